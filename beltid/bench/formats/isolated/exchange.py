"""A bench file as bytes between two processes: arrays and JSON, never pickled objects."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.formats.bench_file import BenchFile, Channel, Field, Group

_META: Final = "meta"


def save(file: BenchFile, path: Path) -> None:
    """Write what was found in a file; an array that several channels share is written once."""
    arrays: dict[str, np.ndarray] = {}

    def as_json(value: Any) -> Any:
        if not isinstance(value, np.ndarray):
            return {field.name: getattr(value, field.name) for field in fields(value)}
        key = f"array {id(value)}"
        arrays[key] = _writable(value)
        return key

    meta = json.dumps(file, default=as_json)
    arrays[_META] = np.frombuffer(meta.encode(), dtype=np.uint8)
    with path.open("wb") as target:
        np.savez(target, **arrays)  # type: ignore[arg-type]


def load(path: Path) -> BenchFile:
    """Read what `save` wrote."""
    with np.load(path, allow_pickle=False) as arrays:
        meta = json.loads(arrays[_META].tobytes())
        known = {key: _readable(arrays[key]) for key in arrays.files if key != _META}
    groups = tuple(
        Group(
            group["name"],
            tuple(
                Channel(c["name"], c["unit"], known[c["values"]], known.get(c["time_s"]))
                for c in group["channels"]
            ),
            tuple(Field(**field) for field in group["fields"]),
            group["first_row"],
        )
        for group in meta["groups"]
    )
    header = tuple(Field(**field) for field in meta["fields"])
    return BenchFile(meta["format"], groups, header, tuple(meta["notes"]))


def _writable(values: np.ndarray) -> np.ndarray:
    if values.dtype.kind == "O":
        return np.array(["" if v is None else str(v) for v in values], dtype=np.str_)
    return np.asarray(values, dtype=float)


def _readable(values: np.ndarray) -> np.ndarray:
    if values.dtype.kind != "U":
        return values
    texts = np.empty(len(values), dtype=object)
    texts[:] = [str(v) or None for v in values]
    return texts
