"""The config model: belt, benches and their files, and the settings of every stage.

The model is closed (an unknown key is an error) and frozen. The defaults are the rig of the paper
with a 5PK belt, so an empty config is complete.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Literal, Self, cast

from pydantic import PrivateAttr, field_serializer

from beltid import params
from beltid.config import checks
from beltid.config.checks import Section, key, number, settings
from beltid.tables.schemas import SETTINGS, Column, table

RigKind = Literal["two_cells", "dead_weight", "torque", "torque_hub"]
Side = Literal["rib", "back"]
Numbers = tuple[float, ...]

HOLDS: dict[str, tuple[params.GivenForce, RigKind]] = {
    "stretch": ("none", "two_cells"),
    "weight_tight": ("tight", "dead_weight"),
    "weight_slack": ("slack", "dead_weight"),
    "hub_force": ("hub", "torque_hub"),
}
"""What stays while the pulley turns -> given force; what is measured, if no channels are known."""
_arcs = partial(settings, 360, "°", "[40, 68, 82]")
_tensions = partial(settings, 1e5, "N", "[100, 270, 410]")
_speeds = partial(settings, 1e4, "rad/s", "[0.05, 0.21, 0.84]")


def _share(default: float, meaning: str, high: float = 0.5, *, open_low: bool = False) -> Any:
    return number(default, 0, high, "", meaning, open_low=open_low)


def _tolerance(default: float, meaning: str) -> Any:
    return _share(default, meaning, 10, open_low=True)


class BeltSection(Section):
    """The belt."""

    name: str = key("5pk", "names the folder of the results", checks.folder_name)
    type: str = key("5PK", "designation; 5PK: five ribs of the profile PK", checks.plain_words)
    ribs: int = number(5, 1, 100, "", "number of ribs", whole=True)
    axial_stiffness_N: float = number(1e5, 1e2, 1e8, "N", "EA, from a tensile test")
    bending_stiffness_N_m2: float = number(0.02, 1e-8, 1e2, "N m²", "EI; biases the rig's mu")
    mass_per_length_kg_m: float = number(0.1, 1e-4, 1e2, "kg/m", "matters only in motion")
    damping_time_s: float = number(1e-4, 0, 1, "s", "Kelvin-Voigt c/E; matters only in motion")
    shear_stiffness_N_m2: float | None = number(
        None, 1e5, 1e12, "N/m²", "of the ribs along the belt; a drive takes them as rigid"
    )


class PressSection(Section):
    """Compression press: a segment of belt pressed into a grooved plate."""

    segment_length_cm: float = number(4.0, 0.1, 100, "cm", "length of belt under the press")
    reference_temperature_degC: float = number(22.0, -60, 200, "°C", "that the law is given at")
    machine_compliance_mm_N: float = number(0.0, 0, 1e-2, "mm/N", "deflection of the press itself")
    cycles: Literal["last", "first", "all"] = key("last", "used; new rubber is stiffer at first")


class RigSection(Section):
    """Friction rig: the belt lies still over a turning pulley."""

    holds: Literal["stretch", "weight_tight", "weight_slack", "hub_force"] | None = key(
        None, "what stays while the pulley turns; null: by the channels"
    )
    weight_N: float | None = number(None, 0, 1e5, "N", "dead weight of all runs; null: a column")
    force_resolution_N: float | None = number(None, 0, 1e4, "N", "in a table of plateaus")
    pulley_radius_m: float = number(0.05, 0.002, 5, "m", "radius of the belt's centreline on it")
    span_length_m: float = number(0.1, 0.002, 10, "m", "free belt from a load cell to the pulley")
    supports: Literal["pinned", "clamped"] = key("pinned", "how the cells hold the belt")
    arcs_deg: Numbers = _arcs((40.0, 68.0, 82.0), "contact arcs; default: of the recording")
    initial_tensions_N: Numbers = _tensions(
        (50.0, 100.0, 160.0, 220.0, 270.0, 310.0, 360.0, 411.0), "before the pulley turns; likewise"
    )
    pulley_speeds_rad_s: Numbers = _speeds(
        (0.05, 0.10, 0.21, 0.42, 0.84), "pulley speeds; likewise"
    )

    _shown: Mapping[str, str] = PrivateAttr(default_factory=dict)  # by the channels

    @property
    def kind(self) -> RigKind:
        """What the rig measures, by the channels, else by what it holds."""
        return cast(RigKind, self._shown.get("kind", HOLDS[self.holds or "stretch"][1]))

    @property
    def running(self) -> bool:
        """Whether the belt moves."""
        return "running" in self._shown

    @property
    def weight_on(self) -> Literal["tight", "slack"]:
        """Span that carries a weight."""
        return "slack" if self.holds == "weight_slack" else "tight"

    @property
    def given_force(self) -> params.GivenForce:
        """Force that stays constant while the pulley turns: where it is not stated, as measured."""
        return HOLDS[self.holds or ("hub_force" if self.kind == "torque_hub" else "stretch")][0]


class ConditionsSection(Section):
    """Conditions of the rig, passed on with the results; null: not stated.

    They change no number. A column of the recording takes precedence. Runs of different conditions
    are never combined into one friction surface.
    """

    surface: Literal["dry", "wet", "dusty"] | None = key(None, "state of the contact surface")
    side: Side | None = key(None, "side of the belt on the pulley")


class ContactSection(Section):
    """Contact of the simulated rig; no bench measures these."""

    damping_N_s_m: float = number(300.0, 0, 1e7, "N s/m", "C_P; sliding does not depend on it")
    points_per_element: int = number(9, 1, 9, "", "contact points per belt element", whole=True)


class DataSection(Section):
    """Recordings; relative paths start at the folder of this file."""

    origin: Literal["measured", "synthetic"] | None = key(None, "results of synthetic data say so")
    press: Path | None = key(None, "recording of the press", checks.file_path)
    rig: Path | None = key(None, "recording of the friction rig", checks.file_path)
    speedloss: Path | None = key(None, "of the two-pulley drive; optional", checks.file_path)

    @property
    def files(self) -> dict[str, Path]:
        """Paths of the stated recordings, by kind."""
        return {kind: path for kind in KINDS if (path := getattr(self, kind)) is not None}


class CompareSection(Section):
    """Tolerances of simulated against measured friction coefficients, as shares of mu."""

    max_rms_relative_error: float = _tolerance(0.06, "root mean square over all runs")
    max_mean_relative_error: float = _tolerance(0.05, "mean magnitude")
    max_relative_error: float = _tolerance(0.20, "largest")


class CrossValidateSection(Section):
    """Runs that are left out and predicted from the others."""

    by: Literal["none", "arc", "speed"] = key("arc", "setting that is left out")


class UncertaintySection(Section):
    """Standard uncertainties (k = 1) of benches and settings; _rel: share of value.

    The defaults are assumptions about a typical bench, not facts about this one: results show for
    each whether it was stated or assumed.
    """

    tension_gain_rel: float = _share(0.002, "calibration that both load cells share")
    cell_gain_rel: float = _share(0.002, "calibration of each load cell")
    cell_hysteresis_rel: float = _share(0.0005, "each load cell, of the change since rest")
    cell_offset_N: float = number(0.05, 0, 1e3, "N", "zero of each load cell")
    torque_gain_rel: float = _share(0.005, "torque of the friction rig")
    bearing_drag_N_m: float = number(0.01, 0, 1e3, "N m", "drag and zero left in that torque")
    mass_per_length_rel: float = _share(0.02, "running: mass per length of the belt")
    arc_deg: float = number(0.1, 0, 20, "°", "contact arc, the same error in all runs")
    arc_setting_deg: float = number(0.2, 0, 20, "°", "contact arc, a new error at each setting")
    pulley_radius_rel: float = _share(0.002, "radius of the belt's centreline")
    span_length_m: float = number(5e-4, 0, 1, "m", "length of the free spans")
    pulley_speed_rel: float = _share(0.002, "speed of the pulley")
    bending_stiffness_rel: float = _share(0.05, "EI")
    axial_stiffness_rel: float = _share(0.05, "EA")
    press_force_rel: float = _share(0.005, "load cell of the press")
    press_displacement_rel: float = _share(0.002, "travel of the press")
    press_law_rel: float = _share(0.05, "contact law in service against the press")
    segment_length_rel: float = _share(0.005, "length of belt under the press")
    machine_compliance_mm_N: float = number(1e-6, 0, 1e-2, "mm/N", "compliance of the press")
    drive_radius_rel: float = _share(0.002, "radius of each pulley of a drive")
    drive_centres_m: float = number(5e-4, 0, 1, "m", "position of each pulley of a drive")
    initial_tension_rel: float = _share(0.01, "belt tension of a drive at rest")
    torque_rel: float = _share(0.005, "torque of the speed-loss bench")


class FrictionSection(Section):
    """Reduction of a rig run: tension = gain (reading - tare), then zeros that show at rest."""

    tension_tight_tare_N: float = number(0.0, -1e4, 1e4, "N", "of the tight cell")
    tension_slack_tare_N: float = number(0.0, -1e4, 1e4, "N", "of the slack cell")
    tension_tight_gain: float = number(1.0, 0.1, 10, "", "of the tight cell")
    tension_slack_gain: float = number(1.0, 0.1, 10, "", "of the slack cell")
    free_at_rest: bool = key(False, "the pulley was rocked free before the rest: it shows gains")
    correct_temperature: bool = key(False, "refine-surface refers all runs to one temperature")
    reference_temperature_degC: float | None = number(None, -60, 200, "°C", "null: their mean")


class SimulationSection(Section):
    """Simulation of the rig."""

    method: Literal["transient", "steady"] = key("transient", "through time, or sliding alone")
    elements: int | None = number(
        None, 4, 2000, "", "of the belt; null: as many as needed", whole=True, even=True
    )
    friction_solver: Literal["newton", "lemke"] = key("newton", "of each time step")
    sticking_ratio: float = number(1.0, 1, 5, "", "static over slowest measured sliding friction")


class PulleySection(Section):
    """A pulley of a drive."""

    name: str = key(..., "its name", checks.text)
    x_m: float = number(..., -100, 100, "m", "centre")
    y_m: float = number(..., -100, 100, "m", "centre")
    radius_m: float = number(..., 0.002, 5, "m", "radius of the belt's centreline")
    side: Side = key("rib", "side of the belt in contact")


class TensionerSection(Section):
    """A sprung arm that carries a pulley, whose coordinates are its mean position."""

    pulley: str = key(..., "name of the pulley on it", checks.text)
    pivot_m: tuple[float, float] = key(
        ..., "its axis", checks.ListOf("[-0.18, 0.10]", 2, checks.Number(-100, 100, "m"))
    )
    arm_m: float = number(..., 0.001, 10, "m", "its length")
    free_angle_deg: float = number(..., -360, 360, "°", "of the pulley about the pivot, at the end")
    preload_N_m: float = number(..., 0, 1e4, "N m", "moment at that angle")
    rate_N_m_deg: float = number(..., 0, 1e3, "N m/°", "its growth")
    stops_deg: tuple[float, float] | None = key(
        None,
        "angles at the stops; null: none",
        checks.ListOf("[-10, 60]", 2, checks.Number(-720, 720, "°")),
    )


class OperatingPointsSection(Section):
    """Operating points: lists of equal length; a single number applies to all points."""

    driver_speed_rad_s: Numbers = key(
        (62.8,),
        "speed of the driver",
        checks.ListOf("[22, 62.8]", 100_000, checks.Number(-1e4, 1e4, "rad/s")),
    )
    torque_N_m: dict[str, Numbers] = key({}, "taken off, by pulley", checks.lists_by_name)
    power_W: dict[str, Numbers] = key({}, "taken off, by pulley", checks.lists_by_name)


class DriveSection(Section):
    """A belt drive: pulleys in the order of the belt, installation, operating points."""

    method: Literal["string", "rod"] = key("rod", "rod: with bending stiffness")
    installation: Literal["fixed_centres", "slack_force", "tensioner"] = key(
        "fixed_centres", "what keeps the belt taut"
    )
    initial_tension_N: Numbers | None = _tensions(None, "at rest, or of the slack span")
    pulleys: tuple[PulleySection, ...] = key(
        (
            PulleySection(name="driver", x_m=0.0, y_m=0.0, radius_m=0.05),
            PulleySection(name="driven", x_m=0.25, y_m=0.0, radius_m=0.05),
        ),
        "in the order of the belt",
        checks.ListOf("[{name: ...}]", 30),
    )
    driver: str | None = key(None, "null: the first pulley", checks.text)
    tensioner: TensionerSection | None = key(None, "with installation: tensioner")
    operating_points: OperatingPointsSection = OperatingPointsSection()
    belt_length_m: float | None = number(
        None, 0.05, 100, "m", "stress-free; null: as initial_tension_N or the tensioner ask for"
    )
    belt_length_tolerance_m: float = number(
        0.0, 0, 1, "m", "of its length, with temperature and wear"
    )
    back_friction: float = number(0.5, 0.01, 5, "", "friction coefficient of the back")
    idler_torque_N_m: float = number(0.0, 0, 1e3, "N m", "drag of a pulley without load")

    @property
    def driving(self) -> str:
        """Name of the driving pulley: the first one unless another is stated."""
        return self.driver or self.pulleys[0].name


class CompareDriveSection(Section):
    """Tolerance of predicted against measured speed loss of a drive."""

    max_rms_relative_error: float = _tolerance(0.10, "root mean square over all judged points")
    min_torque_share: float = _share(0.2, "of the largest; points below are not judged", 1)


class PlanSection(Section):
    """Candidate settings of the next runs and the time they take; null: the settings under rig:."""

    arcs_deg: Numbers | None = _arcs(None, "contact arcs")
    tension_N: Numbers | None = _tensions(None, "initial tensions")
    speed_rad_s: Numbers | None = _speeds(None, "pulley speeds")
    minutes_per_run: float = number(5.0, 0, 1e4, "", "time of a run")
    minutes_per_arc_change: float = number(30.0, 0, 1e4, "", "time to change the arc")


class DialectSection(Section):
    """Dialect of the bench's text files; null: detected from the file."""

    separator: str | None = key(None, "character between cells", checks.separating_character)
    decimal: Literal[".", ","] | None = key(None, "decimal sign")
    thousands: Literal[".", ",", "'", " "] | None = key(None, "sign between thousands")
    encoding: str | None = key(None, "such as utf-8 or cp1252", checks.text_encoding)
    skip_lines: int = number(0, 0, 10_000, "", "lines before the table", whole=True)
    names: tuple[str, ...] | None = key(
        None,
        "of the columns of a file without a header",
        checks.ListOf("[run, time_s, force_N]", 2000, checks.text),
    )


KINDS = ("press", "rig", "speedloss")
SYMBOLS = {"deg": "°", "degC": "°C"}  # unit of a column -> its symbol in a config


def _value(column: Column) -> checks.Check:
    """Return the check of a setting that the config states for all runs."""

    def choice(value: Any) -> Any:
        if value not in column.choices:
            raise checks.complain(column.allowed)
        return value

    if column.dtype == "string":
        return choice if column.choices else checks.text
    unit = SYMBOLS.get(column.unit, column.unit)
    return checks.Number(column.low, column.high, unit, column.open_low, column.open_high)


def _by_kind(check: Callable[[Column], checks.Check | None]) -> dict[str, checks.Keys]:
    """Return the checks of columns by kind; those of the rig serve its plateaus, too."""
    found = {}
    for kind in KINDS:
        columns = (*(table("points").columns if kind == "rig" else ()), *table(kind).columns)
        found[kind] = checks.Keys({c.name: of for c in columns if (of := check(c))})
    return found


_FILES = {"pattern": checks.pattern_of_names, "table": checks.file_path}
_VALUES = _by_kind(lambda c: _value(c) if c.name in SETTINGS else None)
COLUMNS = checks.Keys(_by_kind(lambda c: checks.text))
UNITS = checks.Keys(_by_kind(lambda c: checks.unit_of(c.unit) if c.dtype == "float64" else None))
RUNS = checks.Keys(
    {k: checks.Keys({**_FILES, "values": of}, dict.fromkeys(_FILES)) for k, of in _VALUES.items()}
)


class Config(Section):
    """A belt, its benches, and the settings of every stage.

    Create it with :func:`beltid.load_config`, which writes readable error messages.

    `columns`, `units` and `runs` say how the files of the bench differ from ours, by kind of
    recording: ``config.columns["rig"]`` maps our name to theirs, ``config.units["rig"]`` our name
    to a unit or to ``{"factor": ..., "offset": ...}``; ``config.runs["rig"]`` holds `pattern`,
    `table` and `values`.
    """

    belt: BeltSection = BeltSection()
    press: PressSection = PressSection()
    rig: RigSection = RigSection()
    conditions: ConditionsSection = ConditionsSection()
    contact: ContactSection = ContactSection()
    data: DataSection = DataSection()
    compare: CompareSection = CompareSection()
    cross_validate: CrossValidateSection = CrossValidateSection()
    friction: FrictionSection = FrictionSection()
    simulation: SimulationSection = SimulationSection()
    drive: DriveSection = DriveSection()
    compare_drive: CompareDriveSection = CompareDriveSection()
    plan: PlanSection = PlanSection()
    uncertainty: UncertaintySection = UncertaintySection()
    columns: dict[str, dict[str, str]] = key(COLUMNS({}), "", COLUMNS)
    units: dict[str, dict[str, str | dict[str, float]]] = key(UNITS({}), "", UNITS)
    runs: dict[str, dict[str, Any]] = key(RUNS({}), "", RUNS)
    dialect: DialectSection = DialectSection()

    def with_rig(self, shown: Mapping[str, str]) -> Self:
        """Return the config with what channels show of the rig: kind, holds if not stated."""
        rig = self.rig.model_copy(update={"holds": self.rig.holds or shown.get("holds")})
        rig._shown = dict(shown)
        return self.model_copy(update={"rig": rig}) if shown else self

    @field_serializer("runs", when_used="json")
    def _without_folders(self, runs: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        """Return tables by their name alone: results depend on the content, not on the place."""
        return {
            kind: {**of_kind, "table": of_kind["table"] and of_kind["table"].name}
            for kind, of_kind in runs.items()
        }

    @property
    def run_tables(self) -> dict[str, Path]:
        """Paths of the stated tables of runs, by kind of recording."""
        return {kind: runs["table"] for kind, runs in self.runs.items() if runs["table"]}

    def belt_params(self) -> params.Belt:
        """Return the section properties of the belt."""
        b = self.belt
        return params.Belt(
            b.axial_stiffness_N, b.bending_stiffness_N_m2, b.mass_per_length_kg_m, b.damping_time_s
        )

    def rig_params(self) -> params.Rig:
        """Return the geometry of the rig."""
        r = self.rig
        return params.Rig(r.pulley_radius_m, r.span_length_m, r.supports, r.given_force)

    def contact_params(self) -> params.Contact:
        """Return the settings of the contact."""
        return params.Contact(
            self.contact.damping_N_s_m,
            self.contact.points_per_element,
            self.simulation.sticking_ratio,
        )

    @property
    def sha256(self) -> str:
        """SHA-256 of all that can change a result, independent of the formatting of the file."""
        text = json.dumps(
            self.model_dump(mode="json", exclude={"data"}),
            sort_keys=True,
            separators=(",", ":"),
            allow_nan=False,
        )
        return hashlib.sha256(text.encode()).hexdigest()
