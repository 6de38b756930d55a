"""The compiled part."""

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from ._types import OrderSpectrum, Stage

__VERSION__: str

_Path = str | os.PathLike[str]
_Report = Callable[[str], object] | None

class GearwatchError(Exception): ...
class ReadError(GearwatchError): ...
class BenchError(GearwatchError): ...
class CheckError(GearwatchError): ...
class BaselineError(GearwatchError): ...
class SimulationError(GearwatchError): ...
class ExplainError(GearwatchError): ...

@final
class Bench:
    @staticmethod
    def load(path: _Path) -> Bench: ...
    @staticmethod
    def parse(text: str) -> Bench: ...
    @staticmethod
    def check(path: _Path) -> list[str]: ...
    @staticmethod
    def shipped() -> list[str]: ...
    @property
    def name(self) -> str: ...
    @property
    def motor_speed_hz(self) -> float: ...
    @property
    def brake_torque_nm(self) -> float: ...
    @property
    def sample_rate_hz(self) -> float: ...
    @property
    def sensors(self) -> list[str]: ...
    @property
    def stages(self) -> list[Stage]: ...
    def to_toml(self) -> str: ...

@final
class Segment:
    @property
    def t0_ns(self) -> int: ...
    @property
    def first_sample_index(self) -> int: ...
    @property
    def quality(self) -> int: ...
    @property
    def samples(self) -> NDArray[np.float64]: ...
    def __len__(self) -> int: ...

@final
class Channel:
    @property
    def unit(self) -> str: ...
    @property
    def sample_rate_hz(self) -> float: ...
    @property
    def segments(self) -> list[Segment]: ...
    @property
    def samples(self) -> NDArray[np.float64]: ...
    def __len__(self) -> int: ...

@final
class Recording:
    @staticmethod
    def from_arrays(
        channels: Mapping[str, NDArray[np.float64]],
        sample_rate_hz: float,
        unit: str = "m/s^2",
        *,
        motor_speed_hz: float | None = None,
        brake_torque_nm: float | None = None,
        tacho_s: NDArray[np.float64] | None = None,
        tacho_shaft: str | None = None,
        pulses_per_rev: float = 1.0,
        t0_ns: int = 0,
        name: str = "arrays",
    ) -> Recording: ...
    @property
    def name(self) -> str: ...
    @property
    def warnings(self) -> list[str]: ...
    @property
    def channels(self) -> list[str]: ...
    @property
    def tachos(self) -> dict[str, NDArray[np.int64]]: ...
    @property
    def operating_points(self) -> dict[str, NDArray[Any]]: ...
    def __getitem__(self, sensor: str, /) -> Channel: ...
    def __contains__(self, sensor: str, /) -> bool: ...
    def __len__(self) -> int: ...

@final
class Baseline:
    @staticmethod
    def load(path: _Path) -> Baseline: ...
    def save(self, path: _Path, *, force: bool = False) -> None: ...
    def merged(self, other: Baseline) -> Baseline: ...
    @property
    def bench(self) -> str: ...
    @property
    def window_s(self) -> float: ...
    @property
    def sessions(self) -> list[str]: ...
    def to_json(self) -> str: ...

@final
class Cancel:
    def __init__(self) -> None: ...
    def now(self) -> None: ...

def heed(cancel: Cancel) -> None: ...

@final
class SteadyState:
    @property
    def orders(self) -> NDArray[np.float64]: ...
    @property
    def frequencies_hz(self) -> NDArray[np.float64]: ...
    @property
    def lines(self) -> dict[str, NDArray[np.complex128]]: ...
    @property
    def input_speed_hz(self) -> float: ...
    @property
    def iterations(self) -> int: ...

_Effect = str | tuple[str, str, Mapping[str, float]]
_Course = float | Sequence[tuple[float, float]]

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
    progress: _Report = None,
) -> Recording: ...
def check(bench: Bench, recordings: Sequence[Recording], baseline: Baseline | None = None) -> str: ...
def indicators(
    recordings: Sequence[Recording],
    bench: Bench,
    healthy: Sequence[Recording] | None = None,
    *,
    window_s: float = 1.0,
    envelope_hz: tuple[float, float] | None = None,
    progress: _Report = None,
) -> tuple[str, list[str]]: ...
def order_spectrum(
    samples: NDArray[np.float64], sample_rate_hz: float, speed_hz: float, *, ramp: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
def order_spectra(recording: Recording, bench: Bench, channel: str) -> list[OrderSpectrum]: ...
def amplitudes(recording: Recording, bench: Bench, *, sidebands: bool = False, progress: _Report = None) -> str: ...
def learn_baseline(
    recordings: Sequence[Recording],
    bench: Bench,
    *,
    session: str = "1",
    mounting: str = "1",
    window_s: float | None = None,
    hop_s: float | None = None,
    progress: _Report = None,
) -> tuple[Baseline, list[str]]: ...
def diagnose_json(
    recordings: Sequence[Recording],
    bench: Bench,
    baseline: Baseline | None = None,
    *,
    windows: bool = False,
    labelled: bool | None = None,
    signatures: _Path | None = None,
    progress: _Report = None,
) -> tuple[str, list[str]]: ...
def simulate(
    bench: Bench,
    speed_hz: _Course | None = None,
    torque_nm: _Course | None = None,
    *,
    effects: Sequence[_Effect] | None = None,
    duration_s: float = 10.0,
    seed: int = 1,
    background_m_per_s2: float | None = None,
    name: str | None = None,
    progress: _Report = None,
) -> Recording: ...
def steady(
    bench: Bench,
    speed_hz: float | None = None,
    torque_nm: float | None = None,
    *,
    effects: Sequence[_Effect] | None = None,
    orders: Sequence[float] | None = None,
    seed: int = 1,
    together: bool = False,
) -> SteadyState: ...
def explain(
    bench: Bench,
    recordings: Sequence[Recording],
    reference: Sequence[Recording] | None = None,
    *,
    progress: _Report = None,
) -> tuple[str, Bench]: ...
def effects() -> list[dict[str, Any]]: ...
