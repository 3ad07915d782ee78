"""Uncertainty of simulated runs, and of their difference from measured ones (ASME V&V 20).

An error of the bench acts on the measured values and on the inputs of the simulation (the surface
built from the same bench; arc, tension, radius, stiffnesses), and may cancel in their difference.
Therefore the changes of the simulated ln mu and of the difference are kept by source, with their
signs. The comparison error of simulation and experiment says something about the model only beyond

    u_val² = u_num² + u_input² + u_D²

(ASME V&V 20-2009, Eq. 1-5-9), where each error that inputs and data share enters with its total
change (section 5-3 there). The scatter behind the surface is added as if it were independent of
that of the run, which is conservative by the few percent that one run weighs in it. A setting that
the bench missed and the simulation did not is a known error without correction: it counts in full.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from beltid.identify.agreement import AgreementResult
from beltid.laws.friction_surface import FrictionSurface
from beltid.uncertainty.measured import own_errors, shared_columns
from beltid.uncertainty.rig_runs import INPUTS, Campaign, RigRuns, input_slopes, residual_changes
from beltid.uncertainty.sources import (
    ARC,
    Scatter,
    Source,
    budget,
    changes_by,
    reduction_sources,
    sources_of,
)

Array = NDArray[np.float64]

DIGITS: Final = 5  # of what is stored
MESH_SHARE: Final = 0.4
"""Mesh error as a share of the change by twice as many elements: a third remains at order two,
times 1.25, the safety factor of the grid convergence index (ASME V&V 20-2009, section 2)."""
ARRAYS: Final = ("simulated", "difference", "scatter", "numerical", "by_setting")


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
        sources = dict[tuple[str, int], Source]()
        for source in (source for part in parts for source in part.sources):
            sources.setdefault((source.error, source.place), source)
        places = {key: k for k, key in enumerate(sources)}
        arrays = {name: [getattr(part, name) for part in parts] for name in (*ARRAYS, "mu")}
        for name in ("simulated", "difference"):
            for k, part in enumerate(parts):
                aligned = np.zeros((len(arrays[name][k]), len(places)))
                aligned[:, [places[s.error, s.place] for s in part.sources]] = arrays[name][k]
                arrays[name][k] = aligned
        joined = {name: np.concatenate(values) for name, values in arrays.items()}
        return cls(tuple(sources.values()), tuple(runs), **joined)

    def extra(self) -> dict[str, Any]:
        """Return it as JSON data, with as many digits as an uncertainty needs."""
        arrays = {}
        for name in ARRAYS:
            values = getattr(self, name)
            short = [float(f"{x:.{DIGITS}g}") for x in values.ravel()]
            arrays[name] = np.reshape(short, values.shape).tolist()
        sources = [asdict(source) for source in self.sources]
        return {"sources": sources, "runs": list(self.runs), **arrays}


def runs_uncertainty_of(extra: Mapping[str, Any]) -> RunsUncertainty | None:
    """Read the uncertainty in the metadata of a simulated recording; None if there is none."""
    stored = extra.get("uncertainty")
    if not stored:
        return None
    arrays = {name: np.array(stored[name], dtype=float) for name in ARRAYS}
    return RunsUncertainty(sources_of(stored["sources"]), tuple(stored["runs"]), **arrays)


def simulated_uncertainty(
    campaign: Campaign,
    sources: Sequence[Source],
    elements: int | None = None,
    same_bench: bool = False,
) -> RunsUncertainty:
    """Compute the uncertainty of simulated runs (sliding limit), without labels.

    Parameters
    ----------
    campaign : Campaign
        Settings and coefficients of the simulated recordings; the bench with its surface, whose
        covariance, if it has one, contributes its shared errors.
    sources : sequence of Source
        Errors; the first ones belong to the columns of the surface's factor.
    elements : int, optional
        Belt elements; by default as in the simulation.
    same_bench : bool
        Whether the surface is of this bench and the coefficients were measured at these settings:
        its inputs are then without error, and no source may be one of the bench.

    Raises
    ------
    ConvergenceError
        If a run cannot be simulated.
    """
    surface, n = campaign.bench.surface, campaign.measured.mu.size
    speeds = np.unique(campaign.measured.slip_speed)
    surfaces = [surface] * speeds.size
    rig = RigRuns(campaign, speeds, [elements] * n if elements else 1.0)
    runs = rig.slide(surfaces)
    by_surface, scatter, speed_slope = np.zeros((n, len(sources))), np.zeros(n), np.zeros(n)
    for i, run in enumerate(runs):
        v = float(speeds[rig.label[i]])
        shared, scatter[i] = _of_surface(surface, run.force, v, run.weight)
        by_surface[i, : shared.size] = shared
        _, per_v = surface.gradient(run.force, v)
        speed_slope[i] = float(run.weight @ (per_v * v / surface.mu(run.force, v)))
    tight, slack, mu = np.array([(run.tight, run.slack, run.mu) for run in runs]).T
    response = np.array([run.weight.sum() for run in runs])
    arc = campaign.measured.arc
    by_arc = {ARC: response[:, None] * np.eye(int(arc.max()) + 1)[arc]}
    measured = replace(campaign.measured, tight=tight, slack=slack, mu=mu, columns=by_arc)
    slopes, remaining = np.zeros((n, len(INPUTS))), np.zeros(n)
    if not same_bench:
        slopes = input_slopes(campaign, surfaces, speeds, speed_slope)
        # build-up that is left at the end of a simulated run, and error of its time steps
        remaining = np.abs(np.log(campaign.measured.mu / mu))
    campaign = replace(campaign, measured=measured)
    difference = by_surface - residual_changes(campaign, sources, slopes, speed_slope)
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


def _of_surface(
    surface: FrictionSurface, force: Array, speed: float, weight: Array
) -> tuple[Array, float]:
    """Return the change of ln mu of a run by each source of its surface, and by scatter."""
    if surface.factor is not None:
        columns = weight @ surface.factor_at(force, speed)
        shared = len(surface.sources)
        return columns[:shared], float(np.linalg.norm(columns[shared:]))
    relative = surface.mu_se_at(force, speed) / surface.mu(force, speed)
    return np.zeros(0), float(np.abs(weight) @ np.where(np.isfinite(relative), relative, 0.0))


WITHIN: Final = 2.0
"""Standard uncertainties within which a difference says nothing about the model [-]."""
SHOWN: Final = 3  # contributions that are named
SETTINGS: Final = (
    ("initial_tension_N", "nominal_tension_N"),
    ("pulley_speed_rad_s", "pulley_speed_rad_s"),
)
"""Column of the actual setting, and of the simulated one."""
SCATTERS: Final = (
    "scatter of the measured runs",
    "scatter behind the simulated runs",
    "mesh and time steps of the simulation",
    "settings that the bench missed",
)
UNKNOWN: Final = (
    "the uncertainty of the simulated runs is not known (no artifact of simulate-rig that "
    "contains it): u_validation holds only that of the measured runs, and the scatter"
)


class Validation(NamedTuple):
    """What a comparison says of its uncertainties."""

    columns: dict[str, Array]  # of the comparison table: absolute uncertainties of mu [-], (n,)
    budget: list[dict[str, Any]]  # of the relative difference
    facts: dict[str, Any]
    """How many differences are within their uncertainty, and their ratio."""
    notes: tuple[str, ...]


def validated(
    result: AgreementResult,
    measured: Mapping[str, np.ndarray],
    simulated: Mapping[str, np.ndarray],
    uncertainty: RunsUncertainty | None,
) -> tuple[AgreementResult, Validation]:
    """Return a comparison with the uncertainties ``u_validation`` of its differences, and parts.

    From the tables of reduced runs, and the uncertainty of the simulated ones if it is known.
    """
    of_measured, of_simulated = result.rows
    mu = result.mu_measured
    none = np.zeros(mu.size)

    def column(table: Mapping[str, np.ndarray], name: str, rows: np.ndarray) -> Array:
        """Return the values of a column; zero where they are missing."""
        return np.nan_to_num(np.asarray(table[name], float)[rows]) if name in table else none

    scatter = column(measured, "mu_sliding_se", of_measured) / mu
    of_runs = column(measured, "mu_sliding_u", of_measured) / mu
    whole = np.where(of_runs > 0.0, of_runs, scatter)
    labels = [str(simulated["run"][i]) for i in of_simulated]
    if uncertainty is None or not set(labels) <= set(uncertainty.runs):
        uncertainty, sources = None, tuple[Source, ...]()
        scatters = whole, column(simulated, "mu_sliding_se", of_simulated) / mu, none, none
        of_simulated_runs = difference = np.zeros((mu.size, 0))
    else:
        rows = [uncertainty.runs.index(label) for label in labels]
        # if the surface was built from these runs, an error of their reduction changes both
        shared = {key: values[of_measured] for key, values in shared_columns(measured).items()}
        present = {source.error for source in uncertainty.sources}
        added = tuple(source for source in reduction_sources(shared) if source.error not in present)
        sources, more = (*uncertainty.sources, *added), np.zeros((mu.size, len(added)))
        of_simulated_runs = np.hstack([uncertainty.simulated[rows], more])
        difference = np.hstack([uncertainty.difference[rows], more])
        of_reduction = [shared.get(source.error, none) for source in sources]
        difference -= np.reshape(of_reduction, difference.T.shape).T
        missed = np.zeros((2, mu.size))  # ln of the actual over the simulated setting
        for k, names in enumerate(SETTINGS):
            actual = np.abs(column(measured, names[0], of_measured))
            nominal = np.abs(column(simulated, names[1], of_simulated))
            is_known = (actual > 0.0) & (nominal > 0.0)
            missed[k, is_known] = np.log(actual[is_known] / nominal[is_known])
        by_setting = np.sum(uncertainty.by_setting[rows] * missed.T, axis=1)
        own = own_errors(measured)
        of_samples = scatter if own is None else np.nan_to_num(own[of_measured]) / mu
        of_surface, numerical = uncertainty.scatter[rows], uncertainty.numerical[rows]
        scatters = of_samples, of_surface, numerical, np.abs(by_setting)
    u_validation = np.sqrt(np.sum(np.square([*scatters, *difference.T]), axis=0))
    result = replace(result, u_validation=u_validation)
    inputs, unknown = [scatters[1], scatters[3], *of_simulated_runs.T], np.full(mu.size, np.nan)
    columns = {
        "u_measured": whole * mu,
        "u_input": unknown if uncertainty is None else mu * np.linalg.norm(inputs, axis=0),
        "u_numerical": unknown if uncertainty is None else mu * scatters[2],
        "u_validation": u_validation * mu,
        "e_over_u": result.error_over_uncertainty,
    }
    parts = map(Scatter, SCATTERS, scatters)
    ratio, rms = np.abs(result.error_over_uncertainty), result.rms_error_over_uncertainty
    facts = {
        "n": int(mu.size),
        "within_2u": int(np.count_nonzero(ratio <= WITHIN)),
        "rms_e_over_u": rms if np.isfinite(rms) else None,
        "inputs_known": uncertainty is not None,
    }
    notes = () if uncertainty else (UNKNOWN,)
    rows_of_budget = budget("difference", sources, difference, *parts)
    return result, Validation(columns, rows_of_budget, facts, notes)


def dominant(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the largest contributions of a budget, in words."""
    parts = [row for row in rows[:-1] if row["contribution_percent"] > 0.0]
    parts.sort(key=lambda row: -row["contribution_percent"])
    words = (f"{row['source']} {row['contribution_percent']:.2g} %" for row in parts[:SHOWN])
    return ", ".join(words)
