"""A bench file as bytes between two processes: arrays and JSON, never pickled objects."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.formats.bench_file import BenchFile, Channel, Field, Group

_META: Final = "meta"


def save(file: BenchFile, path: Path) -> None:
    """Write what was found in a file."""
    arrays: dict[str, np.ndarray] = {}
    times: dict[int, str] = {}  # channels of one raster share their time
    groups: list[dict[str, Any]] = []
    for group in file.groups:
        channels = []
        for channel in group.channels:
            key = f"v{len(arrays)}"
            arrays[key] = _writable(channel.values)
            time = None
            if channel.time_s is not None:
                time = times.get(id(channel.time_s))
                if time is None:
                    time = times[id(channel.time_s)] = f"t{len(arrays)}"
                    arrays[time] = channel.time_s.astype(float)
            channels.append([channel.name, channel.unit, key, time])
        groups.append(
            {
                "name": group.name,
                "channels": channels,
                "fields": _listed(group.fields),
                "first_row": group.first_row,
            }
        )
    meta = {
        "format": file.format,
        "groups": groups,
        "fields": _listed(file.fields),
        "notes": list(file.notes),
    }
    arrays[_META] = np.frombuffer(json.dumps(meta).encode(), dtype=np.uint8)
    with path.open("wb") as target:
        np.savez(target, **arrays)  # type: ignore[arg-type]


def load(path: Path) -> BenchFile:
    """Read what `save` wrote."""
    with np.load(path, allow_pickle=False) as arrays:
        meta = json.loads(arrays[_META].tobytes())
        times: dict[str, np.ndarray] = {}

        def time_of(key: str | None) -> np.ndarray | None:
            if key is None:
                return None
            if key not in times:
                times[key] = arrays[key]
            return times[key]

        groups = tuple(
            Group(
                group["name"],
                tuple(
                    Channel(name, unit, _readable(arrays[key]), time_of(time))
                    for name, unit, key, time in group["channels"]
                ),
                tuple(Field(*field) for field in group["fields"]),
                group["first_row"],
            )
            for group in meta["groups"]
        )
    fields = tuple(Field(*field) for field in meta["fields"])
    return BenchFile(meta["format"], groups, fields, tuple(meta["notes"]))


def _listed(fields: tuple[Field, ...]) -> list[list[str]]:
    return [[field.name, field.text, field.unit] for field in fields]


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
