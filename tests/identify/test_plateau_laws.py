"""Friction law through the forces of plateaus: closed form, scatter, numbers measured by others."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from beltid.errors import InputError
from beltid.identify.surface.plateau_laws import PlateauLaw, fit_plateau_law

R = 0.05


def at_100(law: PlateauLaw) -> float:
    """The coefficient at 100 N/m."""
    return float(law.mu0 * (100.0 / law.reference_force_N_m) ** -law.a)


def integrated(weight: float, beta: float, mu0: float, a: float, sign: float) -> float:
    """Force of the other span: dT/dphi = mu(T/R) T along the arc, from the weight on."""

    def slope(_: float, T: np.ndarray) -> np.ndarray:
        return np.asarray(sign * mu0 * (T / R / 100.0) ** -a * T)

    return float(solve_ivp(slope, (0.0, beta), [weight], rtol=1e-9, atol=1e-12).y[0, -1])


@pytest.mark.parametrize("weight_on", ["tight", "slack"])
@pytest.mark.parametrize("a", [0.15, 0.0])
def test_forces_of_an_integrated_belt_give_its_law(
    weight_on: Literal["tight", "slack"], a: float
) -> None:
    sign = -1.0 if weight_on == "tight" else 1.0
    rows = [
        (arc, W, integrated(W, math.radians(arc), 0.4, a, sign))
        for arc in (60.0, 120.0, 200.0)
        for W in (1.0, 4.0, 12.0)
    ]
    arc, weight, other = np.array(rows).T
    forces = (weight, other) if weight_on == "tight" else (other, weight)
    law = fit_plateau_law(arc, *forces, R, weight_on=weight_on, resolution_N=0.05)
    assert at_100(law) == pytest.approx(0.4, rel=1e-5)
    assert law.a == pytest.approx(a, abs=1e-5)
    assert law.rms_N < 1e-6
    assert not law.warnings


@pytest.mark.long
def test_scatter_of_the_readings_is_in_the_standard_errors() -> None:
    """Errors over standard errors of 200 tables: their mean square is one."""
    rng = np.random.default_rng(4)
    arc = np.repeat([90.0, 180.0, 270.0], 8)
    tight = np.tile(np.linspace(2.0, 12.0, 8), 3)
    rows = zip(tight, np.radians(arc), strict=True)
    exact = np.array([integrated(T, b, 0.35, 0.1, -1.0) for T, b in rows])
    z = []
    for _ in range(200):
        law = fit_plateau_law(arc, tight, exact + 0.03 * rng.standard_normal(24), R)
        mu0 = 0.35 * (law.reference_force_N_m / 100.0) ** -0.1
        z.append([(law.mu0 - mu0) / law.mu0_se, (law.a - 0.1) / law.a_se])
    np.testing.assert_allclose(np.mean(np.square(z), axis=0), 1.0, atol=0.35)


def test_a_flat_belt_measured_by_others_gives_what_an_independent_fit_gave() -> None:
    path = Path(__file__).parents[2] / "rigdata" / "measured_by_others" / "flat_belt.csv"
    with path.open() as file:
        rows = list(csv.DictReader(file))
    names = ("arc_deg", "weight_N", "tension_slack_N")
    columns = (np.array([float(row[name]) for row in rows]) for name in names)
    law = fit_plateau_law(*columns, R, resolution_N=0.05)
    assert at_100(law) == pytest.approx(0.328, abs=0.0005)
    assert law.a == pytest.approx(0.093, abs=0.0005)
    assert law.a_se == pytest.approx(0.017, abs=0.0005)
    assert law.rms_N == pytest.approx(0.091, abs=0.0005)
    (warning,) = law.warnings  # the full turn, where turns touch
    assert warning.startswith("arc 360°")


def test_too_few_plateaus_are_refused() -> None:
    with pytest.raises(InputError, match="4 plateaus"):
        fit_plateau_law([90] * 4, [2, 3, 4, 5], [1, 2, 3, 4], R)
