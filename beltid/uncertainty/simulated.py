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
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from beltid.identify.agreement import AgreementResult
from beltid.identify.friction.run import TWO_CELLS, RigKind
from beltid.laws.friction_surface import FrictionSurface
from beltid.params import OperatingPoint
from beltid.rig.model import Bench
from beltid.uncertainty.measured import PressLaw, own_errors, shared_columns
from beltid.uncertainty.rig_runs import (
    INPUTS,
    Campaign,
    RigRuns,
    as_measured,
    input_slopes,
    mesh_of,
    residual_changes,
)
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

DIGITS: Final = 5
MESH_SHARE: Final = 0.4
"""Mesh error as a share of the change by twice as many elements: a third remains at order two,
times 1.25, the safety factor of the grid convergence index (ASME V&V 20-2009, section 2)."""
FINER_MESH: Final = 2.0  # ratio of elements in the finer mesh that shows the mesh error


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
    mu: Array = field(default_factory=lambda: np.zeros(0))  # in the sliding limit, (n,)

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Join the uncertainties of groups of runs with the same sources."""
        names = (*ARRAYS, "mu")
        every = {name: np.concatenate([getattr(p, name) for p in parts]) for name in names}
        return cls(parts[0].sources, tuple(label for p in parts for label in p.runs), **every)

    def extra(self) -> dict[str, Any]:
        """Return it as JSON data."""
        arrays = {name: _short(getattr(self, name)) for name in ARRAYS}
        sources = [asdict(source) for source in self.sources]
        return {"sources": sources, "runs": list(self.runs), **arrays}


ARRAYS: Final = ("simulated", "difference", "scatter", "numerical", "by_setting")


def _short(values: Array) -> list[Any]:
    """Convert to nested lists with few digits, enough for an uncertainty."""
    return [
        _short(row) if np.ndim(row) else float(f"{row:.{DIGITS}g}") for row in np.asarray(values)
    ]


def runs_uncertainty_of(extra: Mapping[str, Any]) -> RunsUncertainty | None:
    """Read the uncertainty in the metadata of a simulated recording; None if there is none."""
    stored = extra.get("uncertainty")
    if not stored:
        return None
    arrays = {name: np.array(stored[name], dtype=float) for name in ARRAYS}
    return RunsUncertainty(sources_of(stored["sources"]), tuple(stored["runs"]), **arrays)


def simulated_uncertainty(
    bench: Bench,
    press: PressLaw,
    points: Sequence[OperatingPoint],
    arc: NDArray[np.intp],
    sources: Sequence[Source],
    elements: int | None = None,
    kind: RigKind = TWO_CELLS,
    same_bench: bool = False,
    labels: Sequence[str] = (),
    found: Array | None = None,
) -> RunsUncertainty:
    """Compute the uncertainty of simulated runs (sliding limit).

    Parameters
    ----------
    bench, press, kind
        The bench, its contact law with the fit to the press, and what it measures; only a surface
        with a covariance contributes its shared errors.
    points, labels, arc
        The runs, their labels, and the number of the arc setting of each, as in the sources (n,).
    sources : sequence of Source
        Errors; the first ones belong to the columns of the surface's factor.
    elements : int, optional
        Belt elements; by default as in the simulation.
    same_bench : bool
        Whether the surface and the measured runs are of this bench and at these settings: its
        inputs are then without error, and no source may be one of the bench.
    found : ndarray, shape (n,), optional
        Coefficients of the simulated recordings [-]; by default those of the sliding limit.

    Raises
    ------
    ConvergenceError
        If a run cannot be simulated.
    """
    surface, n = bench.surface, len(points)
    speeds = np.unique([point.omega for point in points]) * bench.rig.R
    surfaces = [surface] * speeds.size
    mesh = [elements] * n if elements else mesh_of(bench, points, 1.0)
    rig = RigRuns(bench, points, speeds, mesh)
    runs = rig.slide(surfaces)
    by_surface, scatter, speed_slope = np.zeros((n, len(sources))), np.zeros(n), np.zeros(n)
    for i, run in enumerate(runs):
        v = float(speeds[rig.label[i]])
        shared, scatter[i] = _of_surface(surface, run.force, v, run.weight)
        by_surface[i, : shared.size] = shared
        _, per_v = surface.gradient(run.force, v)
        speed_slope[i] = float(run.weight @ (per_v * v / surface.mu(run.force, v)))
    mu = np.array([run.mu for run in runs])
    finer = RigRuns(bench, points, speeds, [2 * round(0.5 * FINER_MESH * m) for m in mesh])
    response = np.array([run.weight.sum() for run in runs])
    tensions = np.array([run.tight for run in runs]), np.array([run.slack for run in runs])
    measured = as_measured(bench, points, tensions, arc, kind)
    by_arc = response[:, None] * np.eye(int(arc.max()) + 1)[arc]
    measured = replace(measured, columns={ARC: by_arc})
    campaign = Campaign(measured, bench, press)
    slopes = np.zeros((n, len(INPUTS)))
    if not same_bench:
        slopes = input_slopes(campaign, surfaces, speeds, speed_slope)
    difference = by_surface - residual_changes(campaign, sources, slopes, speed_slope)
    # remaining build-up at the end of a simulated run, and error of its time steps
    remaining = 0.0 if found is None else np.abs(np.log(found / mu))
    by_mesh = np.abs(finer.log_mu(surfaces, speed_slope) - np.log(mu))
    return RunsUncertainty(
        sources=tuple(sources),
        runs=tuple(labels),
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


@dataclass(frozen=True, slots=True)
class Validation:
    """Relative standard uncertainties of compared runs, arrays (n,)."""

    measured: Array  # of the measured coefficient: shared errors and scatter
    measured_scatter: Array  # scatter only
    simulated_scatter: Array  # of the simulated coefficient by scatter
    numerical: Array  # by mesh and time steps
    settings: Array  # change of the coefficient by the settings that the bench missed
    simulated: Array  # changes of the simulated coefficient by each shared source, (n, K)
    difference: Array  # changes of the difference by each shared source, (n, K)
    sources: tuple[Source, ...] = ()  # shared errors
    inputs_known: bool = False  # whether the uncertainty of the simulated runs is known

    @property
    def u_input(self) -> Array:
        """Standard uncertainty of the simulated coefficient by its inputs (n,)."""
        own = np.column_stack([self.simulated, self.simulated_scatter, self.settings])
        return np.asarray(np.linalg.norm(own, axis=1))

    @property
    def u_validation(self) -> Array:
        """Standard uncertainty of the difference (n,)."""
        own = (self.measured_scatter, self.simulated_scatter, self.numerical, self.settings)
        return np.asarray(np.linalg.norm(np.column_stack([self.difference, *own]), axis=1))

    def columns(self, result: AgreementResult) -> dict[str, Array]:
        """Return columns of the comparison table: absolute uncertainties of mu [-]."""
        mu = result.columns["mu_measured"]
        known = mu * (1.0 if self.inputs_known else np.nan)
        return {
            "u_measured": self.measured * mu,
            "u_input": self.u_input * known,
            "u_numerical": self.numerical * known,
            "u_validation": self.u_validation * mu,
            "e_over_u": result.error_over_uncertainty,
        }

    def budget(self) -> list[dict[str, Any]]:
        """Return the rows of the budget of the difference."""
        return budget(
            "difference",
            self.sources,
            self.difference,
            Scatter("scatter of the measured runs", self.measured_scatter),
            Scatter("scatter behind the simulated runs", self.simulated_scatter),
            Scatter("mesh and time steps of the simulation", self.numerical),
            Scatter("settings that the bench missed", self.settings),
        )

    def facts(self, result: AgreementResult) -> dict[str, Any]:
        """Return how many differences are within their uncertainty, and their ratio."""
        ratio = np.abs(result.error_over_uncertainty)
        rms = result.rms_error_over_uncertainty
        return {
            "n": int(ratio.size),
            "within_2u": int(np.count_nonzero(ratio <= WITHIN)),
            "rms_e_over_u": rms if np.isfinite(rms) else None,
            "inputs_known": self.inputs_known,
        }

    def notes(self) -> tuple[str, ...]:
        """Return notes for the reader."""
        if self.inputs_known:
            return ()
        return (
            "the uncertainty of the simulated runs is not known (no artifact of simulate-rig that "
            "contains it): u_validation holds only that of the measured runs, and the scatter",
        )


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
    mu = result.columns["mu_measured"]

    def column(table: Mapping[str, np.ndarray], name: str, rows: np.ndarray) -> Array:
        """Return the values of a column; zero where they are missing."""
        return np.nan_to_num(np.asarray(table[name], float)[rows]) if name in table else 0.0 * mu

    scatter = column(measured, "mu_sliding_se", of_measured) / mu
    combined = column(measured, "mu_sliding_u", of_measured) / mu
    whole, none = np.where(combined > 0.0, combined, scatter), np.zeros(mu.size)
    labels = [str(simulated["run"][i]) for i in of_simulated]
    if uncertainty is None or not set(labels) <= set(uncertainty.runs):
        of_simulation = column(simulated, "mu_sliding_se", of_simulated) / mu
        empty = np.zeros((mu.size, 0))
        parts = Validation(whole, whole, of_simulation, none, none, empty, empty)
        return replace(result, u_validation=parts.u_validation), parts

    def missed(name: str, stated: str) -> Array:
        """Return ln of the actual over the simulated setting; zero if one is unknown."""
        actual = np.abs(column(measured, name, of_measured))
        nominal = np.abs(column(simulated, stated, of_simulated))
        known = (actual > 0.0) & (nominal > 0.0)
        return np.log(np.where(known, actual, 1.0) / np.where(known, nominal, 1.0))

    rows = [uncertainty.runs.index(label) for label in labels]
    settings = [
        missed("initial_tension_N", "nominal_tension_N"),
        missed("pulley_speed_rad_s", "pulley_speed_rad_s"),
    ]
    by_setting = np.sum(uncertainty.by_setting[rows] * np.column_stack(settings), axis=1)
    # if the surface was built from these runs, an error of their reduction changes both
    shared = {key: values[of_measured] for key, values in shared_columns(measured).items()}
    present = {source.error for source in uncertainty.sources}
    added = tuple(source for source in reduction_sources(shared) if source.error not in present)
    sources, more = (*uncertainty.sources, *added), np.zeros((mu.size, len(added)))
    of_runs = np.zeros((mu.size, len(sources)))
    for k, source in enumerate(sources):
        of_runs[:, k] = shared.get(source.error, 0.0)
    own = own_errors(measured)
    parts = Validation(
        measured=whole,
        measured_scatter=scatter if own is None else np.nan_to_num(own[of_measured]) / mu,
        simulated_scatter=uncertainty.scatter[rows],
        numerical=uncertainty.numerical[rows],
        settings=np.abs(by_setting),
        simulated=np.hstack([uncertainty.simulated[rows], more]),
        difference=np.hstack([uncertainty.difference[rows], more]) - of_runs,
        sources=sources,
        inputs_known=True,
    )
    return replace(result, u_validation=parts.u_validation), parts


def dominant(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the largest contributions, in words."""
    parts = {row["source"]: row["contribution_percent"] or 0.0 for row in rows}
    parts.pop("combined", None)
    largest = sorted(((x, name) for name, x in parts.items() if x > 0.0), key=lambda part: -part[0])
    return ", ".join(f"{name} {x:.2g} %" for x, name in largest[:SHOWN])
