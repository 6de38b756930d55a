"""What a second of signals costs against the size of the task, with slopes on logarithmic axes, as text and as a picture."""

import math
import shutil
import statistics

SIZES = {
    "channels": [1, 4, 16, 64, 256],
    "rate": [1024, 2048, 4096, 8192, 16_384, 32_768, 65_536, 131_072, 204_800],
    "window": [0.25, 0.5, 1, 2, 4, 8],
    "overlap": [1, 2, 4, 10, 20],
    "stages": [1, 2, 3, 4],
    "recordings": [1, 10, 100, 1000],
}
NAMES = {
    "channels": "channels (16 384 Hz)", "rate": "sample rate (Hz)", "window": "window length (s)", "overlap": "windows a second (of 1 s)",
    "stages": "stages", "recordings": "recordings of 2 s (`batch`)",
}


def slope(sizes, costs):
    """Least squares through the logarithms."""
    x, y = [math.log(size) for size in sizes], [math.log(cost) for cost in costs]
    mean_x, mean_y = statistics.mean(x), statistics.mean(y)
    return sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y)) / sum((a - mean_x) ** 2 for a in x)


def recordings(count, gearwatch, folder, bench):
    """Seconds of `batch` for so many recordings; each has bytes of its own, as `batch` passes over what it has seen."""
    source = folder / "recordings"
    source.mkdir(exist_ok=True)
    for k in range(count):
        path = source / f"{k:04}.mcap"
        if not path.exists():
            gearwatch("simulate", bench, "--duration", 2, "--seed", k, "-o", path)
    out = folder / "scaling"
    shutil.rmtree(out, ignore_errors=True)
    return gearwatch("batch", *[source / f"{k:04}.mcap" for k in range(count)], "--bench", bench, "--out", out, "--jobs", 1)


def measure(rounds, figures, gearwatch, folder, bench, picture):
    """Lines of the table: median costs by size, and the slope."""
    lines = ["| against | sizes | median cost | slope |", "|---|---|---|---|"]
    found = {}
    for kind, sizes in SIZES.items():
        costs = []
        for size in sizes:
            if kind == "recordings":
                some = [recordings(size, gearwatch, folder, bench) for _ in range(min(rounds, 3))]
            else:
                some = [figures("scaling", kind, size)["seconds"] for _ in range(min(rounds, 3))]
            costs.append(statistics.median(some))
        found[kind] = (sizes, costs, slope(sizes, costs))
        unit, factor = ("s", 1) if kind == "recordings" else ("ms a second of signals", 1e3)
        figures_text = " · ".join(f"{factor * cost:.3g}" for cost in costs)
        lines.append(f"| {NAMES[kind]} | {' · '.join(f'{size:g}' for size in sizes)} | {figures_text} {unit} | {found[kind][2]:.2f} |")
    lines += ["", draw(found, picture)]
    return lines


def draw(found, path):
    try:
        import matplotlib
    except ImportError:
        return "The picture was not drawn: matplotlib is not installed."
    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "gearwatch"
    import matplotlib.pyplot as plt
    figure, axes = plt.subplots(2, 3, figsize=(11, 6.5), constrained_layout=True)
    for axis, (kind, (sizes, costs, steep)) in zip(axes.flat, found.items()):
        costs = costs if kind == "recordings" else [1e3 * cost for cost in costs]
        axis.loglog(sizes, costs, "o-", color="#1f5f8b", label=f"slope {steep:.2f}")
        axis.set_xlabel(NAMES[kind].replace("`", ""))
        axis.set_ylabel("s" if kind == "recordings" else "ms a second of signals")
        axis.grid(True, which="both", alpha=0.25)
        axis.legend(frameon=False)
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
    return "![Cost against size, with slopes](pictures/cost-against-size.svg)"
