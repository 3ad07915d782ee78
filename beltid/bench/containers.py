"""Files of waveforms: NI TDMS, ASAM MDF, universal files (UFF 58), by their libraries."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from beltid.bench.raw import (
    UNITS,
    Field,
    Raw,
    column_of,
    even_times,
    in_seconds,
    unapplied_scaling,
)
from beltid.errors import InputError


class Rasters:
    """Channels of a group: those with the same times are one table.

    Parameters
    ----------
    place, name, form : str
        File and group, and the format in words.
    fields : tuple of Field
        Entries of the header.
    """

    def __init__(self, place: str, name: str, form: str, fields: tuple[Field, ...] = ()) -> None:
        self.place, self.name, self.form, self.fields = place, name, form, fields
        self.notes: list[str] = []
        self.parts: dict[Any, tuple[dict[str, Any], dict[str, str], dict[str, str], Any]] = {}

    def add(
        self, name: str, values: Any, unit: str = "", times: Any = None, scaling: str = ""
    ) -> None:
        """Add a channel; one that is no list of numbers or texts is left out and noted."""
        values = np.asarray(values)
        if values.ndim != 1 or values.dtype.kind not in "biufOSU":
            self.notes.append(f"channel {name} left out: no plain numbers")
            return
        if not values.size:
            return
        key = (values.size, None if times is None else (float(times[0]), float(times[-1])))
        columns, units, scalings, _ = self.parts.setdefault(key, ({}, {}, {}, times))
        number = 2
        while name in columns:
            name, number = f"{name.partition(' #')[0]} #{number}", number + 1
        columns[name], units[name], scalings[name] = column_of(values), unit, scaling

    def tables(self) -> Iterator[Raw]:
        """Yield a table per raster."""
        for columns, units, scalings, times in self.parts.values():
            yield Raw(
                self.place,
                pd.DataFrame(columns),
                self.name,
                self.form,
                {n: u for n, u in units.items() if u},
                self.fields,
                times,
                {n: s for n, s in scalings.items() if s},
                notes=tuple(self.notes),
            )


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
        properties = {**file.properties, **group.properties}
        rasters = Rasters(place, group.name, "NI TDMS", _fields(properties))
        for channel in group.channels():
            values, unit = channel[:], _unit(channel.properties)
            if values.dtype.kind == "M":
                values, unit = np.datetime_as_string(values, unit="us"), ""
            times = _waveform(channel.properties, len(values), origin, place)
            scaling = unapplied_scaling(values, channel.properties)
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


def _unit(properties: Mapping[str, Any]) -> str:
    return next((str(properties[p]) for p in UNITS if p in properties), "")


def _fields(properties: Mapping[str, Any]) -> tuple[Field, ...]:
    shown = {k: v for k, v in properties.items() if not k.startswith(("wf_", "NI_"))}
    return tuple(Field(str(name), str(value)) for name, value in shown.items())


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
                    if len(times) != len(signal.samples) or not len(times):
                        continue
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
    kinds = np.atleast_1d(file.get_set_types()).astype(int)
    rasters = Rasters(place, "", "universal file (UFF 58)")
    left_out: dict[str, int] = {}
    fields: dict[str, Field] = {}
    for number, kind in enumerate(kinds):
        record = file.read_sets(number) if kind == 58 else {}
        if kind != 58:
            reason = f"dataset {kind}"
        elif record["abscissa_spec_data_type"] != 17:
            reason = "a function that is not of time"
        elif np.iscomplexobj(record["data"]):
            reason = "a function with complex values"
        else:
            _add_record(record, rasters, fields, place)
            continue
        left_out[reason] = left_out.get(reason, 0) + 1
    notes = [
        f"{what} left out" + (f" ({n} times)" if n > 1 else "") for what, n in left_out.items()
    ]
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

    def said(key: str) -> str:
        text = str(record.get(key, "")).strip()
        return "" if text.upper() == "NONE" else text

    n, stated = len(record["data"]), int(record["num_pts"])
    if n != stated:
        raise InputError(
            f"{place}: damaged: {n} samples found, the header states {stated}; if they are binary "
            "and spaced unevenly, export them as text"
        )
    if record["abscissa_spacing"]:
        times = even_times(float(record["abscissa_min"]), float(record["abscissa_inc"]), n)
    else:
        times = np.asarray(record["x"], dtype=float)
    name = said("id1") or said("ordinate_axis_lab") or f"response {record['rsp_node']}"
    seconds = in_seconds(times, said("abscissa_axis_units_lab"), place)
    rasters.add(name, record["data"], said("ordinate_axis_units_lab"), seconds)
    for i in range(2, 6):
        if text := said(f"id{i}"):
            fields[f"ID line {i}"] = Field(f"ID line {i}", text)
