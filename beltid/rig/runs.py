"""Simulate one run of the rig, or a campaign of runs."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from itertools import islice
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from beltid.errors import BeltidError, InputError
from beltid.laws.capstan import friction_coefficient, mean_normal_force
from beltid.params import OperatingPoint
from beltid.rig.model import Bench, RigModel
from beltid.rig.profile import ContactState
from beltid.rig.steady import StaticState, lay_on, slide
from beltid.rig.transient import TransientRun, run_transient

Array = NDArray[np.float64]
Method = Literal["transient", "steady"]

DEFAULT_STEPS = 130
FEWEST_STEPS = 52
LOOK_UP_S = 0.2  # longest wait for a run before signals are handled [s]


@dataclass(frozen=True, slots=True)
class SimulationSettings:
    """Settings of the simulation.

    Parameters
    ----------
    method : {"transient", "steady"}
        Time stepping from the belt at rest, or Newton's method on the sliding limit.
    elements : int, optional
        Number of belt elements, even; by default what the contact asks for.
    steps : int
        Time steps of a transient run and of its recording. A step that does not converge is
        subdivided.
    friction_solver : {"newton", "lemke"}
        Stick and slip by return mapping, or as the paper's linear complementarity problem, exactly
        set-valued, by Lemke's method; slower.
    """

    method: Method = "transient"
    elements: int | None = None
    steps: int = DEFAULT_STEPS
    friction_solver: Literal["newton", "lemke"] = "newton"

    def __post_init__(self) -> None:
        problems = []
        if self.method not in ("transient", "steady"):
            problems.append(f"method = {self.method!r}, must be 'transient' or 'steady'")
        if self.friction_solver not in ("newton", "lemke"):
            problems.append(
                f"friction_solver = {self.friction_solver!r}, must be 'newton' or 'lemke'"
            )
        if self.elements is not None and (self.elements < 4 or self.elements % 2):
            problems.append(f"elements = {self.elements}, must be even and >= 4")
        if self.steps < FEWEST_STEPS:
            problems.append(f"steps = {self.steps}, must be >= {FEWEST_STEPS}")
        if problems:
            raise InputError(problems)


@dataclass(frozen=True, slots=True)
class SolverRecord:
    """Statistics and certificate of the solver for one run.

    Attributes
    ----------
    elements, steps : int
        Belt elements; time steps (0 for the steady method).
    newton_iterations : int
        Total number of iterations.
    status_changes : int
        Changes of a point between stick and slide in all iterations, or pivots of Lemke's method.
    halvings : int
        Number of step halvings.
    residual : float
        Largest residual force of all steps over the tension [-].
    slip_m : float
        Drift: largest movement of a sticking point in its spring [m].
    cone : float
        Largest force beyond the friction cone over its limit [-].
    clamped_lookups, lookups : int
        Contact points in the sliding state: those whose line force or speed lies outside the
        measured range, and all.
    """

    elements: int
    steps: int
    newton_iterations: int
    status_changes: int
    halvings: int
    residual: float
    slip_m: float
    cone: float
    clamped_lookups: int
    lookups: int


@dataclass(frozen=True, slots=True)
class RunResult:
    """One simulated run.

    Attributes
    ----------
    tension_tight_N, tension_slack_N : float
        Forces on the supports in the sliding state [N].
    recording : dict of ndarray, or None
        time_s, tension_tight_N, tension_slack_N, pulley_speed_rad_s of a transient run.
    record : SolverRecord
        Statistics and certificate of the solver.
    sliding : ContactState
        The sliding state; its profile is :attr:`profile`.
    """

    tension_tight_N: float
    tension_slack_N: float
    recording: Mapping[str, Array] | None
    record: SolverRecord
    sliding: ContactState

    @property
    def mu(self) -> float:
        """Apparent coefficient of friction by Eq. (6) [-]."""
        beta = self.sliding.model.point.beta
        return float(friction_coefficient(self.tension_tight_N, self.tension_slack_N, beta))

    @property
    def normal_force_N_m(self) -> float:
        """Mean of Eq. (8) over the arc [N/m]."""
        R = self.sliding.model.path.R
        return float(mean_normal_force(self.tension_tight_N, self.tension_slack_N, R))

    @property
    def profile(self) -> dict[str, NDArray[np.generic]]:
        """Sliding state along the arc, see :meth:`ContactState.profile`."""
        return self.sliding.profile()


def simulate(
    bench: Bench, point: OperatingPoint, settings: SimulationSettings | None = None
) -> RunResult:
    """Simulate one run of the rig.

    Parameters
    ----------
    bench : Bench
        Belt, rig geometry, contact settings, normal law, friction surface.
    point : OperatingPoint
        Contact arc, initial tension, speed of the pulley.
    settings : SimulationSettings, optional
        Method and resolution.

    Raises
    ------
    ConvergenceError
        If an equilibrium or a step is not found.
    """
    settings = settings or SimulationSettings()
    model = bench.model(point, settings.elements)
    return _simulate_laid(bench, model, lay_on(model), settings)


def _simulate_laid(
    bench: Bench, model: RigModel, laid: StaticState, settings: SimulationSettings
) -> RunResult:
    """Simulate a run from the belt laid on and tightened."""
    sliding = slide(model, laid)
    if settings.method == "steady":
        last = ContactState(model, sliding.stretch, sliding.force, sliding.q, sliding.points)
        tensions, recording, run = (sliding.T_A, sliding.T_B), None, None
    else:
        falls = bool(np.any(np.diff(bench.surface.mu_nodes, axis=1) < 0.0))
        if settings.friction_solver == "lemke":
            from beltid.rig.lcp import march_by_lemke

            run = run_transient(model, laid, sliding, settings.steps, falls, march_by_lemke)
        else:
            run = run_transient(model, laid, sliding, settings.steps, falls)
        last, tensions = run.last, (float(run.T_A[-1]), float(run.T_B[-1]))
        recording = {
            "time_s": run.time,
            "tension_tight_N": run.T_A,
            "tension_slack_N": run.T_B,
            "pulley_speed_rad_s": run.omega,
        }
    return RunResult(*tensions, recording, _record(bench, laid, sliding, run, last), last)


def _record(
    bench: Bench,
    laid: StaticState,
    sliding: StaticState,
    run: TransientRun | None,
    last: ContactState,
) -> SolverRecord:
    """Collect the statistics and the certificate of a run."""
    touching = last.points[last.points["F_N"] > 0.0]
    outside = ~bench.surface.covers(touching["f_N"], touching["speed"])
    statics = {
        "elements": laid.points.shape[0],
        "clamped_lookups": int(np.count_nonzero(outside)),
        "lookups": touching.size,
    }
    if run is None:
        return SolverRecord(
            steps=0,
            newton_iterations=laid.iterations + sliding.iterations,
            status_changes=0,
            halvings=0,
            residual=max(laid.residual, sliding.residual),
            slip_m=0.0,
            cone=0.0,
            **statics,
        )
    steps = run.record
    return SolverRecord(
        steps=steps.size,
        newton_iterations=int(steps["iterations"].sum()),
        status_changes=int(steps["changes"].sum()),
        halvings=int(steps["halvings"].sum()),
        residual=float(steps["residual"].max()),
        slip_m=float(steps["drift"].max()),
        cone=float(steps["cone"].max()),
        **statics,
    )


def campaign(
    bench: Bench,
    points: Sequence[OperatingPoint],
    settings: SimulationSettings | None = None,
    jobs: int | None = None,
) -> Iterator[tuple[int, RunResult | BeltidError]]:
    """Simulate many runs in threads; the compiled kernels release the interpreter lock.

    Runs that differ only in speed share one laid-on and tightened belt.

    Parameters
    ----------
    bench : Bench
        Belt, rig and laws of all runs.
    points : sequence of OperatingPoint
        The runs.
    settings : SimulationSettings, optional
        Method and resolution.
    jobs : int, optional
        Threads; by default one per core.

    Yields
    ------
    index, result : int, RunResult or BeltidError
        In the order in which the runs end. The result of a run does not depend on the others. A
        failed run yields its error, and the others continue.
    """
    settings = settings or SimulationSettings()
    groups = runs_of_one_belt(points)

    def simulate_group(indices: list[int]) -> list[tuple[int, RunResult | BeltidError]]:
        return list(_simulate_together(bench, points, indices, settings))

    workers = jobs or os.cpu_count() or 1
    if workers == 1:
        for indices in groups:
            yield from _simulate_together(bench, points, indices, settings)
        return
    waiting = iter(groups)
    with ThreadPoolExecutor(max_workers=workers) as pool:
        running = {pool.submit(simulate_group, indices) for indices in islice(waiting, 2 * workers)}
        while running:
            # a signal delivered to another thread is handled only when this one wakes up
            ended, running = wait(running, LOOK_UP_S, FIRST_COMPLETED)
            for future in ended:
                yield from future.result()
            following = islice(waiting, len(ended))
            running |= {pool.submit(simulate_group, indices) for indices in following}


def runs_of_one_belt(points: Sequence[OperatingPoint]) -> list[list[int]]:
    """Group the indices of runs that differ in speed only, and share the tightened belt."""
    groups: dict[tuple[float, float], list[int]] = {}
    for index, point in enumerate(points):
        groups.setdefault((point.beta, point.T_0), []).append(index)
    return list(groups.values())


def _simulate_together(
    bench: Bench,
    points: Sequence[OperatingPoint],
    indices: Sequence[int],
    settings: SimulationSettings,
) -> Iterator[tuple[int, RunResult | BeltidError]]:
    """Simulate runs with the same contact arc and initial tension."""
    try:
        model = bench.model(points[indices[0]], settings.elements)
        laid = lay_on(model)
    except BeltidError as error:
        yield from ((index, error) for index in indices)
        return
    for index in indices:
        try:
            yield index, _simulate_laid(bench, replace(model, point=points[index]), laid, settings)
        except BeltidError as error:
            yield index, error
