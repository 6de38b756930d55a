// The selected channel's order spectrum with its mesh lines, and the spectra of the last minute below each other.

import { css, el, fit, invalidate, spectra, view } from "./state.js";
import { axis, sized } from "./plot.js";

const WATERFALL_ROWS = 120;
const WATERFALL_COLUMNS = 400;
const DECADES = 4; // that the colours span

let spectrumPlot = null;

export function onSpectrum(s) {
  el("spectra").hidden = false;
  const key = `${s.bench}/${s.channel}`;
  let store = spectra.get(key);
  if (!store) spectra.set(key, (store = { last: null, waterfall: [] }));
  store.last = s;
  store.waterfall.push(peaks(s.amplitude));
  if (store.waterfall.length > WATERFALL_ROWS) store.waterfall.shift();
  if (view.selected && key === keyOf(view.selected)) invalidate("spectrum");
}

const keyOf = (row) => `${row.bench}/${row.channel}`;

// As many columns as are drawn, each the largest of its lines, so that no peak is lost.
function peaks(amplitude) {
  const out = new Float32Array(Math.min(WATERFALL_COLUMNS, amplitude.length));
  amplitude.forEach((a, i) => {
    const c = Math.floor((i * out.length) / amplitude.length);
    out[c] = Math.max(out[c], a);
  });
  return out;
}

export function drawSpectrum() {
  const store = spectra.get(keyOf(view.selected));
  if (!store) return;
  const host = el("spectrum");
  const s = store.last;
  const orders = s.amplitude.map((_, i) => s.first_order + i * s.order_step);
  spectrumPlot = sized(host, (width) => new uPlot({
    width, height: 240, legend: { show: false },
    scales: { x: { time: false }, y: { distr: 3 } },
    axes: [axis("order of the input shaft"), { ...axis(s.unit), size: 64, values: (u, ticks) => ticks.map((t) => (t && Number.isInteger(Math.log10(t)) ? t.toExponential(0) : "")) }],
    series: [{}, { label: "amplitude", stroke: css("--accent"), width: 1 }],
    hooks: { draw: [(u) => marks(u, spectra.get(keyOf(view.selected)).last.lines)] },
  }, [[], []], host), spectrumPlot, keyOf(view.selected));
  const floor = Math.max(...s.amplitude) * 1e-6 || 1e-12;
  spectrumPlot.u.setData([orders, s.amplitude.map((a) => Math.max(a, floor))]);
  drawWaterfall(store.waterfall);
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

// Colours of the waterfall from nothing to the largest line, dark to light: red, green, blue, opacity.
const INKS = Uint8ClampedArray.from(Array.from({ length: 256 }, (_, i) => [...colour(i / 255), 255]).flat());

function colour(level) {
  const [h, s, l] = [(250 - 210 * level) / 30, 0.4 + 0.5 * level, 0.08 + 0.52 * level];
  const reach = s * Math.min(l, 1 - l);
  return [0, 8, 4].map((n) => {
    const at = (n + h) % 12;
    return Math.round(255 * (l - reach * Math.max(-1, Math.min(at - 3, 9 - at, 1))));
  });
}

// One point a column and spectrum, then stretched: thousands of small rectangles would hold up the page.
const points = document.createElement("canvas");

function drawWaterfall(waterfall) {
  const { g, width, height } = fit(el("waterfall"));
  const columns = Math.max(...waterfall.map((row) => row.length));
  points.width = columns;
  points.height = waterfall.length;
  let top = 1e-300;
  for (const row of waterfall) for (const a of row) if (a > top) top = a;
  const pen = points.getContext("2d");
  const image = pen.createImageData(columns, waterfall.length);
  waterfall.forEach((row, r) => {
    for (let c = 0; c < columns; c++) {
      const a = row[Math.floor((c * row.length) / columns)];
      const level = Math.max(0, 1 + Math.log10(a / top) / DECADES);
      const ink = 4 * Math.round(255 * level);
      for (let part = 0; part < 4; part++) image.data[4 * (r * columns + c) + part] = INKS[ink + part];
    }
  });
  pen.putImageData(image, 0, 0);
  const tall = (height * waterfall.length) / WATERFALL_ROWS;
  g.imageSmoothingEnabled = false;
  g.drawImage(points, 0, height - tall, width, tall);
}
