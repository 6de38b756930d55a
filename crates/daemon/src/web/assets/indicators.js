// Condition indicators of the selected row: value, normal value, deviation, and how many sigmas that is.

import { el, known, node, percent, text } from "./state.js";

// [key, name, unit where it is not the channel's]
const CHANNEL = [["rms", "RMS"], ["peak", "Peak"], ["crest_factor", "Crest factor", "1"], ["kurtosis", "Kurtosis", "1"], ["velocity_rms", "Velocity RMS 10–1000 Hz", "mm/s"]];
const GEAR = [["fm0", "FM0", "1"], ["fm4", "FM4", "1"], ["m6a", "M6A", "1"], ["m8a", "M8A", "1"], ["energy_ratio", "Energy ratio", "1"], ["residual_rms", "Residual RMS"], ["residual_kurtosis", "Residual kurtosis (NA4)", "1"],
  ["difference_rms", "Difference RMS"], ["envelope_deviation", "Envelope deviation"], ["envelope_kurtosis", "Envelope kurtosis (NB4)", "1"], ["sideband_index", "Sideband index"], ["sideband_ratio", "Sideband ratio", "1"]];
const ALL = [...CHANNEL.map((c) => ["channel", ...c]), ...["pinion", "wheel"].flatMap((side) => GEAR.map(([key, name, unit]) => [side, `${side}_${key}`, name, unit]))];

// Gears are looked at every tenth window: what they said last stands until they say something else.
export function takeIndicators(row, v) {
  for (const [, key] of ALL) {
    if (!known(v[key])) continue;
    row.indicators[key] = { t0: v.t0_ns, window: v.window, value: v[key], sigma: v[`${key}_sigma`], base: v[`${key}_base`], dev: v[`${key}_dev_percent`], devSigma: v[`${key}_dev_sigma_percent`] };
  }
}

const lines = new Map(); // key → cells, written anew only where they changed

function set(cell, words) {
  if (cell.textContent !== words) cell.textContent = words;
}

export function drawIndicators(row) {
  const any = ALL.some(([, key]) => row.indicators[key]);
  el("indicators-panel").hidden = !any;
  if (!any) return;
  if (lines.size === 0) {
    for (const [place, key, name] of ALL) {
      const cells = [0, 1, 2, 3].map(() => node("td", {}));
      const line = node("tr", {}, node("th", { scope: "row" }, place === "channel" ? name : `${name}, ${place}`), ...cells);
      lines.set(key, { line, cells });
      el("indicators").tBodies[0].append(line);
    }
  }
  for (const [, key, , unit] of ALL) {
    const { line, cells } = lines.get(key);
    const x = row.indicators[key];
    line.hidden = !x;
    if (!x) continue;
    const u = unit === "1" ? "" : unit || row.unit;
    set(cells[0], `${text(x.value, 4)}${known(x.sigma) ? ` ± ${text(x.sigma, 2)}` : ""}${u ? ` ${u}` : ""}`);
    set(cells[1], text(x.base, 4));
    set(cells[2], `${percent(x.dev)}${known(x.devSigma) ? ` ± ${x.devSigma.toFixed(1)}` : ""}`);
    const off = known(x.dev) && x.devSigma > 0 ? x.dev / x.devSigma : null;
    set(cells[3], known(off) ? `${off > 0 ? "+" : off < 0 ? "−" : ""}${Math.abs(off).toFixed(1)} σ` : "–");
    cells[3].dataset.far = String(known(off) && Math.abs(off) >= 3);
  }
}
