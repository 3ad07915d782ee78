"""Front door of the simulated rig: one run, or a campaign of runs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from beltid.errors import BeltidError, InputError
from beltid.laws.capstan import friction_coefficient, mean_normal_force, normal_force
from beltid.params import OperatingPoint
from beltid.rigsim.contact import STICK, Points
from beltid.rigsim.model import Bench, RigModel
from beltid.rigsim.reference_step import march_by_lemke
from beltid.rigsim.sensitivity import TensionSensitivity, tension_sensitivity
from beltid.rigsim.steady import StaticState, solve_steady
from beltid.rigsim.transient import TransientRun, march, run_transient

Array = NDArray[np.float64]
Method = Literal["transient", "steady"]

DEFAULT_STEPS = 130
FEWEST_STEPS = 52


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
        Delassus matrix: the reference, slower by a factor of about ten.
    sensitivities : bool
        Also give the sensitivities of the tensions to mu (steady method only).
    """

    method: Method = "transient"
    elements: int | None = None
    steps: int = DEFAULT_STEPS
    friction_solver: Literal["newton", "lemke"] = "newton"
    sensitivities: bool = False

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
    mu : float
        Apparent coefficient of friction by Eq. (6) [-].
    normal_force_N_m : float
        Mean of Eq. (8) over the arc [N/m].
    recording : dict of ndarray, or None
        time_s, tension_tight_N, tension_slack_N, pulley_speed_rad_s of a transient run.
    profile : dict of ndarray
        The sliding state along the arc: arc_position_m (from the nominal tangent point on the tight
        side), normal_force_N_m, capstan_force_N_m (Eq. (8)), tangential_force_N_m, slip_speed_m_s,
        tension_N, sticks.
    record : SolverRecord
        What the solver did.
    sensitivity : TensionSensitivity, optional
        Derivatives of the tensions with respect to mu, if asked for.
    """

    tension_tight_N: float
    tension_slack_N: float
    mu: float
    normal_force_N_m: float
    recording: Mapping[str, Array] | None
    profile: Mapping[str, NDArray[np.generic]]
    record: SolverRecord
    sensitivity: TensionSensitivity | None = None


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
    if settings.method == "steady":
        laid, sliding = solve_steady(model)
        result = _steady_result(model, laid, sliding)
        if settings.sensitivities:
            return replace(result, sensitivity=tension_sensitivity(model, sliding))
        return result
    marcher = march_by_lemke if settings.friction_solver == "lemke" else march
    ratio = bench.contact.sticking_ratio
    run = run_transient(model, settings.steps, ratio, marcher=marcher)
    return _transient_result(model, run)


def _steady_result(model: RigModel, laid: StaticState, sliding: StaticState) -> RunResult:
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
        lookups=int(np.count_nonzero(sliding.points.F_N > 0.0)),
    )
    T_A, T_B = sliding.T_A, sliding.T_B
    speed = np.full(sliding.points.F_N.shape, model.point.omega * model.path.R)
    profile = _profile(model, sliding.q, sliding.stretch, sliding.points, speed, (T_A, T_B))
    return _result(model, T_A, T_B, None, profile, record)


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
        lookups=int(np.count_nonzero(run.points.F_N > 0.0)),
    )
    recording = {
        "time_s": run.time,
        "tension_tight_N": run.T_A,
        "tension_slack_N": run.T_B,
        "pulley_speed_rad_s": run.omega,
    }
    T_A, T_B = float(run.T_A[-1]), float(run.T_B[-1])
    speed = run.points.point_slip / (run.time[-1] - run.time[-2])
    profile = _profile(model, run.q, run.laid.stretch, run.points, speed, (T_A, T_B))
    return _result(model, T_A, T_B, recording, profile, record)


def _result(
    model: RigModel,
    T_A: float,
    T_B: float,
    recording: Mapping[str, Array] | None,
    profile: Mapping[str, NDArray[np.generic]],
    record: SolverRecord,
) -> RunResult:
    return RunResult(
        tension_tight_N=T_A,
        tension_slack_N=T_B,
        mu=float(friction_coefficient(T_A, T_B, model.point.beta)),
        normal_force_N_m=float(mean_normal_force(T_A, T_B, model.path.R)),
        recording=recording,
        profile=profile,
        record=record,
    )


def _profile(
    model: RigModel,
    q: Array,
    stretch: float,
    points: Points,
    slip_speed: Array,
    tensions: tuple[float, float],
) -> dict[str, NDArray[np.generic]]:
    """The contact along the arc, from the tight to the slack side; see :class:`RunResult`."""
    belt, path = model.system.belt, model.path
    nodes = q.reshape(-1, 4)
    shape = (belt.h.size, 2, 2, 2)  # element, node, (r, r'), (x, y)
    of_element = np.stack([nodes[:-1], nodes[1:]], axis=1).reshape(shape).reshape(-1, 4, 2)
    gradient = np.einsum("ecj,ejk->eck", belt.D_c, of_element)
    axial = belt.EA * (np.linalg.norm(gradient, axis=-1) / stretch - 1.0)
    touches = points.F_N > 0.0
    angle = points.theta[touches] + 0.5 * path.beta
    mu = friction_coefficient(*tensions, path.beta)
    sticks = np.broadcast_to((points.status == STICK)[:, None], touches.shape)
    return {
        "arc_position_m": path.R * angle,
        "normal_force_N_m": points.f_N[touches],
        "capstan_force_N_m": normal_force(angle, tensions[0], mu, path.R),
        "tangential_force_N_m": (points.F_T / (belt.w_c * stretch))[touches],
        "slip_speed_m_s": slip_speed[touches],
        "tension_N": axial[touches],
        "sticks": sticks[touches],
    }


def campaign(
    bench: Bench,
    points: Sequence[OperatingPoint],
    settings: SimulationSettings | None = None,
    jobs: int | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> Iterator[tuple[int, RunResult | BeltidError]]:
    """Simulate many runs; the compiled kernels release the interpreter, so threads suffice.

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

    def one(index: int) -> RunResult | BeltidError:
        try:
            return simulate(bench, points[index], settings)
        except BeltidError as error:
            return error

    workers = jobs or os.cpu_count() or 1
    waiting = iter(range(len(points)))
    with ThreadPoolExecutor(max_workers=workers) as pool:
        running: dict[Future[RunResult | BeltidError], int] = {}

        def refill() -> None:
            while len(running) < 2 * workers and not stop():
                index = next(waiting, None)
                if index is None:
                    return
                running[pool.submit(one, index)] = index

        refill()
        while running:
            ended, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in ended:
                yield running.pop(future), future.result()
            refill()
