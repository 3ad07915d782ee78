"""Artifacts say what they are, are the same bytes for the same content, and show any damage."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydantic import ValidationError

from beltid._version import __version__
from beltid.artifacts.artifact import (
    Artifact,
    artifact_bytes,
    artifact_from_bytes,
    read_artifact,
    write_artifact,
)
from beltid.artifacts.metadata_models import METADATA as MODELS
from beltid.artifacts.metadata_models import Metadata, SlipMetadata
from beltid.artifacts.parquet_table import LARGEST
from beltid.bench.recording import read_recording
from beltid.errors import EXIT_INPUT, ArtifactError, InputError
from beltid.tables import schemas

RIGDATA = Path(__file__).parents[2] / "rigdata"
WRITTEN_BEFORE = Path(__file__).parents[1] / "hostile" / "corpus" / "artifact"
METADATA = Metadata(
    config_sha256="ab" * 32,
    inputs={"rig.csv": "cd" * 32},
    validity={"normal_force_N_m": [1041.5, 9000.25]},
    set_aside=[{"run": "R007", "why": "never slides"}],
    settings={"rig.pulley_radius_m": 0.05},
    method="published",
)


def example(kind: str, n: int = 7, seed: int = 3) -> dict[str, Any]:
    """Columns that the schema allows, with a missing value wherever one may be missing."""
    rng = np.random.default_rng(seed)
    columns: dict[str, Any] = {}
    for column in schemas.table(kind).columns:
        if column.dtype == "string":
            columns[column.name] = [f"R{i:03d}" for i in range(n)]
        elif column.dtype == "int64":
            columns[column.name] = np.arange(n)
        elif column.dtype == "bool":
            columns[column.name] = np.arange(n) % 2 == 0
        elif column.dtype == "list":
            columns[column.name] = [rng.normal(size=4) for _ in range(n)]
        else:
            columns[column.name] = rng.uniform(1.0, 100.0, n)
        if column.nullable and column.dtype in ("float64", "string"):
            columns[column.name][2] = None if column.dtype == "string" else np.nan
    return columns


def same(one: Artifact, other: Artifact) -> bool:
    return (
        (one.kind, one.metadata, one.units, one.schema_version)
        == (other.kind, other.metadata, other.units, other.schema_version)
    ) and all(
        np.array_equal(one.columns[c], other.columns[c], equal_nan=one.columns[c].dtype.kind == "f")
        for c in other.columns
    )


@pytest.mark.parametrize("kind", schemas.ARTIFACTS)
def test_round_trip(tmp_path, kind):
    columns = example(kind)
    path = tmp_path / f"{kind}.parquet"
    digest = write_artifact(path, kind, columns, METADATA)
    artifact = read_artifact(path, kind)
    assert artifact.metadata == MODELS[kind].model_validate(dict(METADATA))
    assert digest == artifact.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert artifact.software_version == __version__
    assert list(artifact.columns) == list(schemas.table(kind).names)
    for name, values in columns.items():
        read = artifact.columns[name]
        if read.dtype == object:
            assert read.tolist() == list(values)
        else:
            np.testing.assert_array_equal(read, np.array(values))
        read[...] = read[::-1].copy()  # the reader owns its columns


def test_same_content_same_bytes_in_any_order(tmp_path):
    columns = example("friction")
    one = artifact_bytes("friction", columns, METADATA)
    other = artifact_bytes("friction", dict(reversed(columns.items())), METADATA)
    assert one == other
    turned = Metadata(settings={"b": 1, "a": 2})
    straight = Metadata(settings={"a": 2, "b": 1})
    assert artifact_bytes("friction", columns, turned) == artifact_bytes(
        "friction", columns, straight
    )
    columns["mu_sliding"][0] = np.nextafter(columns["mu_sliding"][0], 1e9)
    assert artifact_bytes("friction", columns, METADATA) != one


def test_any_parquet_reader_finds_nulls_units_and_metadata(tmp_path):
    path = tmp_path / "friction.parquet"
    write_artifact(path, "friction", example("friction"), METADATA)
    table = pq.read_table(path)
    assert table.column("mu_sliding").null_count == 1
    assert table.schema.field("normal_force_N_m").metadata[b"unit"] == b"N/m"
    record = json.loads(table.schema.metadata[b"beltid"])
    assert (record["kind"], record["schema_version"]) == ("friction", 1)
    assert record["units"]["slip_speed_m_s"] == "m/s"
    assert record["set_aside"] == [{"run": "R007", "why": "never slides"}]
    assert len(pd.read_parquet(path)) == 7


@given(
    values=arrays(np.float64, 5, elements=st.floats(-LARGEST, LARGEST) | st.just(np.nan)),
    words=st.lists(st.text(st.characters(exclude_categories=["Cs"])), min_size=5, max_size=5),
)
def test_numbers_and_texts_come_back_bit_for_bit(values, words):
    columns = example("friction", 5) | {"mu_sliding": values, "notes": words}
    data = artifact_bytes("friction", columns, METADATA)
    read = artifact_from_bytes(data, Path("x"), "friction").columns
    kept = ~np.isnan(values)
    assert read["mu_sliding"][kept].tobytes() == values[kept].tobytes()
    assert np.isnan(read["mu_sliding"][~kept]).all()
    assert read["notes"].tolist() == words


@pytest.mark.parametrize("value", [2.0 * LARGEST, -2.0 * LARGEST, np.inf])
def test_numbers_whose_powers_overflow_are_refused(value):
    columns = example("friction", 5) | {"mu_sliding": [0.5, value, 0.5, 0.5, 0.5]}
    with pytest.raises(
        ArtifactError, match=r"in row 2, must be finite and at most 1e\+100 in size"
    ):
        artifact_bytes("friction", columns, METADATA)


def test_an_empty_table_and_missing_extras_come_back():
    required = [c.name for c in schemas.table("friction").columns if c.required]
    columns = {name: [] for name in required}
    read = artifact_from_bytes(artifact_bytes("friction", columns, METADATA), Path("x"))
    assert list(read.columns) == required
    assert {len(v) for v in read.columns.values()} == {0}
    assert read.columns["mu_sliding"].dtype == np.float64


def test_metadata_take_numpy_values_and_no_number_becomes_null():
    metadata = Metadata(settings={"a": np.float64(1.5), "b": np.arange(2), "c": float("nan")})
    read = artifact_from_bytes(artifact_bytes("slip", example("slip"), metadata), Path("x"))
    assert read.metadata.settings == {"a": 1.5, "b": [0, 1], "c": None}


@pytest.mark.parametrize("kind", sorted(path.stem for path in WRITTEN_BEFORE.iterdir()))
def test_a_file_written_before_is_read_and_says_the_same_when_written_again(kind):
    before = (WRITTEN_BEFORE / f"{kind}.parquet").read_bytes()
    artifact = artifact_from_bytes(before, Path("x"), kind)
    after = artifact_bytes(kind, artifact.columns, artifact.metadata)
    records = [
        json.loads(pq.read_schema(pa.BufferReader(data)).metadata[b"beltid"])
        for data in (before, after)
    ]
    sections = ("config_sha256", "inputs", "validity", "set_aside", "settings", "extra", "units")
    one, other = (json.dumps([r[name] for name in sections], sort_keys=True) for r in records)
    assert one == other


def test_metadata_are_typed_frozen_and_of_their_kind():
    speeds = {"proposed_rad_s": np.array([0.05, 0.2]), "covered": True}
    metadata = SlipMetadata(rig_speeds=speeds, max_slip_speed_m_s=np.float64(0.02))
    read = artifact_from_bytes(artifact_bytes("slip", example("slip"), metadata), Path("x"))
    assert read.metadata.rig_speeds == {"proposed_rad_s": (0.05, 0.2), "covered": True}
    assert read.metadata.max_slip_speed_m_s == 0.02
    assert read.metadata.figures.keys() == {"rig_speeds", "max_slip_speed_m_s"}
    with pytest.raises(ValidationError):
        metadata.method = "other"
    with pytest.raises(ValueError, match=r"a surface artifact: unknown figures .*'rig_speeds'"):
        artifact_bytes("surface", example("surface"), metadata)


def test_a_figure_that_this_version_does_not_know_is_kept_when_it_is_read():
    data = artifact_bytes("slip", example("slip"), METADATA)
    record = json.loads(pq.read_schema(pa.BufferReader(data)).metadata[b"beltid"])
    record["extra"]["of_another_version"] = [1]
    read = artifact_from_bytes(rewritten(data, sealed(record)), Path("x"), "slip")
    assert read.metadata.figures["of_another_version"] == [1]


# --- damage ----------------------------------------------------------------------------------


def test_a_flipped_bit_is_found_or_harmless():
    kind = "stiffness"  # it has a column of lists, too
    data = artifact_bytes(kind, example(kind, 40), METADATA)
    whole = artifact_from_bytes(data, Path("x"), kind)
    rng = np.random.default_rng(11)
    found = 0
    for place, bit in zip(rng.integers(0, len(data), 400), rng.integers(0, 8, 400), strict=True):
        damaged = bytearray(data)
        damaged[place] ^= 1 << bit
        try:
            assert same(artifact_from_bytes(bytes(damaged), Path("x"), kind), whole)
        except ArtifactError:
            found += 1
    assert found > 100


def test_every_bit_of_the_numbers_is_guarded():
    """The pages themselves: not one flip passes."""
    data = artifact_bytes("friction", example("friction", 300), METADATA)
    chunk = pq.ParquetFile(pa.BufferReader(data)).metadata.row_group(0).column(8)
    assert chunk.path_in_schema == "mu_sliding"
    end = chunk.data_page_offset + chunk.total_compressed_size
    for place in range(end - 300, end, 3):
        damaged = bytearray(data)
        damaged[place] ^= 0x10
        with pytest.raises(ArtifactError, match="x: damaged"):
            artifact_from_bytes(bytes(damaged), Path("x"), "friction")
        with pytest.raises(OSError, match=r"CRC checksum verification failed"):
            pq.read_table(pa.BufferReader(bytes(damaged)), page_checksum_verification=True)


@pytest.mark.parametrize("keep", [0.0, 0.001, 0.3, 0.9, 0.9999])
def test_a_file_cut_off_is_found(tmp_path, keep):
    path = tmp_path / "slip.parquet"
    data = artifact_bytes("slip", example("slip"), METADATA)
    path.write_bytes(data[: int(keep * len(data))])
    with pytest.raises(ArtifactError, match=r"slip\.parquet: (damaged|the file is empty|not an)"):
        read_artifact(path, "slip")


def rewritten(
    data: bytes, change: dict[bytes, bytes], columns: dict[str, Any] | None = None
) -> bytes:
    """The artifact as another program might write it, with a changed seal or column."""
    table = pq.read_table(pa.BufferReader(data))
    for name, values in (columns or {}).items():
        table = table.set_column(table.column_names.index(name), name, pa.array(values))
    table = table.replace_schema_metadata({**table.schema.metadata, **change})
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink)
    return sink.getvalue().to_pybytes()


def sealed(record: Any) -> dict[bytes, bytes]:
    text = json.dumps(record).encode()
    return {b"beltid": text, b"beltid_sha256": hashlib.sha256(text).hexdigest().encode()}


def test_a_number_changed_by_another_program_is_found():
    data = artifact_bytes("slip", example("slip"), METADATA)
    changed = rewritten(data, {}, {"torque_N_m": np.arange(7.0)})
    with pytest.raises(ArtifactError, match="the numbers do not match their checksum"):
        artifact_from_bytes(changed, Path("x"), "slip")


def test_metadata_changed_by_another_program_are_found():
    data = artifact_bytes("slip", example("slip"), METADATA)
    with pytest.raises(ArtifactError, match="metadata do not match their checksum"):
        artifact_from_bytes(rewritten(data, {b"beltid": b"{}"}), Path("x"), "slip")


@pytest.mark.parametrize("kept", [False, True], ids=["alone", "in a right one"])
@pytest.mark.parametrize(
    "record",
    [
        [],
        {"kind": ["x"]},
        {"kind": "slip", "schema_version": 1, "inputs": 3},
        {"extra": None},
        {"set_aside": [1]},
        {"units": {"a": 1}},
    ],
)
def test_metadata_of_another_shape_are_damage_though_their_seal_is_right(record, kept):
    data = artifact_bytes("slip", example("slip"), METADATA)
    right = json.loads(pq.read_schema(pa.BufferReader(data)).metadata[b"beltid"])
    record = right | record if kept and record else record
    with pytest.raises(ArtifactError):
        artifact_from_bytes(rewritten(data, sealed(record)), Path("x"))


def test_another_schema_version_says_what_to_do():
    data = artifact_bytes("slip", example("slip"), METADATA)
    record = json.loads(pq.read_schema(pa.BufferReader(data)).metadata[b"beltid"])
    record |= {"schema_version": 2, "software_version": "9.9"}
    with pytest.raises(ArtifactError) as caught:
        artifact_from_bytes(rewritten(data, sealed(record)), Path("x"), "slip")
    assert str(caught.value) == (
        "x: schema version 2 of a slip artifact (written by beltid 9.9), must be 1; "
        "write it again with `beltid fit-slip`"
    )


def test_a_column_that_is_gone_is_no_damage():
    data = artifact_bytes("slip", example("slip"), METADATA)
    record = json.loads(pq.read_schema(pa.BufferReader(data)).metadata[b"beltid"])
    record["units"] |= {"humidity_percent": "%"}
    with pytest.raises(ArtifactError, match=r"humidity_percent.*`beltid fit-slip`") as caught:
        artifact_from_bytes(rewritten(data, sealed(record)), Path("x"), "slip")
    assert "damaged" not in str(caught.value)


def test_another_kind_says_which_command_writes_the_right_one(tmp_path):
    path = tmp_path / "friction.parquet"
    write_artifact(path, "friction", example("friction"), METADATA)
    with pytest.raises(ArtifactError) as caught:
        read_artifact(path, "stiffness")
    assert caught.value.exit_status == EXIT_INPUT
    assert str(caught.value) == (
        f"{path}: is a friction artifact, a stiffness artifact is needed; "
        "`beltid fit-stiffness` writes one"
    )


def test_what_is_no_artifact(tmp_path):
    csv = RIGDATA / "5pk" / "press.csv"
    with pytest.raises(ArtifactError, match=r"not an artifact.*`beltid fit-stiffness` writes one"):
        read_artifact(csv, "stiffness")
    path = tmp_path / "plain.parquet"
    pd.DataFrame({"a": [1]}).to_parquet(path)
    with pytest.raises(ArtifactError, match="a Parquet file, but not one of beltid"):
        read_artifact(path, "stiffness")
    with pytest.raises(ArtifactError, match="there is no such file"):
        read_artifact(tmp_path / "no.parquet")
    with pytest.raises(ArtifactError, match="is a folder"):
        read_artifact(tmp_path)


# --- what may be written ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("normal_force_N_m", np.inf, "normal_force_N_m = inf in row 2, must be >= 0"),
        ("tension_tight_N", -1.0, "tension_tight_N = -1.0 in row 2, must be > 0"),
        ("mu_sliding", -np.inf, "mu_sliding = -inf in row 2, must be finite"),
        ("arc_deg", 4000.0, "arc_deg = 4000.0 in row 2, must be in (0, 3600]"),
    ],
)
def test_a_value_that_the_schema_forbids_is_not_written(tmp_path, column, value, words):
    columns = example("friction")
    columns[column][1] = value
    path = tmp_path / "friction.parquet"
    with pytest.raises(ArtifactError) as caught:
        write_artifact(path, "friction", columns, METADATA)
    assert words in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_a_missing_label_is_not_written():
    columns = example("friction")
    columns["status"][4] = None
    with pytest.raises(ArtifactError, match="status is missing in row 5"):
        artifact_bytes("friction", columns, METADATA)


@pytest.mark.parametrize(
    "change",
    [
        lambda c: {**c, "mu_slding": c["mu_sliding"]},
        lambda c: {k: v for k, v in c.items() if k != "mu_sliding"},
        lambda c: {**c, "mu_sliding": c["mu_sliding"][:-1]},
        lambda c: {**c, "n_samples": c["n_samples"] + 0.5},
        lambda c: {**c, "swapped": ["no"] * 7},
    ],
)
def test_a_mistake_in_the_code_is_loud(change):
    with pytest.raises(ValueError, match=r"friction table|n_samples|swapped"):
        artifact_bytes("friction", change(example("friction")), METADATA)


# --- the same door for measured and simulated recordings --------------------------------------


def test_a_simulated_recording_is_read_as_one_of_the_bench(tmp_path):
    bench = read_recording(RIGDATA / "5pk" / "rig.csv", "rig")
    path = tmp_path / "simulated.parquet"
    write_artifact(path, "simulated", bench.columns, METADATA)
    simulated = read_recording(path, "rig")
    assert list(simulated.columns) == list(bench.columns)
    for name, values in bench.columns.items():
        np.testing.assert_array_equal(simulated.columns[name], values)


def test_another_artifact_is_no_recording(tmp_path):
    path = tmp_path / "friction.parquet"
    write_artifact(path, "friction", example("friction"), METADATA)
    with pytest.raises(InputError, match="is a friction artifact, a simulated artifact is needed"):
        read_recording(path, "rig")
    with pytest.raises(InputError, match="is a friction artifact, a press recording is needed"):
        read_recording(path, "press")
