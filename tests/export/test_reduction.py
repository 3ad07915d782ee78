"""Deviations of simpler laws: closed forms and independent interpolation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

import beltid
from beltid.errors import InputError
from beltid.export import reduction
from beltid.export.law import ContactLaw, friction_part


def power_law(law: ContactLaw, a: float, b: float) -> ContactLaw:
    """mu = 0.9 f^-a v^b on many nodes, so that the surface is that law to five digits."""
    f, v = np.geomspace(500.0, 8000.0, 33), np.geomspace(0.002, 0.032, 33)
    surface = beltid.FrictionSurface(f, v, 0.9 * f[:, None] ** -a * v[None, :] ** b)
    return law.model_copy(update={"friction": friction_part(surface, "published")})


def test_deviations_of_a_power_law_are_those_of_its_closed_form(law: ContactLaw) -> None:
    a, b = 0.17, 0.16
    made = power_law(law, a, b)
    point = reduction.reference_point(made, 2000.0, 0.008)
    constant = reduction.constant_deviation(made.surface, point)
    # mu(2000, 0.008)/mu(f, v) = (f/2000)^a (v/0.008)^-b: at 8000 N/m, 0.002 m/s
    assert constant.worst == pytest.approx(4 ** (a + b) - 1, rel=1e-3)
    assert constant.where == "at 8000 N/m, 0.002 m/s"


def test_rms_is_over_the_range_even_in_the_logarithms_of_the_surface(law: ContactLaw) -> None:
    made = power_law(law, 0.2, 0.0)
    point = reduction.reference_point(made, 2000.0, 0.008)
    x = np.linspace(math.log(2.0), math.log(17.0), 20001)  # ln(1 + f/500)
    f = 500.0 * np.expm1(x)
    expected = np.sqrt(np.mean(((f / 2000.0) ** 0.2 - 1.0) ** 2))
    found = reduction.constant_deviation(made.surface, point).rms
    assert found == pytest.approx(expected, rel=0.01)


def test_linear_normal_law_is_the_secant(law: ContactLaw) -> None:
    point = reduction.reference_point(law, 4990.0, 0.01)
    # Eq. (3): 49.9 µm under 40 N/cm, 87.5 µm under 80 N/cm; secant at 4990 N/m
    delta = (-6.5e7 + math.sqrt(6.5e7**2 + 4 * 3.0256e11 * 4990.0)) / (2 * 3.0256e11)
    assert reduction.linear_stiffness(law, point) == pytest.approx(4990.0 / delta, rel=1e-12)
    deviation = reduction.linear_normal_deviation(law, point)
    # at 400 N/m, the low end: penetration 6.0 µm, where the law is hardly steeper than k_linear
    shallow = (-6.5e7 + math.sqrt(6.5e7**2 + 4 * 3.0256e11 * 400.0)) / (2 * 3.0256e11)
    assert deviation.worst == pytest.approx(4990.0 / delta * shallow / 400.0 - 1, rel=1e-9)
    assert deviation.where == "at 400 N/m"


def test_a_surface_that_begins_without_force_has_a_deviation(law: ContactLaw) -> None:
    surface = beltid.FrictionSurface([0.0, 400.0, 8000.0], [0.01], [[1.0], [0.9], [0.8]])
    made = law.model_copy(update={"friction": friction_part(surface, "published")})
    point = reduction.reference_point(made, 4990.0)
    deviation = reduction.linear_normal_deviation(made, point)
    # towards no force the law is k_linear delta
    limit = reduction.linear_stiffness(made, point) / law.normal.k_linear_N_m2 - 1.0
    assert deviation.worst == pytest.approx(limit, rel=0.02)


def test_table_is_as_close_as_it_says(law: ContactLaw) -> None:
    table = reduction.friction_table(law.surface)
    assert table.deviation.worst <= 1e-3
    assert set(law.surface.normal_force_N_m) <= set(table.normal_force_N_m)
    rng = np.random.default_rng(11)
    f = np.exp(rng.uniform(np.log(400.0), np.log(12000.0), 4000))
    v = np.exp(rng.uniform(np.log(0.0025), np.log(0.04), 4000))
    bilinear = RegularGridInterpolator(
        (table.normal_force_N_m, table.slip_speed_m_s), table.mu, bounds_error=False
    )
    inside = np.clip(f, 400.0 + 1e-9, 12000.0 - 1e-9), np.clip(v, 0.0025 + 1e-12, 0.04 - 1e-12)
    relative = np.abs(bilinear(np.column_stack(inside)) / law.surface.mu(*inside) - 1.0)
    assert 0.8 * table.deviation.worst < relative.max() < 1.2 * table.deviation.worst


@pytest.mark.parametrize(
    ("force", "speed", "said"),
    [
        (100.0, None, "--normal-force = 100, must be in the range of mu, 400 to 12000 N/m"),
        (None, 1.0, "--speed = 1, must be in the range of mu, 0.0025 to 0.04 m/s"),
        (math.nan, None, "--normal-force = nan"),
        (math.inf, None, "--normal-force = inf"),
        (-3.0, -1.0, "--speed = -1"),
    ],
)
def test_a_reference_point_outside_is_refused(
    law: ContactLaw, force: Any, speed: Any, said: str
) -> None:
    with pytest.raises(InputError) as error:
        reduction.reference_point(law, force, speed)
    assert said in str(error.value)


def test_a_constant_coefficient_has_no_deviation_and_takes_any_point(law: ContactLaw) -> None:
    surface = beltid.FrictionSurface.constant(0.7)
    made = law.model_copy(update={"friction": friction_part(surface, "published")})
    point = reduction.reference_point(made, 123.0)
    assert point.normal_force_N_m == 123.0
    assert reduction.constant_deviation(surface, point).worst == 0.0
    assert reduction.friction_table(surface).mu.tolist() == [[0.7]]


@pytest.mark.parametrize("end", [1e-6, 1.0, 60.0, 300.0, 1.0e4, 1.0e5])
def test_a_table_of_penetrations_is_short_wherever_the_press_ended(
    law: ContactLaw, end: float
) -> None:
    pressed = law.validity.model_copy(update={"press_force_N_m": (0.0, end)})
    law = law.model_copy(update={"validity": pressed})
    nodes = reduction.penetration_nodes(law)
    assert 33 <= nodes.size <= 130
    assert law.normal_law.force(nodes[-1]) >= 0.999 * max(end, law.surface.normal_force_N_m[-1])
    at_end = np.abs(nodes - law.normal_law.penetration(end)).min()
    assert at_end < 1e-12 or law.normal_law.penetration(end) < 0.5 * nodes[1]
