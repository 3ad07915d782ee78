"""Metadata of artifacts, one model per kind.

All metadata that other code relies on are checked here, once, when the artifact is opened. Single
values are fields; any of them may be missing in an older artifact. Tables are rows of plain JSON
values, which pages and terminals print directly. Unknown values are kept.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NotRequired, TypeVar

import numpy as np
from pydantic import (
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

# before Python 3.12, pydantic supports only this TypedDict
from typing_extensions import TypedDict

from beltid.artifacts.parquet_table import LARGEST
from beltid.config.messages import problem
from beltid.errors import ArtifactError

SHOWN: Final = 5
SECTIONS: Final = ("config_sha256", "inputs", "validity", "set_aside", "settings")
"""Top-level sections of the stored metadata; all other values are in its section `extra`."""

Origin = Literal["measured", "synthetic"]
"""Origin of the data."""

T = TypeVar("T")


def plain(value: Any) -> Any:
    """Convert a value to plain JSON types; nan and infinity become null."""
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
    return value  # an int stays an int, so that a file written again has the same bytes


def _positive(value: Any) -> float:
    if not _is_number(value) or value <= 0:
        raise PydanticCustomError("positive", "must be a number > 0")
    return value


Number = Annotated[float, PlainValidator(_number)]
Positive = Annotated[float, PlainValidator(_positive)]
Count = Annotated[int, Field(ge=0, le=2**53)]
Place = Annotated[int, Field(ge=0, lt=10_000)]
Listed = Annotated[tuple[T, ...], Strict(False)]
"""A JSON list, stored as a tuple."""
Vector = Listed[Number | None]
Matrix = Listed[Vector]
Span = Annotated[tuple[Number | None, Number | None], Strict(False)]
Rows = Listed[dict[str, Any]]


class BudgetRow(TypedDict):
    """One source of uncertainty of one quantity."""

    quantity: str
    source: str
    basis: str
    unit: str
    standard_uncertainty: Number | None
    contribution_percent: Number | None
    largest_percent: Number | None


class SharedError(TypedDict):
    """One error common to all values of a table; `place` numbers the errors of a kind."""

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
    """One normal contact law, fitted to the same tests as the pooled law."""

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
    """Damping estimated from the load cycles of the press."""

    C_P_N_s_m: NotRequired[Number | None]


class TemperatureEffect(TypedDict):
    """Whether the stiffness depends on the temperature."""

    matters: NotRequired[bool | None]


class RigSpeeds(TypedDict):
    """Pulley speeds that the friction rig must cover."""

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
    """Error sources of the columns in the factor of the covariance of ln mu."""

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
    """Effect on the friction of the runs that is not in the surface, in percent of mu."""

    effect: str
    size_percent: Number
    standard_uncertainty_percent: Number | None
    clear: bool
    explained_percent: NotRequired[Number | None]


class SolverRecord(TypedDict):
    """Solver statistics of a run."""

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
    """One simulated run; `status` is ok or the reason of failure."""

    status: str
    arc_deg: Number
    pulley_speed_rad_s: Number
    mu: NotRequired[Number | None]
    normal_force_N_m: NotRequired[Number | None]
    run: NotRequired[str | None]
    initial_tension_N: NotRequired[Number | None]
    solver: NotRequired[SolverRecord | None]


class SimulatedUncertainty(TypedDict):
    """Relative uncertainties of simulated runs: one row per run, one column per shared error."""

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
    """One tolerance and whether it is met."""

    tolerance: str
    found: NotRequired[Number | None]
    allowed: Number
    holds: bool


class Validation(TypedDict):
    """Number of differences within their uncertainty."""

    n: Count
    within_2u: Count
    rms_e_over_u: NotRequired[Number | None]
    inputs_known: bool


def _check_unchanged(value: Any, check: ValidatorFunctionWrapHandler) -> Any:
    check(value)
    return value


class _KnownRig(TypedDict):
    pulley_radius_m: NotRequired[Positive]
    pulley_speeds_rad_s: NotRequired[Listed[Number]]


class _KnownSettings(TypedDict):
    belt: NotRequired[dict[str, Any]]
    rig: NotRequired[_KnownRig]
    contact: NotRequired[dict[str, Any]]
    friction: NotRequired[dict[str, Any]]


Settings = Annotated[_KnownSettings, WrapValidator(_check_unchanged)]
"""Checked but stored unchanged: the freshness check compares them with the current settings."""


class Metadata(BaseModel):
    """Metadata of every artifact.

    Attributes
    ----------
    config_sha256 : str
        Hash of the config that was used.
    inputs : dict
        Name of every input -> SHA-256 of its bytes.
    ancestors : dict
        Name of every input and of all that it was made from -> SHA-256; see
        :mod:`beltid.artifacts.together`.
    validity : dict
        Range in which the result is valid.
    set_aside : tuple of dict
        What was set aside, and why.
    settings : dict
        Settings of the stage.
    config : str
        Name of the config, without its folder.
    origin : {"measured", "synthetic"} or None
        Origin of the data; None if not stated.
    method : str
        Method of computation, if there are several.
    notes, warnings : tuple of str
        What the user should know, and what to look into.
    budget : tuple of dict
        Sources of uncertainty of the result.
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
    ancestors: dict[str, str] = {}

    @model_validator(mode="before")
    @classmethod
    def _plain(cls, values: Any) -> Any:
        return plain(values)

    @property
    def figures(self) -> dict[str, Any]:
        """Values outside `SECTIONS` by name: the section `extra` of the file."""
        return {
            name: value
            for name, value in sorted(self)
            if name in self.model_fields_set and name not in SECTIONS
        }


class StiffnessMetadata(Metadata):
    """Metadata of the normal contact law; ``n_`` are numbers of samples."""

    temperature: TemperatureEffect = {}
    law_choice: NormalLaws | None = None
    dissipation: Dissipation | None = None
    n_effective: Number | None = None
    n_missing: Count | None = None
    n_spikes: Count | None = None


class SlipMetadata(Metadata):
    """Metadata of sliding speeds in service [m/s]; `pulley_ratio` is driver over driven speed."""

    max_slip_speed_m_s: Number | None = None
    max_slip_run: str | None = None
    pulley_ratio: Number | None = None
    pulley_ratio_se: Number | None = None
    rig_speeds: RigSpeeds | None = None


class SurfaceMetadata(Metadata):
    """Metadata of a friction surface, published or refined; arc spreads are relative to mu.

    `measured` is the range of the runs' mean forces, Eq. (8), and speeds. Beyond it, within
    `validity`, the refined surface is inferred from the forces along the contact of the runs.
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


class SimulatedMetadata(Metadata):
    """Metadata of simulated runs, with surface look-ups in total and outside its range."""

    runs: Listed[SimulatedRun] | None = None
    lookups: Count | None = None
    clamped_lookups: Count | None = None
    uncertainty: SimulatedUncertainty | None = None


class TensionLimitRow(TypedDict):
    """Torque limits of adhesion and of gross slip at one belt tension."""

    driver_speed_rad_s: Number
    initial_tension_N: Number
    adhesion_end_torque_N_m: Number | None
    slip_limit_torque_N_m: Number | None


class SlipLimitRow(TensionLimitRow):
    """Torque limits at one setting of the operating points."""

    largest_torque_N_m: Number


class LaidPulleyRow(TypedDict):
    """A pulley at rest, and the two ends of the span that leaves it [m]."""

    pulley: str
    x_m: Number
    y_m: Number
    radius_m: Number
    leaves_m: list[Number]
    arrives_m: list[Number]


class DriveArcRow(TypedDict):
    """Contact along the arc of a pulley at the most loaded operating point, from the entry."""

    pulley: str
    run: str
    angle_deg: list[Number]
    normal_force_N_m: list[Number]
    slip_speed_m_s: list[Number]


class InstalledBeltRow(TypedDict):
    """A pulley with a belt of least, mean or largest length, at rest and most loaded."""

    belt: str
    belt_length_m: Number
    arm_angle_deg: Number | None
    tension_at_rest_N: Number
    pulley: str
    hub_force_at_rest_N: Number
    largest_tension_N: Number | None
    hub_force_N: Number | None
    reserve: Number | None


class DriveMetadata(Metadata):
    """Metadata of a predicted drive.

    `loaded_pulley` is the loaded pulley of the recording that is repeated, if any.
    `uncertainty_by_string` lists the points with slipping rods that take an uncertainty from the
    string model, because the rod has no steady state with that error.
    """

    n_failed: Count | None = None
    loaded_pulley: str | None = None
    uncertainty_by_string: Listed[str] = ()
    slip_limits: Listed[SlipLimitRow] = ()
    limits_over_tension: Listed[TensionLimitRow] = ()
    laid: Listed[LaidPulleyRow] = ()
    arcs: Listed[DriveArcRow] = ()
    installed: Listed[InstalledBeltRow] = ()


class CompareDriveMetadata(Metadata):
    """Metadata of predicted against measured speed losses; `prominence` of each part of a loss."""

    passed: bool | None = None
    rms_relative_error: Number | None = None
    rms_over_uncertainty: Number | None = None
    max_rms_relative_error: Number | None = None
    n_judged: Count = 0
    n_asked: Count = 0
    prominence: dict[str, Number] = {}
    largest_arc_share: Number | None = None


class CompareMetadata(Metadata):
    """Metadata of simulated against measured coefficients; `passed` if every tolerance is met.

    `hold_out` states whether the runs were predicted from those of other arcs or speeds.
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
    "friction": Metadata,
    "surface": SurfaceMetadata,
    "simulated": SimulatedMetadata,
    "compare": CompareMetadata,
    "drive": DriveMetadata,
    "compare_drive": CompareDriveMetadata,
    "press_curves": Metadata,
    "rig_curves": Metadata,
}
"""Kind of artifact -> model of its metadata."""


def metadata_of(kind: str, values: Mapping[str, Any], name: str) -> Metadata:
    """Validate the metadata of an artifact against the model of its kind.

    Parameters
    ----------
    kind : str
        Kind of artifact.
    values : mapping
        The `SECTIONS` and the other values, by name.
    name : str
        Prefix of the error lines.

    Raises
    ------
    ArtifactError
        If values are invalid; gives place, found and allowed of the first few.
    """
    try:
        return METADATA[kind].model_validate(values)
    except ValidationError as error:
        details = error.errors(include_url=False)[:SHOWN]
        lines = [f"{name}: {_problem(detail)}" for detail in details]
        raise ArtifactError(lines) from None


def _problem(detail: Mapping[str, Any]) -> str:
    place = tuple(detail["loc"])
    if not place:
        return str(detail["msg"])
    return problem(detail, place if place[0] in SECTIONS else ("extra", *place))
