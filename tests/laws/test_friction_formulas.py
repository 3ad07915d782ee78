"""Formulas of friction and of normal contact laws: values by hand, limits, derivatives."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from beltid.laws.friction_formulas import FRICTION_LAWS

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


def values(law):
    return [VALUES[name] for name in FRICTION_LAWS[law].parameters]


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
def test_values_are_those_of_the_formula_and_of_its_text(law):
    f, v = np.array([900.0, 5000.0, 12000.0]), np.array([1e-3, 0.01, 0.2])
    expected = [by_hand(law, *p) for p in zip(f, v, strict=True)]
    assert FRICTION_LAWS[law].mu(values(law), f / 5000.0, v) == pytest.approx(expected, rel=1e-14)
    text = FRICTION_LAWS[law].text(values(law), 5000.0)
    text = text.removeprefix("mu = ").replace("^", "**").replace("ln", "log")
    found = eval(text, {"f": f, "v": v, "log": np.log, "exp": np.exp})
    assert found + 0.0 * v == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("law", FRICTION_LAWS)
@given(f=st.floats(0.1, 3.0), v=st.floats(1e-4, 1.0), share=st.floats(0.2, 5.0))
def test_derivatives_by_the_parameters_are_those_of_differences(law, f, v, share):
    model, at = FRICTION_LAWS[law], (np.array([f]), np.array([v]))
    p = share * np.array(values(law))
    gradient = model.gradient(p, *at)
    assert gradient.shape == (1, p.size)
    for k in range(p.size):
        step = np.zeros(p.size)
        step[k] = 1e-5 * p[k]
        difference = (model.mu(p + step, *at) - model.mu(p - step, *at)) / (2.0 * step[k])
        scale = np.abs(model.mu(p, *at) / p[k])
        assert gradient[:, k] == pytest.approx(difference, rel=1e-6, abs=1e-6 * float(scale[0]))


@pytest.mark.parametrize("law", FRICTION_LAWS)
def test_laws_are_linear_in_their_amplitudes(law):
    model, v, f = FRICTION_LAWS[law], np.array([0.0, 0.003, 0.05]), np.array([0.5, 1.0, 2.0])
    amplitudes = np.array([0.9, 0.6, 2.0])[: model.terms(v, 0.01).shape[1]]
    a = 0.2 if "a" in model.parameters else 0.0
    p = model.from_amplitudes(amplitudes, a, 0.01)
    expected = f**-a * (model.terms(v, 0.01) @ amplitudes)
    assert model.mu(p, f, v) == pytest.approx(expected, rel=1e-14)
    assert p.size == len(model.parameters)
    if model.scale:
        assert p[list(model.parameters).index(model.scale)] == 0.01
