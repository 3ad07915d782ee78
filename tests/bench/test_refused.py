"""Files without a header, and files that are refused for their size."""

from __future__ import annotations

import gzip
import zipfile

import pytest

from beltid.bench.recording import read_recording
from beltid.errors import InputError


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
