"""Parametric friction laws: known laws in, parameters out; what is wrong or unknown is told."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import curve_fit

from beltid.errors import InputError
from beltid.identify.surface.laws import (
    NOT_DETERMINED,
    fit_friction_laws,
    law_variance,
)
from beltid.laws.friction_formulas import FRICTION_LAWS, FrictionFormula

LAWS = tuple(FRICTION_LAWS)
VALUES = {
    "coulomb": {"mu0": 0.8},
    "power": {"mu0": 0.9, "a": 0.22},
    "power_log": {"mu0": 0.6, "a": 0.15, "b": 0.4, "v0": 0.002},
    "power_stribeck_1": {"mu_s": 1.3, "mu_k": 0.8, "a": 0.12, "v_s": 0.02, "c": 1.5},
    "power_stribeck_2": {"mu_s": 1.3, "mu_k": 0.8, "a": 0.12, "v_s": 0.03, "c": 1.5},
}
SPEEDS = np.array([0.0025, 0.005, 0.0105, 0.022, 0.046, 0.1])
FORCES = np.geomspace(1000.0, 9000.0, 8)


def grid(speeds=SPEEDS, forces=FORCES):
    f, v = np.meshgrid(forces, speeds, indexing="ij")
    return f.ravel(), v.ravel()


def noisy(law, rng, share=0.005, speeds=SPEEDS):
    f, v = grid(speeds)
    clean = FrictionFormula(law, 3000.0, VALUES[law]).mu(f, v)
    se = share * clean
    mu = clean + se * rng.normal(size=f.size)
    return f, v, mu, np.diag(se / mu)


@pytest.mark.parametrize("law", LAWS)
def test_exact_points_give_the_exact_parameters_without_a_guess(law):
    f, v = grid()
    mu = FrictionFormula(law, 3000.0, VALUES[law]).mu(f, v)
    found = fit_friction_laws(f, v, mu)
    assert found.best == law
    assert found.fit(law).values == pytest.approx(VALUES[law], rel=1e-7)
    assert found.fit(law).rms_misfit < 1e-9


@pytest.mark.parametrize(
    ("law", "draws"),
    [("power_log", 10), *(pytest.param(x, 25, marks=pytest.mark.long) for x in LAWS)],
)
def test_noisy_points_give_the_parameters_within_their_errors_and_the_law(law, draws):
    rng = np.random.default_rng(17)
    pulls, best = [], []
    for _ in range(draws):
        found = fit_friction_laws(*noisy(law, rng))
        best.append(found.best)
        pulls.append([(p.value - VALUES[law][p.name]) / p.se for p in found.fit(law).parameters])
    # 25 draws determine a standard deviation to 14 %, 10 to 22 %; the errors are never too small
    assert np.all(np.std(pulls, axis=0) < 1.45)
    assert np.all(np.std(pulls, axis=0) > 0.4)
    assert np.all(np.abs(np.mean(pulls, axis=0)) < 0.7)
    richer = LAWS[LAWS.index(law) :]
    assert np.mean([b == law for b in best]) > 0.6
    assert all(b in richer or "stribeck" in law for b in best)


def test_parameters_far_from_the_measured_speeds_are_open_or_within_their_errors():
    """Several speed scales fit as well: linear errors at one of them would be far too small."""
    rng = np.random.default_rng(13)
    f, v = grid()
    open_ones = 0
    for law in ("power_stribeck_1", "power_stribeck_2"):
        for v_s in (2e-4, 0.5, 2.0):
            values = {**VALUES[law], "v_s": v_s}
            clean = FrictionFormula(law, 3000.0, values).mu(f, v)
            mu = clean * (1.0 + 0.001 * rng.normal(size=f.size))
            fit = fit_friction_laws(f, v, mu, 0.001 * np.eye(f.size))
            fit = fit.fit(law)
            for p in fit.parameters:
                open_ones += not p.determined
                assert not p.determined or abs(p.value - values[p.name]) < 5.0 * p.se, (v_s, p)
                assert p.determined or any(f"{p.name} is not determined" in n for n in fit.notes)
            assert fit.rms_misfit < 0.0015  # what is measured is still met
    assert open_ones >= 6


def test_the_fit_is_generalised_least_squares_with_the_covariance_of_the_points():
    f, v, mu, _ = noisy("power_log", np.random.default_rng(3))
    rng = np.random.default_rng(4)
    S = np.column_stack(
        [0.004 * np.ones(f.size), 0.003 * np.log(f / 3000.0), 0.005 * np.eye(f.size)]
    )
    mu *= np.exp(S[:, :2] @ rng.normal(size=2))
    fit = fit_friction_laws(f, v, mu, factor=S).fit("power_log")

    def model(x, mu0, a, b, v0):
        return mu0 * (x[0] / 3000.0) ** -a * (1.0 + b * np.log(1.0 + x[1] / v0))

    C = S @ S.T + fit.law_error**2 * np.eye(f.size)
    best, covariance = curve_fit(
        model, (f, v), mu, [0.6, 0.15, 0.4, 0.002], np.outer(mu, mu) * C, absolute_sigma=True,
        xtol=1e-13, ftol=1e-13,
    )  # fmt: skip
    assert [p.value for p in fit.parameters] == pytest.approx(best.tolist(), rel=1e-5)
    r = 1.0 - model((f, v), *best) / mu
    if fit.law_error > 0.0:
        assert r @ np.linalg.solve(C, r) == pytest.approx(f.size - 4, rel=1e-5)
    # ours are widened by the correlation that is left, all by the same factor, never made smaller
    ratio = [p.se**2 for p in fit.parameters] / np.diag(covariance)
    assert ratio == pytest.approx(ratio[0], rel=1e-3)
    assert 1.0 - 1e-6 < ratio[0] < 3.0


def test_a_covariance_of_low_rank_forces_no_law_through_the_points():
    f, v = grid()
    mu = FrictionFormula("power_stribeck_2", 3000.0, VALUES["power_stribeck_2"]).mu(f, v)
    fit = fit_friction_laws(f, v, mu, factor=0.01 * np.ones((f.size, 1))).fit("power_log")
    free = fit_friction_laws(f, v, mu).fit("power_log")
    # a shared gain alone tells nothing of the shape: all of the misfit is the law's
    assert fit.rms_misfit < 1.5 * free.rms_misfit
    assert fit.law_error == pytest.approx(free.law_error, rel=0.2)


def test_what_the_law_misses_makes_chi_square_equal_to_the_degrees_of_freedom():
    # equal variances: 4 r² / (1 + q) = 2 gives q = 2 r² - 1
    r = np.full(4, 3.0)
    assert law_variance(r, np.ones(4), 2) == pytest.approx(17.0, rel=1e-9)
    # 9/(1 + q) + 16/(4 + q) = 1: q² - 20 q - 48 = 0
    found = law_variance(np.array([3.0, 4.0]), np.array([1.0, 4.0]), 1)
    assert found == pytest.approx(10.0 + math.sqrt(148.0), rel=1e-9)
    assert law_variance(r, np.full(4, 20.0), 2) == 0.0  # their errors explain the misfits
    assert law_variance(r, np.zeros(4), 2) == pytest.approx(18.0, rel=1e-9)  # the scatter itself
    assert law_variance(r, np.ones(4), 0) == 0.0


def test_a_constant_has_the_error_of_a_weighted_mean():
    mu, se = np.array([1.1, 0.9, 1.05, 0.95]), np.array([0.2, 0.2, 0.1, 0.1])
    points = [1e3, 2e3, 3e3, 4e3], [0.01, 0.02, 0.04, 0.08]
    fit = fit_friction_laws(*points, mu, np.diag(se / mu)).fit("coulomb")
    w = se**-2.0
    assert fit.law_error == 0.0
    assert fit.values["mu0"] == pytest.approx(w @ mu / w.sum(), rel=1e-9)
    assert fit.parameters[0].se == pytest.approx(w.sum() ** -0.5, rel=1e-9)
    # relative scatter of s: misfits of equal weight, minimum of sum (1 - m/mu)²
    free = fit_friction_laws(*points, mu).fit("coulomb")
    m = np.sum(1 / mu) / np.sum(1 / mu**2)
    s = math.sqrt(np.sum((1 - m / mu) ** 2) / 3)
    assert free.law_error == pytest.approx(s, rel=1e-9)
    assert free.parameters[0].se == pytest.approx(s / math.sqrt(np.sum(1 / mu**2)), rel=1e-6)


def test_as_many_parameters_as_points_have_errors_that_are_believed_or_unknown():
    f, v, mu = [1e3, 4e3], [0.01, 0.01], [1.0, 0.5]
    errors = np.diag([0.01, 0.02])
    known = fit_friction_laws(f, v, mu, errors).fit("power")
    # half way between the points on a logarithmic scale, at 2000 N/m
    assert known.values == pytest.approx({"mu0": math.sqrt(0.5), "a": 0.5}, rel=1e-9)
    se = 0.5 * math.hypot(0.01, 0.02) * math.sqrt(0.5)
    assert known.parameters[0].se == pytest.approx(se, rel=1e-6)
    assert known.parameters[1].se == pytest.approx(math.hypot(0.01, 0.02) / math.log(4), rel=1e-6)
    unknown = fit_friction_laws(f, v, mu).fit("power")
    assert {p.status for p in unknown.parameters} == {NOT_DETERMINED}


def test_points_are_ordered_and_checked():
    f, v = [3e3, 1e3, 2e3, 5e3], [0.102, 0.2, 0.1, 0.1029]
    found = fit_friction_laws(f, v, [0.9, 1.1, 1.0, 0.8])
    assert [note.split(":")[0] for note in found.notes] == ["no standard errors of mu"]
    assert [fit.law for fit in found.fits] == ["coulomb", "power"]  # two settings of the speed
    for points, words in (
        (([1e3, 2e3], [0.1, 0.1], [1.0, 0.9], [[0.1]]), "1 rows of their covariance"),
        (([1e3], [0.1], [1.0]), "1 coefficients .* at least 2"),
        (([1e3, 2e3], [0.1, -0.1], [1.0, 0.9]), "not a number > 0"),
        (([1e3, 2e3], [0.1, 0.1], [1.0, np.nan]), "not a number > 0"),
    ):
        with pytest.raises(InputError, match=words):
            fit_friction_laws(*points)
    other = fit_friction_laws(f, [0.1, 0.2, 0.1, 0.1062], [0.9, 1.1, 1.0, 0.8])
    assert "power_log" in [fit.law for fit in other.fits]  # three of them
    for force, laws in ((1049.0, ["coulomb"]), (1051.0, ["coulomb", "power"])):
        at_forces = fit_friction_laws([1e3, force, 1e3], [0.1] * 3, [1.0, 0.9, 1.0])
        assert [fit.law for fit in at_forces.fits] == laws
