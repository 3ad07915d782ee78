"""Spellings of units, and units that nothing has to be done for; the others are read by files."""

from __future__ import annotations

import pytest

from beltid.tables.units import CONVERSIONS, canonical_unit, conversion


@pytest.mark.parametrize(
    ("written", "meant"), [("μm", "um"), ("N·m", "N m"), ("furlong", "furlong")]
)
def test_spellings(written, meant):
    assert canonical_unit(written) == meant


@pytest.mark.parametrize("target", CONVERSIONS)
def test_a_unit_converts_to_itself_unchanged(target):
    by = conversion(target, target)
    assert by is not None
    assert (by.factor, by.shift) == (1.0, 0.0)
    assert all(conversion(unit, target) is not None for unit in CONVERSIONS[target])
