#!/usr/bin/env python3
"""Figures of speed beside peers, as the table of docs/performance.md: `just bench-table`, or `python3 tests/peers/table.py [--only PART]… [--rounds N]`.

Peers are Python packages of the interpreter that runs this file: numpy (needed), mcap, h5py, npTDMS, pyarrow, pyfftw, scipy, mkl_fft, matplotlib. One that is
not installed is named so in the table. In each round gearwatch and its peers are measured one after the other, and a ratio is that of one round; the table
states medians with the least and the largest of all rounds. Parts that are not asked for stay in the table as they were.
"""

import argparse
import datetime
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "peers"))
import readers  # noqa: E402
import scaling  # noqa: E402

PAGE = ROOT / "docs" / "performance.md"
FOLDER = ROOT / "target" / "bench-table"
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release"
BENCH = ROOT / "crates" / "sim" / "src" / "shipped" / "paper-rig.toml"
BEGIN, END = "<!-- table: written by tests/peers/table.py -->", "<!-- end of the table -->"
WINDOW = 16_384


def figures(*arguments):
    """One run of the example `figures`."""
    done = subprocess.run([str(TARGET / "examples" / "figures"), *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"figures {' '.join(map(str, arguments))}: {done.stdout}{done.stderr}")
    return json.loads(done.stdout)


def gearwatch(*arguments):
    """Seconds of one run of the program. Exit code 1 says that something was found."""
    began = time.perf_counter()
    done = subprocess.run([str(TARGET / "gearwatch"), *map(str, arguments)], capture_output=True, text=True)
    if done.returncode not in (0, 1):
        sys.exit(f"gearwatch {' '.join(map(str, arguments))}: {done.stderr}")
    return time.perf_counter() - began


def spread(values, digits=2):
    """Median with the least and the largest."""
    def text(value):
        return f"{value:.{digits}f}"
    return f"{text(statistics.median(values))} ({text(min(values))}–{text(max(values))})"


def row(what, found, beside, aim):
    return f"| {what} | {found} | {beside} | {aim} |"


def timed(work, repeats=1):
    """Seconds of the median of some runs, after one that does not count."""
    work()
    all_ = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        all_.append(time.perf_counter() - began)
    return statistics.median(all_)


def transforms():
    """The real transform of a window by name; a text in place of a function where a peer is not installed."""
    rng = np.random.default_rng(1)
    x = rng.standard_normal(WINDOW)
    found = {}
    try:
        import pyfftw
        plan = pyfftw.builders.rfft(pyfftw.byte_align(x.copy()), threads=1, planner_effort="FFTW_MEASURE")
        found["FFTW"] = plan
    except ImportError:
        found["FFTW"] = "pyfftw is not installed"
    try:
        import scipy.fft
        found["SciPy"] = lambda: scipy.fft.rfft(x, workers=1)
    except ImportError:
        found["SciPy"] = "scipy is not installed"
    try:
        import mkl_fft
        found["MKL"] = lambda: mkl_fft.rfft(x)
    except ImportError:
        found["MKL"] = "mkl_fft is not installed"
    return found


def part_row(rounds):
    peers = transforms()
    own, beside = [], {name: [] for name, work in peers.items() if callable(work)}
    for _ in range(rounds):
        own.append(figures("row"))
        for name in beside:
            beside[name].append(timed(peers[name], 200) / own[-1]["transform"])
    ratio = lambda over, under: [one[over] / one[under] for one in own]  # noqa: E731
    transform = "bare real transforms (realfft) of its windows of 16 384 samples"
    lines = [
        row("whole row of two stages, 50 % overlap, speed from mesh lines", f"{spread(ratio('mesh lines', 'bare'))} ×", transform, "≤ 2.0"),
        row("the same with a tacho", f"{spread(ratio('tacho', 'bare'))} ×", transform, "≤ 2.0"),
        row("a new sample at 90 % overlap", f"{spread(ratio('90 %', 'mesh lines'))} ×", "one at 50 %", "≤ 1.3"),
    ]
    for name, work in peers.items():
        found = f"{spread(beside[name])} × the time" if name in beside else work
        lines.append(row(f"one transform by {name}", found, "realfft", "–"))
    return lines


def record(name, seconds, *arguments):
    """A simulated recording, made once."""
    path = FOLDER / f"{name}.mcap"
    if not path.exists():
        gearwatch("simulate", BENCH, "--duration", seconds, "-o", path, *arguments)
    return path


def part_explain(rounds):
    sound, changed = [], []
    for k, speed in enumerate([20, 25, 30, 35], 1):
        state = ["--speed", speed, "--torque", 20 + 10 * k]
        sound.append(record(f"sound-{k}", 6, *state, "--seed", k))
        effect = ["--effect", "eccentricity@stage1.pinion:runout_um=30"]
        changed.append(record(f"changed-{k}", 6, *state, "--seed", 10 + k, *effect))
    reference = [word for path in sound for word in ("--reference", path)]
    found = [gearwatch("explain", BENCH, *changed, *reference) for _ in range(rounds)]
    return [row("`explain` of 4 recordings of 2 channels and 6 s against as many, a pinion with 30 µm of run-out", f"{spread(found)} s", "–", "≤ 3 s")]


def part_steady(rounds):
    own = [figures("steady") for _ in range(rounds)]
    count = own[0]["amplitudes"]
    line = lambda what, key, aim: row(f"{count} amplitudes of the two-stage train, {what}", f"{spread([1e3 * one[key] for one in own])} ms", "–", f"≤ {aim} ms")  # noqa: E731
    return [line("without any past", "cold", 0.8), line("from a neighbour with teeth 2 % stiffer", "neighbour", 0.2)]


def part_stepping(rounds):
    own = [figures("stepping") for _ in range(rounds)]
    def line(key, aim):
        beside = spread([one[key] / one["Runge–Kutta"] for one in own])
        return row(f"simulated seconds a second and core, {key}", spread([one[key] for one in own], 0), f"{beside} × Runge–Kutta of order 4, four steps a sample", f"≥ {aim}")
    return [line("one run", 600), line("eight lanes", 1500)]


def part_reading(rounds):
    made = readers.make(FOLDER, figures)
    lines = []
    # One core for all, so that no peer reads ahead on another.
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(cores)})
    for name, path, peer, work in made:
        own, ratios, peaks = [], [], []
        for _ in range(rounds):
            found = figures("reading", path)[str(path)]
            seconds = found["seconds"]
            own.append(found["samples"] / seconds / 1e6)
            peaks.append(found["peak"] or 0)
            if callable(work):
                ratios.append(timed(work) / seconds)
        beside = f"{spread(ratios)} × as fast as {peer}" if ratios else f"{peer} is not installed"
        memory = f", at most {max(peaks) / 1e6:.0f} MB of memory" if any(peaks) else ""
        lines.append(row(f"reading {name}, {path.stat().st_size / 1e6:.0f} MB, into blocks", f"{spread(own, 0)} million samples/s{memory}", beside, "≥ 1.5"))
    os.sched_setaffinity(0, cores)
    return lines


def part_batch(rounds):
    paths = [record(f"batch-{k}", 30, "--seed", k) for k in range(8)]
    out = FOLDER / "batch"
    a_second, ratios = [], []
    for _ in range(rounds):
        reading = sum(one["seconds"] for one in figures("reading", *paths).values())
        shutil.rmtree(out, ignore_errors=True)
        seconds = gearwatch("batch", *paths, "--bench", BENCH, "--out", out, "--jobs", 1)
        a_second.append(len(paths) / seconds)
        ratios.append(seconds / reading)
    return [row("`batch` of 8 recordings of 30 s and two channels: recordings a second and core", spread(a_second, 1), f"{spread(ratios)} × the time of reading them into blocks", "≤ 1.3")]


def part_scaling(rounds):
    return scaling.measure(rounds, figures, gearwatch, FOLDER, BENCH, ROOT / "docs" / "pictures" / "cost-against-size.svg")


PARTS = {
    "row": part_row, "explain": part_explain, "steady": part_steady, "stepping": part_stepping, "reading": part_reading, "batch": part_batch,
    "scaling": part_scaling,
}


def machine():
    """Commit, processor, cores and date."""
    git = lambda *words: subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True).stdout.strip()  # noqa: E731
    commit = git("rev-parse", "--short", "HEAD") + (" with changes" if git("status", "--porcelain", "--", "crates", "Cargo.toml") else "")
    text = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    name = re.search(r"model name\s*:\s*(.*)", text)
    processor = name.group(1) if name else "unknown processor"
    return f"commit {commit}, {processor}, {os.cpu_count()} cores, {datetime.date.today()}"


def block(part, lines, rounds, note):
    """A part as it stands in the page, between its marks."""
    beside = f", {note}" if note else ""
    head = [f"<!-- part: {part} -->", "", f"Measured at {machine()}; {rounds} {'round' if rounds == 1 else 'rounds'}{beside}.", ""]
    table = [] if lines[0].startswith("| against") else ["| what | gearwatch | beside | aim |", "|---|---|---|---|"]
    return "\n".join(head + table + lines) + "\n"


def write(found, rounds, note):
    """Puts the parts into the page; those that were not measured stay."""
    text = PAGE.read_text()
    front, rest = text.split(BEGIN)
    old, back = rest.split(END)
    parts = {re.match(r"<!-- part: (\w+) -->", part).group(1): part.strip() + "\n" for part in re.split(r"(?=<!-- part: )", old) if part.strip()}
    parts.update({part: block(part, lines, rounds, note) for part, lines in found.items()})
    inside = "\n".join(parts[part] for part in PARTS if part in parts)
    PAGE.write_text(f"{front}{BEGIN}\n\n{inside}\n{END}{back}")


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--only", action="append", choices=list(PARTS), help="measure this part only; repeat for several")
    options.add_argument("--rounds", type=int, default=5)
    options.add_argument("--built", action="store_true", help="take the programs as they are in target/release")
    options.add_argument("--note", default="", help="what else the machine did meanwhile, as it is to stand in the page")
    given = options.parse_args()
    if not given.built:
        build = ["cargo", "build", "--release", "-p", "gearwatch", "-p", "gearwatch-tests", "--features", "gearwatch/full"]
        subprocess.run([*build, "--bin", "gearwatch", "--example", "figures"], cwd=ROOT, check=True)
    FOLDER.mkdir(parents=True, exist_ok=True)
    for part in given.only or PARTS:
        print(f"{part} …", file=sys.stderr, flush=True)
        lines = PARTS[part](given.rounds)
        print("\n".join(lines), flush=True)
        write({part: lines}, given.rounds, given.note)


if __name__ == "__main__":
    main()
