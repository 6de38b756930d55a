"""Condition indicators by NumPy and SciPy: run `python3 reference.py > reference.json`.

An implementation of the definitions in crates/core/src/indicators that shares nothing with the Rust one: the times of the points are solved for by bisection,
the interpolation sums the kernel itself and no table, residual and difference signals are what is left when fitted cosines are subtracted (no
inverse transform of a masked spectrum), the envelope is that of scipy.signal.hilbert's kind made by hand from full spectra, medians and moments are
NumPy's.

Signals: `made` are sums of cosines over the shaft angle with bursts and a noise from a sine, given by numbers in the JSON file, so that the Rust test makes
the same ones. `recorded` are windows of the SpectraQuest recordings, read from ../shared of the workspace where they are there (else left out of the
file). `simulated` are the columns of simulated.csv.gz.
"""
import csv
import gzip
import json
import math
import os
import sys

import numpy as np
import scipy
from scipy import special

HERE = os.path.dirname(os.path.abspath(__file__))
SHARED = os.path.join(HERE, "../../../../../shared/data/gfd_spectraquest")
SHARE = 0.3


def signal(case):
    """The signal of a made case."""
    n, rate = case["samples"], case["sample_rate_hz"]
    theta = angle(case, np.arange(n))
    x = np.full(n, case["offset"])
    for order, amplitude, phase in case["tones"]:
        x += amplitude * np.cos(2 * np.pi * order * theta + phase)
    for order, height, width, carrier in case["bursts"]:
        turn = np.mod(order * theta, 1.0)
        x += height * np.exp(-turn / width) * np.sin(2 * np.pi * carrier * turn)
    i = np.arange(n)
    s = np.sin(i * 0.7548776662 + 0.1) * 43758.5453
    x += case["noise"] * (s - np.trunc(s))
    return x


def angle(case, position):
    """Angle of the input shaft (rev) at positions in samples, zero in the middle."""
    tau = np.asarray(position, float) / case["samples"] - 0.5
    return sum(c * tau ** (k + 1) for k, c in enumerate(case["angle"]))


def position(case, target):
    low, high = np.zeros_like(target), np.full_like(target, case["samples"] - 1.0)
    for _ in range(80):
        middle = 0.5 * (low + high)
        below = angle(case, middle) < target
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


def interpolated(x, at):
    whole = np.floor(at).astype(int)
    total, weight = np.zeros_like(at), np.zeros_like(at)
    for k in range(-3, 5):
        u = at - (whole + k)
        inside = np.clip(1 - (u / 4) ** 2, 0, None)
        h = np.sinc(u) * special.i0(5.0 * np.sqrt(inside)) / special.i0(5.0) * (np.abs(u) < 4)
        total += h * x[whole + k]
        weight += h
    return total / weight


def cost(points):
    whole, left, total, factor = points, points, 0, 2
    while left > 1:
        while left % factor == 0:
            total += factor
            left //= factor
        factor += 1
    return whole * total


def points_of(orders, n, revolutions):
    """Reference shaft, points per revolution and (shaft, points) for each copy of the window; `orders` are pairs of integers."""
    out, i = [], 0
    while i < len(orders):
        turns = revolutions * orders[i][0] / orders[i][1]
        if turns < 2:
            i += 1
            continue
        per_turn = n / turns
        p0, q0 = orders[i]
        base, members, reference = 1, [(i, 1, 1)], i
        i += 1
        while i < len(orders) and revolutions * orders[i][0] / orders[i][1] >= 2:
            p, q = orders[i][0] * q0, orders[i][1] * p0
            p, q = p // math.gcd(p, q), q // math.gcd(p, q)
            both = math.lcm(base, p)
            if both > 1.25 * per_turn or max(1, math.ceil(0.8 * per_turn / both)) * both > 1.25 * per_turn:
                break
            base = both
            members.append((i, p, q))
            i += 1
        first = max(1, math.ceil(0.8 * per_turn / base)) * base
        choices = [first] + list(range(first + base, int(per_turn) + 1, base))
        best = min(choices, key=lambda m: (sum(cost(m // p * q) for _, p, q in members), m))
        out.append((reference, best, [(s, best // p * q) for s, p, q in members]))
    return out


def orders_of(teeth):
    out = [(1, 1)]
    for pinion, wheel in teeth:
        p, q = out[-1][0] * pinion, out[-1][1] * wheel
        out.append((p // math.gcd(p, q), q // math.gcd(p, q)))
    return out


def normalised(x, power, variance):
    """<x^2p> / <x^2>^p and its sigma, by the slope at each point."""
    n = len(x)
    m2 = np.mean(x**2)
    m = np.mean(x ** (2 * power))
    value = m / m2**power
    slope = 2 * power / n * (x ** (2 * power - 1) / m2**power - m * x / m2 ** (power + 1))
    return [value, math.sqrt(variance * np.sum(slope**2))]


def without(y, lines):
    """The average without its mean and without cosines and sines of these orders, each fitted by projection."""
    n = len(y)
    phase = 2 * np.pi * np.arange(n) / n
    left = y - np.mean(y)
    for k in lines:
        c, s = np.cos(k * phase), np.sin(k * phase)
        left = left - 2 / n * (np.dot(y, c) * c + np.dot(y, s) * s)
    return left


def gear_indicators(y, variance, teeth_here, z, highest):
    n = len(y)
    phase = 2 * np.pi * np.arange(n) / n
    line = lambda k: np.dot(y, np.exp(-1j * k * phase))
    amplitude = lambda k: 2 * abs(line(k)) / n
    noise = 2 * variance / n
    beyond = range(highest + 1, n // 2 + 1)
    total = y - np.mean(y)
    if len(beyond):
        # Above the usable band, by the transform: thousands of lines.
        spectrum = np.fft.rfft(total)
        spectrum[highest + 1 :] = 0
        total = np.fft.irfft(spectrum, n)
    mesh = sorted({h * t for t in teeth_here for h in range(1, highest // t + 1)})
    near = lambda side: sorted({k for t in teeth_here for h in range(1, (highest + side) // t + 1)
                                for k in range(h * t - side, h * t + side + 1) if k <= highest} | {1, 2})
    r = without(total, near(0))
    d = without(total, near(1))
    regular = np.mean((total - d) ** 2)
    rms = lambda x: [math.sqrt(np.mean(x**2)), math.sqrt(variance / n)]
    out = {
        "residual_rms": rms(r),
        "residual_kurtosis": normalised(r, 2, variance),
        "difference_rms": rms(d),
        "fm4": normalised(d, 2, variance),
        "m6a": normalised(d, 3, variance),
        "m8a": normalised(d, 4, variance),
    }
    ratio = math.sqrt(np.mean(d**2) / regular)
    out["energy_ratio"] = [ratio, ratio * math.sqrt(variance / n * (1 / np.mean(d**2) + 1 / regular))]
    harmonics = highest // z
    sum_mesh = sum(amplitude(h * z) for h in range(1, harmonics + 1))
    fm0 = np.ptp(y) / sum_mesh
    out["fm0"] = [fm0, math.sqrt(2 * variance + fm0**2 * noise * harmonics) / sum_mesh]
    out["sideband_index"] = [0.5 * (amplitude(z - 1) + amplitude(z + 1)), math.sqrt(noise / 2)]
    if z > 6 and z + 6 <= highest:
        sr = sum(amplitude(z - k) + amplitude(z + k) for k in range(1, 7)) / amplitude(z)
        out["sideband_ratio"] = [sr, math.sqrt(noise * (12 + sr**2)) / amplitude(z)]
    half = (z - 1) // 2
    if z + half <= highest:
        length = 1 << (4 * (2 * half + 1) - 1).bit_length()
        t = 2 * np.pi * np.arange(length) / length
        e = abs(sum(2 / n * line(z + k) * np.exp(1j * k * t) for k in range(-half, half + 1)))
        e = e - np.mean(e)
        band = 2 * variance * length / n
        out["envelope_deviation"] = [math.sqrt(np.mean(e**2)), math.sqrt(band / length)]
        out["envelope_kurtosis"] = normalised(e, 2, band)
    return out


def channel_indicators(x, rate, unit):
    n = len(x)
    c = x - np.mean(x)
    edges = [b * (n // 16) for b in range(16)] + [n]
    rest = lambda b: np.delete(c, np.arange(edges[b], edges[b + 1]))
    jack = lambda f: math.sqrt(15 * np.var([f(rest(b)) for b in range(16)]))
    rms = lambda c: math.sqrt(np.mean(c**2))
    kurtosis = lambda c: np.mean(c**4) / np.mean(c**2) ** 2
    peaks = [np.max(np.abs(c[edges[b] : edges[b + 1]])) for b in range(16)]
    peak = [np.max(np.abs(c)), np.std(peaks, ddof=1)]
    out = {"rms": [rms(c), jack(rms)], "peak": peak, "kurtosis": [kurtosis(c), jack(kurtosis)]}
    crest = peak[0] / out["rms"][0]
    out["crest_factor"] = [crest, crest * math.hypot(peak[1] / peak[0], out["rms"][1] / out["rms"][0])]
    factor = {"m/s^2": 1e3, "g": 9806.65, "mm/s": 1.0}.get(unit)
    if factor and 0.45 * rate >= 1000:
        beta = math.pi * math.sqrt(1.4**2 - 1)
        w = special.i0(beta * np.sqrt(np.clip(1 - 4 * (np.arange(n) / n - 0.5) ** 2, 0, None))) / special.i0(beta)
        f = np.fft.rfftfreq(n, 1 / rate)
        power = np.abs(np.fft.rfft(w * x)) ** 2
        weight = 2 * factor**2 / (n * np.sum(w**2)) * (np.ones(len(f)) if unit == "mm/s" else 1 / (2 * np.pi * np.maximum(f, 1e-9)) ** 2)
        square = variance = 0.0
        for band in range(8):
            low, high = 10 * 100 ** (band / 8), 10 * 100 ** ((band + 1) / 8)
            here = (f >= low) & ((f < high) if band < 7 else (f <= high))
            p = power[here]
            q = np.sort(p)[len(p) // 2] / math.log(2)
            square += np.sum(weight[here] * p)
            b = n * np.sum(w**2) / np.sum(w) ** 2
            variance += b * np.sum(weight[here] ** 2 * np.clip(2 * p * q - np.minimum(p, q) ** 2, 0, None))
        out["velocity_rms"] = [math.sqrt(square), 0.5 * math.sqrt(variance / square)]
    return out


def envelope(case, x):
    """Depth of modulation of the squared envelope of a band at orders, by scipy.signal.hilbert of a band cut from the full transform."""
    from scipy import signal as dsp

    n, rate = len(x), case["sample_rate_hz"]
    low, high = case["envelope"]["band_hz"]
    f = np.fft.rfftfreq(n, 1 / rate)
    spectrum = np.fft.rfft(x)
    spectrum[(f < low) | (f >= high)] = 0
    spacing = rate / n
    lines = math.ceil(high / spacing) - math.ceil(low / spacing)
    length = 1 << (2 * lines - 1).bit_length()
    # The band-limited square, at the coarse times, is an exact sum of the analytic signal's lines.
    analytic = dsp.hilbert(np.fft.irfft(spectrum, n))
    fine = np.fft.fft(analytic) / n
    keep = np.nonzero(np.abs(fine) > 0)[0]
    keep = keep[(keep >= math.ceil(low / spacing)) & (keep < math.ceil(high / spacing))]
    t = np.arange(length) * n / length
    square = np.abs(np.exp(2j * np.pi * np.outer(t, keep) / n) @ fine[keep]) ** 2
    s = square / np.mean(square) - 1
    w = np.hanning(length + 1)[:-1]
    theta = angle(case, t)
    revolutions = float(angle(case, n) - angle(case, 0))
    power = lambda o: (2 / np.sum(w) * abs(np.sum(w * s * np.exp(-2j * np.pi * o * theta)))) ** 2
    out = []
    for order in case["envelope"]["orders"]:
        beside = [power(order + k / revolutions) for m in range(3, 9) for k in (-m, m) if order * revolutions + k > 1]
        floor = math.sqrt(np.median(beside) / math.log(2))
        out.append([math.sqrt(power(order)), floor])
    return out


def measure(case, x):
    n = len(x)
    teeth = case["teeth"]
    orders = orders_of(teeth)
    revolutions = float(angle(case, n) - angle(case, 0))
    plan = math.exp(0.02 * round(math.log(revolutions) / 0.02))
    out = {"signal": channel_indicators(x, case["sample_rate_hz"], case["unit"]), "gears": {}}
    first = float(angle(case, 4))
    span = float(angle(case, n - 5)) - first
    for reference, points, members in points_of(orders, n, plan):
        per_turn = points * orders[reference][0] / orders[reference][1]
        count = int(span * per_turn) + 1
        grid = interpolated(x, position(case, first + np.arange(count) / per_turn))
        for shaft, length in members:
            turns = count // length
            if turns < 2:
                continue
            rows = grid[: turns * length].reshape(turns, length)
            y = rows.mean(axis=0)
            variance = float(np.mean(np.var(rows, axis=0, ddof=1))) / turns
            highest = min(int(SHARE * n / revolutions / (orders[shaft][0] / orders[shaft][1])), (length - 1) // 2)
            here = []
            if shaft < len(teeth):
                here.append((f"{shaft}.pinion", teeth[shaft][0]))
            if shaft > 0:
                here.append((f"{shaft - 1}.wheel", teeth[shaft - 1][1]))
            for name, z in here:
                values = gear_indicators(y, variance, [z for _, z in here], z, highest)
                out["gears"][name] = {"revolutions": turns, **values}
    case = {**case, "envelope": {"band_hz": [1500.0, 2500.0], "orders": [1.0, 3.58, 5.42]}}
    out["envelope"] = {**case["envelope"], "depths": envelope(case, x)}
    return out


def made():
    def case(name, teeth, rate, n, angle, unit, noise, burst):
        tones, order = [], 1.0
        for stage, (pinion, wheel) in enumerate(teeth):
            for h in range(1, 6):
                a = (1.0 + 0.4 * stage) / h
                tones.append([order * pinion * h, a, 0.4 * h + stage])
                tones.append([order * pinion * h + order, 0.2 * a, 1.0 + h])
                tones.append([order * pinion * h - order, 0.15 * a, 2.0 + h])
            order *= pinion / wheel
        tones += [[1.0, 0.3, 0.2], [3.7, 0.2, 0.5]]
        return {"name": name, "teeth": teeth, "sample_rate_hz": rate, "samples": n, "angle": angle, "unit": unit, "offset": 0.7,
                "tones": tones, "bursts": [[1.0, burst, 0.02, 61.0]] if burst else [], "noise": noise}
    return [
        case("steady", [[29, 100], [36, 90]], 16384.0, 16384, [25.013], "m/s^2", 0.3, 0.0),
        case("burst", [[29, 100], [36, 90]], 16384.0, 16384, [24.731], "g", 0.3, 4.0),
        case("ramp", [[34, 73], [36, 90]], 16384.0, 16384, [24.9, 0.6, 0.05], "mm/s", 0.2, 2.0),
        case("slow", [[29, 100]], 8192.0, 8192, [7.3, 0.1], "V", 0.2, 1.0),
        case("own copies", [[37, 101], [41, 103]], 16384.0, 16384, [29.3], "m/s^2", 0.1, 1.0),
    ]


def recorded():
    for name, angle in (("h30hz30", [29.70]), ("b30hz50", [29.66, 0.02])):
        path = os.path.join(SHARED, f"{name}.csv.gz")
        if not os.path.exists(path):
            continue
        with gzip.open(path, "rt") as file:
            rows = list(csv.reader(file))[1:12801]
        for channel in range(4):
            # As the Rust reader has them: single precision.
            x = np.array([row[channel] for row in rows], dtype=np.float32).astype(float)
            case = {"file": name, "channel": channel, "teeth": [[32, 80], [48, 64]], "sample_rate_hz": 12800.0, "angle": angle,
                    "unit": "1", "samples": 12800}
            yield case, x


def simulated():
    """Two channels of `simulated.csv.gz`, which `gearwatch simulate` wrote (see README.md): a healthy machine and one with a cracked root."""
    with gzip.open(os.path.join(HERE, "simulated.csv.gz"), "rt") as file:
        rows = list(csv.reader(file))
    for column, name in enumerate(rows[0]):
        x = np.array([row[column] for row in rows[1:]], dtype=np.float32).astype(float)
        yield {"name": name, "column": column, "teeth": [[29, 100], [36, 90]], "sample_rate_hz": 8192.0, "angle": [25.0],
               "unit": "m/s^2", "samples": len(x)}, x


if __name__ == "__main__":
    cases = {"made": [], "recorded": [], "simulated": [], "numpy": np.__version__, "scipy": scipy.__version__}
    for case in made():
        cases["made"].append({**case, **measure(case, signal(case))})
    for case, x in recorded():
        cases["recorded"].append({**case, **measure(case, x)})
    for case, x in simulated():
        cases["simulated"].append({**case, **measure(case, x)})
    json.dump(cases, sys.stdout, indent=1)
    print()
