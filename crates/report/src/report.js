// Lets a reader zoom into curves and read values. Without it, and on paper, the drawing that is in the page is all there is.
(() => {
  const INKS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#787878"];
  const axis = (label, more) => ({ label, labelSize: 20, stroke: "#55606c", grid: { stroke: "#e5e9ed" }, ticks: { stroke: "#e5e9ed" }, ...more });

  // All curves over one abscissa, ascending; nothing where a curve has no point.
  function together(series) {
    const all = [...new Set(series.flatMap((s) => s.x))].sort((a, b) => a - b);
    const place = new Map(all.map((x, i) => [x, i]));
    return [all, ...series.map((s) => {
      const out = new Array(all.length).fill(null);
      s.x.forEach((x, i) => { out[place.get(x)] = s.y[i]; });
      return out;
    })];
  }

  function open(figure, button) {
    const { x, y, log, series } = JSON.parse(figure.dataset.curves);
    const host = document.createElement("div");
    host.className = "curves";
    figure.querySelector(".picture").after(host);
    const data = together(series).map((column, i) => (i > 0 && log ? column.map((v) => (v > 0 ? v : null)) : column));
    new uPlot({
      width: Math.max(280, figure.clientWidth), height: 340,
      scales: { x: { time: false }, y: { distr: log ? 3 : 1 } },
      axes: [axis(x), axis(y, { size: 70, ...(log ? { values: (u, ticks) => ticks.map((t) => (t && Number.isInteger(Math.round(1e6 * Math.log10(t)) / 1e6) ? t.toExponential(0) : "")) } : {}) })],
      series: [{ label: x }, ...series.map((s, i) => ({ label: s.name || y, stroke: INKS[i % INKS.length], spanGaps: true }))],
      cursor: { drag: { x: true, y: false } },
    }, data, host);
    figure.classList.add("open");
    button.textContent = "Drawing";
    return host;
  }

  for (const figure of document.querySelectorAll("figure[data-curves]")) {
    let host = null;
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = "Zoom and values";
    button.title = "Drag to zoom, double click for all";
    button.addEventListener("click", () => {
      if (host) {
        host.remove();
        host = null;
        figure.classList.remove("open");
        button.textContent = "Zoom and values";
      } else host = open(figure, button);
    });
    figure.append(button);
  }
})();
