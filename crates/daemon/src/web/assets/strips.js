// The rows on the left: one strip of ranks 1x–5x over time each.

import { HARMONICS, LOOKS, Past, codeOf, el, fit, invalidate, lookOf, node, plain, remember, remembered, rows, shade, sizeOf, strengthOf, view } from "./state.js";
import { arrange, inOrder } from "./find.js";

const WIDE = HARMONICS.length;
const NOTHING = -2; // no window in this column
const SHADES = 5; // steps of strength that are told apart
const CELL = 3; // width of a column where a strip shows a span of time (px)

export function rowOf(v) {
  const key = `${v.bench}/${v.stage}/${v.channel}`;
  return rows.get(key) || addRow(key, v);
}

function addRow(key, v) {
  const canvas = node("canvas", { "aria-hidden": "true" });
  const state = node("span", {}, "");
  const box = node("div", { class: "row", role: "option", id: `row-${rows.size}`, "aria-selected": "false" },
    node("div", { class: "head" }, node("span", {}, node("span", { class: "bench" }, `${v.bench} · `), `${v.stage} · ${v.channel}`), state), canvas);
  const row = { key, bench: v.bench, stage: v.stage, channel: v.channel, unit: v.unit, past: new Past(), last: null, indicators: {}, canvas, box, state, columns: null, size: null, anew: true };
  box.addEventListener("click", () => select(row));
  rows.set(key, row);
  el("rows").append(box);
  el("rows").classList.toggle("benches", new Set([...rows.values()].map((r) => r.bench)).size > 1);
  if (!view.selected) select(row);
  arrange();
  return row;
}

export function select(row) {
  if (view.selected) view.selected.box.setAttribute("aria-selected", "false");
  view.selected = row;
  row.box.setAttribute("aria-selected", "true");
  el("rows").setAttribute("aria-activedescendant", row.box.id);
  row.box.scrollIntoView({ block: "nearest" });
  invalidate("detail");
  invalidate("spectrum");
  invalidate("status");
}

el("rows").addEventListener("keydown", (event) => {
  const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (!step || rows.size === 0) return;
  event.preventDefault();
  const all = inOrder();
  if (all.length) select(all[(all.indexOf(view.selected) + step + all.length) % all.length]);
});

// What a strip's cells look like: the level, the look, the strength in steps, of `cells` cells.
function cells(cells) {
  return { level: new Int8Array(cells).fill(NOTHING), look: new Int8Array(cells).fill(NOTHING), strength: new Int8Array(cells) };
}

function put(to, at, past, i, k) {
  const from = i * WIDE + k;
  const look = lookOf(past.machine[i], past.level[from]);
  to.level[at] = past.level[from];
  to.look[at] = look;
  to.strength[at] = Math.round(SHADES * strengthOf(look, past.level[from], past.p[from]));
}

// Columns of a span of time: each holds the gravest of its windows, by what the verdict proves, then by how sure the rank is. Their borders lie at fixed times, so that a new window
// changes the last column alone; `changed` says whether it did.
class Columns {
  constructor(span, count) {
    this.span = span;
    this.count = count;
    this.cells = cells(count * WIDE);
    this.fresh = cells(1);
    this.last = null; // number of the last column since the epoch
    this.taken = 0; // windows taken in, of those that the row ever had
    this.changed = true;
  }

  take(past) {
    const wide = (this.span * 1e9) / this.count;
    this.changed = this.taken === 0;
    for (let i = Math.max(past.start, past.end - (past.total - this.taken)); i < past.end; i++) {
      const column = Math.floor(past.t0[i] / wide);
      const by = this.last === null ? 0 : column - this.last;
      if (by > 0) {
        const gone = Math.min(by, this.count) * WIDE;
        for (const [name, empty] of [["level", NOTHING], ["look", NOTHING], ["strength", 0]]) {
          this.cells[name].copyWithin(0, gone);
          this.cells[name].fill(empty, this.cells[name].length - gone);
        }
        this.changed = true;
      }
      this.last = column;
      for (let k = 0; k < WIDE; k++) {
        const at = (this.count - 1) * WIDE + k;
        put(this.fresh, 0, past, i, k);
        const graver = this.fresh.look[0] - this.cells.look[at] || this.fresh.level[0] - this.cells.level[at] || this.fresh.strength[0] - this.cells.strength[at];
        if (graver > 0) {
          for (const name of ["level", "look", "strength"]) this.cells[name][at] = this.fresh[name][0];
          this.changed = true;
        }
      }
    }
    this.taken = past.total;
  }
}

// The cells that a strip shows, oldest first; null if they are those of the last time.
function shown(row, width, anew) {
  if (!view.span) {
    const cell = Math.max(2, Math.min(8, width / 60));
    const count = Math.min(row.past.length, Math.floor(width / cell));
    row.columns = null;
    const all = cells(count * WIDE);
    for (let i = 0; i < count; i++) for (let k = 0; k < WIDE; k++) put(all, i * WIDE + k, row.past, row.past.end - count + i, k);
    return { cell, count, ...all };
  }
  const count = Math.floor(width / CELL);
  const kept = row.columns;
  if (!kept || kept.span !== view.span || kept.count !== count || kept.taken > row.past.total) row.columns = new Columns(view.span, count);
  row.columns.take(row.past);
  return row.columns.changed || anew ? { cell: CELL, count, ...row.columns.cells } : null;
}

// Draws these strips as long as there is time; those that are left.
export function drawStrips(list, until) {
  const seen = list.filter((row) => row.last && !row.box.hidden);
  // All sizes first: one asked for after something was written costs a layout of the whole page.
  for (const row of seen) {
    if (row.size) continue;
    row.size = sizeOf(row.canvas);
    row.anew = true;
  }
  const inks = LOOKS.map((l) => Array.from({ length: SHADES + 1 }, (_, s) => shade(l, s / SHADES)));
  let drawn = 0;
  while (drawn < seen.length && performance.now() <= until) drawStrip(seen[drawn++], inks);
  return seen.slice(drawn);
}

// The page has another size or another theme.
export function forgetSizes() {
  for (const row of rows.values()) row.size = null;
}

function drawStrip(row, inks) {
  const codes = HARMONICS.map((h) => codeOf(row.last, h)).join(" ");
  const words = row.last.instrument === "ok" ? row.last.machine : row.last.instrument;
  const said = `${plain(words)} · ${codes}`;
  if (row.said !== said) row.state.textContent = row.said = said;

  const what = shown(row, row.size.width, row.anew);
  row.anew = false;
  if (!what) return;
  const { g, width, height } = fit(row.canvas, row.size);
  const { cell, count, level, look, strength } = what;
  const lane = height / WIDE;
  const x0 = width - count * cell;
  const breadth = cell - (cell > 3 ? 1 : 0);
  let ink = null; // a colour is parsed each time it is set
  for (let k = 0; k < WIDE; k++) {
    for (let at = k; at < level.length; at += WIDE) {
      if (look[at] === NOTHING) continue;
      const next = inks[look[at] + 1][strength[at]];
      if (next !== ink) g.fillStyle = ink = next;
      // The height says the rank, for those who cannot tell colours apart, and the rank that a verdict does not bear out.
      const tall = (level[at] < 0 ? 0.18 : 0.3 + 0.14 * level[at]) * (lane - 2);
      g.fillRect(x0 + ((at - k) / WIDE) * cell, (k + 1) * lane - 1 - tall, breadth, tall);
    }
  }
}

view.span = Number(remembered("span", 0)) || 0;
for (const [seconds, name] of [[0, "Windows"], [600, "10 min"], [3600, "1 h"]]) {
  const button = node("button", { type: "button", "aria-pressed": String(seconds === view.span) }, name);
  button.addEventListener("click", () => {
    view.span = seconds;
    remember("span", seconds);
    for (const other of el("span").children) other.setAttribute("aria-pressed", String(other === button));
    invalidate("all");
  });
  el("span").append(button);
}
