// Any time of the past: the spectra of what the history shows as a waterfall, one of them as a curve, and the raw data where the log has some.

import { css, el, invalidate, known, spectra as live, text, view } from "./state.js";
import { Plot, axis } from "./plot.js";
import { Waterfall, line } from "./waterfall.js";
import { bandOf, forgetNormal, normalOf, setNormal } from "./normal.js";
import { marks } from "./spectrum.js";
import { drawRaw, offerRaw } from "./waveform.js";
import { iso } from "./time.js";

const DECADES = 5; // that the ordinate spans
const POLL_MS = 700;
const AGAIN_MS = 20000; // the newest file is read again so often

let answer = null; // spectra and times of raw data of { row, from, to }
let asked = ""; // what was asked for last, and when
let askedAt = 0;
let at = null; // the time that is looked at (ns); null: the newest
let timer = 0;
let top = 1;

const list = () => answer?.spectra || [];
// The spectrum nearest to the time that is looked at.
function chosen() {
  const all = list();
  if (all.length === 0) return null;
  if (at === null) return all.at(-1);
  return all.reduce((a, b) => (Math.abs(b.t0_ns - at) < Math.abs(a.t0_ns - at) ? b : a));
}
const linesOf = (row) => live.get(`${row.bench}/${row.channel}`)?.last?.lines || [];

const plot = new Plot(el("then-spectrum"), {
  name: "Spectrum of then", x: "order", height: 300,
  title: () => `Order spectrum, ${answer.row.bench}/${answer.row.channel}, ${iso(chosen()?.t0_ns)}`,
  options: () => ({
    scales: { x: { time: false }, y: { distr: 3, range: () => [top / 10 ** DECADES, top] } },
    axes: [axis("order of the input shaft"), axis(chosen()?.unit || "", { size: 64, values: (u, ticks) => ticks.map((t) => (t && Number.isInteger(Math.round(1e6 * Math.log10(t)) / 1e6) ? t.toExponential(0) : "")) })],
    series: [{}, { label: "amplitude", stroke: css("--accent"), width: 1 }, { label: "normal_high", stroke: css("--ok"), width: 0.5 }, { label: "normal_low", stroke: css("--ok"), width: 0.5 }],
    bands: [{ series: [2, 3], fill: `${css("--r0")}55` }],
  }),
  marks: (u, g) => answer && marks(u, g, linesOf(answer.row)),
  read: (u, i) => `order ${u.data[0][i].toFixed(3)} · ${text(u.data[1][i], 4, chosen()?.unit)}${known(u.data[2][i]) ? ` · normal ${text(u.data[3][i], 3)} to ${text(u.data[2][i], 3)}` : ""}`,
});
const waterfall = new Waterfall(el("then-waterfall"), el("then-values"), el("then-png"));
plot.zoom.told.push(() => invalidate("then"));

export function drawThen() {
  if (!el("then").open || !answer) return;
  const s = chosen();
  for (const part of el("then").querySelectorAll(".of-spectra")) part.hidden = !s;
  drawRaw(answer, at ?? answer.to_ns);
  if (!s) return;
  const largest = s.amplitude.reduce((a, b) => Math.max(a, b), 1e-12);
  const decade = 10 ** Math.ceil(Math.log10(largest * 1.05));
  if (decade > top || decade < top / 10) top = decade;
  const floor = top / 10 ** DECADES;
  const orders = s.amplitude.map((_, i) => s.first_order + i * s.order_step);
  const normal = normalOf(answer.row);
  const band = bandOf(normal, orders, floor);
  plot.show(`${answer.row.key}#${top}`, [orders, s.amplitude.map((a) => Math.max(a, floor)), band.high, band.low]);
  waterfall.draw(answer.lines, plot);
  el("then-normal").textContent = normal ? `Normal: ${normal.spectra} spectra from ${iso(Number(normal.from))}; forget` : "Take these spectra as normal";
  el("then-normal").setAttribute("aria-pressed", String(!!normal));
}

function told() {
  const s = chosen();
  const slider = el("then-slider");
  slider.max = String(Math.max(0, list().length - 1));
  slider.value = String(s ? list().indexOf(s) : 0);
  slider.disabled = list().length < 2;
  slider.setAttribute("aria-valuetext", s ? iso(s.t0_ns) : "none");
  el("then-time").textContent = s ? iso(s.t0_ns) : "";
  const reading = answer.to_read ? ` ${answer.to_read} files are still to be read.` : "";
  el("then-state").textContent = `${list().length ? `${list().length} spectra from ${iso(list()[0].t0_ns)} to ${iso(list().at(-1).t0_ns)}.` : "The log holds no spectrum of this time."}${reading}`;
}

async function read(row, from, to) {
  clearTimeout(timer);
  const query = new URLSearchParams({ bench: row.bench, channel: row.channel, from, to });
  const mine = (asked = `${row.key} ${from} ${to}`);
  askedAt = performance.now();
  const reply = await fetch(`/api/spectra?${query}`).catch(() => null);
  if (mine !== asked) return;
  if (!reply?.ok) {
    el("then-state").textContent = !reply ? "The service does not answer." : (await reply.text()).trim();
    return;
  }
  const heard = await reply.json();
  if (mine !== asked) return;
  answer = { ...heard, row, from, to, to_ns: Number(to), lines: heard.spectra.map(line) };
  offerRaw(answer);
  told();
  invalidate("then");
  if (heard.to_read) timer = setTimeout(() => read(row, from, to), POLL_MS);
}

let shown = ""; // row and span that the history shows, without the moments by which it moves along
// The history shows this time of this row; `anew`: somebody has chosen another.
export function wantThen(row, from, to, anew) {
  const now = `${row.key} ${Number(to) - Number(from)}`;
  if (now !== shown || anew) at = null;
  const due = now !== shown || anew || performance.now() - askedAt > AGAIN_MS;
  shown = now;
  if (el("then").open && due) read(row, from, to);
  else if (!el("then").open) asked = shown = "";
}

// Looks at a time (ns).
export function lookAt(ns) {
  at = ns;
  if (answer) told();
  invalidate("then");
}

export const lookedAt = () => (el("then").open && answer ? at ?? chosen()?.t0_ns ?? null : null);
export const rawStretches = () => (el("then").open && answer ? answer.raw : []);

el("then-slider").addEventListener("input", () => {
  const s = list()[Number(el("then-slider").value)];
  if (s) lookAt(s.t0_ns);
  invalidate("history");
});
el("then-waterfall").addEventListener("click", (event) => {
  const there = waterfall.at(event);
  if (!there) return;
  lookAt(there.row.t0);
  invalidate("history");
});
el("then-normal").addEventListener("click", () => {
  if (!answer || !view.selected) return;
  if (normalOf(answer.row)) forgetNormal(answer.row);
  else if (!setNormal(answer.row, answer.from, answer.to, list())) el("then-state").textContent = "Too few spectra: five are needed for a band.";
  invalidate("then");
});
