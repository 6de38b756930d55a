"""Order amplitudes by SciPy, for tests/estimator/golden.rs: run `python3 order_amplitudes.py > order_amplitudes.json`.

An implementation that shares nothing with the Rust one: the signal is oversampled eight times by FFT (scipy.signal.resample), a cubic spline
(scipy.interpolate.CubicSpline) takes it to equal steps of shaft angle over a whole number of revolutions, and a flat-top window with
scipy.fft.rfft reads the bins that the orders fall on. The signals are sums of cosines, given by the same numbers in the JSON file, so that
the Rust test makes the same ones.
"""
import json

import numpy as np
import scipy
from scipy import fft, interpolate, signal

RATE = 16384.0
COUNT = 16384
TEETH = [[29, 100], [36, 90]]


def case(f0, ramp):
    """Mesh harmonics of both stages, sidebands of all shafts, and lines that nobody announced."""
    tones = []
    mesh, pinion = 29.0, 1.0
    for stage, (teeth, wheel_teeth) in enumerate(TEETH):
        wheel = pinion * teeth / wheel_teeth
        for h in range(1, 6):
            amplitude = 1.0 / (1.0 + 0.6 * (h - 1)) * (1.0 + 0.5 * stage)
            tones.append([pinion * teeth * h, amplitude, 0.5 * h + stage])
            for times, side in ((1, 0.4), (2, 0.2)):
                tones.append([pinion * teeth * h + times * pinion, side * amplitude, 1.0 + h])
                tones.append([pinion * teeth * h - times * pinion, 0.7 * side * amplitude, 2.0 + h])
        pinion = wheel
    tones.append([17.3, 2.0, 0.1])
    tones.append([61.7, 0.8, 0.2])
    return {"f0_hz": f0, "ramp_hz_per_s": ramp, "tones": tones}


def measure(c):
    t = np.arange(COUNT) / RATE
    angle = c["f0_hz"] * t + 0.5 * c["ramp_hz_per_s"] * t * t
    x = sum(a * np.cos(2 * np.pi * o * angle + p) for o, a, p in c["tones"])
    # Oversampling by FFT needs a periodic signal: fade the ends, which are then left out.
    fade = signal.windows.tukey(COUNT, 0.08)
    fine = signal.resample(x * fade, 8 * COUNT)
    fine_t = np.arange(8 * COUNT) / (8 * RATE)
    fine_angle = c["f0_hz"] * fine_t + 0.5 * c["ramp_hz_per_s"] * fine_t**2
    inside = (fine_t > 0.045) & (fine_t < 0.955)
    spline = interpolate.CubicSpline(fine_angle[inside], fine[inside])
    first = np.ceil(fine_angle[inside][0])
    revolutions = 20
    per_rev = 1024
    grid = first + np.arange(revolutions * per_rev) / per_rev
    assert grid[-1] < fine_angle[inside][-1]
    y = spline(grid)
    window = signal.windows.flattop(len(y), sym=False)
    amplitudes = []
    mesh = 1.0
    for teeth, wheel_teeth in TEETH:
        for h in range(1, 6):
            order = mesh * teeth * h
            # Orders that are no multiple of 1/20 are shifted onto bin zero.
            turned = y * np.exp(-2j * np.pi * order * (grid - grid[0]))
            amplitudes.append(2 * abs(fft.fft(turned * window)[0]) / window.sum())
        mesh *= teeth / wheel_teeth
    return amplitudes


cases = [case(f0, ramp) for f0, ramp in ((25.013, 0.0), (24.731, 0.0), (25.377, 0.0), (24.9, 0.1), (24.8, 0.45), (25.3, -0.5))]
for c in cases:
    c["amplitudes"] = measure(c)
    true = [a for o, a, p in c["tones"]]
print(json.dumps({"scipy": scipy.__version__, "numpy": np.__version__, "sample_rate_hz": RATE, "samples": COUNT, "teeth": TEETH, "cases": cases}, indent=1))
