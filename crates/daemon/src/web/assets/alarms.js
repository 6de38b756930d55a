// Alarms that hold or that nobody has seen, by bench and stage: one fault shows at several channels, and is one entry with its evidence.

import { el, known, node, plain, remember, remembered, rows, view } from "./state.js";
import { iso } from "./time.js";
import { select } from "./strips.js";

let told = "";

// Draws them, and says how many nobody has seen.
export function drawAlarms(benches) {
  const groups = new Map();
  for (const bench of benches) {
    for (const alarm of bench.alarms) {
      const key = `${bench.name}\n${alarm.stage}`;
      if (!groups.has(key)) groups.set(key, { bench: bench.name, stage: alarm.stage, alarms: [] });
      groups.get(key).alarms.push(alarm);
    }
  }
  const all = [...groups.values()];
  const open = all.flatMap((g) => g.alarms).filter((a) => !a.acknowledged).length;
  const now = JSON.stringify(all);
  // Anew only where something changed: a table that is made anew takes the focus from its buttons.
  if (now === told) return open;
  told = now;
  const grave = (g) => [g.alarms.some((a) => !a.acknowledged), g.alarms.some((a) => a.what === "critical"), g.alarms.length].map(Number);
  all.sort((a, b) => {
    const [x, y] = [grave(a), grave(b)];
    const k = x.findIndex((v, i) => v !== y[i]);
    return k < 0 ? 0 : y[k] - x[k];
  });
  el("alarms").hidden = all.length === 0;
  el("no-alarms").hidden = all.length > 0;
  el("alarm-count").textContent = all.length ? `${open} not acknowledged` : "";
  el("alarm-panel").dataset.state = open ? "open" : "quiet";
  el("alarm-groups").replaceChildren(...all.map((g) => group(g, benches.length > 1)));
  return open;
}

const signed = (x) => `${x > 0 ? "+" : x < 0 ? "−" : ""}${Math.abs(x).toFixed(1)}`;

function group(g, several) {
  const severe = g.alarms.some((a) => a.what === "critical") ? "critical" : "warning";
  const name = `${several ? `${g.bench} · ` : ""}${g.stage}`;
  const open = g.alarms.filter((a) => !a.acknowledged);
  const since = Math.min(...g.alarms.map((a) => a.since_ns));
  const head = node("div", { class: "title" }, node("h3", {}, node("span", { class: "badge", "data-severity": severe }, severe === "critical" ? "▲ critical" : "△ warning"), ` ${name} `, node("small", {}, `${g.alarms.length} channel${g.alarms.length > 1 ? "s" : ""}, since ${iso(since)}`)));
  if (open.length) {
    const button = node("button", { type: "button", class: "acknowledge" }, open.length > 1 ? `Acknowledge ${open.length}` : "Acknowledge");
    button.setAttribute("aria-label", `${button.textContent} on ${name}`);
    button.addEventListener("click", () => ask(open, name));
    head.append(button);
  }
  const table = node("table", {}, node("caption", { class: "visually-hidden" }, `Alarms of ${name}`),
    node("thead", {}, node("tr", {}, ...["Channel", "Severity", "Harmonic", "Value", "Limit", "Operating point", "Since", "State", "Acknowledged"].map((h) => node("th", { scope: "col" }, h)))),
    node("tbody", {}, ...g.alarms.map((a) => entry(a, g))));
  return node("section", { class: "alarm-group", "data-severity": severe, "aria-label": `Alarms of ${name}` }, head, node("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": `Table of alarms of ${name}` }, table));
}

function entry(a, g) {
  const e = a.evidence;
  const show = node("button", { type: "button", class: "link" }, a.channel || a.place);
  show.setAttribute("aria-label", `${a.channel}: show ${g.stage}`);
  show.addEventListener("click", () => {
    const row = rows.get(`${g.bench}/${a.stage}/${a.channel}`);
    if (!row) return;
    if (e) view.harmonic = e.harmonic;
    select(row);
    el("h-detail").scrollIntoView({ block: "start" });
  });
  const point = e ? [known(e.input_speed_hz) ? `${e.input_speed_hz.toFixed(2)} Hz` : "", known(e.brake_torque_nm) ? `${e.brake_torque_nm.toFixed(1)} N m` : ""].filter(Boolean).join(", ") : "";
  const seen = a.seen ? `${a.seen.who}, ${iso(a.seen.t_ns)}: ${a.seen.why}` : a.acknowledged ? "yes" : "no";
  return node("tr", {}, node("th", { scope: "row" }, show), node("td", {}, a.what), node("td", {}, e ? `${e.harmonic}x, rank ${e.rank}` : "–"),
    node("td", {}, e ? `${signed(e.deviation_percent)} ± ${e.deviation_sigma_percent.toFixed(1)} %` : "–"), node("td", {}, e && known(e.limit_percent) ? `± ${e.limit_percent} %` : "–"),
    node("td", {}, point || "–"), node("td", {}, iso(a.since_ns)), node("td", {}, plain(a.state)), node("td", { class: "seen" }, seen));
}

// Who has seen alarms, and why they may be acknowledged: both stand in the log.
function ask(alarms, place) {
  const who = node("input", { type: "text", name: "who", maxlength: "100", autocomplete: "name" });
  who.value = remembered("who", "");
  const why = node("input", { type: "text", name: "why", maxlength: "1000" });
  const said = node("p", { role: "status" });
  const send = node("button", { type: "button", class: "send" }, "Acknowledge");
  const leave = node("button", { type: "button" }, "Cancel");
  const what = `${alarms.length === 1 ? alarms[0].what : `${alarms.length} alarms`} on ${place}`;
  const dialog = node("dialog", { id: "acknowledge", "aria-label": `Acknowledge ${what}` },
    node("p", {}, `${what}: ${alarms.map((a) => a.channel || a.place).join(", ")}`), node("label", {}, "Your name ", who), node("label", {}, "Comment ", why), said, node("div", { class: "buttons" }, send, leave));
  dialog.addEventListener("close", () => dialog.remove());
  leave.addEventListener("click", () => dialog.close());
  send.addEventListener("click", async () => {
    if (!who.value.trim() || !why.value.trim()) {
      said.textContent = "Name and comment are needed.";
      return;
    }
    const body = JSON.stringify({ who: who.value, why: why.value });
    const post = (a) => fetch(`/api/alarms/${encodeURIComponent(a.id)}/acknowledge`, { method: "POST", headers: { "content-type": "application/json" }, body }).catch(() => null);
    const replies = await Promise.all(alarms.map(post));
    if (replies.some((reply) => !reply)) said.textContent = "The service does not answer.";
    // One that has ended meanwhile needs nobody to see it.
    else if (replies.every((reply) => reply.ok || reply.status === 404) && replies.some((reply) => reply.ok)) {
      remember("who", who.value);
      dialog.close();
    } else said.textContent = "There is no such alarm any more.";
  });
  document.body.append(dialog);
  dialog.showModal();
  (who.value ? why : who).focus();
}
