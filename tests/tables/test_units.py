"""Units of benches against values worked out by hand."""

from __future__ import annotations

import math

import pytest

from beltid.tables.units import CONVERSIONS, allowed_units, canonical_unit, conversion


@pytest.mark.parametrize(
    ("value", "unit", "target", "expected"),
    [
        (1.0, "kN", "N", 1000.0),
        (1.0, "lbf", "N", 4.4482216152605),
        (3.0, "kg", "N", 29.41995),
        (64.0, "µm", "mm", 0.064),
        (60.0, "rpm", "rad/s", 2.0 * math.pi),
        (212.0, "°F", "degC", 100.0),
        (273.15, "K", "degC", 0.0),
        (math.pi, "rad", "deg", 180.0),
        (1.0, "lbf in", "N m", 0.1129848290276167),
    ],
)
def test_conversions(value, unit, target, expected):
    by = conversion(unit, target)
    assert by is not None
    assert (value + by.shift) * by.factor == pytest.approx(expected, rel=1e-14, abs=1e-12)


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("[N]", "N"),
        ("μm", "um"),
        ("µm", "um"),
        ("1/min", "rpm"),
        ("N·m", "N m"),
        ("°C", "degC"),
        ("furlong", "furlong"),
    ],
)
def test_spellings(written, meant):
    assert canonical_unit(written) == meant


@pytest.mark.parametrize("target", CONVERSIONS)
def test_a_unit_converts_to_itself_unchanged(target):
    by = conversion(target, target)
    assert by is not None
    assert (by.factor, by.shift) == (1.0, 0.0)
    assert all(conversion(unit, target) is not None for unit in allowed_units(target))
