"""Outcome of a stage: its table, its metadata and the scientific result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from beltid.artifacts.metadata_models import Origin
from beltid.report.cells import no_formula
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
    """Result of a stage, before it is written.

    Attributes
    ----------
    kind : str
        Kind of the artifact that holds the table.
    columns : dict of str to ndarray
        The table, with the columns of the artifact; nan or None where a value is missing.
    result : object
        The scientific result with all its properties.
    validity : dict
        Range within which the result holds.
    set_aside : list of dict
        Runs or points that were set aside, with the reason.
    extra : dict
        Further metadata, such as the figures of a statistical test.
    notes, warnings : tuple of str
        What the user should know, and what the user should look into.
    origin : {"measured", "synthetic"} or None
        Origin of the data; None if not stated.
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
        """Return a copy with the combined origin of all its input data.

        Parameters
        ----------
        config : Config
            An origin stated here holds for all inputs.
        *inputs
            A result or an artifact keeps its own origin. Any other table, such as the frame of a
            recording, has the origin that the config states, or none. A law or a surface given by
            numbers does not count as data.
        """
        from beltid.artifacts.artifact import Artifact

        origins = []
        for item in inputs:
            if isinstance(item, Outcome):
                origins.append(item.origin)
            elif isinstance(item, Artifact):
                origins.append(item.metadata.origin)
            elif isinstance(item, Mapping) or hasattr(item, "columns"):
                origins.append(config.data.origin)
        if config.data.origin or not origins:
            origins.append(config.data.origin)
        return replace(self, origin=combined_origin(origins))

    def to_frame(self) -> pd.DataFrame:
        """Return the table as a pandas DataFrame."""
        import pandas as pd

        return pd.DataFrame(
            {
                name: list(values) if values.ndim > 1 else values
                for name, values in self.columns.items()
            }
        )

    def plot(self, figure: str | None = None) -> Figure:
        """Plot the table with matplotlib, as ``beltid show`` does.

        The figure is labelled if the data are synthetic.

        Parameters
        ----------
        figure : str, optional
            Name of the figure; by default the most informative one.

        Raises
        ------
        InputError
            If there is no such figure; the message lists those that exist.
        """
        from beltid.errors import InputError
        from beltid.report.charts import pictures_of
        from beltid.report.results import sheet_from

        made = self.metadata(origin=self.origin)
        sheet = sheet_from(self.kind, self.kind, self.columns, made)
        figures = {picture.key: picture.figure for picture in pictures_of(sheet)}
        name = figure or next(iter(figures), "")
        if name not in figures:
            raise InputError(f"figure = {name}, must be one of: {', '.join(figures) or 'none'}")
        return figures[name]

    def metadata(self, **made: Any) -> Metadata:
        """Return the metadata of an artifact that holds the table.

        Parameters
        ----------
        **made
            Origin, inputs, settings and other provenance; see `Metadata`.
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
        """Write the table as an artifact (.parquet) that every command reads, or as .csv.

        Parameters
        ----------
        path : path
            The file.
        origin : {"measured", "synthetic"}, optional
            Origin of the data, which the artifact states; by default that of the result.
        force : bool
            Whether to overwrite an existing file.

        Raises
        ------
        InputError
            If the file has another ending, or already exists.
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
        """Render the table for a notebook, with its warnings."""
        from html import escape

        frame = self.to_frame()[[*flat(self.columns)]]
        warnings = "".join(f"<li>{escape(line)}</li>" for line in self.warnings)
        table = frame.to_html(
            max_rows=12, na_rep="", border=0, float_format="{:.5g}".format, escape=True
        )
        origin = " (synthetic data)" if self.origin == "synthetic" else ""
        return f"<p>{escape(self.kind)}{origin}: {len(frame)} rows</p><ul>{warnings}</ul>{table}"


def table_columns_of(
    kind: str, values_of: Callable[[str], Sequence[Any] | None]
) -> dict[str, np.ndarray]:
    """Build the columns of a table; a number that its schema does not allow becomes nan.

    Parameters
    ----------
    kind : str
        Kind of the table.
    values_of : callable
        Returns the values of a column by its name, one per row; None if the table omits it.
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
    """Return which runs of a friction table are usable, shape (n,); all if it has no status."""
    status = friction.get("status")
    return np.ones(len(friction["arc_deg"]), dtype=bool) if status is None else status == "ok"


def flat(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the columns of a table that hold a single value in each cell."""
    return {name: values for name, values in columns.items() if values.ndim == 1}


def csv_bytes(columns: Mapping[str, np.ndarray], origin: Origin | None) -> bytes:
    """Return a whole table as CSV, with the origin of its data as a column.

    Columns with several numbers in a cell are left out.
    """
    import pandas as pd

    frame = pd.DataFrame(
        {
            name: [no_formula(label) for label in values] if values.dtype == object else values
            for name, values in flat(columns).items()
        }
    )
    if origin is not None:
        frame["origin"] = origin
    return frame.to_csv(index=False, lineterminator="\n").encode()


def rows_per_setting(
    arc_deg: np.ndarray, speed_rad_s: np.ndarray, force_N_m: np.ndarray, mu: np.ndarray
) -> list[dict[str, Any]]:
    """Return a row per arc and pulley speed: force and friction over the initial tensions."""
    rows = []
    for arc in np.unique(arc_deg):
        for speed in np.unique(speed_rad_s[arc_deg == arc]):
            runs = np.flatnonzero((arc_deg == arc) & (speed_rad_s == speed))
            low, high = runs[np.argmin(force_N_m[runs])], runs[np.argmax(force_N_m[runs])]
            rows.append(
                {
                    "arc_deg": float(arc),
                    "pulley_speed_rad_s": float(speed),
                    "runs": runs.size,
                    "lowest_force_N_m": float(force_N_m[low]),
                    "highest_force_N_m": float(force_N_m[high]),
                    "mu_at_lowest": float(mu[low]),
                    "mu_at_highest": float(mu[high]),
                }
            )
    return rows


def span(values: np.ndarray) -> tuple[float, float] | None:
    """Return the lowest and highest finite value, or None if there is none."""
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else None


def finite_or_none(value: float) -> float | None:
    """Return a number, or None in place of nan and infinity."""
    return value if np.isfinite(value) else None


def in_percent(share: float | None) -> float | None:
    """Convert a share to percent; None stays None."""
    return None if share is None else 100.0 * share


def listed(words: Sequence[str], most: int = 8) -> str:
    """Join the first `most` words, and state how many more there are."""
    text = ", ".join(words[:most])
    return f"{text} and {len(words) - most} more" if len(words) > most else text
