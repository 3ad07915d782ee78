"""The config model: belt, benches and their files, and the settings of every stage.

The model is closed (an unknown key is an error) and frozen. The defaults are the rig of the paper
with a 5PK belt, so an empty config is complete. The sections `columns`, `units` and `runs`, which
describe how bench files differ from ours, have one key per column of a recording; they are built
from the table definitions.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import (
    BeforeValidator,
    create_model,
    field_serializer,
)

from beltid import params
from beltid.config.drive import CompareDriveSection, DriveSection
from beltid.config.fields import (
    Count,
    ListOf,
    Number,
    Section,
    Text,
    UnitOf,
    Unstated,
    file_path,
    folder_name,
    pattern_of_names,
    plain_words,
    separating_character,
    text_encoding,
)
from beltid.tables.columns import Column
from beltid.tables.schemas import RECORDINGS, SETTINGS, table
from beltid.tables.units import Calibration

SHOWN: Final = {"deg": "°", "degC": "°C"}
"""Unit of a column -> its symbol in a config."""


def _create_section(name: str, base: type[Section], keys: dict[str, Any]) -> Any:
    """Create a section class in this module, where pickle finds it in worker processes."""
    section = create_model(name, __base__=base, __module__=__name__, **keys)
    globals()[name] = section
    return section


def _of_columns(name: str, columns: Iterable[Column], allowed: Callable[[Column], Any]) -> Any:
    """Create a section with an optional key for each column."""
    keys = {column.name: (allowed(column) | None, None) for column in columns}
    return _create_section(name, Unstated, keys)


def _per_kind(name: str, section_of: Callable[[str], Any]) -> Any:
    """Create a section with a subsection for each kind of recording."""
    sections = {kind: section_of(kind) for kind in RECORDINGS}
    return _create_section(name, Section, {kind: (of, of()) for kind, of in sections.items()})


def _settings(kind: str) -> list[Column]:
    columns = {column.name: column for column in table(kind).columns}
    return [columns[name] for name in SETTINGS if name in columns]


def _name(column: Column) -> Any:
    return Annotated[str, Text()]


def _unit(column: Column) -> Any:
    return Annotated[Any, UnitOf(column.unit)]


def _value(column: Column) -> Any:
    if column.dtype == "string":
        return Literal[column.choices] if column.choices else _name(column)
    unit = SHOWN.get(column.unit, column.unit)
    return Annotated[
        float, Number(column.low, column.high, unit, column.open_low, column.open_high)
    ]


def _names(kind: str) -> Any:
    return _of_columns(f"_{kind}_names", table(kind).columns, _name)


def _units(kind: str) -> Any:
    numbers = [column for column in table(kind).columns if column.dtype == "float64"]
    return _of_columns(f"_{kind}_units", numbers, _unit)


_Names: Any = _per_kind("_Names", _names)
_Units: Any = _per_kind("_Units", _units)


class ColumnsSection(_Names):
    """Our name of a column -> its name in the file, per kind of recording."""

    def of(self, kind: str) -> dict[str, str]:
        """Return the columns with a different name in files of this kind."""
        return _stated(getattr(self, kind))


class UnitsSection(_Units):
    """Our name of a column -> its unit in the file, per kind of recording."""

    def of(self, kind: str) -> dict[str, str | Calibration]:
        """Return the columns in another unit, or as a raw signal, in files of this kind."""
        return _stated(getattr(self, kind))


def _stated(section: Section) -> dict[str, Any]:
    return {name: value for name, value in section if value is not None}


class RunsOfKind(Section):
    """Where to find label and settings of a run if every run is a separate file, group or sheet.

    Attributes
    ----------
    pattern : str or None
        Pattern of the file names (or of the group names, if one file has all runs).
    table : Path or None
        CSV file with one row per file.
    fields : Section
        Names of the header fields with label and settings.
    values : Section
        Settings that apply to every run.
    """

    pattern: Annotated[str, BeforeValidator(pattern_of_names)] | None = None
    table: Annotated[Path, BeforeValidator(file_path)] | None = None
    fields: Any
    values: Any

    @field_serializer("table", when_used="json")
    def _table_name(self, table: Path | None) -> str | None:
        """Return the name without folder: results depend on the content, not on the place."""
        return None if table is None else table.name


def _runs(kind: str) -> Any:
    label = table(kind).column(table(kind).label)
    fields = _of_columns(f"_{kind}_fields", [label, *_settings(kind)], _name)
    values = _of_columns(f"_{kind}_values", _settings(kind), _value)
    keys = {"fields": (fields, fields()), "values": (values, values())}
    return _create_section(f"_{kind}_runs", RunsOfKind, keys)


_Runs: Any = _per_kind("_Runs", _runs)


class RunsSection(_Runs):
    """Label and settings of runs whose recordings lack them, per kind of recording."""

    def of(self, kind: str) -> RunsOfKind:
        """Return the section of a kind of recording."""
        runs: RunsOfKind = getattr(self, kind)
        return runs

    @property
    def tables(self) -> dict[str, Path]:
        """Paths of the stated tables, by kind of recording."""
        return {kind: path for kind in RECORDINGS if (path := self.of(kind).table) is not None}


class DialectSection(Section):
    """Dialect of the bench's CSV files; null: detected from the file.

    `names` are those of the columns of files without a header.
    """

    separator: Annotated[str, BeforeValidator(separating_character)] | None = None
    decimal: Literal[".", ","] | None = None
    thousands: Literal[".", ",", "'", " "] | None = None
    encoding: Annotated[str, BeforeValidator(text_encoding)] | None = None
    skip_lines: Annotated[int, Count(0, 10_000)] = 0
    names: (
        Annotated[
            tuple[Annotated[str, Text()], ...],
            ListOf("names of columns", "[run, time_s, force_N]", longest=2000),
        ]
        | None
    ) = None


class BeltSection(Section):
    """The belt: its name, which is also the results folder, type and section properties."""

    name: Annotated[str, BeforeValidator(folder_name)] = "5pk"
    type: Annotated[str, BeforeValidator(plain_words)] = "5PK"
    ribs: Annotated[int, Count(1, 100)] = 5
    axial_stiffness_N: Annotated[float, Number(1e2, 1e8, "N")] = 1.0e5
    bending_stiffness_N_m2: Annotated[float, Number(1e-8, 1e2, "N m²")] = 0.02
    mass_per_length_kg_m: Annotated[float, Number(1e-4, 1e2, "kg/m")] = 0.10
    damping_time_s: Annotated[float, Number(0, 1, "s")] = 1.0e-4
    shear_stiffness_N_m2: Annotated[float, Number(1e5, 1e12, "N/m²")] | None = None


class PressSection(Section):
    """The compression press: segment, reference temperature, machine, cycles."""

    segment_length_cm: Annotated[float, Number(0.1, 100, "cm")] = 4.0
    reference_temperature_degC: Annotated[float, Number(-60, 200, "°C")] = 22.0
    machine_compliance_mm_N: Annotated[float, Number(0, 1e-2, "mm/N")] = 0.0
    cycles: Literal["last", "first", "all"] = "last"


MeasuredKind = Literal["two_cells", "dead_weight", "torque", "torque_hub"]
RigKind = Literal[MeasuredKind, "running"]
Arcs = Annotated[
    tuple[Annotated[float, Number(0, 360, open_low=True, open_high=True)], ...],
    ListOf("contact arcs", "[40, 68, 82]"),
]
Tensions = Annotated[
    tuple[Annotated[float, Number(0, 1e5, "N", open_low=True)], ...],
    ListOf("tensions", "[100, 270, 410]"),
]
Speeds = Annotated[
    tuple[Annotated[float, Number(0, 1e4, "rad/s", open_low=True)], ...],
    ListOf("speeds", "[0.05, 0.21, 0.84]"),
]


class RigSection(Section):
    """The friction rig: what it measures, geometry, supports, and the settings of its runs.

    `weight_on` applies if one span carries a dead weight, `torque_with` if a torque and the tension
    of one span are measured: the errors act differently on the tight and the slack span. `slide`
    applies if a hub force is measured: the pulley moves freely under a constant force, as under a
    weight, or is held by its load cell, so that the force grows. On a `running` rig the belt moves
    at `belt_speed_m_s` (null: a column of the recording), and `running_measures` names the other
    kind that has the same channels.
    """

    kind: RigKind = "two_cells"
    weight_on: Literal["tight", "slack"] = "tight"
    torque_with: Literal["tight", "slack"] = "slack"
    slide: Literal["free", "held"] = "free"
    running_measures: MeasuredKind = "two_cells"
    belt_speed_m_s: Annotated[float, Number(0, 1e3, "m/s")] | None = None
    force_resolution_N: Annotated[float, Number(0, 1e4, "N")] | None = None
    pulley_radius_m: Annotated[float, Number(0.002, 5, "m")] = 0.05
    span_length_m: Annotated[float, Number(0.002, 10, "m")] = 0.10
    supports: Literal["pinned", "clamped"] = "pinned"
    arcs_deg: Arcs = (40.0, 68.0, 82.0)
    initial_tensions_N: Tensions = (50.0, 100.0, 160.0, 220.0, 270.0, 310.0, 360.0, 411.0)
    pulley_speeds_rad_s: Speeds = (0.05, 0.10, 0.21, 0.42, 0.84)

    @property
    def measures(self) -> MeasuredKind:
        """Kind of rig that has the channels of the recording; `running_measures` if running."""
        return self.running_measures if self.kind == "running" else self.kind

    @property
    def given_force(self) -> params.GivenForce:
        """Force that stays constant while the pulley turns.

        A dead weight fixes the tension of one span. A hub force fixes the sum of both, unless the
        pulley slide is held.
        """
        if self.kind == "dead_weight":
            return self.weight_on
        gives_way = self.kind == "torque_hub" and self.slide == "free"
        return "hub" if gives_way else "none"


class ConditionsSection(Section):
    """Conditions of the bench; null: not stated.

    They are passed on with the data and change no number. A column of the recording states them
    for each run and takes precedence. Runs on different surfaces, or on different sides of the
    belt, are never combined into one friction surface.
    """

    surface: Literal["dry", "wet", "dusty"] | None = None
    side: Literal["rib", "back"] | None = None


class ContactSection(Section):
    """Settings of the simulated contact that no bench measures."""

    damping_N_s_m: Annotated[float, Number(0, 1e7, "N s/m")] = 300.0
    points_per_element: Annotated[int, Count(1, 9)] = 5


Recorded = Annotated[Path, BeforeValidator(file_path)] | None


class DataSection(Section):
    """Paths of the recordings, and whether they are from a real bench.

    A relative path starts at the folder of the config. Results from synthetic recordings say so;
    an origin that is not stated stays unknown.
    """

    origin: Literal["measured", "synthetic"] | None = None
    press: Recorded = None
    rig: Recorded = None
    speedloss: Recorded = None

    @property
    def files(self) -> dict[str, Path]:
        """Paths of the stated recordings, by kind."""
        paths = {"press": self.press, "rig": self.rig, "speedloss": self.speedloss}
        return {kind: path for kind, path in paths.items() if path is not None}


class CompareSection(Section):
    """Tolerances between simulated and measured friction coefficients.

    With `hold_out`, `run` leaves out the runs of each arc or speed in turn and predicts them from
    the others.
    """

    max_rms_relative_error: Annotated[float, Number(0, 10, open_low=True)] = 0.06
    max_mean_relative_error: Annotated[float, Number(0, 10, open_low=True)] = 0.05
    max_relative_error: Annotated[float, Number(0, 10, open_low=True)] = 0.20
    hold_out: Literal["none", "arc", "speed"] = "arc"


Share = Annotated[float, Number(0, 0.5)]


class UncertaintySection(Section):
    """Standard uncertainties (k = 1) of calibrations and settings of the benches.

    ``_rel`` means relative to the value. The defaults are assumptions about a typical bench, not
    facts about this one: results show for each whether it was stated or assumed.
    """

    tension_gain_rel: Share = 0.002
    cell_gain_rel: Share = 0.001
    cell_offset_N: Annotated[float, Number(0, 1e3, "N")] = 0.05
    torque_gain_rel: Share = 0.005
    bearing_drag_N_m: Annotated[float, Number(0, 1e3, "N m")] = 0.01
    mass_per_length_rel: Share = 0.02
    arc_deg: Annotated[float, Number(0, 20, "°")] = 0.1
    arc_setting_deg: Annotated[float, Number(0, 20, "°")] = 0.2
    pulley_radius_rel: Share = 0.002
    span_length_m: Annotated[float, Number(0, 1, "m")] = 5.0e-4
    pulley_speed_rel: Share = 0.002
    bending_stiffness_rel: Share = 0.05
    axial_stiffness_rel: Share = 0.05
    press_force_rel: Share = 0.005
    press_displacement_rel: Share = 0.002
    segment_length_rel: Share = 0.005
    machine_compliance_mm_N: Annotated[float, Number(0, 1e-2, "mm/N")] = 1.0e-6
    drive_radius_rel: Share = 0.002
    drive_centres_m: Annotated[float, Number(0, 1, "m")] = 5.0e-4
    initial_tension_rel: Share = 0.01
    torque_rel: Share = 0.005


class FrictionSection(Section):
    """Reduction of a rig run to a friction coefficient.

    The calibration of the load cells is applied first: T = gain (reading - tare). Zeros that still
    show at rest are corrected next.
    """

    tension_tight_tare_N: Annotated[float, Number(-1e4, 1e4, "N")] = 0.0
    tension_slack_tare_N: Annotated[float, Number(-1e4, 1e4, "N")] = 0.0
    tension_tight_gain: Annotated[float, Number(0.1, 10)] = 1.0
    tension_slack_gain: Annotated[float, Number(0.1, 10)] = 1.0
    correct_temperature: bool = False
    reference_temperature_degC: Annotated[float, Number(-60, 200, "°C")] | None = None


class SimulationSection(Section):
    """Simulation of the rig; null: chosen by the program."""

    method: Literal["transient", "steady"] = "transient"
    elements: Annotated[int, Count(4, 2000, even=True)] | None = None
    friction_solver: Literal["newton", "lemke"] = "newton"
    sticking_ratio: Annotated[float, Number(1, 5)] = 1.0


Minutes = Annotated[float, Number(0, 1e4)]


class PlanSection(Section):
    """Candidate settings of the next runs and the time they take; null: the settings under rig:."""

    arcs_deg: Arcs | None = None
    tension_N: Tensions | None = None
    speed_rad_s: Speeds | None = None
    minutes_per_run: Minutes = 5.0
    minutes_per_arc_change: Minutes = 30.0


class Config(Section):
    """A belt, its benches, and the settings of every stage.

    The defaults are the rig of the paper with a 5PK belt. Create it with
    :func:`beltid.load_config`, which writes readable error messages.
    """

    belt: BeltSection = BeltSection()
    press: PressSection = PressSection()
    rig: RigSection = RigSection()
    conditions: ConditionsSection = ConditionsSection()
    contact: ContactSection = ContactSection()
    data: DataSection = DataSection()
    compare: CompareSection = CompareSection()
    friction: FrictionSection = FrictionSection()
    simulation: SimulationSection = SimulationSection()
    drive: DriveSection = DriveSection()
    compare_drive: CompareDriveSection = CompareDriveSection()
    plan: PlanSection = PlanSection()
    uncertainty: UncertaintySection = UncertaintySection()
    columns: ColumnsSection = ColumnsSection()
    units: UnitsSection = UnitsSection()
    runs: RunsSection = RunsSection()
    dialect: DialectSection = DialectSection()

    def belt_params(self) -> params.Belt:
        """Return the section properties of the belt."""
        b = self.belt
        return params.Belt(
            EA=b.axial_stiffness_N,
            EI=b.bending_stiffness_N_m2,
            rhoA=b.mass_per_length_kg_m,
            damping_time=b.damping_time_s,
        )

    def rig_params(self) -> params.Rig:
        """Return the geometry of the rig."""
        r = self.rig
        return params.Rig(
            R=r.pulley_radius_m,
            span=r.span_length_m,
            supports=r.supports,
            given_force=r.given_force,
        )

    def contact_params(self) -> params.Contact:
        """Return the settings of the contact."""
        return params.Contact(
            C_P=self.contact.damping_N_s_m,
            points_per_element=self.contact.points_per_element,
            sticking_ratio=self.simulation.sticking_ratio,
        )

    @property
    def sha256(self) -> str:
        """SHA-256 of everything that can change a result: every section except `data`.

        The place of a recording does not matter; its content has a separate hash.
        """
        return self.section_sha256(*(name for name in type(self).model_fields if name != "data"))

    def section_sha256(self, *sections: str) -> str:
        """Compute the SHA-256 of some sections, independent of the formatting of the file.

        Parameters
        ----------
        *sections : str
            Names of sections, such as ``"belt"``; their order does not matter.

        Raises
        ------
        KeyError
            If the config has no such section.
        """
        values: dict[str, Any] = self.model_dump(mode="json")
        chosen = {name: values[name] for name in sections}
        text = json.dumps(chosen, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()
