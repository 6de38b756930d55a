"""Which physics was left out, as an object with figures."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Union

from . import _frame, _native
from ._native import Bench, Recording
from ._told import Progress, reported

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MEASURED, _MODELLED = "#0072b2", "#e69f00"


@dataclass(frozen=True)
class NamedEffect:
    """An effect that explains the difference."""

    effect: str
    """Its id in the library: ``gearwatch.effects()``."""
    place: str
    """A stage, gear, shaft, bearing or sensor of the bench."""
    probability: float
    """That effect and place are right (0 to 1)."""
    parameters: dict[str, tuple[float, float]]
    """Value and standard deviation by name; the name ends in the unit."""
    indistinguishable_from: list[tuple[str, str]]
    """Effects and places that these recordings cannot tell from this one."""
    evidence: dict[str, str]
    """Why, a sentence each: where, law, support, shape."""


@dataclass(frozen=True)
class Explanation:
    """Where simulation and recordings differ, and which physics was left out."""

    status: Literal["consistent", "explained", "ambiguous", "unexplained"]
    effects: list[NamedEffect]
    """Most probable first."""
    nearest: list[NamedEffect]
    """What comes nearest where nothing in the library accounts for the difference: leads, no findings."""
    law: dict[str, Any] | None
    """A law of a spring or damper without a name that accounts for it: where, probability, parameters, term."""
    mismatch: list[dict[str, Any]]
    """Lines that differ most, largest first: recording, channel, what, order, frequency_hz, measured, modelled, sigma, z, share."""
    fit: dict[str, Any] | None
    """Misfit of the recordings that were fitted and of those held out, before and after."""
    latent_force: dict[str, Any] | None
    """The force that would account for what has no name, over the turn that it repeats with."""
    limits: list[str]
    """What these recordings keep from being told."""
    advice: list[str]
    """What to record next, and why."""
    bench: Bench
    """The bench with the named effects in it."""
    json: str
    """The whole answer, byte for byte the command's explanation.json."""

    def mismatch_frame(self, frame: _frame.Kind = "pandas") -> Any:
        """``mismatch`` as a table of pandas or polars."""
        return _frame.table("\n".join(json.dumps(row) for row in self.mismatch), frame)

    def plot_mismatch(self, most: int = 12) -> Figure:
        """A figure of matplotlib: measured beside modelled amplitude (peak, unit of the channel) of the lines that differ most."""
        import matplotlib.pyplot as plt

        rows = self.mismatch[:most][::-1]
        figure, axes = plt.subplots(figsize=(9, 0.45 * len(rows) + 1.2), layout="constrained")
        places = range(len(rows))
        axes.barh([at + 0.2 for at in places], [row["measured"] for row in rows], 0.4, label="measured", color=_MEASURED)
        axes.barh([at - 0.2 for at in places], [row["modelled"] for row in rows], 0.4, label="modelled", color=_MODELLED)
        axes.set_yticks(list(places), [f"{row['channel']} {row['what']}, {row['frequency_hz']:.1f} Hz" for row in rows])
        axes.set_xlabel("peak amplitude (unit of the channel)")
        axes.legend()
        return figure

    def plot_fit(self) -> Figure:
        """A figure of matplotlib: misfit without and with the named effects, of recordings that were fitted and of those held out, beside noise."""
        import matplotlib.pyplot as plt

        if self.fit is None:
            raise ValueError("this explanation has no fit: nothing was named")
        figure, axes = plt.subplots(figsize=(6, 2.6), layout="constrained")
        for at, which in enumerate(("held_out", "train")):
            axes.barh(at + 0.2, self.fit[f"{which}_before"], 0.4, color=_MODELLED, label="without" if at == 0 else None)
            axes.barh(at - 0.2, self.fit[f"{which}_after"], 0.4, color=_MEASURED, label="with" if at == 0 else None)
        axes.axvline(self.fit["noise_floor"], color="grey", linewidth=1, label="noise and repetition")
        axes.set_yticks([0, 1], ["held out", "fitted"])
        axes.set_xlabel(self.fit["metric"])
        axes.legend()
        return figure


def _several(recordings: Union[Recording, Iterable[Recording]]) -> list[Recording]:
    return [recordings] if isinstance(recordings, Recording) else list(recordings)


def _named(one: dict[str, Any]) -> NamedEffect:
    return NamedEffect(
        effect=one["effect"],
        place=one["where"],
        probability=one["probability"],
        parameters={name: (value["value"], value["sigma"]) for name, value in one["parameters"].items()},
        indistinguishable_from=[(other["effect"], other["where"]) for other in one["indistinguishable_from"]],
        evidence=one["evidence"],
    )


def explain(
    bench: Bench,
    recordings: Union[Recording, Iterable[Recording]],
    reference: Union[Recording, Iterable[Recording], None] = None,
    *,
    progress: Progress = None,
) -> Explanation:
    """Says where the simulation of a bench and its recordings differ, and which physics was left out.

    ``reference`` are recordings of the same bench, sensors and mounting before. It takes a minute and more; ``progress=True`` says what is being
    done. What is said is judged on recordings that took no part in the fit. Recordings of which nothing can be said raise ``ExplainError``.
    """
    with reported(progress, "explain") as report:
        text, fitted = _native.explain(bench, _several(recordings), None if reference is None else _several(reference), progress=report)
    answer = json.loads(text)
    library = [one for one in answer["effects"] if one["effect"] is not None]
    return Explanation(
        status=answer["status"],
        effects=[_named(one) for one in library if not one.get("nearest")],
        nearest=[_named(one) for one in library if one.get("nearest")],
        law=next((one for one in answer["effects"] if one["effect"] is None), None),
        mismatch=answer["mismatch"],
        fit=answer.get("fit"),
        latent_force=answer.get("latent_force"),
        limits=answer.get("limits", []),
        advice=answer["advice"],
        bench=fitted,
        json=text,
    )
