"""Uncertainty of simulated runs, and of their difference from measured ones.

An error of the bench acts on a comparison in two ways: on the measured values, and on the inputs of
the simulation (the surface built from the same bench; arc, tension, radius, stiffnesses). Both
change together: an arc error changes the measured coefficient and a surface built from it alike,
and cancels in their difference. Therefore the changes of the simulated ln mu and of the difference
are kept by source, with their signs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from beltid.identify.friction.kinds import TWO_CELLS, RigKind
from beltid.laws.friction_surface import FrictionSurface
from beltid.params import OperatingPoint, Rig
from beltid.refine.effects import arc_effect
from beltid.refine.rig_runs import MeasuredRun, RigRuns, lookup_weights, mesh_of
from beltid.rig.model import Bench, RigModel
from beltid.uncertainty.campaign import Campaign
from beltid.uncertainty.measured import Measured
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.refined import INPUTS, residual_change, simulated_slopes
from beltid.uncertainty.sources import Errors, Source

Array = NDArray[np.float64]

DIGITS = 5
MESH_SHARE = 0.4
"""Mesh error as a share of the change by twice as many elements: a third remains at order two,
times 1.25, the safety factor of the grid convergence index (ASME V&V 20-2009, section 2)."""
ARRAYS = ("simulated", "difference", "scatter", "numerical", "by_setting")
FINER_MESH = 2.0
"""Ratio of elements in the finer mesh that shows the mesh error."""


@dataclass(frozen=True, slots=True)
class SimulatedUncertainty:
    """Relative changes of simulated coefficients, arrays by run.

    Attributes
    ----------
    simulated : ndarray, shape (n, K)
        Change of the simulated coefficient by one standard uncertainty of each source.
    difference : ndarray, shape (n, K)
        Change of simulated minus measured coefficient.
    scatter : ndarray, shape (n,)
        Standard uncertainty by the scatter behind the surface.
    mesh : ndarray, shape (n,)
        Change by twice as many elements.
    mu : ndarray, shape (n,)
        Simulated coefficient in the sliding limit [-].
    by_setting : ndarray, shape (n, 2)
        Derivatives of ln mu by the ln of initial tension and speed, for settings that a bench
        misses.
    """

    simulated: Array
    difference: Array
    scatter: Array
    mesh: Array
    mu: Array
    by_setting: Array


@dataclass(frozen=True, slots=True)
class RunsUncertainty:
    """Uncertainty of simulated runs as stored in the metadata, arrays by run.

    Attributes
    ----------
    sources : tuple of Source
        Shared errors.
    runs : tuple of str
        Labels of the runs.
    simulated, difference : ndarray, shape (n, K)
        Relative changes of the simulated coefficient, and of its difference from the measured one.
    scatter, numerical : ndarray, shape (n,)
        Relative standard uncertainties.
    by_setting : ndarray, shape (n, 2)
        Derivatives of ln mu by the ln of initial tension and speed.
    """

    sources: tuple[Source, ...]
    runs: tuple[str, ...]
    simulated: Array
    difference: Array
    scatter: Array
    numerical: Array
    by_setting: Array

    @classmethod
    def of(
        cls,
        runs: Sequence[str],
        mu: Array,
        sources: tuple[Source, ...],
        parts: Sequence[SimulatedUncertainty],
    ) -> Self:
        """Combine the uncertainties of groups of runs, in the same order.

        Parameters
        ----------
        runs : sequence of str
            Labels of the runs.
        mu : ndarray, shape (n,)
            Simulated coefficients [-].
        sources : tuple of Source
            Shared errors.
        parts : sequence of SimulatedUncertainty
            The groups.
        """
        mesh = np.concatenate([part.mesh for part in parts])
        limit = np.concatenate([part.mu for part in parts])
        # remaining build-up at the end of a simulated run, and error of its time steps
        remaining = np.abs(np.log(mu / limit))
        return cls(
            sources=sources,
            runs=tuple(runs),
            simulated=np.concatenate([part.simulated for part in parts]),
            difference=np.concatenate([part.difference for part in parts]),
            scatter=np.concatenate([part.scatter for part in parts]),
            numerical=np.hypot(MESH_SHARE * mesh, remaining),
            by_setting=np.concatenate([part.by_setting for part in parts]),
        )

    def extra(self) -> dict[str, Any]:
        """Return it as JSON data."""
        return {
            "sources": [asdict(source) for source in self.sources],
            "runs": list(self.runs),
            **{name: _short(getattr(self, name)) for name in ARRAYS},
        }


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
    sources = sources_of(stored["sources"])
    arrays = {name: np.array(stored[name], dtype=float) for name in ARRAYS}
    return RunsUncertainty(sources=sources, runs=tuple(stored["runs"]), **arrays)


def sources_of(stored: Sequence[Mapping[str, Any]]) -> tuple[Source, ...]:
    """Read sources of error from metadata."""
    return tuple(Source(**{name: row[name] for name in Source.__slots__}) for row in stored)


def simulated_uncertainty(
    bench: Bench,
    press: PressLaw,
    points: Sequence[OperatingPoint],
    arc: NDArray[np.intp],
    sources: Sequence[Source],
    elements: int | None = None,
    kind: RigKind = TWO_CELLS,
) -> SimulatedUncertainty:
    """Compute the uncertainty of simulated runs (sliding limit).

    Parameters
    ----------
    bench : Bench
        The bench; only a surface with a covariance contributes its shared errors.
    press : PressLaw
        Its contact law with the fit to the press.
    points : sequence of OperatingPoint
        The runs.
    arc : ndarray of int, shape (n,)
        Number of the arc setting of each run, as in the sources.
    sources : sequence of Source
        Errors; the first ones belong to the columns of the surface's factor.
    elements : int, optional
        Belt elements; by default as in the simulation.
    kind : RigKind
        What the simulated bench measures.

    Raises
    ------
    ConvergenceError
        If a run cannot be simulated.
    """
    runs = [MeasuredRun(point, 1.0, 0.0) for point in points]
    omegas = np.unique([point.omega for point in points])
    speeds = omegas * bench.rig.R
    rig = RigRuns(bench, runs, speeds, _counts(bench, runs, elements, 1.0))
    n, surface = len(runs), bench.surface
    by_surface, scatter = np.zeros((n, len(sources))), np.zeros(n)
    log_mu, speed_slope, response, tensions = *np.zeros((3, n)), np.zeros((n, 2))
    for i, (model, state) in enumerate(rig.slide([surface] * speeds.size)):
        v = float(speeds[rig.label[i]])
        mu, force, weight = lookup_weights(model, state, surface)
        shared, scatter[i] = _of_surface(surface, force, v, weight)
        by_surface[i, : shared.size] = shared
        _, per_v = surface.gradient(force, v)
        speed_slope[i] = float(weight @ (per_v * v / surface.mu(force, v)))
        log_mu[i], tensions[i], response[i] = np.log(mu), (state.T_A, state.T_B), weight.sum()
    finer = RigRuns(bench, runs, speeds, _counts(bench, runs, elements, FINER_MESH))
    change = finer.log_mu([surface] * speeds.size, speed_slope) - log_mu
    measured = _as_measured(points, tensions, np.exp(log_mu), bench.rig, kind)
    measured = replace(measured, arc=arc)
    campaign = Campaign(measured.with_effects([arc_effect(arc)], response), bench, press)
    slopes = simulated_slopes(campaign, [surface] * speeds.size, speeds, speed_slope)
    difference, simulated = np.zeros((n, len(sources))), np.zeros((n, len(sources)))
    for k, source in enumerate(sources):
        errors = Errors.single(source)
        residual = residual_change(campaign, errors, slopes, speed_slope)
        difference[:, k] = by_surface[:, k] - residual
        measured_change = np.log(campaign.measured.corrected(errors).mu / campaign.measured.mu)
        simulated[:, k] = difference[:, k] + measured_change
    return SimulatedUncertainty(
        simulated=simulated,
        difference=difference,
        scatter=scatter,
        mesh=np.abs(change),
        mu=np.exp(log_mu),
        by_setting=np.column_stack([slopes[:, INPUTS.index("initial tension")], speed_slope]),
    )


def _counts(
    bench: Bench, runs: Sequence[MeasuredRun], elements: int | None, finer: float
) -> list[int | RigModel]:
    """Return the number of elements of each run, `finer` times that of the simulation."""
    if elements is None:
        return mesh_of(bench, runs, finer)
    return [2 * round(0.5 * finer * elements)] * len(runs)


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


def _as_measured(
    points: Sequence[OperatingPoint], tensions: Array, mu: Array, rig: Rig, kind: RigKind
) -> Measured:
    """Return simulated runs in the form of measured ones."""
    return Measured(
        R=rig.R,
        kind=kind,
        given_force=rig.given_force,
        arc=np.zeros(mu.size, dtype=np.intp),
        beta=np.array([point.beta for point in points]),
        T_0=np.array([point.T_0 for point in points]),
        omega=np.array([point.omega for point in points]),
        tight=tensions[:, 0],
        slack=tensions[:, 1],
        mu=mu,
        mu_se=np.zeros(mu.size),
    )


def with_rig_sources(stored: Sequence[Source], given: Sequence[Source]) -> tuple[Source, ...]:
    """Return the sources stored with a surface, then the given ones that it lacks."""
    stored_keys = {(source.error, source.place) for source in stored}
    return (*stored, *(s for s in given if (s.error, s.place) not in stored_keys))
