"""Simulate one run of the rig, or a campaign of runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from beltid.errors import BeltidError, InputError
from beltid.laws.capstan import friction_coefficient, mean_normal_force
from beltid.params import OperatingPoint
from beltid.rig.model import Bench, RigModel
from beltid.rig.newton import STEP, march
from beltid.rig.profile import profile
from beltid.rig.steady import StaticState, lay_on, slide
from beltid.rig.transient import run_transient

Array = NDArray[np.float64]
Method = Literal["transient", "steady"]

DEFAULT_STEPS = 130
FEWEST_STEPS = 52


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
    model : RigModel
        The rig.
    sliding : StaticState
        The sliding state; its contact along the arc is :attr:`profile`.
    recording : dict of ndarray, or None
        time_s, tension_tight_N, tension_slack_N, pulley_speed_rad_s of a transient run.
    record : SolverRecord
        Statistics and certificate of the solver.
    """

    model: RigModel
    sliding: StaticState
    recording: Mapping[str, Array] | None
    record: SolverRecord

    @property
    def tension_tight_N(self) -> float:
        """Force on the support of the tight side in the sliding state [N]."""
        return self.sliding.T_A

    @property
    def tension_slack_N(self) -> float:
        """Force on the support of the slack side in the sliding state [N]."""
        return self.sliding.T_B

    @property
    def mu(self) -> float:
        """Apparent coefficient of friction by Eq. (6) [-]."""
        tight, slack = self.sliding.T_A, self.sliding.T_B
        return float(friction_coefficient(tight, slack, self.model.point.beta))

    @property
    def normal_force_N_m(self) -> float:
        """Mean of Eq. (8) over the arc [N/m]."""
        return float(mean_normal_force(self.sliding.T_A, self.sliding.T_B, self.model.path.R))

    @property
    def profile(self) -> dict[str, NDArray[np.generic]]:
        """Sliding state along the arc, see :func:`beltid.rig.profile.profile`."""
        return profile(self.model, self.sliding)


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
    ((_, result),) = campaign(bench, [point], settings)
    if isinstance(result, BeltidError):
        raise result
    return result


def campaign(
    bench: Bench, points: Sequence[OperatingPoint], settings: SimulationSettings | None = None
) -> Iterator[tuple[int, RunResult | BeltidError]]:
    """Simulate many runs; those that differ only in speed share one laid-on and tightened belt.

    Parameters
    ----------
    bench : Bench
        Belt, rig and laws of all runs.
    points : sequence of OperatingPoint
        The runs.
    settings : SimulationSettings, optional
        Method and resolution.

    Yields
    ------
    index, result : int, RunResult or BeltidError
        The result of a run does not depend on the others. A failed run yields its error, and the
        others continue.
    """
    settings = settings or SimulationSettings()
    for indices in runs_of_one_belt(points):
        try:
            model = bench.model(points[indices[0]], settings.elements)
            laid = lay_on(model)
        except BeltidError as error:
            yield from ((index, error) for index in indices)
            continue
        for index in indices:
            try:
                yield index, _simulated(bench, replace(model, point=points[index]), laid, settings)
            except BeltidError as error:
                yield index, error


def runs_of_one_belt(points: Sequence[OperatingPoint]) -> list[list[int]]:
    """Group the indices of runs that differ in speed only, and share the tightened belt."""
    groups: dict[tuple[float, float], list[int]] = {}
    for index, point in enumerate(points):
        groups.setdefault((point.beta, point.T_0), []).append(index)
    return list(groups.values())


def _simulated(
    bench: Bench, model: RigModel, laid: StaticState, settings: SimulationSettings
) -> RunResult:
    """Simulate a run from the belt laid on and tightened."""
    last, recording, steps = slide(model, laid), None, np.zeros(0, dtype=STEP)
    if settings.method == "transient":
        marcher = march
        if settings.friction_solver == "lemke":
            from beltid.rig.lcp import march_by_lemke as marcher
        falls = bench.surface.falls_with_speed
        steps, last = run_transient(model, laid, last, settings.steps, falls, marcher)
        tight, slack = np.hypot(steps["force"][:, ::2], steps["force"][:, 1::2]).T
        recording = {
            "time_s": np.append(0.0, np.cumsum(steps["dt"])),
            "tension_tight_N": np.append(laid.T_A, tight),
            "tension_slack_N": np.append(laid.T_B, slack),
            "pulley_speed_rad_s": np.append(0.0, steps["omega"]),
        }
    touching = last.points[last.touching]
    inside = bench.surface.covers(touching["f_N"], touching["speed"])
    record = SolverRecord(
        elements=last.points.shape[0],
        steps=steps.size,
        newton_iterations=last.iterations + (0 if steps.size else laid.iterations),
        status_changes=int(steps["changes"].sum()),
        halvings=int(steps["halvings"].sum()),
        residual=max(last.residual, 0.0 if steps.size else laid.residual),
        slip_m=float(steps["drift"].max(initial=0.0)),
        cone=float(steps["cone"].max(initial=0.0)),
        clamped_lookups=int(np.count_nonzero(~inside)),
        lookups=touching.size,
    )
    return RunResult(model, last, recording, record)
