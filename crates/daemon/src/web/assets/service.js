// The service itself: lamps, operating point, the benches, sources, facts, and the tab's title.

import { MACHINE, el, invalidate, known, node, plain, text, view } from "./state.js";
import { arrange } from "./find.js";
import { drawAlarms } from "./alarms.js";

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
  const { machine, machine_of, instrument, instrument_of } = status.gravest;
  lamp("lamp-machine", machine, words(machine, benches, machine_of));
  lamp("lamp-instrument", ["ok", "unknown"].includes(instrument) ? instrument : "not_ok", words(instrument, benches, instrument_of));
  el("op-speed").textContent = known(bench.motor_speed_hz) ? `${text(bench.motor_speed_hz, 5, "Hz")} (${(60 * bench.motor_speed_hz).toFixed(0)} rpm)` : "–";
  el("op-torque").textContent = text(bench.brake_torque_nm, 4, "N m");
  el("op-temperature").textContent = text(bench.temperature_c, 3, "°C");
  drawBenches(benches);
  const alarms = drawAlarms(status);
  // Where the page is one tab of many, its title is all that is seen of it.
  title(machine, instrument, alarms, machine_of.length, benches.length);
  el("sources").tBodies[0].replaceChildren(...benches.flatMap((b) => b.sources.map((s) => node("tr", {}, node("th", { scope: "row" }, benches.length > 1 ? `${b.name} · ${s.name}` : s.name), node("td", {}, s.state), node("td", {}, String(s.windows)), node("td", {}, String(s.gaps))))));
  const facts = Object.entries(status.facts || {});
  el("log").replaceChildren(...facts.map(([k, v]) => node("div", {}, node("dt", {}, k), node("dd", {}, String(v)))));
}

const SIGN = { alarm: "▲", path_changed: "◆", deviating: "△", unknown: "?", normal: "●" };

export function title(machine, instrument, alarms, of, all) {
  const benches = all > 1 && machine !== "normal" ? ` ${of}/${all}` : "";
  const open = alarms ? ` · ${alarms} open` : "";
  const deaf = ["ok", "unknown"].includes(instrument) ? "" : " · instrument";
  const now = `${SIGN[machine] || "?"} ${plain(machine)}${benches}${open}${deaf} – gearwatch`;
  if (document.title !== now) document.title = now;
}

// A state in words, with the benches that it is of where there are several.
function words(state, benches, of) {
  return benches.length < 2 || of.length === benches.length ? plain(state) : `${plain(state)}: ${of.length > 2 ? `${of.length} of ${benches.length} benches` : of.join(", ")}`;
}

// One button a bench, the gravest first: pressed, it shows the rows of that bench alone.
let told = "";
function drawBenches(benches) {
  const list = [...benches].sort((a, b) => MACHINE.indexOf(b.machine) - MACHINE.indexOf(a.machine));
  const now = JSON.stringify([view.bench, list.map((b) => [b.name, b.machine, b.instrument, b.alarms.length])]);
  if (now === told) return;
  told = now;
  el("benches").hidden = benches.length < 2;
  const focused = document.activeElement?.dataset?.bench;
  el("benches").replaceChildren(...list.map((b) => {
    const button = node("button", { type: "button", class: "lamp", "data-state": b.machine, "data-bench": b.name, "aria-pressed": String(view.bench === b.name) }, node("b", {}, b.name), node("span", {}, `${plain(b.machine)}${b.instrument === "ok" ? "" : `, ${plain(b.instrument)}`}`));
    button.addEventListener("click", () => {
      view.bench = view.bench === b.name ? "" : b.name;
      arrange(true);
      invalidate("status");
    });
    return button;
  }));
  if (focused) [...el("benches").children].find((b) => b.dataset.bench === focused)?.focus();
}
