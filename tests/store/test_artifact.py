"""Artifacts say what they are, are the same bytes for the same content, and show any damage."""

import random
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from beltid.errors import ArtifactError
from beltid.store.artifact import (
    EARLIER_KEY,
    RECORD_KEY,
    Record,
    artifact_bytes,
    artifact_from_bytes,
    read_artifact,
    write_artifact,
)

COLUMNS = {
    "temperature_degC": np.array([22.0, np.nan]),
    "k_linear_N_m2": np.array([6.5e7, 6.4999999999999e7]),
    "k_quadratic_N_m3": np.array([3.0e11, 1 / 3 * 1e12]),
    "k_linear_se_N_m2": np.array([np.nan, 1.0]),
    "k_quadratic_se_N_m3": np.array([1e7, 2e7]),
    "covariance": [None, np.array([1.0, 2.0, 2.0, 5.0])],
    "contact_offset_mm": np.array([0.0, -0.1]),
    "rms_residual_N_m": np.array([1.0, 2.0]),
    "hysteresis_ratio": np.array([0.1, 0.2]),
    "max_penetration_m": np.array([1e-4, 1e-4]),
    "max_force_N_m": np.array([1e4, 1e4]),
    "n_samples": np.array([100, 200]),
    "notes": np.array([None, "µ"], dtype=object),
}
RECORD = Record(
    "stiffness",
    made_by="fit-stiffness",
    origin="synthetic",
    facts={"k_linear_N_m2": np.float64(6.5e7), "supported": np.True_, "unknown": np.nan},
    tables={"budget": [{"source": "µ", "percent": 1.5}]},
    validity={"force_N_m": (0.0, 1e4)},
    notes=["one", "two"],
)
DATA = artifact_bytes(COLUMNS, RECORD)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "stiffness.parquet"
    written = write_artifact(path, COLUMNS, RECORD)
    read = read_artifact(path, "stiffness")
    assert asdict(read.record) == asdict(written.record)
    assert read.facts == {"k_linear_N_m2": 6.5e7, "supported": True, "unknown": None}
    assert (read.origin, read.record.validity) == ("synthetic", {"force_N_m": [0.0, 1e4]})
    assert read.record.tables == RECORD.tables
    for name in ("k_linear_N_m2", "k_quadratic_N_m3", "k_linear_se_N_m2", "n_samples"):
        assert np.array_equal(read.columns[name], COLUMNS[name], equal_nan=name != "n_samples")
    assert np.isnan(read.columns["covariance"][0]).all()
    assert read.columns["covariance"][1].tolist() == [1.0, 2.0, 2.0, 5.0]
    assert read.columns["notes"].tolist() == [None, "µ"]


def test_same_content_same_bytes(tmp_path: Path) -> None:
    assert artifact_bytes(dict(reversed(COLUMNS.items())), RECORD) == DATA
    read = artifact_from_bytes(DATA, tmp_path)
    assert artifact_bytes(read.columns, read.record) == DATA


def test_a_flipped_bit_anywhere_is_refused_or_changes_nothing(tmp_path: Path) -> None:
    whole = artifact_from_bytes(DATA, tmp_path)
    dice, harmless = random.Random(1), 0
    places = dice.sample(range(len(DATA)), 400)
    for place in places:
        damaged = bytearray(DATA)
        damaged[place] ^= 1 << dice.randrange(8)
        try:
            read = artifact_from_bytes(bytes(damaged), tmp_path / "x.parquet", "stiffness")
        except ArtifactError:
            continue
        harmless += 1
        assert asdict(read.record) == asdict(whole.record)
        for name, values in whole.columns.items():
            equal = read.columns[name] == values
            assert np.all(equal | (read.columns[name] != read.columns[name])) or name == "notes"
    assert harmless < len(places)


@pytest.mark.parametrize("keep", [0, 3, 4, 100, len(DATA) // 2, len(DATA) - 1])
def test_a_file_cut_off_is_refused(keep: int, tmp_path: Path) -> None:
    path = tmp_path / "x.parquet"
    path.write_bytes(DATA[:keep])
    with pytest.raises(ArtifactError, match=r"x\.parquet"):
        read_artifact(path)


def test_what_another_program_changed_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.parquet"
    path.write_bytes(DATA)
    table = pq.read_table(path)
    new = pa.array([6.5e7, 6.6e7])
    index = table.column_names.index("k_linear_N_m2")
    pq.write_table(table.set_column(index, table.schema.field(index), new), path)
    with pytest.raises(ArtifactError, match="damaged"):
        read_artifact(path)
    stated = dict(table.schema.metadata)
    stated[RECORD_KEY] = stated[RECORD_KEY].replace(b"synthetic", b"measured")
    pq.write_table(table.replace_schema_metadata(stated), path)
    with pytest.raises(ArtifactError, match="damaged"):
        read_artifact(path)


@pytest.mark.parametrize(
    ("metadata", "kind", "named"),
    [
        ({}, None, "beltid"),
        ({RECORD_KEY: b"{}"}, None, "beltid"),
        ({EARLIER_KEY: b'{"kind":"stiffness"}', b"beltid_sha256": b"0"}, None, "fit-stiffness"),
        (None, "slip", "fit-slip"),
        (b"run,mu\n", None, "Parquet"),
    ],
)
def test_what_is_none_of_ours_is_called_so(
    tmp_path: Path, metadata: dict[bytes, bytes] | bytes | None, kind: str | None, named: str
) -> None:
    path = tmp_path / "x.parquet"
    path.write_bytes(metadata if isinstance(metadata, bytes) else DATA)
    if isinstance(metadata, dict):
        pq.write_table(pq.read_table(path).replace_schema_metadata(metadata), path)
    with pytest.raises(ArtifactError, match=named):
        read_artifact(path, kind)


def test_what_the_schema_forbids_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "x.parquet"
    for name, value in (("k_linear_N_m2", -1.0), ("hysteresis_ratio", np.inf)):
        with pytest.raises(ArtifactError, match=name):
            write_artifact(path, {**COLUMNS, name: np.array([value, 1.0])}, RECORD)
    with pytest.raises(ValueError, match="mine"):
        write_artifact(path, {**COLUMNS, "mine": np.zeros(2)}, RECORD)
    with pytest.raises(TypeError, match="object"):
        write_artifact(path, COLUMNS, replace(RECORD, facts={"x": object()}))
    assert not path.exists()
