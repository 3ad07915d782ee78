"""Read ASAM MDF 3 and 4: every channel group has its own raster. Runs in the child process."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np

from beltid.bench.formats.bench_file import BenchFile, Channel, Field, Group, in_seconds
from beltid.errors import InputError


def read(path: Path) -> BenchFile:
    """Read an MDF file; channels with more than one dimension are left out and noted."""
    from asammdf import MDF

    notes: list[str] = []
    with MDF(path, use_display_names=False) as file:
        if getattr(file, "_mapped_file", None) is None and not file.groups:
            raise InputError("holds no channel group")
        groups = [
            group
            for index in range(len(file.groups))
            if (group := _group(file, index, notes)) is not None
        ]
        version = str(file.version)
        fields = _fields(str(getattr(file.header, "comment", "") or ""))
        fields += (Field("Start time", file.header.start_time.isoformat(" ")),)
    return BenchFile(f"ASAM MDF {version}", tuple(groups), fields, tuple(notes))


def _group(file: Any, index: int, notes: list[str]) -> Group | None:
    group = file.groups[index]
    master = file.masters_db.get(index)
    channels: list[Channel] = []
    time: np.ndarray | None = None
    for number, channel in enumerate(group.channels):
        if number == master:
            continue
        signal = file.get(group=index, index=number)
        samples = signal.samples
        if samples.dtype.kind not in "biufSU" or samples.ndim != 1:
            notes.append(f"channel {channel.name} left out: no plain numbers")
            continue
        if len(samples) == 0:
            continue
        if time is None or len(time) != len(signal.timestamps):
            unit = "" if master is None else str(group.channels[master].unit or "")
            time = in_seconds(np.asarray(signal.timestamps, dtype=float), unit)
        channels.append(
            Channel(
                channel.name,
                str(signal.unit or ""),
                _values(samples),
                time if len(time) else None,
            )
        )
    if not channels:
        return None
    name = str(getattr(group.channel_group, "acq_name", "") or "")
    return Group(name or f"group {index + 1}", tuple(channels))


def _values(samples: np.ndarray) -> np.ndarray:
    if samples.dtype.kind not in "SU":
        return np.asarray(samples, dtype=float)
    texts = np.empty(len(samples), dtype=object)
    texts[:] = [
        (s.decode("utf-8", "replace") if isinstance(s, bytes) else str(s)).strip("\0 ") or None
        for s in samples
    ]
    return texts


def _fields(comment: str) -> tuple[Field, ...]:
    """Read the properties in the XML comment of a header."""
    if "<" not in comment or "<!" in comment:  # no entities are expanded
        return (Field("comment", comment.strip()),) if comment.strip() else ()
    try:
        root = ElementTree.fromstring(comment)
    except ElementTree.ParseError:
        return ()
    return tuple(
        Field(name, (entry.text or "").strip(), entry.get("unit", ""))
        for entry in root.iter()
        if entry.tag.rpartition("}")[2] == "e" and (name := entry.get("name"))
    )
