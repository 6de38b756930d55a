// What the page knows: one row per bench, stage and channel, the newest spectra, the newest status. Others read it and ask for drawing.

export const HARMONICS = [1, 2, 3, 4, 5];
export const RANKS = ["0", "I", "II", "III", "IV", "V"];
export const view = { selected: null, harmonic: 1, span: 0, status: null, bench: "" }; // span: seconds a strip shows; 0: each window by itself. bench: the only one shown
export const rows = new Map(); // bench/stage/channel → row
export const spectra = new Map(); // bench/channel → { last, waterfall }

const KEEP = 7200; // windows kept per row, as the service does: an hour of two a second
const WIDE = HARMONICS.length;
const NUMBERS = ["p", "amp", "base", "sigma"]; // of each harmonic

/* ---- drawing happens at most once per animation frame, and only what changed ---- */

const dirty = new Set();
let painter = () => {};

export function paintWith(draw) {
  painter = draw;
}

export function invalidate(what) {
  if (dirty.size === 0) {
    requestAnimationFrame(() => {
      const todo = new Set(dirty);
      dirty.clear();
      painter(todo);
    });
  }
  dirty.add(what);
}

/* ---- the past of a row ---- */

// Columns of numbers, oldest first, between `start` and `end`. They live in arrays twice as long as what is kept, so that the
// oldest can go without moving the rest each time.
export class Past {
  constructor() {
    this.t0 = new Float64Array(2 * KEEP);
    this.level = new Int8Array(2 * KEEP * WIDE);
    this.machine = new Array(2 * KEEP);
    for (const name of NUMBERS) this[name] = new Float32Array(2 * KEEP * WIDE);
    this.clear();
  }

  clear() {
    this.start = this.end = 0;
    this.total = 0; // pushed since it was empty
  }

  get length() {
    return this.end - this.start;
  }

  get newest() {
    return this.length ? this.t0[this.end - 1] : -Infinity;
  }

  // `of(name, k)` gives the value of harmonic k (from 0); what is not known is kept as NaN.
  push(t0, machine, of) {
    if (this.end === 2 * KEEP) {
      this.t0.copyWithin(0, this.start, this.end);
      this.machine.copyWithin(0, this.start, this.end);
      for (const name of ["level", ...NUMBERS]) this[name].copyWithin(0, this.start * WIDE, this.end * WIDE);
      this.end -= this.start;
      this.start = 0;
    }
    this.t0[this.end] = t0;
    this.machine[this.end] = machine;
    for (let k = 0; k < WIDE; k++) {
      const at = this.end * WIDE + k;
      this.level[at] = of("level", k);
      for (const name of NUMBERS) this[name][at] = of(name, k) ?? NaN;
    }
    this.end++;
    this.total++;
    if (this.length > KEEP) this.start++;
  }

  // One harmonic as uPlot wants it: null where nothing is known.
  column(name, k) {
    const out = new Array(this.length);
    for (let i = 0; i < out.length; i++) {
      const x = this[name][(this.start + i) * WIDE + k];
      out[i] = Number.isFinite(x) ? x : null;
    }
    return out;
  }
}

/* ---- small things that all need ---- */

export const el = (id) => document.getElementById(id);
// Colours of the theme. The browser computes all styles for such a question: each is asked once a theme.
const colours = new Map();
export function css(name) {
  if (!colours.has(name)) colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return colours.get(name);
}
export const forgetColours = () => colours.clear();

/* ---- the look of a rank: its colour says no more than the verdict, its strength how sure the rank is ---- */

export const LOOKS = [-1, 0, 1, 2, 3, 4, 5, 6]; // unknown, 0 to V, path changed
// The highest rank that each machine state (by its first letter) proves: a naked V on a stage that is called normal is no alarm.
const PROVEN = { n: 0, d: 3, a: 5 };
export const lookOf = (machine, level) => (level < 0 || machine[0] === "u" ? -1 : machine[0] === "p" ? 6 : Math.min(level, PROVEN[machine[0]] ?? 5));
// A rank above 0 on a stage that is called normal is not borne out, however probable it is by itself.
const borneOut = (look, level) => look !== 0 || level <= 0;
export const strengthOf = (look, level, p) => (look < 0 ? 1 : 0.2 + 0.8 * (known(p) && borneOut(look, level) ? p : 0));
const inkOf = (look) => (look < 0 ? "--ru" : look === 6 ? "--rp" : `--r${look}`);
export const shade = (look, strength) => `color-mix(in srgb, ${css(inkOf(look))} ${Math.round(100 * strength)}%, ${css("--panel")})`;
const channels = (hex) => [1, 3, 5].map((i) => parseInt(hex.length === 4 ? hex[(i + 1) / 2].repeat(2) : hex.slice(i, i + 2), 16));
// Black or white, whichever is read better on a shade: relative luminance of WCAG 2, where both have the same contrast at 0.179.
export function inkOn(look, strength) {
  const [on, under] = [css(inkOf(look)), css("--panel")].map(channels);
  const linear = on.map((c, i) => (c * strength + under[i] * (1 - strength)) / 255).map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
  return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2] > 0.179 ? "#000" : "#fff";
}
export const colourOf = (last, h) => {
  const look = lookOf(last.machine, last[`level_${h}x`]);
  return shade(look, strengthOf(look, last[`level_${h}x`], last[`p_${h}x`]));
};
// The rank in words, with a question mark where it is as likely wrong as right.
export function codeOf(v, h) {
  const level = v[`level_${h}x`];
  if (level < 0) return "?";
  return `${v[`rank_${h}x`]}${v[`p_${h}x`] > 0.5 && borneOut(lookOf(v.machine, level), level) ? "" : "?"}`;
}

export const known = (x) => typeof x === "number" && Number.isFinite(x);
export const text = (x, digits, unit) => (known(x) ? `${Number(x).toPrecision(digits)}${unit ? ` ${unit}` : ""}` : "–");
export const percent = (x) => (known(x) ? `${x > 0 ? "+" : x < 0 ? "−" : ""}${Math.abs(x).toFixed(1)} %` : "–");
export const plain = (words) => String(words).replaceAll("_", " ");

// What somebody has chosen, for the next visit. A browser that keeps nothing is no reason to stop.
export function remembered(name, otherwise) {
  try {
    return localStorage.getItem(`gearwatch-${name}`) ?? otherwise;
  } catch {
    return otherwise;
  }
}
export function remember(name, value) {
  try {
    localStorage.setItem(`gearwatch-${name}`, value);
  } catch {
    // Not kept.
  }
}

/* ---- states, from good to grave ---- */

export const MACHINE = ["normal", "unknown", "deviating", "path_changed", "alarm"];
export const gravity = (v) => MACHINE.indexOf(v.machine);

export function node(tag, attributes = {}, ...children) {
  const n = document.createElement(tag);
  // Styles go through the object model: the content security policy forbids style attributes.
  for (const [k, v] of Object.entries(attributes)) k === "style" ? (n.style.cssText = v) : n.setAttribute(k, v);
  n.append(...children);
  return n;
}

export const sizeOf = (canvas) => ({ width: Math.max(1, canvas.clientWidth), height: Math.max(1, canvas.clientHeight) });

// A canvas as sharp as the screen, cleared. Its size is asked for where it is not known: that makes the browser lay out the page if something was written before.
export function fit(canvas, { width, height } = sizeOf(canvas)) {
  const ratio = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const g = canvas.getContext("2d");
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  g.clearRect(0, 0, width, height);
  return { g, width, height };
}
