// Alarms that hold or that nobody has seen, by bench and stage: one fault shows at several channels, and is one entry with its evidence.

import { el, known, node, plain, remember, remembered, rows, view } from "./state.js";
import { iso } from "./time.js";
import { select } from "./strips.js";

const MAINTENANCE = "maintenance"; // stage of the entry that stands while somebody works at a bench
// For how long an acknowledgement holds: [minutes, words].
const SHELVES = [["", "until it ends"], ["60", "1 hour"], ["480", "8 hours"], ["1440", "1 day"], ["10080", "1 week"]];
let told = "";

// Draws them as the service has put them together, and says how many nobody has seen.
export function drawAlarms({ benches, faults }) {
  const byId = new Map(benches.flatMap((b) => b.alarms.map((a) => [a.id, a])));
  const all = faults.map((f) => ({ ...f, alarms: f.ids.map((id) => byId.get(id)).filter(Boolean) }));
  const open = all.reduce((count, f) => count + f.open.length, 0);
  const now = JSON.stringify(all);
  // Anew only where something changed: a table that is made anew takes the focus from its buttons.
  if (now === told) return open;
  told = now;
  el("alarms").hidden = all.length === 0;
  el("no-alarms").hidden = all.length > 0;
  el("alarm-count").textContent = all.length ? `${open} not acknowledged` : "";
  el("alarm-panel").dataset.state = open ? "open" : "quiet";
  el("alarm-groups").replaceChildren(...all.map((g) => group(g, benches.length > 1)));
  return open;
}

const signed = (x) => `${x > 0 ? "+" : x < 0 ? "−" : ""}${Math.abs(x).toFixed(1)}`;

function group(g, several) {
  const severe = g.severity;
  const name = `${several ? `${g.bench} · ` : ""}${g.stage}`;
  const open = g.alarms.filter((a) => !a.acknowledged);
  if (g.stage === MAINTENANCE) return maintained(g, several);
  const head = node("div", { class: "title" }, node("h3", {}, node("span", { class: "badge", "data-severity": severe }, severe === "critical" ? "▲ critical" : "△ warning"), ` ${name} `, node("small", {}, `${g.alarms.length} channel${g.alarms.length > 1 ? "s" : ""}, since ${iso(g.since_ns)}`)));
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

// A bench at which somebody works.
function maintained(g, several) {
  const [a] = g.alarms;
  const end = node("button", { type: "button" }, "End maintenance");
  end.setAttribute("aria-label", `End maintenance of ${g.bench}`);
  end.addEventListener("click", () => post(a.id, a.seen?.who || "page", "maintenance is over", "0"));
  const words = a.seen ? `until ${iso(a.seen.until_ns)}: ${a.seen.who}, ${iso(a.seen.t_ns)}: ${a.seen.why}` : "";
  const head = node("div", { class: "title" }, node("h3", {}, `⚒ ${several ? `${g.bench} · ` : ""}maintenance `, node("small", {}, `no alarm is raised ${words}`)), end);
  return node("section", { class: "alarm-group", "data-severity": "quiet", "aria-label": `Maintenance of ${g.bench}` }, head);
}

function post(id, who, why, minutes) {
  const body = JSON.stringify({ who, why, ...(minutes === "" ? {} : { minutes: Number(minutes) }) });
  return fetch(`/api/alarms/${encodeURIComponent(id)}/acknowledge`, { method: "POST", headers: { "content-type": "application/json" }, body }).catch(() => null);
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
  const seen = a.seen ? `${a.seen.until_ns ? `${a.stage === MAINTENANCE ? "" : "shelved "}until ${iso(a.seen.until_ns)}: ` : ""}${a.seen.who}, ${iso(a.seen.t_ns)}: ${a.seen.why}` : a.acknowledged ? "yes" : "no";
  return node("tr", {}, node("th", { scope: "row" }, show), node("td", {}, a.what), node("td", {}, e ? `${e.harmonic}x, rank ${e.rank}` : "–"),
    node("td", {}, e ? `${signed(e.deviation_percent)} ± ${e.deviation_sigma_percent.toFixed(1)} %` : "–"), node("td", {}, e && known(e.limit_percent) ? `± ${e.limit_percent} %` : "–"),
    node("td", {}, point || "–"), node("td", {}, iso(a.since_ns)), node("td", {}, plain(a.state)), node("td", { class: "seen" }, seen));
}

// Who has seen alarms, and why they may be acknowledged: both stand in the log. `until`: for how long it holds, [minutes, words] each.
function ask(alarms, place, act = "Acknowledge", until = SHELVES) {
  const who = node("input", { type: "text", name: "who", maxlength: "100", autocomplete: "name" });
  who.value = remembered("who", "");
  const why = node("input", { type: "text", name: "why", maxlength: "1000" });
  const minutes = node("select", { name: "minutes" }, ...until.map(([value, words]) => node("option", { value }, words)));
  const said = node("p", { role: "status" });
  const send = node("button", { type: "button", class: "send" }, act);
  const leave = node("button", { type: "button" }, "Cancel");
  const what = `${alarms.length === 1 ? alarms[0].what : `${alarms.length} alarms`} on ${place}`;
  const dialog = node("dialog", { id: "acknowledge", "aria-label": `${act} ${what}` },
    node("p", {}, `${what}: ${alarms.map((a) => a.channel || a.place).join(", ")}`), node("label", {}, "Your name ", who), node("label", {}, "Comment ", why), node("label", {}, "Holds ", minutes), said, node("div", { class: "buttons" }, send, leave));
  dialog.addEventListener("close", () => dialog.remove());
  leave.addEventListener("click", () => dialog.close());
  send.addEventListener("click", async () => {
    if (!who.value.trim() || !why.value.trim()) {
      said.textContent = "Name and comment are needed.";
      return;
    }
    const replies = await Promise.all(alarms.map((a) => post(a.id, who.value, why.value, minutes.value)));
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

// Somebody works at the bench that is shown: no alarm is raised meanwhile.
el("maintenance").addEventListener("click", () => {
  const name = view.bench || view.selected?.bench || view.status?.benches?.[0]?.name;
  if (name) ask([{ id: `${name}/${MAINTENANCE}`, what: MAINTENANCE, place: "no alarm is raised meanwhile" }], name, "Begin maintenance", SHELVES.slice(1));
});

/* ---- what became of alarms, from the log ---- */

const POLL_MS = 700;
const EVENT = { raised: "raised", ended: "ended", acknowledged: "acknowledged" };
let timer = 0;

async function recall() {
  clearTimeout(timer);
  if (!el("past-alarms").open) return;
  const to = Date.now();
  const query = new URLSearchParams({ from: `${to - Number(el("past-span").value) * 86400000}000000`, to: `${to}000000` });
  const reply = await fetch(`/api/alarms?${query}`).catch(() => null);
  if (!reply?.ok) {
    el("past-state").textContent = reply ? (await reply.text()).trim() : "The service does not answer.";
    return;
  }
  const { alarms, to_read } = await reply.json();
  el("past-state").textContent = to_read ? `${to_read} files are still to be read.` : `${alarms.length} entries.`;
  el("past-table").tBodies[0].replaceChildren(...alarms.reverse().map(({ t_ns, alarm: a }) => {
    const e = a.evidence;
    const what = a.event === "acknowledged" && a.seen?.until_ns ? `shelved until ${iso(a.seen.until_ns)}` : EVENT[a.event] || a.event;
    const value = e ? `${e.harmonic}x ${signed(e.deviation_percent)} ± ${e.deviation_sigma_percent.toFixed(1)} %${known(e.limit_percent) ? `, limit ${e.limit_percent} %` : ""}` : "–";
    return node("tr", {}, node("th", { scope: "row" }, iso(t_ns)), node("td", {}, `${a.bench} · ${a.stage}${a.channel ? ` · ${a.channel}` : ""}`), node("td", {}, what), node("td", {}, a.severity), node("td", {}, value), node("td", {}, a.who ? `${a.who}: ${a.why}` : ""));
  }));
  if (to_read) timer = setTimeout(recall, POLL_MS);
}
el("past-alarms").addEventListener("toggle", recall);
el("past-span").addEventListener("change", recall);
