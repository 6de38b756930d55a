"""Watches, diagnoses, simulates and explains gear test benches.

The functions here are those of the command ``gearwatch``: the same readers, the same signal path, the same numbers. Frequencies are in Hz, torques
in N m, amplitudes are peak values in the unit of the channel, times are ns since the Unix epoch (UTC). Long work leaves other threads of Python
running and ends at Ctrl-C.

>>> import gearwatch as gw
>>> bench = gw.Bench.load("bench.toml")
>>> normal = gw.learn_baseline([gw.read("monday.tdms", unit="g")], bench)
>>> gw.diagnose(gw.read("today.tdms", unit="g"), bench, normal)[["stage", "channel", "machine", "rank_1x"]]
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Union

from . import _native
from ._native import (
    Baseline,
    BaselineError,
    Bench,
    BenchError,
    Channel,
    ExplainError,
    GearwatchError,
    ReadError,
    Recording,
    Segment,
    SimulationError,
    SteadyState,
    effects,
    order_spectra,
    order_spectrum,
    read,
    steady,
)

if TYPE_CHECKING:
    import pandas
    import polars

    Frame = Union[pandas.DataFrame, polars.DataFrame]

__version__: str = _native.__VERSION__

__all__ = [
    "Baseline", "BaselineError", "Bench", "BenchError", "Channel", "ExplainError", "Explanation", "GearwatchError", "NamedEffect",
    "ReadError", "Recording", "Segment", "SimulationError", "SteadyState", "amplitudes", "batch", "diagnose", "diagnose_json", "effects",
    "explain", "learn_baseline", "order_spectra", "order_spectrum", "read", "simulate", "steady",
]

Progress = Union[bool, Callable[[str], None], None]
Recordings = Union[Recording, Iterable[Recording]]
EffectLike = Union[str, tuple[str, str, Mapping[str, float]]]


def _several(recordings: Recordings) -> list[Recording]:
    return [recordings] if isinstance(recordings, Recording) else list(recordings)


def _report(progress: Progress, what: str) -> Callable[[str], None] | None:
    """``True`` writes a line that is renewed where stderr is a terminal, and nothing elsewhere."""
    if progress is None or progress is False:
        return None
    if progress is not True:
        return progress
    if not sys.stderr.isatty():
        return lambda _: None
    return lambda step: print(f"\r\x1b[K{what}: {step}", end="", file=sys.stderr, flush=True)


def _frame(lines: str, frame: Literal["pandas", "polars"]) -> Frame:
    """JSON lines as a table; the longest object has all columns, in order."""
    rows = [json.loads(line) for line in lines.splitlines()]
    columns = list(max(rows, key=len)) if rows else []
    if frame == "polars":
        import polars

        return polars.DataFrame({name: [row.get(name) for row in rows] for name in columns}, strict=False)
    if frame != "pandas":
        raise ValueError(f"frame is {frame!r}; expected 'pandas' or 'polars'")
    import pandas

    table = pandas.DataFrame.from_records(rows, columns=columns)
    # A column of numbers that are all unknown is still one of numbers.
    for name in columns:
        if table[name].isna().all():
            table[name] = table[name].astype("float64")
    return table


def diagnose_json(
    recordings: Recordings,
    bench: Bench,
    baseline: Baseline | None = None,
    *,
    windows: bool = False,
    signatures: str | os.PathLike[str] | None = None,
    progress: Progress = None,
) -> str:
    """Verdicts as JSON lines, byte for byte those of ``gearwatch diagnose --format json`` (or ``--windows``)."""
    return _native.diagnose_json(
        _several(recordings), bench, baseline, windows=windows, signatures=signatures, progress=_report(progress, "diagnose")
    )


def diagnose(
    recordings: Recordings,
    bench: Bench,
    baseline: Baseline | None = None,
    *,
    windows: bool = False,
    signatures: str | os.PathLike[str] | None = None,
    progress: Progress = None,
    frame: Literal["pandas", "polars"] = "pandas",
) -> Frame:
    """What recordings say of the gears: a row a recording, operating point, channel and stage, or with ``windows`` a row a window.

    Columns are the fields of the command's JSON: ``rank_1x`` … ``rank_5x`` (0, I … V or unknown), ``dev_1x_percent`` with its
    ``dev_sigma_1x_percent``, ``amp_1x`` (peak, in ``unit``), ``machine``, ``instrument``, ``reason`` and more. Unknown numbers are NaN (pandas) or
    null (polars). Without a baseline every rank is unknown.
    """
    lines = diagnose_json(recordings, bench, baseline, windows=windows, signatures=signatures, progress=progress)
    return _frame(lines, frame)


def amplitudes(
    recording: Recording, bench: Bench, *, sidebands: bool = False, frame: Literal["pandas", "polars"] = "pandas"
) -> Frame:
    """Amplitudes of the mesh harmonics 1x to 5x, a row a window, channel and stage.

    ``amp_1x`` is the peak amplitude in ``unit``, ``sigma_1x`` its standard deviation, ``floor_1x`` what noise alone would show there, and
    ``phase_1x_rad`` the phase at the window's first sample. With ``sidebands`` also ±1 to ±3 of both shafts, as ``amp_1x-2pinion``.
    """
    return _frame(_native.amplitudes(recording, bench, sidebands=sidebands), frame)


def learn_baseline(
    recordings: Recordings,
    bench: Bench,
    *,
    session: str = "1",
    mounting: str = "1",
    window_s: float | None = None,
    hop_s: float | None = None,
) -> Baseline:
    """What is normal, learned from recordings of the normal state.

    One session understates how much a healthy machine scatters: learn several, each under its own name, and join them with
    ``Baseline.merged``.
    """
    return _native.learn_baseline(
        _several(recordings), bench, session=session, mounting=mounting, window_s=window_s, hop_s=hop_s
    )


def _effects(effects: Iterable[EffectLike] | None) -> list[Any]:
    return [one if isinstance(one, str) else (one[0], one[1], dict(one[2])) for one in effects or ()]


def simulate(
    bench: Bench,
    speed_hz: float | Sequence[tuple[float, float]] | None = None,
    torque_nm: float | Sequence[tuple[float, float]] | None = None,
    *,
    effects: Iterable[EffectLike] | None = None,
    duration_s: float = 10.0,
    seed: int = 1,
    background_m_per_s2: float | None = None,
    progress: Progress = None,
) -> Recording:
    """Simulates a bench in time.

    ``speed_hz`` is the motor's speed and ``torque_nm`` the brake's torque: numbers, or points ``(time in s, value)`` with straight lines between
    them; the bench's nominal values where left out. An effect is ``"tooth_wear@stage1:depth_um=20"`` or ``("tooth_wear", "stage1", {"depth_um":
    20})``; ``gearwatch.effects()`` lists them. The same seed gives the same samples as ``gearwatch simulate``.
    """
    return _native.simulate(
        bench,
        speed_hz,
        torque_nm,
        effects=_effects(effects),
        duration_s=duration_s,
        seed=seed,
        background_m_per_s2=background_m_per_s2,
        progress=_report(progress, "simulate"),
    )


@dataclass(frozen=True)
class NamedEffect:
    """An effect that explains the difference."""

    effect: str
    place: str
    probability: float
    parameters: dict[str, tuple[float, float]]
    """Value and standard deviation by name; the name ends in the unit."""
    indistinguishable_from: list[tuple[str, str]]
    """Effects and places that these recordings cannot tell from this one."""


@dataclass(frozen=True)
class Explanation:
    """Where simulation and recordings differ, and which physics was left out."""

    status: Literal["consistent", "explained", "ambiguous", "unexplained"]
    effects: list[NamedEffect]
    """Most probable first."""
    mismatch: list[dict[str, Any]]
    """Lines that differ most, largest first: recording, channel, order, frequency_hz, measured, modelled, sigma, z, share."""
    fit: dict[str, Any] | None
    """Misfit of the recordings that were fitted and of those held out, before and after."""
    limits: list[str]
    """What these recordings keep from being told."""
    advice: list[str]
    """What to record next, and why."""
    bench: Bench
    """The bench with the named effects in it."""
    json: str
    """The whole answer, byte for byte the command's explanation.json."""

    def mismatch_frame(self, frame: Literal["pandas", "polars"] = "pandas") -> Frame:
        """``mismatch`` as a table."""
        return _frame("\n".join(json.dumps(row) for row in self.mismatch), frame)

    def plot_mismatch(self, most: int = 12) -> Any:
        """A matplotlib figure: measured beside modelled amplitude (peak, unit of the channel) of the lines that differ most."""
        import matplotlib.pyplot as plt

        rows = self.mismatch[:most][::-1]
        figure, axes = plt.subplots(figsize=(9, 0.45 * len(rows) + 1.2), layout="constrained")
        places = range(len(rows))
        axes.barh([at + 0.2 for at in places], [row["measured"] for row in rows], 0.4, label="measured", color="#0072b2")
        axes.barh([at - 0.2 for at in places], [row["modelled"] for row in rows], 0.4, label="modelled", color="#e69f00")
        axes.set_yticks(list(places), [f"{row['channel']} {row['what']}, {row['frequency_hz']:.1f} Hz" for row in rows])
        axes.set_xlabel("peak amplitude (unit of the channel)")
        axes.legend()
        return figure


def explain(
    bench: Bench,
    recordings: Recordings,
    reference: Recordings | None = None,
    *,
    progress: Progress = None,
) -> Explanation:
    """Says where the simulation of a bench and its recordings differ, and which physics was left out.

    ``reference`` are recordings of the same bench, sensors and mounting before. It takes a minute and more; ``progress=True`` says what is being
    done. What is said is judged on recordings that took no part in the fit.
    """
    text, fitted = _native.explain(
        bench,
        _several(recordings),
        None if reference is None else _several(reference),
        progress=_report(progress, "explain"),
    )
    answer = json.loads(text)

    named = [
        NamedEffect(
            effect=one["effect"],
            place=one["where"],
            probability=one["probability"],
            parameters={name: (value["value"], value["sigma"]) for name, value in one["parameters"].items()},
            indistinguishable_from=[(other["effect"], other["where"]) for other in one["indistinguishable_from"]],
        )
        for one in answer["effects"]
    ]
    return Explanation(
        status=answer["status"],
        effects=named,
        mismatch=answer["mismatch"],
        fit=answer.get("fit"),
        limits=answer.get("limits", []),
        advice=answer["advice"],
        bench=fitted,
        json=text,
    )


def batch(
    paths: Iterable[str | os.PathLike[str]],
    bench: Bench,
    baseline: Baseline | None = None,
    *,
    windows: bool = True,
    workers: int | None = None,
    progress: Progress = None,
    frame: Literal["pandas", "polars"] = "pandas",
    **read_options: Any,
) -> tuple[Frame, dict[str, str]]:
    """Judges many recordings, several at a time, and gives one table and what could not be read.

    ``read_options`` are those of :func:`read`. The table has the columns of :func:`diagnose`, with the file in ``recording``; its order is that of
    ``paths`` whatever the number of ``workers``. The dictionary has a sentence for each file that is not in the table.
    """
    paths = [os.fspath(path) for path in paths]
    report = _report(progress, "batch")

    def one(path: str) -> str | GearwatchError:
        try:
            lines = diagnose_json(read(path, **read_options), bench, baseline, windows=windows)
        except GearwatchError as error:
            return error
        if not windows:
            return lines
        label = json.dumps(path, ensure_ascii=False)
        return "".join(f'{{"recording":{label},{line[1:]}\n' for line in lines.splitlines())

    tables, failed = [], {}
    with ThreadPoolExecutor(workers or os.cpu_count()) as pool:
        for done, (path, result) in enumerate(zip(paths, pool.map(one, paths)), start=1):
            if isinstance(result, GearwatchError):
                failed[path] = str(result)
            else:
                tables.append(result)
            if report is not None:
                report(f"{done} of {len(paths)}")
    return _frame("".join(tables), frame), failed
