"""What a config states about the files of a bench, for a kind of recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from beltid.config import Config
from beltid.errors import InputError
from beltid.tables import schemas
from beltid.tables.columns import Table
from beltid.tables.units import Calibration

DIALECT: Final[Mapping[str, Any]] = {
    "separator": None,
    "decimal": None,
    "thousands": None,
    "encoding": None,
    "skip_lines": 0,
    "names": None,
}
"""What is None is detected from the file."""
TWO_CELLS: Final = ("two_cells", "tight", False)


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Differences between the files of a bench and ours; none by default.

    Attributes
    ----------
    names : mapping
        Our column -> its name in the file, or that of a field of its head.
    units : mapping
        Our column -> its unit in the file, or the calibration of its sensor.
    pattern : str or None
        Pattern of the file names with label and settings.
    run_table : Path or None
        Table with a row per file.
    values : mapping
        Settings of all runs.
    dialect : mapping
        Separators and encoding of texts; see `DIALECT`.
    rig : str, str, bool
        What the friction rig measures, on which span a weight is, whether its belt runs.
    """

    names: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str | Calibration] = field(default_factory=dict)
    pattern: str | None = None
    run_table: Path | None = None
    values: Mapping[str, Any] = field(default_factory=dict)
    dialect: Mapping[str, Any] = field(default_factory=lambda: DIALECT)
    rig: tuple[str, str, bool] = TWO_CELLS

    @classmethod
    def of(cls, config: Config | None, kind: str) -> ReadOptions:
        """Return the options that a config states for a kind of recording."""
        if config is None:
            return cls()
        dialect = {name: getattr(config.dialect, name) for name in DIALECT}
        if dialect["decimal"] is not None and dialect["decimal"] == dialect["thousands"]:
            raise InputError(
                f'config: dialect.decimal and dialect.thousands are both "{dialect["decimal"]}", '
                "must differ"
            )
        also = "rig" if kind == "points" else kind  # what is stated of a rig serves its plateaus
        runs, rig = config.runs[kind], config.rig if kind in ("rig", "points") else None
        return cls(
            config.columns[also] | config.columns[kind],
            {
                n: Calibration(u["factor"], u["offset"]) if isinstance(u, dict) else u
                for n, u in (config.units[also] | config.units[kind]).items()
            },
            runs["pattern"],
            runs["table"],
            runs["values"],
            dialect,
            (rig.measures, rig.weight_on, rig.kind == "running") if rig else TWO_CELLS,
        )

    def table(self, kind: str) -> Table:
        """Return the table that a kind of recording must fill."""
        measures, weight_on, running = self.rig
        if kind != "rig":
            return schemas.table(kind)
        return schemas.rig_table(measures, weight_on, running=running)
