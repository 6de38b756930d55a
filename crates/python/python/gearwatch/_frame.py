"""JSON lines as tables."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, Union

if TYPE_CHECKING:
    import pandas
    import polars

    Frame = Union[pandas.DataFrame, polars.DataFrame]

Kind = Literal["pandas", "polars"]


def table(lines: str, frame: Kind, columns: Sequence[str] = ()) -> Any:
    """A row a line; the longest object has all columns, in order, else there are ``columns``. Annotated as ``Any``: what it is follows from
    ``frame``."""
    rows = [json.loads(line) for line in lines.splitlines()]
    columns = list(max(rows, key=len)) if rows else list(columns)
    if frame == "polars":
        import polars

        return polars.DataFrame({name: [row.get(name) for row in rows] for name in columns}, strict=False)
    if frame != "pandas":
        raise ValueError(f"frame is {frame!r}; expected 'pandas' or 'polars'")
    import pandas

    made = pandas.DataFrame.from_records(rows, columns=columns)
    # A column of numbers that are all unknown is still one of numbers.
    for name in columns:
        if made[name].isna().all():
            made[name] = made[name].astype("float64")
    return made
