"""Artifacts: Parquet files that state what they are, what they were made from, and what they say.

A file holds a table and one JSON record. One seal covers record and values, and every page has a
checksum, so that damage and edits by other programs are found. The bytes depend only on the
content, not on time, machine or user.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from beltid.errors import ArtifactError
from beltid.store.disk import read_bytes, sha256, write_bytes
from beltid.store.parquet import (
    arrow_table,
    columns_of_arrow,
    columns_sha256,
    damaged,
    normalised,
    open_parquet,
)
from beltid.tables import schemas

RECORD_KEY: Final = b"beltid_record"
SEAL_KEY: Final = b"beltid_seal"
EARLIER_KEY: Final = b"beltid"
"""Key of the metadata in files of earlier versions, which are not read."""

Origin = Literal["measured", "synthetic"]
"""Origin of the data."""


@dataclass(frozen=True, slots=True)
class Record:
    """What an artifact says about itself besides its table: plain JSON values.

    Attributes
    ----------
    kind, version : str, int
        Kind of the table, and version of its schema.
    made_by : str
        Command, such as "fit-stiffness".
    made_from : str
        Hash of the software, inputs, settings and options: unchanged means up to date.
    software, sources : str
        Version of the software; SHA-256 of its sources.
    origin : {"measured", "synthetic"} or None
        Origin of the data; None if not stated.
    inputs, ancestors : dict
        SHA-256 of the inputs by role; of all that they were made from, by name.
    config, config_sha256 : str
        Name of the config without its folder, and its hash.
    settings : dict
        Sections of the config that matter, and the options of the call.
    facts : dict
        Single results by name; the unit is in the name.
    tables : dict of str to list of dict
        Further tables.
    validity : dict
        Ranges within which the result holds.
    set_aside : list of dict
        What was set aside, and why.
    notes, warnings : list of str
        What the user should know, and look into.
    verdict, passed : str, bool or None
        Verdict in words; whether what was judged is within tolerance, None if nothing was.
    """

    kind: str
    version: int = 0
    made_by: str = ""
    made_from: str = ""
    software: str = ""
    sources: str = ""
    origin: str | None = None
    inputs: dict[str, str] = field(default_factory=dict)
    ancestors: dict[str, str] = field(default_factory=dict)
    config: str = ""
    config_sha256: str = ""
    settings: dict[str, Any] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)
    tables: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    validity: dict[str, Any] = field(default_factory=dict)
    set_aside: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    verdict: str = ""
    passed: bool | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Artifact:
    """A table with its record, as read from a verified file.

    `columns` has the order of the schema; missing numbers are nan, missing texts None. `sha256` is
    the hash of the file.
    """

    columns: dict[str, np.ndarray]
    record: Record
    path: Path
    sha256: str

    @property
    def kind(self) -> str:
        """Kind of the table."""
        return self.record.kind

    @property
    def facts(self) -> dict[str, Any]:
        """Single results by name."""
        return self.record.facts

    @property
    def tables(self) -> dict[str, list[dict[str, Any]]]:
        """Further tables."""
        return self.record.tables

    @property
    def validity(self) -> dict[str, Any]:
        """Ranges within which the result holds."""
        return self.record.validity

    @property
    def origin(self) -> str | None:
        """Origin of the data."""
        return self.record.origin


def plain(value: Any) -> Any:
    """Convert a value to plain JSON types; nan and infinity become null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (np.generic, np.ndarray)):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    if isinstance(value, (str, int)) or value is None:
        return value
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "model_dump"):
        return plain(value.model_dump())
    raise TypeError(f"{type(value).__name__} cannot be stored in a record")


def combined_origin(origins: Any) -> Origin | None:
    """Combine the origins of inputs; one synthetic input makes the result synthetic."""
    found = set(origins)
    if "synthetic" in found:
        return "synthetic"
    return "measured" if found == {"measured"} else None


def write_artifact(path: Path, columns: Mapping[str, Any], record: Record) -> Artifact:
    """Write an artifact whole or not at all, and return it as read back."""
    data = artifact_bytes(columns, record, str(path))
    artifact = artifact_from_bytes(data, path, record.kind)
    write_bytes(path, data)
    return artifact


def artifact_bytes(columns: Mapping[str, Any], record: Record, name: str = "artifact") -> bytes:
    """Return the bytes of an artifact; `name` is for messages."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = schemas.table(record.kind)
    values = normalised(columns, table, name)
    stated = {**asdict(record), "version": table.version}
    text = json.dumps(
        plain(stated), separators=(",", ":"), allow_nan=False, ensure_ascii=True
    ).encode()
    sealed = arrow_table(values, table).replace_schema_metadata(
        {RECORD_KEY: text, SEAL_KEY: _seal(text, values)}
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


def _seal(text: bytes, columns: Mapping[str, np.ndarray]) -> bytes:
    return sha256(text + columns_sha256(columns).encode()).encode()


def read_artifact(path: str | Path, kind: str | None = None) -> Artifact:
    """Read an artifact and verify that it is undamaged and, if stated, of a kind."""
    return artifact_from_bytes(read_bytes(Path(path), ArtifactError), Path(path), kind)


def artifact_from_bytes(data: bytes, path: Path, kind: str | None = None) -> Artifact:
    """Read an artifact from the bytes of its file; see `read_artifact`."""
    if data[:4] != b"PAR1":
        raise ArtifactError(f"{path}: not an artifact (not a Parquet file){_needed(kind)}")
    file = open_parquet(data, str(path), ArtifactError)
    stored = file.schema_arrow.metadata or {}
    if RECORD_KEY not in stored or SEAL_KEY not in stored:
        if EARLIER_KEY in stored:
            raise ArtifactError(f"{path}: written by an earlier version{_again(stated_kind(path))}")
        if RECORD_KEY in stored or SEAL_KEY in stored:
            raise ArtifactError(f"{path}: damaged: a part of its record is missing")
        raise ArtifactError(f"{path}: a Parquet file, but not one of beltid{_needed(kind)}")
    text = stored[RECORD_KEY]
    try:
        stated = json.loads(text)
        known = {f.name for f in fields(Record)}
        record = Record(**{name: value for name, value in stated.items() if name in known})
    except (ValueError, TypeError, AttributeError):
        raise ArtifactError(f"{path}: damaged: its record cannot be read") from None
    if record.kind not in schemas.TABLES:
        raise ArtifactError(f"{path}: is a {record.kind} artifact, which this version knows not")
    table = schemas.table(record.kind)
    if kind not in (None, record.kind):
        raise ArtifactError(f"{path}: is a {record.kind} artifact{_needed(kind)}")
    if record.version != table.version:
        raise ArtifactError(
            f"{path}: schema version {record.version} of a {table.kind} artifact (written by "
            f"{record.software}), must be {table.version}{_again(table.kind)}"
        )
    try:
        columns = columns_of_arrow(file.read(use_threads=False), table, str(path))
    except ArtifactError:
        raise
    except Exception as error:  # a damaged file can raise almost any error
        raise ArtifactError(f"{path}: {damaged(error)}") from None
    if _seal(text, columns) != stored[SEAL_KEY]:
        raise ArtifactError(f"{path}: damaged: record and numbers do not match their checksum")
    return Artifact(columns, record, path, sha256(data))


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
    """Return the kind that a file states, even if damaged or old; None if it is not of beltid."""
    data = read_bytes(path, ArtifactError) if path.stat().st_size else b""
    match = re.search(rb'"kind":"([a-z_]+)"', data) if b"beltid_s" in data else None
    return None if match is None else match[1].decode()


def _again(kind: str | None) -> str:
    known = kind is not None and kind in schemas.TABLES
    return f"; `{schemas.table(str(kind)).command}` makes it again" if known else ""


def _needed(kind: str | None) -> str:
    if kind is None:
        return ""
    return f", a {kind} artifact is needed; `{schemas.table(kind).command}` writes one"
