"""Thousands separators: read where no other reading is left, else refused; told once."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import pytest

from beltid.bench.recording import read_recording
from beltid.config import load_config
from beltid.errors import InputError

FORCES = [950.5, 1000.12, 1250.0, 12345.67]


def press(folder: Path, forces: list[str], separator: str = ";") -> Path:
    """Forces as they are written, beside numbers without a decimal sign."""
    rows = [separator.join((str(i), str(i), f'"{f}"')) for i, f in enumerate(forces)]
    path = folder / "P1.csv"
    head = separator.join(("Zeit [s]", "Weg [mm]", "Kraft [N]"))
    path.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    return path


def forces(path: Path, **dialect: str) -> list[float]:
    recording = read_recording(path, "press", load_config({"dialect": dialect}))
    return recording.columns["force_N"].tolist()


def written(value: float, thousands: str, decimal: str) -> str:
    text = f"{value:,.2f}"
    return text.translate(str.maketrans({",": thousands, ".": decimal}))


GROUPS = [(",", "."), (".", ","), *product("'’ \u00a0\u2009\u202f", ".,")]


@pytest.mark.parametrize(("thousands", "decimal"), GROUPS)
@pytest.mark.parametrize("separator", [";", ","])
def test_both_signs_leave_one_reading(tmp_path, thousands, decimal, separator):
    path = press(tmp_path, [written(f, thousands, decimal) for f in FORCES], separator)
    assert forces(path) == FORCES


def test_two_groups_leave_one_reading(tmp_path):
    assert forces(press(tmp_path, ["950", "1,250", "1,234,567"])) == [950, 1250, 1234567]
    assert forces(press(tmp_path, ["950", "1.250", "1.234.567"])) == [950, 1250, 1234567]


def test_a_point_that_cannot_be_a_decimal_sign_is_asked_for(tmp_path):
    path = press(tmp_path, ["950", "1.250", "2.100"])
    assert forces(path, thousands=".") == [950, 1250, 2100]
    assert forces(path, decimal=".") == [950, 1.25, 2.1]
    assert forces(press(tmp_path, ["950", "1.25", "2.125"])) == [950, 1.25, 2.125]
    # another sign marks the thousands: the point is a decimal sign
    assert forces(press(tmp_path, ["1'000.5", "950", "1.250"])) == [1000.5, 950, 1.25]


def test_three_decimals_stay_decimals(tmp_path):
    assert forces(press(tmp_path, ["1.250", "12.375", "999.000"])) == [1.25, 12.375, 999.0]
    assert forces(press(tmp_path, ["0,125", "1,250", "999,000"])) == [0.125, 1.25, 999.0]


@pytest.mark.parametrize("sign", ["\u2212", "\u2013"])
def test_a_typographic_minus_is_a_minus(tmp_path, sign):
    rows = [f"{sign}1.250,5", f"{sign}5,25", "3,75"]
    assert forces(press(tmp_path, rows)) == [-1250.5, -5.25, 3.75]


@pytest.mark.parametrize(("text", "value"), [("1'234", 1234.0), ("1,250", None)])
def test_header_fields(tmp_path, text, value):
    path = tmp_path / "R1.csv"
    head = "Zeit [s];Zugtrum [N];Leertrum [N];Drehzahl [1/min];Umschlingungswinkel [°]"
    rows = [f"{i};310.5;150.5;{60 * (i > 9)};82" for i in range(20)]
    path.write_text("\n".join(["Riemen;5PK", f"Vorspannkraft;{text};N", "", head, *rows]) + "\n")
    if value is not None:
        assert set(read_recording(path, "rig").columns["initial_tension_N"]) == {value}
        return
    with pytest.raises(
        InputError, match=r'header field "Vorspannkraft"\) = "1,250", may be 1.250 or'
    ):
        read_recording(path, "rig")
