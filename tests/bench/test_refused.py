"""Files without a header, and files that are refused for their size."""

from __future__ import annotations

import gzip
import zipfile

import numpy as np
import pytest

from beltid.bench.recording import read_recording
from beltid.config import load_config
from beltid.errors import InputError


def test_a_million_columns_are_refused(tmp_path):
    path = tmp_path / "rig.csv"
    path.write_text(",".join(f"c{i}" for i in range(1_000_000)) + "\n" + "1," * 999_999 + "1\n")
    with pytest.raises(InputError, match=r"rig\.csv:1: 1000000 columns, must be at most 2000"):
        read_recording(path, "rig")


def test_packed_bombs_are_refused_by_a_limit(tmp_path, monkeypatch):
    monkeypatch.setattr("beltid.bench.packed.MAX_BYTES", 1 << 20)
    with zipfile.ZipFile(tmp_path / "rig.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("R001.csv", b"0" * (8 << 20))
    (tmp_path / "rig.csv.gz").write_bytes(gzip.compress(b"0" * (8 << 20)))
    for name in ("rig.zip", "rig.csv.gz"):
        with pytest.raises(InputError, match="unpacks to more than"):
            read_recording(tmp_path / name, "rig")


def test_names_of_a_file_without_a_header(tmp_path):
    path = tmp_path / "P.csv"
    path.write_text("".join(f"{i};0,{i:02d};{50 + i}\n" for i in range(20)))
    config = load_config({"dialect": {"names": ["time_s", "displacement_mm", "force_N"]}})
    columns = read_recording(path, "press", config).columns
    np.testing.assert_array_equal(columns["force_N"], np.arange(50.0, 70.0))
    np.testing.assert_array_equal(columns["time_s"], np.arange(20.0))


def test_a_column_of_the_config_may_be_a_field_of_the_head(tmp_path):
    path = tmp_path / "rig.csv"
    rows = (f"R1;{i};100,5;90;0,2;270\n" for i in range(20))
    head = "Winkel;82;°\n\nrun;time_s;tension_tight_N;tension_slack_N;pulley_speed_rad_s;"
    path.write_text(head + "initial_tension_N\n" + "".join(rows))
    config = load_config({"columns": {"rig": {"arc_deg": "Winkel"}}})
    assert set(read_recording(path, "rig", config).columns["arc_deg"]) == {82.0}
