"""Files of waveforms: NI TDMS, ASAM MDF, universal files (UFF 58), by their libraries."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections import Counter
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
            scaling = unapplied_scaling(values, properties)
            rasters.add(channel.name, values, unit, times, scaling)
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
        fields = _comments(str(getattr(file.header, "comment", "") or ""))
        groups: list[Any] = file.groups
        for index, group in enumerate(groups):
            master = file.masters_db.get(index)
            unit = "" if master is None else str(group.channels[master].unit or "")
            name = str(getattr(group.channel_group, "acq_name", "") or "") or f"group {index + 1}"
            rasters = Rasters(place, name, f"ASAM MDF {file.version}", fields)
            for number, channel in enumerate(group.channels):
                if number != master:
                    signal = file.get(group=index, index=number)
                    times = np.asarray(signal.timestamps, float)
                    if len(times) == len(signal.samples) and len(times):
                        seconds = in_seconds(times, unit, place)
                        rasters.add(channel.name, signal.samples, str(signal.unit or ""), seconds)
            yield from rasters.tables()


def _comments(comment: str) -> tuple[Field, ...]:
    """Read the properties in the XML comment of a header; no entities are expanded."""
    if "<" not in comment or "<!" in comment:
        return (Field("comment", comment.strip()),) if comment.strip() else ()
    try:
        entries = list(ElementTree.fromstring(comment).iter())
    except ElementTree.ParseError:
        return ()
    named = [e for e in entries if e.tag.rpartition("}")[2] == "e" and e.get("name")]
    return tuple(Field(e.get("name", ""), (e.text or "").strip(), e.get("unit", "")) for e in named)


def read_uff(path: Path, place: str) -> Iterator[Raw]:
    """Read a universal file: its time records in datasets 58, as text or binary."""
    import pyuff

    _refuse_uff(path.read_bytes(), place)
    file = pyuff.UFF(str(path))
    rasters, left_out = Rasters(place, "", "universal file (UFF 58)"), Counter[str]()
    fields: dict[str, Field] = {}
    for number, kind in enumerate(np.atleast_1d(file.get_set_types()).astype(int)):
        record = file.read_sets(number) if kind == 58 else {}
        if kind != 58:
            left_out[f"dataset {kind}"] += 1
        elif record["abscissa_spec_data_type"] != 17:
            left_out["a function that is not of time"] += 1
        elif np.iscomplexobj(record["data"]):
            left_out["a function with complex values"] += 1
        else:
            _add_record(record, rasters, fields, place)
    notes = [f"{what} left out ({n} times)" for what, n in left_out.items()]
    if not rasters.parts:
        held = "; ".join(notes) or "nothing"
        raise InputError(f"{place}: holds no time record of real numbers in a dataset 58: {held}")
    rasters.notes += notes
    rasters.fields = tuple(fields.values())
    yield from rasters.tables()


def _refuse_uff(data: bytes, place: str) -> None:
    """Refuse what the library would read wrong: files that are cut off, numbers of no IEEE form."""
    if not data.rstrip().endswith(b"-1"):
        raise InputError(f"{place}: damaged: the last dataset does not end with -1: cut off")
    for head in re.findall(rb"^ *58b([^\r\n]*)", data, re.MULTILINE | re.IGNORECASE):
        order, form = (head.split() + [b""] * 2)[:2]
        if order not in (b"1", b"2") or form != b"2":
            raise InputError(f"{place}: binary numbers must be in IEEE 754 format")


def _add_record(
    record: Mapping[str, Any], rasters: Rasters, fields: dict[str, Field], place: str
) -> None:
    """Add the time record of a dataset 58."""
    said = {
        k: "" if v.strip().upper() == "NONE" else v.strip()
        for k, v in record.items()
        if isinstance(v, str)
    }
    n, stated = len(record["data"]), int(record["num_pts"])
    if n != stated:
        raise InputError(
            f"{place}: damaged: {n} samples found, the header states {stated}; if they are binary "
            "and spaced unevenly, export them as text"
        )
    times = np.asarray(record["x"], dtype=float)
    if record["abscissa_spacing"]:
        times = even_times(float(record["abscissa_min"]), float(record["abscissa_inc"]), n)
    names = (said.get("id1"), said.get("ordinate_axis_lab"), f"response {record['rsp_node']}")
    seconds = in_seconds(times, said.get("abscissa_axis_units_lab", ""), place)
    unit = said.get("ordinate_axis_units_lab", "")
    rasters.add(next(filter(None, names)), record["data"], unit, seconds)
    lines = {f"ID line {i}": said.get(f"id{i}") for i in range(2, 6)}
    fields |= {name: Field(name, text) for name, text in lines.items() if text}
