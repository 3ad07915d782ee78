"""Friction below the slowest measured speed: half of the trend, and the limits of its error."""

from __future__ import annotations

import numpy as np
import pytest

from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.slow_friction import continued
from beltid.laws.surface_tables import SurfaceTables, evaluate_cell, locate

SLOWEST = 0.002
F, V = np.geomspace(100.0, 10000.0, 25), np.geomspace(SLOWEST, 0.05, 30)


def power_law(exponent: float, force_axis: np.ndarray = F) -> FrictionSurface:
    """``mu = 0.8 (f/1000)^-0.2 (v/SLOWEST)^exponent``: a straight line of ln mu over ln v."""
    mu = 0.8 * (force_axis[:, None] / 1000.0) ** -0.2 * (V / SLOWEST) ** exponent
    return FrictionSurface(force_axis, V, mu)


def mu_of(tables: SurfaceTables, f: float, v: float) -> float:
    i, s, _ = locate(tables.x_nodes, tables.f_ref, f)
    j, t, _ = locate(tables.y_nodes, tables.v_ref, v)
    return float(evaluate_cell(tables.C, i, j, s, t)[0])


@pytest.mark.parametrize("exponent", [0.2, -0.15])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_a_power_law_goes_on_with_its_share_and_fades_at_rest(
    exponent: float, share: float
) -> None:
    tables = continued(power_law(exponent), share)
    for f in (150.0, 1234.0, 9000.0):
        for over in (0.9, 0.4, 0.1, 0.02, 0.0):
            expected = 0.8 * (f / 1000.0) ** -0.2 * ((over + 0.01) / 1.01) ** (share * exponent)
            assert mu_of(tables, f, over * SLOWEST) == pytest.approx(expected, rel=2e-3)


def test_what_was_measured_stays() -> None:
    surface = power_law(0.2)
    tables = continued(surface, 0.5)
    for f, v in ((150.0, SLOWEST), (1234.0, 0.0031), (9000.0, 0.05), (9000.0, 0.2)):
        assert mu_of(tables, f, v) == pytest.approx(float(surface.mu(f, v)), rel=1e-14)
    assert continued(FrictionSurface.constant(0.5), 1.0).C.shape == (1, 1, 4, 4)
    from_rest = FrictionSurface([1000.0], [0.0, 0.01], [[0.5, 0.6]])
    assert continued(from_rest, 1.0) is from_rest.tables()


def test_a_trend_that_is_scatter_of_the_nodes_is_bounded() -> None:
    v = [SLOWEST, 1.05 * SLOWEST, 0.05]
    tables = continued(FrictionSurface([1000.0], v, [[0.2, 0.5, 0.6]]), 1.0)
    at_rest = mu_of(tables, 1000.0, 0.0)
    assert at_rest == pytest.approx(0.2 * (0.01 / 1.01) ** 0.5, rel=1e-6)
