"""Recordings of the benches: CSV (or Parquet) in, validated columns out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from beltid.errors import InputError
from beltid.store import schemas
from beltid.store.checks import Checker
from beltid.store.csv_reader import Wanted, read_rows
from beltid.store.dialect import Layout, ReadOptions, decode, header_further_down, layout
from beltid.store.files import read_bytes, unpacked
from beltid.store.frames import columns_of_frame
from beltid.store.hashing import sha256
from beltid.store.header import check_header, hint_units_row
from beltid.store.problems import Problems
from beltid.units import Conversion, allowed_units, canonical_unit, conversion


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording of a bench, validated.

    Attributes
    ----------
    kind : str
        "press", "rig" or "speedloss".
    columns : dict of str to ndarray
        The columns of the schema in its order and units: float64 with nan where a number is
        missing, object arrays of str for labels. An optional column that the file does not have
        is all nan.
    path : Path
        The file.
    sha256 : str
        Hash of the bytes of the file.
    notes : tuple of str
        What was found out, left out or missing.
    lines : ndarray
        Line of every row in the file, from 1; empty for a file without lines.
    """

    kind: str
    columns: dict[str, np.ndarray]
    path: Path
    sha256: str
    notes: tuple[str, ...] = ()
    lines: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    def line_of(self, index: int) -> int:
        """Line in the file, from 1, of the row with this index; for Parquet the row, from 1."""
        return int(self.lines[index]) if self.lines.size else index + 1


def read_recording(path: str | Path, kind: str, config: Any = None) -> Recording:
    """Read a recording and check that it can be what it claims to be.

    Parameters
    ----------
    path : path
        A CSV file, plain or packed with gzip, or a Parquet file with the same columns.
    kind : {"press", "rig", "speedloss"}
        What it is a recording of.
    config : Config, optional
        Names, units and dialect of the bench's files.

    Raises
    ------
    InputError
        With everything that is wrong, each with its line.
    """
    path = Path(path)
    data = read_bytes(path)
    digest = sha256(data)
    options = ReadOptions.of(config, kind)
    if data[:4] == b"PAR1":
        columns, notes = _from_parquet(data, path, kind, options)
        return Recording(kind, columns, path, digest, notes)
    text = decode(unpacked(data, path), str(path), options.encoding)
    return _from_csv(text, path, kind, options, digest)


def columns_of(frame: Any, kind: str, config: Any = None) -> dict[str, np.ndarray]:
    """Columns of a recording that is in memory, checked as those of a file.

    Parameters
    ----------
    frame : DataFrame, pyarrow Table, mapping or Recording
        The samples; other columns than those of the kind are left out.
    kind : {"press", "rig", "speedloss"}
        What it is a recording of.
    config : Config, optional
        Names and units of the columns.

    Raises
    ------
    InputError
        With everything that is wrong, each with its row.
    """
    if isinstance(frame, Recording):
        frame = frame.columns
    return _checked_frame(frame, kind, "frame", ReadOptions.of(config, kind))[0]


def _from_csv(text: str, path: Path, kind: str, options: ReadOptions, digest: str) -> Recording:
    name, table = str(path), schemas.table(kind)
    in_file = {c.name: options.names.get(c.name, c.name) for c in table.columns}
    found = layout(text, name, options, in_file.values())
    header_line = found.first_line - 1 - options.units_row
    problems = Problems()
    check_header(found.header, in_file, table, f"{name}:{header_line}", problems)
    if problems.count and (later := header_further_down(found, in_file.values())):
        setting = f"dialect: {{skip_lines: {later - 1}}}"
        problems.add(f"{name}:{later}: the header seems to stand here, set {setting}")
    problems.raise_if_any()
    wanted = {
        ours: Wanted(found.header.index(theirs), table.column(ours).dtype == "string", shown)
        for ours, theirs in in_file.items()
        if theirs in found.header
        for shown in [ours if ours == theirs else f'{ours} (column "{theirs}")']
    }
    conversions, notes = csv_conversions(found, wanted, table, options, name, problems)
    problems.raise_if_any()
    rows = read_rows(found, wanted, name, problems)
    if problems.count and len(rows.lines) == 0:
        problems.raise_if_any()
    columns = _completed(rows.columns, table, len(rows.lines))
    _convert(columns, conversions)

    def place(index: int) -> tuple[str, int]:
        line = int(rows.lines[index])
        return f"{name}:{line}", line

    notes += Checker(name, columns, table, place, problems).run({*options.units, *conversions})
    if problems.count:
        hint_units_row(found, wanted, name, problems)
    problems.raise_if_any()
    left_out = [n for n in found.header if n and n not in in_file.values()]
    if left_out:
        notes.append("columns left out: " + ", ".join(left_out[:12]))
    return Recording(kind, columns, path, digest, (*found.notes, *notes), rows.lines)


def csv_conversions(
    found: Layout,
    wanted: Mapping[str, Wanted],
    table: schemas.Table,
    options: ReadOptions,
    name: str,
    problems: Problems,
) -> tuple[dict[str, Conversion], list[str]]:
    """Conversions stated by the config, else by the row of units."""
    conversions: dict[str, Conversion] = {}
    notes: list[str] = []
    for ours, w in wanted.items():
        target = table.column(ours).unit
        cell = found.unit_cells[w.index] if w.index < len(found.unit_cells) else ""
        unit = options.units.get(ours) or cell
        if w.is_text or canonical_unit(unit) in ("", "-", "1"):
            continue
        known = conversion(unit, target)
        if known is None:
            problems.add(
                f"{name}:{found.first_line - 1}: {w.shown} is in {unit}, must be one of "
                + ", ".join(allowed_units(target))
            )
            continue
        conversions[ours] = known
        if canonical_unit(unit) != target:
            notes.append(f"{w.shown} converted from {unit} to {target}")
    return conversions, notes


def _convert(columns: dict[str, np.ndarray], conversions: Mapping[str, Conversion]) -> None:
    for column, by in conversions.items():
        if by != Conversion(1.0):
            columns[column] = (columns[column] + by.shift) * by.factor


def _completed(
    columns: Mapping[str, np.ndarray], table: schemas.Table, length: int
) -> dict[str, np.ndarray]:
    """Columns in the order of the schema; an optional one that is absent is all nan."""
    return {c.name: columns.get(c.name, np.full(length, np.nan)) for c in table.columns}


def _from_parquet(
    data: bytes, path: Path, kind: str, options: ReadOptions
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Columns of a Parquet file: an artifact of ours (simulated) or one with the same columns."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    from beltid.store.artifacts import SEAL_KEY, artifact_from_bytes

    try:
        file = pq.ParquetFile(pa.BufferReader(data), page_checksum_verification=True)
        sealed = SEAL_KEY in (file.schema_arrow.metadata or {})
        frame = None if sealed else file.read(use_threads=False)
    except Exception as error:  # a damaged file can raise nearly anything
        reason = " ".join(str(error).split())[:120]
        raise InputError(f"{path}: damaged: {reason or type(error).__name__}") from None
    if sealed:
        needed = "simulated" if kind == "rig" else None
        artifact = artifact_from_bytes(data, path, needed)
        if needed is None:
            raise InputError(f"{path}: is a {artifact.kind} artifact, a {kind} recording is needed")
        frame, options = artifact.columns, ReadOptions()
    return _checked_frame(frame, kind, str(path), options, units_known=sealed)


def _checked_frame(
    frame: Any, kind: str, name: str, options: ReadOptions, *, units_known: bool = False
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    table = schemas.table(kind)
    problems = Problems()
    columns = columns_of_frame(frame, table, name, options.names, problems)
    problems.raise_if_any()
    length = len(next(iter(columns.values())))
    columns = _completed(columns, table, length)
    conversions = {
        ours: known
        for ours, unit in options.units.items()
        if (known := conversion(unit, table.column(ours).unit))
    }
    _convert(columns, conversions)

    def place(index: int) -> tuple[str, int]:
        return f"{name}, row {index + 1}", index + 1

    stated = table.names if units_known else conversions
    notes = Checker(name, columns, table, place, problems).run(stated)
    problems.raise_if_any()
    return columns, tuple(notes)
