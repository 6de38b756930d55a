// The normal spectrum of a channel: mean and band of the spectra of a time that somebody has chosen from the log as the normal one.

import { invalidate, remember, remembered } from "./state.js";

const FEWEST = 5; // spectra; fewer say nothing of the scatter
const kept = new Map(); // bench/channel → { from, to, spectra, first_order, order_step, mean, sigma }; null while it is read

const keyOf = (row) => `${row.bench}/${row.channel}`;
// The times alone are kept by the browser; the spectra come from the log.
const times = () => {
  try {
    return JSON.parse(remembered("normal-spectra", "{}"));
  } catch {
    return {};
  }
};

// Mean and scatter of the logarithms of each line; lines of spectra with other steps are taken where their orders lie.
function summary(spectra) {
  const { first_order, order_step, amplitude } = spectra[0];
  const mean = new Float64Array(amplitude.length);
  const sigma = new Float64Array(amplitude.length);
  const at = (s, i) => s.amplitude[Math.round((first_order + i * order_step - s.first_order) / s.order_step)];
  for (let i = 0; i < mean.length; i++) {
    const levels = spectra.map((s) => at(s, i)).filter((a) => a > 0).map(Math.log10);
    if (levels.length < FEWEST) {
      mean[i] = sigma[i] = NaN;
      continue;
    }
    mean[i] = levels.reduce((a, b) => a + b, 0) / levels.length;
    sigma[i] = Math.sqrt(levels.reduce((a, b) => a + (b - mean[i]) ** 2, 0) / (levels.length - 1));
  }
  return { first_order, order_step, mean, sigma };
}

// The normal spectrum of a row's channel; read from the log where its time is known and it is not here yet.
export function normalOf(row) {
  const key = keyOf(row);
  if (!kept.has(key)) {
    kept.set(key, null);
    const time = times()[key];
    if (time) read(row, time.from, time.to);
  }
  return kept.get(key);
}

async function read(row, from, to) {
  const query = new URLSearchParams({ bench: row.bench, channel: row.channel, from, to });
  const reply = await fetch(`/api/spectra?${query}`).catch(() => null);
  if (reply?.ok) take(row, from, to, (await reply.json()).spectra);
}

function take(row, from, to, spectra) {
  if (spectra.length < FEWEST) return false;
  kept.set(keyOf(row), { from, to, spectra: spectra.length, ...summary(spectra) });
  invalidate("spectrum");
  return true;
}

// Takes these spectra as the normal ones from now on; `from` and `to` as the log was asked. False where they are too few.
export function setNormal(row, from, to, spectra) {
  if (!take(row, from, to, spectra)) return false;
  remember("normal-spectra", JSON.stringify({ ...times(), [keyOf(row)]: { from, to } }));
  return true;
}

export function forgetNormal(row) {
  kept.set(keyOf(row), null);
  const rest = times();
  delete rest[keyOf(row)];
  remember("normal-spectra", JSON.stringify(rest));
  invalidate("spectrum");
}

// Two sigmas on each side of the mean at these orders, nulls where nothing is known.
export function bandOf(normal, orders, floor) {
  if (!normal) {
    const none = orders.map(() => null);
    return { high: none, low: none };
  }
  const side = (sign) => orders.map((order) => {
    const i = Math.round((order - normal.first_order) / normal.order_step);
    const level = normal.mean[i] + sign * 2 * normal.sigma[i];
    return Number.isFinite(level) ? Math.max(floor, 10 ** level) : null;
  });
  return { high: side(1), low: side(-1) };
}
