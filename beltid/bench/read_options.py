"""Options for reading the files of a bench, as its config states them for a kind of recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from beltid.config import Config
from beltid.config.layout import RUNS
from beltid.config.model import DialectSection, RigSection
from beltid.errors import InputError
from beltid.tables import schemas
from beltid.tables.columns import Table
from beltid.tables.units import Calibration


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Differences between the files of a bench and ours; none by default.

    Attributes
    ----------
    names, units : mapping
        Our column -> its name in the file; its unit, or the calibration of its sensor.
    dialect : DialectSection
        Separators and encoding of tables; those that are null are detected from the file.
    runs : mapping
        Where to find label and settings of the runs: pattern, table, fields, values.
    rig : RigSection
        The friction rig: its kind determines the channels of a recording.
    """

    names: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str | Calibration] = field(default_factory=dict)
    dialect: DialectSection = field(default_factory=DialectSection)
    runs: Mapping[str, Any] = field(default_factory=lambda: RUNS({})["rig"])
    rig: RigSection = field(default_factory=RigSection)

    @classmethod
    def of(cls, config: Config | None, kind: str) -> ReadOptions:
        """Return the options that a config states for a kind of recording."""
        if config is None:
            return cls()
        dialect = config.dialect
        if dialect.decimal is not None and dialect.decimal == dialect.thousands:
            sign = dialect.decimal
            raise InputError(
                f'config: dialect.decimal and dialect.thousands are both "{sign}", must differ',
            )
        also = "rig" if kind == "points" else kind  # what is stated of a rig serves its plateaus
        names = config.columns[also] | config.columns[kind]
        units = {
            name: unit if isinstance(unit, str) else Calibration(unit["factor"], unit["offset"])
            for name, unit in (config.units[also] | config.units[kind]).items()
        }
        return cls(names, units, dialect, config.runs[kind], config.rig)

    def table(self, kind: str) -> Table:
        """Return the table that a kind of recording must fill."""
        if kind != "rig":
            return schemas.table(kind)
        running = self.rig.kind == "running"
        return schemas.rig_table(self.rig.measures, self.rig.weight_on, running=running)
