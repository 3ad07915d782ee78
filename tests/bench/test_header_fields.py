"""Header fields: numbers of either decimal sign and either sign, with or without a unit."""

from __future__ import annotations

from itertools import product

import pytest

from beltid.bench.formats.table_head import is_unit, read_field

WHOLE = ("0", "1", "82", "-3", "+270")
DECIMALS = [str(n) for n in range(100)] + ["01", "010", "1000"]


@pytest.mark.parametrize("unit", ["", " deg", "deg", " °", " N", "N", " rad/s"])
def test_a_number_keeps_its_decimals(unit: str) -> None:
    for whole, point, decimals in product(WHOLE, ".,", DECIMALS):
        written = f"{whole}{point}{decimals}"
        found = read_field("Setting", written + unit)
        assert (found.text, found.unit) == (written, unit.strip())


@pytest.mark.parametrize("text", [".1", ",1", "1.1"])
def test_a_number_is_no_unit(text: str) -> None:
    assert not is_unit(text)
