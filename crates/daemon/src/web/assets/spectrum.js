// The selected channel's order spectrum with its mesh lines, what the baseline says of them, and cursors for harmonics and sidebands.

import { HARMONICS, css, el, invalidate, known, rows, spectra, text, view } from "./state.js";
import { Plot, axis } from "./plot.js";
import { cursors, describe, drawCursors, place } from "./cursors.js";
import { Waterfall, precede, remember } from "./waterfall.js";
import { bandOf, normalOf } from "./normal.js";
import { iso } from "./time.js";

const DECADES = 5; // that the ordinate spans

export function onSpectrum(s) {
  el("spectra").hidden = false;
  const key = `${s.bench}/${s.channel}`;
  let store = spectra.get(key);
  if (!store) spectra.set(key, (store = { last: null, held: null, waterfall: [] }));
  store.last = s;
  remember(store, s);
  if (view.selected && key === keyOf(view.selected)) invalidate("spectrum");
}

const keyOf = (row) => `${row.bench}/${row.channel}`;
const chosen = () => view.selected && spectra.get(keyOf(view.selected));
const orderAt = (s, i) => s.first_order + i * s.order_step;

const waterfall = new Waterfall(el("waterfall"), el("waterfall-values"), el("waterfall-png"));
const BEFORE_NS = 15 * 60e9; // of the waterfall that the log fills when a channel is first shown

// The waterfall of before the page was opened; a service without a log has none.
async function fill(store, row) {
  store.filled = true;
  const to = Math.round((store.waterfall[0]?.t0 ?? Date.now() * 1e6) / 1000) * 1000;
  const query = new URLSearchParams({ bench: row.bench, channel: row.channel, from: String(to - BEFORE_NS), to: String(to) });
  const reply = await fetch(`/api/spectra?${query}`).catch(() => null);
  if (!reply?.ok) return;
  precede(store, (await reply.json()).spectra);
  invalidate("spectrum");
}

let top = 1; // decade above the largest line: moves by whole decades only

const plot = new Plot(el("spectrum"), {
  name: "Order spectrum", x: "order", height: 300,
  title: () => `Order spectrum, ${keyOf(view.selected)}, ${iso(chosen().last.t0_ns)}`,
  options: () => ({
    scales: { x: { time: false }, y: { distr: 3, range: () => [top / 10 ** DECADES, top] } },
    axes: [axis("order of the input shaft"), axis(chosen().last.unit, { size: 64, values: (u, ticks) => ticks.map((t) => (t && Number.isInteger(Math.round(1e6 * Math.log10(t)) / 1e6) ? t.toExponential(0) : "")) })],
    series: [{}, { label: "amplitude", stroke: css("--accent"), width: 1 }, { label: "held", stroke: css("--r3"), width: 1 },
      { label: "normal_high", stroke: css("--ok"), width: 0.5 }, { label: "normal_low", stroke: css("--ok"), width: 0.5 }],
    bands: [{ series: [3, 4], fill: `${css("--r0")}55` }],
  }),
  marks: (u, g) => {
    const store = chosen();
    if (!store) return;
    marks(u, g, store.last.lines);
    baseline(u, g, store.last);
    drawCursors(u, g, store.last);
  },
  read: (u, i) => `order ${u.data[0][i].toFixed(3)} · ${text(u.data[1][i], 4, chosen()?.last.unit)}${known(u.data[2][i]) ? ` · held ${text(u.data[2][i], 4)}` : ""}${known(u.data[3][i]) ? ` · normal ${text(u.data[4][i], 3)} to ${text(u.data[3][i], 3)}` : ""}`,
});
plot.zoom.told.push(() => invalidate("spectrum"));

let down = 0;
el("spectrum").addEventListener("mousedown", (event) => { down = event.clientX; });
el("spectrum").addEventListener("click", (event) => {
  const store = chosen();
  if (!store || cursors.mode === "off" || Math.abs(event.clientX - down) > 4 || !event.target.classList.contains("u-over")) return;
  place(plot.u.posToVal(event.clientX - plot.u.over.getBoundingClientRect().left, "x"), store.last, plot.shown());
  invalidate("spectrum");
});

el("hold").addEventListener("click", () => {
  const store = chosen();
  if (!store) return;
  store.held = store.held ? null : store.last;
  invalidate("spectrum");
});

export function drawSpectrum() {
  const store = chosen();
  el("spectra").hidden = !store;
  if (!store) return;
  const s = store.last;
  const largest = s.amplitude.reduce((a, b) => Math.max(a, b), 1e-12);
  const decade = 10 ** Math.ceil(Math.log10(largest * 1.05));
  if (decade > top || decade < top / 10) top = decade;
  const floor = top / 10 ** DECADES;
  const held = store.held && store.held.amplitude.length === s.amplitude.length ? store.held.amplitude.map((a) => Math.max(a, floor)) : s.amplitude.map(() => null);
  el("hold").setAttribute("aria-pressed", String(!!store.held));
  el("hold").textContent = store.held ? `Held: ${iso(store.held.t0_ns)}` : "Hold as reference";
  const orders = s.amplitude.map((_, i) => orderAt(s, i));
  const band = bandOf(normalOf(view.selected), orders, floor);
  plot.show(`${keyOf(view.selected)}#${top}`, [orders, s.amplitude.map((a) => Math.max(a, floor)), held, band.high, band.low]);
  el("cursor-values").textContent = describe(s);
  waterfall.draw(store.waterfall, plot);
  if (!store.filled) fill(store, view.selected);
}

export function inside(u, g, draw) {
  g.save();
  g.beginPath();
  g.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
  g.clip();
  draw();
  g.restore();
}

export function marks(u, g, lines) {
  const stages = [];
  const ratio = window.devicePixelRatio || 1;
  const ends = []; // right ends of the labels of each stage's row
  g.save();
  g.font = `${11 * ratio}px system-ui`;
  for (const line of lines || []) {
    const x = u.valToPos(line.order, "x", true);
    if (x < u.bbox.left || x > u.bbox.left + u.bbox.width) continue;
    g.strokeStyle = line.sideband ? css("--soft") : css("--r4");
    g.setLineDash(line.sideband ? [2 * ratio, 4 * ratio] : []);
    g.beginPath();
    g.moveTo(x, u.bbox.top + (line.sideband ? u.bbox.height * 0.75 : 0));
    g.lineTo(x, u.bbox.top + u.bbox.height);
    g.globalAlpha = 0.55;
    g.stroke();
    g.globalAlpha = 1;
    if (line.sideband) continue;
    // One row of labels a stage: lines of two stages often lie close together. Where there is no room, the line stands without its name.
    const stage = line.label.slice(0, line.label.lastIndexOf(" "));
    if (!stages.includes(stage)) stages.push(stage);
    const lane = stages.indexOf(stage);
    if (x + 3 * ratio < (ends[lane] ?? -Infinity)) continue;
    g.fillStyle = css("--ink");
    g.textAlign = "left";
    g.fillText(line.label, x + 3 * ratio, u.bbox.top + (10 + 13 * lane) * ratio);
    ends[lane] = x + 6 * ratio + g.measureText(line.label).width;
  }
  g.restore();
}

// What the baseline knows: the normal amplitude of each mesh line with its band of two sigmas, a beam at the line.
function baseline(u, g, s) {
  const ratio = window.devicePixelRatio || 1;
  inside(u, g, () => {
    for (const row of rows.values()) {
      const v = row.last;
      if (!v || row.bench !== s.bench || row.channel !== s.channel) continue;
      for (const h of HARMONICS) {
        const line = (s.lines || []).find((l) => !l.sideband && l.label === `${row.stage} ${h}x`);
        const [base, sigma] = [v[`base_${h}x`], v[`dev_sigma_${h}x_percent`]];
        if (!line || !known(base) || base <= 0) continue;
        const x = u.valToPos(line.order, "x", true);
        const y = (a) => u.valToPos(Math.max(a, top / 10 ** DECADES), "y", true);
        const wide = 7 * ratio;
        if (known(sigma)) {
          const [low, high] = [y(base * (1 - sigma / 50)), y(base * (1 + sigma / 50))];
          g.globalAlpha = 0.35;
          g.fillStyle = css("--ok");
          g.fillRect(x - wide, high, 2 * wide, Math.max(ratio, low - high));
          g.globalAlpha = 1;
        }
        g.fillStyle = css("--ok");
        g.fillRect(x - wide, y(base) - ratio, 2 * wide, 2 * ratio);
      }
    }
  });
}
