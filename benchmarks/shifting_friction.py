"""Does the refined surface hold the truth where the friction shifts over the campaign?

    python -m benchmarks.shifting_friction [DRAWS [PART OF A NAME]]

The bench is virtual: 45 runs at three arcs, five tensions and three speeds, read as the sliding
limit of the simulated rig on its finer mesh, with a surface that is no power law, times what shifts
the friction of each run. Noise 0.3 % of each run; the bench itself has no errors and none are
stated. Each draw has its own noise, its own random order, and arcs that differ by 0.3 % (one
standard deviation) where nothing else is said.

RMS: error of ln mu at the nodes within the forces of the runs, at the temperature and the middle of
the campaign that the surface is stated for; "beside the level": less its mean in each draw, which
nothing measures where arcs differ. z: root mean square of error over stated uncertainty. The places
of one draw move together: few draws say little.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "uncertainty"))

from virtual_bench import (
    BELT,
    FINER,
    LAW,
    RIG,
    TRUE_SURFACE,
    Design,
    true_mu,
)

from beltid.identify.surface.surface import build_surface
from beltid.laws.friction_surface import FrictionSurface
from beltid.params import Contact, OperatingPoint
from beltid.refine.inverse import refine_surface
from beltid.refine.shown import shown_effects
from beltid.rig.model import Bench
from beltid.rig.runs import SimulationSettings, simulate
from beltid.uncertainty.measured import Measured
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.rig_runs import Campaign
from beltid.uncertainty.sources import ORDER, TEMPERATURE

Array = np.ndarray

DESIGN = Design((40.0, 68.0, 82.0), (60.0, 130.0, 220.0, 310.0, 400.0), (0.1, 0.21, 0.42))
NOISE = 0.003
USUAL_ARCS = 0.003
FACTOR = 1.96


@dataclass(frozen=True)
class Case:
    """What shifts the friction: change of ln mu over x (0 to 1) of the campaign, by K, by arc."""

    sorted: bool = False
    course: Callable[[Array], Array] = lambda x: 0.0 * x
    per_kelvin: float = 0.0
    arcs: float = USUAL_ARCS
    scatter: float = 0.0
    n_arcs: int = 3


def steady(x: Array) -> Array:
    """5 % more from the first run to the last."""
    return 0.05 * (x - 0.5)


def quick(x: Array) -> Array:
    """5 % more, within a quarter of the campaign."""
    change = -0.05 * np.exp(-4.0 * x)
    return np.asarray(change - change.mean())


CASES = {
    "nothing, random order": Case(),
    "nothing, sorted by arc, tension, speed": Case(sorted=True),
    "run-in of 5 %, random": Case(course=steady),
    "run-in of 5 %, sorted": Case(sorted=True, course=steady),
    "quick run-in of 5 %, random": Case(course=quick),
    "quick run-in of 5 %, sorted": Case(sorted=True, course=quick),
    "2 % less per 10 K, 20 to 35 °C, random": Case(per_kelvin=-0.002),
    "2 % less per 10 K, rising over a sorted campaign": Case(sorted=True, per_kelvin=-0.002),
    "scatter of 1 % from run to run": Case(scatter=0.01),
    "three arcs that differ by 3 %": Case(arcs=0.03),
    "two arcs that differ by 3 %": Case(arcs=0.03, n_arcs=2),
}


@dataclass(frozen=True)
class Read:
    """A campaign as it was read, and the change of ln mu that its surface is stated with."""

    campaign: Campaign
    speeds: Array


def read(case: Case, rng: np.random.Generator) -> Read:
    """Draw what shifts and simulate every run with it."""
    arcs_deg = DESIGN.arcs_deg[-case.n_arcs :]
    settings = [
        (k, math.radians(arc), T_0, omega)
        for k, arc in enumerate(arcs_deg)
        for T_0 in DESIGN.tensions_N
        for omega in DESIGN.speeds_rad_s
    ]
    n = len(settings)
    order = np.arange(n) if case.sorted else rng.permutation(n)
    x = order / (n - 1)
    # measured temperatures: of the room, rising over the campaign where that is the case
    warm = 20.0 + 15.0 * (x if case.sorted else rng.random(n))
    number, beta, T_0, omega = np.array(settings).T
    arc = number.astype(np.intp)
    shift = case.course(x) + case.per_kelvin * (warm - warm.mean())
    shift = shift + case.arcs * rng.standard_normal(case.n_arcs)[arc]
    shift = shift + case.scatter * rng.standard_normal(n)
    bench = Bench(BELT, RIG, Contact(), LAW, TRUE_SURFACE)
    f, v, mu = TRUE_SURFACE.normal_force_N_m, TRUE_SURFACE.slip_speed_m_s, TRUE_SURFACE.mu_nodes
    tensions = []
    for by, b, T, w in zip(shift, beta, T_0, omega, strict=True):
        of_run = replace(bench, surface=FrictionSurface(f, v, mu * math.exp(by)))
        point = OperatingPoint(float(b), float(T), float(w))
        elements = 2 * round(0.5 * FINER * (of_run.model(point).nodes.size - 1))
        run = simulate(of_run, point, SimulationSettings("steady", elements=elements))
        tensions.append((run.tension_tight_N, run.tension_slack_N))
    tight, slack = np.array(tensions).T
    exact = np.log(tight / slack) / beta
    measured = Measured(
        R=RIG.R,
        arc=arc,
        beta=beta,
        T_0=T_0,
        omega=omega,
        tight=tight,
        slack=slack,
        mu=exact,
        mu_se=NOISE * exact,
        order=order,
        temperature_degC=warm if case.per_kelvin else None,
    ).scattered(NOISE * rng.standard_normal(n))
    start = build_surface(
        np.degrees(beta), measured.normal_force, measured.slip_speed, measured.mu, measured.mu_se
    ).surface
    press = PressLaw(LAW, np.zeros((2, 2)), 1.2e-4, 0.04)
    return Read(Campaign(measured, replace(bench, surface=start), press), DESIGN.speeds)


@dataclass(frozen=True)
class Draw:
    """Errors of ln mu at the nodes within the forces of the runs, and their uncertainties."""

    error: Array
    u: Array
    found: float
    found_u: float


def refined(case: Case, seed: int) -> Draw:
    """One campaign, refined and compared with the truth."""
    drawn = read(case, np.random.default_rng(seed))
    found = refine_surface(drawn.campaign, drawn.speeds)
    surface, force = found.surface, drawn.campaign.measured.normal_force
    f = surface.normal_force_N_m
    inside = (f >= force.min()) & (f <= force.max())
    factor = found.uncertainty.factor[inside]
    key = TEMPERATURE if case.per_kelvin else ORDER
    effect = next(effect for effect in shown_effects(found) if effect.key == key)
    return Draw(
        np.log(surface.mu_nodes[inside] / true_mu(f[inside][:, None], drawn.speeds[None, :])),
        np.sqrt(np.sum(np.square(factor), axis=-1)),
        effect.size,
        effect.uncertainty,
    )


def row(name: str, case: Case, draws: int) -> str:
    """A row of the table."""
    found = [refined(case, seed) for seed in range(draws)]
    square = np.mean([np.mean(np.square(one.error)) for one in found])
    beside = np.mean([np.var(one.error) for one in found])
    z = np.concatenate([np.ravel(one.error / one.u) for one in found])
    u = np.median(np.concatenate([np.ravel(one.u) for one in found]))
    size, own = (100.0 * np.mean([getattr(one, key) for one in found]) for key in FOUND)
    return (
        f"| {name} | {draws} | {size:+.2f} ± {own:.2f} % | {100 * u:.2f} % "
        f"| {100 * math.sqrt(square):.2f} % | {100 * math.sqrt(beside):.2f} % "
        f"| {100 * np.mean(np.abs(z) < FACTOR):.0f} % | {np.sqrt(np.mean(z**2)):.2f} |"
    )


FOUND = ("found", "found_u")


def main() -> None:
    """Print the table."""
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else 16
    wanted = sys.argv[2] if len(sys.argv) > 2 else ""
    print(
        "| put in | draws | found: order, or per 10 K | stated u | RMS error | beside the level "
        "| 95 % intervals hold | z |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for name, case in CASES.items():
        if wanted in name:
            print(row(name, case, draws), flush=True)


if __name__ == "__main__":
    main()
