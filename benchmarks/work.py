"""The work that is timed: 120 runs of one belt, and how times are taken."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.rig.model import Bench

ARCS_DEG = (40.0, 68.0, 82.0)
TENSIONS_N = tuple(np.linspace(100.0, 450.0, 8))
SPEEDS_RAD_S = (0.1, 0.2, 0.5, 1.0, 2.0)
MU = 0.5

BELT = Belt(EA=1.0e5, EI=0.02, rhoA=0.10)
RIG = Rig(R=0.05, span=0.10)
LAW = NormalLaw(1.0e8)

POINTS = tuple(
    OperatingPoint(math.radians(arc), float(T_0), omega)
    for arc in ARCS_DEG
    for T_0 in TENSIONS_N
    for omega in SPEEDS_RAD_S
)


def constant_bench() -> Bench:
    """The rig with the constant coefficient of friction of the comparison."""
    return Bench(BELT, RIG, Contact(), LAW, FrictionSurface.constant(MU))


def surface_bench() -> Bench:
    """The same rig with a surface mu(f_N, v) of 8 x 5 nodes: the true law of the synthetic 5PK."""
    f = np.geomspace(800.0, 16000.0, 8)[:, None]
    v = RIG.R * np.array(SPEEDS_RAD_S)[None, :]
    growth = np.log1p(v / 0.0015) / math.log1p(0.01 / 0.0015) - 1.0
    mu = 0.95 * (f / 5400.0) ** -0.18 * (1.0 + 0.45 * growth)
    return Bench(BELT, RIG, Contact(), LAW, FrictionSurface(f.ravel(), v.ravel(), mu))


def worst_error(mu: NDArray[np.float64], reference: NDArray[np.float64]) -> float:
    """Largest relative error of the apparent mu over all runs [%]."""
    return float(100.0 * np.max(np.abs(mu / reference - 1.0)))


def stopwatch(task: Callable[[], Any], clock: Callable[[], float] = time.perf_counter) -> float:
    """Time of a task [s]; by the wall unless another clock is given."""
    start = clock()
    task()
    return clock() - start


def fastest(
    tasks: Mapping[str, Callable[[], Any]],
    rounds: int,
    clock: Callable[[], float] = time.process_time,
) -> dict[str, float]:
    """Best time of each task [s]; the tasks take turns, so that all meet the same machine.

    Work of one thread is timed by what the processor spends on it: other work on the machine then
    disturbs less.
    """
    times: dict[str, float] = {}
    for _ in range(rounds):
        for name, task in tasks.items():
            times[name] = min(stopwatch(task, clock), times.get(name, math.inf))
    return times


def medians(tasks: Mapping[str, Callable[[], Any]], rounds: int) -> dict[str, float]:
    """Median time of each task [s]; the tasks take turns."""
    times: dict[str, list[float]] = {name: [] for name in tasks}
    for _ in range(rounds):
        for name, task in tasks.items():
            times[name].append(stopwatch(task))
    return {name: statistics.median(taken) for name, taken in times.items()}
