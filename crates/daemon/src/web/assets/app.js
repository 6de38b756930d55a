// The live page: one stream of events, a few canvases, no framework.
//
// app (link, theme) ─► state (rows, spectra, status) ─► strips · detail · spectrum · service (drawing)

import { LOOKS, RANKS, el, forgetColours, invalidate, node, paintWith, remember, remembered, rows, shade, view } from "./state.js";
import { drawStrips, forgetSizes, rowOf } from "./strips.js";
import { drawDetail } from "./detail.js";
import { drawSpectrum, onSpectrum } from "./spectrum.js";
import { drawStatus, lamp, title } from "./service.js";
import { drawHistory } from "./history.js";
import { drawThen } from "./then.js";
import { takeIndicators } from "./indicators.js";
import { arrange } from "./find.js";

const STEPS = "< 1 %,≥ 1 %,≥ 4 %,≥ 7 %,≥ 10 %,≥ 13 %".split(",");

// What is not drawn after so long goes on in the next frame, so that the page answers a hand meanwhile.
const FRAME_MS = 8;
const PARTS = [["detail", drawDetail], ["history", drawHistory], ["then", drawThen], ["spectrum", drawSpectrum]];

paintWith((todo) => {
  const until = performance.now() + FRAME_MS;
  if (todo.has("all")) {
    forgetSizes();
    for (const name of ["status", ...PARTS.map(([name]) => name), ...rows.keys()]) todo.add(name);
  }
  if (todo.has("then")) todo.add("history");
  const parts = [...(view.status ? [["status", drawStatus]] : []), ...(view.selected ? PARTS : [])];
  for (const [name, draw] of parts) {
    if (!todo.has(name)) continue;
    if (performance.now() > until) invalidate(name);
    else draw();
  }
  for (const row of drawStrips([...rows.values()].filter((row) => todo.has(row.key)), until)) invalidate(row.key);
});

/* ---- data in ---- */

function changed(row) {
  invalidate(row.key);
  arrange();
  if (row === view.selected) invalidate("detail");
}

const FIELDS = { level: (k) => `level_${k}x`, p: (k) => `p_${k}x`, amp: (k) => `amp_${k}x`, base: (k) => `base_${k}x`, sigma: (k) => `dev_sigma_${k}x_percent` };

function onVerdict(v) {
  const row = rowOf(v);
  row.last = v;
  row.unit = v.unit;
  takeIndicators(row, v);
  // A replay that starts anew.
  if (v.t0_ns < row.past.newest) row.past.clear();
  // The newest window comes twice to a page that has just been opened: in the past, and by itself.
  if (v.t0_ns > row.past.newest) row.past.push(v.t0_ns, v.machine[0], (name, k) => v[FIELDS[name](k + 1)]);
  changed(row);
}

// The past of a row, sent when a page begins to listen, and again after a reconnect.
function onPast(p) {
  const row = rowOf(p);
  row.unit = p.unit;
  row.past.clear();
  p.t0_ns.forEach((t0, i) => row.past.push(t0, p.machine[i], (name, k) => (name === "level" ? "?012345".indexOf(p.level[k][i]) - 1 : p[name][k][i])));
  changed(row);
}

function onStatus(s) {
  view.status = s;
  invalidate("status");
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
  events.addEventListener("past", heard(onPast));
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
  title("unknown", "unknown", 0, 0, 0);
}
setInterval(() => {
  if (lastHeard && performance.now() - lastHeard > 6000) {
    lamp("lamp-link", "not_ok", "silent");
    stale();
  }
}, 1000);

/* ---- set-up ---- */

function theme(dark) {
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  forgetColours();
  el("theme").setAttribute("aria-pressed", String(dark));
  legend();
  invalidate("all");
}
function legend() {
  const names = ["unknown", ...RANKS.map((r, i) => `${r} ${STEPS[i]}`), "path changed"];
  el("legend").replaceChildren(...LOOKS.map((look, i) => node("li", {}, node("i", { style: `background:${shade(look, 1)}` }), names[i])));
}
el("theme").addEventListener("click", () => {
  const dark = document.documentElement.dataset.theme !== "dark";
  remember("theme", dark ? "dark" : "light");
  theme(dark);
});
const system = matchMedia("(prefers-color-scheme: dark)");
const chosen = () => remembered("theme", system.matches ? "dark" : "light") === "dark";
system.addEventListener("change", () => theme(chosen()));
theme(chosen());
new ResizeObserver(() => invalidate("all")).observe(document.querySelector("main"));
connect();
