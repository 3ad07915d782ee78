"""Outcome of a stage: its table, what it says about itself, and the result of the science."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from beltid.artifacts.metadata_models import Origin
from beltid.report.summary import combined_origin
from beltid.tables import schemas
from beltid.tables.values import outside

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from beltid.artifacts.metadata_models import Metadata
    from beltid.config import Config

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
    origin : {"measured", "synthetic"} or None
        Where the data come from; None where nobody said.
    """

    kind: str
    columns: dict[str, np.ndarray]
    result: Result
    validity: dict[str, Any] = field(default_factory=dict)
    set_aside: list[dict[str, Any]] = field(default_factory=list)
    extra: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    origin: Origin | None = None

    def with_origin(self, config: Config, *inputs: Any) -> Outcome[Result]:
        """The same, with the origin of all data that went into it.

        Parameters
        ----------
        config : Config
            What it states of the data holds for all inputs.
        *inputs
            A result or an artifact hands on its own origin. Any other table, such as the frame of a
            recording, has the origin that the config states: unknown if it states none. A law or a
            surface by its numbers is no data.
        """
        from beltid.artifacts.artifact import Artifact

        origins = []
        for one in inputs:
            if isinstance(one, Outcome):
                origins.append(one.origin)
            elif isinstance(one, Artifact):
                origins.append(one.metadata.origin)
            elif isinstance(one, Mapping) or hasattr(one, "columns"):
                origins.append(config.data.origin)
        if config.data.origin or not origins:
            origins.append(config.data.origin)
        return replace(self, origin=combined_origin(origins))

    def to_frame(self) -> pd.DataFrame:
        """The table as a pandas DataFrame."""
        import pandas as pd

        return pd.DataFrame(
            {
                name: list(values) if values.ndim > 1 else values
                for name, values in self.columns.items()
            }
        )

    def plot(self, figure: str | None = None) -> Figure:
        """The table as a figure of matplotlib, like that of ``beltid show``.

        It says so if the data are synthetic.

        Parameters
        ----------
        figure : str, optional
            Which of its figures; by default the most telling one.

        Raises
        ------
        InputError
            If there is no such figure, with the names of those there are.
        """
        from beltid.errors import InputError
        from beltid.report.figures.single import pictures
        from beltid.report.results import Sheet

        sheet = Sheet(self.kind, self.kind, self.columns, self.metadata(origin=self.origin))
        found = {
            picture.key: picture.figure for picture in pictures(sheet) if picture.figure is not None
        }
        name = figure or next(iter(found), "")
        if name not in found:
            raise InputError(f"figure = {name}, must be one of: {', '.join(found) or 'none'}")
        return found[name]

    def metadata(self, **made: Any) -> Metadata:
        """What an artifact of the table states about itself, with how it was made.

        Parameters
        ----------
        **made
            Origin, inputs, settings and so on; see `Metadata`.
        """
        from beltid.artifacts.metadata_models import METADATA

        stated = {
            **self.extra,
            "validity": self.validity,
            "set_aside": self.set_aside,
            "notes": self.notes,
            "warnings": self.warnings,
        }
        return METADATA[self.kind].model_validate({**stated, **made})

    def save(
        self,
        path: str | Path,
        *,
        origin: Origin | None = None,
        force: bool = False,
    ) -> Path:
        """Write the table: to an artifact (.parquet) that every command takes, or as .csv.

        Parameters
        ----------
        path : path
            The file.
        origin : {"measured", "synthetic"}, optional
            Where the data come from; the artifact states it. By default what the result knows.
        force : bool
            Whether to overwrite an existing file.

        Raises
        ------
        InputError
            If the file ends in something else, or exists already.
        ArtifactError
            If it cannot be written.
        """
        from beltid.artifacts.artifact import write_artifact
        from beltid.artifacts.file_bytes import write_bytes
        from beltid.errors import InputError

        path = Path(path)
        if path.exists() and not force:
            raise InputError(f"{path}: already exists; force=True replaces it")
        if path.suffix == ".csv":
            write_bytes(path, csv_bytes(self.columns, origin or self.origin))
        elif path.suffix == ".parquet":
            metadata = self.metadata(origin=origin or self.origin)
            write_artifact(path, self.kind, self.columns, metadata)
        else:
            raise InputError(f"{path}: must end in .parquet or .csv")
        return path

    def _repr_html_(self) -> str:
        """The table for a notebook, with what should be looked into."""
        from html import escape

        frame = self.to_frame()[[*flat(self.columns)]]
        said = "".join(f"<li>{escape(line)}</li>" for line in self.warnings)
        table = frame.to_html(
            max_rows=12, na_rep="", border=0, float_format="{:.5g}".format, escape=True
        )
        of_what = " (synthetic data)" if self.origin == "synthetic" else ""
        return f"<p>{escape(self.kind)}{of_what}: {len(frame)} rows</p><ul>{said}</ul>{table}"


def table_columns_of(
    kind: str, values_of: Callable[[str], Sequence[Any] | None]
) -> dict[str, np.ndarray]:
    """Columns of a table of ours; a number that the table does not admit is left out of it.

    Parameters
    ----------
    kind : str
        Kind of the table.
    values_of : callable
        The values of a column by its name, a row each; None where the table goes without it.
    """
    columns: dict[str, np.ndarray] = {}
    for column in schemas.table(kind).columns:
        values = values_of(column.name)
        if values is None:
            continue
        array = np.empty(len(values), dtype=object if column.dtype == "string" else column.dtype)
        array[:] = values
        if column.dtype == "float64":
            array = np.where(np.isfinite(array) & ~outside(array, column), array, np.nan)
        columns[column.name] = array
    return columns


def ok_rows(friction: Mapping[str, np.ndarray]) -> np.ndarray:
    """Which runs of a friction table, shape (n,), can be used: all of one without a status."""
    status = friction.get("status")
    return np.ones(len(friction["arc_deg"]), dtype=bool) if status is None else status == "ok"


def flat(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The columns of a table that hold a single value in each cell."""
    return {name: values for name, values in columns.items() if values.ndim == 1}


def csv_bytes(columns: Mapping[str, np.ndarray], origin: Origin | None) -> bytes:
    """A whole table as CSV, with the origin of its data as a column.

    Columns with several numbers in a cell are left out. A label that a spreadsheet would take for a
    formula is quoted by an apostrophe.
    """
    import pandas as pd

    frame = pd.DataFrame(
        {
            name: [_quoted(label) for label in values] if values.dtype == object else values
            for name, values in flat(columns).items()
        }
    )
    if origin is not None:
        frame["origin"] = origin
    return frame.to_csv(index=False, lineterminator="\n").encode()


def _quoted(cell: Any) -> Any:
    is_formula = isinstance(cell, str) and cell.startswith(("=", "+", "-", "@"))
    return f"'{cell}" if is_formula else cell


def rows_of(columns: dict[str, np.ndarray], *names: str) -> list[dict[str, Any]]:
    """Rows of some columns of a table as plain values; nan becomes None."""
    chosen = [name for name in names if name in columns]
    cells = [[_plain(v) for v in columns[name].tolist()] for name in chosen]
    return [dict(zip(chosen, row, strict=True)) for row in zip(*cells, strict=True)]


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and np.isnan(value) else value


def rows_per_setting(
    arc_deg: np.ndarray, speed_rad_s: np.ndarray, force_N_m: np.ndarray, mu: np.ndarray
) -> list[dict[str, Any]]:
    """A row per arc and pulley speed: force and friction over the initial tensions."""
    rows = []
    for arc in np.unique(arc_deg):
        for speed in np.unique(speed_rad_s[arc_deg == arc]):
            here = np.flatnonzero((arc_deg == arc) & (speed_rad_s == speed))
            low, high = here[np.argmin(force_N_m[here])], here[np.argmax(force_N_m[here])]
            rows.append(
                {
                    "arc_deg": float(arc),
                    "pulley_speed_rad_s": float(speed),
                    "runs": here.size,
                    "lowest_force_N_m": float(force_N_m[low]),
                    "highest_force_N_m": float(force_N_m[high]),
                    "mu_at_lowest": float(mu[low]),
                    "mu_at_highest": float(mu[high]),
                }
            )
    return rows


def span(values: np.ndarray) -> tuple[float, float] | None:
    """Lowest and highest finite value; None if there is none."""
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else None


def finite_or_none(value: float) -> float | None:
    """A number, or None in the place of nan and infinity."""
    return value if np.isfinite(value) else None


def in_percent(share: float | None) -> float | None:
    """A share in percent, None where it is not known."""
    return None if share is None else 100.0 * share


def listed(words: Sequence[str], most: int = 8) -> str:
    """The first of some words, and how many more there are."""
    text = ", ".join(words[:most])
    return f"{text} and {len(words) - most} more" if len(words) > most else text
