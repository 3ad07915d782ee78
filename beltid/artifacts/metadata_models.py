"""What an artifact states about itself, a model per kind.

A checksum shows that an artifact is undamaged, not that beltid wrote it: anybody can write one by
hand. So all that anything relies on is checked here, when the artifact is opened, and nowhere else.
Single figures are fields, any of which may be missing in an older artifact. Tables are rows of
plain values, as JSON has them and as pages and terminals print them. Unknown figures are kept.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NotRequired, TypeVar

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    PlainValidator,
    Strict,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_validator,
)
from pydantic_core import PydanticCustomError

# pydantic reads this one only, before Python 3.12
from typing_extensions import TypedDict

from beltid.artifacts.parquet_table import LARGEST
from beltid.config.messages import problem
from beltid.errors import ArtifactError

SHOWN: Final = 5
SECTIONS: Final = ("config_sha256", "inputs", "validity", "set_aside", "settings")
"""Parts of the metadata that the file holds beside each other; all others are its `extra`."""

Origin = Literal["measured", "synthetic"]
"""Where data come from."""

T = TypeVar("T")


def plain(value: Any) -> Any:
    """A value as JSON has it: numpy and models to plain values, nan and infinity to null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (np.generic, np.ndarray)):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, (str, int, bool)) or value is None:
        return value
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, BaseModel):
        return plain(value.model_dump())
    raise TypeError(f"{type(value).__name__} cannot be stored in the metadata of an artifact")


def _is_number(value: Any) -> bool:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return number and -LARGEST <= value <= LARGEST


def _number(value: Any) -> float:
    if not _is_number(value):
        raise PydanticCustomError("number", "must be a number")
    return value  # a whole one stays whole: the bytes of a file written again are the same


def _positive(value: Any) -> float:
    if not _is_number(value) or value <= 0:
        raise PydanticCustomError("positive", "must be a number > 0")
    return value


def _rectangular(value: tuple[Any, ...]) -> tuple[Any, ...]:
    if len({len(row) for row in value}) > 1:
        raise PydanticCustomError("rows", "must hold rows of one length")
    return value


Number = Annotated[float, PlainValidator(_number)]
Positive = Annotated[float, PlainValidator(_positive)]
Count = Annotated[int, Field(ge=0, le=2**53)]
Place = Annotated[int, Field(ge=0, lt=10_000)]
Listed = Annotated[tuple[T, ...], Strict(False)]
"""A list of JSON, kept as a tuple."""
Vector = Listed[Number | None]
Matrix = Annotated[Listed[Vector], AfterValidator(_rectangular)]
Span = Annotated[tuple[Number | None, Number | None], Strict(False)]
Rows = Listed[dict[str, Any]]


class BudgetRow(TypedDict):
    """One cause of uncertainty of one quantity."""

    quantity: str
    source: str
    basis: str
    unit: str
    standard_uncertainty: Number | None
    contribution_percent: Number | None
    largest_percent: Number | None


class SharedError(TypedDict):
    """One error that all values of a table share; `place` counts those of a kind."""

    name: str
    error: str
    place: Place
    size: Number
    unit: str
    per_unit: Number
    basis: str


class Parameter(TypedDict):
    """One coefficient of a fitted law."""

    name: str
    value: Number
    se: Number | None
    unit: str


class NormalLawRow(TypedDict):
    """One normal contact law, fitted to the tests of the pooled one."""

    law: str
    parameters: Listed[Parameter]
    rms_residual_N_m: Number | None
    criterion: Number | None
    cv_error_N_m: Number | None
    cv_ratio: Number | None
    largest_difference: Number | None
    note: NotRequired[str | None]


class NormalLaws(TypedDict):
    """Comparison of normal contact laws."""

    laws: Listed[NormalLawRow]
    quadratic_supported: NotRequired[bool | None]


class Dissipation(TypedDict):
    """Damping that the load cycles of the press tell of."""

    C_P_N_s_m: NotRequired[Number | None]


class TemperatureEffect(TypedDict):
    """Whether the stiffness depends on the temperature."""

    matters: NotRequired[bool | None]


class RigSpeeds(TypedDict):
    """Pulley speeds that the friction rig has to cover."""

    statement: NotRequired[str | None]
    proposed_rad_s: NotRequired[Vector | None]
    covered: NotRequired[bool | None]


class FrictionLawRow(TypedDict):
    """One friction formula, fitted to the nodes of a surface."""

    law: str
    parameters: Listed[Parameter]
    rms_misfit: Number | None
    worst_misfit: Number | None
    criterion: Number | None
    formula: str


class FrictionLaws(TypedDict):
    """Comparison of friction formulas."""

    laws: Listed[FrictionLawRow]


class SurfaceUncertainty(TypedDict):
    """What the columns of the factor of the covariance of ln mu stand for."""

    sources: Listed[SharedError]
    arcs_deg: Listed[Positive]


class MisfitRow(TypedDict):
    """Simulated less measured coefficients of a group of runs, before and after refinement."""

    group: str
    runs: Count
    rms_before_percent: Number | None
    mean_before_percent: Number | None
    rms_after_percent: Number | None
    mean_after_percent: Number | None


class EffectRow(TypedDict):
    """What shifts the friction of the runs beside the surface, in percent of mu."""

    effect: str
    size_percent: Number
    standard_uncertainty_percent: Number | None
    clear: bool
    explained_percent: NotRequired[Number | None]


class BendingFigures(TypedDict):
    """Bending stiffness that the runs ask for beside the stated one [N m²]."""

    fitted_N_m2: Positive
    fitted_u_N_m2: Number
    stated_N_m2: Positive
    stated_u_N_m2: Number


class DriftRow(TypedDict):
    """Change of the friction of the runs with one cause, in percent of mu."""

    cause: str
    per: str
    change_percent: Number | None
    standard_error_percent: Number | None
    clear: bool
    explained_percent: NotRequired[Number]


class MonteCarlo(TypedDict):
    """Check of the linear uncertainty by replicates."""

    replicates: Count
    seed: Count
    table: Rows
    linear_fails_at: Rows


class SolverRecord(TypedDict):
    """What the solver did in a run."""

    elements: NotRequired[Number | None]
    steps: NotRequired[Number | None]
    newton_iterations: NotRequired[Number | None]
    status_changes: NotRequired[Number | None]
    halvings: NotRequired[Number | None]
    residual: NotRequired[Number | None]
    slip_m: NotRequired[Number | None]
    cone: NotRequired[Number | None]
    clamped_lookups: Number
    lookups: Number


class SimulatedRun(TypedDict):
    """One simulated run; `status` is ok, or why it failed."""

    status: str
    arc_deg: Number
    pulley_speed_rad_s: Number
    mu: NotRequired[Number | None]
    normal_force_N_m: NotRequired[Number | None]
    run: NotRequired[str | None]
    initial_tension_N: NotRequired[Number | None]
    solver: NotRequired[SolverRecord | None]


class SimulatedUncertainty(TypedDict):
    """Relative uncertainties of simulated runs, a row per run and a column per shared error."""

    sources: Listed[SharedError]
    runs: Listed[str]
    simulated: Matrix
    difference: Matrix
    scatter: Vector
    numerical: Vector
    by_setting: Matrix


class AgreementRow(TypedDict):
    """Simulated less measured coefficients of a group of runs."""

    group: str
    n_points: Count
    rms_percent: Number | None
    mean_percent: Number | None
    largest_percent: Number | None
    force_low_N_m: Number | None
    force_high_N_m: Number | None


class AveragedRow(TypedDict):
    """One setting, averaged over the arcs."""

    normal_force_N_m: NotRequired[Number | None]
    mu_measured: NotRequired[Number | None]
    mu_simulated: NotRequired[Number | None]
    nominal_tension_N: NotRequired[Number | None]
    pulley_speed_rad_s: NotRequired[Number | None]


class JudgedRow(TypedDict):
    """One tolerance and whether it holds."""

    tolerance: str
    found: NotRequired[Number | None]
    allowed: Number
    holds: bool


class Validation(TypedDict):
    """How many differences are within their uncertainty."""

    n: Count
    within_2u: Count
    rms_e_over_u: NotRequired[Number | None]
    inputs_known: bool


def _as_found(value: Any, check: ValidatorFunctionWrapHandler) -> Any:
    check(value)
    return value


_KNOWN_SETTINGS = TypedDict(
    "_KNOWN_SETTINGS",
    {
        "rig.pulley_radius_m": NotRequired[Positive | None],
        "rig.pulley_speeds_rad_s": NotRequired[Listed[Number] | None],
        "friction": NotRequired[dict[str, Any]],
    },
)
Settings = Annotated[_KNOWN_SETTINGS, WrapValidator(_as_found)]
"""Checked, but kept as they are: freshness compares them with those of today."""


class Metadata(BaseModel):
    """What every artifact states about itself.

    Attributes
    ----------
    config_sha256 : str
        Hash of the config that was used.
    inputs : dict
        Name of every input -> SHA-256 of its bytes.
    validity : dict
        Range within which the result holds.
    set_aside : tuple of dict
        What was set aside, and why.
    settings : dict
        Settings of the stage.
    config : str
        Name of the config, without its folder.
    origin : {"measured", "synthetic"} or None
        Where the data come from; None where nobody said so.
    method : str
        How the result was found, where there are several ways.
    notes, warnings : tuple of str
        What the user should know, and look into.
    budget : tuple of dict
        Causes of the uncertainty of the result.
    """

    model_config = ConfigDict(frozen=True, strict=True, extra="allow")

    config_sha256: str = ""
    inputs: dict[str, str] = {}
    validity: dict[str, Span | None] = {}
    set_aside: Rows = ()
    settings: Settings = {}
    config: str | None = None
    origin: Origin | None = None
    method: str = ""
    notes: Listed[str] = ()
    warnings: Listed[str] = ()
    budget: Listed[BudgetRow] = ()

    @model_validator(mode="before")
    @classmethod
    def _plain(cls, values: Any) -> Any:
        return plain(values)

    @property
    def figures(self) -> dict[str, Any]:
        """All that is stated beyond `SECTIONS`, by its name: the section `extra` of the file."""
        return {
            name: value
            for name, value in sorted(self)
            if name in self.model_fields_set and name not in SECTIONS
        }


class StiffnessMetadata(Metadata):
    """Of the normal contact law; numbers of samples."""

    temperature: TemperatureEffect = {}
    law_choice: NormalLaws | None = None
    dissipation: Dissipation | None = None
    n_effective: Number | None = None
    n_missing: Count | None = None
    n_spikes: Count | None = None


class SlipMetadata(Metadata):
    """Of the sliding speeds in service [m/s]; `pulley_ratio` is driver over driven speed."""

    max_slip_speed_m_s: Number | None = None
    max_slip_run: str | None = None
    pulley_ratio: Number | None = None
    pulley_ratio_se: Number | None = None
    rig_speeds: RigSpeeds | None = None


class FrictionMetadata(Metadata):
    """Of the reduced runs of a friction rig."""

    drift: Listed[DriftRow] = ()


class ShearMetadata(Metadata):
    """Of the shear stiffness of the ribs; `high` is missing where ribs without compliance fit."""

    resolved: bool = False
    shear_stiffness_N_m2: Positive | None = None
    shear_stiffness_u_N_m2: Positive | None = None
    shear_stiffness_low_N_m2: Number | None = None
    shear_stiffness_high_N_m2: Positive | None = None
    effective_span_m: Number | None = None
    effective_span_u_m: Number | None = None
    slope_scatter: Number | None = None


class SurfaceMetadata(Metadata):
    """Of a friction surface, published or refined; spreads between arcs are shares of mu.

    `measured` is the range of the runs' mean forces, Eq. (8), and speeds; what the refined surface
    says beyond it (`validity`) is inferred from the forces that act within their contact.
    """

    measured: dict[str, Span] = {}
    conditions: dict[str, str] = {}
    degree: Listed[Count] | None = None
    n_points: Count | None = None
    rms_arc_spread: Number | None = None
    max_arc_spread: Number | None = None
    arc_spread_before: Number | None = None
    uncertainty: SurfaceUncertainty | None = None
    friction_laws: FrictionLaws | None = None
    misfit: Listed[MisfitRow] = ()
    iterations: Count | None = None
    noise_scale: Number | None = None
    effective_parameters: Number | None = None
    effects: Listed[EffectRow] = ()
    reference_temperature_degC: Number | None = None
    bending: BendingFigures | None = None
    monte_carlo: MonteCarlo | None = None


class SimulatedMetadata(Metadata):
    """Of simulated runs; look-ups of the surface, and those beyond its measured range."""

    runs: Listed[SimulatedRun] | None = None
    lookups: Count | None = None
    clamped_lookups: Count | None = None
    uncertainty: SimulatedUncertainty | None = None

    @model_validator(mode="after")
    def _together(self) -> SimulatedMetadata:
        """Figures of the right types that do not go together are refused as well."""
        problems = [*_wrong_runs(self.runs), *_wrong_shapes(self.uncertainty)]
        if problems:
            raise PydanticCustomError("together", "{problem}", {"problem": problems[0]})
        return self


def _wrong_runs(runs: tuple[SimulatedRun, ...] | None) -> Iterator[str]:
    for i, run in enumerate(runs or ()):
        known = (run.get("mu"), run.get("normal_force_N_m"))
        if run["status"] == "ok" and not all(v is not None and v > 0.0 for v in known):
            yield f"extra.runs[{i}] is ok, but without mu and normal_force_N_m > 0"
    if runs is not None and not any(run["status"] == "ok" for run in runs):
        yield "extra.runs: none is ok"


def _wrong_shapes(stated: SimulatedUncertainty | None) -> Iterator[str]:
    if not stated:
        return
    n, k = len(stated["runs"]), len(stated["sources"])
    arrays: Mapping[str, Any] = {**stated}
    for name, shape in (
        ("simulated", (n, k)),
        ("difference", (n, k)),
        ("scatter", (n,)),
        ("numerical", (n,)),
        ("by_setting", (n, 2)),
    ):
        found = np.shape(arrays[name])
        if found != shape:
            yield f"extra.uncertainty.{name} has the shape {found}, must have {shape}"


class ProfilesMetadata(Metadata):
    """Of profiles along the arc."""

    profile_times_s: Listed[Number] | None = None


class TensionLimitRow(TypedDict):
    """Torques at which a drive stops sticking and begins to slip grossly, at one tension."""

    driver_speed_rad_s: Number
    initial_tension_N: Number
    adhesion_end_torque_N_m: Number | None
    slip_limit_torque_N_m: Number | None


class SlipLimitRow(TensionLimitRow):
    """The same at one setting of the operating points."""

    largest_torque_N_m: Number


class LaidPulleyRow(TypedDict):
    """A pulley at rest, and the ends of the span that leaves it [m]."""

    pulley: str
    x_m: Number
    y_m: Number
    radius_m: Number
    leaves_m: list[Number]
    arrives_m: list[Number]


class DriveArcRow(TypedDict):
    """The contact along the arc of a pulley at the most loaded point, entry first."""

    pulley: str
    run: str
    angle_deg: list[Number]
    normal_force_N_m: list[Number]
    slip_speed_m_s: list[Number]


class DriveMetadata(Metadata):
    """Of a predicted drive; the loaded pulley is that of the recording it follows, if any.

    `uncertainty_by_string` are the points with rods that slip whose uncertainty is, for an error
    with which a rod has no steady state, that of the string. `slow_friction` says how friction goes
    on below the slowest measured sliding.
    """

    n_failed: Count | None = None
    slow_friction: str | None = None
    loaded_pulley: str | None = None
    uncertainty_by_string: Listed[str] = ()
    slip_limits: Listed[SlipLimitRow] = ()
    limits_over_tension: Listed[TensionLimitRow] = ()
    laid: Listed[LaidPulleyRow] = ()
    arcs: Listed[DriveArcRow] = ()


class CompareDriveMetadata(Metadata):
    """Of predicted against measured speed losses; `prominence` of each part of the loss."""

    passed: bool | None = None
    rms_relative_error: Number | None = None
    rms_over_uncertainty: Number | None = None
    max_rms_relative_error: Number | None = None
    n_judged: Count = 0
    n_asked: Count = 0
    prominence: dict[str, Number] = {}
    largest_arc_share: Number | None = None


class CompareMetadata(Metadata):
    """Of simulated against measured coefficients; `passed` if every tolerance holds.

    `hold_out` says whether the runs were predicted from those of other arcs or speeds.
    """

    hold_out: Literal["none", "arc", "speed"] = "none"
    passed: bool | None = None
    statistics: Listed[AgreementRow] = ()
    averaged: Listed[AveragedRow] = ()
    judged: Listed[JudgedRow] = ()
    n_measured: Count | None = None
    n_simulated: Count | None = None
    validation: Validation = {"n": 0, "within_2u": 0, "inputs_known": False}


METADATA: Final[dict[str, type[Metadata]]] = {
    "stiffness": StiffnessMetadata,
    "slip": SlipMetadata,
    "friction": FrictionMetadata,
    "shear": ShearMetadata,
    "surface": SurfaceMetadata,
    "simulated": SimulatedMetadata,
    "profiles": ProfilesMetadata,
    "compare": CompareMetadata,
    "drive": DriveMetadata,
    "compare_drive": CompareDriveMetadata,
    "press_curves": Metadata,
    "rig_curves": Metadata,
}
"""Kind of an artifact -> model of its metadata."""


def metadata_of(kind: str, values: Mapping[str, Any], name: str) -> Metadata:
    """Metadata of an artifact from plain values, in the model of its kind.

    Parameters
    ----------
    kind : str
        Its kind.
    values : mapping
        The `SECTIONS` and the figures, by their names.
    name : str
        What the lines of the error begin with.

    Raises
    ------
    ArtifactError
        If they do not fit: place, found, allowed; the first few.
    """
    try:
        return METADATA[kind].model_validate(values)
    except ValidationError as error:
        details = error.errors(include_url=False)[:SHOWN]
        lines = [f"{name}: {_problem(detail)}" for detail in details]
        raise ArtifactError(lines, code="damaged") from None


def _problem(detail: Mapping[str, Any]) -> str:
    place = tuple(detail["loc"])
    if not place:
        return str(detail["msg"])
    return problem(detail, place if place[0] in SECTIONS else ("extra", *place))
