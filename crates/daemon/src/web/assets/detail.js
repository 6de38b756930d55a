// The selected row: its last window as a table, its deviations beside the nearest fault states.

import { HARMONICS, RANKS, codeOf, colourOf, css, el, fit, inkOn, known, lookOf, node, percent, plain, shade, strengthOf, text, view } from "./state.js";
import { iso } from "./time.js";
import { drawIndicators } from "./indicators.js";
import { wantHistory } from "./history.js";
import { drawTrends } from "./trend.js";
import { LIMITS, frame } from "./limits.js";

export function drawDetail() {
  const row = view.selected;
  const last = row.last;
  if (!last) return;
  const name = `${row.bench} · ${row.stage} · ${row.channel}`;
  if (el("h-detail").textContent !== name) el("h-detail").textContent = name;
  const why = last.reason ? ` (${plain(last.reason)})` : "";
  el("window").textContent = `${plain(last.machine)}${why}, instrument ${plain(last.instrument)} · window ${last.window}, ${iso(last.t0_ns)} · mesh ${text(last.mesh_hz, 6, "Hz")}${known(last.brake_torque_nm) ? `, ${text(last.brake_torque_nm, 4, "N m")}` : ""}${last.cell ? ` · baseline cell ${last.cell}` : ""}`;
  el("doubts").hidden = !last.doubts;
  el("doubts").textContent = `Doubtful: ${plain((last.doubts || "").replaceAll(" ", ", "))} (gearwatch check says what to do)`;
  el("ranks").tBodies[0].replaceChildren(...HARMONICS.map((h) => harmonicRow(h, last)));
  drawIndicators(row);
  drawTrends(row);
  wantHistory();
  drawPillars(last);
}

function harmonicRow(h, last) {
  const look = lookOf(last.machine, last[`level_${h}x`]);
  const strength = strengthOf(look, last[`level_${h}x`], last[`p_${h}x`]);
  const badge = node("b", { style: `background:${shade(look, strength)};color:${inkOn(look, Math.round(100 * strength) / 100)}` }, codeOf(last, h));
  const sigma = last[`dev_sigma_${h}x_percent`];
  return node("tr", {}, node("th", { scope: "row" }, (last.shared || "").includes(`${h}x`) ? `${h}x, shared` : `${h}x`), node("td", { class: "rank" }, badge),
    node("td", {}, known(last[`p_${h}x`]) ? `${(100 * last[`p_${h}x`]).toFixed(0)} %` : "–"),
    node("td", {}, `${percent(last[`dev_${h}x_percent`])} ± ${known(sigma) ? sigma.toFixed(1) : "–"}`),
    node("td", {}, text(last[`amp_${h}x`], 4, last.unit)), node("td", {}, text(last[`base_${h}x`], 4)), node("td", {}, text(last[`floor_${h}x`], 2)));
}

// A fault state's pillars: signed where its table knows the sign; where it knows ranks alone, the middle of the rank on the side of the
// measured deviation, drawn from the rank's lower to its upper step.
const STEP = [0, ...LIMITS, 16];
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
  const limit = frame(Math.max(0, ...groups.flatMap((s) => s.dev.map((d) => (known(d) ? Math.abs(d) : 0)))));
  const left = 52;
  const bottom = 18;
  const y = (d) => (height - bottom) * (0.5 - Math.max(-limit, Math.min(limit, d)) / (2 * limit));
  g.font = "11px system-ui";
  g.textBaseline = "middle";
  const steps = limit > 32 ? [13, limit / 2] : limit > 16 ? [1, 7, 13, 24] : LIMITS;
  for (const step of [0, ...steps, ...steps.map((s) => -s)]) {
    g.strokeStyle = css(step === 0 ? "--soft" : "--line");
    g.beginPath();
    g.moveTo(left, y(step));
    g.lineTo(width, y(step));
    g.stroke();
    g.fillStyle = css("--soft");
    g.textAlign = "right";
    const rank = LIMITS.indexOf(Math.abs(step)) + 1;
    if (step === 0 || (Math.abs(step) === 1 && limit > 16)) continue;
    g.fillText(`${rank ? `${RANKS[rank]} ` : ""}${step > 0 ? "+" : "−"}${Math.abs(step)} %`, left - 4, y(step));
  }
  const slot = (width - left) / HARMONICS.length;
  const bar = Math.min(26, (slot * 0.8) / groups.length);
  const inks = [null, css("--accent"), css("--warn"), css("--unknown")];
  HARMONICS.forEach((h, i) => {
    groups.forEach((s, k) => {
      const d = s.dev[i];
      if (!known(d)) return;
      const x = left + i * slot + slot * 0.1 + k * bar;
      g.fillStyle = k === 0 ? colourOf(last, h) : inks[k];
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
  el("states").replaceChildren(...near.map((s, k) => node("li", {}, node("i", { style: `background:${inks[k + 1]}` }), `${plain(s.name)}: ${(100 * s.probability).toFixed(0)} %`)));
}
