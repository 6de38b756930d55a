"""Dictionaries that functions give."""

from __future__ import annotations

from typing import TypedDict

import numpy as np
from numpy.typing import NDArray


class Stage(TypedDict):
    """A gear stage of a bench; orders are multiples of the input shaft's speed."""

    name: str
    pinion_teeth: int
    wheel_teeth: int
    pinion_order: float
    wheel_order: float
    mesh_order: float


class OrderSpectrum(TypedDict):
    """The order spectrum of a window: begin (ns since the epoch, UTC), speed of the input shaft (Hz), orders of shape (lines,) in multiples of
    that speed, and peak amplitudes of the same shape in the unit of the channel."""

    t0_ns: int
    input_speed_hz: float
    orders: NDArray[np.float64]
    amplitude: NDArray[np.float64]
