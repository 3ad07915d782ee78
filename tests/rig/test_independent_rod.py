"""Random rigs against an elastic rod in strong form, which shares only the laws of contact."""

import math

import numpy as np
import pytest
from rod import Rod

from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.rig.model import Bench
from beltid.rig.runs import SimulationSettings, simulate

STEADY = SimulationSettings(method="steady")


def draw(number: int) -> tuple[Bench, OperatingPoint]:
    """A rig on which the belt lies, pinned or clamped, with a law and a surface of its own."""
    rng = np.random.default_rng([20261125, number])
    while True:
        R, beta = rng.uniform(0.02, 0.08), math.radians(rng.uniform(25, 170))
        T_0, span = math.exp(rng.uniform(math.log(60), math.log(600))), rng.uniform(0.06, 0.15)
        EI, EA = math.exp(rng.uniform(math.log(0.002), math.log(0.04))), rng.uniform(5e4, 2e5)
        if math.sqrt(EI / T_0) > 0.25 * min(R * beta, span):
            continue
        law = NormalLaw(rng.uniform(4e7, 1.2e8), rng.choice([0.0, rng.uniform(1e11, 5e11)]))
        f, v = np.geomspace(5.0, 6e4, 60), R * np.array([0.05, 0.2, 1.0])
        mu = rng.uniform(0.3, 1.0) * (f[:, None] / (T_0 / R)) ** -rng.uniform(0.0, 0.2)
        surface = FrictionSurface(f, v, mu * (1.0 + 0.1 * np.log(v / v[1])))
        supports = "pinned" if number % 2 else "clamped"
        rig = Rig(R, span, supports)  # type: ignore[arg-type]
        return Bench(Belt(EA, EI, 0.1), rig, Contact(), law, surface), OperatingPoint(
            beta, T_0, 0.2
        )


@pytest.mark.parametrize(
    "number", [n if n < 4 else pytest.param(n, marks=pytest.mark.long) for n in range(20)]
)
def test_random_rigs(number: int) -> None:
    """Both tensions within 0.05 %, at the first try."""
    bench, point = draw(number)
    v = point.omega * bench.rig.R
    rod = Rod(
        bench.belt.EA,
        bench.belt.EI,
        bench.rig.R,
        bench.rig.span,
        point.beta,
        bench.law,
        lambda f: np.asarray(bench.surface.mu(f, v), dtype=float),
        clamped=bench.rig.supports == "clamped",
    )
    run = simulate(bench, point, STEADY)
    exact = rod.solve(point.T_0)
    assert (run.tension_tight_N, run.tension_slack_N) == pytest.approx(exact, rel=5e-4)
