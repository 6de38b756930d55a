// Cursors on the spectrum: multiples of an order, or a carrier with lines beside it at equal distances.

import { css, el, invalidate, text } from "./state.js";

const MOST_HARMONICS = 40;
const SIDEBANDS = 5; // on each side
const LISTED = 12;
const SNAP = 0.004; // share of what is shown within which a click finds the largest line

export const cursors = { mode: "off", order: 1, spacing: 1 };

// Puts the cursor onto the largest line near an order.
export function place(order, s, [min, max]) {
  const reach = Math.max(1, Math.round((SNAP * (max - min)) / s.order_step));
  const at = Math.round((order - s.first_order) / s.order_step);
  let best = Math.max(0, Math.min(s.amplitude.length - 1, at));
  for (let i = Math.max(0, at - reach); i <= Math.min(s.amplitude.length - 1, at + reach); i++) if (s.amplitude[i] > s.amplitude[best]) best = i;
  cursors.order = s.first_order + best * s.order_step;
  el("cursor-order").value = cursors.order.toFixed(4);
}

function lines(s) {
  const { mode, order, spacing } = cursors;
  const last = s.first_order + (s.amplitude.length - 1) * s.order_step;
  if (mode === "harmonics" && order > 0) return Array.from({ length: Math.min(MOST_HARMONICS, Math.floor(last / order)) }, (_, i) => ({ order: (i + 1) * order, name: `${i + 1}×` }));
  if (mode === "sidebands" && spacing > 0) {
    const all = Array.from({ length: 2 * SIDEBANDS + 1 }, (_, i) => i - SIDEBANDS).map((k) => ({ order: order + k * spacing, name: k === 0 ? "carrier" : k > 0 ? `+${k}` : `−${-k}` }));
    return all.filter((l) => l.order > 0 && l.order <= last);
  }
  return [];
}

// The largest of the lines on both sides of an order: what stands there, wherever between two lines of the picture it lies.
function amplitude(s, order) {
  const at = Math.round((order - s.first_order) / s.order_step);
  return Math.max(...[at - 1, at, at + 1].map((i) => s.amplitude[i] ?? 0));
}

export function drawCursors(u, g, s) {
  const ratio = window.devicePixelRatio || 1;
  g.save();
  g.strokeStyle = g.fillStyle = css("--focus");
  g.lineWidth = 1.5 * ratio;
  g.font = `${11 * ratio}px system-ui`;
  g.textAlign = "center";
  let end = -Infinity;
  for (const line of lines(s)) {
    const x = u.valToPos(line.order, "x", true);
    if (x < u.bbox.left || x > u.bbox.left + u.bbox.width) continue;
    g.beginPath();
    g.moveTo(x, u.bbox.top + u.bbox.height * 0.3);
    g.lineTo(x, u.bbox.top + u.bbox.height);
    g.stroke();
    const half = g.measureText(line.name).width / 2;
    if (x - half < end) continue;
    g.fillText(line.name, x, u.bbox.top + u.bbox.height * 0.3 - 3 * ratio);
    end = x + half + 4 * ratio;
  }
  g.restore();
}

// The values under the cursors in words.
export function describe(s) {
  const all = lines(s);
  if (all.length === 0) return cursors.mode === "off" ? "" : "No cursor within the spectrum.";
  const shown = all.slice(0, LISTED).map((l) => `${l.name} ${text(amplitude(s, l.order), 3)}`);
  const carrier = all.find((l) => l.name === "carrier");
  const beside = all.filter((l) => l !== carrier).map((l) => amplitude(s, l.order));
  const share = carrier ? ` · all sidebands / carrier ${text(Math.hypot(...beside) / amplitude(s, carrier.order), 3)}` : "";
  return `${shown.join(" · ")}${all.length > LISTED ? " · …" : ""} (${s.unit})${share}`;
}

for (const id of ["cursor-order", "cursor-spacing"]) {
  el(id).addEventListener("input", () => {
    const value = Number(el(id).value);
    if (value > 0) cursors[id === "cursor-order" ? "order" : "spacing"] = value;
    invalidate("spectrum");
  });
}
el("cursor-mode").addEventListener("change", () => {
  cursors.mode = el("cursor-mode").value;
  el("cursor-order-label").hidden = cursors.mode === "off";
  el("cursor-spacing-label").hidden = cursors.mode !== "sidebands";
  invalidate("spectrum");
});
