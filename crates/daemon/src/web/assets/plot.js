// What all line plots share: a zoom that stays while data come in, a cursor with values, and what may be taken along as PNG or CSV.

import { css, node } from "./state.js";
import { timeTicks, zone } from "./time.js";

const HEIGHT = 240;
const SMALLEST_DRAG = 5; // px; less is a click

export function axis(label, more = {}) {
  return { label, labelSize: 20, stroke: css("--soft"), grid: { stroke: css("--line"), width: 1 }, ticks: { stroke: css("--line") }, font: "12px system-ui", labelFont: "12px system-ui", ...more };
}

export const timeAxis = () => axis(`time (UTC${zone()})`, { values: timeTicks, size: 44, space: 84 });

// The part of the abscissa that somebody has chosen; null: all there is. Plots that share one move together.
export class Zoom {
  constructor() {
    this.range = null;
    this.plots = new Set();
    this.told = [];
  }

  set(range) {
    this.range = range && range[1] > range[0] ? range : null;
    for (const plot of this.plots) plot.follow();
    for (const tell of this.told) tell(this.range);
  }

  // Around a place (0–1 of what is shown) by a factor, and along by a share of what is shown.
  change([min, max], factor, along = 0, at = 0.5) {
    const middle = min + at * (max - min);
    const by = along * (max - min);
    this.set([middle - (middle - min) * factor + by, middle + (max - middle) * factor + by]);
  }
}

export class Plot {
  // `host`: where the plot goes, a row of buttons in front of it and the values under the cursor below. `what.name` names its files; `what.options()`
  // are uPlot's, without a size; `what.read(u, i)` tells the values at point i in words; `what.marks(u, g)` draws on top of it.
  constructor(host, what) {
    this.host = host;
    this.what = what;
    this.zoom = what.zoom || new Zoom();
    this.zoom.plots.add(this);
    this.u = null;
    this.readout = node("p", { class: "readout" });
    this.tools = node("div", { class: "buttons tools", role: "group", "aria-label": `${what.name}: view and download` });
    const tool = (sign, label, act) => {
      const button = node("button", { type: "button", "aria-label": `${sign} ${what.name}: ${label}`, title: label }, sign);
      button.addEventListener("click", act);
      this.tools.append(button);
      return button;
    };
    const change = (...by) => () => this.u && this.zoom.change(this.shown(), ...by);
    tool("+", "zoom in", change(0.5));
    tool("−", "zoom out", change(2));
    tool("◂", "to the left", change(1, -0.25));
    tool("▸", "to the right", change(1, 0.25));
    this.all = tool("All", "show all (double click)", () => this.zoom.set(null));
    tool("PNG", "download the picture", () => this.png());
    tool("CSV", "download the numbers", () => this.csv());
    host.before(this.tools);
    host.after(this.readout);
  }

  shown() {
    return [this.u.scales.x.min, this.u.scales.x.max];
  }

  // Draws anew. `shape` names what is shown: a plot of something else is made anew, with the zoom that it had.
  show(shape, data) {
    const width = Math.max(200, this.host.clientWidth);
    const theme = document.documentElement.dataset.theme;
    if (!this.u || this.shape !== shape || this.theme !== theme) {
      if (this.u) this.u.destroy();
      Object.assign(this, { shape, theme, u: new uPlot(this.options(width), data, this.host) });
      this.listen(this.u.over);
      this.follow();
    } else {
      if (this.u.width !== width) this.u.setSize({ width, height: this.what.height || HEIGHT });
      this.u.setData(data);
    }
    this.all.setAttribute("aria-pressed", String(this.zoom.range === null));
  }

  follow() {
    if (!this.u) return;
    if (this.zoom.range) this.u.setScale("x", { min: this.zoom.range[0], max: this.zoom.range[1] });
    else this.u.setData(this.u.data);
    this.all.setAttribute("aria-pressed", String(this.zoom.range === null));
  }

  options(width) {
    const own = this.what.options();
    return {
      width, height: this.what.height || HEIGHT, legend: { show: false }, ...own,
      series: own.series.map((s) => ({ points: { show: false }, ...s })),
      scales: { ...own.scales, x: { time: true, ...own.scales?.x, auto: () => this.zoom.range === null } },
      cursor: { drag: { x: true, y: false, setScale: false }, bind: { dblclick: () => () => this.zoom.set(null) }, ...own.cursor },
      hooks: {
        ...own.hooks,
        draw: [(u) => this.what.marks?.(u, u.ctx)],
        setCursor: [(u) => this.read(u)],
        setSelect: [(u) => {
          const { left, width: wide } = u.select;
          if (wide < SMALLEST_DRAG) return;
          u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
          this.zoom.set([u.posToVal(left, "x"), u.posToVal(left + wide, "x")]);
        }],
      },
    };
  }

  read(u) {
    const { idx, left } = u.cursor;
    this.readout.textContent = idx === null || idx === undefined || left < 0 ? "" : this.what.read?.(u, idx) || "";
  }

  // Shift and drag, or one finger where a part is shown, move along; the wheel with Ctrl and two fingers zoom.
  listen(over) {
    const at = (event) => (event.clientX - over.getBoundingClientRect().left) / over.clientWidth;
    let from = null;
    const fingers = new Map();
    over.addEventListener("mousedown", (event) => {
      if (!event.shiftKey) return;
      event.stopImmediatePropagation();
      from = { x: at(event), range: this.shown() };
      const move = (e) => this.zoom.set(from.range.map((x) => x - (at(e) - from.x) * (from.range[1] - from.range[0])));
      const end = () => document.removeEventListener("mousemove", move);
      document.addEventListener("mousemove", move);
      document.addEventListener("mouseup", end, { once: true });
    }, true);
    over.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      this.zoom.change(this.shown(), event.deltaY > 0 ? 1.25 : 0.8, 0, at(event));
    }, { passive: false });
    over.addEventListener("touchstart", (event) => {
      for (const t of event.touches) fingers.set(t.identifier, at(t));
      from = { places: [...event.touches].map(at), range: this.shown() };
    }, { passive: true });
    over.addEventListener("touchmove", (event) => {
      const now = [...event.touches].map(at);
      if (!from?.places || now.length !== from.places.length || (now.length < 2 && !this.zoom.range)) return;
      if (now.length > 1) event.preventDefault();
      const [min, max] = from.range;
      const wide = max - min;
      const factor = now.length > 1 ? Math.abs(from.places[1] - from.places[0]) / Math.max(0.02, Math.abs(now[1] - now[0])) : 1;
      const start = min + from.places[0] * wide - now[0] * wide * factor;
      this.zoom.set([start, start + wide * factor]);
    }, { passive: false });
  }

  png() {
    const from = this.u.ctx.canvas;
    const ratio = window.devicePixelRatio || 1;
    const head = 26 * ratio;
    const to = document.createElement("canvas");
    to.width = from.width;
    to.height = from.height + head;
    const g = to.getContext("2d");
    g.fillStyle = css("--panel");
    g.fillRect(0, 0, to.width, to.height);
    g.fillStyle = css("--ink");
    g.font = `${13 * ratio}px system-ui`;
    g.fillText(this.title(), 8 * ratio, 18 * ratio);
    g.drawImage(from, 0, head);
    to.toBlob((blob) => save(blob, `${this.file()}.png`));
  }

  // The part that is shown.
  csv() {
    const [min, max] = this.shown();
    const names = this.u.series.map((s, i) => (i === 0 ? this.what.x || "time_unix_s" : s.label));
    const lines = this.u.data[0].flatMap((x, i) => (x < min || x > max ? [] : [this.u.data.map((column) => column[i] ?? "").join(",")]));
    save(new Blob([[names.map(quoted).join(","), ...lines, ""].join("\n")], { type: "text/csv" }), `${this.file()}.csv`);
  }

  title() {
    return this.what.title?.() || this.what.name;
  }

  file() {
    return `gearwatch-${this.title()}`.replace(/[^A-Za-z0-9._-]+/g, "-").slice(0, 120);
  }
}

const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);

export function save(blob, name) {
  const url = URL.createObjectURL(blob);
  const link = node("a", { href: url, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
}

// Points for values that no line leads to or from, as of a bench that runs an hour a day.
export const lonePoints = (ink) => ({
  show: true, size: 5, width: 0, fill: ink,
  filter: (u, series) => {
    const values = u.data[series];
    const there = (i) => values[i] !== null && values[i] !== undefined;
    return values.flatMap((_, i) => (there(i) && !there(i - 1) && !there(i + 1) ? [i] : []));
  },
});

// Horizontal lines at these values, with a word beside each.
export function levels(u, g, lines) {
  const ratio = window.devicePixelRatio || 1;
  g.save();
  g.beginPath();
  g.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
  g.clip();
  g.lineWidth = ratio;
  const seen = lines.map((line) => [line, u.valToPos(line.value, "y", true)]).filter(([, y]) => y >= u.bbox.top && y <= u.bbox.top + u.bbox.height);
  for (const [{ ink }, y] of seen) {
    g.strokeStyle = ink;
    g.setLineDash([6 * ratio, 4 * ratio]);
    g.beginPath();
    g.moveTo(u.bbox.left, y);
    g.lineTo(u.bbox.left + u.bbox.width, y);
    g.stroke();
  }
  g.restore();
  // Beside the plot, where neither curves nor events are.
  g.save();
  g.font = `${10 * ratio}px system-ui`;
  g.textAlign = "left";
  let last = -Infinity;
  // The highest first; where they crowd, some lines have no word.
  for (const [{ ink, word }, y] of seen.filter(([line]) => line.word).sort((a, b) => a[1] - b[1])) {
    if (y - last < 10 * ratio) continue;
    last = y;
    g.fillStyle = ink;
    g.fillText(word, u.bbox.left + u.bbox.width + 4 * ratio, y + 3 * ratio);
  }
  g.restore();
}

// Vertical lines at times, with a letter on top.
export function moments(u, g, events) {
  const ratio = window.devicePixelRatio || 1;
  g.save();
  g.font = `${10 * ratio}px system-ui`;
  g.textAlign = "center";
  for (const { at, ink, word } of events) {
    const x = u.valToPos(at, "x", true);
    if (x < u.bbox.left || x > u.bbox.left + u.bbox.width) continue;
    g.strokeStyle = g.fillStyle = ink;
    g.lineWidth = ratio;
    g.setLineDash([2 * ratio, 3 * ratio]);
    g.beginPath();
    g.moveTo(x, u.bbox.top + 12 * ratio);
    g.lineTo(x, u.bbox.top + u.bbox.height);
    g.stroke();
    g.fillText(word, x, u.bbox.top + 10 * ratio);
  }
  g.restore();
}
