// The service itself: lamps, operating point, alarms, sources, facts.

import { clock, el, node, text, view } from "./state.js";

export function lamp(id, state, words) {
  const n = el(id);
  if (n.dataset.state !== state) n.dataset.state = state;
  const span = n.querySelector("span");
  if (span.textContent !== words) span.textContent = words;
}

export function drawStatus() {
  const status = view.status;
  const bench = (status.benches || []).find((b) => view.selected && b.name === view.selected.bench) || (status.benches || [])[0];
  if (!bench) return;
  el("bench").textContent = bench.name;
  lamp("lamp-machine", bench.machine, bench.machine.replace("_", " "));
  lamp("lamp-instrument", bench.instrument === "ok" ? "ok" : bench.instrument === "unknown" ? "unknown" : "not_ok", bench.instrument.replace(/_/g, " "));
  el("op-speed").textContent = text(bench.motor_speed_hz, 5, "Hz");
  el("op-torque").textContent = text(bench.brake_torque_nm, 4, "N m");
  el("op-temperature").textContent = text(bench.temperature_c, 3, "°C");
  el("alarms").tBodies[0].replaceChildren(...(bench.alarms.length ? bench.alarms.map(alarmRow) : [node("tr", {}, node("td", { colspan: "5" }, "none"))]));
  el("sources").tBodies[0].replaceChildren(...bench.sources.map((s) => node("tr", {}, node("th", { scope: "row" }, s.name), node("td", {}, s.state), node("td", {}, String(s.windows)), node("td", {}, String(s.gaps)))));
  const facts = Object.entries(status.facts || {});
  el("log").replaceChildren(...facts.map(([k, v]) => node("div", {}, node("dt", {}, k), node("dd", {}, String(v)))));
}

function alarmRow(a) {
  const button = node("button", { type: "button" }, a.acknowledged ? "Acknowledged" : "Acknowledge");
  button.disabled = a.acknowledged;
  button.setAttribute("aria-label", `Acknowledge ${a.what} on ${a.place}`);
  button.addEventListener("click", async () => {
    button.disabled = true;
    const reply = await fetch(`/api/alarms/${encodeURIComponent(a.id)}/acknowledge`, { method: "POST", headers: { "content-type": "application/json" }, body: "{}" }).catch(() => null);
    if (!reply || !reply.ok) button.disabled = false;
  });
  return node("tr", {}, node("td", {}, clock(a.since_ns)), node("td", {}, a.place), node("td", {}, a.what), node("td", {}, a.state), node("td", {}, button));
}
