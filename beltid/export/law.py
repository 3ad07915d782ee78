"""The contact law of a belt as one value, in the shape of its JSON file; that text and its schema.

The text contains the SHA-256 of its content, so that a law edited by hand is not mistaken for the
identified one. To use an edited law, remove the key ``content_sha256``.
"""

import json
import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    NonNegativeFloat,
    PositiveFloat,
    ValidationError,
    ValidationInfo,
    field_validator,
)

from beltid.config.checks import FOLDER_NAME, PLAIN_WORDS, complain, folder_name, plain_words
from beltid.config.loading import problem
from beltid.errors import SHOWN, ArtifactError, InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.store.artifact import Origin, plain
from beltid.store.disk import sha256

FORMAT: Literal["beltlaw"] = "beltlaw"
VERSION: Literal[1] = 1
SCHEMA_ID = f"urn:beltid:{FORMAT}:{VERSION}"
SEAL = "content_sha256"
SUFFIX = ".beltlaw.json"

Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
FolderName = Annotated[str, Field(pattern=f"^{FOLDER_NAME}$"), BeforeValidator(folder_name)]
Words = Annotated[str, Field(pattern=f"^{PLAIN_WORDS}$"), BeforeValidator(plain_words)]
Size = PositiveFloat | None
Error = NonNegativeFloat | None
Range = tuple[NonNegativeFloat, NonNegativeFloat] | None
Row = tuple[float, ...]
Matrix = tuple[Row, ...]


def field(description: str, default: Any = ..., **limits: Any) -> Any:
    """Return a field with its description; without a default it is required."""
    return Field(default, description=description, **limits)


class Part(BaseModel):
    """A closed, frozen part of the law."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=False)


def part_of(part: type[Part], values: Mapping[str, Any]) -> Any:
    """Make a part of a law from those values that it has."""
    return part(**{name: value for name, value in values.items() if name in part.model_fields})


class BeltFacts(Part):
    """The belt that the law was identified with."""

    name: FolderName = field("name of the belt; files are named by it")
    type: Words | None = field("type, such as 5PK", None)
    ribs: int | None = field("number of ribs", None, ge=1)
    width_m: Size = field("width of the ribbed side [m]", None)
    axial_stiffness_N: Size = field("EA [N]", None)
    bending_stiffness_N_m2: Size = field("EI [N m²]", None)
    mass_per_length_kg_m: Size = field("[kg/m]", None)


class NormalPart(Part):
    """Normal contact: line force f_N = k_linear delta + k_quadratic delta² for delta > 0, else 0.

    delta is the penetration of the belt into the pulley; f_N the force per metre of belt.
    """

    k_linear_N_m2: NonNegativeFloat = field("coefficient of the penetration [N/m²]")
    k_quadratic_N_m3: NonNegativeFloat = field("of the squared penetration [N/m³]")
    k_linear_u_N_m2: Error = field("combined standard uncertainty, k = 1 [N/m²]", None)
    k_quadratic_u_N_m3: Error = field("combined standard uncertainty, k = 1 [N/m³]", None)
    k_linear_se_N_m2: Error = field("standard error [N/m²]", None)
    k_quadratic_se_N_m3: Error = field("standard error [N/m³]", None)
    covariance: tuple[tuple[float, float], tuple[float, float]] | None = field(
        "of (k_linear, k_quadratic) [N²/m⁴, N²/m⁵; N²/m⁵, N²/m⁶]", None
    )
    rms_residual_N_m: Error = field("of the fit [N/m]", None)
    hysteresis_ratio: Error = field("energy lost over energy put in, per load cycle [-]", None)


class Contribution(Part):
    """Contribution of one source of error to the uncertainty of mu, in percent of mu, k = 1."""

    source: str = field("name of the source; combined: all of them together")
    basis: str = field("stated, assumed or fitted", "")
    contribution_percent: NonNegativeFloat = field("RMS over the measured range")
    largest_percent: Error = field("largest value over the measured range", None)


class FrictionPart(Part):
    """Friction coefficient mu over line force f_N and sliding speed v, bicubic between nodes.

    Outside the nodes the value of the nearest node applies; mu is even in v. In cell i, j
    mu = sum_ab patches[i][j][a][b] s^a t^b, with s = (x - x_nodes[i])/(x_nodes[i+1] - x_nodes[i])
    and t likewise with y_nodes[j]. The peak before sliding grows with the time at rest and is not
    part of mu.
    """

    method: str = field("refined (rig simulated) or published (Eqs. 6 and 8)")
    normal_force_N_m: tuple[NonNegativeFloat, ...] = field("nodes of f_N [N/m]")
    slip_speed_m_s: tuple[NonNegativeFloat, ...] = field("nodes of v [m/s]")
    mu: tuple[tuple[PositiveFloat, ...], ...] = field("[-]: a row per force, a column per speed")
    mu_u: tuple[tuple[NonNegativeFloat, ...], ...] | None = field(
        "combined standard uncertainty of mu, k = 1 [-]", None
    )
    mu_se: tuple[tuple[Error, ...], ...] | None = field(
        "part due to the scatter of the runs alone; null if unknown", None
    )
    budget: tuple[Contribution, ...] = field("contributions to mu_u", ())
    factor: tuple[Matrix, ...] | None = field(
        "rows S of the nodes: the covariance of ln mu at two nodes is the product of theirs", None
    )
    sources: tuple[str, ...] = field("of the first columns of factor; the others are scatter", ())
    sticking_ratio: Size = field("peak before sliding over mu, mean of the runs", None)
    sticking_ratio_sd: Error = field("its standard deviation between runs", None)
    x_nodes: Row = field("ln(1 + f_N/f_ref_N_m) of the force nodes [-]")
    y_nodes: Row = field("ln(1 + v/v_ref_m_s) of the speed nodes [-]")
    f_ref_N_m: Size = field("null: mu does not depend on the force")
    v_ref_m_s: Size = field("null: mu does not depend on the speed")
    patches: tuple[tuple[Matrix, ...], ...] = field("polynomials of the cells")

    @field_validator("mu_u")
    @classmethod
    def _like_mu(cls, mu_u: Any, info: ValidationInfo) -> Any:
        if mu_u is not None and [*map(len, mu_u)] != [*map(len, info.data.get("mu", mu_u))]:
            raise complain("like mu: a row per force, a column per speed")
        return mu_u

    @field_validator("patches")
    @classmethod
    def _of_the_nodes(cls, patches: Any, info: ValidationInfo) -> Any:
        nodes: list[Any] = [
            info.data.get(of) for of in ("normal_force_N_m", "slip_speed_m_s", "mu")
        ]
        if not all(nodes):
            return patches
        own = FrictionSurface(*nodes).tables().C
        if np.shape(patches) != own.shape or not np.allclose(patches, own, rtol=1e-7, atol=1e-9):
            raise complain("those of the nodes mu; beltid.FrictionSurface makes them")
        return patches


class Validity(Part):
    """Measured ranges, and the range that the refined surface infers; beyond, nothing is known.

    Line forces between `measured_force_N_m` and `normal_force_N_m` occur within the contact of the
    measured runs: mu is inferred there. The normal law beyond `press_force_N_m` is extrapolated.
    """

    measured_force_N_m: Range = field("mean line force of the measured friction runs [N/m]", None)
    normal_force_N_m: Range = field("line force with mu, measured or inferred [N/m]", None)
    slip_speed_m_s: Range = field("sliding speed [m/s]", None)
    penetration_m: Range = field("penetration, of the normal law [m]", None)
    press_force_N_m: Range = field("line force, of the normal law [N/m]", None)


class Provenance(Part):
    """Origin of the law: software, artifacts, recordings and config."""

    software: str = field("program and version that wrote the file")
    software_sha256: str = field("hash of the sources that built the artifacts", "")
    artifacts: dict[str, Sha256] = field("SHA-256 of the artifacts", {})
    recordings: dict[str, Sha256] = field("SHA-256 of the bench recordings", {})
    config: str | None = field("name of the config", None)
    config_sha256: str = field("hash of the config's values", "")
    notes: tuple[str, ...] = field("messages of the identification", ())


class ContactLaw(Part):
    """Contact law between a belt and a pulley: normal stiffness, friction, range, origin.

    All values in SI units, per metre of belt. Compute with `surface` and `normal_law`.
    """

    format: Literal["beltlaw"] = FORMAT
    version: Literal[1] = VERSION
    about: str = field("what this file is and how to use it", "")
    origin: Origin | None = field("where the data come from; null: not stated", None)
    belt: BeltFacts
    conditions: dict[str, str] = field("of the friction runs, such as condition: wet", {})
    normal: NormalPart
    friction: FrictionPart
    validity: Validity
    provenance: Provenance

    def __repr__(self) -> str:
        return (
            f"contact law of the belt {self.belt.name}, {self.origin or 'origin not stated'}\n"
            f"  normal: {self.normal_law}\n"
            f"  friction: {self.friction.method}, {self.surface!r}\n"
            f"  validity: {self.validity}"
        )

    @property
    def surface(self) -> FrictionSurface:
        """The friction surface with its uncertainty."""
        return _surface(self.friction)

    @property
    def normal_law(self) -> NormalLaw:
        """The normal contact law."""
        return NormalLaw(self.normal.k_linear_N_m2, self.normal.k_quadratic_N_m3)


@lru_cache(maxsize=8)
def _surface(part: FrictionPart) -> FrictionSurface:
    se = None if part.mu_se is None else np.array(part.mu_se, dtype=float)
    surface = FrictionSurface(part.normal_force_N_m, part.slip_speed_m_s, part.mu, se)
    return surface.with_covariance(part.factor, part.sources)


def friction_part(surface: FrictionSurface, method: str, **more: Any) -> FrictionPart:
    """Build the friction part of a law from its surface with its covariance, and other fields."""
    tables, factor = surface.tables(), surface.factor
    values = {
        "method": method,
        "normal_force_N_m": surface.normal_force_N_m,
        "slip_speed_m_s": surface.slip_speed_m_s,
        "mu": surface.mu_nodes,
        "mu_u": None if factor is None else surface.mu_nodes * np.linalg.norm(factor, axis=2),
        "mu_se": surface.mu_se_nodes,
        "factor": factor,
        "sources": surface.sources,
        "x_nodes": tables.x_nodes,
        "y_nodes": tables.y_nodes,
        "f_ref_N_m": tables.f_ref,
        "v_ref_m_s": tables.v_ref,
        "patches": tables.C,
    }
    return FrictionPart.model_validate(plain(values | more))


def law_text(law: ContactLaw) -> str:
    """Write a law as JSON text; the same law gives the same bytes."""
    values = law.model_dump(mode="json")
    return _indented({"$schema": SCHEMA_ID, **values, SEAL: _seal(values)}) + "\n"


def law_from_text(text: str, name: str) -> ContactLaw:
    """Read a law from JSON text; messages call the file by its name.

    Raises
    ------
    ArtifactError
        If the text is not a contact law, is damaged, or was edited without removing its checksum.
    """
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ArtifactError(f"{name}: not a contact law: not valid JSON ({error})") from None
    if not isinstance(values, dict) or values.get("format") != FORMAT:
        raise ArtifactError(
            f'{name}: not a contact law: the key "format" must be "{FORMAT}"; `beltid export json` '
            "writes one"
        )
    seal = values.pop(SEAL, None)
    values.pop("$schema", None)
    if seal is not None and seal != _seal(values):
        raise ArtifactError(
            f"{name}: was changed after beltid wrote it; if this is intended, remove its key {SEAL}"
        )
    if isinstance(values.get("friction"), dict):
        values["friction"].pop("ensemble", None)  # of earlier files, nearly always null
    try:
        # strict and as JSON: text is not accepted as a number, a list is accepted as a tuple
        law = ContactLaw.model_validate_json(json.dumps(values), strict=True)
        law.surface, law.normal_law  # noqa: B018  (raise what the model cannot see)
    except ValidationError as error:
        raise ArtifactError(validation_problems(error, name)) from None
    except InputError as error:
        raise ArtifactError(error.at(name)) from None
    return law


def validation_problems(error: ValidationError, name: str) -> list[str]:
    """List the validation errors of a law, one line per problem."""
    details = error.errors(include_url=False)[:SHOWN]
    return [f"{name}: {problem(detail, tuple(detail['loc']))}" for detail in details]


def schema() -> dict[str, Any]:
    """Build the JSON Schema (2020-12) of the file."""
    generated = ContactLaw.model_json_schema()
    seal = (
        "SHA-256 of all other keys as JSON with sorted keys and no spaces (without $schema); "
        "remove this key after editing the file by hand"
    )
    generated["properties"] = {
        "$schema": {"const": SCHEMA_ID, "description": "schema of this file"},
        **generated["properties"],
        SEAL: {"type": "string", "pattern": "^[0-9a-f]{64}$", "description": seal},
    }
    generated["required"] = ["format", "version", *generated["required"]]
    dialect = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": SCHEMA_ID}
    return dialect | generated | {"title": "Contact law between a belt and a pulley"}


def _seal(values: dict[str, Any]) -> str:
    return sha256(json.dumps(values, sort_keys=True, separators=(",", ":")).encode())


def _indented(values: dict[str, Any]) -> str:
    """Format JSON with one key per line, and one line per list of plain values."""
    text = json.dumps(values, indent=2, ensure_ascii=False, allow_nan=False)
    innermost = r"\[\n *([^\[\]{}]*?)\n *\]"  # raw line breaks stand between values only
    return re.sub(innermost, lambda found: "[" + re.sub(r"\n *", " ", found[1]) + "]", text)
