// The past of the selected row: deviations of 1x to 5x with the rank limits, and one amplitude beside its baseline.

import { HARMONICS, css, el, invalidate, known, node, percent, text, view } from "./state.js";
import { Plot, Zoom, axis, levels, moments, timeAxis } from "./plot.js";
import { frame, limitLines } from "./limits.js";
import { iso } from "./time.js";

export const time = new Zoom(); // all plots over time show the same time
const INKS = ["--h1", "--h2", "--h3", "--h4", "--h5"];
let half = 16;
let of = null; // what is shown: { row, t, amp, base, sigma, dev }

// The live past of a row as columns.
function live(row) {
  const past = row.past;
  return { t: Array.from(past.t0.subarray(past.start, past.end), (ns) => ns / 1e9), column: (name, k) => past.column(name, k) };
}

// When alarms of the row came and were seen.
function events(row) {
  const bench = (view.status?.benches || []).find((b) => b.name === row.bench);
  const alarms = (bench?.alarms || []).filter((a) => a.stage === row.stage && a.channel === row.channel);
  return alarms.flatMap((a) => [{ at: a.since_ns / 1e9, ink: css("--bad"), word: "A" }, ...(a.seen ? [{ at: a.seen.t_ns / 1e9, ink: css("--accent"), word: "S" }] : [])]);
}

const deviations = new Plot(el("deviations"), {
  name: "Deviations", zoom: time, height: 260,
  title: () => `Deviations, ${of.row.key}`,
  options: () => ({
    scales: { y: { range: () => [-half, half] } },
    axes: [timeAxis(), axis("deviation (%)", { size: 56 })],
    series: [{}, ...HARMONICS.map((h) => ({ label: `dev_${h}x_percent`, stroke: css(INKS[h - 1]), width: h === view.harmonic ? 2.5 : 1.2, spanGaps: false }))],
    cursor: { drag: { x: true, y: false, setScale: false }, sync: { key: "time" }, bind: { dblclick: () => () => time.set(null) } },
  }),
  marks: (u, g) => {
    levels(u, g, limitLines(half));
    if (of) moments(u, g, events(of.row));
  },
  read: (u, i) => `${iso(1e9 * u.data[0][i])} · ${HARMONICS.map((h) => `${h}x ${percent(u.data[h][i])}`).join(" · ")}`,
});

const amplitude = new Plot(el("trend"), {
  name: "Amplitude", zoom: time, height: 260,
  title: () => `Amplitude ${view.harmonic}x, ${of.row.key}`,
  options: () => ({
    axes: [timeAxis(), axis(`${view.harmonic}x (${of.row.unit})`, { size: 64 })],
    series: [{}, { label: `amp_${view.harmonic}x`, stroke: css("--accent"), width: 2 }, { label: `base_${view.harmonic}x`, stroke: css("--ok"), width: 1 },
      { label: "base_plus_2_sigma", stroke: css("--line") }, { label: "base_minus_2_sigma", stroke: css("--line") }],
    bands: [{ series: [3, 4], fill: `${css("--r0")}33` }],
    cursor: { drag: { x: true, y: false, setScale: false }, sync: { key: "time" }, bind: { dblclick: () => () => time.set(null) } },
  }),
  marks: (u, g) => of && moments(u, g, events(of.row)),
  read: (u, i) => `${iso(1e9 * u.data[0][i])} · ${text(u.data[1][i], 4, of.row.unit)} · baseline ${text(u.data[2][i], 4, of.row.unit)} (${text(u.data[4][i], 4)} to ${text(u.data[3][i], 4)})`,
});

export function drawTrends(row) {
  const { t, column } = live(row);
  const amps = HARMONICS.map((h) => column("amp", h - 1));
  const bases = HARMONICS.map((h) => column("base", h - 1));
  const devs = amps.map((amp, k) => amp.map((a, i) => (a === null || !bases[k][i] ? null : 100 * (a / bases[k][i] - 1))));
  of = { row };
  // The scale is that of the part which is shown; a single far window does not hold it for ever.
  const [from, to] = time.range || [-Infinity, Infinity];
  let largest = 0;
  for (const dev of devs) dev.forEach((d, i) => { if (d !== null && t[i] >= from && t[i] <= to) largest = Math.max(largest, Math.abs(d)); });
  half = frame(largest);
  deviations.show(`${row.key}#${view.harmonic}#${half}`, [t, ...devs]);
  const k = view.harmonic - 1;
  const sigma = column("sigma", k);
  const band = (sign) => bases[k].map((b, i) => (b === null || sigma[i] === null ? null : b * (1 + (sign * 2 * sigma[i]) / 100)));
  amplitude.show(`${row.key}#${view.harmonic}`, [t, amps[k], bases[k], band(1), band(-1)]);
  for (const [i, button] of [...el("pick").children].entries()) button.setAttribute("aria-pressed", String(i === k));
}

time.told.push(() => invalidate("detail"));

for (const h of HARMONICS) {
  const button = node("button", { type: "button", "aria-pressed": String(h === view.harmonic) }, `${h}x`);
  button.addEventListener("click", () => {
    view.harmonic = h;
    invalidate("detail");
  });
  el("pick").append(button);
  for (const id of ["harmonics", "history-harmonics"]) el(id).append(node("li", {}, node("i", { class: `h${h}` }), `${h}x`));
}
