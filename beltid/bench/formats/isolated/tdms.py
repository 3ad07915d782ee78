"""Read NI TDMS files: groups of channels, each with its own properties, start time and time step.

Runs in the child process (see `process`). The file is opened as a stream, so that the library
ignores an index file next to it, which may be outdated.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.formats.bench_file import (
    BenchFile,
    Channel,
    Field,
    Group,
    even_times,
    in_seconds,
    unapplied_scaling,
)
from beltid.errors import InputError

UNIT_PROPERTIES: Final = ("unit_string", "NI_UnitDescription", "Unit", "unit", "Units", "units")
_WAVEFORM: Final = ("wf_", "NI_")


def read(path: Path) -> BenchFile:
    """Read a TDMS file."""
    from nptdms import TdmsFile

    with path.open("rb") as stream:
        file = TdmsFile.read(stream)
        if getattr(file, "incomplete_data", False) or _status_incomplete(file):
            raise InputError("damaged: the last segment is cut off")
        origin = _first_start(file)
        groups = []
        for group in file.groups():
            times: dict[tuple[Any, ...], np.ndarray] = {}
            channels = tuple(
                converted
                for channel in group.channels()
                if (converted := _channel(channel, origin, times)) is not None
            )
            if channels:
                groups.append(Group(group.name, channels, _fields(group.properties)))
        start_fields = () if origin is None else (Field("wf_start_time", str(origin)),)
        return BenchFile("NI TDMS", tuple(groups), (*_fields(file.properties), *start_fields))


def _status_incomplete(file: Any) -> bool:
    status = getattr(file, "file_status", None)
    return bool(getattr(status, "incomplete_final_segment", False))


def _first_start(file: Any) -> np.datetime64 | None:
    """Return the earliest start of a waveform, from which all times are counted."""
    starts = [
        np.datetime64(channel.properties["wf_start_time"])
        for group in file.groups()
        for channel in group.channels()
        if "wf_start_time" in channel.properties
    ]
    return min(starts) if starts else None


def _channel(
    channel: Any, origin: np.datetime64 | None, times: dict[tuple[Any, ...], np.ndarray]
) -> Channel | None:
    values = channel[:]
    if len(values) == 0:
        return None
    unit = next(
        (str(channel.properties[p]) for p in UNIT_PROPERTIES if p in channel.properties), ""
    )
    if getattr(values, "dtype", None) is not None and values.dtype.kind == "M":
        values, unit = np.datetime_as_string(values, unit="us"), ""
    if values.dtype.kind in "OUS":
        texts = np.empty(len(values), dtype=object)
        texts[:] = [str(v) for v in values]
        return Channel(channel.name, unit, texts)
    if values.dtype.kind == "c":
        return None
    return Channel(
        channel.name,
        unit,
        np.asarray(values, dtype=float),
        _time(channel, len(values), origin, times),
        unapplied_scaling(values, channel.properties),
    )


def _time(
    channel: Any,
    length: int,
    origin: np.datetime64 | None,
    times: dict[tuple[Any, ...], np.ndarray],
) -> np.ndarray | None:
    properties = channel.properties
    step = properties.get("wf_increment")
    if step is None:
        return None
    step = float(step)
    if not step > 0 or not np.isfinite(step):
        return None  # LabVIEW writes 0 if the step is unknown
    unit = str(properties.get("wf_xunit_string", ""))
    step, offset = (
        in_seconds(t, unit) for t in (step, float(properties.get("wf_start_offset", 0.0)))
    )
    start = properties.get("wf_start_time")
    if start is not None and origin is not None:
        offset += float((np.datetime64(start) - origin) / np.timedelta64(1, "us")) * 1e-6
    key = (offset, step, length)
    if key not in times:
        times[key] = even_times(offset, step, length)
    return times[key]


def _fields(properties: Mapping[str, Any]) -> tuple[Field, ...]:
    return tuple(
        Field(str(name), str(value))
        for name, value in properties.items()
        if not str(name).startswith(_WAVEFORM)
    )
