"""Artifacts: Parquet files that state what they are, what they were made from, and what they say.

A file holds a table and one JSON record. One seal covers record and values, and every page has a
checksum, so that damage and edits by other programs are found. The bytes depend only on the
content, not on time, machine or user.

An artifact states the SHA-256 of all that it was made from. Artifacts fit together if nothing that
one of them was made from is given, or stated by another, with another content.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from beltid.errors import ArtifactError
from beltid.store.disk import read_bytes, sha256, write_bytes

if TYPE_CHECKING:
    import numpy as np

RECORD_KEY = b"beltid_record"
SEAL_KEY = b"beltid_seal"
EARLIER_KEY = b"beltid"  # of the metadata in files of earlier versions, which are not read

RECORDINGS = ("press", "rig", "speedloss")
Origin = Literal["measured", "synthetic"]  # of the data


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """What a result says besides its table."""

    facts: Mapping[str, Any] = field(default_factory=dict)  #: single results; unit in the name
    tables: Mapping[str, Any] = field(default_factory=dict)  #: further tables: lists of rows
    validity: Mapping[str, Any] = field(default_factory=dict)  #: ranges within which it holds
    set_aside: list[dict[str, Any]] = field(default_factory=list)  #: runs or points, and why
    notes: Sequence[str] = field(default_factory=list)
    warnings: Sequence[str] = field(default_factory=list)
    verdict: str = ""
    passed: bool | None = None  #: whether what was judged is within tolerance
    origin: str | None = None  #: of the data, "measured" or "synthetic"; None if not stated


@dataclass(frozen=True, slots=True)
class Record(Said):
    """What an artifact says about itself, and what its result says: plain JSON values.

    `inputs` and `ancestors` are the SHA-256 of what was read, and of all that it was made from, by
    name; `sources` that of the software, `made_from` that of all these, the settings and options:
    unchanged means up to date. `config` has no folder, so that the bytes are the same anywhere.
    """

    kind: str
    version: int = 0  # of the schema of the kind
    made_by: str = ""  # command, such as "fit-stiffness"
    made_from: str = ""
    software: str = ""
    sources: str = ""
    inputs: dict[str, str] = field(default_factory=dict)
    ancestors: dict[str, str] = field(default_factory=dict)
    config: str = ""
    config_sha256: str = ""
    settings: dict[str, Any] = field(default_factory=dict)  # sections of the config, options


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
    def name(self) -> str:
        """Kind of the table, and whether it comes from the refined surface."""
        refined = self.kind in ("surface", "simulated", "compare") and (
            self.facts.get("method") == "refined" or "surface_refined" in self.record.ancestors
        )
        return f"{self.kind}_refined" if refined else self.kind

    @property
    def recordings(self) -> set[tuple[str, str]]:
        """Name and SHA-256 of the recordings that it was made from."""
        return {pair for pair in self.record.ancestors.items() if pair[0] in RECORDINGS}

    @property
    def facts(self) -> Mapping[str, Any]:
        """Single results by name."""
        return self.record.facts

    @property
    def origin(self) -> str | None:
        """Origin of the data."""
        return self.record.origin


def plain(value: Any) -> Any:
    """Convert a value to plain JSON types; nan and infinity become null."""
    if hasattr(value, "tolist"):  # an array or a number of numpy
        value = value.tolist()
    match value:
        case Mapping():
            return {str(key): plain(item) for key, item in value.items()}
        case list() | tuple():
            return [plain(item) for item in value]
        case float():
            return value if math.isfinite(value) else None
        case str() | int() | None:
            return value
        case Path():
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
    from beltid.store.parquet import normalised, parquet_bytes, seal
    from beltid.tables.schemas import TABLES

    table = TABLES[record.kind]
    values = normalised(columns, table, name)
    stated = plain({"kind": table.kind} | asdict(record) | {"version": table.version})
    text = json.dumps(stated, separators=(",", ":"), allow_nan=False).encode()
    return parquet_bytes(values, table, {RECORD_KEY: text, SEAL_KEY: seal(text, values)})


def read_artifact(path: str | Path, kind: str | None = None) -> Artifact:
    """Read an artifact and verify that it is undamaged and, if stated, of a kind."""
    return artifact_from_bytes(read_bytes(Path(path), ArtifactError), Path(path), kind)


def artifact_from_bytes(data: bytes, path: Path, kind: str | None = None) -> Artifact:
    """Read an artifact from the bytes of its file; see `read_artifact`."""
    from beltid.store.parquet import columns_of_arrow, damaged, open_parquet, seal
    from beltid.tables.schemas import TABLES

    needed = "" if kind is None else f", a {kind} artifact is needed; {_command(kind)} writes one"
    if data[:4] != b"PAR1":
        raise ArtifactError(f"{path}: not an artifact (not a Parquet file){needed}")
    file = open_parquet(data, str(path), ArtifactError)
    stored = file.metadata.metadata or {}
    if SEAL_KEY not in stored or RECORD_KEY not in stored:
        if EARLIER_KEY in stored:
            raise ArtifactError(
                f"{path}: written by an earlier version; {_command(kind_in(data) or kind or '')} "
                "makes it again"
            )
        raise ArtifactError(f"{path}: a Parquet file, but not one of beltid{needed}")
    text = stored[RECORD_KEY]
    try:
        record = Record(**json.loads(text))
        table = TABLES[record.kind]
    except (ValueError, TypeError, KeyError):
        raise ArtifactError(f"{path}: damaged, or of another version of beltid{needed}") from None
    if kind not in (None, record.kind):
        raise ArtifactError(f"{path}: is a {record.kind} artifact{needed}")
    if record.version != table.version:
        raise ArtifactError(
            f"{path}: schema version {record.version} of {record.software}, must be "
            f"{table.version}; {_command(table.kind)} makes it again"
        )
    try:
        columns = columns_of_arrow(file.read(use_threads=False), table)
    except Exception as error:  # a damaged file can raise almost any error
        raise ArtifactError(f"{path}: {damaged(error)}") from None
    if seal(text, columns) != stored[SEAL_KEY]:
        raise ArtifactError(f"{path}: damaged: record and numbers do not match their checksum")
    return Artifact(columns, record, path, sha256(data))


def may_be_artifact(path: Path) -> bool:
    """Return whether the footer of a file has the seal of an artifact; reads only the footer."""
    import pyarrow.parquet as pq

    try:
        with path.open("rb") as file:
            return file.read(4) == b"PAR1" and SEAL_KEY in (pq.read_metadata(path).metadata or {})
    except Exception:  # a damaged file can raise almost any error
        return False


def kind_in(data: bytes) -> str | None:
    """Return the kind that a file states, even if damaged or old; None if it is not of beltid."""
    match = re.search(rb'"kind":"([a-z_]+)"', data) if b"beltid_s" in data else None
    return None if match is None else match[1].decode()


def _command(kind: str) -> str:
    from beltid.tables.schemas import TABLES

    return f"`{TABLES[kind].command if kind in TABLES else 'beltid'}`"


def refuse_misfits(artifacts: Iterable[Artifact], guests: Iterable[Artifact] = ()) -> None:
    """Refuse artifacts that do not fit together; a guest counts if it is of the same recordings."""
    hosts = list(artifacts)
    known = {recording for host in hosts for recording in host.recordings}
    if problems := misfits([*hosts, *(guest for guest in guests if known & guest.recordings)]):
        raise ArtifactError(problems)


def misfits(artifacts: Sequence[Artifact]) -> list[str]:
    """Return a line for each misfit, only for the nearest causes."""
    found: tuple[list[str], ...] = ([], [], [])  # with an input, its ancestor, another result
    for position, artifact in enumerate(artifacts):
        for name, content in artifact.record.ancestors.items():
            given = [other for other in artifacts if other.name == name]
            if given and all(other.sha256 != content for other in given):
                is_input = content in artifact.record.inputs.values()
                found[0 if is_input else 1].append(_line(artifact, name, given[0]))
            for other in () if given else artifacts[:position]:
                if other.record.ancestors.get(name, content) != content:
                    found[2].append(_line(artifact, name, other))
    return next(filter(None, found), [])


def _line(artifact: Artifact, name: str, other: Artifact) -> str:
    made_by = artifact.record.made_by
    command = f"beltid {made_by}" if made_by else _command(artifact.kind).strip("`")
    if artifact.kind == "simulated" and other.kind == "friction":
        command += f" --from {other.path}"
    return (
        f"{artifact.path}: was made from another {name} "
        f"{'recording' if name in RECORDINGS else 'artifact'} than {other.path}; "
        f"`{command}` makes it again, `beltid run` all results of the belt"
    )
