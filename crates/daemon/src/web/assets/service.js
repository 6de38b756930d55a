// The service itself: lamps, operating point, alarms, sources, facts.

import { clock, el, known, node, text, view } from "./state.js";

export function lamp(id, state, words) {
  const n = el(id);
  if (n.dataset.state !== state) n.dataset.state = state;
  const span = n.querySelector("span");
  if (span.textContent !== words) span.textContent = words;
}

export function drawStatus() {
  const status = view.status;
  const benches = status.benches || [];
  const bench = benches.find((b) => view.selected && b.name === view.selected.bench) || benches[0];
  if (!bench) return;
  el("bench").textContent = bench.name;
  const machine = gravest(benches, (b) => MACHINE.indexOf(b.machine));
  lamp("lamp-machine", machine.machine, words(machine.machine, benches, (b) => b.machine === machine.machine));
  const instrument = gravest(benches, (b) => (b.instrument === "ok" ? 0 : b.instrument === "unknown" ? 1 : 2));
  const other = benches.filter((b) => !["ok", "unknown"].includes(b.instrument));
  lamp("lamp-instrument", instrument.instrument === "ok" ? "ok" : instrument.instrument === "unknown" ? "unknown" : "not_ok",
    words(instrument.instrument, benches, (b) => (other.length ? other.includes(b) : b.instrument === instrument.instrument)));
  el("op-speed").textContent = known(bench.motor_speed_hz) ? `${text(bench.motor_speed_hz, 5, "Hz")} (${(60 * bench.motor_speed_hz).toFixed(0)} rpm)` : "–";
  el("op-torque").textContent = text(bench.brake_torque_nm, 4, "N m");
  el("op-temperature").textContent = text(bench.temperature_c, 3, "°C");
  const alarms = benches.flatMap((b) => b.alarms.map((a) => [b, a]));
  el("alarms").tBodies[0].replaceChildren(...(alarms.length ? alarms.map(([b, a]) => alarmRow(a, benches.length > 1 ? `${b.name} · ${a.place}` : a.place)) : [node("tr", {}, node("td", { colspan: "5" }, "none"))]));
  el("sources").tBodies[0].replaceChildren(...benches.flatMap((b) => b.sources.map((s) => node("tr", {}, node("th", { scope: "row" }, benches.length > 1 ? `${b.name} · ${s.name}` : s.name), node("td", {}, s.state), node("td", {}, String(s.windows)), node("td", {}, String(s.gaps))))));
  const facts = Object.entries(status.facts || {});
  el("log").replaceChildren(...facts.map(([k, v]) => node("div", {}, node("dt", {}, k), node("dd", {}, String(v)))));
}

// From good to grave.
const MACHINE = ["normal", "unknown", "deviating", "path_changed", "alarm"];

// The lamps speak of all benches: one that is in order must not hide another that is not.
function gravest(benches, severity) {
  return benches.reduce((a, b) => (severity(b) > severity(a) ? b : a));
}

// A state in words, with the benches that it is of where there are several.
function words(state, benches, has) {
  const of = benches.filter(has).map((b) => b.name);
  const plain = state.replaceAll("_", " ");
  return benches.length < 2 || of.length === benches.length ? plain : `${plain}: ${of.length > 2 ? `${of.length} of ${benches.length} benches` : of.join(", ")}`;
}

// Who has seen an alarm, and why it may be acknowledged: both stand in the log.
function ask(a, place) {
  const who = node("input", { type: "text", name: "who", maxlength: "100", autocomplete: "name" });
  who.value = localStorage.getItem("gearwatch-who") || "";
  const why = node("input", { type: "text", name: "why", maxlength: "1000" });
  const said = node("p", { role: "status" });
  const send = node("button", { type: "button", class: "send" }, "Acknowledge");
  const leave = node("button", { type: "button" }, "Cancel");
  const dialog = node("dialog", { id: "acknowledge", "aria-label": `Acknowledge ${a.what} on ${place}` },
    node("p", {}, `${a.what} on ${place}`), node("label", {}, "Your name ", who), node("label", {}, "Reason ", why), said, node("div", { class: "buttons" }, send, leave));
  dialog.addEventListener("close", () => dialog.remove());
  leave.addEventListener("click", () => dialog.close());
  send.addEventListener("click", async () => {
    if (!who.value.trim() || !why.value.trim()) {
      said.textContent = "Name and reason are needed.";
      return;
    }
    const body = JSON.stringify({ who: who.value, why: why.value });
    const reply = await fetch(`/api/alarms/${encodeURIComponent(a.id)}/acknowledge`, { method: "POST", headers: { "content-type": "application/json" }, body }).catch(() => null);
    if (reply && reply.ok) {
      localStorage.setItem("gearwatch-who", who.value);
      dialog.close();
    } else {
      said.textContent = !reply ? "The service does not answer." : "There is no such alarm any more.";
    }
  });
  document.body.append(dialog);
  dialog.showModal();
  (who.value ? why : who).focus();
}

function alarmRow(a, place) {
  const button = node("button", { type: "button" }, a.acknowledged ? "Acknowledged" : "Acknowledge");
  button.disabled = a.acknowledged;
  button.setAttribute("aria-label", `Acknowledge ${a.what} on ${place}`);
  button.addEventListener("click", () => ask(a, place));
  return node("tr", {}, node("td", {}, clock(a.since_ns)), node("td", {}, place), node("td", {}, a.what), node("td", {}, a.state), node("td", {}, button));
}
