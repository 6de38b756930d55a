// The selected row: its last window as a table, its past beside the baseline, its deviations beside the nearest fault states.

import { HARMONICS, RANKS, clock, codeOf, css, el, fit, invalidate, known, lookOf, node, percent, shade, strengthOf, text, view } from "./state.js";
import { axis, sized } from "./plot.js";

let trendPlot = null;

export function drawDetail() {
  const row = view.selected;
  const last = row.last;
  if (!last) return;
  el("h-detail").textContent = `${row.stage} · ${row.channel}, window ${last.window}, ${clock(last.t0_ns)}, mesh ${text(last.mesh_hz, 6, "Hz")}`;
  el("doubts").hidden = !last.doubts;
  el("doubts").textContent = `Doubtful: ${(last.doubts || "").replaceAll(" ", ", ").replaceAll("_", " ")} (gearwatch check says what to do)`;
  el("ranks").tBodies[0].replaceChildren(...HARMONICS.map((h) => harmonicRow(h, last)));
  drawTrend(row);
  drawPillars(last);
}

function colour(last, h) {
  const level = last[`level_${h}x`];
  const look = lookOf(last.machine, level);
  return shade(look, strengthOf(look, level, last[`p_${h}x`]));
}

function harmonicRow(h, last) {
  const badge = node("b", { style: `background:${colour(last, h)}` }, codeOf(last, h));
  const sigma = last[`dev_sigma_${h}x_percent`];
  return node("tr", {}, node("th", { scope: "row" }, (last.shared || "").includes(`${h}x`) ? `${h}x, shared` : `${h}x`), node("td", { class: "rank" }, badge),
    node("td", {}, known(last[`p_${h}x`]) ? `${(100 * last[`p_${h}x`]).toFixed(0)} %` : "–"),
    node("td", {}, `${percent(last[`dev_${h}x_percent`])} ± ${known(sigma) ? sigma.toFixed(1) : "–"}`),
    node("td", {}, text(last[`amp_${h}x`], 4, last.unit)), node("td", {}, text(last[`base_${h}x`], 4)), node("td", {}, text(last[`floor_${h}x`], 2)));
}

function drawTrend(row) {
  const host = el("trend");
  const k = view.harmonic - 1;
  const t = Array.from(row.past.t0.subarray(row.past.start, row.past.end), (ns) => ns / 1e9);
  const base = row.past.column("base", k);
  const sigma = row.past.column("sigma", k);
  const band = (sign) => base.map((b, i) => (b === null || sigma[i] === null ? null : b * (1 + (sign * 2 * sigma[i]) / 100)));
  trendPlot = sized(host, (width) => new uPlot({
    width, height: 240, legend: { show: false }, cursor: { drag: { x: true, y: false } },
    axes: [axis(""), axis(`${view.harmonic}x (${row.unit})`)],
    series: [{}, { label: "amplitude", stroke: css("--accent"), width: 2 }, { label: "baseline", stroke: css("--ok"), width: 1 },
      { label: "+2σ", stroke: css("--line") }, { label: "−2σ", stroke: css("--line") }],
    bands: [{ series: [3, 4], fill: `${css("--r0")}33` }],
  }, [[], [], [], [], []], host), trendPlot, `${row.key}#${view.harmonic}`);
  trendPlot.u.setData([t, row.past.column("amp", k), base, band(1), band(-1)]);
}

// A fault state's pillars: signed where its table knows the sign; where it knows ranks alone, the middle of the rank on the side of the
// measured deviation, drawn from the rank's lower to its upper step.
const STEP = [0, 1, 4, 7, 10, 13, 16];
function pattern(expected, last) {
  const dev = [];
  const range = [];
  HARMONICS.forEach((h, i) => {
    const e = expected[i] || {};
    const side = last[`dev_${h}x_percent`] < 0 ? -1 : 1;
    const rank = RANKS.indexOf(e.rank);
    dev.push(known(e.percent) ? e.percent : rank < 0 ? null : side * 0.5 * (STEP[rank] + STEP[rank + 1]));
    range.push(known(e.percent) || rank < 0 ? null : [side * STEP[rank], side * STEP[rank + 1]]);
  });
  return { dev, range };
}

function drawPillars(last) {
  const { g, width, height } = fit(el("pillars"));
  const near = (Array.isArray(last.states) ? last.states : []).slice(0, 3);
  const groups = [{ name: "now", dev: HARMONICS.map((h) => last[`dev_${h}x_percent`]), sigma: HARMONICS.map((h) => last[`dev_sigma_${h}x_percent`]) }]
    .concat(near.map((s) => ({ name: s.name, sigma: [], ...pattern(s.expected || [], last) })));
  const limit = Math.max(15, ...groups.flatMap((s) => s.dev.map((d, i) => (known(d) ? Math.abs(d) + (s.sigma[i] || 0) : 0)))) * 1.08;
  const left = 40;
  const bottom = 18;
  const y = (d) => (height - bottom) * (0.5 - d / (2 * limit));
  g.font = "11px system-ui";
  g.textBaseline = "middle";
  for (const step of [-13, -10, -7, -4, -1, 1, 4, 7, 10, 13]) {
    g.strokeStyle = css("--line");
    g.beginPath();
    g.moveTo(left, y(step));
    g.lineTo(width, y(step));
    g.stroke();
    if (Math.abs(step) !== 1) {
      g.fillStyle = css("--soft");
      g.textAlign = "right";
      g.fillText(`${step > 0 ? "+" : "−"}${Math.abs(step)} %`, left - 4, y(step));
    }
  }
  const slot = (width - left) / HARMONICS.length;
  const bar = Math.min(26, (slot * 0.8) / groups.length);
  const inks = [null, css("--accent"), css("--warn"), css("--unknown")];
  HARMONICS.forEach((h, i) => {
    groups.forEach((s, k) => {
      const d = s.dev[i];
      if (!known(d)) return;
      const x = left + i * slot + slot * 0.1 + k * bar;
      g.fillStyle = k === 0 ? colour(last, h) : inks[k];
      const range = s.range && s.range[i];
      if (range) {
        const [near0, far] = range.map(y);
        g.fillRect(x, Math.min(near0, far), bar - 2, Math.max(1, Math.abs(far - near0)));
        return;
      }
      g.fillRect(x, Math.min(y(0), y(d)), bar - 2, Math.max(1, Math.abs(y(d) - y(0))));
      if (k === 0 && known(s.sigma[i])) {
        g.strokeStyle = css("--ink");
        g.beginPath();
        g.moveTo(x + bar / 2 - 1, y(d - s.sigma[i]));
        g.lineTo(x + bar / 2 - 1, y(d + s.sigma[i]));
        g.stroke();
      }
    });
    g.fillStyle = css("--soft");
    g.textAlign = "center";
    g.fillText(`${h}x`, left + (i + 0.5) * slot, height - bottom / 2);
  });
  const words = { none: "No known state fits these deviations. The nearest, and their shares of the likelihood:", several: "Several states fit about equally.", not_compared: "Not compared: nothing is known of the deviations." };
  el("fit").textContent = words[last.state_fit] || "";
  el("states").replaceChildren(...near.map((s, k) => node("li", {}, node("i", { style: `background:${inks[k + 1]}` }), `${s.name.replaceAll("_", " ")}: ${(100 * s.probability).toFixed(0)} %`)));
}

for (const h of HARMONICS) {
  const button = node("button", { type: "button", "aria-pressed": String(h === view.harmonic) }, `${h}x`);
  button.addEventListener("click", () => {
    view.harmonic = h;
    for (const other of el("pick").children) other.setAttribute("aria-pressed", String(other === button));
    invalidate("detail");
  });
  el("pick").append(button);
}
