"""Reduced runs of a friction rig and the contact law of a press, and their correction for errors.

The procedure of the published surface is repeated with each error corrected; a change is taken at
the moved node and shifted back along the slope of the surface.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from beltid.arrays import Array, Mask
from beltid.errors import InputError
from beltid.identify.estimators import settings_of
from beltid.identify.friction.run import SPANS, TWO_CELLS, RigKind
from beltid.identify.press.stiffness import LawEstimate
from beltid.identify.surface.surface import ARC_GAP, Points, SurfaceGrid, surface_through
from beltid.laws.capstan import (
    friction_coefficient,
    hub_force,
    mean_normal_force,
    sliding_speed,
    tensions_by_hub_force,
    tensions_by_torque,
)
from beltid.laws.penalty import NormalLaw, elastic_force, elastic_stiffness
from beltid.mixed import root
from beltid.params import GivenForce
from beltid.uncertainty.sources import (
    BENT,
    LAW,
    PRESS,
    REDUCTION_SOURCES,
    RIG,
    Errors,
    Source,
    StandardUncertainties,
    SurfaceUncertainty,
    budget,
    changes_by,
    reduction_sources,
    stated_sources,
)


@dataclass(frozen=True, slots=True)
class PressLaw:
    """A contact law with covariance and range of its fit."""

    law: NormalLaw
    covariance: Array  # of (k_linear, k_quadratic) by the scatter of the press; or zero, (2, 2)
    max_penetration_m: float  # deepest penetration of the fit
    segment_length_m: float  # length of belt under the press

    def coefficients(self, errors: Errors) -> Array:
        """Return the coefficients (2,) with errors corrected; negative ones become zero.

        The law is fitted to its own curve with errors corrected, and with a free contact point, of
        which the force f per length has the derivative f'. A compliance c moves a point by c L f
        along the travel, which changes its force by f' c L f.
        """
        k = np.array([self.law.k_linear_N_m2, self.law.k_quadratic_N_m3])
        present = np.append(k > 0.0, True)
        k += root(self.covariance) @ [errors.at(LAW, 0), errors.at(LAW, 1)]
        delta = self.max_penetration_m * np.linspace(0.0, 1.0, 200)[1:]
        force, slope = elastic_force(delta, *k), elastic_stiffness(delta, *k)
        force = force * (1.0 + errors.at("machine_compliance") * self.segment_length_m * slope)
        force *= (1.0 + errors.at("press_force")) * (1.0 + errors.at("press_law"))
        travel = delta * (1.0 + errors.at("press_displacement"))
        design = np.column_stack([travel, travel**2, slope])[:, present]
        size, fitted = np.linalg.norm(design, axis=0), np.zeros(3)
        per_length = force / (1.0 + errors.at("segment_length"))
        fitted[present] = np.linalg.lstsq(design / size, per_length, rcond=None)[0] / size
        return np.maximum(fitted[:2], 0.0)  # the last one moves the contact point


POSITIVE = ("arc_deg", "normal_force_N_m", "slip_speed_m_s", "mu_sliding")


@dataclass(frozen=True, slots=True)
class Measured:
    """Reduced runs of a friction rig, arrays (n,)."""

    R: float  # radius of the belt's centreline on the pulley [m]
    arc: NDArray[np.intp]  # number of the arc setting
    beta: Array  # contact arc [rad]
    T_0: Array  # initial tension [N], mean of both cells; a given force takes its place
    omega: Array  # speed of the pulley [rad/s]
    tight: Array  # tensions while sliding [N]
    slack: Array
    mu_se: Array  # standard error of the sliding coefficient by the scatter of the run [-]
    columns: Mapping[str, Array] = field(default_factory=dict)
    """Change of ln mu of each run per unit of a shared error to which each run has its own
    sensitivity: key of the source -> a column per place, (n, places)."""
    order: NDArray[np.intp] | None = None  # of each run in the campaign; by default as here
    temperature_degC: Array | None = None  # of each run while sliding, nan if unknown
    kind: RigKind = TWO_CELLS  # what the rig measures: which errors the tensions can have
    given_force: GivenForce = "none"  # what stays constant, see :class:`beltid.params.Rig`
    momentum: Array | float = 0.0  # m v² of a running belt, subtracted from all tensions [N]
    with_tight: Mask | None = None
    """Whether the tension measured with a torque is the tight one; by default as `kind` states."""

    def __post_init__(self) -> None:
        given = {"tight": self.tight, "slack": self.slack, "hub": 0.5 * (self.tight + self.slack)}
        object.__setattr__(self, "T_0", given.get(self.given_force, self.T_0))

    @property
    def arcs_deg(self) -> Array:
        """Contact arc of each setting, in the order of their numbers [deg]."""
        return np.degrees(np.bincount(self.arc, self.beta) / np.bincount(self.arc))

    @property
    def mu(self) -> Array:
        """Sliding coefficient, Eq. (6) [-]."""
        return friction_coefficient(self.tight, self.slack, self.beta)

    @property
    def normal_force(self) -> Array:
        """Mean normal force over the arc, Eq. (8) [N/m]."""
        return mean_normal_force(self.tight, self.slack, self.R)

    @property
    def slip_speed(self) -> Array:
        """Sliding speed, Eq. (7) [m/s]."""
        return sliding_speed(self.omega, self.R)

    def corrected(self, errors: Errors) -> Self:
        """Return the runs with errors corrected, i.e. with the true values.

        Raises `InputError` if an error is as large as the value itself.
        """
        setting = np.array([errors.at("arc_setting", int(k)) for k in self.arc])
        beta = self.beta + errors.at("arc") + setting
        tight, slack, T_0 = self._corrected_tensions(errors, beta)
        if not np.min([tight, slack, beta, T_0]) > 0.0:
            raise InputError(
                "uncertainty: an error of the load cells or of the arc is as large as a tension or "
                f"an arc itself (lowest tension {np.min(self.slack):.3g} N, shortest arc "
                f"{np.degrees(np.min(self.beta)):.3g} deg), must be much smaller"
            )
        corrected = replace(
            self,
            R=self.R * (1.0 + errors.at("pulley_radius")),
            beta=beta,
            T_0=T_0,
            omega=self.omega * (1.0 + errors.at("pulley_speed")),
            tight=tight,
            slack=slack,
        )
        changes = (
            columns @ [errors.at(key, place) for place in range(columns.shape[1])]
            for key, columns in self.columns.items()
        )
        return corrected.scattered(sum(changes, np.zeros(beta.size)))

    def scattered(self, change: Array) -> Self:
        """Return the runs with ln mu changed by `change` (n,) and the same force at rest.

        One tension rises and the other falls; a given tension, or a given sum, stays constant.
        """
        rise = self.mu * self.beta * np.expm1(change)  # of ln(tight/slack)
        tight_share = {"none": 0.5, "tight": 0.0, "slack": 1.0, "hub": 0.5}[self.given_force]
        tight = self.tight * np.exp(tight_share * rise)
        slack = self.slack * np.exp((tight_share - 1.0) * rise)
        kept = (self.tight + self.slack) / (tight + slack) if self.given_force == "hub" else 1.0
        return replace(self, tight=tight * kept, slack=slack * kept)

    def _corrected_tensions(self, errors: Errors, beta: Array) -> tuple[Array, Array, Array]:
        """Return tight, slack and initial tension [N] with errors of the measurement corrected."""
        kind, R = self.kind, self.R * (1.0 + errors.at("pulley_radius"))
        # of m v², subtracted from all tensions; the belt has the gain error of the pulley's speed
        mass = self.momentum * (errors.at("mass_per_length") + 2.0 * errors.at("pulley_speed"))

        # the tight cell rises and reads too little, the slack one falls and reads too much
        lag = errors.at("cell_hysteresis") * (kind.measures != "torque_hub")

        def cell(number: int, tension: Array) -> Array:
            """Return what a cell measures; a weight on its span has the error of the mass only."""
            if SPANS[number] == kind.weight:
                return tension - mass
            gain = errors.at("tension_gain") + errors.at("cell_gain", number)
            zero = errors.at("cell_offset", number) - mass + lag * (tension - self.T_0)
            return np.asarray(tension + (tension + self.momentum) * gain + zero)

        tight, slack = cell(0, self.tight), cell(1, self.slack)
        at_rest = cell(0, self.T_0), cell(1, self.T_0)
        if not kind.has_torque:
            return tight, slack, 0.5 * (at_rest[0] + at_rest[1])
        measured = (self.tight - self.slack) * self.R
        M = measured * (1.0 + errors.at("torque_gain")) - errors.at("bearing_drag")
        if kind.measures == "torque_hub":
            spans = replace(
                kind.spans,
                EI=kind.spans.EI * (1.0 + errors.at("bending_stiffness")),
                length=kind.spans.length + errors.at("span_length"),
            )
            hub = cell(0, hub_force(self.tight, self.slack, self.beta, self.R, kind.spans))
            return (*tensions_by_hub_force(M, hub, beta, R, spans), at_rest[0])
        by_tight = tensions_by_torque(M, R, T_tight=tight)
        by_slack = tensions_by_torque(M, R, T_slack=slack)
        is_tight = kind.torque_with == "tight" if self.with_tight is None else self.with_tight
        return (*np.where(is_tight, by_tight, by_slack), np.where(is_tight, *at_rest))


def measured_runs(
    columns: Mapping[str, np.ndarray],
    rows: np.ndarray,
    R: float,
    kind: RigKind = TWO_CELLS,
    given_force: GivenForce = "none",
) -> Measured:
    """Read valid rows of a friction table; tensions by force and coefficient, Eqs. (5) and (8).

    R [m] is the radius of the belt's centreline on the pulley. A missing standard error is the
    median of the others, or zero if none is known; errors that the runs share are not in it but in
    the `columns` of the result.
    """

    def known(name: str) -> Array:
        """Return the values of a column; nan where they are missing."""
        return np.asarray(columns[name], float)[rows] if name in columns else np.full(n, np.nan)

    n = len(rows)
    arc_deg, f, v, mu = map(known, POSITIVE)
    errors, beta = own_errors(columns)[rows], np.radians(arc_deg)
    typical = float(np.nanmedian(errors)) if np.isfinite(errors).any() else 0.0
    slack = f * R * (mu * beta) / np.expm1(mu * beta)
    tight, at_rest = slack * np.exp(mu * beta), known("initial_tension_N")
    return Measured(
        R=R,
        arc=settings_of(arc_deg, ARC_GAP),
        beta=beta,
        T_0=np.where(np.isfinite(at_rest), at_rest, np.sqrt(tight * slack)),
        omega=np.abs(v) / R,
        tight=tight,
        slack=slack,
        mu_se=np.where(np.isfinite(errors), errors, typical),
        columns={key: values[rows][:, None] for key, values in shared_columns(columns).items()},
        order=np.asarray(rows, dtype=np.intp),
        temperature_degC=known("temperature_degC"),
        kind=kind,
        given_force=given_force,
        momentum=np.nan_to_num(known("momentum_N")),
        with_tight=columns["torque_with"][rows] == "tight" if "torque_with" in columns else None,
    )


def shared_columns(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the change of ln mu (n,) by shared errors of the reduction; 0 where unknown."""
    shared = {k: np.asarray(columns[k], float) for k in REDUCTION_SOURCES if k in columns}
    return {key: np.where(np.isfinite(values), values, 0.0) for key, values in shared.items()}


def own_errors(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return standard errors of mu (n,) without shared errors; nan if the table has none.

    The column ``mu_sliding_se`` is the total: the run's own part and shared parts add in squares.
    """
    mu = np.asarray(columns["mu_sliding"], float)
    whole = np.asarray(columns.get("mu_sliding_se", np.full(mu.size, np.nan)), float)
    shared = sum(np.square(mu * share) for share in shared_columns(columns).values())
    return np.asarray(np.sqrt(np.maximum(np.square(whole) - shared, 0.0)))


def numbered_arcs(
    arcs_deg: Sequence[float] | np.ndarray, known_deg: Sequence[float] | np.ndarray
) -> tuple[NDArray[np.intp], list[float]]:
    """Return the number of each arc (n,), and all arcs [deg]: new ones follow the known ones."""
    all_arcs, numbers = [float(arc) for arc in known_deg], []
    for arc in arcs_deg:
        near = np.flatnonzero(np.isclose(all_arcs, arc, rtol=ARC_GAP, atol=0.0))
        numbers.append(near[0] if near.size else len(all_arcs))
        all_arcs += [] if near.size else [float(arc)]
    return np.array(numbers, dtype=np.intp), all_arcs


def valid_rows(columns: Mapping[str, Any], rows: np.ndarray) -> np.ndarray:
    """Select the rows whose arc, force, speed and coefficient are positive numbers."""
    values = np.array([columns[name] for name in POSITIVE], dtype=float)[:, rows]
    values[2] = np.abs(values[2])  # the speed
    return np.asarray(rows[np.all((values > 0.0) & (values < np.inf), axis=0)])


def published_grid(measured: Measured) -> SurfaceGrid:
    """Build the averaged surface of a campaign by the published procedure."""
    of_runs = measured.normal_force, measured.slip_speed, measured.mu, measured.mu_se
    return surface_through(Points(np.degrees(measured.beta), *of_runs))[0]


def changes_at_nodes(nominal: SurfaceGrid, other: SurfaceGrid) -> Array:
    """Return the change of ln mu at the nominal nodes (nf, nv), other minus nominal."""
    f, v = nominal.normal_force_N_m[:, None], nominal.slip_speed_m_s
    if other.mu.shape != nominal.mu.shape:  # nodes were added or removed
        return np.asarray(np.log(other.to_surface().mu(f, v) / nominal.mu))
    by_f, by_v = nominal.to_surface().gradient(f, v)
    f_step, v_step = np.log(other.normal_force_N_m[:, None] / f), np.log(other.slip_speed_m_s / v)
    along = (by_f * f * f_step + by_v * v * v_step) / nominal.mu
    return np.asarray(np.log(other.mu / nominal.mu) - along)


def published_uncertainty(
    measured: Measured, nominal: SurfaceGrid, given: StandardUncertainties
) -> SurfaceUncertainty:
    """Propagate the errors to the published surface; the bias by bending is not included."""
    sources = sources_of_runs(measured, given)

    def change(errors: Errors) -> Array:
        """Return the change of ln mu at the nodes with errors corrected."""
        return changes_at_nodes(nominal, published_grid(measured.corrected(errors)))

    factor = np.concatenate([changes_by(sources, change), nominal.scatter], axis=-1)
    names = [source.name for source in sources]
    surface = nominal.to_surface().with_covariance(factor, names)
    return SurfaceUncertainty(surface, sources, measured.arcs_deg)


def sources_of_runs(measured: Measured, given: StandardUncertainties) -> tuple[Source, ...]:
    """Return the errors of the bench, and of the reduction, that runs share."""
    results = (RIG, BENT) if measured.kind.spans.EI > 0.0 else (RIG,)
    bench = stated_sources(given, results, n_arcs=int(measured.arc.max()) + 1)
    return (*bench, *reduction_sources(measured.columns))


QUANTITIES = {"mu_sliding": "mu_sliding_u", "normal_force_N_m": "normal_force_u_N_m"}
"""Quantity of a run -> the column of its combined uncertainty."""
Found = tuple[dict[str, Array], list[dict[str, Any]]]


def friction_uncertainty(
    columns: Mapping[str, np.ndarray],
    given: StandardUncertainties,
    R: float,
    kind: RigKind = TWO_CELLS,
) -> Found:
    """Compute the combined uncertainties of the runs of a friction rig, and their budget.

    Returns columns ``mu_sliding_u`` [-] and ``normal_force_u_N_m``, nan for runs that cannot be
    used, and one row per quantity and source.
    """
    rows = valid_rows(columns, np.flatnonzero(columns["status"] == "ok"))
    u = {name: np.full(len(columns["status"]), np.nan) for name in QUANTITIES.values()}
    lines = list[dict[str, Any]]()
    if not rows.size:  # a table may state coefficients without an arc
        return u, lines
    measured = measured_runs(columns, rows, R, kind)
    sources = sources_of_runs(measured, given)

    def of_runs(errors: Errors) -> Array:
        """Return coefficient and normal force (2, n) with errors corrected."""
        corrected = measured.corrected(errors)
        return np.stack([corrected.mu, corrected.normal_force])

    values, own_part = (measured.mu, measured.normal_force), measured.mu_se / measured.mu
    each = values, changes_by(sources, of_runs), (own_part, 0.0 * own_part)
    for (quantity, name), value, change, own in zip(QUANTITIES.items(), *each, strict=True):
        relative = change / value[:, None]
        u[name][rows] = value * np.hypot(np.linalg.norm(relative, axis=1), own)
        lines += budget(quantity, sources, relative, {"scatter of the samples": own})
    return u, lines


def stiffness_uncertainty(
    laws: Sequence[LawEstimate], given: StandardUncertainties, segment_length_m: float
) -> Found:
    """Compute the uncertainties of normal contact laws, and the budget of the last (pooled) one.

    Returns columns ``k_linear_u_N_m2`` and ``k_quadratic_u_N_m3``, and one row per coefficient and
    source.
    """
    sources, none = stated_sources(given, (PRESS,)), np.zeros((2, 2))
    k = np.array([(law.k_linear_N_m2, law.k_quadratic_N_m3) for law in laws])
    size = np.where(k > 0.0, k, 1.0)
    scatter = np.array([(law.k_linear_se_N_m2, law.k_quadratic_se_N_m3) for law in laws]) / size
    fits = (PressLaw(law.law, none, law.max_penetration_m, segment_length_m) for law in laws)
    changes = [changes_by(sources, fit.coefficients) for fit in fits]
    relative = np.array(changes) / size[..., None]
    u, rows = size * np.hypot(np.linalg.norm(relative, axis=-1), scatter), []
    for j, name in enumerate(("k_linear_N_m2", "k_quadratic_N_m3")):
        part = {"scatter of the press curves": scatter[-1:, j]}
        rows += budget(name, sources, relative[-1:, j], part)
    return {"k_linear_u_N_m2": u[:, 0], "k_quadratic_u_N_m3": u[:, 1]}, rows
