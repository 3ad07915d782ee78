"""Artifacts: Parquet files that say what they are, from what they were made, and if they are whole.

Three nets catch damage: the checksum of every page, a hash of the metadata, and a hash of the
numbers. The bytes depend on the content only, not on time, machine or user.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid._version import __version__
from beltid.artifacts import atomic
from beltid.artifacts.file_bytes import read_bytes
from beltid.artifacts.fingerprint import source_sha256
from beltid.artifacts.hashing import columns_sha256, sha256
from beltid.artifacts.parquet_open import damaged, open_parquet
from beltid.errors import ArtifactError
from beltid.tables import schemas

METADATA_KEY: Final = b"beltid"
SEAL_KEY: Final = b"beltid_sha256"


@dataclass(frozen=True, slots=True)
class Metadata:
    """What an artifact says about its making.

    Attributes
    ----------
    config_sha256 : str
        Hash of the config that was used.
    inputs : dict
        Name of every input -> SHA-256 of its bytes.
    validity : dict
        Range within which the result holds.
    set_aside : list of dict
        What was set aside, and why.
    settings : dict
        Settings of the stage.
    extra : dict
        Anything else worth keeping, such as fit statistics.
    """

    config_sha256: str = ""
    inputs: dict[str, str] = field(default_factory=dict)
    validity: dict[str, Any] = field(default_factory=dict)
    set_aside: list[dict[str, Any]] = field(default_factory=list)
    settings: dict[str, Any] = field(default_factory=dict)
    extra: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Artifact:
    """An artifact that was read and found whole.

    Attributes
    ----------
    kind : str
        Kind of the table.
    columns : dict of str to ndarray
        Columns in the order of the schema; missing numbers are nan, missing texts None.
    metadata : Metadata
        What it says about its making.
    path : Path
        Where it was read.
    sha256 : str
        Hash of the bytes of the file.
    units : dict
        Unit per column.
    schema_version : int
        Version of the schema it was written with.
    software_version, software_sha256 : str
        Version of the software that wrote it, and the hash of its sources ("" if not known).
    """

    kind: str
    columns: dict[str, np.ndarray]
    metadata: Metadata
    path: Path
    sha256: str
    units: dict[str, str]
    schema_version: int
    software_version: str
    software_sha256: str


def write_artifact(
    path: str | Path, kind: str, columns: Mapping[str, Any], metadata: Metadata
) -> str:
    """Write an artifact, whole or not at all.

    Parameters
    ----------
    path : path
        Where it is to stand.
    kind : str
        Kind of the table, one of `schemas.ARTIFACTS`.
    columns : mapping
        Values of every required column, and of extra columns of the schema; nan or None where a
        value is missing.
    metadata : Metadata
        What the artifact says about its making.

    Returns
    -------
    str
        SHA-256 of the file's bytes.

    Raises
    ------
    ArtifactError
        If a value is not what the schema allows, or the file cannot be written.
    """
    data = artifact_bytes(kind, columns, metadata, str(path))
    atomic.write_bytes(path, data)
    return sha256(data)


def artifact_bytes(
    kind: str, columns: Mapping[str, Any], metadata: Metadata, name: str = "artifact"
) -> bytes:
    """Bytes of an artifact; `name` stands in messages. See `write_artifact`."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    from beltid.artifacts.arrow_columns import arrow_table, normalised

    table = schemas.table(kind)
    values = normalised(columns, table, name)
    record = {
        "kind": kind,
        "schema_version": table.version,
        "software_version": __version__,
        "software_sha256": source_sha256(),
        "units": {column: table.column(column).unit for column in values},
        "content_sha256": columns_sha256(values),
        **asdict(metadata),
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
    """Whether the foot of a file has a seal of ours; the file is not read for that."""
    import pyarrow.parquet as pq

    try:
        with path.open("rb") as file:
            if file.read(4) != b"PAR1":
                return False
        return SEAL_KEY in (pq.read_schema(path).metadata or {})
    except Exception:  # a damaged file can raise nearly anything
        return False


def read_artifact(path: str | Path, kind: str | None = None) -> Artifact:
    """Read an artifact and verify that it is whole and of the kind that is needed.

    Parameters
    ----------
    path : path
        The file.
    kind : str, optional
        The kind that is needed; None takes any.

    Raises
    ------
    ArtifactError
        If the file is missing, damaged, no artifact, of another kind, or of a schema version that
        this software does not read.
    """
    path = Path(path)
    data = read_bytes(path, ArtifactError)
    return artifact_from_bytes(data, path, kind)


def artifact_from_bytes(data: bytes, path: Path, kind: str | None = None) -> Artifact:
    """Artifact from the bytes of its file; see `read_artifact`."""
    from beltid.artifacts.arrow_columns import columns_of_arrow
    from beltid.artifacts.metadata_models import wrong_contents

    if data[:4] != b"PAR1":
        raise ArtifactError(f"{path}: not an artifact (no Parquet file){_needed(kind)}")
    file, record = _open(data, path, kind)
    found = str(record.get("kind"))
    _check_kind(path, found, kind)
    table = schemas.TABLES[found]
    _check_version(path, record, table)
    try:
        arrow = file.read(use_threads=False)
        columns = columns_of_arrow(arrow, table, str(path))
        whole = columns_sha256(columns) == record["content_sha256"]
        metadata = Metadata(**{name: record[name] for name in Metadata.__slots__})
        units = dict(record["units"])
    except ArtifactError:
        raise
    except Exception as error:  # a damaged file can raise nearly anything
        raise ArtifactError(f"{path}: {damaged(error)}") from None
    if not whole:
        raise ArtifactError(f"{path}: damaged: the numbers do not match their checksum")
    wrong = wrong_contents(found, record)
    if wrong:
        raise ArtifactError([f"{path}: damaged or written by others: {line}" for line in wrong])
    return Artifact(
        kind=found,
        columns=columns,
        metadata=metadata,
        path=path,
        sha256=sha256(data),
        units=units,
        schema_version=table.version,
        software_version=str(record.get("software_version")),
        software_sha256=str(record.get("software_sha256", "")),
    )


def _open(data: bytes, path: Path, kind: str | None) -> tuple[Any, dict[str, Any]]:
    """Parquet file and the metadata of its seal, both checked as far as the footer tells."""
    file = open_parquet(data, schemas.TEXT_COLUMNS, str(path), ArtifactError)
    stored = file.schema_arrow.metadata or {}
    if METADATA_KEY not in stored:
        if SEAL_KEY in stored:
            raise ArtifactError(f"{path}: damaged: its metadata are missing")
        raise ArtifactError(f"{path}: a Parquet file, but not one of beltid{_needed(kind)}")
    if sha256(stored[METADATA_KEY]).encode() != stored.get(SEAL_KEY):
        raise ArtifactError(f"{path}: damaged: its metadata do not match their checksum")
    try:
        record = json.loads(stored[METADATA_KEY])
    except (ValueError, RecursionError) as error:
        raise ArtifactError(f"{path}: {damaged(error)}") from None
    if not isinstance(record, dict) or not _is_record(record):
        raise ArtifactError(f"{path}: damaged: its metadata are not those of an artifact")
    return file, record


def _is_record(record: Mapping[str, Any]) -> bool:
    """Whether every part of the metadata is of its type; a right seal alone does not say that."""
    sections = all(isinstance(record.get(n), dict) for n in ("validity", "settings", "extra"))
    texts = [record.get(n) for n in ("config_sha256", "content_sha256", "software_version")]
    named = all(isinstance(record.get(n), dict) for n in ("inputs", "units"))
    aside = record.get("set_aside")
    return (
        sections
        and named
        and all(isinstance(v, str) for v in (*record["inputs"].values(), *record["units"].values()))
        and all(isinstance(text, str) for text in texts)
        and isinstance(aside, list)
        and all(isinstance(item, dict) for item in aside)
    )


def _check_kind(path: Path, found: str, needed: str | None) -> None:
    if needed is not None and found != needed:
        raise ArtifactError(f"{path}: is a {found} artifact{_needed(needed)}")
    if found not in schemas.ARTIFACTS:
        raise ArtifactError(f"{path}: is a {found} artifact, which this version does not know")


def _check_version(path: Path, record: Mapping[str, Any], table: schemas.Table) -> None:
    version = record.get("schema_version")
    if version != table.version:
        raise ArtifactError(
            f"{path}: schema version {version} of a {table.kind} artifact (written by beltid "
            f"{record.get('software_version')}), must be {table.version}; "
            f"write it again with `{table.command}`"
        )


def _needed(kind: str | None) -> str:
    if kind is None:
        return ""
    return f", a {kind} artifact is needed; `{schemas.table(kind).command}` writes one"


def plain(value: Any) -> Any:
    """A value as JSON has it: numpy scalars and arrays to plain ones, nan and infinity to null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (np.generic, np.ndarray)):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, (str, int, bool)) or value is None:
        return value
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} cannot stand in the metadata of an artifact")
