"""Friction laws through the forces of plateaus: closed forms, and numbers measured by others."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from beltid.errors import InputError
from beltid.identify.surface.laws import fit_friction_laws
from beltid.identify.surface.plateau_laws import PlateauLaws, fit_plateau_laws
from beltid.laws.capstan import friction_coefficient

MEASURED = Path(__file__).parents[2] / "rigdata" / "measured_by_others"
R = 0.05


def columns_of(name: str) -> dict[str, list[str]]:
    with (MEASURED / name).open() as file:
        rows = list(csv.DictReader(file))
    return {key: [row[key] for row in rows] for key in rows[0]}


def flat_belt() -> tuple[np.ndarray, ...]:
    """Contact arc [deg], weight on the tight side and slack force [N] of every reading."""
    table = columns_of("flat_belt.csv")
    names = ("arc_deg", "weight_N", "tension_slack_N")
    return tuple(np.array(table[name], dtype=float) for name in names)


def mu_at_100(laws: PlateauLaws) -> float:
    """The coefficient of the power law at 100 N/m."""
    falls = (100.0 / laws.reference_force_N_m) ** -laws.power.values["a"]
    return laws.power.values["mu0"] * falls


def integrated(weight: float, beta: float, mu0: float, a: float, tight: bool) -> float:
    """Force of the other span: dT/dphi = mu(T/R) T along the arc, from the weight on."""
    sign = -1.0 if tight else 1.0

    def slope(_: float, T: np.ndarray) -> np.ndarray:
        return sign * mu0 * (T / R / 100.0) ** -a * T

    return float(solve_ivp(slope, (0.0, beta), [weight], rtol=1e-10, atol=1e-12).y[0, -1])


@pytest.mark.parametrize("weight_on", ["tight", "slack"])
@pytest.mark.parametrize("a", [0.15, -0.1, 0.0])
def test_forces_of_an_integrated_belt_give_its_law(weight_on: str, a: float) -> None:
    rows = [
        (arc, W, integrated(W, math.radians(arc), 0.4, a, weight_on == "tight"))
        for arc in (60.0, 120.0, 200.0)
        for W in (1.0, 3.0, 6.0, 12.0)
    ]
    arc, weight, other = np.array(rows).T
    tight, slack = (weight, other) if weight_on == "tight" else (other, weight)
    laws = fit_plateau_laws(
        arc,
        tight,
        slack,
        R,
        weight_on=weight_on,  # type: ignore[arg-type]
        resolution_N=0.05,
    )
    assert mu_at_100(laws) == pytest.approx(0.4, rel=1e-5)
    assert laws.power.values["a"] == pytest.approx(a, abs=1e-5)
    assert laws.power.rms_N < 1e-6
    # no scatter is seen: that of the resolution stands in its place
    assert laws.power.scatter_N == pytest.approx(0.05 / math.sqrt(12.0))
    assert not laws.warnings


@pytest.mark.parametrize("draws", [50, pytest.param(200, marks=pytest.mark.long)])
def test_scatter_of_the_readings_is_in_the_standard_errors(draws: int) -> None:
    """Errors over standard errors of many tables: their mean square is one."""
    rng = np.random.default_rng(4)
    arc = np.repeat([90.0, 180.0, 270.0], 8)
    tight = np.tile(np.linspace(2.0, 12.0, 8), 3)
    exact = np.array(
        [integrated(T, math.radians(b), 0.35, 0.1, True) for T, b in zip(tight, arc, strict=True)]
    )
    z = []
    for _ in range(draws):
        laws = fit_plateau_laws(arc, tight, exact + 0.03 * rng.standard_normal(24), R)
        power = laws.power
        mu0 = 0.35 * (laws.reference_force_N_m / 100.0) ** -0.1
        z.append(
            [
                (power.values["mu0"] - mu0) / power.errors["mu0"],
                (power.values["a"] - 0.1) / power.errors["a"],
            ]
        )
    # of 200 draws: 1 with a standard deviation of 0.1, of 50 with 0.2
    np.testing.assert_allclose(np.mean(np.square(z), axis=0), 1.0, atol=0.35)


def test_measured_flat_belt_gives_what_independent_fits_gave() -> None:
    laws = fit_plateau_laws(*flat_belt(), R, resolution_N=0.05)
    assert laws.constant.values["mu0"] == pytest.approx(0.335, abs=0.0005)
    assert laws.constant.errors["mu0"] == pytest.approx(0.003, abs=0.0005)
    assert laws.constant.rms_N == pytest.approx(0.120, abs=0.0005)
    assert mu_at_100(laws) == pytest.approx(0.328, abs=0.0005)
    assert laws.power.values["a"] == pytest.approx(0.093, abs=0.0005)
    assert laws.power.errors["a"] == pytest.approx(0.017, abs=0.0005)
    assert laws.power.rms_N == pytest.approx(0.091, abs=0.0005)
    assert laws.with_zero.values["a"] == pytest.approx(0.122, abs=0.001)
    assert laws.with_zero.errors["a"] == pytest.approx(0.025, abs=0.001)
    assert laws.with_zero.values["zero_N"] == pytest.approx(0.071, abs=0.001)
    assert laws.with_zero.errors["zero_N"] == pytest.approx(0.045, abs=0.001)
    arc, weight, slack = flat_belt()
    mu = friction_coefficient(weight, slack, np.radians(arc))
    means = [mu[arc == one].mean() for one in np.unique(arc)]
    np.testing.assert_allclose(means, [0.335, 0.327, 0.352, 0.387], atol=0.0005)


def test_measured_flat_belt_falls_with_the_load_and_its_full_turn_is_flagged() -> None:
    laws = fit_plateau_laws(*flat_belt(), R, resolution_N=0.05)
    assert laws.power.clear("a")
    assert "the coefficient falls with the load" in laws.verdict
    assert len(laws.warnings) == 1
    assert laws.warnings[0].startswith("arc 360°: its coefficient is +13 % off")
    assert "turns that touch" in laws.warnings[0]


def test_a_single_arc_has_no_other_to_disagree_with() -> None:
    weight = np.linspace(2.0, 12.0, 6)
    slack = weight * np.exp(-0.4 * math.pi)
    laws = fit_plateau_laws(np.full(6, 180.0), weight, slack, R, resolution_N=0.05)
    assert laws.constant.values["mu0"] == pytest.approx(0.4, rel=1e-9)
    assert laws.warnings == ()


@pytest.mark.parametrize(
    ("material", "heads", "holds"),
    [
        ("DragonSkin10", ("1",), False),
        ("DragonSkin10", ("1", "2"), False),
        ("Sil950", ("1",), False),
        ("DragonSkin10", ("2",), True),
    ],
)
def test_no_law_is_forced_on_silicone(material: str, heads: tuple[str, ...], holds: bool) -> None:
    table = columns_of("silicone.csv")
    rows = [
        i
        for i, (name, head) in enumerate(zip(table["material"], table["head"], strict=True))
        if name == material and head in heads
    ]
    force, mu = (np.array(table[name], dtype=float)[rows] for name in ("normal_force_N", "mu"))
    verdict = fit_friction_laws(force, np.full(force.size, 0.01), mu).verdict
    assert verdict.startswith("None of the fitted formulas holds over the whole range") is not holds


def test_tables_that_cannot_be_fitted_are_refused_with_the_plateau() -> None:
    with pytest.raises(InputError, match="4 plateaus to fit friction laws to, must be at least 5"):
        fit_plateau_laws([90] * 4, [2, 3, 4, 5], [1, 2, 3, 4], R)
    with pytest.raises(InputError, match="plateau 2: tight force 3 N, must be above the slack"):
        fit_plateau_laws([90] * 5, [2, 3, 4, 5, 6], [1, 3, 3, 4, 5], R)
