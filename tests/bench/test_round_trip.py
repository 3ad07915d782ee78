"""A file written by a format's own library is read as the numbers that were put into it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import writers

from beltid.bench.inspection import inspect_recording
from beltid.bench.recording import read_recording
from beltid.config import load_config
from beltid.errors import InputError

EXACT = {"tdms", "mat5", "mat73", "xlsx", "zip", "gzip"}
"""Formats that keep the numbers as they are; the others convert units, to the last digits."""


def compare(columns: dict[str, np.ndarray], expected: pd.DataFrame, tolerance: float) -> None:
    for name, values in columns.items():
        if values.dtype == object:
            continue
        wanted = expected[name].to_numpy(dtype=float)
        np.testing.assert_allclose(values, wanted, rtol=tolerance, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("name", [n for n in writers.RIG if not n.startswith(("mf4", "mdf3"))])
def test_every_format_gives_the_recording_of_the_tidy_file(tmp_path, name):
    recording = read_recording(writers.RIG[name](tmp_path), "rig")
    runs = writers.rig_runs()
    assert list(dict.fromkeys(recording.columns["run"])) == list(runs)
    expected = pd.concat(runs.values())
    compare(recording.columns, expected, 0.0 if name in EXACT - {"tdms"} else 1e-12)


@pytest.mark.parametrize("name", ["mf4", pytest.param("mdf3", marks=pytest.mark.long)])
def test_the_rasters_of_an_mdf_file_are_aligned(tmp_path, name):
    recording = read_recording(writers.RIG[name](tmp_path), "rig")
    run = writers.rig_runs(1)["R001"]
    sensors = ("tension_tight_N", "tension_slack_N", "pulley_speed_rad_s", "time_s", "arc_deg")
    for column in sensors:
        np.testing.assert_array_equal(recording.columns[column], run[column])
    slow = run["temperature_degC"].to_numpy()[::10]
    found = recording.columns["temperature_degC"]
    np.testing.assert_allclose(found[: 10 * len(slow)][::10], slow, rtol=1e-12)
    # straight between two slow samples, nothing beyond the last one
    assert found[5] == pytest.approx((slow[0] + slow[1]) / 2, rel=1e-12)
    assert np.isnan(found[10 * (len(slow) - 1) + 1 :]).all()
    assert any(
        "interpolated linearly to the times of tension_tight_N" in n for n in recording.notes
    )


@pytest.mark.parametrize("x_columns", ["No", "One", "Multi"])
@pytest.mark.parametrize("decimal", [",", "."])
def test_labview(tmp_path, x_columns, decimal):
    run = writers.rig_runs(1)["R001"]
    writers.write_lvm(tmp_path / "R001.lvm", run, x_columns=x_columns, decimal=decimal)
    config = load_config({"runs": {"rig": {"values": {"arc_deg": 40, "initial_tension_N": 50}}}})
    recording = read_recording(tmp_path / "R001.lvm", "rig", config)
    compare(recording.columns, run, 1e-12)
    assert set(recording.columns["run"]) == {"R001"}
    assert "read Trumkraft Zugtrum [N] as tension_tight_N" in recording.notes


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_zwick(tmp_path, encoding):
    test = writers.press_tests()["P22"]
    recording = read_recording(writers.write_zwick(tmp_path / "P22.txt", test, encoding), "press")
    for column in ("time_s", "force_N", "displacement_mm"):
        np.testing.assert_array_equal(recording.columns[column], test[column])
    # the header tells one temperature
    mean = test["temperature_degC"].mean()
    np.testing.assert_allclose(recording.columns["temperature_degC"], mean, rtol=1e-12)


def test_zwick_tra(tmp_path):
    test = writers.press_tests()["P22"]
    recording = read_recording(writers.write_tra(tmp_path / "P22.tra", test), "press")
    compare(recording.columns, test, 1e-12)
    assert set(recording.columns["test"]) == {"P22"}


DATA = Path(__file__).parent / "data"


def test_the_sample_of_zwick():
    path = DATA / "zwick-testxpert-export.txt"
    (view,) = inspect_recording(path, load_config(), "press").files
    shown = {c.candidate.name: (c.candidate.unit, c.n_samples, c.first) for c in view.channels}
    assert view.format == "Zwick testXpert text"
    assert shown["Standardkraft"] == ("N", 38, 0.576537916)
    assert shown["Breitenänderung"] == ("mm", 38, 0.950183725)
    fields = {field.name: (field.text, field.unit) for field in view.fields}
    assert fields["Temperatur"] == ("22", "°C")
    assert fields["Messlänge Standardweg"] == ("80", "mm")
    # crosshead or gauge: both are travel, so neither is taken
    with pytest.raises(InputError, match=r"Traversenweg absolut \[mm\], Standardweg \[mm\] can be"):
        read_recording(DATA / "zwick-testxpert-export.txt", "press")


def test_the_sample_of_labview():
    path = DATA / "labview-two-channels.lvm"
    (view,) = inspect_recording(path, load_config(), "press").files
    first, second = view.channels
    assert (first.candidate.name, first.candidate.unit) == ("Excitation (Trigger)", "Newtons")
    assert second.candidate.unit == "m/s^2"
    assert (first.n_samples, first.first, second.high) == (10, 0.914018, 1.222088)
    assert first.rate_Hz == pytest.approx(1 / 3.90625e-5, rel=1e-9)
