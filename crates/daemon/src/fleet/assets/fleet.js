// All benches of the fleet: one EventSource that brings the whole picture once a second, drawn anew where it has changed.
"use strict";

const RANKS = ["0", "I", "II", "III", "IV", "V"];
const WORST_FIRST = ["alarm", "deviating", "path_changed", "silent", "stopped", "not ok", "unknown", "normal"];
const MINUTES = 120;
const QUIET_MS = 5000; // so long without a word from this program, and the page says so

const el = (id) => document.getElementById(id);
const rows = new Map(); // bench → { tr, json }
let heardAt = 0;

function node(tag, attributes = {}, ...children) {
  const svg = tag === "svg" || tag === "rect";
  const n = svg ? document.createElementNS("http://www.w3.org/2000/svg", tag) : document.createElement(tag);
  for (const [k, v] of Object.entries(attributes)) n.setAttribute(k, v);
  n.append(...children);
  return n;
}

const number = (x, digits, unit) => (typeof x === "number" ? `${x.toFixed(digits)} ${unit}` : "–");
const level = (rank) => RANKS.indexOf(rank); // −1: unknown

function age(ns) {
  const s = Math.max(0, Math.round(ns / 1e9));
  return s < 120 ? `${s} s` : s < 7200 ? `${Math.round(s / 60)} min` : `${Math.round(s / 3600)} h`;
}

function worstPlace(places) {
  const worst = (ranks) => [...ranks].map(level).sort((a, b) => b - a);
  const order = ([, a], [, b]) => {
    const [x, y] = [worst(a.ranks), worst(b.ranks)];
    const k = x.findIndex((v, i) => v !== y[i]);
    return k < 0 ? 0 : y[k] - x[k];
  };
  return Object.entries(places).sort(order)[0];
}

function ranks(bench) {
  const worst = worstPlace(bench.places);
  if (!worst) return ["–"];
  const badge = (rank) => node("span", { class: `rank l${level(rank)}` }, level(rank) < 0 ? "?" : rank);
  return [...worst[1].ranks.map(badge), ` ${worst[0]}`];
}

function past(bench) {
  const minutes = Object.entries(bench.past ?? {}).map(([minute, severity]) => [Number(minute), severity]);
  const newest = Math.max(...minutes.map(([minute]) => minute));
  const count = (s) => minutes.filter(([, severity]) => severity === s).length;
  const words = minutes.length
    ? `until ${new Date(newest * 60000).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" })}: ${count(2)} min alarm, ${count(1)} deviating, ${count(0)} normal, ${count(-1)} unknown`
    : "no verdict yet";
  const bars = minutes.map(([minute, severity]) => {
    const height = [6, 10, 15, 22][severity + 1];
    return node("rect", { class: `s${severity}`, x: MINUTES - 1 - (newest - minute), y: 22 - height, width: 1, height });
  });
  return node("svg", { class: "past", role: "img", "aria-label": words, viewBox: `0 0 ${MINUTES} 22`, preserveAspectRatio: "none" }, ...bars);
}

function cells(name, bench) {
  const alarms = Object.entries(bench.alarms).map(([id, severity]) => `${id} ${severity}`).join(", ");
  return [
    node("th", { scope: "row" }, name),
    node("td", {}, node("span", { class: "condition", "data-state": bench.condition }, bench.condition.replace("_", " "))),
    node("td", {}, past(bench)),
    node("td", {}, ...ranks(bench)),
    node("td", {}, alarms || "–"),
    node("td", {}, number(bench.motor_speed_hz, 2, "Hz")),
    node("td", {}, number(bench.brake_torque_nm, 1, "N m")),
    node("td", {}, (bench.instrument || "unknown").replace("_", " ")),
    node("td", {}, String(bench.verdicts)),
    node("td", {}, String(bench.missing)),
    node("td", { class: "heard" }),
  ];
}

function show(fleet) {
  const names = Object.keys(fleet.benches);
  const order = (name) => WORST_FIRST.indexOf(fleet.benches[name].condition);
  names.sort((a, b) => order(a) - order(b) || a.localeCompare(b, undefined, { numeric: true }));
  for (const name of names) {
    const bench = fleet.benches[name];
    const { heard_ns, ...drawn } = bench;
    const json = JSON.stringify(drawn);
    if (!rows.has(name)) rows.set(name, { tr: node("tr"), json: "" });
    const row = rows.get(name);
    if (row.json !== json) {
      row.tr.replaceChildren(...cells(name, bench));
      row.json = json;
    }
    row.tr.querySelector(".heard").textContent = age(fleet.now_ns - heard_ns);
  }
  for (const name of [...rows.keys()].filter((name) => !(name in fleet.benches))) rows.delete(name);
  const body = el("benches").tBodies[0];
  const wanted = names.map((name) => rows.get(name).tr);
  if (wanted.length !== body.rows.length || wanted.some((tr, k) => tr !== body.rows[k])) body.replaceChildren(...wanted);

  const counts = WORST_FIRST.map((condition) => [condition, names.filter((name) => fleet.benches[name].condition === condition).length]);
  const there = counts.filter(([, count]) => count > 0);
  const worst = there[0]?.[0] ?? "unknown";
  lamp("lamp-fleet", WORST_FIRST.indexOf(worst) < 3 || worst === "normal" ? worst : "unknown", there.map(([condition, count]) => `${count} ${condition.replace("_", " ")}`).join(", ") || "none heard");
  const link = fleet.link === "live" ? `live from ${fleet.server}` : fleet.link === "reading" ? "reading what was said" : fleet.link;
  lamp("lamp-link", fleet.link === "live" ? "ok" : fleet.link.startsWith("away") ? "not_ok" : "unknown", link);
}

function lamp(id, state, words) {
  const lamp = el(id);
  lamp.dataset.state = state;
  const span = lamp.querySelector("span");
  // Assistive technology speaks what changes: the same words again are no change.
  if (span.textContent !== words) span.textContent = words;
}

function theme(dark) {
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  el("theme").setAttribute("aria-pressed", String(dark));
}

theme(matchMedia("(prefers-color-scheme: dark)").matches);
el("theme").addEventListener("click", () => theme(document.documentElement.dataset.theme !== "dark"));
const events = new EventSource("/api/events");
events.addEventListener("message", (event) => {
  heardAt = Date.now();
  show(JSON.parse(event.data));
});
setInterval(() => {
  if (Date.now() - heardAt > QUIET_MS) lamp("lamp-link", "not_ok", "gearwatch fleet does not answer");
}, 1000);
