"""Formulas fitted to surfaces: exact points, covered parameters, the right law, published data."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from beltid.errors import InputError, NumericsError
from beltid.identify.surface.laws import FrictionLawFit, FrictionLaws, fit_friction_laws
from beltid.laws.friction_formulas import FRICTION_LAWS

VALUES = {
    "coulomb": {"mu0": 0.7},
    "power": {"mu0": 0.9, "a": 0.15},
    "power_log": {"mu0": 0.6, "a": 0.15, "b": 0.4, "v0": 0.002},
    "power_stribeck_1": {"mu_s": 1.3, "mu_k": 0.8, "a": 0.12, "v_s": 0.03, "c": 1.5},
    "power_stribeck_2": {"mu_s": 1.3, "mu_k": 0.8, "a": 0.12, "v_s": 0.03, "c": 1.5},
}
LAWS = tuple(VALUES)
FORCE, SPEED = (
    x.ravel()
    for x in np.meshgrid(
        np.geomspace(1e3, 9e3, 6), [0.0025, 0.005, 0.0105, 0.022, 0.046, 0.1], indexing="ij"
    )
)


def clean(law: str, **changed: float) -> np.ndarray:
    values = {**VALUES[law], **changed}
    return FRICTION_LAWS[law].mu([*values.values()], FORCE / 3000.0, SPEED)


def fit_of(found: FrictionLaws, law: str) -> FrictionLawFit:
    return next(fit for fit in found.fits if fit.law == law)


def values_of(fit: FrictionLawFit) -> dict[str, float]:
    return {p.name: p.value for p in fit.parameters}


@pytest.mark.parametrize("law", LAWS)
def test_exact_points_give_the_exact_parameters_without_a_guess(law: str) -> None:
    found = fit_friction_laws(FORCE, SPEED, clean(law))
    assert found.best.law == law
    assert values_of(fit_of(found, law)) == pytest.approx(VALUES[law], rel=1e-6)
    assert fit_of(found, law).rms_misfit < 1e-9


@pytest.mark.parametrize(
    ("law", "draws"), [("power", 4), *(pytest.param(x, 25, marks=pytest.mark.long) for x in LAWS)]
)
def test_noisy_points_give_the_law_and_its_parameters_within_their_errors(
    law: str, draws: int
) -> None:
    rng = np.random.default_rng(17)
    z, best = [], []
    for _ in range(draws):
        mu = clean(law) * (1.0 + 0.005 * rng.normal(size=FORCE.size))
        found = fit_friction_laws(FORCE, SPEED, mu, 0.005 * np.eye(FORCE.size))
        best.append(found.best.law)
        z.append([(p.value - VALUES[law][p.name]) / p.se for p in fit_of(found, law).parameters])
    assert np.sqrt(np.mean(np.square(z))) < 1.5
    assert np.mean([b == law for b in best]) > 0.6


def test_a_speed_scale_far_below_the_measured_speeds_is_not_determined() -> None:
    rng = np.random.default_rng(13)
    values = {**VALUES["power_stribeck_1"], "v_s": 2e-4}
    mu = clean("power_stribeck_1", v_s=2e-4) * (1.0 + 0.001 * rng.normal(size=FORCE.size))
    found = fit_friction_laws(FORCE, SPEED, mu, 0.001 * np.eye(FORCE.size))
    fit = fit_of(found, "power_stribeck_1")
    assert fit.rms_misfit < 0.0015  # what is measured is met
    assert [p.name for p in fit.parameters if not math.isfinite(p.se)] == ["mu_s", "v_s"]
    assert all(abs(p.value - values[p.name]) < 5.0 * p.se for p in fit.parameters)


def test_a_shared_error_is_the_error_of_the_level() -> None:
    """All points wrong by 1 % together: the level is known to 1 %, the exponent as before."""
    mu = clean("power") * (1.0 + 0.002 * np.random.default_rng(3).normal(size=FORCE.size))
    own = 0.002 * np.eye(FORCE.size)
    with_gain = np.column_stack([own, np.full(FORCE.size, 0.01)])
    alone, shared = (
        fit_of(fit_friction_laws(FORCE, SPEED, mu, S), "power") for S in (own, with_gain)
    )
    (mu0, a), (mu0_shared, a_shared) = alone.parameters, shared.parameters
    assert mu0_shared.se == pytest.approx(math.hypot(mu0.se, 0.01 * mu0.value), rel=0.05)
    assert a_shared.se == pytest.approx(a.se, rel=0.05)
    assert mu0_shared.value == pytest.approx(mu0.value, rel=1e-3)


def test_two_points_of_a_power_law_lie_on_it() -> None:
    known = fit_friction_laws([1e3, 4e3], [0.01, 0.01], [1.0, 0.5], np.diag([1e-4, 2e-4]))
    assert [fit.law for fit in known.fits] == ["coulomb", "power"]  # one speed
    # half way between the points on a logarithmic scale, at 2000 N/m
    found = values_of(fit_of(known, "power"))
    assert found == pytest.approx({"mu0": math.sqrt(0.5), "a": 0.5}, rel=1e-3)


@pytest.mark.parametrize(
    ("material", "heads", "holds"),
    [
        ("DragonSkin10", ("1",), False),
        ("DragonSkin10", ("1", "2"), False),
        ("Sil950", ("1",), False),
        ("DragonSkin10", ("2",), True),
    ],
)
def test_no_law_is_forced_on_silicone_measured_by_others(
    material: str, heads: tuple[str, ...], holds: bool
) -> None:
    path = Path(__file__).parents[2] / "rigdata" / "measured_by_others" / "silicone.csv"
    with path.open() as file:
        rows = [r for r in csv.DictReader(file) if r["material"] == material and r["head"] in heads]
    force, mu = (np.array([float(row[key]) for row in rows]) for key in ("normal_force_N", "mu"))
    laws = fit_friction_laws(force, np.full(force.size, 0.01), mu)
    assert any(fit.law_error <= 0.1 for fit in laws.fits) is holds


def test_points_that_are_no_friction_are_refused() -> None:
    for points in (([1e3], [0.1], [1.0]), ([1e3, 2e3], [0.1, -0.1], [1.0, 0.9])):
        with pytest.raises(InputError):
            fit_friction_laws(*points)


def test_a_constant_known_to_be_shared_has_no_scatter_to_fit() -> None:
    f, v = np.geomspace(1000, 6000, 40), np.geomspace(0.002, 0.04, 40)
    with pytest.raises(NumericsError, match="coulomb"):
        fit_friction_laws(f, v, np.full(40, 0.8), np.full((40, 1), 0.05))
