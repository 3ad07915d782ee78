"""Runs on the simulated rig, their derivatives, and the uncertainty of what they say.

The belt of each run is laid on the pulley once, and slides with many surfaces. The adjoint of the
sliding state gives the derivatives of ln mu, Eq. (6), by mu at every place where the belt looks it
up; those by the inputs of the rig take one more simulation each.

An error of the bench acts on the measured values and on the inputs of the simulation, and may
cancel in their difference. So the changes of the simulated ln mu and of the difference are kept by
source, with their signs. A comparison says something about the model only beyond

    u_val² = u_num² + u_input² + u_D²

(ASME V&V 20-2009, Eq. 1-5-9), where each error that inputs and data share enters with its total
change (section 5-3 there). The scatter behind the surface is added as if it were independent of
that of the run. A setting that only the bench missed is a known error: it counts in full.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from beltid.arrays import Array
from beltid.identify.agreement import AgreementResult
from beltid.identify.friction.run import RigKind
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import OperatingPoint
from beltid.rig.forces import State
from beltid.rig.model import Bench, RigModel
from beltid.rig.runs import RunResult, lay_on, slide, tension_sensitivity
from beltid.uncertainty.measured import Measured, PressLaw, own_errors, shared_columns
from beltid.uncertainty.sources import (
    ARC,
    EFFECT_SOURCES,
    REDUCTION_SOURCES,
    Errors,
    Source,
    budget,
    changes_by,
    reduction_sources,
    with_sources,
)

INPUTS = ("arc", "initial tension", "radius", "span", "EI", "EA", "k_linear", "k_quadratic")
"""Inputs of the simulated rig whose errors act on a run."""
STEP = 2.0e-3  # relative step of the differences by the inputs; their error is of its order
MESH = 2.0
"""Ratio of elements to the default: where contact points come and go, derivatives scatter more than
values, those by bending stiffness (0.03) at the smallest tensions by a tenth."""


@dataclass(frozen=True, slots=True)
class Campaign:
    """Measured runs and the bench on which they are simulated."""

    measured: Measured  # the runs
    bench: Bench  # belt, rig, and the surface that the inverse solution starts from
    press: PressLaw  # the contact law and its fit to the press

    def inputs(self, runs: Measured, errors: Errors) -> Array:
        """Return `INPUTS` of the simulated rig (n, 8) for runs with the same errors corrected."""
        belt = self.bench.belt
        span = self.bench.rig.span + errors.at("span_length")
        EI = belt.EI * (1.0 + errors.at("bending_stiffness"))
        EA = belt.EA * (1.0 + errors.at("axial_stiffness"))
        inputs = runs.beta, runs.T_0, runs.R, span, EI, EA, *self.press.coefficients(errors)
        return np.column_stack(np.broadcast_arrays(*inputs))


def simulated_runs(
    bench: Bench,
    points: Sequence[OperatingPoint],
    arc: NDArray[np.intp],
    kind: RigKind,
    tensions: Array | tuple[Array, Array] | None = None,
) -> Measured:
    """Return simulated runs as if their tensions, or those at rest, had been measured exactly."""
    beta, T_0, omega = np.array([(point.beta, point.T_0, point.omega) for point in points]).T
    tight, slack = (T_0, T_0) if tensions is None else tensions
    runs = bench.rig.R, arc, beta, T_0, omega, tight, slack, np.zeros(T_0.size)
    return Measured(*runs, kind=kind, given_force=bench.rig.given_force)


def look_ups(run: RunResult, surface: FrictionSurface) -> tuple[Array, Array]:
    """Return line forces [N/m] where mu is looked up, and d ln mu of the run by ln mu there."""
    point, state = run.model.point, run.sliding
    force, tight, slack = tension_sensitivity(run.model, state)
    per_mu = (tight / state.T_A - slack / state.T_B) / (point.beta * run.mu)
    return force, per_mu * surface.mu(force, point.omega * run.model.path.R)


class RigRuns:
    """The runs of a campaign with the belt laid on once, ready to slide with many surfaces.

    Each run belongs to the nearest of the speeds (m,) [m/s], increasing. The mesh is a ratio of
    belt elements to the default, their number in each run, or that of the models of a rig that
    differs a little: the noise of another mesh is larger than the difference. `inputs` (n, 8) take
    the place of those of the campaign.
    """

    def __init__(
        self,
        campaign: Campaign,
        speeds: Array,
        mesh: float | Sequence[int | RigModel],
        inputs: Array | None = None,
    ) -> None:
        bench, runs = campaign.bench, campaign.measured
        inputs = campaign.inputs(runs, Errors()) if inputs is None else inputs
        self.speeds = np.asarray(speeds, dtype=float)
        self.label = np.argmin(np.abs(np.log(runs.slip_speed[:, None] / self.speeds)), axis=1)
        self.off_speed = np.log(runs.slip_speed / self.speeds[self.label])
        self.models, self._laid = list[RigModel](), list[State]()
        known = dict[tuple[float, ...], tuple[RigModel, State]]()  # runs that differ in speed
        for i, (beta, T_0, R, span, EI, EA, *k) in enumerate(inputs.tolist()):
            point = OperatingPoint(beta, T_0, self.speeds[self.label[i]] / R)
            if (key := tuple(inputs[i])) not in known:
                belt, rig = bench.belt._replace(EI=EI, EA=EA), replace(bench.rig, R=R, span=span)
                of_run = replace(bench, belt=belt, rig=rig, law=NormalLaw(*k))
                if isinstance(mesh, float):
                    default = of_run.model(point).nodes.size - 1
                    model = of_run.model(point, 2 * round(0.5 * mesh * default))
                else:
                    model = of_run.model(point, mesh[i])
                known[key] = model, lay_on(model)
            model, laid = known[key]
            self.models.append(replace(model, point=point))
            self._laid.append(laid)

    def slide(self, surfaces: Sequence[FrictionSurface]) -> list[RunResult]:
        """Compute the sliding limit of every run with the surface of its speed."""
        runs = list[RunResult]()
        for model, laid, speed in zip(self.models, self._laid, self.label, strict=True):
            of_run = model.with_surface(surfaces[speed])
            runs.append(RunResult(of_run, slide(of_run, laid), None))
        return runs

    def log_mu(self, surfaces: Sequence[FrictionSurface], speed_slope: Array) -> Array:
        """Simulate the logarithms of the coefficients (n,), corrected for the speed of each run."""
        mu = [run.mu for run in self.slide(surfaces)]
        return np.asarray(np.log(mu) + self.off_speed * speed_slope)


def residual_changes(
    campaign: Campaign,
    sources: Sequence[Source],
    surfaces: Sequence[FrictionSurface],
    speeds: Array,
    speed_slope: Array,
) -> tuple[Array, Array]:
    """Compute the change of measured minus simulated ln mu by one u of each source (n, K).

    `surfaces` holds the surface at each of the speeds [m/s], `speed_slope` the derivative of ln mu
    of each run by ln v (n,). Also returned are the derivatives of the simulated ln mu by the ln of
    `INPUTS` (n, 8), zero if no source is an error of the bench.
    """
    before, slopes = campaign.measured, np.zeros((campaign.measured.mu.size, len(INPUTS)))
    inputs = campaign.inputs(before, Errors())
    if not {source.error for source in sources} <= {*REDUCTION_SOURCES, *EFFECT_SOURCES}:
        rig, steps = RigRuns(campaign, speeds, MESH), 1.0 + STEP * np.eye(len(INPUTS))
        nominal = rig.log_mu(surfaces, speed_slope)
        for k, step in enumerate(steps):
            near = RigRuns(campaign, speeds, rig.models, inputs * step)
            slopes[:, k] = (near.log_mu(surfaces, speed_slope) - nominal) / np.log1p(STEP)

    def residual(errors: Errors) -> Array:
        """Return the residual with errors corrected, less that without."""
        after = before.corrected(errors)
        corrected = campaign.inputs(after, errors)
        known = (inputs > 0.0) & (corrected > 0.0)  # either coefficient of the law may be zero
        steps = np.log(np.divide(corrected, inputs, out=np.ones_like(inputs), where=known))
        simulated = np.sum(slopes * steps, axis=1)
        simulated += speed_slope * np.log(after.slip_speed / before.slip_speed)
        return np.asarray(np.log(after.mu / before.mu) - simulated)

    return changes_by(sources, residual), slopes


MESH_SHARE = 0.4
"""Mesh error as a share of the change by twice as many elements: a third remains at order two,
times 1.25, the safety factor of the grid convergence index (ASME V&V 20-2009, section 2)."""
ARRAYS = ("simulated", "difference", "scatter", "numerical", "by_setting")


@dataclass(frozen=True, slots=True)
class RunsUncertainty:
    """Uncertainty of simulated runs, arrays by run; all but `mu` is stored in the metadata."""

    sources: tuple[Source, ...]  # shared errors
    runs: tuple[str, ...]  # labels of the runs
    simulated: Array  # change of ln mu by one standard uncertainty of each source, (n, K)
    difference: Array  # the same less that of the measured ln mu, (n, K)
    scatter: Array  # standard uncertainty by the scatter behind the surface, (n,)
    numerical: Array  # by mesh and time steps, (n,)
    by_setting: Array
    """Derivatives of ln mu by the ln of initial tension and speed, for settings that a bench
    misses, (n, 2)."""
    mu: Array | None = None  # in the sliding limit, (n,)

    @classmethod
    def joined(cls, parts: Sequence[Self], runs: Sequence[str]) -> Self:
        """Join groups of runs, whose sources may differ, under the labels of all runs."""
        sources = {source.key: source for part in parts for source in part.sources}
        arrays = {name: [getattr(part, name) for part in parts] for name in (*ARRAYS, "mu")}
        for k, part in enumerate(parts):
            places = [[*sources].index(source.key) for source in part.sources]
            for name in ("simulated", "difference"):
                arrays[name][k] = arrays[name][k] @ np.eye(len(sources))[places]
        joined = {name: np.concatenate(values) for name, values in arrays.items()}
        return cls(tuple(sources.values()), tuple(runs), **joined)

    def extra(self) -> dict[str, Any]:
        """Return it as JSON data."""
        return {name: value for name, value in asdict(self).items() if name != "mu"}


def runs_uncertainty_of(extra: Mapping[str, Any]) -> RunsUncertainty | None:
    """Read the uncertainty in the metadata of a simulated recording; None if there is none."""
    if not (stored := extra.get("uncertainty")):
        return None
    arrays = {name: np.array(stored[name], dtype=float) for name in ARRAYS}
    sources = tuple(Source(**row) for row in stored["sources"])
    return RunsUncertainty(sources, tuple(stored["runs"]), **arrays)


def simulated_uncertainty(
    campaign: Campaign,
    sources: Sequence[Source],
    elements: int | None = None,
    same_bench: bool = False,
) -> RunsUncertainty:
    """Compute the uncertainty of simulated runs (sliding limit), without labels.

    The campaign has settings and coefficients of the simulated recordings, and the bench with its
    surface, whose covariance, if it has one, contributes its shared errors: the first sources are
    those of its factor. On the `same_bench` the coefficients were measured on the bench of the
    surface, at these settings: its inputs are then without error, and no source may be one of the
    bench. Raises `ConvergenceError` if a run cannot be simulated.
    """
    surface, n = campaign.bench.surface, campaign.measured.mu.size
    if surface.factor is None:  # without a covariance the standard errors add up
        se = np.zeros((1, 1)) if surface.mu_se_nodes is None else surface.mu_se_nodes
        surface = surface.with_covariance(np.nan_to_num(se / surface.mu_nodes)[..., None])
    speeds = np.unique(campaign.measured.slip_speed)
    surfaces = [surface] * speeds.size
    rig = RigRuns(campaign, speeds, [elements] * n if elements else 1.0)
    runs = rig.slide(surfaces)
    by_surface, scatter, speed_slope, response = np.zeros((n, len(sources))), *np.zeros((3, n))
    shared = len(surface.sources)
    for i, run in enumerate(runs):
        v, (force, weight) = float(speeds[rig.label[i]]), look_ups(run, surface)
        columns = weight @ surface.factor_at(force, v)
        by_surface[i, :shared], scatter[i] = columns[:shared], np.linalg.norm(columns[shared:])
        speed_slope[i] = weight @ (surface.gradient(force, v)[1] * v / surface.mu(force, v))
        response[i] = weight.sum()
    tight, slack, mu = np.array([(r.tension_tight_N, r.tension_slack_N, r.mu) for r in runs]).T
    by_arc = response[:, None] * np.eye(int(campaign.measured.arc.max()) + 1)[campaign.measured.arc]
    measured = replace(campaign.measured, tight=tight, slack=slack, columns={ARC: by_arc})
    # build-up that is left at the end of a simulated run, and error of its time steps
    remaining = 0.0 if same_bench else np.abs(np.log(campaign.measured.mu / mu))
    campaign = replace(campaign, measured=measured)
    changes, slopes = residual_changes(campaign, sources, surfaces, speeds, speed_slope)
    difference = by_surface - changes
    finer = RigRuns(campaign, speeds, [2 * (model.nodes.size - 1) for model in rig.models])
    by_mesh = np.abs(finer.log_mu(surfaces, speed_slope) - np.log(mu))
    return RunsUncertainty(
        sources=tuple(sources),
        runs=(),
        simulated=difference + changes_by(sources, lambda e: np.log(measured.corrected(e).mu)),
        difference=difference,
        scatter=scatter,
        numerical=np.hypot(MESH_SHARE * by_mesh, remaining),
        by_setting=np.column_stack([slopes[:, INPUTS.index("initial tension")], speed_slope]),
        mu=mu,
    )


WITHIN = 2.0
"""Standard uncertainties within which a difference says nothing about the model [-]."""
SHOWN = 3  # contributions that are named
SETTINGS = (
    ("initial_tension_N", "nominal_tension_N"),
    ("pulley_speed_rad_s", "pulley_speed_rad_s"),
)
"""Column of the actual setting, and of the simulated one."""
UNKNOWN = (
    "the uncertainty of the simulated runs is not known (no artifact of simulate-rig that "
    "contains it): u_validation holds only that of the measured runs, and the scatter"
)


def validated(
    result: AgreementResult,
    measured: Mapping[str, np.ndarray],
    simulated: Mapping[str, np.ndarray],
    uncertainty: RunsUncertainty | None,
) -> tuple[
    AgreementResult, dict[str, Array], list[dict[str, Any]], dict[str, Any], tuple[str, ...]
]:
    """Return a comparison with the uncertainties ``u_validation`` of its differences.

    From the tables of reduced runs, and the uncertainty of the simulated ones if it is known. Then
    follow columns of the comparison table with absolute uncertainties of mu [-], the budget of the
    relative difference, facts (how many differences are within their uncertainty), and notes.
    """
    of_measured, of_simulated = result.rows
    mu = result.columns["mu_measured"]
    none, labels = np.zeros(mu.size), [str(label) for label in simulated["run"][of_simulated]]

    def column(table: Mapping[str, np.ndarray], name: str, rows: np.ndarray) -> Array:
        """Return the values of a column; zero where they are missing."""
        return np.nan_to_num(np.asarray(table[name], float)[rows]) if name in table else none

    whole, own = (column(measured, f"mu_sliding_{of}", of_measured) / mu for of in ("u", "se"))
    whole = np.where(whole > 0.0, whole, own)
    sources, difference, by_input = tuple[Source, ...](), np.zeros((mu.size, 0)), none[:, None]
    of_runs, numerical, missed = whole, none, none
    of_surface = column(simulated, "mu_sliding_se", of_simulated) / mu
    is_known = uncertainty is not None and set(labels) <= set(uncertainty.runs)
    if uncertainty is not None and is_known:
        rows = [uncertainty.runs.index(label) for label in labels]
        of_runs = np.nan_to_num(own_errors(measured)[of_measured]) / mu
        shared = {key: change[of_measured] for key, change in shared_columns(measured).items()}
        # if the surface was built from these runs, an error of their reduction changes both
        sources = with_sources(uncertainty.sources, reduction_sources(shared))
        difference = np.zeros((mu.size, len(sources)))
        difference[:, : len(uncertainty.sources)] = uncertainty.difference[rows]
        for k, source in enumerate(sources):
            difference[:, k] -= shared.get(source.error, none)
        actual = np.abs([column(measured, name, of_measured) for name, _ in SETTINGS])
        nominal = np.abs([column(simulated, name, of_simulated) for _, name in SETTINGS])
        known = (actual > 0.0) & (nominal > 0.0)
        ratio = np.divide(actual, nominal, out=np.ones(known.shape), where=known)
        missed = np.sum(uncertainty.by_setting[rows].T * np.log(ratio), axis=0)
        of_surface, numerical = uncertainty.scatter[rows], uncertainty.numerical[rows]
        by_input = uncertainty.simulated[rows]
    parts = {
        "scatter of the measured runs": of_runs,
        "scatter behind the simulated runs": of_surface,
        "mesh and time steps of the simulation": numerical,
        "settings that the bench missed": np.abs(missed),
    }
    u_validation = np.linalg.norm([*parts.values(), *difference.T], axis=0)
    u_input = np.linalg.norm([of_surface, missed, *by_input.T], axis=0)
    known_u = np.where(u_validation > 0.0, u_validation, np.nan)
    e_over_u = result.columns["relative_difference"] / known_u
    result = replace(result, rms_over_u=float(np.sqrt(np.mean(np.square(e_over_u)))))
    columns = {
        "u_measured": whole * mu,
        "u_input": u_input * (mu if is_known else np.nan),
        "u_numerical": numerical * (mu if is_known else np.nan),
        "u_validation": u_validation * mu,
        "e_over_u": e_over_u,
    }
    facts = {
        "n": int(mu.size),
        "within_2u": int(np.count_nonzero(np.abs(e_over_u) <= WITHIN)),
        "rms_e_over_u": result.rms_over_u if np.isfinite(result.rms_over_u) else None,
        "inputs_known": is_known,
    }
    lines = budget("difference", sources, difference, parts)
    return result, columns, lines, facts, () if is_known else (UNKNOWN,)


def dominant(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the largest contributions of a budget, in words."""
    sizes = [(row["contribution_percent"], row["source"]) for row in rows[:-1]]
    largest = sorted(sizes, key=lambda pair: -pair[0])[:SHOWN]
    return ", ".join(f"{source} {size:.2g} %" for size, source in largest if size > 0.0)
