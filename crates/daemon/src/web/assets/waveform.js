// The raw data around a time of the past, where the log has some: seen, heard, and taken along as a recording.

import { css, el, invalidate, node } from "./state.js";
import { Plot, Zoom, axis, save } from "./plot.js";
import { iso } from "./time.js";

const COLUMNS = 1500; // points that are drawn, each the least and the largest of its samples
const SOUND = 0.8; // of full scale, at the largest sample

let offered = null; // { row, raw } of the log
let at = 0; // time that is looked at (ns)
let wave = null; // { row, t0_ns, rate, unit, samples }
let said = "";
let playing = null;
const zoom = new Zoom();
zoom.told.push(() => invalidate("then"));

const plot = new Plot(el("raw-wave"), {
  name: "Raw data", x: "time_s", height: 220, zoom,
  title: () => `Raw data, ${wave.row.bench}/${wave.row.channel}, ${iso(wave.t0_ns)}`,
  options: () => ({
    scales: { x: { time: false } },
    axes: [axis("time since the first sample (s)"), axis(wave.unit, { size: 64 })],
    series: [{}, { label: "least", stroke: css("--accent"), width: 1 }, { label: "largest", stroke: css("--accent"), width: 1 }],
    bands: [{ series: [2, 1], fill: css("--accent") }],
  }),
  read: (u, i) => `${u.data[0][i].toFixed(4)} s · ${u.data[1][i]?.toPrecision(4) ?? "–"} to ${u.data[2][i]?.toPrecision(4) ?? "–"} ${wave.unit}`,
});

// Least and largest sample of each column of what is shown.
function columns() {
  const { samples, rate } = wave;
  const [from, to] = zoom.range ? zoom.range.map((t) => Math.round(t * rate)) : [0, samples.length];
  const [first, last] = [Math.max(0, Math.min(from, samples.length - 2)), Math.max(2, Math.min(to, samples.length))];
  const wide = Math.max(1, Math.ceil((last - first) / COLUMNS));
  const out = [[], [], []];
  for (let i = first; i < last; i += wide) {
    let [low, high] = [Infinity, -Infinity];
    for (let k = i; k < Math.min(i + wide, last); k++) {
      if (samples[k] < low) low = samples[k];
      if (samples[k] > high) high = samples[k];
    }
    out[0].push(i / rate);
    out[1].push(low === Infinity ? null : low);
    out[2].push(high === -Infinity ? null : high);
  }
  return out;
}

// The stretch that the time lies in, or the nearest.
function nearest() {
  const away = ([first, last]) => Math.max(0, first - at, at - last);
  return (offered?.raw || []).reduce((a, b) => (a && away(a) <= away(b) ? a : b), null);
}

export function offerRaw(answer) {
  if (wave && wave.row !== answer.row) wave = null;
  offered = answer;
}

export function drawRaw(answer, time) {
  at = time;
  const there = nearest();
  el("raw").hidden = false;
  for (const id of ["raw-show", "raw-mcap", "raw-listen"]) el(id).disabled = !there;
  el("raw-listen").disabled = !wave;
  const count = offered?.raw.length || 0;
  el("raw-state").textContent = said || (count ? `Raw data at ${count} time${count > 1 ? "s" : ""}; the nearest from ${iso(there[0])} to ${iso(there[1])}.` : "The log holds no raw data of this time: the key raw of its sink says what is kept.");
  el("raw-wave").hidden = !wave;
  plot.tools.hidden = plot.readout.hidden = !wave;
  if (wave) plot.show(`${wave.row.key}#${wave.t0_ns}`, columns());
}

// The window asked for: from the time that is looked at on, moved into the stretch that there is.
function query() {
  const there = nearest();
  const long = Number(el("raw-long").value) * 1e9;
  const from = Math.max(there[0], Math.min(at, there[1]));
  const ns = (t) => String(BigInt(Math.round(t / 1000)) * 1000n);
  return new URLSearchParams({ bench: offered.row.bench, channel: offered.row.channel, from: ns(from), to: ns(from + long) });
}

function say(words) {
  said = words;
  invalidate("then");
}

el("raw-show").addEventListener("click", async () => {
  const row = offered.row;
  say("Reading the log …");
  const reply = await fetch(`/api/raw?${query()}`).catch(() => null);
  if (!reply?.ok) {
    say(reply ? (await reply.text()).trim() : "The service does not answer.");
    return;
  }
  const head = (name) => reply.headers.get(name);
  const samples = new Float32Array(await reply.arrayBuffer());
  const unit = (head("x-unit") || "").replace(/\\u\{([0-9a-f]+)\}/g, (_, code) => String.fromCodePoint(parseInt(code, 16)));
  wave = { row, t0_ns: Number(head("x-t0-ns")), rate: Number(head("x-sample-rate-hz")), unit, samples };
  zoom.set(null);
  say("");
});

el("raw-mcap").addEventListener("click", async () => {
  say("Reading the log …");
  const reply = await fetch(`/api/raw.mcap?${query()}`).catch(() => null);
  if (!reply?.ok) {
    say(reply ? (await reply.text()).trim() : "The service does not answer.");
    return;
  }
  const name = /filename="([^"]+)"/.exec(reply.headers.get("content-disposition") || "")?.[1] || "gearwatch-raw.mcap";
  save(await reply.blob(), name);
  say("");
});

// Listens to what is shown, at the rate at which it was recorded.
el("raw-listen").addEventListener("click", () => {
  if (playing) {
    playing.stop();
    return;
  }
  const { samples, rate } = wave;
  const [from, to] = zoom.range ? zoom.range.map((t) => Math.max(0, Math.round(t * rate))) : [0, samples.length];
  const part = samples.slice(from, to).map((x) => (Number.isFinite(x) ? x : 0));
  const mean = part.reduce((a, b) => a + b, 0) / Math.max(1, part.length);
  const largest = part.reduce((a, b) => Math.max(a, Math.abs(b - mean)), 1e-30);
  const context = new AudioContext();
  let buffer = null;
  try {
    buffer = context.createBuffer(1, Math.max(1, part.length), rate);
  } catch {
    say(`This browser plays no sound of ${rate} samples per second.`);
    context.close();
    return;
  }
  buffer.copyToChannel(part.map((x) => (SOUND * (x - mean)) / largest), 0);
  playing = new AudioBufferSourceNode(context, { buffer });
  playing.connect(context.destination);
  playing.addEventListener("ended", () => {
    playing = null;
    context.close();
    el("raw-listen").textContent = "Listen";
    el("raw-listen").setAttribute("aria-pressed", "false");
  });
  el("raw-listen").textContent = "Stop";
  el("raw-listen").setAttribute("aria-pressed", "true");
  playing.start();
});
for (const seconds of [1, 2, 5, 10, 20, 60]) el("raw-long").append(node("option", { value: seconds }, `${seconds} s`));
el("raw-long").value = "2";
