"""What a config holds: belt, benches and their files, and the settings of every stage.

The model is closed (an unknown key is an error) and frozen. The defaults are the built-in rig of
the paper with a 5PK belt, so an empty config is a complete one. The sections that tell how the
files of a bench differ from ours (names of columns, units, dialect) have a key for each column of
the table of its kind of recording, so they are built from the tables.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import (
    BeforeValidator,
    Strict,
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
    auto_or_switch,
    file_path,
    folder_name,
    pattern_of_names,
    separating_character,
    text_encoding,
    time_zone_name,
)
from beltid.tables.columns import Column
from beltid.tables.schemas import RECORDINGS, SETTINGS, table
from beltid.tables.units import Calibration

SHOWN: Final = {"deg": "°", "degC": "°C"}
"""Unit of a column -> how a config shows it."""


def _built(name: str, base: type[Section], keys: dict[str, Any]) -> Any:
    """A section as a class of this module: a config is pickled for worker processes."""
    section = create_model(name, __base__=base, __module__=__name__, **keys)
    globals()[name] = section
    return section


def _of_columns(name: str, columns: Iterable[Column], allowed: Callable[[Column], Any]) -> Any:
    """A section with a key for each column; null where nothing is stated."""
    keys = {column.name: (allowed(column) | None, None) for column in columns}
    return _built(name, Unstated, keys)


def _per_kind(name: str, section_of: Callable[[str], Any]) -> Any:
    """A section with a section for each kind of recording."""
    sections = {kind: section_of(kind) for kind in RECORDINGS}
    return _built(name, Section, {kind: (of, of()) for kind, of in sections.items()})


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
        """The columns that are named otherwise in files of this kind."""
        return _stated(getattr(self, kind))


class UnitsSection(_Units):
    """Our name of a column -> its unit in the file, per kind of recording."""

    def of(self, kind: str) -> dict[str, str | Calibration]:
        """The columns that come in another unit, or as a raw signal, in files of this kind."""
        return _stated(getattr(self, kind))


def _stated(section: Section) -> dict[str, Any]:
    return {name: value for name, value in section if value is not None}


class RunsOfKind(Section):
    """Where to find label and settings of a run that is a file, group or sheet of its own.

    Attributes
    ----------
    pattern : str or None
        How the names of the files (of the groups, where one file holds all runs) are made up.
    table : Path or None
        A CSV file with a row per file.
    fields : Section
        Names of the header fields that hold label and settings.
    values : Section
        Settings that hold for every run.
    """

    pattern: Annotated[str, BeforeValidator(pattern_of_names)] | None = None
    table: Annotated[Path, BeforeValidator(file_path)] | None = None
    fields: Any
    values: Any

    @field_serializer("table", when_used="json")
    def _table_name(self, table: Path | None) -> str | None:
        """The name without its folder: where a table lies changes no result, its content does."""
        return None if table is None else table.name


def _runs(kind: str) -> Any:
    label = table(kind).column(table(kind).label)
    fields = _of_columns(f"_{kind}_fields", [label, *_settings(kind)], _name)
    values = _of_columns(f"_{kind}_values", _settings(kind), _value)
    keys = {"fields": (fields, fields()), "values": (values, values())}
    return _built(f"_{kind}_runs", RunsOfKind, keys)


_Runs: Any = _per_kind("_Runs", _runs)


class RunsSection(_Runs):
    """Label and settings of runs whose recordings do not hold them, per kind of recording."""

    def of(self, kind: str) -> RunsOfKind:
        """What is said about the runs of a kind of recording."""
        runs: RunsOfKind = getattr(self, kind)
        return runs

    @property
    def tables(self) -> dict[str, Path]:
        """The tables that are named, by the kind of recording."""
        return {kind: found for kind in RECORDINGS if (found := self.of(kind).table) is not None}


class DialectSection(Section):
    """How the CSV files of the bench are written; null means: found out from the file."""

    separator: Annotated[str, BeforeValidator(separating_character)] | None = None
    decimal: Literal[".", ","] | None = None
    thousands: Literal[".", ",", "'", " "] | None = None
    encoding: Annotated[str, BeforeValidator(text_encoding)] | None = None
    time_zone: Annotated[str, BeforeValidator(time_zone_name)] | None = None
    skip_lines: Annotated[int, Count(0, 10_000)] = 0
    units_row: Annotated[bool, Strict()] = False


class BeltSection(Section):
    """The belt: name of the results' folder, type, and the properties of its cross section."""

    name: Annotated[str, BeforeValidator(folder_name)] = "5pk"
    type: Annotated[str, Text(40)] = "5PK"
    ribs: Annotated[int, Count(1, 100)] = 5
    width_m: Annotated[float, Number(1e-3, 2, "m")] | None = None
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
    force_gain: Annotated[float, Number(0.1, 10)] = 1.0
    displacement_gain: Annotated[float, Number(0.1, 10)] = 1.0
    cycles: Literal["last", "first", "all"] = "last"
    loading_only: bool = False


MeasuredKind = Literal["two_cells", "dead_weight", "torque", "torque_hub"]
RigKind = Literal[MeasuredKind, "running"]
BinEdge = Annotated[float, Number(0, 1e4, "rad/s")]
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

    `weight_on` counts where one span hangs on a dead weight, `torque_with` where the tension of one
    span is measured beside a torque: which one it is decides how its errors act. `slide` counts
    where a hub force is measured: whether the pulley gives way until the force is that at rest, as
    under a weight, or is held by its load cell, so that the force grows. On a `running` rig
    the belt moves at `belt_speed_m_s` (null: a column of the recording), and `running_measures`
    says which of the other kinds its channels are those of.
    """

    kind: RigKind = "two_cells"
    weight_on: Literal["tight", "slack"] = "tight"
    torque_with: Literal["tight", "slack"] = "slack"
    slide: Literal["free", "held"] = "free"
    running_measures: MeasuredKind = "two_cells"
    belt_speed_m_s: Annotated[float, Number(0, 1e3, "m/s")] | None = None
    speed_bins_rad_s: (
        Annotated[
            tuple[BinEdge, ...], ListOf("edges of speed bins", "[0.1, 0.2, 0.4, 0.8]", fewest=2)
        ]
        | None
    ) = None
    force_resolution_N: Annotated[float, Number(0, 1e4, "N")] | None = None
    pulley_radius_m: Annotated[float, Number(0.002, 5, "m")] = 0.05
    span_length_m: Annotated[float, Number(0.002, 10, "m")] = 0.10
    supports: Literal["pinned", "clamped"] = "pinned"
    arcs_deg: Arcs = (40.0, 68.0, 82.0)
    initial_tensions_N: Tensions = (50.0, 100.0, 160.0, 220.0, 270.0, 310.0, 360.0, 411.0)
    pulley_speeds_rad_s: Speeds = (0.05, 0.10, 0.21, 0.42, 0.84)

    @property
    def measures(self) -> MeasuredKind:
        """The kind whose channels the recording has: that of the rig, or what it is if running."""
        return self.running_measures if self.kind == "running" else self.kind

    @property
    def given_force(self) -> params.GivenForce:
        """The force that stays what it was before the pulley turned.

        A dead weight is that of one span, a hub force that of both together unless the slide of the
        pulley is held. On a running rig the spans share the length of one belt: what one gains the
        other loses, as under a hub force.
        """
        if self.kind == "dead_weight":
            return self.weight_on
        gives_way = self.kind == "torque_hub" and self.slide == "free"
        return "hub" if gives_way or self.kind == "running" else "none"


class PulleyConditions(Section):
    """The pulley that the belt rubs on."""

    material: Annotated[str, Text(40)] | None = None
    roughness_Ra_um: Annotated[float, Number(0, 1e3, "µm")] | None = None


class ConditionsSection(Section):
    """Under which conditions a bench was run; null where nobody stated it.

    They travel with the data and change no number. A column of the recording states them run by
    run, which then counts. What was measured on another surface, or on the other side of the belt,
    is never put into one friction surface.
    """

    surface: Literal["dry", "wet", "dusty"] | None = None
    side: Literal["rib", "back"] | None = None
    humidity_percent: Annotated[float, Number(0, 100, "%")] | None = None
    hours_run: Annotated[float, Number(0, 1e6, "h")] | None = None
    pulley: PulleyConditions = PulleyConditions()


class ContactSection(Section):
    """Settings of the simulated contact that no bench measures."""

    damping_N_s_m: Annotated[float, Number(0, 1e7, "N s/m")] = 300.0
    points_per_element: Annotated[int, Count(1, 9)] = 5


Recorded = Annotated[Path, BeforeValidator(file_path)] | None


class DataSection(Section):
    """Where the recordings are, and whether they are of a real bench.

    A relative path counts from the folder of the config. Whatever is made from recordings of
    synthetic origin says so; an origin that is not stated stays unknown. `date` is when the
    recordings were made, of those that do not tell it themselves.
    """

    origin: Literal["measured", "synthetic"] | None = None
    press: Recorded = None
    rig: Recorded = None
    speedloss: Recorded = None
    date: Annotated[str, Text(40)] | None = None

    @property
    def files(self) -> dict[str, Path]:
        """The recordings that are named, by their kind."""
        named = {"press": self.press, "rig": self.rig, "speedloss": self.speedloss}
        return {kind: path for kind, path in named.items() if path is not None}


class CompareSection(Section):
    """How far the simulated friction coefficients may be from the measured ones.

    `hold_out` says whose runs `run` leaves out in turn, to predict them from the others.
    """

    max_rms_relative_error: Annotated[float, Number(0, 10, open_low=True)] = 0.06
    max_mean_relative_error: Annotated[float, Number(0, 10, open_low=True)] = 0.05
    max_relative_error: Annotated[float, Number(0, 10, open_low=True)] = 0.20
    max_rms_error_over_uncertainty: Annotated[float, Number(0, 100, open_low=True)] | None = None
    hold_out: Literal["none", "arc", "speed"] = "arc"


Share = Annotated[float, Number(0, 0.5)]


class UncertaintySection(Section):
    """Standard uncertainties (k = 1) of what the benches were calibrated and set to.

    ``_rel`` is a share of the value. The defaults are assumptions about a bench of a usual class,
    not facts about this one: results say of each whether it was stated or assumed.
    """

    tension_gain_rel: Share = 0.002
    cell_gain_rel: Share = 0.001
    cell_linearity_rel: Share = 0.0
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
    """How a run of the friction rig is reduced to a friction coefficient.

    What is known of the load cells comes first: T = gain (reading - tare) / cos(tilt), with the
    angle between the span and the axis of its cell; then the imbalance that is left.
    """

    min_plateau_samples: Annotated[int, Count(8, 1_000_000)] = 12
    spike_threshold: Annotated[float, Number(3, 100)] = 6.0
    correct_imbalance: Annotated[Literal["auto"] | bool, BeforeValidator(auto_or_switch)] = "auto"
    tension_tight_tare_N: Annotated[float, Number(-1e4, 1e4, "N")] = 0.0
    tension_slack_tare_N: Annotated[float, Number(-1e4, 1e4, "N")] = 0.0
    tension_tight_gain: Annotated[float, Number(0.1, 10)] = 1.0
    tension_slack_gain: Annotated[float, Number(0.1, 10)] = 1.0
    tension_tight_tilt_deg: Annotated[float, Number(-60, 60, "°")] = 0.0
    tension_slack_tilt_deg: Annotated[float, Number(-60, 60, "°")] = 0.0
    check_initial_tension: bool = True
    correct_temperature: bool = False
    reference_temperature_degC: Annotated[float, Number(-60, 200, "°C")] | None = None
    max_mu: Annotated[float, Number(0.01, 100)] = 3.0


class SurfaceSection(Section):
    """How the friction surface is built: number of common nodes of the normal force."""

    force_nodes: Annotated[int, Count(2, 200)] | None = None


class SlipSection(Section):
    """How many pulley speeds the friction rig is to run."""

    n_speeds: Annotated[int, Count(2, 50)] = 5


class SimulationSection(Section):
    """How the rig is simulated; null leaves a number to the program."""

    method: Literal["transient", "steady"] = "transient"
    elements: Annotated[int, Count(4, 2000, even=True)] | None = None
    steps_per_run: Annotated[int, Count(52, 100_000)] | None = None
    friction_solver: Literal["newton", "lemke"] = "newton"
    sticking_ratio: Annotated[float, Number(1, 5)] = 1.0


Minutes = Annotated[float, Number(0, 1e4)]


class PlanSection(Section):
    """What the next runs may be set to, and the time they take; null: the settings of the rig."""

    arcs_deg: Arcs | None = None
    tension_N: Tensions | None = None
    speed_rad_s: Speeds | None = None
    minutes_per_run: Minutes = 5.0
    minutes_per_arc_change: Minutes = 30.0


class Config(Section):
    """A belt, its benches, and the settings of every stage.

    The defaults are the rig of the paper with a 5PK belt. Values are made by
    :func:`beltid.load_config`, which words the errors.
    """

    belt: BeltSection = BeltSection()
    press: PressSection = PressSection()
    rig: RigSection = RigSection()
    conditions: ConditionsSection = ConditionsSection()
    contact: ContactSection = ContactSection()
    data: DataSection = DataSection()
    compare: CompareSection = CompareSection()
    friction: FrictionSection = FrictionSection()
    surface: SurfaceSection = SurfaceSection()
    slip: SlipSection = SlipSection()
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
        """Section properties of the belt for the science."""
        b = self.belt
        return params.Belt(
            EA=b.axial_stiffness_N,
            EI=b.bending_stiffness_N_m2,
            rhoA=b.mass_per_length_kg_m,
            damping_time=b.damping_time_s,
        )

    def rig_params(self) -> params.Rig:
        """Geometry of the rig for the science."""
        r = self.rig
        return params.Rig(
            R=r.pulley_radius_m,
            span=r.span_length_m,
            supports=r.supports,
            given_force=r.given_force,
        )

    def contact_params(self) -> params.Contact:
        """Settings of the contact for the science."""
        return params.Contact(
            C_P=self.contact.damping_N_s_m,
            points_per_element=self.contact.points_per_element,
            sticking_ratio=self.simulation.sticking_ratio,
        )

    @property
    def sha256(self) -> str:
        """SHA-256 of all that can change a result: every section but `data`.

        Where a recording lies does not matter, what it holds does; its own hash covers that.
        """
        return self.section_sha256(*(name for name in type(self).model_fields if name != "data"))

    def section_sha256(self, *sections: str) -> str:
        """SHA-256 of the values of some sections, independent of how the file was written.

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
