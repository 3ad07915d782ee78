"""Artifacts: Parquet files that state what they are and what they were computed from.

Damage is detected by a checksum of every page, a hash of the metadata and a hash of the values. The
bytes depend only on the content, not on time, machine or user.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from beltid._version import __version__
from beltid.artifacts.file_bytes import read_bytes, sha256, source_sha256, write_bytes
from beltid.artifacts.metadata_models import METADATA, SECTIONS, Metadata, metadata_of, plain
from beltid.artifacts.parquet_table import columns_sha256, damaged, open_parquet
from beltid.errors import ArtifactError
from beltid.tables import schemas

METADATA_KEY: Final = b"beltid"
SEAL_KEY: Final = b"beltid_sha256"


M = TypeVar("M", bound=Metadata)


class _Record(BaseModel):
    """JSON metadata of a file, before its kind is known."""

    model_config = ConfigDict(strict=True)

    kind: str
    schema_version: int
    software_version: str
    software_sha256: str = ""
    units: dict[str, str]
    content_sha256: str
    config_sha256: str
    inputs: dict[str, str]
    validity: dict[str, Any]
    set_aside: list[dict[str, Any]]
    settings: dict[str, Any]
    extra: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Artifact(Generic[M]):
    """An artifact that was read and verified.

    Attributes
    ----------
    kind : str
        Kind of the table.
    columns : dict of str to ndarray
        Columns in the order of the schema; missing numbers are nan, missing texts None.
    metadata : Metadata
        Its metadata, in the model of its kind.
    path : Path
        File that was read.
    sha256 : str
        Hash of the bytes of the file.
    units : dict
        Unit of each column.
    schema_version : int
        Version of its schema.
    software_version, software_sha256 : str
        Version of the software that wrote it, and the hash of its sources ("" if not known).
    """

    kind: str
    columns: dict[str, np.ndarray]
    metadata: M
    path: Path
    sha256: str
    units: dict[str, str]
    schema_version: int
    software_version: str
    software_sha256: str


def write_artifact(
    path: str | Path, kind: str, columns: Mapping[str, Any], metadata: Metadata
) -> str:
    """Write an artifact atomically.

    Parameters
    ----------
    path : path
        Path of the file.
    kind : str
        Kind of the table, one of `schemas.ARTIFACTS`.
    columns : mapping
        Values of every required column and of any optional columns; nan or None if a value is
        missing.
    metadata : Metadata
        Its metadata, in the model of its kind.

    Returns
    -------
    str
        SHA-256 of the file's bytes.

    Raises
    ------
    ArtifactError
        If a value is not what the schema allows, or the file cannot be written.
    ValueError
        If columns or metadata are not those of the kind: a bug in the code.
    """
    data = artifact_bytes(kind, columns, metadata, str(path))
    write_bytes(path, data)
    return sha256(data)


def artifact_bytes(
    kind: str, columns: Mapping[str, Any], metadata: Metadata, name: str = "artifact"
) -> bytes:
    """Create the bytes of an artifact; `name` is for messages. See `write_artifact`."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    from beltid.artifacts.parquet_table import arrow_table, normalised

    table = schemas.table(kind)
    values = normalised(columns, table, name)
    unknown = [figure for figure in metadata.figures if figure not in METADATA[kind].model_fields]
    if unknown:
        raise ValueError(f"a {kind} artifact: unknown figures {unknown}")
    record = {
        "kind": kind,
        "schema_version": table.version,
        "software_version": __version__,
        "software_sha256": source_sha256(),
        "units": {column: table.column(column).unit for column in values},
        "content_sha256": columns_sha256(values),
        **{name: getattr(metadata, name) for name in SECTIONS},
        "extra": metadata.figures,
    }
    text = json.dumps(
        plain(record), sort_keys=True, separators=(",", ":"), allow_nan=False, ensure_ascii=True
    ).encode()
    sealed = arrow_table(values, table).replace_schema_metadata(
        {METADATA_KEY: text, SEAL_KEY: sha256(text).encode()}
    )
    buffer = io.BytesIO()
    pq.write_table(
        sealed,
        pa.PythonFile(buffer, mode="w"),
        version="2.6",
        compression="zstd",
        compression_level=3,
        use_dictionary=[c.name for c in table.columns if c.name in values and c.dtype == "string"],
        write_page_checksum=True,
        store_schema=True,
    )
    return buffer.getvalue()


def may_be_artifact(path: Path) -> bool:
    """Return whether the footer of a file has the seal of an artifact; reads only the footer."""
    import pyarrow.parquet as pq

    try:
        with path.open("rb") as file:
            if file.read(4) != b"PAR1":
                return False
        return SEAL_KEY in (pq.read_schema(path).metadata or {})
    except Exception:  # a damaged file can raise almost any error
        return False


def stated_kind(path: Path) -> str | None:
    """Return the kind stated in the metadata of a file, even if damaged or of an old schema.

    Parameters
    ----------
    path : Path
        An ordinary file.

    Returns
    -------
    str or None
        None if the file is empty or was not written by beltid.

    Raises
    ------
    ArtifactError
        If the file cannot be read.
    """
    data = read_bytes(path, ArtifactError) if path.stat().st_size else b""
    match = re.search(rb'"kind":"([a-z_]+)"', data) if SEAL_KEY in data else None
    return None if match is None else match[1].decode()


def read_artifact(path: str | Path, kind: str | None = None) -> Artifact[Any]:
    """Read an artifact and verify that it is undamaged and of the needed kind.

    Parameters
    ----------
    path : path
        The file.
    kind : str, optional
        The needed kind; None accepts any.

    Raises
    ------
    ArtifactError
        If the file is missing, damaged, not an artifact, of another kind, or of a schema version
        that this software does not read.
    """
    path = Path(path)
    data = read_bytes(path, ArtifactError)
    return artifact_from_bytes(data, path, kind)


def artifact_from_bytes(data: bytes, path: Path, kind: str | None = None) -> Artifact[Any]:
    """Read an artifact from the bytes of its file; see `read_artifact`."""
    from beltid.artifacts.parquet_table import columns_of_arrow

    if data[:4] != b"PAR1":
        text = f"{path}: not an artifact (not a Parquet file){_needed(kind)}"
        raise ArtifactError(text)
    file, record = _open(data, path, kind)
    _check_kind(path, record.kind, kind)
    table = schemas.table(record.kind)
    _check_version(path, record, table)
    try:
        columns = columns_of_arrow(file.read(use_threads=False), table, str(path))
        intact = columns_sha256(columns) == record.content_sha256
    except ArtifactError:
        raise
    except Exception as error:  # a damaged file can raise almost any error
        raise ArtifactError(f"{path}: {damaged(error)}") from None
    if not intact:
        text = f"{path}: damaged: the numbers do not match their checksum"
        raise ArtifactError(text)
    stated = {**record.extra, **{name: getattr(record, name) for name in SECTIONS}}
    metadata = metadata_of(record.kind, stated, f"{path}: damaged or not written by beltid")
    return Artifact(
        kind=record.kind,
        columns=columns,
        metadata=metadata,
        path=path,
        sha256=sha256(data),
        units=record.units,
        schema_version=table.version,
        software_version=record.software_version,
        software_sha256=record.software_sha256,
    )


def _open(data: bytes, path: Path, kind: str | None) -> tuple[Any, _Record]:
    """Open a Parquet file and verify its footer and its sealed metadata."""
    file = open_parquet(data, str(path), ArtifactError)
    stored = file.schema_arrow.metadata or {}
    if METADATA_KEY not in stored:
        if SEAL_KEY in stored:
            raise ArtifactError(f"{path}: damaged: its metadata are missing")
        raise ArtifactError(f"{path}: a Parquet file, but not one of beltid{_needed(kind)}")
    if sha256(stored[METADATA_KEY]).encode() != stored.get(SEAL_KEY):
        text = f"{path}: damaged: its metadata do not match their checksum"
        raise ArtifactError(text)
    try:
        return file, _Record.model_validate_json(stored[METADATA_KEY])
    except ValidationError:
        text = f"{path}: damaged: its metadata are not those of an artifact"
        raise ArtifactError(text) from None


def _check_kind(path: Path, found: str, needed: str | None) -> None:
    if needed is not None and found != needed:
        text = f"{path}: is a {found} artifact{_needed(needed)}"
        raise ArtifactError(text)
    if found not in schemas.ARTIFACTS:
        raise ArtifactError(f"{path}: is a {found} artifact, which this version does not know")


def _check_version(path: Path, record: _Record, table: schemas.Table) -> None:
    if record.schema_version != table.version:
        raise ArtifactError(
            f"{path}: schema version {record.schema_version} of a {table.kind} artifact (written "
            f"by beltid {record.software_version}), must be {table.version}; "
            f"write it again with `{table.command}`",
        )
    if unknown := [name for name in record.units if name not in table.names]:
        raise ArtifactError(
            f"{path}: a {table.kind} artifact (written by beltid {record.software_version}) with "
            f"columns that are gone: {', '.join(unknown)}; write it again with `{table.command}`"
        )


def _needed(kind: str | None) -> str:
    if kind is None:
        return ""
    return f", a {kind} artifact is needed; `{schemas.table(kind).command}` writes one"
