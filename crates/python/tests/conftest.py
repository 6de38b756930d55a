"""A small bench, recordings of it, and the command line to compare with."""

import os
import shutil
import subprocess
from pathlib import Path

import gearwatch as gw
import pytest

# One stage, sampled slowly: everything is quick.
BENCH = """
format = "gearwatch-bench/1"
name = "small"
motor = { speed_hz = 5.0 }
shaft = [{ name = "input" }, { name = "output" }]
stage = [{ name = "stage1", pinion = { teeth = 20 }, wheel = { teeth = 40 } }]
brake = { torque_nm = 10.0 }
sensor = [{ name = "acc_1", shaft = "input" }, { name = "acc_2", shaft = "output" }]
tacho = { shaft = "input" }
acquisition = { sample_rate_hz = 2048.0 }
"""


@pytest.fixture(scope="session")
def command():
    """The command line, from GEARWATCH_BINARY or the path."""
    binary = os.environ.get("GEARWATCH_BINARY") or shutil.which("gearwatch")
    if binary is None:
        pytest.skip("the command gearwatch is not installed; GEARWATCH_BINARY names it")

    def run(*args, exits=(0,)):
        done = subprocess.run([binary, *map(str, args)], capture_output=True, timeout=600)
        assert done.returncode in exits, done.stderr.decode()
        return done.stdout

    return run


@pytest.fixture(scope="session")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("bench")
    (folder / "bench.toml").write_text(BENCH)
    return folder


@pytest.fixture(scope="session")
def bench(folder):
    return gw.Bench.load(folder / "bench.toml")


@pytest.fixture(scope="session")
def healthy(bench):
    return [gw.simulate(bench, duration_s=20.0, seed=seed) for seed in (1, 2)]


@pytest.fixture(scope="session")
def baseline(bench, healthy):
    return gw.learn_baseline(healthy[0], bench, session="monday").merged(
        gw.learn_baseline(healthy[1], bench, session="tuesday")
    )
