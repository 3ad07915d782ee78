"""Artifacts with a right seal and wrong contents, as somebody could write them by hand."""

from __future__ import annotations

import copy
import io
import json
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from beltid.artifacts.artifact import METADATA_KEY, SEAL_KEY
from beltid.artifacts.file_bytes import sha256
from beltid.artifacts.parquet_table import arrow_table, columns_of_arrow, columns_sha256
from beltid.tables import schemas

Columns = dict[str, np.ndarray]
SECTIONS = ("extra", "validity", "settings", "set_aside")
WRONG: tuple[Any, ...] = (
    None,
    "x",
    "",
    True,
    0,
    -1,
    1e308,
    10**400,
    [],
    [None],
    ["x", "y"],
    [1.0, 2.0, 3.0],
    {},
    {"x": {"y": None}},
)
GONE = object()
"""Stands for a key that is left out."""


def unpacked(data: bytes) -> tuple[Columns, dict[str, Any]]:
    """Columns and record of an artifact, even of one that is refused for its figures."""
    arrow = pq.read_table(pa.BufferReader(data))
    record = json.loads(arrow.schema.metadata[METADATA_KEY])
    return columns_of_arrow(arrow, schemas.table(record["kind"]), "forged"), record


def sealed(columns: Columns, record: dict[str, Any]) -> bytes:
    """Bytes of an artifact with these contents and a right seal, whatever they are."""
    table = schemas.table(record["kind"])
    text = json.dumps({**record, "content_sha256": columns_sha256(columns)}).encode()
    about = {METADATA_KEY: text, SEAL_KEY: sha256(text).encode()}
    out = io.BytesIO()
    arrow = arrow_table(columns, table).replace_schema_metadata(about)
    pq.write_table(arrow, pa.PythonFile(out, mode="w"), write_page_checksum=True)
    return out.getvalue()


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Places in a record: every key, the first and the last item of every list."""
    if path:
        yield path
    if isinstance(value, dict):
        for key, item in value.items():
            yield from places(item, (*path, key))
    elif isinstance(value, list) and value:
        for i in dict.fromkeys((0, len(value) - 1)):
            yield from places(value[i], (*path, i))


def changed(record: dict[str, Any], path: tuple[Any, ...], new: Any) -> dict[str, Any]:
    """A record with another value at a place, or without it."""
    record = copy.deepcopy(record)
    at: Any = record
    for key in path[:-1]:
        at = at[key]
    if new is GONE:
        del at[path[-1]]
    else:
        at[path[-1]] = new
    return record


def _with(name: str, change: Callable[[np.ndarray], Any]) -> Callable[[Columns], Columns]:
    return lambda columns: {**columns, name: np.asarray(change(columns[name].copy()))}


def _filled(value: Any) -> Callable[[np.ndarray], np.ndarray]:
    def change(cells: np.ndarray) -> np.ndarray:
        cells[:] = value
        return cells

    return change


def _first(value: Any) -> Callable[[np.ndarray], np.ndarray]:
    def change(cells: np.ndarray) -> np.ndarray:
        cells[:1] = value
        return cells

    return change


def column_changes(
    columns: Columns, kind: str
) -> Iterator[tuple[str, Callable[[Columns], Columns]]]:
    """Changes to the columns of an artifact that its seal does not show."""
    yield "no rows", lambda c: {name: v[:0] for name, v in c.items()}
    yield "one row", lambda c: {name: v[:1] for name, v in c.items()}
    yield "last row", lambda c: {name: v[-1:] for name, v in c.items()}
    yield "rows twice", lambda c: {name: np.concatenate([v, v]) for name, v in c.items()}
    yield "reversed", lambda c: {name: v[::-1].copy() for name, v in c.items()}
    table = schemas.table(kind)
    for name in columns:
        dtype = table.column(name).dtype
        if not table.column(name).required:
            yield f"{name} left out", lambda c, n=name: {k: v for k, v in c.items() if k != n}
        values: tuple[Any, ...] = ()
        if dtype in ("float64", "list"):
            values = (np.nan, 0.0, -1.0, 1e308, 1e-308, 1.0)
        elif dtype == "int64":
            values = (0, -1, 2**62)
        elif dtype == "bool":
            values = (True, False)
        else:
            values = (None, "", "ok", "<script>", "\x1b[31m", "x" * 5000)
        for value in values:
            shown = repr(value)[:20]
            yield f"{name} = {shown}", _with(name, _filled(value))
            yield f"{name}[0] = {shown}", _with(name, _first(value))
        if dtype == "list":
            yield f"{name} of one number", _with(name, lambda v: v[:, :1])
            yield f"{name} of many", _with(name, lambda v: np.hstack([v, v, v]))
            yield f"{name} of none", _with(name, lambda v: v[:, :0])


def forgeries(data: bytes) -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Wrong artifacts that a right one can become: what is wrong in words, and who writes it."""
    columns, record = unpacked(data)
    for what, change in column_changes(columns, record["kind"]):
        yield what, lambda change=change: sealed(change(columns), record)
    for section in SECTIONS:
        for place in places(record[section]):
            for new in (GONE, *WRONG):
                words = "gone" if new is GONE else repr(new)[:20]
                where = ".".join(str(part) for part in (section, *place))
                yield (
                    f"{where} = {words}",
                    lambda at=(section, *place), new=new: sealed(columns, changed(record, at, new)),
                )
