"""Formulas of friction: values by hand, limits, derivatives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from beltid.laws.friction_formulas import (
    FRICTION_LAWS,
    PARAMETERS,
    FrictionFormula,
    has_force_exponent,
    has_speed_scale,
    speed_terms,
)

VALUES = {
    "mu0": 0.9,
    "a": 0.2,
    "b": 0.3,
    "v0": 0.002,
    "mu_s": 1.1,
    "mu_k": 0.7,
    "v_s": 0.01,
    "c": 2.0,
}


def formula(law):
    return FrictionFormula(law, 5000.0, {name: VALUES[name] for name in PARAMETERS[law]})


def by_hand(law, f, v):
    p, falling = VALUES, (f / 5000.0) ** -0.2
    d = 2 if law.endswith("2") else 1
    stribeck = 0.7 + (1.1 - 0.7) * math.exp(-((v / 0.01) ** d)) + 2.0 * v
    return {
        "coulomb": p["mu0"],
        "power": p["mu0"] * falling,
        "power_log": p["mu0"] * falling * (1.0 + 0.3 * math.log(1.0 + v / 0.002)),
    }.get(law, falling * stribeck)


@pytest.mark.parametrize("law", FRICTION_LAWS)
def test_values_are_those_of_the_formula(law):
    f, v = np.array([900.0, 5000.0, 12000.0]), np.array([1e-3, 0.01, 0.2])
    found = formula(law).mu(f, v)
    assert found == pytest.approx([by_hand(law, *p) for p in zip(f, v, strict=True)], rel=1e-14)
    assert np.array_equal(formula(law).mu(f, -v), found)


@pytest.mark.parametrize("law", FRICTION_LAWS)
def test_text_is_the_formula_itself(law):
    text = formula(law).text.removeprefix("mu = ").replace("^", "**").replace("ln", "log")
    f, v = 3000.0, 0.004
    found = eval(text, {"f": f, "v": v, "log": math.log, "exp": math.exp})
    assert found == pytest.approx(by_hand(law, f, v), rel=1e-12)


@pytest.mark.parametrize("law", [x for x in FRICTION_LAWS if has_speed_scale(x)])
@given(v=st.floats(1e-4, 1.0), scale=st.floats(-8.0, 0.0))
def test_derivatives_by_the_speed_scale_are_those_of_differences(law, v, scale):
    h, at = 1e-6, np.array([v])
    high, low = (speed_terms(law, at, scale + s)[0] for s in (h, -h))
    assert speed_terms(law, at, scale)[1] == pytest.approx((high - low) / (2 * h), abs=1e-8)


def test_terms_of_the_laws_by_hand():
    v, scale = np.array([0.0, 0.003]), 0.01
    fading_1, fading_2 = math.exp(-0.3), math.exp(-0.09)
    expected = {
        "coulomb": [[1.0], [1.0]],
        "power": [[1.0], [1.0]],
        "power_log": [[1.0, 0.0], [1.0, math.log(1.3)]],
        "power_stribeck_1": [[1.0, 0.0, 0.0], [fading_1, 1.0 - fading_1, 0.003]],
        "power_stribeck_2": [[1.0, 0.0, 0.0], [fading_2, 1.0 - fading_2, 0.003]],
    }
    for law in FRICTION_LAWS:
        terms, derivatives = speed_terms(law, v, math.log(scale))
        assert terms == pytest.approx(np.array(expected[law]), rel=1e-14)
        assert derivatives.shape == terms.shape
        assert has_force_exponent(law) == ("a" in PARAMETERS[law])


@pytest.mark.parametrize("law", ["coulomb", "power"])
def test_laws_without_a_speed_scale_do_not_change_with_it(law):
    terms, derivatives = speed_terms(law, np.array([0.1, 0.2]), -3.0)
    assert np.array_equal(terms, [[1.0], [1.0]])
    assert np.array_equal(derivatives, [[0.0], [0.0]])
