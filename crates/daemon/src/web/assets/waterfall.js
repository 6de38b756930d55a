// Spectra below each other, the newest at the bottom, with the orders of the spectrum above and the time at the side.

import { css, fit, text } from "./state.js";
import { save } from "./plot.js";
import { iso } from "./time.js";

const ROWS = 120;
const COLUMNS = 750;
const DECADES = 4; // that the colours span

// As many columns as are drawn, each the largest of its lines, so that no peak is lost.
export function line(s) {
  const out = new Float32Array(Math.min(COLUMNS, s.amplitude.length));
  s.amplitude.forEach((a, i) => {
    const c = Math.floor((i * out.length) / s.amplitude.length);
    out[c] = Math.max(out[c], a);
  });
  const first = s.first_order - s.order_step / 2;
  // The logarithm once, not each time that the line is drawn.
  return { t0: s.t0_ns, first, last: first + s.amplitude.length * s.order_step, peaks: out, log: out.map(Math.log10), top: out.reduce((a, b) => Math.max(a, b), 1e-300) };
}

export function remember(store, s) {
  if (store.waterfall.length && s.t0_ns < store.waterfall.at(-1).t0) store.waterfall = [];
  store.waterfall.push(line(s));
  if (store.waterfall.length > ROWS) store.waterfall.shift();
}

// Spectra of before the page was opened, from the log, above those that came since.
export function precede(store, older) {
  const first = store.waterfall[0]?.t0 ?? Infinity;
  store.waterfall = [...older.filter((s) => s.t0_ns < first).map(line), ...store.waterfall].slice(-ROWS);
}

// Colours from nothing to the largest line, dark to light: red, green, blue, opacity.
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
const BOTTOM = 40;
const SCALE = 46; // width of the colour scale with its numbers

export class Waterfall {
  // A canvas, where the values under the cursor are told, and the button that saves the picture.
  constructor(canvas, values, png) {
    this.canvas = canvas;
    this.shown = null; // where the picture lies, for the values under the cursor
    canvas.addEventListener("mousemove", (event) => { values.textContent = this.read(event) ?? values.textContent; });
    canvas.addEventListener("mouseleave", () => { values.textContent = ""; });
    png.addEventListener("click", () => canvas.toBlob((blob) => save(blob, "gearwatch-waterfall.png")));
  }

  draw(list, plot) {
    const { g, width, height } = fit(this.canvas);
    const ratio = window.devicePixelRatio || 1;
    const box = { left: plot.u.bbox.left / ratio, top: 6, height: height - BOTTOM - 6 };
    box.width = Math.max(20, Math.min(plot.u.bbox.width / ratio, width - box.left - SCALE));
    const [min, max] = plot.shown();
    if (list.length === 0) return;
    const top = Math.max(...list.map((row) => row.top));
    const scaled = Math.log10(top);
    points.width = COLUMNS;
    points.height = list.length;
    const pen = points.getContext("2d");
    const image = pen.createImageData(COLUMNS, list.length);
    list.forEach((row, r) => {
      for (let c = 0; c < COLUMNS; c++) {
        const order = min + ((c + 0.5) / COLUMNS) * (max - min);
        const log = row.log[Math.floor(((order - row.first) / (row.last - row.first)) * row.log.length)] ?? -Infinity;
        const ink = 4 * Math.round(255 * Math.max(0, 1 + (log - scaled) / DECADES));
        for (let part = 0; part < 4; part++) image.data[4 * (r * COLUMNS + c) + part] = INKS[ink + part];
      }
    });
    pen.putImageData(image, 0, 0);
    const tall = (box.height * list.length) / Math.max(list.length, ROWS / 4);
    g.imageSmoothingEnabled = false;
    g.drawImage(points, box.left, box.top + box.height - tall, box.width, tall);
    this.shown = { box, tall, list, min, max };
    axes(g, this.shown);
    scale(g, box, top);
  }

  // The row of a place on the canvas, and the order there; nothing beside the picture.
  at(event) {
    if (!this.shown) return null;
    const { box, tall, list, min, max } = this.shown;
    const row = list[Math.floor(((event.offsetY - (box.top + box.height - tall)) / tall) * list.length)];
    const share = (event.offsetX - box.left) / box.width;
    return !row || share < 0 || share > 1 ? null : { row, order: min + share * (max - min) };
  }

  read(event) {
    const at = this.at(event);
    if (!at) return null;
    const { row, order } = at;
    const a = row.peaks[Math.floor(((order - row.first) / (row.last - row.first)) * row.peaks.length)];
    return `${iso(row.t0)} · order ${order.toFixed(2)} · ${text(a, 3)}`;
  }
}

function axes(g, { box, tall, list, min, max }) {
  g.strokeStyle = css("--line");
  g.strokeRect(box.left, box.top, box.width, box.height);
  g.fillStyle = css("--soft");
  g.font = "12px system-ui";
  g.textAlign = "center";
  g.textBaseline = "top";
  // Steps of 1, 2 or 5, as the spectrum above.
  const rough = ((max - min) * 70) / box.width;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((m) => m * power >= rough);
  for (let order = Math.ceil(min / step) * step; order <= max; order += step) {
    const x = box.left + ((order - min) / (max - min)) * box.width;
    g.fillRect(x, box.top + box.height, 1, 4);
    g.fillText(String(Number(order.toPrecision(6))), x, box.top + box.height + 6);
  }
  g.fillText("order of the input shaft", box.left + box.width / 2, box.top + box.height + 22);
  g.textAlign = "right";
  g.textBaseline = "middle";
  const line = tall / list.length;
  const every = Math.max(1, Math.round(list.length / Math.max(1, Math.floor(tall / 34))));
  const long = list.at(-1).t0 - list[0].t0 > 86400e9;
  for (let r = list.length - 1; r >= 0; r -= every) {
    const y = box.top + box.height - tall + (r + 0.5) * line;
    g.fillRect(box.left - 4, y, 4, 1);
    g.fillText(long ? iso(list[r].t0).slice(5, 16).replace("T", " ") : iso(list[r].t0).slice(11, 19), box.left - 6, y);
  }
}

function scale(g, box, top) {
  const x = box.left + box.width + 6;
  for (let i = 0; i < 64; i++) {
    const at = 4 * Math.round((255 * i) / 63);
    g.fillStyle = `rgb(${INKS[at]} ${INKS[at + 1]} ${INKS[at + 2]})`;
    g.fillRect(x, box.top + box.height * (1 - (i + 1) / 64), 8, box.height / 64 + 1);
  }
  g.fillStyle = css("--soft");
  g.font = "10px system-ui";
  g.textAlign = "left";
  for (let d = 0; d <= DECADES; d++) {
    g.textBaseline = d === 0 ? "top" : d === DECADES ? "bottom" : "middle";
    g.fillText((top / 10 ** d).toExponential(0), x + 10, box.top + (box.height * d) / DECADES);
  }
}
