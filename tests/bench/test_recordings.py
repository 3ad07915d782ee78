"""Recordings of the benches: what is read, and what is told about what cannot be."""

from __future__ import annotations

import csv
import gzip
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

import beltid
from beltid.bench.big_recording import open_big
from beltid.bench.formats.csv_table import Wanted, read_rows
from beltid.bench.formats.dialect import layout
from beltid.bench.recording import columns_of, read_recording, read_rig
from beltid.config import load_config
from beltid.config.model import DialectSection
from beltid.errors import EXIT_INPUT, InputError

RIGDATA = Path(__file__).parents[2] / "rigdata"
HEADER = (
    "run,time_s,tension_tight_N,tension_slack_N,pulley_speed_rad_s,temperature_degC,arc_deg,"
    "initial_tension_N"
)


def rows(n: int = 6, run: str = "R1", tight: str = "310.5", arc: str = "82") -> list[str]:
    return [f"{run},{0.02 * i:.2f},{tight},150.25,0.21,22.0,{arc},270" for i in range(n)]


def write(folder: Path, lines: list[str], name: str = "rig.csv", end: str = "\n") -> Path:
    path = folder / name
    path.write_bytes((end.join(lines) + end).encode())
    return path


def problems(path: Path, kind: str = "rig", config: dict[str, object] | None = None) -> list[str]:
    with pytest.raises(InputError) as caught:
        read_recording(path, kind, load_config(config))
    assert caught.value.exit_status == EXIT_INPUT
    return [p.replace(f"{path}", path.name) for p in caught.value.problems]


# --- what is right ---------------------------------------------------------------------------


@pytest.mark.parametrize("belt", ["4pk", "5pk", "6pk"])
@pytest.mark.parametrize("kind", ["press", "rig", "speedloss"])
def test_the_bench_recordings_are_read_exactly(belt, kind):
    path = RIGDATA / belt / f"{kind}.csv"
    recording = read_recording(path, kind)
    with path.open(newline="") as file:
        expected = list(csv.DictReader(file))
    for name, values in recording.columns.items():
        cells = [row[name] for row in expected]
        if values.dtype == object:
            assert values.tolist() == cells
        else:
            numbers = np.array([float(c) if c else np.nan for c in cells])
            np.testing.assert_array_equal(values, numbers)


def test_missing_samples_are_kept_and_reported(tmp_path):
    lines = [HEADER, *rows()]
    lines[3] = "R1,0.04,,nan,0.21,NA,82,270"
    recording = read_recording(write(tmp_path, lines), "rig")
    assert np.flatnonzero(np.isnan(recording.columns["tension_tight_N"])).tolist() == [2]
    assert np.flatnonzero(np.isnan(recording.columns["tension_slack_N"])).tolist() == [2]
    assert "1 of 6 samples of tension_tight_N are missing" in recording.notes


def test_the_temperature_may_be_missing(tmp_path):
    cut = [",".join(line.split(",")[:5] + line.split(",")[6:]) for line in [HEADER, *rows()]]
    recording = read_recording(write(tmp_path, cut), "rig")
    assert np.isnan(recording.columns["temperature_degC"]).all()
    assert list(recording.columns) == HEADER.split(",")


def test_other_columns_and_another_order_are_no_matter(tmp_path):
    frame = pd.read_csv(write(tmp_path, [HEADER, *rows()]))
    frame["comment"] = "text, with a comma"
    path = tmp_path / "other.csv"
    frame[frame.columns[::-1]].to_csv(path, index=False, quoting=csv.QUOTE_ALL)
    recording = read_recording(path, "rig")
    np.testing.assert_array_equal(recording.columns["time_s"], 0.02 * np.arange(6))
    assert recording.notes == ("columns left out: comment",)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("bom", [b"", b"\xef\xbb\xbf"])
def test_line_ends_marks_and_blank_lines_do_not_shift_the_lines(tmp_path, end, bom):
    lines = ["", HEADER, *rows(3), "", "", *rows(2, "R2")]
    path = tmp_path / "rig.csv"
    path.write_bytes(bom + end.join(lines).encode())
    assert read_recording(path, "rig").n_samples == 5
    lines[8] = lines[8].replace("310.5", "-3.1")
    path.write_bytes(bom + end.join(lines).encode())
    assert problems(path) == ["rig.csv:9: tension_tight_N = -3.1, must be > 0"]


def test_a_cell_over_two_lines_does_not_shift_the_lines(tmp_path):
    lines = [HEADER + ",note", *(r + ",x" for r in rows())]
    lines[2] = lines[2][:-1] + '"two\nlines"'
    lines[5] = lines[5].replace("150.25", "-1")
    assert problems(write(tmp_path, lines)) == ["rig.csv:7: tension_slack_N = -1, must be > 0"]


def test_packed_recordings(tmp_path):
    plain = write(tmp_path, [HEADER, *rows()])
    packed = tmp_path / "rig.csv.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    one, two = read_recording(plain, "rig"), read_recording(packed, "rig")
    np.testing.assert_array_equal(one.columns["time_s"], two.columns["time_s"])
    packed.write_bytes(packed.read_bytes()[:-9])
    assert problems(packed) == ["rig.csv.gz: the gzip file is damaged or cut off"]


def test_settings_given_once_per_run_are_filled_in(tmp_path):
    lines = [HEADER, *rows(3), *rows(3, "R2", arc="40")]
    for i in (2, 3, 5, 6):
        lines[i] = ",".join(lines[i].split(",")[:6]) + ",,"
    recording = read_recording(write(tmp_path, lines), "rig")
    assert recording.columns["arc_deg"].tolist() == [82, 82, 82, 40, 40, 40]
    assert recording.columns["initial_tension_N"].tolist() == [270] * 6


# --- dialects, names and units ---------------------------------------------------------------


@pytest.mark.parametrize("stated", [True, False])
def test_semicolons_and_decimal_commas(tmp_path, stated):
    lines = [line.replace(",", ";").replace(".", ",") for line in [HEADER, *rows()]]
    dialect: dict[str, object] = {"separator": ";", "decimal": ","} if stated else {}
    path = write(tmp_path, lines)
    recording = read_recording(path, "rig", load_config({"dialect": dialect}))
    assert recording.columns["tension_tight_N"].tolist() == [310.5] * 6
    assert len(recording.notes) == (0 if stated else 2)


def test_under_a_decimal_comma_a_point_is_no_decimal_sign(tmp_path):
    lines = [line.replace(",", ";").replace(".", ",") for line in [HEADER, *rows()]]
    lines[4] = lines[4].replace("310,5", "1.310")
    assert problems(write(tmp_path, lines), config={"dialect": {"decimal": ","}}) == [
        'rig.csv:5: tension_tight_N = "1.310", may be 1.310 or 1310: set dialect: {decimal: "."} '
        'or {thousands: "."}'
    ]


def test_tabs_and_what_excel_writes_first(tmp_path):
    lines = ["sep=\t", *(line.replace(",", "\t") for line in [HEADER, *rows()])]
    assert read_recording(write(tmp_path, lines), "rig").n_samples == len(rows())


def test_comments_and_a_preamble_before_the_header(tmp_path):
    lines = ["# rig 3", "# monday", HEADER, *rows()]
    assert read_recording(write(tmp_path, lines), "rig").n_samples == len(rows())
    lines = ["Rig;3", "Operator;NN", "", HEADER, *rows()]
    path = write(tmp_path, lines)
    recording = read_recording(path, "rig")
    assert "header found in line 4" in recording.notes
    stated = read_recording(path, "rig", load_config({"dialect": {"skip_lines": 3}}))
    np.testing.assert_array_equal(stated.columns["time_s"], recording.columns["time_s"])


@pytest.mark.parametrize("sign", [",", ";", "\t", " "])
def test_a_file_without_a_header_is_read_by_stated_names(tmp_path, sign):
    truth = read_recording(write(tmp_path, [HEADER, *rows()]), "rig").columns
    point = "," if sign == ";" else "."
    cells = [line.replace(",", sign).replace(".", point) for line in rows()]
    (found,) = problems(write(tmp_path, cells))
    assert found.startswith("rig.csv:1: ")
    assert all(word in found for word in ("numbers", "8 columns", "dialect: {names:"))
    for before in ([], ["rig 3", "monday"]):
        path = write(tmp_path, [*before, *cells])
        dialect = {"names": HEADER.split(","), "skip_lines": len(before)}
        columns = read_recording(path, "rig", load_config({"dialect": dialect})).columns
        for name, values in truth.items():
            np.testing.assert_array_equal(columns[name], values)
    short = {"dialect": {"names": HEADER.split(",")[:-1]}}
    (found,) = problems(write(tmp_path, cells), config=short)
    assert found.startswith("rig.csv:1: 8 cells")
    assert "7 names" in found


def test_a_sample_that_the_config_calls_the_header_is_not_lost(tmp_path):
    first = dict(zip(HEADER.split(","), rows()[0].split(","), strict=True))
    (found,) = problems(write(tmp_path, rows()), config={"columns": {"rig": first}})
    assert "names" in found


def test_a_row_of_units_converts(tmp_path):
    units = "-,ms,kN,[kN],1/min,°F,rad,N"
    lines = [
        HEADER,
        units,
        "R1,500,0.31,0.15,2,71.6,1.5,270",
        "R1,520,0.31,0.15,2,71.6,1.5,270",
    ]
    path = write(tmp_path, lines)
    columns = read_recording(path, "rig").columns
    assert columns["time_s"][0] == pytest.approx(0.5, rel=1e-14)
    assert columns["tension_slack_N"][0] == pytest.approx(150.0, rel=1e-14)
    assert columns["pulley_speed_rad_s"][0] == pytest.approx(2 * 2 * np.pi / 60, rel=1e-14)
    assert columns["temperature_degC"][0] == pytest.approx(22.0, abs=1e-10)
    assert columns["arc_deg"][0] == pytest.approx(np.degrees(1.5), rel=1e-14)
    write(tmp_path, [lines[0], "-,x,bar,?,a,b,c,d", *lines[2:]])
    assert 'rig.csv:2: time_s = "x", must be a number' in problems(path)


def test_the_header_keeps_its_line_above_a_row_of_units(tmp_path):
    lines = ["", HEADER.replace("time_s", "clock"), "-,s,N,N,rad/s,C,deg,N", *rows()]
    found = problems(write(tmp_path, lines))
    assert found[0] == "rig.csv:2: column time_s is missing"


def test_an_unknown_unit_in_the_row_of_units(tmp_path):
    lines = [HEADER, "-,s,kPa,N,rad/s,C,deg,N", *rows()]
    found = problems(write(tmp_path, lines))
    assert found[0].startswith("rig.csv:2: tension_tight_N is in kPa, must be one of N, mN, daN")


def test_names_and_units_of_the_config(tmp_path):
    header = "test,t,Weg [µm],Kraft"
    path = write(tmp_path, [header, "P1,0,1.5,0.001", "P1,1,80.0,0.25"], "press.csv")
    config = {
        "columns": {
            "press": {"time_s": "t", "displacement_mm": "Weg [µm]", "force_N": "Kraft"},
        },
        "units": {"press": {"displacement_mm": "µm", "force_N": "kN", "time_s": "min"}},
    }
    columns = read_recording(path, "press", load_config(config)).columns
    assert columns["displacement_mm"].tolist() == pytest.approx([0.0015, 0.08], rel=1e-14)
    assert columns["force_N"].tolist() == pytest.approx([1.0, 250.0], rel=1e-14)
    assert columns["time_s"].tolist() == [0.0, 60.0]
    path = write(tmp_path, [header, "P1,0,x,0.001", "P1,1,80.0,0.25"], "press.csv")
    assert problems(path, "press", config) == [
        'press.csv:2: displacement_mm (column "Weg [µm]") = "x", must be a number'
    ]


def test_encodings(tmp_path):
    path = tmp_path / "rig.csv"
    text = "\n".join([HEADER + ",Längskraft", *(r + ",é" for r in rows())])
    path.write_bytes(text.encode("latin-1"))
    assert "not UTF-8, read as latin-1" in read_recording(path, "rig").notes
    stated = read_recording(path, "rig", load_config({"dialect": {"encoding": "latin-1"}}))
    assert stated.notes[-1] == "columns left out: Längskraft"
    path.write_bytes(text.encode("cp850"))  # what is at 0x84 differs from encoding to encoding
    assert problems(path) == [
        "rig.csv:1: byte 0x84 is not UTF-8; if it is of Windows, set dialect: {encoding: cp1252}"
    ]
    path.write_bytes(text.encode("utf-16"))
    assert len(read_recording(path, "rig").columns["time_s"]) == 6


# --- what is wrong ---------------------------------------------------------------------------


def test_all_problems_at_once_in_the_order_of_the_lines(tmp_path):
    lines = [HEADER, *rows(10)]
    lines[2] = lines[2].replace("150.25", "0")
    lines[3] = lines[3].replace("310.5", "abc")
    lines[4] = lines[4].replace("310.5", "inf")
    lines[5] += ",7,8"
    lines[6] = lines[6].rsplit(",", 2)[0]
    lines[7] = lines[7].replace("0.12", "0.01")
    lines[8] = lines[8].replace(",82,", ",40,")
    lines[9] = lines[9].replace("R1", "")
    lines[10] = lines[10].replace("0.18", "")
    assert problems(write(tmp_path, lines)) == [
        "rig.csv:3: tension_slack_N = 0, must be > 0",
        'rig.csv:4: tension_tight_N = "abc", must be a number',
        "rig.csv:5: tension_tight_N = inf, must be > 0",
        "rig.csv:6: 10 cells, must be 8",
        "rig.csv:7: 6 cells, must be 8",
        "rig.csv:8: time_s = 0.01 after 0.06 in run R1, must not go backwards "
        "(is the label used twice?)",
        "rig.csv:9: arc_deg = 40, must stay 82 within run R1 (is the label used twice?)",
        "rig.csv:10: run is empty, it must label the recording",
        "rig.csv:11: time_s is empty, must be finite",
    ]


def test_problems_of_one_kind_are_one_with_a_count(tmp_path):
    lines = [HEADER, *rows(3000, tight="inf")]
    found = problems(write(tmp_path, lines))
    assert found == ["rig.csv:2: tension_tight_N = inf, must be > 0 (2999 more like it)"]
    lines[7] = lines[7].rsplit(",", 1)[0]
    assert problems(write(tmp_path, lines)) == [
        "rig.csv:2: tension_tight_N = inf, must be > 0 (2998 more like it)",
        "rig.csv:8: 7 cells, must be 8",
    ]


def test_interleaved_runs_are_distinguished_by_their_labels(tmp_path):
    one, two = rows(4), rows(4, "R2", arc="40")
    lines = [HEADER, *(line for pair in zip(one, two, strict=True) for line in pair)]
    assert read_recording(write(tmp_path, lines), "rig").columns["run"].tolist() == ["R1", "R2"] * 4


def test_a_label_used_twice_is_seen_by_its_time(tmp_path):
    lines = [HEADER, *rows(5), *rows(5, "R2"), *rows(5)]
    (found,) = problems(write(tmp_path, lines))
    assert found.startswith("rig.csv:12: time_s = 0 after 0.08 in run R1, must not go backwards")


def test_a_missing_column_is_named_with_what_was_found(tmp_path):
    lines = [HEADER.replace("tension_tight_N", "tension_tigth_N"), *rows()]
    found = problems(write(tmp_path, lines))
    assert found[0] == (
        "rig.csv:1: column tension_tight_N is missing, did you mean tension_tigth_N?"
    )
    assert "run, time_s, tension_tigth_N" in found[1]
    assert 'columns: {rig: {tension_tight_N: "tension_tigth_N"}}' in found[1]


def test_a_recording_of_another_bench_is_recognised():
    assert problems(RIGDATA / "5pk" / "rig.csv", "press") == [
        "rig.csv:1: these are the columns of a recording of the friction rig, not of the "
        "compression press; in a config its key is data.rig",
    ]
    assert problems(RIGDATA / "5pk" / "press.csv") == [
        "press.csv:1: these are the columns of a recording of the compression press, not of the "
        "friction rig; in a config its key is data.press",
    ]


def test_a_recording_of_another_bench_is_recognised_by_the_words_of_its_laboratory(tmp_path):
    lines = ["Versuch;Zeit [s];Kraft [N];Weg [mm]", "1;0;0;0", "1;1;5;0.1"]
    (found,) = problems(write(tmp_path, lines))
    assert "these are the columns of a recording of the compression press" in found
    lines = ["run,time_s,tension_slack_N,pulley_speed_rad_s,arc_deg,weight_N", "1,0,5,0,180,5"]
    (found,) = problems(write(tmp_path, lines), "press")
    assert "these are the columns of a recording of the friction rig" in found


def test_a_column_named_by_the_config_must_be_there(tmp_path):
    config = {"columns": {"rig": {"temperature_degC": "T_belt"}}}
    found = problems(write(tmp_path, [HEADER, *rows()]), config=config)
    assert "column T_belt (which the config names for temperature_degC) is missing" in found[0]


def test_a_header_that_stands_twice(tmp_path):
    lines = [HEADER + ",time_s", *(r + ",0" for r in rows())]
    assert problems(write(tmp_path, lines)) == [
        "rig.csv:1: time_s #1, time_s #2 can be time_s, say which: "
        'columns: {rig: {time_s: "time_s #1"}}'
    ]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "the file is empty"),
        (b"\n\n \n", "holds no header"),
        (HEADER.encode() + b"\n", "holds no samples, only a header in line 1"),
        (b"PK\x03\x04" + b"\0" * 50, "the zip file is damaged or cut off"),
        (b"\x7fELF\0\0\0", "cannot be read"),
        (b"PAR1" + b"\0" * 50, "damaged"),
        (b"PAR1", "damaged"),
        (b"hello", "holds no samples"),
        (b"a\nb\nc", "column time_s is missing"),
        (",".join(f"c{i}" for i in range(5000)).encode(), "5000 columns, must be at most 2000"),
        (b'"' * 200_001 + b"\n1", "rig.csv"),
    ],
)
def test_files_that_are_no_recording(tmp_path, content, words):
    path = tmp_path / "rig.csv"
    path.write_bytes(content)
    assert any(words in p for p in problems(path))


def test_what_is_not_a_file(tmp_path):
    assert problems(tmp_path / "rig.csv") == ["rig.csv: there is no such file"]
    (tmp_path / "folder.csv").mkdir()
    assert problems(tmp_path / "folder.csv") == ["folder.csv: holds no recording"]


def test_a_column_without_any_number(tmp_path):
    assert problems(write(tmp_path, [HEADER, *rows(tight="")])) == [
        "rig.csv: tension_tight_N holds no numbers"
    ]


@pytest.mark.parametrize(
    ("kind", "column", "factor", "unit"),
    [
        ("rig", "tension_tight_N", 1e-3, "kN"),
        ("rig", "tension_slack_N", 1e3, "mN"),
        ("rig", "arc_deg", np.pi / 180, "rad"),
        ("press", "displacement_mm", 1e3, "um"),
        ("press", "force_N", 1e-3, "kN"),
        ("speedloss", "torque_N_m", 1e-3, "kN m"),
    ],
)
def test_a_unit_that_is_not_plausible_is_suggested(tmp_path, kind, column, factor, unit):
    frame = pd.read_csv(RIGDATA / "5pk" / f"{kind}.csv")
    right = frame[column].to_numpy(dtype=float)
    frame[column] = right * factor
    path = tmp_path / f"{kind}.csv"
    frame.to_csv(path, index=False)
    (found,) = problems(path, kind)
    setting = {"units": {kind: {column: unit}}}
    assert f"units: {{{kind}: {{{column}: {unit}}}}}" in found
    columns = read_recording(path, kind, load_config(setting)).columns
    np.testing.assert_allclose(columns[column], right, rtol=1e-12, atol=1e-12)


def test_a_stated_unit_is_believed(tmp_path):
    path = write(tmp_path, [HEADER, *rows(arc="5")])
    assert "rad" in problems(path)[0]
    config = load_config({"units": {"rig": {"arc_deg": "deg"}}})
    assert read_recording(path, "rig", config).columns["arc_deg"][0] == 5.0


# --- in memory -------------------------------------------------------------------------------


def test_frames_tables_and_dicts_alike(tmp_path):
    path = write(tmp_path, [HEADER, *rows(3), *rows(3, "7")])
    recording = read_recording(path, "rig")
    frame = pd.read_csv(path)
    for table in (frame, frame.to_dict("list"), pa.Table.from_pandas(frame), recording):
        columns = columns_of(table, "rig")
        assert list(columns) == list(recording.columns)
        for name, values in recording.columns.items():
            np.testing.assert_array_equal(columns[name], values)


def test_the_frame_itself_is_not_changed():
    frame = pd.read_csv(RIGDATA / "5pk" / "rig.csv", nrows=50)
    frame.loc[3, "arc_deg"] = np.nan
    before = frame.copy()
    columns = columns_of(frame, "rig", load_config({"units": {"rig": {"tension_tight_N": "daN"}}}))
    columns["time_s"][:] = 0.0
    pd.testing.assert_frame_equal(frame, before)


def test_what_was_read_with_a_config_is_not_renamed_and_converted_again(tmp_path):
    """`read_rig` gives our columns in our units; a part of its frame is taken with the config."""
    frame = pd.read_csv(RIGDATA / "5pk" / "rig.csv", nrows=50, dtype={"run": str})
    theirs = frame.assign(F1=frame["tension_tight_N"] / 10).drop(columns="tension_tight_N")
    theirs.to_csv(tmp_path / "rig.csv", index=False)
    config = load_config(
        {
            "columns": {"rig": {"tension_tight_N": "F1"}},
            "units": {"rig": {"tension_tight_N": "daN"}},
        }
    )
    read = beltid.read_rig(tmp_path / "rig.csv", config)
    for part in (
        read,
        read[read["time_s"] > 0.1],
        read_recording(tmp_path / "rig.csv", "rig", config),
    ):
        columns = columns_of(part, "rig", config)
        tight = frame["tension_tight_N"].iloc[-len(columns["run"]) :]
        np.testing.assert_allclose(columns["tension_tight_N"], tight, rtol=1e-12)


def test_the_unit_in_a_name_that_the_config_states_is_that_of_the_frame():
    frame = pd.read_csv(RIGDATA / "5pk" / "rig.csv", nrows=50)
    known = load_config({"columns": {"rig": {"tension_slack_N": "Leertrum [daN]"}}})
    written = frame.assign(**{"Leertrum [daN]": frame["tension_slack_N"] / 10})
    columns = columns_of(written.drop(columns="tension_slack_N"), "rig", known)
    np.testing.assert_allclose(columns["tension_slack_N"], frame["tension_slack_N"], rtol=1e-12)
    known = load_config({"columns": {"rig": {"tension_slack_N": "Leertrum [mm]"}}})
    with pytest.raises(InputError, match="is in mm, must be one of N, "):
        columns_of(written.rename(columns={"Leertrum [daN]": "Leertrum [mm]"}), "rig", known)


@pytest.mark.parametrize("packed", [False, True])
def test_truths_say_whether_the_pulley_was_idle(tmp_path, packed):
    frame = pd.read_csv(RIGDATA / "5pk" / "rig.csv", nrows=50, dtype={"run": str})
    frame = frame.assign(torque_N_m=1.0, idle=True)
    config = load_config({"rig": {"kind": "torque"}})
    frame.to_parquet(tmp_path / "rig.parquet")
    columns = (
        read_recording(tmp_path / "rig.parquet", "rig", config).columns
        if packed
        else columns_of(frame, "rig", config)
    )
    assert set(columns["idle"]) == {"true"}


def test_what_is_no_list_among_the_columns_of_a_mapping_is_left_out():
    frame = pd.read_csv(RIGDATA / "5pk" / "rig.csv", nrows=50, dtype={"run": str})
    more = {
        "note": "monday",
        "matrix": np.zeros((50, 2)),
        "zeros": [0.0, 0.0],
        "z": frame["time_s"] + 1j,
    }
    columns = columns_of({**frame.to_dict("list"), **more}, "rig")
    np.testing.assert_array_equal(columns["time_s"], frame["time_s"])


def test_whole_numbers_label_runs_without_a_point():
    frame = pd.read_csv(RIGDATA / "5pk" / "rig.csv", nrows=3).assign(run=[1.0, 1.0, 2.0])
    assert columns_of(frame, "rig")["run"].tolist() == ["1", "1", "2"]
    numbered = {name: str(k) for k, name in enumerate(frame.columns)}
    frame.columns = range(frame.shape[1])  # as a table without a header is read
    known = load_config({"columns": {"rig": numbered}})
    assert columns_of(frame, "rig", known)["run"].tolist() == ["1", "1", "2"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: f.drop(columns="time_s"), "column time_s is missing"),
        (lambda f: f.set_index("run"), "column run is missing"),
        (lambda f: f.assign(tension_tight_N=-1.0), "frame, row 1: tension_tight_N = -1, must be"),
        (
            lambda f: f.assign(tension_tight_N="x"),
            "column tension_tight_N holds texts, must hold numbers",
        ),
        (lambda f: f.iloc[:0], "holds no samples"),
        (lambda f: 5, "must be a DataFrame"),
        (lambda f: {"run": ["a"], "time_s": [1.0, 2.0]}, "different lengths"),
        (lambda f: {**f.to_dict("list"), "time_s": 5.0}, "must be a list"),
        (lambda f: f.assign(run=None), "run is empty"),
    ],
)
def test_what_is_wrong_with_a_frame(change, words):
    frame = pd.read_csv(RIGDATA / "5pk" / "rig.csv", nrows=5)
    with pytest.raises(InputError) as caught:
        columns_of(change(frame), "rig")
    assert any(words in p for p in caught.value.problems)


def test_a_parquet_file_of_the_bench(tmp_path):
    frame = pd.read_csv(RIGDATA / "5pk" / "rig.csv", nrows=500)
    path = tmp_path / "rig.parquet"
    frame.to_parquet(path)
    columns = read_recording(path, "rig").columns
    np.testing.assert_array_equal(columns["tension_tight_N"], frame["tension_tight_N"])
    frame.loc[0, "tension_tight_N"] = -1.0
    frame.to_parquet(path)
    assert problems(path)[0] == "rig.parquet, row 1: tension_tight_N = -1, must be > 0"


def test_a_parquet_file_of_one_run_takes_its_settings_from_the_config(tmp_path):
    """As a CSV file does: without a column of labels it is one run, called like the file."""
    frame = pd.read_csv(RIGDATA / "5pk" / "rig.csv", nrows=9)
    stated = {"arc_deg": 61.5, "initial_tension_N": 133.0}
    config = load_config({"runs": {"rig": {"values": stated}}})
    frame = frame.drop(columns=["run", "arc_deg", "initial_tension_N"])
    for one in (frame, frame.assign(arc_deg=40.0)):  # what the config states holds
        one.to_parquet(tmp_path / "R7.parquet")
        one.to_csv(tmp_path / "R7.csv", index=False)
        for ending in ("parquet", "csv"):
            columns = read_recording(tmp_path / f"R7.{ending}", "rig", config).columns
            assert set(columns["run"]) == {"R7"}
            assert {name: set(columns[name]) for name in stated} == {
                name: {value} for name, value in stated.items()
            }


def parquet_runs(folder, n=2):
    """A Parquet file for each of the first runs, named by label and settings; its samples."""
    frame = pd.read_csv(RIGDATA / "5pk" / "rig.csv", dtype={"run": str})
    runs = [frame[frame["run"] == label] for label in frame["run"].unique()[:n]]
    settings = ["run", "arc_deg", "initial_tension_N"]
    for run in runs:
        name = "{}_{}deg_{}N.parquet".format(*run[settings].iloc[0])
        run.drop(columns=settings).to_parquet(folder / name, index=False)
    return pd.concat(runs)


@pytest.mark.parametrize("told_by", ["pattern", "table"])
def test_names_of_parquet_files_and_a_table_tell_the_settings(tmp_path, told_by):
    folder = tmp_path / "runs"
    folder.mkdir()
    frame = parquet_runs(folder)
    lines = ["file,run,arc_deg,initial_tension_N"]
    for file in folder.iterdir():
        run, arc, tension = file.stem.split("_")
        lines.append(f"{file.name},{run},{arc[:-3]},{tension[:-1]}")
    (tmp_path / "runs.csv").write_text("\n".join(lines) + "\n")
    told = {
        "pattern": "{run}_{arc_deg}deg_{initial_tension_N}N.parquet",
        "table": str(tmp_path / "runs.csv"),
    }
    config = load_config({"runs": {"rig": {told_by: told[told_by]}}})
    columns = read_recording(folder, "rig", config).columns
    for name in ("run", "arc_deg", "initial_tension_N", "time_s", "tension_slack_N"):
        np.testing.assert_array_equal(columns[name], frame[name])
    first = next(folder.iterdir())
    first.rename(folder / "other.parquet")
    with pytest.raises(InputError, match=r"other\.parquet"):
        read_recording(folder, "rig", config)


def test_parquet_columns_are_found_and_converted_as_those_of_a_text_file(tmp_path):
    frame = pd.read_csv(RIGDATA / "5pk" / "rig.csv", nrows=300, dtype={"run": str})
    written = frame.assign(condition="dry", tension_slack_N=frame["tension_slack_N"] / 10)
    written = written.rename(columns={"tension_slack_N": "Leertrum [daN]"})
    path = tmp_path / "rig.parquet"
    written.to_parquet(path, index=False)
    config = load_config({"columns": {"rig": {"tension_slack_N": "Leertrum [daN]"}}})
    for known in (None, config):
        recording = read_recording(path, "rig", known)
        slack = recording.columns["tension_slack_N"]
        np.testing.assert_allclose(slack, frame["tension_slack_N"], rtol=1e-12)
        assert set(recording.columns["condition"]) == {"dry"}
        (run,) = list(open_big(path, known))
        np.testing.assert_array_equal(run.columns["tension_slack_N"], slack)
        assert run.texts == {"condition": "dry"}


def test_parts_of_a_parquet_table_in_several_units(tmp_path):
    frame = pd.read_csv(RIGDATA / "5pk" / "rig.csv", nrows=300, dtype={"run": str})
    halves = {"a": frame[:150], "b": frame[150:]}
    halves["b"] = halves["b"].assign(time_ms=1000 * frame["time_s"]).drop(columns="time_s")
    for name, half in halves.items():
        half.to_parquet(tmp_path / f"{name}.parquet", index=False)
    columns = read_recording(tmp_path, "rig").columns
    np.testing.assert_allclose(columns["time_s"], frame["time_s"], rtol=0, atol=1e-12)
    with pytest.raises(
        InputError, match=r"b\.parquet: time_s .*a different unit than in the first"
    ):
        list(open_big(tmp_path))


def test_a_few_samples_tell_nothing_of_their_unit(tmp_path):
    """Five rows of a belt at rest, in newton, are not taken for kilonewton."""
    lines = ["test,time_s,displacement_mm,force_N", *(f"P,{i},0.00{i},-0.09" for i in range(5))]
    recording = read_recording(write(tmp_path, lines, "press.csv"), "press")
    assert recording.columns["force_N"].tolist() == [-0.09] * 5


def test_no_thread_of_arrow_holds_what_belongs_to_python():
    """At the end of the program it would have to wait for the interpreter, and be aborted."""
    let_go_by = set()

    class Body(bytes):
        def __del__(self):
            let_go_by.add(threading.get_ident())

    found = layout("run,time_s\nA,1\n", "rig.csv", DialectSection(), ["run"])
    wanted = {"time_s": Wanted(1, False, "time_s")}
    for _ in range(200):
        read_rows(replace(found, body=Body(b"A,1\n")), wanted, "rig.csv")
    assert let_go_by == {threading.get_ident()}


@pytest.mark.parametrize("name", ["rig.csv", "rig.csv.gz", "rig.parquet", "rig.zip"])
def test_a_recording_is_opened_once(tmp_path, name):
    path = tmp_path / name
    frame = pd.read_csv(RIGDATA / "5pk" / "rig.csv", nrows=500)
    if name.endswith(".parquet"):
        frame.to_parquet(path, index=False)
    else:
        frame.to_csv(path, index=False)
    opened = []
    sys.addaudithook(
        lambda event, given: (
            opened.append(given) if event == "open" and given[0] == str(path) else 0
        )
    )
    read_rig(path)
    assert len(opened) == 1
