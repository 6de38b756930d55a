// The rows on the left: one strip of ranks 1x–5x over time each.

import { HARMONICS, Past, el, fit, invalidate, node, rankColour, rows, view } from "./state.js";

const WIDE = HARMONICS.length;
const NOTHING = -2; // no window in this column
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
  const row = { key, bench: v.bench, stage: v.stage, channel: v.channel, unit: v.unit, past: new Past(), last: null, canvas, box, state, columns: null };
  box.addEventListener("click", () => select(row));
  rows.set(key, row);
  el("rows").append(box);
  el("rows").classList.toggle("benches", new Set([...rows.values()].map((r) => r.bench)).size > 1);
  if (!view.selected) select(row);
  return row;
}

function select(row) {
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
  const all = [...rows.values()];
  select(all[(all.indexOf(view.selected) + step + all.length) % all.length]);
});

// Columns of a span of time: each holds the highest level of its windows. Their borders lie at fixed times, so that a new window
// changes the last column alone; `changed` says whether it did.
class Columns {
  constructor(span, count) {
    this.span = span;
    this.count = count;
    this.level = new Int8Array(count * WIDE).fill(NOTHING);
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
        const cells = Math.min(by, this.count) * WIDE;
        this.level.copyWithin(0, cells);
        this.level.fill(NOTHING, this.level.length - cells);
        this.changed = true;
      }
      this.last = column;
      for (let k = 0; k < WIDE; k++) {
        const at = (this.count - 1) * WIDE + k;
        const level = past.level[i * WIDE + k];
        if (level > this.level[at]) {
          this.level[at] = level;
          this.changed = true;
        }
      }
    }
    this.taken = past.total;
  }
}

// The levels that a strip shows, oldest first; null if they are those of the last time.
function shown(row, width, anew) {
  if (!view.span) {
    const cell = Math.max(2, Math.min(8, width / 60));
    const count = Math.min(row.past.length, Math.floor(width / cell));
    row.columns = null;
    return { cell, count, level: row.past.level.subarray((row.past.end - count) * WIDE, row.past.end * WIDE) };
  }
  const count = Math.floor(width / CELL);
  const kept = row.columns;
  if (!kept || kept.span !== view.span || kept.count !== count || kept.taken > row.past.total) row.columns = new Columns(view.span, count);
  row.columns.take(row.past);
  return row.columns.changed || anew ? { cell: CELL, count, level: row.columns.level } : null;
}

export function drawStrip(row, anew) {
  if (!row.last) return;
  const codes = HARMONICS.map((h) => (row.last[`level_${h}x`] < 0 ? "?" : row.last[`rank_${h}x`])).join(" ");
  const words = row.last.instrument === "ok" ? row.last.machine : row.last.instrument;
  row.state.textContent = `${words.replaceAll("_", " ")} · ${codes}`;

  const what = shown(row, Math.max(1, row.canvas.clientWidth), anew);
  if (!what) return;
  const { g, width, height } = fit(row.canvas);
  const { cell, count, level } = what;
  const lane = height / WIDE;
  const x0 = width - count * cell;
  const breadth = cell - (cell > 3 ? 1 : 0);
  for (let colour = -1; colour <= 5; colour++) {
    g.fillStyle = rankColour(colour);
    // The height says the same as the colour, for those who cannot tell colours apart.
    const tall = (colour < 0 ? 0.18 : 0.3 + 0.14 * colour) * (lane - 2);
    for (let at = 0; at < level.length; at++) {
      if (level[at] !== colour) continue;
      const k = at % WIDE;
      g.fillRect(x0 + ((at - k) / WIDE) * cell, (k + 1) * lane - 1 - tall, breadth, tall);
    }
  }
}

for (const [seconds, name] of [[0, "Windows"], [600, "10 min"], [3600, "1 h"]]) {
  const button = node("button", { type: "button", "aria-pressed": String(seconds === view.span) }, name);
  button.addEventListener("click", () => {
    view.span = seconds;
    for (const other of el("span").children) other.setAttribute("aria-pressed", String(other === button));
    invalidate("all");
  });
  el("span").append(button);
}
