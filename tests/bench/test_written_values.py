"""Clock times and numbers as they are written: read if no other reading is left, else refused."""

import datetime
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from beltid.bench.recording import Recording, read_recording
from beltid.config import load_config
from beltid.errors import InputError

STEP = 0.02
N = 30
T = np.arange(N) * STEP
START = datetime.datetime(2026, 11, 20, 13, 45, 2, 125000)


def stamps(start: datetime.datetime = START, n: int = N) -> list[datetime.datetime]:
    """Every 20 ms, by the calendar of Python."""
    return [start + datetime.timedelta(milliseconds=20 * i) for i in range(n)]


def clocked(
    folder: Path, times: Sequence[str], head: str = "Uhrzeit", name: str = "P1.csv"
) -> Path:
    path = folder / name
    rows = [f"{t};{0.01 * i:.2f};{10 * i}" for i, t in enumerate(times)]
    path.write_text("\n".join([f"{head};Weg [mm];Kraft [N]", *rows]) + "\n", encoding="utf-8")
    return path


def read(path: Path) -> Recording:
    return read_recording(path, "press")


def problems(path: Path) -> list[str]:
    with pytest.raises(InputError) as caught:
        read(path)
    return [p.replace(str(path), path.name) for p in caught.value.problems]


WRITTEN = {
    "13:45:02:125000": "%H:%M:%S:%f",
    "20.11.26 13:45:02,125 +01:00": "%d.%m.%y %H:%M:%S,%f +01:00",
}


@pytest.mark.parametrize("form", WRITTEN.values(), ids=WRITTEN)
def test_every_way_of_writing_them(tmp_path, form):
    recording = read(clocked(tmp_path, [t.strftime(form) for t in stamps()]))
    np.testing.assert_allclose(recording.columns["time_s"], T, atol=1e-9)
    first = START.strftime(form)
    assert any(f"seconds are counted from the first, {first}" in n for n in recording.notes)


def test_a_clock_of_twelve_hours_is_refused(tmp_path):
    path = clocked(tmp_path, [t.strftime("%I:%M:%S.%f %p") for t in stamps()])
    assert "Uhrzeit" in problems(path)[0]


def test_the_end_of_summer_time(tmp_path):
    zones = [
        "2026-10-25T02:59:59.98+02:00",
        "2026-10-25T02:00:00+01:00",
        "2026-10-25T02:00:00.02+01:00",
    ]
    recording = read(clocked(tmp_path, zones))
    np.testing.assert_allclose(recording.columns["time_s"], [0.0, 0.02, 0.04], atol=1e-9)
    assert problems(clocked(tmp_path, [z[:-6] for z in zones])) == [
        "P1.csv:3: Uhrzeit goes back from 02:59:59.980 to 02:00:00 without passing midnight, "
        "must not go backwards"
    ]


def test_a_stop_watch_comes_before_a_clock(tmp_path):
    times = [f"{t.strftime('%H:%M:%S.%f')};{s:.2f}" for t, s in zip(stamps(), 5 + T, strict=True)]
    recording = read(clocked(tmp_path, times, "Uhrzeit;Zeit [s]"))
    np.testing.assert_array_equal(recording.columns["time_s"], np.round(5 + T, 2))


def test_parquet_stamps_are_exact_to_the_nanosecond_and_reported_where_they_go_back(tmp_path):
    count = 1_763_646_302_125_000_001 + np.array([0, 1, 2_000_000_000])
    columns = {
        "test": ["a"] * 3,
        "temperature_degC": [22.0] * 3,
        "displacement_mm": [0.1, 0.2, 0.3],
        "force_N": [10.0, 20.0, 30.0],
    }
    for counts in (count, count[[0, 2, 1]]):
        times = pa.array(counts, pa.timestamp("ns"))
        pq.write_table(pa.table({**columns, "time_s": times}), tmp_path / "press.parquet")
        if counts is count:
            found = read(tmp_path / "press.parquet").columns["time_s"]
            np.testing.assert_allclose(found, [0, 1e-9, 2], rtol=0, atol=1e-12)
        else:
            assert problems(tmp_path / "press.parquet")[0].startswith(
                "press.parquet, row 3: time_s goes back from"
            )


# --- numbers -------------------------------------------------------------------------------------

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
