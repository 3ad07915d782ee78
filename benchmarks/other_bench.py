"""A second friction bench with a known answer, independent of the benches in the tests.

A belt of a law of its own (Stribeck over speed, a hyperbola over force) is dragged over the pulley
between two stiff spans: both tensions follow from the travel of the pulley, so that the build-up,
the peak and the decay to the plateau are one curve over the sliding distance. Every fault is a
function that changes a recording. ``benchmarks/coverage.py`` reduces them. All of it is synthetic.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np
import pandas as pd

from beltid.arrays import Array, Mask

RADIUS_M = 0.04  # of the belt's centreline on the pulley
EA_N, SPAN_M = 1.3e5, 0.12


@dataclass
class Bench:
    """What one draw of the bench has in common: its belt and the settings of its faults."""

    rng: np.random.Generator
    mu_0: float  # coefficient at 4,000 N/m and high speed
    bend: float  # share by which it is larger at a vanishing force
    rise: float  # share by which it is smaller at a vanishing speed
    peak: float  # excess of the sticking peak over the plateau
    length_m: float  # sliding distance over which the peak decays
    noise_N: float = 0.4
    rate_Hz: float = 50.0
    rest_s: float = 1.0
    distance_rad: float = 1.4  # turn of the pulley in a run
    tail: Callable[[Array], Array] = lambda x: np.exp(-x)  # of the peak, over `length_m`
    reversed_share: float = 0.0  # share of the runs in which the pulley turns the other way

    def mu(self, force_N_m: float, speed_m_s: float) -> float:
        """Sliding friction at a force per length and a speed."""
        over_force = 1.0 + self.bend / (1.0 + force_N_m / 2500.0)
        over_speed = 1.0 - self.rise / (1.0 + speed_m_s / 0.006)
        return self.mu_0 * over_force * over_speed


@dataclass
class Run:
    """A recording before and after its faults: tensions over time at the two spans."""

    bench: Bench
    arc_rad: float
    tension_N: float
    omega: float  # speed of the pulley [rad/s], positive
    sense: int  # -1 if it turns the other way: then the slack span is the one called tight
    time_s: Array
    turning: Mask  # samples in which the pulley turns
    leading: Array  # tension of the span that pulls [N]
    trailing: Array  # of that which is pulled [N]
    mu: float

    @property
    def since_start_s(self) -> Array:
        """Time since the pulley turns, 0 before [s]."""
        return np.maximum(self.time_s - self.bench.rest_s, 0.0)

    @property
    def angle_rad(self) -> Array:
        """Turn of the pulley since the start [rad]."""
        return self.omega * self.since_start_s


def a_run(bench: Bench, arc_deg: float, tension_N: float, omega: float, reverse: bool) -> Run:
    """One run without faults."""
    arc = np.radians(arc_deg)
    length_s = bench.rest_s + bench.distance_rad / omega
    time = np.arange(0.0, length_s, 1.0 / bench.rate_Hz)
    travel = RADIUS_M * omega * np.maximum(time - bench.rest_s, 0.0)
    actual = tension_N * (1.0 + 0.01 * bench.rng.normal())  # never set exactly
    mu = bench.mu(actual / RADIUS_M, RADIUS_M * omega)
    # two springs EA/span: the difference grows with the travel until all of the arc slides
    most = mu * (1.0 + bench.peak)
    difference = 2.0 * actual * np.tanh(most * arc / 2.0)
    stiff = EA_N / SPAN_M * 0.8
    seated = -np.expm1(-stiff * travel / difference)
    slid = np.maximum(travel - 4.0 * difference / stiff, 0.0)
    sliding = mu * (1.0 + bench.peak * bench.tail(slid / bench.length_m))
    z = arc * sliding * seated
    leading = 2.0 * actual / (1.0 + np.exp(-z))
    white = bench.noise_N * bench.rng.normal(size=(2, time.size))
    return Run(
        bench,
        arc,
        tension_N,
        omega,
        sense=-1 if reverse else 1,
        time_s=time,
        turning=time >= bench.rest_s,
        leading=leading + white[0],
        trailing=2.0 * actual - leading + white[1],
        mu=mu,
    )


def zeros_drift(run: Run, leading_N: float, trailing_N: float) -> None:
    """The zeros of the cells move over each record by so much, in newtons."""
    course = run.time_s / run.time_s[-1]
    run.leading += leading_N * course
    run.trailing += trailing_N * course


def held(run: Run, share: float, spread: float = 0.0, decays: bool = False) -> None:
    """Friction that the belt holds at rest, a share of the tension; gone once it slides."""
    own = share + spread * run.bench.rng.normal()
    rest = ~run.turning
    force = own * run.tension_N * np.ones(np.count_nonzero(rest))
    if decays:
        force *= np.exp(-run.time_s[rest] / 0.7)
    # one side of the bench, whichever way the pulley turns afterwards
    run.leading[rest] += 0.5 * run.sense * force
    run.trailing[rest] -= 0.5 * run.sense * force


def gain(run: Run, share: float) -> None:
    """The cell that hangs at the left end reads a share too much."""
    tension = run.leading if run.sense > 0 else run.trailing
    tension *= 1.0 + share


def hysteresis(run: Run, share: float, range_N: float = 1000.0) -> None:
    """The loaded cell lags: what rose reads too little, what fell too much."""
    for tension, sign in ((run.leading, -1.0), (run.trailing, 1.0)):
        away = np.abs(tension - tension[0])
        tension += sign * share * range_N * -np.expm1(-away / 20.0)


def slow_noise(run: Run, newtons: float, memory_s: float) -> None:
    """Noise of each cell that remembers, an Ornstein-Uhlenbeck process."""
    keep = np.exp(-1.0 / (run.bench.rate_Hz * memory_s))
    for tension in (run.leading, run.trailing):
        kicks = run.bench.rng.normal(size=tension.size)
        kicks[1:] *= np.sqrt(1.0 - keep**2)
        tension += newtons * np.fromiter(accumulate(kicks, lambda x, kick: keep * x + kick), float)


def seam(run: Run, share: float, width_rad: float = 0.25) -> None:
    """Friction that rises where the seam of the coating passes, about its mean of a turn."""
    place = 2.0 * np.pi * run.bench.rng.random()
    away = np.angle(np.exp(1j * (run.angle_rad - place)))
    mean = width_rad / np.sqrt(2.0 * np.pi)
    _more_friction(run, share * (np.exp(-0.5 * (away / width_rad) ** 2) - mean))


def warming(run: Run, newtons: float) -> None:
    """The leading cell warms while the belt slides."""
    run.leading += newtons * -np.expm1(-run.since_start_s / 4.0)


def _more_friction(run: Run, share: float | Array) -> None:
    """Raise the friction by a share, at constant sum of the tensions."""
    total = run.leading + run.trailing
    z = np.log(run.leading / run.trailing) * (1.0 + share)
    run.leading[:] = total / (1.0 + np.exp(-z))
    run.trailing[:] = total - run.leading


def hum(run: Run, newtons: float, hertz: float = 49.3) -> None:
    """Mains in both cells."""
    phase = 2.0 * np.pi * run.bench.rng.random()
    for tension in (run.leading, run.trailing):
        tension += newtons * np.sin(2.0 * np.pi * hertz * run.time_s + phase)


def converter(run: Run, step_N: float) -> None:
    """Both cells are read in steps."""
    for tension in (run.leading, run.trailing):
        tension[:] = step_N * np.round(tension / step_N)


def scatter(run: Run, share: float) -> None:
    """Runs repeat to a share of their friction only: the truth of a run is its own."""
    own = share * run.bench.rng.normal()
    run.mu *= 1.0 + own
    _more_friction(run, own)


def log_tail(x: Array) -> Array:
    """A decay by the logarithm, done after twenty lengths."""
    return np.maximum(1.0 - np.log1p(x) / np.log(21.0), 0.0)


def two_tails(x: Array) -> Array:
    """A quick and a slow exponential."""
    return 0.7 * np.exp(-4.0 * x) + 0.3 * np.exp(-0.4 * x)


ROWS: dict[str, tuple[Any, ...]] = {
    "clean": ({},),
    "tail: logarithm": ({"tail": log_tail},),
    "tail: two exponentials": ({"tail": two_tails},),
    "tail: power law": ({"tail": lambda x: 1.0 / (1.0 + x) ** 2},),
    "runs that scatter by 0.5 %": ({}, scatter, 0.005),
    "slow noise 1 N, 0.3 s": ({}, slow_noise, 1.0, 0.3),
    "slow noise 1 N, 1 s": ({}, slow_noise, 1.0, 1.0),
    "leading zero drifts by 0.5 N": ({"rest_s": 2.0}, zeros_drift, 0.5, 0.0),
    "trailing zero drifts by 0.5 N": ({"rest_s": 2.0}, zeros_drift, 0.0, 0.5),
    "both zeros drift by 0.5 N": ({"rest_s": 2.0}, zeros_drift, 0.5, 0.5),
    "held at rest, 0.25 %": ({}, held, 0.0025),
    "held at rest, 2 %": ({}, held, 0.02),
    "held at rest, 10 %": ({}, held, 0.10),
    "held at rest, 2 ± 1 %": ({}, held, 0.02, 0.01),
    "held at rest, 2 %, decaying": ({}, held, 0.02, 0.0, True),
    "held at rest, 10 %, decaying": ({}, held, 0.10, 0.0, True),
    "held at rest, 2 %, half reversed": ({"reversed_share": 0.5}, held, 0.02),
    "gain +2 %, half reversed": ({"reversed_share": 0.5}, gain, 0.02),
    "gain +0.2 %": ({}, gain, 0.002),
    "hysteresis 0.05 % of 1 kN": ({}, hysteresis, 0.0005),
    "seam of 3 % once a turn": ({}, seam, 0.03),
    "seam of 3 %, four turns": ({"distance_rad": 25.0, "rate_Hz": 20.0}, seam, 0.03),
    "leading cell warms by 1 N": ({}, warming, 1.0),
    "converter of 1 N": ({"noise_N": 0.2}, converter, 1.0),
    "hum of 3 N": ({}, hum, 3.0),
    "short runs": ({"distance_rad": 0.35},),
    "2 samples a second": ({"rate_Hz": 2.0, "rest_s": 4.0},),
    "500 samples a second": ({"rate_Hz": 500.0, "distance_rad": 0.7},),
}
"""Row -> what the bench is, its fault and the size of that."""


def draw(name: str, n: int, seed: int) -> tuple[pd.DataFrame, Array]:
    """Return the recording of n runs of a bench, and the true friction of each."""
    rng = np.random.default_rng([seed, n, sum(name.encode())])
    options, *fault = ROWS[name]
    bench = Bench(
        rng,
        mu_0=rng.uniform(0.5, 1.1),
        bend=rng.uniform(0.2, 0.6),
        rise=rng.uniform(0.1, 0.4),
        peak=rng.uniform(0.02, 0.12),
        length_m=rng.uniform(0.4e-3, 2e-3),
        **options,
    )
    arcs, tensions = (30.0, 55.0, 90.0), (80.0, 140.0, 210.0, 290.0, 380.0)
    speeds = (0.07, 0.16, 0.35, 0.7)
    grid = [(a, t, w) for a in arcs for t in tensions for w in speeds] * 2
    rows = sorted(rng.permutation(len(grid))[:n].tolist())
    back = rng.permutation(n) < round(bench.reversed_share * n)
    chosen = zip((grid[row] for row in rows), back.tolist(), strict=True)
    runs = [a_run(bench, arc, tension, omega, reverse) for (arc, tension, omega), reverse in chosen]
    if fault:
        change, *sizes = fault
        for run in runs:
            change(run, *sizes)
    frames = [_frame(f"{i + 1:03d}", run) for i, run in enumerate(runs)]
    return pd.concat(frames, ignore_index=True), np.array([run.mu for run in runs])


def _frame(label: str, run: Run) -> pd.DataFrame:
    """One run in the columns of rig.csv: what is called tight is the span that pulls forward."""
    tight, slack = (run.leading, run.trailing)[:: run.sense]
    speed = run.sense * np.where(run.turning, run.omega, 0.0)
    return pd.DataFrame(
        {
            "run": label,
            "time_s": run.time_s,
            "tension_tight_N": tight,
            "tension_slack_N": slack,
            "pulley_speed_rad_s": speed,
            "arc_deg": round(float(np.degrees(run.arc_rad)), 6),
            "initial_tension_N": run.tension_N,
        }
    )


CONFIG = {
    "rig": {"pulley_radius_m": RADIUS_M},
    "belt": {"axial_stiffness_N": EA_N},
}
