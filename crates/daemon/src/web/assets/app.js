// The live page: one EventSource, a few canvases, no framework. State is kept per bench, channel and stage; drawing happens at most
// once per animation frame, and only what changed.
"use strict";

const HARMONICS = [1, 2, 3, 4, 5];
const RANKS = ["0", "I", "II", "III", "IV", "V"];
const STEPS = "< 1 %,≥ 1 %,≥ 4 %,≥ 7 %,≥ 10 %,≥ 13 %".split(",");
const KEEP = 7200; // windows kept per row: an hour of two a second
const WATERFALL_ROWS = 120;

const rows = new Map(); // key → { key, bench, stage, channel, verdicts, canvas, … }
const spectra = new Map(); // bench/channel → { last, waterfall: [...] }
let status = null;
let selected = null;
let harmonic = 1;
let span = 0; // seconds that a strip shows; 0: each window by itself
const dirty = new Set();

const el = (id) => document.getElementById(id);
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const rankColour = (level) => css(level < 0 ? "--ru" : `--r${level}`);
const known = (x) => typeof x === "number" && Number.isFinite(x);
const text = (x, digits, unit) => (known(x) ? `${Number(x).toPrecision(digits)}${unit ? ` ${unit}` : ""}` : "–");
const percent = (x) => (known(x) ? `${x > 0 ? "+" : x < 0 ? "−" : ""}${Math.abs(x).toFixed(1)} %` : "–");
const clock = (ns) => new Date(ns / 1e6).toLocaleTimeString();

function node(tag, attributes = {}, ...children) {
  const n = document.createElement(tag);
  // Styles go through the object model: the content security policy forbids style attributes.
  for (const [k, v] of Object.entries(attributes)) k === "style" ? (n.style.cssText = v) : n.setAttribute(k, v);
  n.append(...children);
  return n;
}

function invalidate(what) {
  if (dirty.size === 0) requestAnimationFrame(draw);
  dirty.add(what);
}

/* ---- data in ---- */

function onVerdict(v) {
  const key = `${v.bench}/${v.stage}/${v.channel}`;
  let row = rows.get(key);
  if (!row) {
    row = addRow(key, v);
  }
  const last = row.verdicts[row.verdicts.length - 1];
  if (last && v.t0_ns <= last.t0_ns) {
    // After a reconnect the history is sent again; a restarted replay starts anew.
    if (row.seen.has(v.t0_ns)) return;
    row.verdicts.length = 0;
    row.seen.clear();
  }
  row.verdicts.push(v);
  row.seen.add(v.t0_ns);
  if (row.verdicts.length > KEEP) row.seen.delete(row.verdicts.shift().t0_ns);
  invalidate(key);
  if (row === selected) invalidate("detail");
}

function onSpectrum(s) {
  el("spectra").hidden = false;
  const key = `${s.bench}/${s.channel}`;
  let store = spectra.get(key);
  if (!store) spectra.set(key, (store = { last: null, waterfall: [] }));
  store.last = s;
  store.waterfall.push(s);
  if (store.waterfall.length > WATERFALL_ROWS) store.waterfall.shift();
  if (selected && key === `${selected.bench}/${selected.channel}`) invalidate("spectrum");
}

function onStatus(s) {
  status = s;
  invalidate("status");
}

function addRow(key, v) {
  const canvas = node("canvas", { "aria-hidden": "true" });
  const state = node("span", {}, "");
  const box = node("div", { class: "row", role: "option", id: `row-${rows.size}`, "aria-selected": "false" },
    node("div", { class: "head" }, node("span", {}, `${v.stage} · ${v.channel}`), state), canvas);
  const row = { key, bench: v.bench, stage: v.stage, channel: v.channel, verdicts: [], seen: new Set(), canvas, box, state };
  box.addEventListener("click", () => select(row));
  rows.set(key, row);
  el("rows").append(box);
  if (!selected) select(row);
  return row;
}

function select(row) {
  if (selected) selected.box.setAttribute("aria-selected", "false");
  selected = row;
  row.box.setAttribute("aria-selected", "true");
  el("rows").setAttribute("aria-activedescendant", row.box.id);
  row.box.scrollIntoView({ block: "nearest" });
  invalidate("detail");
  invalidate("spectrum");
}

el("rows").addEventListener("keydown", (event) => {
  const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (!step || rows.size === 0) return;
  event.preventDefault();
  const all = [...rows.values()];
  select(all[(all.indexOf(selected) + step + all.length) % all.length]);
});

/* ---- drawing ---- */

function fit(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = Math.max(1, canvas.clientWidth);
  const height = Math.max(1, canvas.clientHeight);
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const g = canvas.getContext("2d");
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  g.clearRect(0, 0, width, height);
  return { g, width, height };
}

function draw() {
  const todo = new Set(dirty);
  dirty.clear();
  if (todo.has("status") && status) drawStatus();
  for (const row of rows.values()) if (todo.has(row.key) || todo.has("all")) drawStrip(row);
  if (selected && (todo.has("detail") || todo.has("all"))) drawDetail();
  if (selected && (todo.has("spectrum") || todo.has("all"))) drawSpectrum();
}

// What a strip shows, oldest first: the windows themselves, or for each column of a longer span the highest level in it.
function columns(row, fits) {
  if (!span) return row.verdicts.slice(-fits).map((v) => HARMONICS.map((h) => v[`level_${h}x`]));
  const end = row.verdicts[row.verdicts.length - 1].t0_ns;
  const wide = (span * 1e9) / fits;
  const out = Array.from({ length: fits }, () => null);
  for (let i = row.verdicts.length - 1; i >= 0; i--) {
    const v = row.verdicts[i];
    const at = fits - 1 - Math.floor((end - v.t0_ns) / wide);
    if (at < 0) break;
    if (!out[at]) out[at] = HARMONICS.map(() => -1);
    HARMONICS.forEach((h, k) => (out[at][k] = Math.max(out[at][k], v[`level_${h}x`])));
  }
  return out;
}

function drawStrip(row) {
  const { g, width, height } = fit(row.canvas);
  const cell = span ? 3 : Math.max(2, Math.min(8, width / 60));
  const lane = height / HARMONICS.length;
  const shown = columns(row, Math.floor(width / cell));
  const x0 = width - shown.length * cell;
  const colours = [-1, 0, 1, 2, 3, 4, 5].map(rankColour);
  shown.forEach((levels, i) => {
    if (!levels) return;
    levels.forEach((level, k) => {
      g.fillStyle = colours[level + 1];
      // The height says the same as the colour, for those who cannot tell colours apart.
      const tall = level < 0 ? 0.18 : 0.3 + 0.14 * level;
      g.fillRect(x0 + i * cell, (k + 1) * lane - 1 - tall * (lane - 2), cell - (cell > 3 ? 1 : 0), tall * (lane - 2));
    });
  });
  const last = row.verdicts[row.verdicts.length - 1];
  const codes = HARMONICS.map((h) => (last[`level_${h}x`] < 0 ? "?" : last[`rank_${h}x`])).join(" ");
  row.state.textContent = `${last.instrument === "ok" ? last.machine.replace("_", " ") : last.instrument.replace("_", " ")} · ${codes}`;
}

let trendPlot = null;
let spectrumPlot = null;

function axis(label) {
  return { label, labelSize: 20, stroke: css("--soft"), grid: { stroke: css("--line"), width: 1 }, ticks: { stroke: css("--line") }, font: "12px system-ui", labelFont: "12px system-ui" };
}

function sized(host, make, plot, shape) {
  const width = Math.max(200, host.clientWidth);
  if (plot && plot.shape === shape && plot.theme === document.documentElement.dataset.theme) {
    if (plot.u.width !== width) plot.u.setSize({ width, height: 240 });
    return plot;
  }
  if (plot) plot.u.destroy();
  return { u: make(width), shape, theme: document.documentElement.dataset.theme };
}

function drawDetail() {
  const row = selected;
  const last = row.verdicts[row.verdicts.length - 1];
  if (!last) return;
  el("h-detail").textContent = `${row.stage} · ${row.channel}, window ${last.window}, ${clock(last.t0_ns)}, mesh ${text(last.mesh_hz, 6, "Hz")}`;
  const body = el("ranks").tBodies[0];
  body.replaceChildren(...HARMONICS.map((h) => {
    const level = last[`level_${h}x`];
    const badge = node("b", { style: `background:${rankColour(level)};color:${level === 0 || level === 5 ? "#fff" : "#111"}` }, last[`rank_${h}x`]);
    return node("tr", {}, node("th", { scope: "row" }, `${h}x`), node("td", { class: "rank" }, badge),
      node("td", {}, known(last[`p_${h}x`]) ? `${(100 * last[`p_${h}x`]).toFixed(0)} %` : "–"),
      node("td", {}, `${percent(last[`dev_${h}x_percent`])} ± ${known(last[`dev_sigma_${h}x_percent`]) ? last[`dev_sigma_${h}x_percent`].toFixed(1) : "–"}`),
      node("td", {}, text(last[`amp_${h}x`], 4, last.unit)), node("td", {}, text(last[`base_${h}x`], 4)), node("td", {}, text(last[`floor_${h}x`], 2)));
  }));
  drawTrend(row);
  drawPillars(last);
}

function drawTrend(row) {
  const host = el("trend");
  const t = row.verdicts.map((v) => v.t0_ns / 1e9);
  const pick = (name) => row.verdicts.map((v) => (known(v[name]) ? v[name] : null));
  const amp = pick(`amp_${harmonic}x`);
  const base = pick(`base_${harmonic}x`);
  const sigma = pick(`dev_sigma_${harmonic}x_percent`);
  const band = (sign) => base.map((b, i) => (b === null || sigma[i] === null ? null : b * (1 + (sign * 2 * sigma[i]) / 100)));
  trendPlot = sized(host, (width) => new uPlot({
    width, height: 240, legend: { show: false }, cursor: { drag: { x: true, y: false } },
    axes: [axis(""), axis(`${harmonic}x (${row.verdicts[0].unit})`)],
    series: [{}, { label: "amplitude", stroke: css("--accent"), width: 2 }, { label: "baseline", stroke: css("--ok"), width: 1 },
      { label: "+2σ", stroke: css("--line") }, { label: "−2σ", stroke: css("--line") }],
    bands: [{ series: [3, 4], fill: `${css("--r0")}33` }],
  }, [[], [], [], [], []], host), trendPlot, `${row.key}#${harmonic}`);
  trendPlot.u.setData([t, amp, base, band(1), band(-1)]);
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
      g.fillStyle = k === 0 ? rankColour(last[`level_${h}x`]) : inks[k];
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

function drawSpectrum() {
  const store = spectra.get(`${selected.bench}/${selected.channel}`);
  const host = el("spectrum");
  if (!store) return;
  const s = store.last;
  const orders = s.amplitude.map((_, i) => s.first_order + i * s.order_step);
  spectrumPlot = sized(host, (width) => new uPlot({
    width, height: 240, legend: { show: false },
    scales: { x: { time: false }, y: { distr: 3 } },
    axes: [axis("order of the input shaft"), { ...axis(s.unit), size: 64, values: (u, ticks) => ticks.map((t) => (t && Number.isInteger(Math.log10(t)) ? t.toExponential(0) : "")) }],
    series: [{}, { label: "amplitude", stroke: css("--accent"), width: 1 }],
    hooks: { draw: [(u) => marks(u, spectra.get(`${selected.bench}/${selected.channel}`).last.lines)] },
  }, [[], []], host), spectrumPlot, `${selected.bench}/${selected.channel}`);
  const floor = Math.max(...s.amplitude) * 1e-6 || 1e-12;
  spectrumPlot.u.setData([orders, s.amplitude.map((a) => Math.max(a, floor))]);
  drawWaterfall(store);
}

function marks(u, lines) {
  const g = u.ctx;
  const stages = [];
  const ratio = window.devicePixelRatio || 1;
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
    if (!line.sideband) {
      g.fillStyle = css("--ink");
      g.textAlign = "left";
      // One row of labels a stage: lines of two stages often lie close together.
      const stage = line.label.slice(0, line.label.lastIndexOf(" "));
      if (!stages.includes(stage)) stages.push(stage);
      g.fillText(line.label, x + 3 * ratio, u.bbox.top + (10 + 13 * stages.indexOf(stage)) * ratio);
    }
  }
  g.restore();
}

function drawWaterfall(store) {
  const { g, width, height } = fit(el("waterfall"));
  const count = store.waterfall.length;
  const tall = height / WATERFALL_ROWS;
  let top = 1e-300;
  for (const s of store.waterfall) for (const a of s.amplitude) if (a > top) top = a;
  const columns = Math.min(Math.floor(width), 400);
  const wide = width / columns;
  store.waterfall.forEach((s, r) => {
    const per = s.amplitude.length / columns;
    for (let c = 0; c < columns; c++) {
      let a = 0;
      for (let i = Math.floor(c * per); i < Math.max(Math.floor(c * per) + 1, (c + 1) * per); i++) a = Math.max(a, s.amplitude[i] || 0);
      const level = Math.max(0, 1 + Math.log10(Math.max(a / top, 1e-4)) / 4);
      g.fillStyle = `hsl(${250 - 210 * level} ${40 + 50 * level}% ${8 + 52 * level}%)`;
      g.fillRect(c * wide, height - (count - r) * tall, wide + 0.5, tall + 0.5);
    }
  });
}

function lamp(id, state, words) {
  const n = el(id);
  if (n.dataset.state !== state) n.dataset.state = state;
  const span = n.querySelector("span");
  if (span.textContent !== words) span.textContent = words;
}

function drawStatus() {
  const bench = (status.benches || []).find((b) => selected && b.name === selected.bench) || (status.benches || [])[0];
  if (!bench) return;
  el("bench").textContent = bench.name;
  lamp("lamp-machine", bench.machine, bench.machine.replace("_", " "));
  lamp("lamp-instrument", bench.instrument === "ok" ? "ok" : bench.instrument === "unknown" ? "unknown" : "not_ok", bench.instrument.replace(/_/g, " "));
  el("op-speed").textContent = text(bench.motor_speed_hz, 5, "Hz");
  el("op-torque").textContent = text(bench.brake_torque_nm, 4, "N m");
  el("op-temperature").textContent = text(bench.temperature_c, 3, "°C");
  el("alarms").tBodies[0].replaceChildren(...(bench.alarms.length ? bench.alarms.map(alarmRow) : [node("tr", {}, node("td", { colspan: "5" }, "none"))]));
  el("sources").tBodies[0].replaceChildren(...bench.sources.map((s) => node("tr", {}, node("th", { scope: "row" }, s.name), node("td", {}, s.state), node("td", {}, String(s.windows)), node("td", {}, String(s.gaps)))));
  const facts = Object.entries(status.facts || {});
  el("log").replaceChildren(...facts.map(([k, v]) => node("div", {}, node("dt", {}, k), node("dd", {}, String(v)))));
}

function alarmRow(a) {
  const button = node("button", { type: "button" }, a.acknowledged ? "Acknowledged" : "Acknowledge");
  button.disabled = a.acknowledged;
  button.setAttribute("aria-label", `Acknowledge ${a.what} on ${a.place}`);
  button.addEventListener("click", async () => {
    button.disabled = true;
    const reply = await fetch(`/api/alarms/${encodeURIComponent(a.id)}/acknowledge`, { method: "POST", headers: { "content-type": "application/json" }, body: "{}" }).catch(() => null);
    if (!reply || !reply.ok) button.disabled = false;
  });
  return node("tr", {}, node("td", {}, clock(a.since_ns)), node("td", {}, a.place), node("td", {}, a.what), node("td", {}, a.state), node("td", {}, button));
}

/* ---- link ---- */

let lastHeard = 0;
function connect() {
  const events = new EventSource("/api/events");
  const heard = (handler) => (event) => {
    lastHeard = performance.now();
    lamp("lamp-link", "ok", "live");
    handler(JSON.parse(event.data));
  };
  events.addEventListener("verdict", heard(onVerdict));
  events.addEventListener("spectrum", heard(onSpectrum));
  events.addEventListener("status", heard(onStatus));
  events.addEventListener("error", () => {
    lamp("lamp-link", "not_ok", "lost, trying again");
    stale();
    if (events.readyState === EventSource.CLOSED) setTimeout(connect, 2000);
  });
}

// A page that no longer hears the service must not go on showing green.
function stale() {
  lamp("lamp-machine", "unknown", "unknown");
  lamp("lamp-instrument", "unknown", "unknown");
}
setInterval(() => {
  if (lastHeard && performance.now() - lastHeard > 6000) {
    lamp("lamp-link", "not_ok", "silent");
    stale();
  }
}, 1000);

/* ---- set-up ---- */

for (const h of HARMONICS) {
  const button = node("button", { type: "button", "aria-pressed": String(h === 1) }, `${h}x`);
  button.addEventListener("click", () => {
    harmonic = h;
    for (const other of el("pick").children) other.setAttribute("aria-pressed", String(other === button));
    invalidate("detail");
  });
  el("pick").append(button);
}

for (const [seconds, name] of [[0, "Windows"], [600, "10 min"], [3600, "1 h"]]) {
  const button = node("button", { type: "button", "aria-pressed": String(seconds === span) }, name);
  button.addEventListener("click", () => {
    span = seconds;
    for (const other of el("span").children) other.setAttribute("aria-pressed", String(other === button));
    invalidate("all");
  });
  el("span").append(button);
}

function theme(dark) {
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  el("theme").setAttribute("aria-pressed", String(dark));
  legend();
  invalidate("all");
  if (status) invalidate("status");
}
function legend() {
  el("legend").replaceChildren(...["unknown", ...RANKS].map((r, i) => node("li", {}, node("i", { style: `background:${rankColour(i - 1)}` }), i ? `${r} ${STEPS[i - 1]}` : r)));
}
el("theme").addEventListener("click", () => theme(document.documentElement.dataset.theme !== "dark"));
theme(matchMedia("(prefers-color-scheme: dark)").matches);
new ResizeObserver(() => invalidate("all")).observe(document.querySelector("main"));
connect();
