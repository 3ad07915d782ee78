"""Layouts that one format can have: structs, segments, stamps, sheets; what is too large."""

import gzip
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from golden import files_written as w

import beltid
from beltid.bench.recording import Recording, read_recording
from beltid.config import Config, load_config
from beltid.errors import InputError

CELLS = w.CELLS[1:]


def tdms(path: Path, channels: dict[str, tuple[np.ndarray, str]], **waveform: object) -> None:
    """Write a TDMS file: channels with their units, all with the properties of a waveform."""
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path, "a" if path.exists() else "w") as writer:
        for name, (values, unit) in channels.items():
            about = {"unit_string": unit, **{f"wf_{key}": said for key, said in waveform.items()}}
            writer.write_segment([ChannelObject("rig", name, values, properties=about)])


def settings(arc_deg: float, initial_tension_N: float) -> Config:
    values = {"arc_deg": arc_deg, "initial_tension_N": initial_tension_N}
    return load_config({"runs": {"rig": {"values": values}}})


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_an_array_of_structs_is_refused_by_name(tmp_path, version):
    import h5py
    from scipy.io import savemat

    path = tmp_path / "rig.mat"
    if version == "5":
        runs = np.zeros((3,), dtype=[("t", "O")])
        runs["t"] = [w.R001["time_s"]] * 3
        savemat(path, {"runs": runs})
    else:
        with h5py.File(path, "w", userblock_size=512) as file:
            cells = file.create_dataset("runs", (3, 1), dtype=h5py.ref_dtype)
            cells[0, 0] = file.create_dataset(
                "#refs#/a", data=w.R001["time_s"].to_numpy()[None, :]
            ).ref
        with path.open("r+b") as stream:
            stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM")
    with pytest.raises(InputError, match="runs left out"):
        read_recording(path, "rig")


def test_variables_of_matlab(tmp_path):
    from scipy.io import savemat

    test, named = w.PRESS, {"force_N": "Kraft", "displacement_mm": "Weg"}
    time, force, travel = (test[c].to_numpy() for c in ("time_s", "force_N", "displacement_mm"))
    plain = {"Zeit": time, "Kraft": force / 1000, "Weg": travel}
    # the names that a config states do not hide the units that the file does
    units = {"units": {"Zeit": "s", "Kraft": "kN", "Weg": "mm"}}
    savemat(tmp_path / "a.mat", {"a": {"b": {**plain, **units}}})
    config = load_config({"columns": {"press": named}})
    columns = read_recording(tmp_path / "a.mat", "press", config).columns
    np.testing.assert_allclose(columns["force_N"], force, rtol=1e-12)
    np.testing.assert_array_equal(columns["time_s"], time)
    savemat(tmp_path / "4.mat", plain, format="4")
    savemat(tmp_path / "data.mat", {"data": test[["time_s", "force_N"]].to_numpy()})
    for name, words in (("4", "if it is no text, export it"), ("data", "data left out")):
        with pytest.raises(InputError, match=words):
            read_recording(tmp_path / f"{name}.mat", "press")


def test_rates_and_starts_of_tdms_channels(tmp_path):
    path, late = tmp_path / "rig.tdms", 0.1
    start = np.datetime64("2026-11-20T09:00:00", "us")
    fast, slow = np.arange(0, 8, 0.01), np.arange(0, 8, 0.02)
    turning = np.where(slow > 2, 30.0, 0.0)
    tdms(path, {"Zugtrum": (300 + fast, "N")}, increment=0.01, start_time=start)
    tdms(path, {"Drehzahl": (turning, "1/min")}, increment=0.02, start_time=start)
    later = start + np.timedelta64(100, "ms")
    tdms(path, {"Leertrum": (200 + slow + late, "N")}, increment=0.02, start_time=later)
    columns = read_recording(path, "rig", settings(82, 300)).columns
    assert columns["time_s"][0] == pytest.approx(late, abs=1e-9)
    # both rise with the time: equal but for their offset wherever both were recorded
    np.testing.assert_allclose(columns["tension_tight_N"] - columns["tension_slack_N"], 100.0)


@pytest.mark.parametrize("kind", ["lvm, one", "lvm, no", "tdms", "mdf", "mdf, furlong"])
def test_the_unit_in_which_a_format_tells_the_time(tmp_path, kind):
    """Formats have a place for it; a time in milliseconds is none in seconds."""
    run, path = w.R001, tmp_path / "R001"
    told = run.assign(time_s=1000 * run["time_s"])
    channels = {name: (run[name].to_numpy(dtype=float), w.UNITS[name]) for name in CELLS}
    if kind == "tdms":
        tdms(path, channels, increment=float(told["time_s"][1]), xunit_string="ms")
    elif kind.startswith("mdf"):
        from asammdf import MDF, Signal

        file, time = MDF(version="4.10"), told["time_s"].to_numpy()
        file.append([Signal(x, time, unit=unit, name=n) for n, (x, unit) in channels.items()])
        unit = "furlong" if "furlong" in kind else "ms"
        file.groups[0].channels[file.masters_db[0]].unit = unit
        path = file.save(path.with_suffix(".mf4"))
        file.close()
    else:
        told_so = "X_Unit_Label" + "\tms" * 3 + "\r\nX0\t"
        path.write_text(w.lvm(told, x=kind.split()[1].title()).replace("X0\t", told_so))
    if "furlong" in kind:
        with pytest.raises(InputError, match=r"time .*in furlong"):
            read_recording(path, "rig", settings(40, 50))
    else:
        columns = read_recording(path, "rig", settings(40, 50)).columns
        np.testing.assert_allclose(columns["time_s"], run["time_s"], rtol=0, atol=1e-9)


def test_hidden_sheets_are_left_out_and_a_word_among_numbers_has_a_place(tmp_path):
    from openpyxl import load_workbook

    path = tmp_path / "press.xlsx"
    rows = [["Zeit [s]", "Weg [mm]", "Kraft [N]"], *([i, 0.1 * i, 5.0 * i] for i in range(8))]
    w.workbook(path, {"A": rows, "B": rows})
    assert read_recording(path, "press").columns["test"].tolist() == ["A"] * 8 + ["B"] * 8
    book = load_workbook(path)
    book["A"].sheet_state = "hidden"
    book.save(path)
    recording = read_recording(path, "press")
    assert len(recording.columns["test"]) == 8
    assert any("sheet A left out" in note for note in recording.notes)
    book["B"]["C5"] = "overload"
    book.save(path)
    with pytest.raises(InputError, match=r'press\.xlsx:5: force_N .* = "overload", must be a'):
        read_recording(path, "press")


@pytest.mark.parametrize("apart", ["\t\t", "\t"])
def test_every_channel_of_a_labview_measurement_has_its_unit_above_it(tmp_path, apart):
    """Times beside each channel leave a blank between the cells of the head."""
    path, told = tmp_path / "press.lvm", {"Samples": "9 9 9", "Y_Unit_Label": "mm kN N"}
    head = ["LabVIEW Measurement", "X_Columns\tMulti", "***End_of_Header***", "", "Channels\t3"]
    head += [f"{key}\t{cells.replace(' ', apart)}" for key, cells in told.items()]
    head += ["***End_of_Header***", "\t".join(["X_Value\t" + n for n in ("Weg", "Rest", "Kraft")])]
    rows = ["\t".join([f"{0.1 * i:.1f}\t{i * by}" for by in (0.1, 1, 10)]) for i in range(9)]
    path.write_text("\n".join([*head, *rows, ""]))
    force = read_recording(path, "press").columns["force_N"]
    np.testing.assert_array_equal(force, 10.0 * np.arange(9))
    path.write_text(path.read_text().replace(f"9{apart}9\n", f"9{apart}10\n"))
    with pytest.raises(InputError, match="Kraft has 9 samples, its header states 10"):
        read_recording(path, "press")


@pytest.mark.parametrize("told", [{"Slope": 0.02, "offset": -1.0}, {"Slope": 1.0, "serial": 7.0}])
def test_whole_numbers_are_read_once_the_config_says_what_they_are(tmp_path, told):
    counts = (50 * w.PRESS["force_N"].to_numpy()).astype(np.int16)
    w.hdf5(tmp_path / "P.h5", 50, **told)
    scalings = [({"factor": 0.02, "offset": -1}, 0.02 * counts - 1), ("N", counts)]
    for units, expected in scalings if told["Slope"] != 1.0 else [({}, counts)]:
        config = load_config({"units": {"press": {"force_N": units}}} if units else {})
        force = read_recording(tmp_path / "P.h5", "press", config).columns["force_N"]
        np.testing.assert_allclose(force, expected, rtol=0, atol=1e-12)


# --- universal files -----------------------------------------------------------------------------

DATA = Path(__file__).parent / "data"
N = 50
TIME = np.arange(N) * 0.02
FORCE = np.round(100 * np.sin(3 * TIME) ** 2 + 950 * TIME, 3)
TRAVEL = np.round(0.5 * TIME + 0.01 * np.sin(TIME), 5)
UNEVEN = np.round(TIME + 0.003 * np.sin(np.arange(N)), 5)


def check(recording: Recording, digits: float) -> None:
    """The force at its own times; the travel, uneven in time, brought to them."""
    time = recording.columns["time_s"]
    force, travel = recording.columns["force_N"], recording.columns["displacement_mm"]
    np.testing.assert_allclose(force, np.interp(time, TIME, FORCE), rtol=digits, atol=1e-9)
    np.testing.assert_allclose(travel, np.interp(time, UNEVEN, TRAVEL), rtol=digits, atol=1e-9)
    assert len(time) >= N - 2
    assert "read Kraft [N] as force_N" in recording.notes


PYUFF = {"single": 1e-5, "double": 1e-11, "binary": 1e-12}


@pytest.mark.parametrize(("kind", "digits"), PYUFF.items())
def test_files_that_pyuff_wrote(kind, digits):
    check(read_recording(DATA / f"uff58-{kind}.unv", "press"), digits)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d[:-8], r"P1.unv: damaged: the last dataset"),
        (lambda d: d[: len(d) // 4] + d[len(d) // 4 + 4 :], "damaged"),
        (lambda d: d.replace(b"       200", b"       201"), "200 samples found, the header"),
        (lambda d: d.replace(b"        17", b"        18"), "no dataset 58"),
        (lambda d: d.replace(b"         4       200", b"         6       200"), "no dataset 58"),
        (lambda d: b"    -1\n   151\nmodel\n    -1\n", "no dataset 58"),
    ],
)  # fmt: skip
def test_what_is_damaged_or_not_read_is_reported(tmp_path, change, words):
    path = tmp_path / "P1.unv"
    path.write_bytes(change(w.uff(even=True)))
    with pytest.raises(InputError, match=words):
        read_recording(path, "press")


# --- size ----------------------------------------------------------------------------------------


def test_a_million_columns_are_refused(tmp_path):
    path = tmp_path / "rig.csv"
    path.write_text(",".join(f"c{i}" for i in range(1_000_000)) + "\n" + "1," * 999_999 + "1\n")
    with pytest.raises(InputError, match=r"rig\.csv:1: 1000000 columns, must be at most 2000"):
        read_recording(path, "rig")


def test_packed_bombs_are_refused_by_a_limit(tmp_path, monkeypatch):
    monkeypatch.setattr("beltid.bench.files.MAX_BYTES", 1 << 20)
    with zipfile.ZipFile(tmp_path / "rig.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("R001.csv", b"0" * (8 << 20))
    (tmp_path / "rig.csv.gz").write_bytes(gzip.compress(b"0" * (8 << 20)))
    for name in ("rig.zip", "rig.csv.gz"):
        with pytest.raises(InputError, match="unpacks to more than"):
            read_recording(tmp_path / name, "rig")


def test_pieces_of_a_text_are_read_as_the_whole(tmp_path, monkeypatch):
    """With remarks and quotation marks anywhere; a frame that was read can be written to."""
    path, lines = tmp_path / "rig.csv", w.table(w.RIG, quote='"').splitlines(keepends=True)
    path.write_text("".join([*lines[:99], "\n# cycle 2\n\n", *lines[99:]]))
    whole = beltid.read_rig(path)
    monkeypatch.setattr("beltid.bench.cells.BLOCK", 97)
    frame = beltid.read_rig(path)
    pd.testing.assert_frame_equal(frame, whole, check_exact=True)
    frame.loc[3, "time_s"] = -1.0
    assert frame["time_s"][3] == -1.0
    path.write_text("".join([*lines[:300], '"R1,2\n', *lines[300:]]))
    with pytest.raises(InputError, match="quotation marks"):
        beltid.read_rig(path)
