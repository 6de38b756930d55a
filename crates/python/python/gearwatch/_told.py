"""What long work tells while it goes, and what is doubtful about its result."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Union

Progress = Union[bool, Callable[[str], object], None]

_HERE = str(Path(__file__).parent)


class DoubtWarning(UserWarning):
    """What a check of bench and recordings found doubtful, or what was left out. The words are those of the command on stderr."""


@contextmanager
def reported(progress: Progress, what: str) -> Iterator[Callable[[str], object] | None]:
    """A function that takes each step's sentence: the one given, or with ``True`` a line on stderr that is renewed, where somebody can see it."""
    if progress is None or progress is False:
        yield None
        return
    if progress is not True:
        yield progress
        return
    if not sys.stderr.isatty():
        yield None
        return

    def renew(step: str) -> None:
        print(f"\r\x1b[K{what}: {step}", end="", file=sys.stderr, flush=True)

    try:
        yield renew
    finally:
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def doubt(sentences: Sequence[str]) -> None:
    """Warns of each, at the line outside this package that asked."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_HERE):
        frame, level = frame.f_back, level + 1
    for sentence in sentences:
        warnings.warn(sentence, DoubtWarning, stacklevel=level)
