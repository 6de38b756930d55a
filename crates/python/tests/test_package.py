"""The package as its users' tools see it."""

import inspect
import subprocess
import sys
import textwrap

import gearwatch as gw
import pytest
from conftest import BENCH

GOOD = """
import gearwatch as gw
import numpy as np
from numpy.typing import NDArray

bench: gw.Bench = gw.Bench.load("bench.toml")
recording: gw.Recording = gw.simulate(bench, 25.0, [(0.0, 10.0), (5.0, 20.0)], effects=[("tooth_wear", "stage1", {"depth_um": 20})])
samples: NDArray[np.float64] = recording["acc_1"].samples
baseline: gw.Baseline = gw.learn_baseline([recording, gw.read("x.tdms", unit="g")], bench, session="a", progress=print)
text: str = gw.diagnose_json(recording, bench, baseline, progress=True)
answer: gw.Explanation = gw.explain(bench, [recording], reference=recording)
named: list[gw.NamedEffect] = answer.effects
lines: dict[str, NDArray[np.complex128]] = gw.steady(bench).lines
"""


def mypy(tmp_path, text):
    (tmp_path / "user.py").write_text(text)
    arguments = ["--strict", "--no-error-summary", "--cache-dir", str(tmp_path / "cache"), "user.py"]
    return subprocess.run([sys.executable, "-m", "mypy", *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=300)


def test_conform_types_hold_for_a_user(tmp_path):
    """A user's program passes mypy's strict mode, and a wrong one does not."""
    done = mypy(tmp_path, GOOD)
    assert done.returncode == 0, done.stdout
    wrong = mypy(tmp_path, GOOD + 'gw.steady("bench.toml")\ngw.learn_baseline(recording, bench, sesion="a")\n')
    assert "arg-type" in wrong.stdout and "sesion" in wrong.stdout, wrong.stdout


def test_conform_stubs_say_what_the_compiled_part_has(tmp_path):
    """mypy's stubtest: names, arguments and defaults of the stub are those of the module."""
    arguments = ["gearwatch._native", "--concise", "--ignore-missing-stub", "--ignore-disjoint-bases"]
    done = subprocess.run([sys.executable, "-m", "mypy.stubtest", *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("name", [name for name in gw.__all__ if not name.endswith(("Error", "Warning"))])
def test_conform_everything_has_words(name):
    """Each public name and each of its members has a docstring."""
    thing = getattr(gw, name)
    assert inspect.getdoc(thing), name
    if inspect.isclass(thing):
        members = [member for member in vars(thing) if not member.startswith("_")]
        fields = getattr(thing, "__dataclass_fields__", {})
        assert [m for m in members if m not in fields and not inspect.getdoc(getattr(thing, m))] == []


def test_conform_a_doubt_is_warned_of_where_it_was_asked(bench):
    """A sensor of the sheet that the recording does not have: a warning at the line of the user, and its word in the verdict."""
    made = gw.simulate(bench, duration_s=20.0)
    other = gw.Bench.parse(bench.to_toml().replace("acc_2", "acc_9"))
    findings = gw.check(other, made)
    assert findings.id.tolist() == ["channel_missing"] and findings.severity.tolist() == ["doubtful"]
    with pytest.warns(gw.DoubtWarning, match="acc_9") as told:
        table = gw.diagnose(made, other)
    assert told[0].filename == __file__
    assert all(table.doubts == "channel_missing")
    assert gw.check(bench, made).empty and list(gw.check(bench, made).columns) == list(findings.columns)


def test_conform_what_is_wrong_is_refused(bench):
    """A motor whose speed is stated in rpm where Hz belongs: nothing is judged, and the sentence says why."""
    made = gw.simulate(bench, duration_s=20.0)
    rpm = gw.Bench.parse(BENCH.replace("speed_hz = 5.0", "speed_hz = 600.0"))
    assert "wrong" in set(gw.check(rpm, made).severity)
    for refused in (gw.diagnose, gw.learn_baseline, gw.indicators):
        with pytest.raises(gw.CheckError, match="speed_rpm"):
            refused(made, rpm)


PROGRAM = """
import gearwatch as gw, sys, threading, time, _thread
bench = gw.Bench.load(sys.argv[1])
recordings = [gw.simulate(bench, duration_s=600.0, seed=1)]
print("go", flush=True)
began = time.monotonic()
threading.Timer(0.5, _thread.interrupt_main).start()
try:
    gw.{call}
except KeyboardInterrupt:
    print(f"{{time.monotonic() - began:.1f}}", flush=True)
"""


@pytest.mark.parametrize(
    "call",
    [
        "diagnose(recordings * 1000, bench)",
        "learn_baseline(recordings * 1000, bench)",
        "indicators(recordings * 1000, bench)",
        "batch([sys.argv[2]] * 1000, bench)",
        "explain(bench, recordings * 3)",
    ],
)
def test_conform_ctrl_c_ends_long_work(command, folder, call):
    """The call ends long before its work would, and the interpreter with it: nothing stays behind that has to be waited for."""
    recording = folder / "long.mcap"
    if not recording.exists():
        command("simulate", folder / "bench.toml", "--seed", 1, "--duration", 300, "-o", recording)
    program = textwrap.dedent(PROGRAM).format(call=call)
    done = subprocess.run(
        [sys.executable, "-c", program, str(folder / "bench.toml"), str(recording)], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0 and done.stdout.startswith("go\n"), done.stderr
    # The work would take minutes; half a second passes before Ctrl-C.
    assert len(done.stdout.split()) == 2, "it was not interrupted"
