"""The contact law of a belt as one value, in the shape of its JSON file."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, NonNegativeFloat, PositiveFloat

from beltid.artifacts.metadata_models import Origin
from beltid.config.checks import FOLDER_NAME, PLAIN_WORDS, folder_name, plain_words
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw

FORMAT: Final = "beltlaw"
VERSION: Final = 1
SCHEMA_ID: Final = f"urn:beltid:{FORMAT}:{VERSION}"

Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
Range = tuple[NonNegativeFloat, NonNegativeFloat]
Matrix = tuple[tuple[float, ...], ...]


class Part(BaseModel):
    """A closed, frozen part of the law."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=False)


class BeltFacts(Part):
    """The belt that the law was identified with."""

    name: Annotated[str, BeforeValidator(folder_name)] = Field(
        description="name of the belt; files are named by it", pattern=f"^{FOLDER_NAME}$"
    )
    type: Annotated[str, Field(pattern=f"^{PLAIN_WORDS}$"), BeforeValidator(plain_words)] | None = (
        Field(default=None, description="type, such as 5PK")
    )
    ribs: int | None = Field(default=None, description="number of ribs", ge=1)
    width_m: PositiveFloat | None = Field(default=None, description="width of the ribbed side [m]")
    axial_stiffness_N: PositiveFloat | None = Field(default=None, description="EA [N]")
    bending_stiffness_N_m2: PositiveFloat | None = Field(default=None, description="EI [N m²]")
    mass_per_length_kg_m: PositiveFloat | None = Field(default=None, description="[kg/m]")


class NormalPart(Part):
    """Normal contact: line force f_N = k_linear delta + k_quadratic delta² for delta > 0, else 0.

    delta is the penetration of the belt into the pulley; f_N the force per metre of belt.
    """

    k_linear_N_m2: NonNegativeFloat = Field(description="coefficient of the penetration [N/m²]")
    k_quadratic_N_m3: NonNegativeFloat = Field(description="of the squared penetration [N/m³]")
    k_linear_u_N_m2: NonNegativeFloat | None = Field(
        default=None, description="combined standard uncertainty, k = 1 [N/m²]"
    )
    k_quadratic_u_N_m3: NonNegativeFloat | None = Field(
        default=None, description="combined standard uncertainty, k = 1 [N/m³]"
    )
    k_linear_se_N_m2: NonNegativeFloat | None = Field(
        default=None, description="standard error [N/m²]"
    )
    k_quadratic_se_N_m3: NonNegativeFloat | None = Field(
        default=None, description="standard error [N/m³]"
    )
    covariance: tuple[tuple[float, float], tuple[float, float]] | None = Field(
        default=None,
        description="covariance of (k_linear, k_quadratic) [N²/m⁴, N²/m⁵; N²/m⁵, N²/m⁶]",
    )
    rms_residual_N_m: NonNegativeFloat | None = Field(default=None, description="of the fit [N/m]")
    hysteresis_ratio: NonNegativeFloat | None = Field(
        default=None, description="energy lost over energy put in, per load cycle [-]"
    )


class Contribution(Part):
    """Contribution of one source of error to the uncertainty of mu."""

    source: str = Field(description="name of the source; combined: all of them together")
    basis: str = Field(default="", description="stated, assumed or fitted")
    contribution_percent: NonNegativeFloat = Field(
        description="RMS over the measured range, percent of mu, k = 1"
    )
    largest_percent: NonNegativeFloat | None = Field(
        default=None, description="largest value over the measured range, percent of mu, k = 1"
    )


class FrictionPart(Part):
    """Friction coefficient mu over line force f_N and sliding speed v, bicubic between nodes.

    Outside the nodes the value of the nearest node applies; mu is even in v.
    """

    method: str = Field(description="refined (rig simulated) or published (Eqs. 6 and 8)")
    normal_force_N_m: tuple[NonNegativeFloat, ...] = Field(description="nodes of f_N [N/m]")
    slip_speed_m_s: tuple[NonNegativeFloat, ...] = Field(description="nodes of v [m/s]")
    mu: tuple[tuple[PositiveFloat, ...], ...] = Field(
        description="friction coefficient at the nodes [-]: a row per force, a column per speed"
    )
    mu_u: tuple[tuple[NonNegativeFloat, ...], ...] | None = Field(
        default=None, description="combined standard uncertainty of mu, k = 1 [-]"
    )
    mu_se: tuple[tuple[NonNegativeFloat | None, ...], ...] | None = Field(
        default=None, description="part due to the scatter of the runs alone; null if unknown"
    )
    budget: tuple[Contribution, ...] = Field(default=(), description="contributions to mu_u")
    factor: tuple[Matrix, ...] | None = Field(
        default=None,
        description="factor[i][j] is the row S of node i, j: the covariance of ln mu at two nodes "
        "is the product of their rows",
    )
    sources: tuple[str, ...] = Field(
        default=(), description="names of the first columns of factor; the others are scatter"
    )
    sticking_ratio: PositiveFloat | None = Field(
        default=None,
        description="peak before sliding over the sliding coefficient, mean of the runs; it grows "
        "with the time at rest and is not part of mu",
    )
    sticking_ratio_sd: NonNegativeFloat | None = Field(
        default=None, description="its standard deviation between runs"
    )
    x_nodes: tuple[float, ...] = Field(description="ln(1 + f_N/f_ref_N_m) of the force nodes [-]")
    y_nodes: tuple[float, ...] = Field(description="ln(1 + v/v_ref_m_s) of the speed nodes [-]")
    f_ref_N_m: PositiveFloat | None = Field(description="null: mu does not depend on the force")
    v_ref_m_s: PositiveFloat | None = Field(description="null: mu does not depend on the speed")
    patches: tuple[tuple[Matrix, ...], ...] = Field(
        description="patches[i][j][a][b]: mu = sum_ab patches[i][j][a][b] s^a t^b in cell i, j, "
        "with s = (x - x_nodes[i])/(x_nodes[i+1] - x_nodes[i]) and t likewise with y_nodes[j]"
    )


class Validity(Part):
    """Measured ranges, and the range that the refined surface infers; beyond, nothing is known.

    Line forces between `measured_force_N_m` and `normal_force_N_m` occur within the contact of the
    measured runs: mu is inferred there. The normal law beyond `press_force_N_m` is extrapolated.
    """

    measured_force_N_m: Range | None = Field(
        default=None, description="mean line force of the measured friction runs [N/m]"
    )
    normal_force_N_m: Range | None = Field(
        default=None, description="line force for which mu is given, including inferred mu [N/m]"
    )
    slip_speed_m_s: Range | None = Field(default=None, description="sliding speed [m/s]")
    penetration_m: Range | None = Field(
        default=None, description="penetration, of the normal law [m]"
    )
    press_force_N_m: Range | None = Field(
        default=None, description="line force, of the normal law [N/m]"
    )


class Provenance(Part):
    """Origin of the law: software, artifacts, recordings and config."""

    software: str = Field(description="program and version that wrote the file")
    software_sha256: str = Field(
        default="", description="hash of the sources that built the artifacts"
    )
    artifacts: dict[str, Sha256] = Field(default={}, description="SHA-256 of the artifacts")
    recordings: dict[str, Sha256] = Field(default={}, description="SHA-256 of the bench recordings")
    config: str | None = Field(default=None, description="name of the config")
    config_sha256: str = Field(default="", description="hash of the config's values")
    notes: tuple[str, ...] = Field(default=(), description="messages of the identification")


class ContactLaw(Part):
    """Contact law between a belt and a pulley: normal stiffness, friction, range, origin.

    All values in SI units, per metre of belt. Compute with `surface` and `normal_law`.
    """

    format: Literal["beltlaw"] = FORMAT
    version: Literal[1] = VERSION
    about: str = Field(default="", description="what this file is and how to use it")
    origin: Origin | None = Field(
        default=None, description="where the data come from; null: not stated"
    )
    belt: BeltFacts
    conditions: dict[str, str] = Field(
        default={}, description="conditions of the friction runs, such as condition: wet"
    )
    normal: NormalPart
    friction: FrictionPart
    validity: Validity
    provenance: Provenance

    @property
    def surface(self) -> FrictionSurface:
        """The friction surface with its uncertainty."""
        return _surface(self.friction)

    @property
    def normal_law(self) -> NormalLaw:
        """The normal contact law."""
        return NormalLaw(self.normal.k_linear_N_m2, self.normal.k_quadratic_N_m3)

    @property
    def synthetic(self) -> bool:
        """Whether the data come from a virtual bench."""
        return self.origin == "synthetic"


@lru_cache(maxsize=8)
def _surface(part: FrictionPart) -> FrictionSurface:
    se = None
    if part.mu_se is not None:
        se = [[float("nan") if cell is None else cell for cell in row] for row in part.mu_se]
    surface = FrictionSurface(part.normal_force_N_m, part.slip_speed_m_s, part.mu, se)
    return surface.with_covariance(part.factor, part.sources)


def friction_part(
    surface: FrictionSurface,
    method: str,
    budget: tuple[Contribution, ...] = (),
    sticking: tuple[float, float] | None = None,
) -> FrictionPart:
    """Build the friction part of a law from its surface.

    Parameters
    ----------
    surface : FrictionSurface
        The surface; also supplies its covariance.
    method : str
        Identification method.
    budget : tuple of Contribution
        Contributions to its uncertainty.
    sticking : tuple of float, optional
        Ratio of sticking peak and sliding coefficient: mean and standard deviation of the runs.
    """
    tables = surface.tables()
    se = surface.mu_se_nodes
    factor = surface.factor
    return FrictionPart(
        method=method,
        normal_force_N_m=_plain(surface.normal_force_N_m),
        slip_speed_m_s=_plain(surface.slip_speed_m_s),
        mu=_plain(surface.mu_nodes),
        mu_u=None if factor is None else _plain(surface.mu_nodes * np.linalg.norm(factor, axis=2)),
        mu_se=None if se is None else _plain(se, none_for_nan=True),
        budget=budget,
        factor=None if factor is None else _plain(factor),
        sources=surface.sources,
        sticking_ratio=None if sticking is None else sticking[0],
        sticking_ratio_sd=None if sticking is None else sticking[1],
        x_nodes=_plain(tables.x_nodes),
        y_nodes=_plain(tables.y_nodes),
        f_ref_N_m=tables.f_ref if tables.f_ref < float("inf") else None,
        v_ref_m_s=tables.v_ref if tables.v_ref < float("inf") else None,
        patches=_plain(tables.C),
    )


def _plain(values: Any, none_for_nan: bool = False) -> Any:
    """Convert an array to nested tuples of floats."""

    def cell(value: Any) -> Any:
        if isinstance(value, list):
            return tuple(cell(item) for item in value)
        return None if none_for_nan and value != value else value

    return cell(values.tolist())
