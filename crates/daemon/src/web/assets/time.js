// Times as people write them in a log book: ISO 8601, 24 hours, with the zone.

const two = (n) => String(n).padStart(2, "0");

// The zone of this browser at a time, such as +01:00.
export function zone(date = new Date()) {
  const minutes = -date.getTimezoneOffset();
  return `${minutes < 0 ? "-" : "+"}${two(Math.floor(Math.abs(minutes) / 60))}:${two(Math.abs(minutes) % 60)}`;
}

const day = (d) => `${d.getFullYear()}-${two(d.getMonth() + 1)}-${two(d.getDate())}`;
const minute = (d) => `${two(d.getHours())}:${two(d.getMinutes())}`;

// 2026-11-22T23:12:05+01:00 of nanoseconds since the epoch.
export function iso(ns) {
  const d = new Date(ns / 1e6);
  return Number.isFinite(d.getTime()) ? `${day(d)}T${minute(d)}:${two(d.getSeconds())}${zone(d)}` : "–";
}

// Labels of a time axis (s since the epoch); a new day is written below the first tick that lies in it.
export function timeTicks(u, splits, axis, space, step) {
  let last = "";
  return splits.map((s) => {
    const d = new Date(1000 * s);
    if (step >= 86400) return day(d);
    const clock = step < 60 ? `${minute(d)}:${two(d.getSeconds())}` : minute(d);
    const today = day(d);
    const text = today === last ? clock : `${clock}\n${today}`;
    last = today;
    return text;
  });
}
