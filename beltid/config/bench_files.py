"""How the files of a bench differ from ours: names of columns, units, dialect of the CSV."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict

from beltid.config.fields import Choice, Count, Encoding, OnOff, Separator, Text, UnitOf


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


Time = Annotated[str, UnitOf("s")] | None
Force = Annotated[str, UnitOf("N")] | None
Speed = Annotated[str, UnitOf("rad/s")] | None
Temperature = Annotated[str, UnitOf("degC")] | None


class PressUnits(Section):
    """Units of the columns of a press recording in the file."""

    temperature_degC: Temperature = None
    time_s: Time = None
    displacement_mm: Annotated[str, UnitOf("mm")] | None = None
    force_N: Force = None


class RigUnits(Section):
    """Units of the columns of a recording of the friction rig in the file."""

    time_s: Time = None
    tension_tight_N: Force = None
    tension_slack_N: Force = None
    pulley_speed_rad_s: Speed = None
    temperature_degC: Temperature = None
    arc_deg: Annotated[str, UnitOf("deg")] | None = None
    initial_tension_N: Force = None


class SpeedlossUnits(Section):
    """Units of the columns of a speed-loss recording in the file."""

    time_s: Time = None
    initial_tension_N: Force = None
    torque_N_m: Annotated[str, UnitOf("N m")] | None = None
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

    def of(self, kind: str) -> dict[str, str]:
        """The columns that come in another unit in files of this kind."""
        return _stated(self, kind)


def _stated(section: Section, kind: str) -> dict[str, str]:
    stated: dict[str, str] = getattr(section, kind).model_dump(exclude_none=True)
    return stated


class DialectSection(Section):
    """How the CSV files of the bench are written; null means: found out from the file."""

    separator: Annotated[str, Separator()] | None = None
    decimal: Annotated[Literal[".", ","], Choice((".", ","))] | None = None
    encoding: Annotated[str, Encoding()] | None = None
    skip_lines: Annotated[int, Count(0, 10_000)] = 0
    units_row: Annotated[bool, OnOff()] = False
