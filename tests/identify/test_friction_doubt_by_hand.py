"""What a friction law misses, the words about its parameters and the verdict, by hand."""

from __future__ import annotations

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest

from beltid.errors import InputError
from beltid.identify.surface.laws import (
    NOT_DETERMINED,
    NOT_ZERO,
    chi_square_note,
    fit_friction_laws,
    law_variance,
    status,
    verdict_of,
)


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
    fit = fit_friction_laws(*points, mu, se).fit("coulomb")
    w = se**-2.0
    assert fit.law_error == 0.0
    assert fit.values["mu0"] == pytest.approx(w @ mu / w.sum(), rel=1e-9)
    assert fit.parameters[0].se == pytest.approx(w.sum() ** -0.5, rel=1e-9)
    # relative scatter of s: misfits of equal weight, minimum of sum (1 - m/mu)²
    free = fit_friction_laws(*points, mu).fit("coulomb")
    m = np.sum(1 / mu) / np.sum(1 / mu**2)
    s = math.sqrt(np.sum((1 - m / mu) ** 2) / 3)
    assert free.law_error == pytest.approx(s, rel=1e-9)
    assert math.isnan(free.chi_square)
    assert free.parameters[0].se == pytest.approx(s / math.sqrt(np.sum(1 / mu**2)), rel=1e-6)


def test_as_many_parameters_as_points_have_errors_that_are_believed_or_unknown():
    f, v, mu = [1e3, 4e3], [0.01, 0.01], [1.0, 0.5]
    known = fit_friction_laws(f, v, mu, [0.01, 0.01], reference_force_N_m=1e3).fit("power")
    assert known.values == pytest.approx({"mu0": 1.0, "a": 0.5}, rel=1e-9)
    # mu0 rests on the first point alone, a = ln(mu_1/mu_2)/ln 4 on both
    assert known.parameters[0].se == pytest.approx(0.01, rel=1e-6)
    assert known.parameters[1].se == pytest.approx(math.hypot(0.01, 0.02) / math.log(4), rel=1e-6)
    unknown = fit_friction_laws(f, v, mu).fit("power")
    assert {p.status for p in unknown.parameters} == {NOT_DETERMINED}
    assert np.isnan(unknown.covariance).all()


def test_a_value_within_two_errors_of_zero_is_not_told_from_it():
    mu, v = np.array([0.8, 1.0]), np.array([0.01, 0.1])
    for se, said in ((0.109, ""), (0.111, NOT_ZERO), (0.99, NOT_ZERO), (1.01, NOT_DETERMINED)):
        assert status("a", 0.22, se, mu, v) == said
    for name, value, limit in (
        ("mu0", 0.9, 0.45),  # half the mean
        ("mu_k", 0.9, 0.45),
        ("v0", 0.002, 0.002 * 0.5 * math.log(10.0)),  # a factor of ten at two errors
        ("v_s", 0.02, 0.02 * 0.5 * math.log(10.0)),
        ("c", 100.0, 4.5),  # half the mean at the highest speed
        ("b", 10.0, 10.0),  # itself, or one
        ("b", 0.4, 1.0),
    ):
        zero = NOT_ZERO if name == "b" else ""
        assert status(name, value, 0.99 * limit, mu, v) == zero
        assert status(name, value, 1.01 * limit, mu, v) == NOT_DETERMINED


@pytest.mark.parametrize(
    ("chi_square", "dof", "said"),
    [
        (400.0, 100, "misses the points by more than their errors, by 3 %"),
        (130.0, 100, None),
        (5.0, 100, "scatter by less than their errors"),
        (80.0, 100, None),
        (3.0, 1, None),  # far from one, but no wonder
        (0.2, 1, None),
        (3.0, 0, "as many parameters as points"),
    ],
)
def test_chi_square_far_from_its_expectation_is_noted(chi_square, dof, said):
    found = chi_square_note("power", chi_square, dof, 0.03)
    assert len(found) == (said is not None)
    assert said is None or re.search(f"^power: .*{said}", found[0])


def test_points_are_ordered_and_their_errors_completed():
    f, v = [3e3, 1e3, 2e3, 5e3], [0.102, 0.2, -0.1, 0.1029]
    found = fit_friction_laws(f, v, [0.9, 1.1, 1.0, 0.8], [0.09, np.nan, 0.0, 0.04])
    assert found.notes == ("2 points without a standard error: 7.5 % taken",)
    assert dict(found.refused)["power_log"].startswith("2 sliding speeds, 3 are needed")
    free = fit_friction_laws([*f, np.nan], [*v, 0.1], [0.9, 1.1, 1.0, 0.8, 0.9])
    assert [n.split(":")[0] for n in free.notes] == [
        "1 of 5 points left out",
        "no standard errors of mu",
    ]
    for points, words in (
        (([1e3, 2e3], [0.1, 0.1], [1.0, 0.9], [0.1]), "mu_se: 1 values, must be 2"),
        (([1e3], [0.1], [1.0]), "1 usable points of 1, must be at least 2"),
    ):
        with pytest.raises(InputError, match=words):
            fit_friction_laws(*points)
    with pytest.raises(InputError, match="reference_force_N_m"):
        fit_friction_laws(f, v, [0.9, 1.1, 1.0, 0.8], reference_force_N_m=-1.0)
    other = fit_friction_laws(f, [0.1, 0.2, 0.1, 0.1062], [0.9, 1.1, 1.0, 0.8])
    assert not any("sliding speeds" in why for law, why in other.refused if law == "power_log")
    for force, refused in ((1049.0, True), (1051.0, False)):
        laws = fit_friction_laws([1e3, force, 1e3], [0.1] * 3, [1.0, 0.9, 1.0])
        assert ("all points at one force" in dict(laws.refused).get("power", "")) == refused


def test_verdict_names_the_best_law_its_equals_and_the_constant():
    def fit(law, criterion, rms, worst, determined=True):
        return SimpleNamespace(
            law=law, criterion=criterion, rms_misfit=rms, worst_misfit=worst,
            determined=determined, law_error=0.0, formula=SimpleNamespace(text="TEXT"),
        )  # fmt: skip

    fits = [
        fit("coulomb", 40.0, 0.12, -0.31),
        fit("power", 1.9, 0.02, 0.05),
        fit("power_log", 0.0, 0.01, -0.03, determined=False),
        fit("power_stribeck_1", 2.0, 0.01, 0.03),
        fit("power_stribeck_2", math.nan, 0.01, 0.03),
    ]
    assert verdict_of(fits) == (
        "Best formula: power_log, TEXT (f in N/m, v in m/s), misfit 1 % RMS, 3 % at worst; not all "
        "of its parameters are determined: use it within the measured range only; power does as "
        "well. A constant coefficient misses by 12 % RMS, 31 % at worst."
    )
    assert verdict_of(fits[:1]) == (
        "Best formula: coulomb, TEXT (f in N/m, v in m/s), misfit 12 % RMS, 31 % at worst."
    )
    assert verdict_of(fits[4:]) == "Too few independent points to compare friction laws."
