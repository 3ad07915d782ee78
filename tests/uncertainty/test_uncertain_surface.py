"""Band and covariance of a surface, against direct Gaussian computations."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from beltid.errors import InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.uncertain_surface import UncertainSurface

F, V = np.array([1000.0, 2000.0, 4000.0]), np.array([0.01, 0.02])
MU = np.array([[1.0, 1.1], [0.9, 1.0], [0.8, 0.9]])
FACTOR = np.zeros((3, 2, 3))
FACTOR[..., 0] = 0.004  # one error that moves all nodes
FACTOR[0, 0, 1] = FACTOR[2, 1, 2] = 0.003


def surface() -> UncertainSurface:
    plain = FrictionSurface(F, V, MU, 0.003 * MU)
    return UncertainSurface(plain, FACTOR, ["gain"])


def test_combined_uncertainty_at_nodes_and_beyond():
    s = surface()
    assert s.mu_u(1000.0, 0.01) == pytest.approx(0.005)
    assert s.mu_u(2000.0, 0.02) == pytest.approx(0.004)
    assert s.mu_u(90.0, 0.001) == pytest.approx(0.005)  # that of the nearest node
    assert s.mu_se(2000.0, 0.02) == pytest.approx(0.003)
    assert np.isnan(s.mu_u(np.nan, 0.01))
    assert s.mu_u(F[:, None], V).shape == (3, 2)


def test_bands_hold_their_level():
    low, high = surface().band(1000.0, 0.01)
    assert high / 1.0 == pytest.approx(np.exp(1.959964 * 0.005), rel=1e-6)
    assert low * high == pytest.approx(1.0)
    low, high = surface().band(2000.0, 0.01)  # mu = 0.9, u(ln mu) = 0.4 %
    assert (low, high) == pytest.approx(0.9 * np.exp(1.959964 * np.array([-0.004, 0.004])))
    for level in (1.5, 1.0, 0.0, -0.1):
        with pytest.raises(InputError, match=rf"level = {level}, must be in \(0, 1\)"):
            surface().band(1000.0, 0.01, level=level)


def test_the_factor_is_bilinear_between_nodes_in_the_coordinates_of_the_surface():
    # ln(1 + f / 1000 N/m) of the nodes: ln 2, ln 3, ln 5; a middle is a geometric mean
    middle_v = 0.01 * (np.sqrt(2 * 3) - 1)
    low, high = 1000 * (np.sqrt(2 * 3) - 1), 1000 * (np.sqrt(3 * 5) - 1)
    found = surface().factor_at([low, high, np.nan], middle_v)
    np.testing.assert_allclose(found[0], [0.004, 0.003 / 4, 0.0], rtol=1e-12, atol=1e-18)
    np.testing.assert_allclose(found[1], [0.004, 0.0, 0.003 / 4], rtol=1e-12, atol=1e-18)
    assert np.isnan(found[2]).all()
    quarter = 1000 * (2 ** (3 / 4) * 3 ** (1 / 4) - 1)
    np.testing.assert_allclose(
        surface().factor_at(quarter, 0.01), [0.004, 0.00225, 0.0], rtol=1e-12, atol=1e-18
    )


def test_the_two_neighbours_of_each_axis_count():
    v = np.array([0.01, 0.03, 0.07])  # ln(1 + v / 0.01 m/s) of ln 2, 4, 8
    columns = np.tile(np.array([0.01, 0.02, 0.05])[:, None], (3, 1, 1))
    s = UncertainSurface(FrictionSurface(F, v, np.ones((3, 3))), columns)
    middles = 0.01 * (np.array([np.sqrt(2 * 4), np.sqrt(4 * 8)]) - 1)
    np.testing.assert_allclose(s.mu_u(2000.0, middles), [0.015, 0.035], rtol=1e-12)


def test_one_speed_and_one_force_have_their_uncertainty_too():
    one_speed = UncertainSurface(FrictionSurface(F, V[:1], MU[:, :1]), FACTOR[:, :1])
    assert one_speed.mu_u(1000.0, 0.5) == pytest.approx(0.005)
    one_force = UncertainSurface(FrictionSurface(F[:1], V, MU[:1]), FACTOR[:1])
    assert one_force.mu_u(9000.0, 0.02) == pytest.approx(1.1 * 0.004)


def test_without_covariance_the_standard_error_is_all_that_is_known():
    plain = UncertainSurface(FrictionSurface(F, V, MU, 0.01 * MU))
    assert plain.mu_u(1000.0, 0.01) == pytest.approx(0.01)
    with pytest.raises(InputError, match="no covariance"):
        plain.factor_at(1000.0, 0.01)
    with pytest.raises(InputError, match=r"factor: shape \(2, 2, 1\)"):
        UncertainSurface(FrictionSurface(F, V, MU), np.zeros((2, 2, 1)))


def test_every_source_has_a_column_and_scatter_need_not_be():
    plain = FrictionSurface(F, V, MU)
    assert UncertainSurface(plain, FACTOR[..., :1], ["gain"]).mu_u(2000.0, 0.02) == pytest.approx(
        0.004
    )
    with pytest.raises(InputError, match="factor: shape"):
        UncertainSurface(plain, FACTOR[..., :1], ["gain", "zero"])
    with pytest.raises(InputError, match="factor: shape"):
        UncertainSurface(plain, FACTOR[..., 0])


def test_it_is_a_friction_surface_and_survives_a_pickle():
    s = surface()
    again = pickle.loads(pickle.dumps(s))
    assert again == s
    assert again.sources == ("gain",)
    np.testing.assert_array_equal(again.factor, FACTOR)
    assert s.mu(1000.0, 0.01) == pytest.approx(1.0)
