"""Outcome of a stage: its table, what it says about itself, and the result of the science."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

Result = TypeVar("Result")


@dataclass(frozen=True, slots=True, eq=False)
class Outcome(Generic[Result]):
    """What a stage computed, before it is written.

    Attributes
    ----------
    kind : str
        Kind of the artifact that holds the table.
    columns : dict of str to ndarray
        The table, with the columns of the artifact; nan or None where a value is missing.
    result : object
        The result of the science with all its properties.
    validity : dict
        Range within which the result holds.
    set_aside : list of dict
        What was set aside, and why.
    extra : dict
        Single figures, such as those of a statistical test.
    notes, warnings : tuple of str
        What the user should know, and look into.
    """

    kind: str
    columns: dict[str, np.ndarray]
    result: Result
    validity: dict[str, Any] = field(default_factory=dict)
    set_aside: list[dict[str, Any]] = field(default_factory=list)
    extra: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def to_frame(self) -> pd.DataFrame:
        """The table as a pandas DataFrame."""
        import pandas as pd

        return pd.DataFrame(
            {
                name: list(values) if values.ndim > 1 else values
                for name, values in self.columns.items()
            }
        )


def rows_of(columns: dict[str, np.ndarray], *names: str) -> list[dict[str, Any]]:
    """Rows of some columns of a table as plain values; nan becomes None."""
    chosen = [name for name in names if name in columns]
    cells = [[_plain(v) for v in columns[name].tolist()] for name in chosen]
    return [dict(zip(chosen, row, strict=True)) for row in zip(*cells, strict=True)]


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and np.isnan(value) else value


def span(values: np.ndarray) -> tuple[float, float] | None:
    """Lowest and highest finite value; None if there is none."""
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else None
