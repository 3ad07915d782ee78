"""The inverse problem on 120 runs, and the sensitivities of its solution."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from beltid.identify.surface.surface import build_surface
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Contact
from beltid.refine.inverse import refine_surface
from beltid.rig.model import Bench
from beltid.rig.runs import SimulationSettings, campaign
from beltid.uncertainty.measured import Measured
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.rig_runs import Campaign, input_slopes
from benchmarks.work import BELT, POINTS, RIG

LAW = NormalLaw(6.5e7, 3.0256e11)
NOISE = 0.0025


@dataclass(frozen=True, slots=True)
class Inverse:
    """Times on one core [s] after warm-up: the solution and its sensitivities."""

    solution: float
    sensitivities: float


def _measured() -> Measured:
    """120 simulated runs with noise, in the place of measured ones."""
    f, v = np.geomspace(80.0, 4e4, 40), np.geomspace(1e-3, 0.3, 20)
    mu = 0.95 * (f[:, None] / 5400.0) ** -0.18 * (1.0 + 0.1 * np.log(v / 0.01))
    bench = Bench(BELT, RIG, Contact(), LAW, FrictionSurface(f, v, mu))
    found = dict(campaign(bench, POINTS, SimulationSettings("steady"), jobs=1))
    runs = [found[i] for i in range(len(POINTS))]
    beta = np.array([point.beta for point in POINTS])
    noise = 1.0 + NOISE * np.random.default_rng(1).standard_normal(beta.size)
    apparent = np.array([run.mu for run in runs]) * noise  # type: ignore[union-attr]
    return Measured(
        R=RIG.R,
        arc=np.unique(np.round(beta, 6), return_inverse=True)[1],
        beta=beta,
        T_0=np.array([point.T_0 for point in POINTS]),
        omega=np.array([point.omega for point in POINTS]),
        tight=np.array([run.tension_tight_N for run in runs]),  # type: ignore[union-attr]
        slack=np.array([run.tension_slack_N for run in runs]),  # type: ignore[union-attr]
        mu=apparent,
        mu_se=NOISE * apparent,
    )


def measure_inverse(rounds: int) -> Inverse:
    """Take the times; the best of each counts."""
    measured = _measured()
    speeds = np.unique(measured.slip_speed)
    start = build_surface(
        [math.degrees(b) for b in measured.beta],
        measured.normal_force,
        measured.slip_speed,
        measured.mu,
        measured.mu_se,
    ).surface
    bench = Bench(BELT, RIG, Contact(), LAW, start)
    whole = Campaign(measured, bench, PressLaw(LAW, np.zeros((2, 2)), 1.2e-4, 0.04))
    refined = refine_surface(whole, speeds)
    surfaces = refined.curves.surfaces(refined.parameters)
    input_slopes(whole, surfaces, speeds, refined.speed_slope)
    times: dict[str, list[float]] = {"solution": [], "sensitivities": []}
    for _ in range(rounds):
        clock = [time.perf_counter()]
        refine_surface(whole, speeds)
        clock.append(time.perf_counter())
        input_slopes(whole, surfaces, speeds, refined.speed_slope)
        clock.append(time.perf_counter())
        for name, seconds in zip(times, np.diff(clock), strict=True):
            times[name].append(float(seconds))
    return Inverse(**{name: min(values) for name, values in times.items()})
