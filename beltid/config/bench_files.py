"""How the files of a bench differ from ours: names of columns, units, dialect of the CSV."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, field_serializer

from beltid.config.fields import (
    Choice,
    Count,
    Encoding,
    FilePath,
    NamePattern,
    Number,
    OnOff,
    Separator,
    Text,
    UnitOf,
)
from beltid.tables.units import Calibration


class Section(BaseModel):
    """A closed, frozen section of the config."""

    model_config = ConfigDict(extra="forbid", frozen=True)


Name = Annotated[str, Text()] | None


class PressNames(Section):
    """Names of the columns of a press recording in the file."""

    test: Name = None
    temperature_degC: Name = None
    time_s: Name = None
    displacement_mm: Name = None
    force_N: Name = None


class RigNames(Section):
    """Names of the columns of a recording of the friction rig in the file."""

    run: Name = None
    time_s: Name = None
    tension_tight_N: Name = None
    tension_slack_N: Name = None
    pulley_speed_rad_s: Name = None
    temperature_degC: Name = None
    arc_deg: Name = None
    initial_tension_N: Name = None


class SpeedlossNames(Section):
    """Names of the columns of a speed-loss recording in the file."""

    run: Name = None
    time_s: Name = None
    initial_tension_N: Name = None
    torque_N_m: Name = None
    driver_speed_rad_s: Name = None
    driven_speed_rad_s: Name = None


Time = Annotated[Any, UnitOf("s")] | None
Force = Annotated[Any, UnitOf("N")] | None
Speed = Annotated[Any, UnitOf("rad/s")] | None
Temperature = Annotated[Any, UnitOf("degC")] | None


class PressUnits(Section):
    """Units of the columns of a press recording in the file."""

    temperature_degC: Temperature = None
    time_s: Time = None
    displacement_mm: Annotated[Any, UnitOf("mm")] | None = None
    force_N: Force = None


class RigUnits(Section):
    """Units of the columns of a recording of the friction rig in the file."""

    time_s: Time = None
    tension_tight_N: Force = None
    tension_slack_N: Force = None
    pulley_speed_rad_s: Speed = None
    temperature_degC: Temperature = None
    arc_deg: Annotated[Any, UnitOf("deg")] | None = None
    initial_tension_N: Force = None


class SpeedlossUnits(Section):
    """Units of the columns of a speed-loss recording in the file."""

    time_s: Time = None
    initial_tension_N: Force = None
    torque_N_m: Annotated[Any, UnitOf("N m")] | None = None
    driver_speed_rad_s: Speed = None
    driven_speed_rad_s: Speed = None


class ColumnsSection(Section):
    """Our name of a column -> its name in the file, per kind of recording."""

    press: PressNames = PressNames()
    rig: RigNames = RigNames()
    speedloss: SpeedlossNames = SpeedlossNames()

    def of(self, kind: str) -> dict[str, str]:
        """The columns that are named otherwise in files of this kind."""
        return _stated(self, kind)


class UnitsSection(Section):
    """Our name of a column -> its unit in the file, per kind of recording."""

    press: PressUnits = PressUnits()
    rig: RigUnits = RigUnits()
    speedloss: SpeedlossUnits = SpeedlossUnits()

    def of(self, kind: str) -> dict[str, str | Calibration]:
        """The columns that come in another unit, or as a raw signal, in files of this kind."""
        return _stated(self, kind)


def _stated(section: Section, kind: str) -> dict[str, Any]:
    """What a section states for a kind of recording, by the names of our columns."""
    values = getattr(section, kind)
    return {
        name: value
        for name in type(values).model_fields
        if (value := getattr(values, name)) is not None
    }


Arc = Annotated[float, Number(0, 360, "°", open_low=True, open_high=True)] | None
Tension = Annotated[float, Number(0, 1e6, "N", open_low=True)] | None
Degrees = Annotated[float, Number(-90, 200, "°C")] | None


class Unstated(Section):
    """A section whose keys mean nothing until they are stated."""


class PressSettings(Unstated):
    """Settings that hold for every test of the press."""

    temperature_degC: Degrees = None


class RigSettings(Unstated):
    """Settings that hold for every run of the friction rig."""

    arc_deg: Arc = None
    initial_tension_N: Tension = None
    temperature_degC: Degrees = None


class SpeedlossSettings(Unstated):
    """Settings that hold for every run of the speed-loss bench."""

    initial_tension_N: Tension = None


class PressFields(Section):
    """Names of the header fields that tell label and settings of a test of the press."""

    test: Name = None
    temperature_degC: Name = None


class RigFields(Section):
    """Names of the header fields that tell label and settings of a run of the friction rig."""

    run: Name = None
    arc_deg: Name = None
    initial_tension_N: Name = None
    temperature_degC: Name = None


class SpeedlossFields(Section):
    """Names of the header fields that tell label and settings of a run of the speed-loss bench."""

    run: Name = None
    initial_tension_N: Name = None


class _Runs(Section):
    """Where label and settings of a run stand that is a file, group or sheet of its own.

    `pattern` says how the names of the files (of the groups, where one file holds all runs) are
    made up, `table` names a CSV file with a row per file.
    """

    pattern: Annotated[str, NamePattern()] | None = None
    table: Annotated[Path, FilePath()] | None = None

    @field_serializer("table", when_used="json")
    def _table_name(self, table: Path | None) -> str | None:
        """The name without its folder: where a table lies changes no result, its content does."""
        return None if table is None else table.name


class PressRuns(_Runs):
    """Label and temperature of the tests of the press."""

    fields: PressFields = PressFields()
    values: PressSettings = PressSettings()


class RigRuns(_Runs):
    """Label, arc and initial tension of the runs of the friction rig."""

    fields: RigFields = RigFields()
    values: RigSettings = RigSettings()


class SpeedlossRuns(_Runs):
    """Label and initial tension of the runs of the speed-loss bench."""

    fields: SpeedlossFields = SpeedlossFields()
    values: SpeedlossSettings = SpeedlossSettings()


class RunsSection(Section):
    """Label and settings of runs whose recordings do not hold them, per kind of recording."""

    press: PressRuns = PressRuns()
    rig: RigRuns = RigRuns()
    speedloss: SpeedlossRuns = SpeedlossRuns()

    def of(self, kind: str) -> PressRuns | RigRuns | SpeedlossRuns:
        """What is said about the runs of a kind of recording."""
        runs: PressRuns | RigRuns | SpeedlossRuns = getattr(self, kind)
        return runs

    @property
    def tables(self) -> dict[str, Path]:
        """The tables that are named, by the kind of recording."""
        kinds = type(self).model_fields
        return {kind: table for kind in kinds if (table := self.of(kind).table) is not None}


class DialectSection(Section):
    """How the CSV files of the bench are written; null means: found out from the file."""

    separator: Annotated[str, Separator()] | None = None
    decimal: Annotated[Literal[".", ","], Choice((".", ","))] | None = None
    encoding: Annotated[str, Encoding()] | None = None
    skip_lines: Annotated[int, Count(0, 10_000)] = 0
    units_row: Annotated[bool, OnOff()] = False
