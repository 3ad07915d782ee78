"""What a config states about the files of a bench, for a kind of recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from beltid.config import Config
from beltid.errors import InputError
from beltid.tables import schemas
from beltid.tables.schemas import Table
from beltid.tables.units import Calibration

DIALECT: Final[Mapping[str, Any]] = {
    **dict.fromkeys(("separator", "decimal", "thousands", "encoding", "names")),
    "skip_lines": 0,
}
"""What is None is detected from the file."""


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Differences between the files of a bench and ours; none by default."""

    names: Mapping[str, str] = field(default_factory=dict)  # our column -> channel or head field
    units: Mapping[str, str | Calibration] = field(default_factory=dict)
    pattern: str | None = None  # of the file names, with label and settings
    run_table: Path | None = None  # with a row per file
    values: Mapping[str, Any] = field(default_factory=dict)  # settings of all runs
    dialect: Mapping[str, Any] = field(default_factory=lambda: DIALECT)
    rig: tuple[str, str, bool] = ("two_cells", "tight", False)  # measures, weight on, running
    found: Mapping[str, str] = field(default_factory=dict)  # keys of `rig` by the channels

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
        kind = "rig" if kind == "points" else kind  # what is stated of a rig serves its plateaus
        runs, rig = config.runs[kind], config.rig if kind == "rig" else None
        units = {
            n: Calibration(u["factor"], u["offset"]) if isinstance(u, dict) else u
            for n, u in config.units[kind].items()
        }
        weight = {"weight_N": rig.weight_N} if rig and rig.weight_N else {}
        stated = runs["pattern"], runs["table"], weight | runs["values"]
        known = cls(config.columns[kind], units, *stated, dialect)
        return replace(known, rig=(rig.kind, rig.weight_on, False)) if rig else known

    def table(self, kind: str) -> Table:
        """Return the table that a kind of recording must fill."""
        measures, weight_on, running = self.rig
        if kind != "rig":
            return schemas.table(kind)
        return schemas.rig_table(measures, weight_on, running=running)
