// What all line plots share.

import { css } from "./state.js";

const HEIGHT = 240;

export function axis(label) {
  return { label, labelSize: 20, stroke: css("--soft"), grid: { stroke: css("--line"), width: 1 }, ticks: { stroke: css("--line") }, font: "12px system-ui", labelFont: "12px system-ui" };
}

// The plot of before, at the width that the page now has; a new one where what it shows or the theme is another.
export function sized(host, make, plot, shape) {
  const width = Math.max(200, host.clientWidth);
  const theme = document.documentElement.dataset.theme;
  if (plot && plot.shape === shape && plot.theme === theme) {
    if (plot.u.width !== width) plot.u.setSize({ width, height: HEIGHT });
    return plot;
  }
  if (plot) plot.u.destroy();
  return { u: make(width), shape, theme };
}
