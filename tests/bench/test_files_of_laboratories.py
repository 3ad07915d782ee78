"""Files as laboratories write them: what their programs put around the samples does not matter,
what cannot be read is named.

All numbers are synthetic: a press that follows F = 2000 d in N and mm, at 10 samples a second.
"""

from __future__ import annotations

import bz2
import gzip
import io
import re
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest

from beltid.bench.big_recording import open_big
from beltid.bench.files.sniff import decode
from beltid.bench.recording import Recording, read_recording
from beltid.config import load_config
from beltid.errors import InputError

T = np.round(np.arange(40) * 0.1, 3)
D = np.round(0.01 * np.minimum(T, 3.9 - T), 5)
F = np.round(2000.0 * D, 3)
ROWS = [f"{t};{d};{f}" for t, d, f in zip(T, D, F, strict=True)]
HEADER = "Zeit [s];Weg [mm];Kraft [N]"


def read(path: Path, config: dict[str, object] | None = None) -> Recording:
    return read_recording(path, "press", load_config(config or {}))


def refused(path: Path) -> str:
    with pytest.raises(InputError) as error:
        read(path)
    return str(error.value)


def assert_is_the_press(recording: Recording) -> None:
    for name, expected in (("time_s", T), ("displacement_mm", D), ("force_N", F)):
        np.testing.assert_allclose(recording.columns[name], expected, rtol=0, atol=1e-12)


def test_comments_and_heads_between_the_rows_are_left_out_and_reported(tmp_path):
    lines = [HEADER, *ROWS[:20], "# cycle 2", HEADER, *ROWS[20:], "# end of measurement"]
    path = tmp_path / "P22.csv"
    path.write_text("\n".join(lines) + "\n")
    recording = read(path)
    assert_is_the_press(recording)
    assert (
        "3 lines of comments (#) and repeated headers left out between the rows" in recording.notes
    )
    lines[23] += "x"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=r"P22\.csv:24: "):  # those before it stay counted
        read(path)


def test_a_repeated_row_of_units_is_left_out_with_its_head(tmp_path):
    head = ["Zeit;Weg;Kraft", "s;mm;N"]
    path = tmp_path / "P22.csv"
    path.write_text("\n".join([*head, *ROWS[:20], "", *head, *ROWS[20:]]) + "\n")
    assert_is_the_press(read(path))


def test_labels_that_begin_with_a_sign_of_comments_are_labels(tmp_path):
    path = tmp_path / "P22.csv"
    path.write_text("\n".join(["Versuch;" + HEADER, *(f"#1;{row}" for row in ROWS)]) + "\n")
    recording = read(path)
    assert_is_the_press(recording)
    assert set(recording.columns["test"]) == {"#1"}


def test_a_big_recording_leaves_them_out_as_well(tmp_path):
    row = "R1,{},310,290,0.1,40,300"
    lines = [row.format(t) for t in T]
    head = "run,time_s,tension_tight_N,tension_slack_N,pulley_speed_rad_s,arc_deg,initial_tension_N"
    path = tmp_path / "rig.csv"
    path.write_text("\n".join([head, *lines[:20], "# cycle 2", head, *lines[20:]]) + "\n")
    big = open_big(path)
    (run,) = list(big)
    np.testing.assert_array_equal(run.columns["time_s"], T)
    assert "2 lines of comments (#) and repeated headers left out between the rows" in big.notes


def test_quoted_cells_with_blanks_around_them(tmp_path):
    rows = (" , ".join(f'"{v}"' for v in row) for row in zip(T, D, F, strict=True))
    path = tmp_path / "P22.csv"
    path.write_text("\n".join(['"Time [s]" , "Travel [mm]" , "Load [N]"', *rows]) + "\n")
    assert_is_the_press(read(path))


def test_a_clock_whose_form_stands_as_its_unit(tmp_path):
    rows = (f"00:00:{t:06.3f};{d};{f}" for t, d, f in zip(T, D, F, strict=True))
    path = tmp_path / "P22.asc"
    head = ["DASYLab - V 13.00.00", "", "Messzeit[hh:mm:ss.s];Weg[mm];Kraft[N]"]
    path.write_text("\n".join([*head, *rows]) + "\n")
    assert_is_the_press(read(path))


CATMAN = HEADER.replace("Zeit", "Zeit  1 - Standardmessrate")
START_AND_RATE = ["T0 = 20.11.2026 13:00:00;;", "dt = 100 ms;;", " s;mm;N"]


@pytest.mark.parametrize(
    ("title", "below"), [([], []), ([], START_AND_RATE), (["Test;5PK"], START_AND_RATE)]
)
def test_channels_of_catman(tmp_path, title, below):
    """With the start and the rate between names and units, or without them."""
    names = re.sub(r" \[\w+\]", "", CATMAN) if below else CATMAN
    path = tmp_path / "P22.asc"
    path.write_text("\n".join([*title, names, *below, *ROWS]) + "\n")
    assert_is_the_press(read(path))


def test_days_of_a_spreadsheet_are_a_unit_of_time(tmp_path):
    rows = (f"{float(46085 + t / 86400)!r};{d};{f}" for t, d, f in zip(T, D, F, strict=True))
    path = tmp_path / "P22.csv"
    path.write_text("\n".join(["Datum/Uhrzeit;Weg [mm];Kraft [N]", *rows]) + "\n")
    time = read(path, {"units": {"press": {"time_s": "d"}}}).columns["time_s"]
    np.testing.assert_allclose(time - time[0], T, atol=2e-6)  # eps of 46085 days is 0.6 us


def test_merged_cells_of_a_head_over_two_rows(tmp_path):
    from openpyxl import Workbook

    book = Workbook()
    sheet = book.active
    sheet.append(["Zeit", "Stempel"])
    sheet.merge_cells("A1:A2")
    sheet.merge_cells("B1:C1")
    sheet.append([None, "Weg", "Kraft"])
    sheet.append(["s", "mm", "N"])
    for row in zip(T, D, F, strict=True):
        sheet.append([float(v) for v in row])
    book.save(tmp_path / "P22.xlsx")
    assert_is_the_press(read(tmp_path / "P22.xlsx"))


@pytest.mark.parametrize("sign", ["\t", ","])
def test_labview_with_tabs_and_with_commas(tmp_path, sign):
    word = {"\t": "Tab", ",": "Comma"}[sign]
    lines = [
        ["LabVIEW Measurement"],
        ["Separator", word],
        ["Decimal_Separator", "."],
        ["X_Columns", "One"],
        ["***End_of_Header***", ""],
        [],
        ["Channels", "2"],
        ["Y_Unit_Label", "mm", "N"],
        ["X_Dimension", "Time", "Time"],
        ["***End_of_Header***", "", ""],
        ["X_Value", "Weg", "Kraft", "Comment"],
        *([str(v) for v in row] for row in zip(T, D, F, strict=True)),
    ]
    path = tmp_path / "P22.lvm"
    path.write_text("\n".join(map(sign.join, lines)) + "\n")
    assert_is_the_press(read(path))


def _tar() -> bytes:
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w") as archive:
        entry = tarfile.TarInfo("P22.csv")
        entry.size = 3
        archive.addfile(entry, io.BytesIO(b"a,b"))
    return packed.getvalue()


def _zip(*names: str) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name in names:
            archive.writestr(name, "application/vnd.oasis.opendocument.spreadsheet")
    return packed.getvalue()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (gzip.compress(_tar(), mtime=0), "cannot be read; export it to CSV"),
        (_zip("mimetype", "content.xml"), "files of several kinds"),
        (_zip("[Content_Types].xml", "xl/workbook.bin"), "a binary Excel workbook (.xlsb)"),
        (b"\xd0\xcf\x11\xe0" + bytes(99), "cannot be read; export it to CSV"),
        (bz2.compress("\n".join(ROWS).encode()), "cannot be read; export it to CSV"),
        (gzip.compress(gzip.compress(b"x" * 99, mtime=0), mtime=0), "packed twice"),
        (b"DIAHEADERSTART\n1,x\n", "column force_N is missing"),
        (b'<?xml version="1.0"?>\n<a>', "column force_N is missing"),
        (b'{"time_s": [0, 1]}', "holds no samples"),
        ("\n".join([HEADER, *ROWS, "\0" * 99]).encode(), "P22.csv:42: contains a zero byte"),
        (
            HEADER.encode("utf-16-le"),
            "without a byte order mark: set dialect: {encoding: utf-16-le}",
        ),
    ],
)
def test_what_cannot_be_read_is_refused(tmp_path, content, words):
    path = tmp_path / "P22.csv"
    path.write_bytes(content)
    assert words in refused(path)


def test_text_in_utf_16_without_its_mark_is_read_where_the_config_says_so(tmp_path):
    path = tmp_path / "P22.csv"
    path.write_bytes(("\r\n".join([HEADER, *ROWS]) + "\r\n").encode("utf-16-le"))
    assert_is_the_press(read(path, {"dialect": {"encoding": "utf-16-le"}}))
    with pytest.raises(InputError, match="utf-16-be"):
        decode(HEADER.encode("utf-16-be"), "P22.csv")


def test_exponents_of_fortran_are_exponents(tmp_path):
    def fortran(value: float) -> str:
        return f"{value:.9E}".replace("E", "D")

    rows = (";".join(map(fortran, row)) for row in zip(T, D, F, strict=True))
    path = tmp_path / "P22.dat"
    path.write_text("\n".join([HEADER, *rows]) + "\n")
    assert_is_the_press(read(path))


@pytest.mark.parametrize(
    "word",
    ["#N/A", "#NV", "#DIV/0!", "-nan(ind)", "1.#QNAN", "-1.#IND", "<NA>", "n.a.", "---", "\u2013"],
)
def test_words_of_programs_for_a_missing_number(tmp_path, word):
    path = tmp_path / "P22.csv"
    rows = [*ROWS[:7], f"{T[7]};{D[7]};{word}", *ROWS[8:]]
    path.write_text("\n".join([HEADER, *rows]) + "\n")
    recording = read(path)
    assert np.flatnonzero(np.isnan(recording.columns["force_N"])).tolist() == [7]
    assert "1 of 40 samples of force_N are missing" in recording.notes


def test_errors_of_a_spreadsheet_are_missing_numbers(tmp_path):
    from openpyxl import Workbook

    book = Workbook()
    sheet = book.active
    sheet.append(HEADER.split(";"))
    for row in zip(T, D, F, strict=True):
        sheet.append([float(v) for v in row])
    sheet["C9"] = "#DIV/0!"
    book.save(tmp_path / "P22.xlsx")
    force = read(tmp_path / "P22.xlsx").columns["force_N"]
    assert np.flatnonzero(np.isnan(force)).tolist() == [7]


def test_our_names_with_another_unit_are_converted(tmp_path):
    path = tmp_path / "P22.csv"
    rows = (f"{1e3 * t:.0f},{1e3 * d:.2f},{1e-3 * f:.9f}" for t, d, f in zip(T, D, F, strict=True))
    path.write_text("\n".join(["time_ms,displacement_um,force_kN", *rows]) + "\n")
    recording = read(path)
    assert_is_the_press(recording)
    assert any("force_kN" in note and "kN to N" in note for note in recording.notes)


def test_a_head_whose_cells_hold_line_breaks(tmp_path):
    path = tmp_path / "P22.csv"
    head = '"Zeit\n[s]";"Weg\n[mm]";"Kraft\n[N]"'
    path.write_text("\n".join(["Versuch 7", "", head, *ROWS]) + "\n")
    assert_is_the_press(read(path))
    path.write_text("\n".join([head, *ROWS[:20], "1;2", *ROWS[20:]]) + "\n")
    assert "P22.csv:25: 2 cells, must be 3" in refused(path)


def test_folders_in_a_folder_of_recordings_are_named(tmp_path):
    for place in ("P1.csv", "day2/P2.csv", "results/P1.txt"):
        (tmp_path / place).parent.mkdir(exist_ok=True)
        (tmp_path / place).write_text("\n".join([HEADER, *ROWS]) + "\n")
    assert "folders with further files left out: day2" in read(tmp_path).notes


def test_packed_numbers_of_netcdf_are_refused(tmp_path):
    import h5py

    with h5py.File(tmp_path / "P22.nc", "w") as file:
        counts = np.round(F / 0.02).astype(np.int32) - 50
        for name, values, unit in (("time", T, "s"), ("travel", D, "mm"), ("force", counts, "N")):
            file.create_dataset(name, data=values).attrs["units"] = unit
        file["force"].attrs.update({"scale_factor": 0.02, "add_offset": 1.0})
    assert "scale_factor = 0.02" in refused(tmp_path / "P22.nc")
    with h5py.File(tmp_path / "P22.nc", "a") as file:
        file["force"].attrs["_FillValue"] = counts[7]
    assert "_FillValue" in refused(tmp_path / "P22.nc")


def test_settings_in_attributes_that_are_arrays_of_one(tmp_path):
    import h5py

    still = {"tension_tight_N": 100.0 + T, "tension_slack_N": 100.0 - T, "pulley_speed_rad_s": T}
    with h5py.File(tmp_path / "R1.h5", "w") as file:
        file.attrs.update({"arc_deg": np.array([82.0]), "initial_tension_N": np.array([[100.0]])})
        for name, values in {"time_s": T, **still}.items():
            file.create_dataset(name, data=values)
    columns = read_recording(tmp_path / "R1.h5", "rig").columns
    assert set(columns["arc_deg"]) == {82.0}
    assert set(columns["initial_tension_N"]) == {100.0}


@pytest.mark.parametrize("stated", [{}, {"dialect": {"separator": " "}}])
def test_columns_set_apart_by_blanks(tmp_path, stated):
    rows = (f"  {t:8.3f} {d:10.5f}  {f:9.3f} " for t, d, f in zip(T, D, F, strict=True))
    path = tmp_path / "P22.dat"
    path.write_text("\n".join(["  time_s  displacement_mm force_N", *rows]) + "\n")
    assert_is_the_press(read(path, stated))
    path.write_text("\n".join(["time_s displacement_mm force_N", *rows, " 0.1  x 2.0"]) + "\n")
    with pytest.raises(InputError, match=r'P22\.dat:2: displacement_mm = "x", must be a number'):
        read(path, stated)
