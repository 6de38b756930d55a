// Which rows are shown, and in what order: by name, by state, the worst first.

import { HARMONICS, MACHINE, el, gravity, invalidate, known, node, plain, remember, remembered, rows, view } from "./state.js";

const PATIENCE_MS = 2000; // rows do not change places faster than a hand can follow
let kept = "";
let due = 0;
let waiting = 0;

// The gravest rank that the verdict bears out, then the deviation that lies the most sigmas from zero.
function worst(row) {
  if (!row.last) return [-1, 0, 0];
  const level = Math.max(...HARMONICS.map((h) => row.last[`level_${h}x`]));
  const far = Math.max(0, ...HARMONICS.map((h) => Math.abs(row.last[`dev_${h}x_percent`]) / row.last[`dev_sigma_${h}x_percent`]).filter(known));
  const bad = row.last.instrument !== "ok" ? 0.5 : 0; // between normal and unknown's neighbours: cannot be judged
  return [gravity(row.last) + bad, level, far];
}

const byName = (a, b) => a.key.localeCompare(b.key, undefined, { numeric: true });
const ORDERS = {
  worst: ["Worst first", (a, b) => {
    const [x, y] = [worst(a), worst(b)];
    const k = x.findIndex((v, i) => v !== y[i]);
    // Not by the last digit of a deviation, which is another in each window.
    return k < 0 || k === 2 ? byName(a, b) : y[k] - x[k];
  }],
  name: ["By name", byName],
  channel: ["By channel", (a, b) => a.channel.localeCompare(b.channel, undefined, { numeric: true }) || byName(a, b)],
  file: ["As configured", () => 0],
};

function matches(row) {
  const state = el("filter").value;
  const words = el("search").value.toLowerCase().split(/\s+/).filter(Boolean);
  const name = `${row.bench} ${row.stage} ${row.channel}`.toLowerCase();
  if (view.bench && row.bench !== view.bench) return false;
  if (!words.every((word) => name.includes(word))) return false;
  if (state === "all") return true;
  if (!row.last) return false;
  if (state === "trouble") return gravity(row.last) > 1 || row.last.instrument !== "ok";
  return state === "instrument" ? row.last.instrument !== "ok" : row.last.machine === state;
}

// The rows that are shown, in their order.
export function inOrder() {
  const all = [...rows.values()].filter(matches);
  const order = ORDERS[el("sort").value];
  return order ? all.sort(order[1]) : all;
}

// Puts the rows into their order; at once where somebody asked for it, else now and then.
export function arrange(now = false) {
  const at = performance.now();
  if (!now && at < due) {
    if (!waiting) waiting = setTimeout(() => { waiting = 0; arrange(); }, due - at + 10);
    return;
  }
  due = at + PATIENCE_MS;
  const shown = inOrder();
  const keys = shown.map((row) => row.box.id).join(" ");
  const count = `${shown.length === rows.size ? "" : `${shown.length} of `}${rows.size} row${rows.size === 1 ? "" : "s"}`;
  if (el("found").textContent !== count) el("found").textContent = count;
  if (keys === kept) return;
  kept = keys;
  const visible = new Set(shown);
  for (const row of rows.values()) {
    const appears = row.box.hidden && visible.has(row);
    row.box.hidden = !visible.has(row);
    if (appears) invalidate("all");
  }
  // Moving a node that stands where it should would take the focus and the scroll place from it.
  let before = el("rows").firstChild;
  for (const row of shown) {
    if (before === row.box) before = before.nextSibling;
    else el("rows").insertBefore(row.box, before);
  }
}

for (const [value, [name]] of Object.entries(ORDERS)) el("sort").append(node("option", { value }, name));
for (const [value, name] of [["all", "All states"], ["trouble", "Not in order"], ["instrument", "Instrument not ok"], ...[...MACHINE].reverse().map((s) => [s, plain(s)])]) {
  el("filter").append(node("option", { value }, name));
}
for (const [id, otherwise] of [["sort", "worst"], ["filter", "all"]]) {
  el(id).value = remembered(id, otherwise);
  if (el(id).selectedIndex < 0) el(id).value = otherwise;
  el(id).addEventListener("change", () => {
    remember(id, el(id).value);
    arrange(true);
  });
}
el("search").addEventListener("input", () => arrange(true));
