"""Files of waveforms: NI TDMS, ASAM MDF, universal files (UFF 58), by their libraries."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from beltid.bench.raw import UNITS, Field, Rasters, Raw, even_times, in_seconds, unapplied_scaling
from beltid.errors import InputError


def read_tdms(path: Path, place: str) -> Iterator[Raw]:
    """Read NI TDMS: a table per group and raster of times, counted from the earliest start."""
    from nptdms import TdmsFile

    with path.open("rb") as stream:  # a stream: an index file beside it may be outdated
        file = TdmsFile.read(stream)
    if file.file_status.incomplete_final_segment:
        raise InputError(f"{place}: damaged: the last segment is cut off")
    channels = [c for group in file.groups() for c in group.channels()]
    starts = [c.properties["wf_start_time"] for c in channels if "wf_start_time" in c.properties]
    origin = np.datetime64(min(starts)) if starts else None
    for group in file.groups():
        about = {**file.properties, **group.properties}.items()
        fields = (Field(str(k), str(v)) for k, v in about if not k.startswith(("wf_", "NI_")))
        rasters = Rasters(place, group.name, "NI TDMS", tuple(fields))
        for channel in group.channels():
            values, properties = channel[:], channel.properties
            unit = next((str(properties[p]) for p in UNITS if p in properties), "")
            if values.dtype.kind == "M":
                values, unit = np.datetime_as_string(values, unit="us"), ""
            times = _waveform(properties, len(values), origin, place)
            rasters.add(channel.name, values, unit, times, unapplied_scaling(values, properties))
        yield from rasters.tables()


def _waveform(
    properties: Mapping[str, Any], n: int, origin: np.datetime64 | None, place: str
) -> np.ndarray | None:
    """Return the times of a channel [s]; LabVIEW writes a step of 0 if it is unknown."""
    step = float(properties.get("wf_increment") or 0.0)
    if not 0 < step < np.inf or not n:
        return None
    unit = str(properties.get("wf_xunit_string", ""))
    offset = float(properties.get("wf_start_offset", 0.0))
    step, offset = (in_seconds(t, unit, place) for t in (step, offset))
    if "wf_start_time" in properties and origin is not None:
        late = np.datetime64(properties["wf_start_time"]) - origin
        offset += float(late / np.timedelta64(1, "us")) * 1e-6
    return even_times(offset, step, n)


def read_mdf(path: Path, place: str) -> Iterator[Raw]:
    """Read ASAM MDF 3 or 4: a table per channel group."""
    from asammdf import MDF

    with MDF(path, use_display_names=False) as file:
        groups: list[Any] = file.groups
        for index, group in enumerate(groups):
            master = file.masters_db.get(index)
            unit = "" if master is None else str(group.channels[master].unit or "")
            name = str(getattr(group.channel_group, "acq_name", "") or "") or f"group {index + 1}"
            rasters = Rasters(place, name, f"ASAM MDF {file.version}")
            for number, channel in enumerate(group.channels):
                if number != master:
                    signal = file.get(group=index, index=number)
                    times = np.asarray(signal.timestamps, float)
                    if len(times) == len(signal.samples) and len(times):
                        seconds = in_seconds(times, unit, place)
                        rasters.add(channel.name, signal.samples, str(signal.unit or ""), seconds)
            yield from rasters.tables()


def read_uff(path: Path, place: str) -> Iterator[Raw]:
    """Read a universal file: its time records in datasets 58, as text or binary."""
    import pyuff

    _refuse_uff(path.read_bytes(), place)
    file = pyuff.UFF(str(path))
    rasters, left_out = Rasters(place, "", "universal file (UFF 58)"), list[str]()
    for number, kind in enumerate(np.atleast_1d(file.get_set_types()).astype(int)):
        record = file.read_sets(number) if kind == 58 else {}
        is_time = record.get("abscissa_spec_data_type") == 17
        if is_time and not np.iscomplexobj(record["data"]):
            _add_record(record, rasters, place)
        else:
            left_out.append(f"dataset {number + 1} ({kind}) left out: no real numbers over time")
    if not rasters.parts:
        raise InputError(f"{place}: no dataset 58 holds real numbers over time")
    rasters.notes += left_out
    yield from rasters.tables()


def _refuse_uff(data: bytes, place: str) -> None:
    """Refuse what the library would read wrong: files that are cut off, numbers of no IEEE form."""
    if not data.rstrip().endswith(b"-1"):
        raise InputError(f"{place}: damaged: the last dataset does not end with -1: cut off")
    for head in re.findall(rb"^ *58b([^\r\n]*)", data, re.MULTILINE | re.IGNORECASE):
        if not re.match(rb"\s*[12]\s+2\b", head):
            raise InputError(f"{place}: binary numbers must be in IEEE 754 format")


def _add_record(record: Mapping[str, Any], rasters: Rasters, place: str) -> None:
    """Add the time record of a dataset 58."""

    def said(key: str) -> str:
        text = str(record.get(key) or "").strip()
        return "" if text.upper() == "NONE" else text

    n, stated = len(record["data"]), int(record["num_pts"])
    if n != stated:
        raise InputError(
            f"{place}: damaged: {n} samples found, the header states {stated}; if they are binary "
            "and spaced unevenly, export them as text"
        )
    times = np.asarray(record["x"], dtype=float)
    if record["abscissa_spacing"]:
        times = even_times(float(record["abscissa_min"]), float(record["abscissa_inc"]), n)
    name = said("id1") or said("ordinate_axis_lab") or f"response {record['rsp_node']}"
    seconds = in_seconds(times, said("abscissa_axis_units_lab"), place)
    rasters.add(name, record["data"], said("ordinate_axis_units_lab"), seconds)
    lines = (Field(f"ID line {i}", said(f"id{i}")) for i in range(2, 6))
    rasters.fields = (*rasters.fields, *(line for line in lines if line.text))
