#!/usr/bin/env python3
"""The exponential stepper beside SciPy's solve_ivp, a compiled LSODA and CVODE, on one train: `python3 tests/peers/compare.py`.

Makes a virtual environment in target/peers and installs numpy, scipy and numba there, and where they can be had numbalsoda (LSODA; its
installation needs a Fortran compiler: `apt install gfortran`) and scikit-sundae (CVODE). Every solver integrates the
paper's two-stage rig; the right-hand side of the Python solvers is compiled by numba, so that solvers are compared, not
interpreters. Printed per solver: seconds of computing per simulated second, that over the exponential stepper's, and the largest
deviation of the mesh harmonics 1x to 5x of stage 1 from it, relative to each (harmonics below 5 % of the largest: to that 5 %).
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
VENV = ROOT / "target" / "peers"


def in_environment():
    """Runs this file again inside the virtual environment, made where it is missing."""
    python = VENV / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(VENV)], check=True)
        pip = [str(python), "-m", "pip", "install", "-q"]
        subprocess.run([*pip, "numpy", "scipy", "numba"], check=True)
        for optional in ["numbalsoda", "scikit-sundae"]:
            if subprocess.run([*pip, optional]).returncode != 0:
                print(f"{optional} could not be installed and is left out", file=sys.stderr)
    os.execv(str(python), [str(python), __file__, "--inside"])


def main():
    import numba as nb
    import numpy as np
    from scipy.integrate import solve_ivp

    text = subprocess.run(
        ["cargo", "run", "--release", "-q", "-p", "gearwatch-sim", "--example", "export_model"],
        cwd=ROOT, check=True, capture_output=True, text=True).stdout
    model = json.loads(text)
    mass = np.array(model["mass"])
    n = len(mass)
    a = np.zeros((n, 2 * n))
    a[:, :n] = -np.array(model["stiffness"]) / mass[:, None]
    a[:, n:] = -np.array(model["damping"]) / mass[:, None]
    load = np.array(model["load"]) / mass
    rows = np.array([m["row"] for m in model["meshes"]])
    damping = np.array([m["damping"] for m in model["meshes"]])
    pinion = np.array([m["pinion"] for m in model["meshes"]])
    teeth = np.array([m["teeth"] for m in model["meshes"]], dtype=float)
    order = np.array([m["order"] for m in model["meshes"]])
    phase0 = np.array([m["phase0"] for m in model["meshes"]])
    table = np.array([m["table"] for m in model["meshes"]])
    omega = model["omega"]

    @nb.njit(fastmath=False)
    def rhs(t, x, out):
        for i in range(n):
            out[i] = x[n + i]
            s = load[i]
            for j in range(2 * n):
                if a[i, j] != 0.0:
                    s += a[i, j] * x[j]
            out[n + i] = s
        for k in range(rows.shape[0]):
            delta = 0.0
            rate = 0.0
            for j in range(n):
                delta += rows[k, j] * x[j]
                rate += rows[k, j] * x[n + j]
            u = phase0[k] + teeth[k] / (2 * np.pi) * (order[k] * omega * t + x[pinion[k]])
            u = (u - np.floor(u)) * table.shape[1]
            i = int(u)
            w = u - i
            i = i % table.shape[1]
            i2 = (i + 1) % table.shape[1]
            stiff = table[k, i, 0] + w * (table[k, i2, 0] - table[k, i, 0])
            gap = table[k, i, 1] + w * (table[k, i2, 1] - table[k, i, 1])
            force = max(stiff * delta - gap, 0.0)
            if force > 0.0:
                force += damping[k] * rate
            for j in range(n):
                out[n + j] -= rows[k, j] * force / mass[j]

    @nb.njit
    def scipy_rhs(t, x):
        out = np.empty(2 * n)
        rhs(t, x, out)
        return out

    start = np.array(model["start"])
    settle, record = 1.0, 1.0
    rate_hz = model["rate_hz"]
    times = settle + np.arange(int(record * rate_hz)) / rate_hz
    sensor = np.concatenate([model["sensor_position"], model["sensor_velocity"]])

    def lines(signal):
        window = 1 - np.cos(2 * np.pi * (np.arange(len(signal)) + 0.5) / len(signal))
        signal = signal - signal.mean()
        return np.array([abs(2 / len(signal) * np.sum(window * signal * np.exp(-1j * 34 * h * omega * times)))
                         for h in range(1, 6)])

    etd_lines = np.array(model["etd_lines"])
    floor = 0.05 * etd_lines.max()
    etd = model["etd_s_per_s"]
    print(f"{'solver':34} {'s per s':>9} {'x ETD':>9} {'1x..5x':>9}")
    print(f"{'exponential stepper (this)':34} {etd:9.4f} {1.0:9.1f} {'-':>9}")
    half = model["etd_half_s_per_s"]
    change = np.max(np.abs(np.array(model["etd_half_lines"]) - etd_lines) / np.maximum(etd_lines, floor))
    print(f"{'the same, a step for two samples':34} {half:9.4f} {half / etd:9.2f} {change:9.1e}")
    print(f"{'RK4, 4 steps a sample (this)':34} {model['rk4_s_per_s']:9.4f} {model['rk4_s_per_s'] / etd:9.1f} {'-':>9}")

    def report(name, seconds, solution):
        deviation = np.max(np.abs(lines(solution) - etd_lines) / np.maximum(etd_lines, floor))
        spent = seconds / (settle + record)
        print(f"{name:34} {spent:9.3f} {spent / etd:9.0f} {deviation:9.1e}", flush=True)

    scipy_rhs(0.0, start)
    try:
        from numbalsoda import lsoda, lsoda_sig

        @nb.cfunc(lsoda_sig)
        def compiled(t, x, dx, p):
            rhs(t, nb.carray(x, 2 * n), nb.carray(dx, 2 * n))

        grid = np.concatenate([[0.0], times])
        began = time.process_time()
        solution, success = lsoda(compiled.address, start, grid, rtol=1e-6, atol=1e-12, mxstep=1_000_000)
        if success:
            report("numbalsoda LSODA 1e-6 (compiled)", time.process_time() - began, solution[1:] @ sensor)
        else:
            print("numbalsoda LSODA: failed")
    except ImportError as error:
        print(f"numbalsoda: {error}")
    try:
        from sksundae.cvode import CVODE

        def in_place(t, x, out):
            rhs(t, x, out)

        for method in ["Adams", "BDF"]:
            solver = CVODE(in_place, method=method, rtol=1e-6, atol=1e-12, max_num_steps=100_000_000)
            began = time.process_time()
            solution = solver.solve(np.concatenate([[0.0], times]), start)
            report(f"CVODE {method} 1e-6 (numba RHS)", time.process_time() - began, solution.y[1:] @ sensor)
    except ImportError as error:
        print(f"scikit-sundae: {error}")
    for method, tolerance in [("RK45", 1e-6), ("LSODA", 1e-6)]:
        began = time.process_time()
        solution = solve_ivp(scipy_rhs, (0.0, times[-1] + 1e-9), start, method=method, t_eval=times, rtol=tolerance, atol=1e-12)
        report(f"scipy {method} {tolerance:g} (numba RHS)", time.process_time() - began, sensor @ solution.y)


if __name__ == "__main__":
    main() if "--inside" in sys.argv else in_environment()
