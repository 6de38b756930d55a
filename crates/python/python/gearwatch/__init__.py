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

import os
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Union

from . import _native
from ._explanation import Explanation, NamedEffect, _several, explain
from ._frame import Kind, table
from ._native import (
    Baseline,
    BaselineError,
    Bench,
    BenchError,
    Channel,
    CheckError,
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
    steady,
)
from ._told import DoubtWarning, Progress, doubt, reported
from ._types import OrderSpectrum, Stage

__version__: str = _native.__VERSION__

__all__ = [
    "Baseline", "BaselineError", "Bench", "BenchError", "Channel", "CheckError", "DoubtWarning", "ExplainError", "Explanation",
    "GearwatchError", "NamedEffect", "OrderSpectrum", "ReadError", "Recording", "Segment", "SimulationError", "Stage", "SteadyState", "amplitudes", "batch", "check",
    "diagnose", "diagnose_json", "effects", "explain", "indicators", "learn_baseline", "order_spectra", "order_spectrum", "read", "simulate",
    "steady",
]

Recordings = Union[Recording, Iterable[Recording]]
EffectLike = Union[str, tuple[str, str, Mapping[str, float]]]
_Path = Union[str, "os.PathLike[str]"]

_FINDING = ["id", "severity", "recording", "place", "found", "expected", "advice"]


def read(
    path: _Path,
    *,
    sample_rate_hz: float | None = None,
    unit: str | None = None,
    scale: float | None = None,
    channels: Sequence[str] | None = None,
    time_column: str | None = None,
    delimiter: str | None = None,
    decimal_comma: bool | None = None,
    motor_speed_hz: float | None = None,
    motor_speed_rpm: float | None = None,
    brake_torque_nm: float | None = None,
    progress: Progress = None,
) -> Recording:
    """Reads a recording: MCAP, CSV, WAV, UFF, MATLAB or TDMS, gzipped or not.

    What the file leaves unsaid is said by keywords, or by a file ``<path>.toml`` beside it: the rate (samples per second), the unit of the values
    (``m/s^2``, ``g``, ``mm/s``, ``V`` or ``1``), a factor ``scale`` from values in the file to that unit, and the operating point.
    ``channels`` are those to read, as ``"NAME=COLUMN:UNIT"``, ``"NAME=COLUMN"`` or ``"COLUMN"``. ``Recording.warnings`` says what is unusual
    in the file.
    """
    with reported(progress, "read") as report:
        return _native.read(
            path, sample_rate_hz=sample_rate_hz, unit=unit, scale=scale, channels=channels, time_column=time_column, delimiter=delimiter,
            decimal_comma=decimal_comma, motor_speed_hz=motor_speed_hz, motor_speed_rpm=motor_speed_rpm, brake_torque_nm=brake_torque_nm,
            progress=report,
        )


def check(bench: Bench, recordings: Recordings = (), baseline: Baseline | None = None, *, frame: Kind = "pandas") -> Any:
    """Whether sheet, recordings and baseline belong together: a row a finding, the gravest first; no row where all fits.

    Columns: ``id``, ``severity`` (``wrong``, ``doubtful``, ``note``), ``recording``, ``place``, ``found``, ``expected``, ``advice``. What is wrong
    is refused by :func:`learn_baseline`, :func:`diagnose` and :func:`indicators` with a ``CheckError``; what is doubtful is warned of there
    (``DoubtWarning``) and stands in the column ``doubts`` of verdicts.
    """
    return table(_native.check(bench, _several(recordings), baseline), frame, _FINDING)


def diagnose_json(
    recordings: Recordings,
    bench: Bench,
    baseline: Baseline | None = None,
    *,
    windows: bool = False,
    signatures: _Path | None = None,
    progress: Progress = None,
) -> str:
    """Verdicts as JSON lines, byte for byte those of ``gearwatch diagnose --format json`` (or ``--windows``)."""
    with reported(progress, "diagnose") as report:
        lines, doubts = _native.diagnose_json(
            _several(recordings), bench, baseline, windows=windows, signatures=signatures, progress=report
        )
    doubt(doubts)
    return lines


def diagnose(
    recordings: Recordings,
    bench: Bench,
    baseline: Baseline | None = None,
    *,
    windows: bool = False,
    signatures: _Path | None = None,
    progress: Progress = None,
    frame: Kind = "pandas",
) -> Any:
    """What recordings say of the gears: a row a recording, operating point, channel and stage, or with ``windows`` a row a window.

    Columns are the fields of the command's JSON: ``rank_1x`` … ``rank_5x`` (0, I … V or unknown), ``dev_1x_percent`` with its
    ``dev_sigma_1x_percent``, ``amp_1x`` (peak, in ``unit``), ``machine``, ``instrument``, ``reason`` and more. Unknown numbers are NaN (pandas) or
    null (polars). Without a baseline every rank is unknown. Gives a ``pandas.DataFrame`` or, with ``frame="polars"``, a ``polars.DataFrame``.
    """
    return table(diagnose_json(recordings, bench, baseline, windows=windows, signatures=signatures, progress=progress), frame)


def amplitudes(
    recording: Recording, bench: Bench, *, sidebands: bool = False, progress: Progress = None, frame: Kind = "pandas"
) -> Any:
    """Amplitudes of the mesh harmonics 1x to 5x, a row a window, channel and stage.

    ``amp_1x`` is the peak amplitude in ``unit``, ``sigma_1x`` its standard deviation, ``floor_1x`` what noise alone would show there, and
    ``phase_1x_rad`` the phase at the window's first sample. With ``sidebands`` also ±1 to ±3 of both shafts, as ``amp_1x-2pinion``.
    """
    with reported(progress, "amplitudes") as report:
        return table(_native.amplitudes(recording, bench, sidebands=sidebands, progress=report), frame)


def indicators(
    recordings: Recordings,
    bench: Bench,
    healthy: Recordings | None = None,
    *,
    window_s: float = 1.0,
    envelope_hz: tuple[float, float] | None = None,
    progress: Progress = None,
    frame: Kind = "pandas",
) -> Any:
    """Condition indicators beside the mesh harmonics: RMS, kurtosis, FM0, FM4, NA4, NB4, M6A, M8A, sidebands, envelope. A row a number.

    ``value`` is the mean over windows of ``window_s`` seconds (overlapping by half) in ``unit``, ``sigma`` its standard error; ``place`` is a gear
    or a bearing's part, or empty for the channel. With ``healthy`` recordings, at the same speed and load, ``baseline``, ``dev_percent`` and
    ``z`` compare with them, and NA4* and NB4* are known. Rows are the lines of ``gearwatch indicators --json``. docs/indicators.md says what
    each is.
    """
    with reported(progress, "indicators") as report:
        lines, told = _native.indicators(
            _several(recordings), bench, None if healthy is None else _several(healthy), window_s=window_s, envelope_hz=envelope_hz,
            progress=report,
        )
    doubt(told)
    return table(lines, frame)


def learn_baseline(
    recordings: Recordings,
    bench: Bench,
    *,
    session: str = "1",
    mounting: str = "1",
    window_s: float | None = None,
    hop_s: float | None = None,
    progress: Progress = None,
) -> Baseline:
    """What is normal, learned from recordings of the normal state.

    One session understates how much a healthy machine scatters: learn several, each under its own name, and join them with
    ``Baseline.merged``. ``window_s`` and ``hop_s`` are the length of a window and the step to the next (s); 1 and 0.5 where left out.
    """
    with reported(progress, "learn_baseline") as report:
        baseline, doubts = _native.learn_baseline(
            _several(recordings), bench, session=session, mounting=mounting, window_s=window_s, hop_s=hop_s, progress=report
        )
    doubt(doubts)
    return baseline


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
    name: str | None = None,
    progress: Progress = None,
) -> Recording:
    """Simulates a bench in time.

    ``speed_hz`` is the motor's speed and ``torque_nm`` the brake's torque: numbers, or points ``(time in s, value)`` with straight lines between
    them; the bench's nominal values where left out. An effect is ``"tooth_wear@stage1:depth_um=20"`` or ``("tooth_wear", "stage1", {"depth_um":
    20})``; ``gearwatch.effects()`` lists them. ``background_m_per_s2`` is the
    standard deviation of the noise of the surroundings. The recording has the bench's name, or ``name``. The same seed gives the same samples
    as ``gearwatch simulate``.
    """
    with reported(progress, "simulate") as report:
        return _native.simulate(
            bench, speed_hz, torque_nm, effects=_effects(effects), duration_s=duration_s, seed=seed,
            background_m_per_s2=background_m_per_s2, name=name, progress=report,
        )


def batch(
    paths: Iterable[_Path],
    bench: Bench,
    baseline: Baseline | None = None,
    *,
    windows: bool = True,
    workers: int | None = None,
    progress: Progress = None,
    frame: Kind = "pandas",
    **read_options: Any,
) -> tuple[Any, dict[str, str]]:
    """Judges many recordings, several at a time, and gives one table and what could not be judged.

    ``read_options`` are those of :func:`read`. The table has the columns of :func:`diagnose`, with the file in ``recording``; its order is that of
    ``paths`` whatever the number of ``workers``. The dictionary has a sentence for each file that is not in the table. What is doubtful about
    a recording stands in the column ``doubts``.
    """
    named = [os.fspath(path) for path in paths]
    cancel = _native.Cancel()

    def one(path: str) -> str | GearwatchError:
        try:
            recording = _native.read(path, **read_options)
            lines, _ = _native.diagnose_json([recording], bench, baseline, windows=windows, labelled=True)
        except GearwatchError as error:
            return error
        return lines

    tables: list[str] = []
    failed: dict[str, str] = {}
    pool = ThreadPoolExecutor(workers or os.cpu_count(), initializer=_native.heed, initargs=(cancel,))
    with reported(progress, "batch") as report:
        try:
            for done, (path, result) in enumerate(zip(named, pool.map(one, named)), start=1):
                if isinstance(result, GearwatchError):
                    failed[path] = str(result)
                else:
                    tables.append(result)
                if report is not None:
                    report(f"{done} of {len(named)}: {os.path.basename(path)}")
        except BaseException:
            # Ctrl-C is heard here only: the threads are told.
            cancel.now()
            raise
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
    return table("".join(tables), frame), failed
