"""Words, units and digits of results; tables that fit."""

import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from beltid.report.summary import Summary, cell, name_and_unit, show
from beltid.tables import schemas


def test_units_shown_are_those_of_the_tables() -> None:
    spelling = {"deg": "°", "degC": "°C", "um": "µm", "1": ""}
    for table in schemas.TABLES.values():
        for column in table.columns:
            if column.dtype == "float64":
                expected = spelling.get(column.unit, column.unit)
                assert name_and_unit(column.name)[1] == expected, (table.kind, column.name)
    assert name_and_unit("valid torque_N_m") == ("valid torque", "N m")


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("tension_N", 0.0, "0"),
        ("tension_N", 371.0949, "371.1"),
        ("k_linear_se_N_m2", 12163.2, "1.2e+04"),
        ("mu_se", 0.001268, "0.0013"),
        ("mu", float("nan"), "-"),
        ("mu", None, "-"),
        ("swapped", True, "yes"),
        ("mu_range", (0.5, 1.25), "0.5000 to 1.2500"),
        ("mu_range", [0.9236, 0.9236], "0.9236"),
        ("arcs_deg", [40.0, 82.0], "40, 82"),
        ("rms_percent", 3.71834, "3.72"),
    ],
)
def test_values_have_sensible_digits(name: str, value: Any, text: str) -> None:
    assert cell(name, value) == text


def printed(summary: Summary, width: int, **options: bool) -> str:
    file = io.StringIO()
    show(summary, Console(file=file, width=width, color_system=None), **options)
    return file.getvalue()


TABLE = [
    {"run": f"R{k}", "normal_force_N_m": 1000.0 * k, "mu": 0.5, "status": "ok"} for k in (1, 2)
]


def test_a_wide_terminal_gets_a_table_and_a_narrow_one_records() -> None:
    summary = Summary("x", "a title", table=TABLE)
    wide = printed(summary, 80)
    assert any(line.split() == ["R2", "2000", "0.5000", "ok"] for line in wide.splitlines())
    narrow = printed(summary, 28)
    assert "- run: R2\n" in narrow
    assert "  normal force [N/m]: 2000\n" in narrow


def test_no_line_ends_with_blanks_and_none_is_too_long() -> None:
    for width in range(20, 90, 7):
        lines = printed(Summary("x", "title", facts={"runs": 3}, table=TABLE), width).splitlines()
        assert all(line == line.rstrip() and len(line) <= width for line in lines)


def test_the_overview_stands_for_a_long_table_unless_all_is_wanted() -> None:
    summary = Summary("x", "t", table=TABLE, overview=[{"runs": 2}], shown=("run", "mu"))
    assert "R1" not in printed(summary, 80)
    complete = printed(summary, 80, complete=True)
    assert "R1" in complete
    assert "2000" not in complete  # not one of the columns shown


def test_json_has_null_for_what_is_missing() -> None:
    facts = {"a": math.nan, "b": np.float64(1.5), "c": np.array([1.0, np.inf]), "p": Path("x")}
    product = Summary("x", "t", facts=facts).as_json()
    assert product["facts"] == {"a": None, "b": 1.5, "c": [1.0, None], "p": "x"}
    json.dumps(product, allow_nan=False)
