"""The limit of full sliding: beltid's steady method against Exudyn's static solver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from beltid.rig.model import Bench
from beltid.rig.runs import RunResult, SimulationSettings, campaign, simulate
from benchmarks.exudyn_rig import TUNED, TUNED_FINE, PeerRig, PeerSettings, apparent_mu
from benchmarks.work import (
    ARCS_DEG,
    POINTS,
    SPEEDS_RAD_S,
    TENSIONS_N,
    constant_bench,
    fastest,
    surface_bench,
    worst_error,
)

Array = NDArray[np.float64]

ELEMENTS: tuple[int | None, ...] = (8, 10, 12, 14, 20, 28, 40, None)
CONVERGED = 200  # elements of the reference
ACCURACIES = {"coarse": 0.10, "fine": 0.017}  # worst error of the apparent mu [%]
PLAIN = {
    "coarse": PeerSettings(20, tolerance=1.0e-8),
    "fine": PeerSettings(40, tolerance=1.0e-8),
}
HARD = {"coarse": TUNED, "fine": TUNED_FINE}


def shared(bench: Bench, elements: int | None) -> list[RunResult]:
    """All runs with beltid as a campaign: runs that differ in speed share the belt laid on."""
    settings = SimulationSettings(method="steady", elements=elements)
    results: list[RunResult] = []
    for _, result in campaign(bench, POINTS, settings, jobs=1):
        if isinstance(result, Exception):
            raise result
        results.append(result)
    return results


def alone(bench: Bench, elements: int | None) -> list[RunResult]:
    """All runs with beltid, each by itself: model built, belt laid on and tightened, slid."""
    settings = SimulationSettings(method="steady", elements=elements)
    return [simulate(bench, point, settings) for point in POINTS]


def peer_alone(settings: PeerSettings) -> Array:
    """Tensions (120, 2) [N] of all runs with Exudyn, each by itself."""
    tensions = []
    for point in POINTS:
        rig = PeerRig(point.beta, settings)
        rig.lay_on(point.T_0)
        tensions.append(rig.slide(point.omega))
    return np.array(tensions)


def peer_shared(settings: PeerSettings) -> Array:
    """The same with one model for each arc, and the belt laid on once for each tension."""
    tensions: list[tuple[float, float]] = []
    for arc in ARCS_DEG:
        rig = PeerRig(float(np.radians(arc)), settings)
        for T_0 in TENSIONS_N:
            rig.lay_on(float(T_0))
            tensions.extend(rig.slide(omega) for omega in SPEEDS_RAD_S)
    return np.array(tensions)


def mu_of(tensions: Array) -> Array:
    """Apparent mu of all runs from their tensions (120, 2) [N]."""
    pairs = zip(tensions, POINTS, strict=True)
    return np.array([apparent_mu((T[0], T[1]), point.beta) for T, point in pairs])


@dataclass(frozen=True, slots=True)
class OwnMesh:
    """beltid with a number of elements: errors [%], iterations per run, times [s]."""

    elements: int | None
    error: float
    surface_error: float
    iterations: float
    shared: float
    alone: float
    surface_shared: float
    surface_alone: float


@dataclass(frozen=True, slots=True)
class PeerMesh:
    """Exudyn with some settings: errors [%] of mu and of the tight tension, times [s]."""

    settings: PeerSettings
    error: float
    tension_error: float
    shared: float
    alone: float


@dataclass(frozen=True, slots=True)
class SteadyComparison:
    """All of the comparison; plain and hard peers by accuracy."""

    own: list[OwnMesh]
    plain: dict[str, PeerMesh]
    hard: dict[str, PeerMesh]

    def own_for(self, accuracy: float) -> OwnMesh:
        """The coarsest mesh whose worst error is not above ``accuracy`` [%], mu constant."""
        return next(own for own in self.own if own.error <= accuracy)

    def own_for_surface(self, accuracy: float) -> OwnMesh:
        """The same with the surface."""
        return next(own for own in self.own if own.surface_error <= accuracy)


def compare_steady(rounds: int) -> SteadyComparison:
    """Measure beltid and Exudyn in turns."""
    plain, varied = constant_bench(), surface_bench()
    tasks: dict[str, Callable[[], object]] = {}
    for n in ELEMENTS:
        tasks[f"shared {n}"] = partial(shared, plain, n)
        tasks[f"alone {n}"] = partial(alone, plain, n)
        tasks[f"surface shared {n}"] = partial(shared, varied, n)
        tasks[f"surface alone {n}"] = partial(alone, varied, n)
    for settings in (*PLAIN.values(), *HARD.values()):
        tasks[f"peer shared {settings}"] = partial(peer_shared, settings)
        tasks[f"peer alone {settings}"] = partial(peer_alone, settings)
    for n in ELEMENTS:  # warm-up; the peer is warmed up by the measurement of its errors
        shared(varied, n)
    reference = shared(plain, CONVERGED)
    varied_mu = np.array([r.mu for r in shared(varied, CONVERGED)])
    peers = {s: peer_alone(s) for s in (*PLAIN.values(), *HARD.values())}
    times = fastest(tasks, rounds)
    return SteadyComparison(
        own=[_own(n, times, reference, varied_mu) for n in ELEMENTS],
        plain={key: _peer(s, times, reference, peers[s]) for key, s in PLAIN.items()},
        hard={key: _peer(s, times, reference, peers[s]) for key, s in HARD.items()},
    )


def _own(
    n: int | None, times: dict[str, float], reference: list[RunResult], varied_mu: Array
) -> OwnMesh:
    results, varied = shared(constant_bench(), n), shared(surface_bench(), n)
    return OwnMesh(
        elements=n,
        error=worst_error(np.array([r.mu for r in results]), np.array([r.mu for r in reference])),
        surface_error=worst_error(np.array([r.mu for r in varied]), varied_mu),
        iterations=float(np.mean([r.record.newton_iterations for r in results])),
        shared=times[f"shared {n}"],
        alone=times[f"alone {n}"],
        surface_shared=times[f"surface shared {n}"],
        surface_alone=times[f"surface alone {n}"],
    )


def _peer(
    settings: PeerSettings, times: dict[str, float], reference: list[RunResult], tensions: Array
) -> PeerMesh:
    return PeerMesh(
        settings=settings,
        error=worst_error(mu_of(tensions), np.array([r.mu for r in reference])),
        tension_error=worst_error(tensions[:, 0], np.array([r.tension_tight_N for r in reference])),
        shared=times[f"peer shared {settings}"],
        alone=times[f"peer alone {settings}"],
    )
