// The steps between ranks, and scales that do not move with each window.

import { RANKS, css } from "./state.js";

export const LIMITS = [1, 4, 7, 10, 13]; // lower ends of the ranks I to V (percent)

// Half of the height of a plot of deviations (percent): 16, 32, 64 … so that pictures can be compared, and no window changes the scale.
export function frame(largest) {
  let half = 16;
  while (half < largest && half < 1e6) half *= 2;
  return half;
}

// The limits as lines, both signs; far out only the last one, which would be all one line.
export function limitLines(half) {
  const shown = LIMITS.map((value, i) => ({ value, word: RANKS[i + 1], ink: css(`--r${i + 1}`) })).filter((l) => half < 40 || l.value === 13);
  return shown.flatMap((l) => [l, { ...l, value: -l.value, word: "" }]);
}
