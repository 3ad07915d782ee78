"""Front door of the simulated rig: one run, or a campaign of runs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from itertools import islice
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from beltid.errors import BeltidError, InputError
from beltid.laws.capstan import friction_coefficient, mean_normal_force
from beltid.params import OperatingPoint
from beltid.rigsim.model import Bench, RigModel, Workspace
from beltid.rigsim.profile import ContactState, steady_contact
from beltid.rigsim.reference.step import march_by_lemke
from beltid.rigsim.sensitivity import TensionSensitivity, tension_sensitivity
from beltid.rigsim.steady import StaticState, lay_on, slide
from beltid.rigsim.step import march
from beltid.rigsim.transient_run import Plan, TransientRun, run_transient

Array = NDArray[np.float64]
Method = Literal["transient", "steady"]

DEFAULT_STEPS = 130
FEWEST_STEPS = 52
LOOK_UP_S = 0.2  # time after which one who waits for runs wakes up [s]


@dataclass(frozen=True, slots=True)
class SimulationSettings:
    """How the rig is simulated.

    Parameters
    ----------
    method : {"transient", "steady"}
        Time stepping from the belt at rest, or Newton's method on the sliding limit.
    elements : int, optional
        Number of belt elements, even; by default it follows from the elastic-bed length.
    steps : int
        Time steps of a transient run; those of the recording. A step that does not converge is cut
        further.
    friction_solver : {"newton", "lemke"}
        Stick and slip of a step by the active set (semismooth Newton), or by Lemke's method on the
        Delassus matrix: the reference, slower by a factor of about ten, and compiled by its first
        run.
    sensitivities : bool
        Also give the sensitivities of the tensions to mu (steady method only).
    profile_times_s : tuple of float
        Times after the start of rotation at which the contact along the arc is kept [s] (transient
        method only): the end of the step that holds the time.
    """

    method: Method = "transient"
    elements: int | None = None
    steps: int = DEFAULT_STEPS
    friction_solver: Literal["newton", "lemke"] = "newton"
    sensitivities: bool = False
    profile_times_s: tuple[float, ...] = ()

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
    """What the solver did in one run.

    Attributes
    ----------
    elements, steps : int
        Belt elements; time steps (0 for the steady method).
    newton_iterations : int
        Iterations in all.
    status_changes : int
        Changes of a patch between stick and slide in all iterations, or pivots of Lemke's method.
    halvings : int
        Times that a step was cut.
    residual : float
        Largest residual force of all steps over T_0 [-].
    slip_m : float
        Largest slip of a sticking patch in a step [m].
    cone : float
        Largest force beyond the friction cone over the largest limit [-].
    clamped_lookups, lookups : int
        Contact points whose line force or speed lies outside the measured range in the sliding
        state, and contact points in all.
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
        What the solver did.
    sliding : ContactState
        The sliding state; its profile is :attr:`profile`.
    snapshots : tuple of (float, ContactState)
        Time [s] and contact at the times that were asked for (transient).
    sensitivity : TensionSensitivity, optional
        Derivatives of the tensions with respect to mu, if asked for.
    """

    tension_tight_N: float
    tension_slack_N: float
    recording: Mapping[str, Array] | None
    record: SolverRecord
    sliding: ContactState
    snapshots: tuple[tuple[float, ContactState], ...] = ()
    sensitivity: TensionSensitivity | None = None

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
        """The sliding state along the arc, see :meth:`ContactState.profile`."""
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
        Arc, initial tension, speed of the pulley.
    settings : SimulationSettings, optional
        Method and resolution.

    Raises
    ------
    ConvergenceError
        If no equilibrium, or no solution of a step, was found.
    """
    settings = settings or SimulationSettings()
    model = bench.model(point, settings.elements)
    work = model.workspace()
    return _simulate_laid(bench, model, lay_on(model, work), work, settings)


def _simulate_laid(
    bench: Bench,
    model: RigModel,
    laid: StaticState,
    work: Workspace,
    settings: SimulationSettings,
) -> RunResult:
    """Simulate a run whose belt lies on the pulley, tightened."""
    sliding = slide(model, laid, work)
    if settings.method == "transient":
        marcher = march_by_lemke if settings.friction_solver == "lemke" else march
        plan = Plan(settings.steps, bench.contact.sticking_ratio, settings.profile_times_s)
        return _transient_result(model, run_transient(model, laid, sliding, plan, marcher))
    sensitivity = tension_sensitivity(model, sliding) if settings.sensitivities else None
    record = SolverRecord(
        elements=model.nodes.size - 1,
        steps=0,
        newton_iterations=laid.iterations + sliding.iterations,
        status_changes=0,
        halvings=0,
        residual=max(laid.residual, sliding.residual),
        slip_m=0.0,
        cone=0.0,
        clamped_lookups=sliding.outside,
        lookups=sliding.lookups,
    )
    state = steady_contact(model, sliding)
    return RunResult(sliding.T_A, sliding.T_B, None, record, state, (), sensitivity)


def _transient_result(model: RigModel, run: TransientRun) -> RunResult:
    record = SolverRecord(
        elements=model.nodes.size - 1,
        steps=run.time.size - 1,
        newton_iterations=int(run.record.iterations.sum()),
        status_changes=int(run.record.changes.sum()),
        halvings=int(run.record.halvings.sum()),
        residual=float(run.record.residual.max()),
        slip_m=float(run.record.slip.max()),
        cone=float(run.record.cone.max()),
        clamped_lookups=int(run.record.outside[-1]),
        lookups=int(run.record.lookups[-1]),
    )
    recording = {
        "time_s": run.time,
        "tension_tight_N": run.T_A,
        "tension_slack_N": run.T_B,
        "pulley_speed_rad_s": run.omega,
    }
    last = run.snapshots[-1][1]
    tensions = float(run.T_A[-1]), float(run.T_B[-1])
    return RunResult(*tensions, recording, record, last, run.snapshots[:-1])


def campaign(
    bench: Bench,
    points: Sequence[OperatingPoint],
    settings: SimulationSettings | None = None,
    jobs: int | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> Iterator[tuple[int, RunResult | BeltidError]]:
    """Simulate many runs; the compiled kernels release the interpreter, so threads suffice.

    Runs that differ in speed only share the belt laid on and tightened.

    Parameters
    ----------
    bench : Bench
        What the runs share.
    points : sequence of OperatingPoint
        The runs.
    settings : SimulationSettings, optional
        Method and resolution.
    jobs : int, optional
        Threads; by default one per core.
    stop : callable, optional
        Asked between runs; True ends the campaign early.

    Yields
    ------
    index, result : int, RunResult or BeltidError
        In the order in which the runs end. The result of a run does not depend on the others. A run
        that fails for a reason yields its error, and the others go on.
    """
    settings = settings or SimulationSettings()
    rigs: dict[tuple[float, float], list[int]] = {}
    for index, point in enumerate(points):
        rigs.setdefault((point.beta, point.T_0), []).append(index)

    def together(indices: list[int]) -> list[tuple[int, RunResult | BeltidError]]:
        return list(_simulate_together(bench, points, indices, settings, stop))

    workers = jobs or os.cpu_count() or 1
    if workers == 1:
        for indices in rigs.values():
            yield from _simulate_together(bench, points, indices, settings, stop)
        return
    waiting = iter(rigs.values())
    with ThreadPoolExecutor(max_workers=workers) as pool:
        running = {pool.submit(together, indices) for indices in islice(waiting, 2 * workers)}
        while running:
            # a signal that the system gives to another thread is heard when this one wakes up
            ended, running = wait(running, LOOK_UP_S, FIRST_COMPLETED)
            for future in ended:
                yield from future.result()
            if not stop():
                more = islice(waiting, len(ended))
                running |= {pool.submit(together, indices) for indices in more}


def _simulate_together(
    bench: Bench,
    points: Sequence[OperatingPoint],
    indices: Sequence[int],
    settings: SimulationSettings,
    stop: Callable[[], bool],
) -> Iterator[tuple[int, RunResult | BeltidError]]:
    """Simulate runs of one arc and initial tension."""
    try:
        model = bench.model(points[indices[0]], settings.elements)
        work = model.workspace()
        laid = lay_on(model, work)
    except BeltidError as error:
        yield from ((index, error) for index in indices)
        return
    for index in indices:
        if stop():
            return
        try:
            of_run = replace(model, point=points[index])
            yield index, _simulate_laid(bench, of_run, laid, work, settings)
        except BeltidError as error:
            yield index, error
