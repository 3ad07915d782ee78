"""Uncertainty of simulated runs, and of their difference from measured ones.

An error of the bench acts on a comparison in two ways: on the measured values, and on the inputs of
the simulation (the surface built from the same bench; arc, tension, radius, stiffnesses). Both
change together: an arc error changes the measured coefficient and a surface built from it alike,
and cancels in their difference. Therefore the changes of the simulated ln mu and of the difference
are kept by source, with their signs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from beltid.identify.friction.kinds import TWO_CELLS, RigKind
from beltid.laws.friction_surface import FrictionSurface
from beltid.params import OperatingPoint
from beltid.rig.model import Bench
from beltid.uncertainty.measured import Measured, PressLaw
from beltid.uncertainty.rig_runs import (
    INPUTS,
    Campaign,
    RigRuns,
    input_slopes,
    mesh_of,
    residual_changes,
)
from beltid.uncertainty.sources import ARC, Source, changes_by, sources_of

Array = NDArray[np.float64]

DIGITS: Final = 5
MESH_SHARE: Final = 0.4
"""Mesh error as a share of the change by twice as many elements: a third remains at order two,
times 1.25, the safety factor of the grid convergence index (ASME V&V 20-2009, section 2)."""
FINER_MESH: Final = 2.0
"""Ratio of elements in the finer mesh that shows the mesh error."""


@dataclass(frozen=True, slots=True)
class SimulatedUncertainty:
    """Relative changes of simulated coefficients, arrays by run."""

    simulated: Array
    """Change of the simulated coefficient by one standard uncertainty of each source, (n, K)."""
    difference: Array  # change of simulated minus measured coefficient, (n, K)
    scatter: Array  # standard uncertainty by the scatter behind the surface, (n,)
    mesh: Array  # change by twice as many elements, (n,)
    mu: Array  # simulated coefficient in the sliding limit [-], (n,)
    by_setting: Array
    """Derivatives of ln mu by the ln of initial tension and speed, for settings that a bench
    misses, (n, 2)."""


@dataclass(frozen=True, slots=True)
class RunsUncertainty:
    """Uncertainty of simulated runs as stored in the metadata, arrays by run."""

    sources: tuple[Source, ...]  # shared errors
    runs: tuple[str, ...]  # labels of the runs
    simulated: Array
    """Relative changes of the simulated coefficient, and of its difference from the measured one,
    (n, K)."""
    difference: Array
    scatter: Array  # relative standard uncertainties, (n,)
    numerical: Array
    by_setting: Array  # derivatives of ln mu by the ln of initial tension and speed, (n, 2)

    @classmethod
    def of(
        cls,
        runs: Sequence[str],
        mu: Array,
        sources: tuple[Source, ...],
        parts: Sequence[SimulatedUncertainty],
    ) -> Self:
        """Combine the uncertainties of groups of runs, in the order of labels and mu (n,) [-]."""
        every = {
            f.name: np.concatenate([getattr(part, f.name) for part in parts])
            for f in fields(SimulatedUncertainty)
        }
        # remaining build-up at the end of a simulated run, and error of its time steps
        remaining = np.abs(np.log(mu / every.pop("mu")))
        numerical = np.hypot(MESH_SHARE * every.pop("mesh"), remaining)
        return cls(sources=sources, runs=tuple(runs), numerical=numerical, **every)

    def extra(self) -> dict[str, Any]:
        """Return it as JSON data."""
        arrays = {name: _short(getattr(self, name)) for name in ARRAYS}
        sources = [asdict(source) for source in self.sources]
        return {"sources": sources, "runs": list(self.runs), **arrays}


ARRAYS: Final = tuple(f.name for f in fields(RunsUncertainty) if f.name not in ("sources", "runs"))


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
    *,
    same_bench: bool = False,
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
    same_bench : bool
        Whether the surface and the measured runs are of this bench and at these settings: its
        inputs are then without error, and no source may be one of the bench.

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
    measured = Measured(
        R=bench.rig.R,
        kind=kind,
        given_force=bench.rig.given_force,
        arc=arc,
        beta=rig.beta,
        T_0=np.array([point.T_0 for point in points]),
        omega=np.array([point.omega for point in points]),
        tight=np.array([run.tight for run in runs]),
        slack=np.array([run.slack for run in runs]),
        mu=mu,
        mu_se=np.zeros(n),
        columns={ARC: response[:, None] * np.eye(int(arc.max()) + 1)[arc]},
    )
    campaign = Campaign(measured, bench, press)
    slopes = np.zeros((n, len(INPUTS)))
    if not same_bench:
        slopes = input_slopes(campaign, surfaces, speeds, speed_slope)
    difference = by_surface - residual_changes(campaign, sources, slopes, speed_slope)
    return SimulatedUncertainty(
        simulated=difference + changes_by(sources, lambda e: np.log(measured.corrected(e).mu)),
        difference=difference,
        scatter=scatter,
        mesh=np.abs(finer.log_mu(surfaces, speed_slope) - np.log(mu)),
        mu=mu,
        by_setting=np.column_stack([slopes[:, INPUTS.index("initial tension")], speed_slope]),
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
