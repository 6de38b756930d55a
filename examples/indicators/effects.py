#!/usr/bin/env python3
"""At which size each effect of the simulator is first significant in each condition indicator: the table of docs/indicators.md.

    python3 effects.py [--gearwatch PROGRAM] [--bench FILE] [--only EFFECT …] > table.md

Twelve healthy recordings (fresh noise each) say how far every number scatters from recording to recording. Of each effect five sizes are
simulated, from an eighth of the typical one to twice it. A size counts where the number is beyond five of those standard deviations, at this size and
at all larger ones: with eleven degrees of freedom one number in 2500 is by chance. The first column is any mesh harmonic 1x to 5x, by its logarithm.
"""
import argparse
import csv
import json
import math
import os
import re
import statistics
import subprocess
import sys
import tempfile

HEALTHY = 12
BEYOND = 5.0
SHARES = [0.125, 0.25, 0.5, 1.0, 2.0]
SECONDS = 10
BACKGROUND = 0.02
COLUMNS = [
    ("rms", "rms"), ("peak", "peak"), ("crest_factor", "crest"), ("kurtosis", "kurt."), ("velocity_rms", "velocity"),
    ("fm0", "FM0"), ("fm4", "FM4"), ("m6a", "M6A"), ("m8a", "M8A"), ("energy_ratio", "ER"), ("residual_rms", "rms(r)"),
    ("residual_kurtosis", "NA4"), ("difference_rms", "rms(d)"), ("envelope_deviation", "sd(e)"), ("envelope_kurtosis", "NB4"),
    ("sideband_index", "SI"), ("sideband_ratio", "SR"),
]
# The parameter that says how large an effect is, where it is not the first.
SIZE = {"bearing_defect": "amplitude", "structural_resonance": "gain", "sensor_mounting": "gain", "speed_fluctuation": "depth_percent",
        "torque_ripple": "depth_percent", "electrical_pickup": "amplitude", "aliasing": "amplitude", "ghost_component": "amplitude_um",
        "pitting": "area_fraction"}
# Places of a bench of two stages, by the words of `gearwatch list`.
PLACES = {"STAGE.pinion": "stage1.pinion", "STAGE": "stage1", "SHAFT": "input", "SENSOR": "acc"}


def effects(program):
    """Id, first place, parameters with (low, high, typical) of each effect, from `gearwatch list effects`."""
    text = subprocess.run([program, "list", "effects"], check=True, capture_output=True, text=True).stdout
    out = []
    for line in text.splitlines():
        if m := re.match(r"  (\w+)\s+\S", line):
            out.append({"id": m[1], "parameters": {}})
        elif m := re.match(r"      where\s+(.*)", line):
            out[-1]["place"] = m[1].split(" or ")[0].split(",")[0].strip()
        elif m := re.match(r"      (\w+)\s+(\S+) to (\S+)(?: (.+))?, typically (\S+)", line):
            out[-1]["parameters"][m[1]] = (float(m[2]), float(m[3]), float(m[5]), (m[4] or "").rstrip(","))
    return out


def sizes(effect):
    name = SIZE.get(effect["id"], next(iter(effect["parameters"]), None))
    if name is None:
        return None, []
    low, high, typical, _ = effect["parameters"][name]
    if effect["id"] == "wrong_tooth_count":
        return name, [30.0]
    if effect["id"] == "clipping":
        # The signal's largest values are at 1.0: the lower the level, the larger the effect.
        return name, [1.0, 0.9, 0.8, 0.6, 0.4]
    if name == "factor":
        # A factor of 1 changes nothing: its powers are the sizes.
        typical = 0.5 if typical == 1.0 else typical
        values = [typical**share for share in SHARES]
    else:
        values = [typical * share for share in SHARES]
    return name, sorted({min(max(value, low), high) for value in values}, key=lambda v: abs(math.log(v)) if name == "factor" else abs(v))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--gearwatch", default="gearwatch")
    parser.add_argument("--bench", default=os.path.join(os.path.dirname(os.path.abspath(__file__)), "bench.toml"))
    parser.add_argument("--only", nargs="*")
    arguments = parser.parse_args()
    run = lambda *words, **keys: subprocess.run([arguments.gearwatch, *words], capture_output=True, text=True, **keys)
    with tempfile.TemporaryDirectory() as folder:
        simulate = lambda name, seed, *words: run("simulate", arguments.bench, "--duration", str(SECONDS), "--background", str(BACKGROUND),
                                                  "--seed", str(seed), "-o", os.path.join(folder, f"{name}.mcap"), *words)
        names, cases, refused = [], [], {}
        for seed in range(HEALTHY):
            simulate(f"healthy-{seed}", 100 + seed, ).check_returncode()
            names.append(f"healthy-{seed}")
        for effect in effects(arguments.gearwatch):
            if arguments.only and effect["id"] not in arguments.only:
                continue
            parameter, values = sizes(effect)
            place = PLACES.get(effect["place"], effect["place"].lower())
            for i, value in enumerate(values):
                name = f"{effect['id']}-{i}"
                done = simulate(name, 7 + i, "--effect", f"{effect['id']}@{place}:{parameter}={value!r}")
                if done.returncode == 0:
                    names.append(name)
                else:
                    refused[effect["id"]] = "the bench has no place for it" if "no place" in done.stderr else "not simulated"
            cases.append((effect["id"], place, parameter, values))
            print(effect["id"], file=sys.stderr)
        files = [os.path.join(folder, f"{name}.mcap") for name in names]
        table = {}
        text = run("indicators", arguments.bench, *files, "--csv").stdout
        for row in csv.DictReader(text.splitlines()):
            if row["value"]:
                table.setdefault(row["recording"][:-5], {})[row["place"], row["indicator"]] = float(row["value"])
        for line in run("diagnose", *files, "--bench", arguments.bench, "-f", "json").stdout.splitlines():
            row = json.loads(line)
            for h in range(1, 6):
                if (row.get(f"amp_{h}x") or 0) > 3 * (row.get(f"floor_{h}x") or math.inf):
                    key = row["stage"], f"{h}x"
                    table.setdefault(os.path.basename(row["recording"])[:-5], {})[key] = math.log(row[f"amp_{h}x"])
        healthy = [table[f"healthy-{seed}"] for seed in range(HEALTHY)]
        normal = {}
        for key in healthy[0]:
            values = [h[key] for h in healthy if key in h]
            if len(values) == HEALTHY and statistics.stdev(values) > 0:
                normal[key] = statistics.mean(values), statistics.stdev(values) * math.sqrt(1 + 1 / HEALTHY)

        def beyond(name, wanted):
            found = table.get(name, {})
            return any(wanted(key) and abs(found[key] - normal[key][0]) > BEYOND * normal[key][1] for key in found if key in normal)

        heads = ["1x–5x"] + [head for _, head in COLUMNS]
        print("| effect | size | " + " | ".join(heads) + " |")
        print("|---|---|" + "---|" * len(heads))
        for effect, place, parameter, values in cases:
            there = [(i, v) for i, v in enumerate(values) if f"{effect}-{i}" in table]
            cells = []
            for wanted in [lambda key: key[1] in ("1x", "2x", "3x", "4x", "5x")] + [lambda key, n=n: key[1] == n for n, _ in COLUMNS]:
                first = ""
                for i, value in reversed(there):
                    if not beyond(f"{effect}-{i}", wanted):
                        break
                    first = f"{value:.3g}"
                cells.append(first)
            shown = f"{there[0][1]:.3g} … {there[-1][1]:.3g}" if there else refused.get(effect, "no window is used: the instrument state is not ok")
            print(f"| {effect}@{place} | {parameter} {shown} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
