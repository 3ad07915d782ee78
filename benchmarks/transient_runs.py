"""Runs in time: the campaign, the cost of a step, its growth with the mesh, memory."""

from __future__ import annotations

import math
import time
import tracemalloc
from dataclasses import dataclass

import numpy as np

from beltid.errors import BeltidError
from beltid.rig.runs import SimulationSettings, campaign, simulate
from beltid.rig.steady import lay_on, slide
from benchmarks.exudyn_rig import PeerRig, PeerSettings, apparent_mu
from benchmarks.work import POINTS, constant_bench, fastest

SIZES = (20, 40, 80, 160, 320, 640)
STEPS = 130
PEER_STEPS = 15
PEER_MORE_STEPS = 60
PEER_TRAVEL_M = 3.0e-4
EQUAL_ELEMENTS = 20
PEER = PeerSettings(EQUAL_ELEMENTS, modified_newton=True)
MIDDLE = next(p for p in POINTS if p.beta > 1.4 and p.T_0 == 250.0 and p.omega == 0.5)


@dataclass(frozen=True, slots=True)
class TransientComparison:
    """Times [s] of the 120 runs, times per step [s], Newton iterations per step, mu of the peer."""

    two_threads: float
    one_thread: float
    steps: int
    iterations_per_step: float
    own_step: float
    peer_step: float
    peer_small_step: float
    peer_mu: float
    own_mu: float


def run_all(jobs: int, elements: int | None = None) -> list[float]:
    """The 120 runs in time; returns their Newton iterations."""
    settings = SimulationSettings(method="transient", elements=elements, steps=STEPS)
    iterations: list[float] = []
    for _, result in campaign(constant_bench(), POINTS, settings, jobs=jobs):
        if isinstance(result, Exception):
            raise result
        iterations.append(result.record.newton_iterations)
    return iterations


def compare_transient(rounds: int) -> TransientComparison:
    """Measure the campaign, and the cost per step of both at equal elements."""
    iterations = run_all(1)
    times = fastest(
        {"two": lambda: run_all(2), "one": lambda: run_all(1)}, rounds, time.perf_counter
    )
    bench = constant_bench()
    settings = SimulationSettings(method="transient", elements=EQUAL_ELEMENTS, steps=STEPS)
    steady = SimulationSettings(method="steady", elements=EQUAL_ELEMENTS)
    rig = PeerRig(MIDDLE.beta, PEER)
    rig.lay_on(MIDDLE.T_0)
    tasks = {
        "own": lambda: simulate(bench, MIDDLE, settings),
        "steady": lambda: simulate(bench, MIDDLE, steady),  # what a run holds besides its steps
        "peer": lambda: rig.turn(MIDDLE.omega, PEER_STEPS, PEER_TRAVEL_M),
        "peer small": lambda: rig.turn(MIDDLE.omega, PEER_MORE_STEPS, PEER_TRAVEL_M),
    }
    each = fastest(tasks, 10 * rounds)
    peer = rig.turn(MIDDLE.omega, PEER_STEPS, PEER_TRAVEL_M)
    return TransientComparison(
        two_threads=times["two"],
        one_thread=times["one"],
        steps=STEPS,
        iterations_per_step=float(np.mean(iterations)) / STEPS,
        own_step=(each["own"] - each["steady"]) / STEPS,
        peer_step=each["peer"] / PEER_STEPS,
        peer_small_step=each["peer small"] / PEER_MORE_STEPS,
        peer_mu=apparent_mu(peer, MIDDLE.beta),
        own_mu=simulate(bench, MIDDLE, settings).mu,
    )


@dataclass(frozen=True, slots=True)
class Growth:
    """Times [s] against the number of elements; nan where no solution was found, see ``failures``.

    ``newton_step`` is a Newton iteration of the steady method with the model's building left out,
    ``time_iteration`` one of a time step, ``time_step`` a whole step.
    """

    elements: tuple[int, ...]
    newton_step: list[float]
    time_step: list[float]
    time_iteration: list[float]
    failures: list[str]

    def exponent(self, times: list[float]) -> float:
        """Slope of log time over log elements."""
        x, y = np.log(self.elements), np.log(times)
        known = np.isfinite(y)
        return float(np.polyfit(x[known], y[known], 1)[0])


def measure_growth(rounds: int) -> Growth:
    """Cost of a Newton iteration in statics and of a time step for 20 to 640 elements."""
    growth = Growth(SIZES, [], [], [], [])
    for n in SIZES:
        few = rounds if n > 100 else 4 * rounds
        for measure, columns in (
            (_statics, (growth.newton_step,)),
            (_dynamics, (growth.time_step, growth.time_iteration)),
        ):
            try:
                values = measure(n, few)
            except BeltidError as error:
                growth.failures.append(f"{n} elements: {error}")
                values = (math.nan,) * len(columns)
            for column, value in zip(columns, values, strict=True):
                column.append(value)
    return growth


def _statics(n: int, rounds: int) -> tuple[float, ...]:
    model = constant_bench().model(MIDDLE, n)
    laid = lay_on(model)
    iterations = laid.iterations + slide(model, laid).iterations
    return (fastest({"": lambda: slide(model, lay_on(model))}, rounds)[""] / iterations,)


def _dynamics(n: int, rounds: int) -> tuple[float, ...]:
    steady = SimulationSettings(method="steady", elements=n)
    settings = SimulationSettings(method="transient", elements=n, steps=52)
    bench = constant_bench()
    iterations = simulate(bench, MIDDLE, settings).record.newton_iterations
    tasks = {
        "steady": lambda: simulate(bench, MIDDLE, steady),  # what a run holds besides its steps
        "transient": lambda: simulate(bench, MIDDLE, settings),
    }
    times = fastest(tasks, rounds)
    spent = times["transient"] - times["steady"]
    return spent / settings.steps, spent / iterations


def peak_memory() -> dict[int, float]:
    """Peak memory [kB] of a run by its number of steps, arrays of the recording included."""
    peaks = {}
    for steps in (130, 1300, 13000):
        settings = SimulationSettings(method="transient", elements=EQUAL_ELEMENTS, steps=steps)
        tracemalloc.start()
        simulate(constant_bench(), MIDDLE, settings)
        peaks[steps] = tracemalloc.get_traced_memory()[1] / 1000.0
        tracemalloc.stop()
    return peaks
