"""Tables against their text, what must hold for all of them; spellings of units."""

import pytest

from beltid.tables import schemas
from beltid.tables.schemas import Column, column_of
from beltid.tables.units import CONVERSIONS, canonical_unit, conversion


@pytest.mark.parametrize(
    ("line", "column", "allowed"),
    [
        (
            "b_deg?  (0, 3600]  deg  arc",
            Column("b_deg", "float64", "deg", "arc", False, 0.0, 3600.0, True, required=False),
            "in (0, 3600]",
        ),
        ("d  count  1  runs", Column("d", "int64", "1", "runs", low=0.0), ">= 0"),
        ("f  list of 4?  1  rows", Column("f", "list", "1", "rows", True, length=4), "finite"),
        (
            "g  dry | wet | dusty?  -  state",
            Column("g", "string", "", "state", True, choices=("dry", "wet", "dusty")),
            "dry, wet or dusty",
        ),
    ],
)
def test_a_line_states_a_column(line: str, column: Column, allowed: str) -> None:
    assert column_of(line) == column
    assert column.allowed == allowed


@pytest.mark.parametrize(
    "line", ["a_N  positive  N  force", "a_N  > 0  N", "a_N  (0; 1)  N  force"]
)
def test_a_line_with_a_slip_is_refused(line: str) -> None:
    with pytest.raises(ValueError, match=r"a_N|values to unpack"):
        column_of(line)


@pytest.mark.parametrize("table", schemas.TABLES.values(), ids=lambda table: table.kind)
def test_columns_are_named_once_and_their_units_are_known(table: schemas.Table) -> None:
    assert len(set(table.names)) == len(table.names)
    assert table.label in ("", *table.names)
    for column in table.columns:
        assert column.low < column.high
        assert (column.unit == "") == (column.dtype in ("string", "bool"))
        if table.kind in schemas.RECORDINGS and column.dtype == "float64":
            assert column.unit in CONVERSIONS, column.name


@pytest.mark.parametrize(
    ("written", "meant"), [("μm", "um"), ("N·m", "N m"), ("furlong", "furlong")]
)
def test_spellings(written: str, meant: str) -> None:
    assert canonical_unit(written) == meant


@pytest.mark.parametrize("target", CONVERSIONS)
def test_a_unit_converts_to_itself_unchanged(target: str) -> None:
    by = conversion(target, target)
    assert by is not None
    assert (by.factor, by.shift) == (1.0, 0.0)
    assert all(conversion(unit, target) is not None for unit in CONVERSIONS[target])
