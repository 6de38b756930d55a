// The past of the selected row from the service's log: any time, in steps that fit the screen, with what happened.

import { HARMONICS, css, el, invalidate, known, node, percent, plain, remember, remembered, text, view } from "./state.js";
import { Plot, Zoom, axis, levels, lonePoints, moments, timeAxis } from "./plot.js";
import { frame, limitLines } from "./limits.js";
import { iso } from "./time.js";
import { lookAt, lookedAt, rawStretches, wantThen } from "./then.js";

// [kind of event: sign, ink] and [state: ink] below; a step is what the service put together for one point.
const HOUR = 3600;
const SPANS = [[HOUR / 4, "15 min"], [HOUR, "1 h"], [24 * HOUR, "1 day"], [7 * 24 * HOUR, "1 week"], [30 * 24 * HOUR, "30 days"], [365 * 24 * HOUR, "1 year"]];
const INKS = ["--h1", "--h2", "--h3", "--h4", "--h5"];
const SIGNS = { alarm: ["A", "--bad"], acknowledged: ["S", "--accent"], ended: ["E", "--ok"], reload: ["R", "--warn"], gap: ["G", "--warn"], note: ["N", "--soft"] };
const BAND = { normal: "--ok", deviating: "--r3", path_changed: "--rp", alarm: "--bad", unknown: "--ru" };
const REFRESH_MS = 15000;
const POLL_MS = 700;
const MOST_EVENTS = 200;
const MOST_MARKS = 60; // more would hide the curves

const asked = { span: Number(remembered("history-span", HOUR)) || HOUR, back: 0, quantity: remembered("history-quantity", "speed_hz") };
let answer = null; // the newest, with the row that it is of
let of = ""; // the row of the answer
let wanted = ""; // the row that was asked for last
let half = 16;
let timer = 0;
let round = 0;
let anewThen = false; // somebody has chosen another time or row
const zoom = new Zoom();

const marked = () => (answer?.events || []).filter((e) => e.kind !== "note").slice(-MOST_MARKS);
const marks = (u, g) => {
  const looked = lookedAt();
  const here = looked === null ? [] : [{ at: looked / 1e9, ink: css("--focus"), word: "▼" }];
  moments(u, g, [...marked().map((e) => ({ at: e.t_ns / 1e9, ink: css(SIGNS[e.kind]?.[1] || "--soft"), word: SIGNS[e.kind]?.[0] || "?" })), ...here]);
};
// Where the log has raw data: a line at the top.
function raw(u, g) {
  const ratio = window.devicePixelRatio || 1;
  const x = (ns) => Math.min(u.bbox.left + u.bbox.width, Math.max(u.bbox.left, u.valToPos(ns / 1e9, "x", true)));
  g.fillStyle = css("--accent");
  for (const [from, to] of rawStretches()) g.fillRect(x(from), u.bbox.top, Math.max(2 * ratio, x(to) - x(from)), 4 * ratio);
}
// The gravest state of each step as a band below the curves.
function band(u, g) {
  const ratio = window.devicePixelRatio || 1;
  const x = (t) => Math.min(u.bbox.left + u.bbox.width, Math.max(u.bbox.left, u.valToPos(t, "x", true)));
  answer.machine.forEach((state, i) => {
    const [from, to] = [x(answer.t0_s[i]), x(answer.t0_s[i] + answer.every_s)];
    g.fillStyle = css(BAND[state] || "--ru");
    if (to > from) g.fillRect(from, u.bbox.top + u.bbox.height - 6 * ratio, Math.max(3 * ratio, to - from), 6 * ratio);
  });
}
const cursor = { drag: { x: true, y: false, setScale: false }, sync: { key: "history" }, bind: { dblclick: () => () => zoom.set(null) } };
const scaleX = () => ({ range: (u, min, max) => (zoom.range ? [min, max] : [answer.from, answer.to]) });

const deviations = new Plot(el("history-deviations"), {
  name: "History of deviations", zoom, height: 260,
  title: () => `History of deviations, ${of}`,
  options: () => ({
    scales: { x: scaleX(), y: { range: () => [-half, half] } },
    axes: [timeAxis(), axis("deviation (%)", { size: 56 })],
    series: [{}, ...HARMONICS.map((h) => ({ label: `dev_${h}x_percent`, stroke: css(INKS[h - 1]), width: 1.4, points: lonePoints(css(INKS[h - 1])) }))], cursor,
  }),
  marks: (u, g) => {
    if (!answer) return;
    levels(u, g, limitLines(half));
    band(u, g);
    raw(u, g);
    marks(u, g);
  },
  read: (u, i) => {
    const place = i;
    i = answer ? answer.t0_s.indexOf(u.data[0][place] - answer.every_s / 2) : -1;
    if (i < 0) return "";
    const event = answer.events.find((e) => e.t_ns / 1e9 >= answer.t0_s[i] && e.t_ns / 1e9 < answer.t0_s[i] + answer.every_s);
    return `${iso(1e9 * answer.t0_s[i])} · ${answer.windows[i]} windows, gravest ${plain(answer.machine[i])}${answer.not_ok[i] ? `, ${answer.not_ok[i]} not ok` : ""} · ${HARMONICS.map((h) => `${h}x ${percent(u.data[h][place])} ± ${text(answer.dev_sigma[h - 1][i], 2)}`).join(" · ")}${event ? ` · ${event.kind}: ${event.text}` : ""}`;
  },
});

// The name stands above; beside a plot as low as this one it would be cut off.
const unitOf = (name) => name.match(/\(([^()]+)\)$/)?.[1] || name;
const other = new Plot(el("history-other"), {
  name: "History of a quantity", zoom, height: 200,
  title: () => `${asked.quantity}, ${of}`,
  options: () => ({
    scales: { x: scaleX() },
    axes: [timeAxis(), axis(unitOf(el("history-quantity").selectedOptions[0].textContent), { size: 64 })],
    series: [{}, { label: asked.quantity, stroke: css("--accent"), width: 1.6, points: lonePoints(css("--accent")) }], cursor,
  }),
  marks: (u, g) => answer && marks(u, g),
  read: (u, i) => `${iso(1e9 * u.data[0][i])} · ${el("history-quantity").selectedOptions[0].textContent} ${text(u.data[1][i], 5)}`,
});

const column = () => (asked.quantity === "speed_hz" || asked.quantity === "torque_nm" ? answer[asked.quantity] : answer.indicator) || answer.t0_s.map(() => null);

export function drawHistory() {
  if (!answer || !el("history").open) return;
  const shown = answer.dev.flatMap((dev) => dev.filter(known).map(Math.abs));
  half = frame(shown.length ? Math.max(...shown) : 0);
  // A step is drawn at its middle; where there is none, the line ends.
  const [t, ...columns] = broken(answer.t0_s, [...answer.dev, column()], answer.every_s);
  const middle = t.map((s) => s + answer.every_s / 2);
  const shape = `${of}#${half}#${asked.span}`;
  deviations.show(shape, [middle, ...columns.slice(0, HARMONICS.length)]);
  other.show(`${shape}#${asked.quantity}`, [middle, columns.at(-1)]);
}

// With a step of nothing wherever steps are missing, so that no line leads across.
function broken(t, columns, every) {
  const out = [[], ...columns.map(() => [])];
  t.forEach((s, i) => {
    if (i > 0 && s - t[i - 1] > every) {
      out[0].push(t[i - 1] + every);
      columns.forEach((_, k) => out[k + 1].push(null));
    }
    out[0].push(s);
    columns.forEach((column, k) => out[k + 1].push(column[i]));
  });
  return out;
}

function told() {
  const { files, to_read, troubled, t0_s, every_s } = answer;
  const left = to_read ? `Reading: ${files - to_read} of ${files} files. ` : "";
  const bad = troubled ? ` ${troubled} file${troubled > 1 ? "s" : ""} not read to the end (gearwatch doctor says more).` : "";
  const none = !to_read && t0_s.length === 0 ? "The log holds no window of this row in this time. " : "";
  el("history-state").textContent = `${left}${none}${t0_s.length} steps of ${every_s >= HOUR ? `${every_s / HOUR} h` : every_s >= 60 ? `${every_s / 60} min` : `${every_s} s`} from ${iso(1e9 * answer.from)} to ${iso(1e9 * answer.to)}.${bad}`;
  const list = answer.events.slice(-MOST_EVENTS).reverse();
  el("history-events").tBodies[0].replaceChildren(...(list.length ? list.map((e) => node("tr", {}, node("th", { scope: "row" }, iso(e.t_ns)), node("td", {}, `${SIGNS[e.kind]?.[0] || ""} ${e.kind}`), node("td", {}, e.text))) : [node("tr", {}, node("td", { colspan: "3" }, "none"))]));
}

async function read() {
  clearTimeout(timer);
  const row = view.selected;
  if (!row || !el("history").open) return;
  const mine = ++round;
  wanted = row.key;
  const to = Date.now() / 1000 - asked.back * asked.span;
  const from = to - asked.span;
  const ns = (s) => `${Math.round(s)}000000000`;
  const indicator = ["speed_hz", "torque_nm"].includes(asked.quantity) ? "" : asked.quantity;
  const query = new URLSearchParams({ bench: row.bench, stage: row.stage, channel: row.channel, from: ns(from), to: ns(to), indicator });
  const reply = await fetch(`/api/history?${query}`).catch(() => null);
  if (mine !== round) return;
  let wait = REFRESH_MS;
  if (reply?.ok) {
    const now = await reply.json();
    if (mine !== round) return;
    answer = { ...now, from, to };
    of = row.key;
    told();
    drawHistory();
    wantThen(row, ns(from), ns(to), anewThen);
    anewThen = false;
    if (now.to_read) wait = POLL_MS;
  } else {
    el("history-state").textContent = !reply ? "The service does not answer." : (await reply.text()).trim();
  }
  timer = setTimeout(read, wait);
}

// Asks anew where another row or another time is wanted.
export function wantHistory(anew = false) {
  if (!anew && !(view.selected && view.selected.key !== wanted)) return;
  anewThen = true;
  read();
}

function back() {
  const spans = asked.back;
  el("history-back-words").textContent = spans === 0 ? "up to now" : `up to ${iso(1e6 * (Date.now() - 1000 * spans * asked.span))}`;
}

for (const [seconds, name] of SPANS) {
  const button = node("button", { type: "button", "aria-pressed": String(seconds === asked.span) }, name);
  button.addEventListener("click", () => {
    asked.span = seconds;
    remember("history-span", seconds);
    for (const one of el("history-span").children) one.setAttribute("aria-pressed", String(one === button));
    zoom.set(null);
    back();
    wantHistory(true);
  });
  el("history-span").append(button);
}
el("history-back").addEventListener("input", () => {
  asked.back = -Number(el("history-back").value);
  zoom.set(null);
  back();
  clearTimeout(timer);
  anewThen = true;
  timer = setTimeout(read, 250);
});
// A click, not a drag, looks at that time.
let down = 0;
el("history-deviations").addEventListener("mousedown", (event) => { down = event.clientX; });
el("history-deviations").addEventListener("click", (event) => {
  if (!deviations.u || event.shiftKey || Math.abs(event.clientX - down) > 4 || !event.target.classList.contains("u-over")) return;
  if (!el("then").open) el("then").open = true;
  lookAt(1e9 * deviations.u.posToVal(event.clientX - deviations.u.over.getBoundingClientRect().left, "x"));
  drawHistory();
});
el("then").addEventListener("toggle", () => {
  if (el("then").open) wantHistory(true);
});
const plainIndicators = ["rms", "peak", "crest_factor", "kurtosis", "velocity_rms"];
const gearIndicators = ["fm0", "fm4", "m6a", "m8a", "energy_ratio", "residual_rms", "residual_kurtosis", "difference_rms", "envelope_deviation", "envelope_kurtosis", "sideband_index", "sideband_ratio"];
for (const [value, name] of [["speed_hz", "speed of the input shaft (Hz)"], ["torque_nm", "torque at the brake (N m)"], ...[...plainIndicators, ...["pinion", "wheel"].flatMap((s) => gearIndicators.map((g) => `${s}_${g}`))].map((n) => [n, plain(n)])]) {
  el("history-quantity").append(node("option", { value }, name));
}
el("history-quantity").value = asked.quantity;
if (el("history-quantity").selectedIndex < 0) el("history-quantity").value = asked.quantity = "speed_hz";
el("history-quantity").addEventListener("change", () => {
  asked.quantity = el("history-quantity").value;
  remember("history-quantity", asked.quantity);
  wantHistory(true);
});
el("history").addEventListener("toggle", () => {
  remember("history-open", el("history").open ? "1" : "0");
  if (el("history").open) wantHistory(true);
  invalidate("detail");
});
el("history").open = remembered("history-open", "0") === "1";
back();
