"""Binary formats and LabVIEW measurements: a table per group, struct, raster or segment.

Waveforms (TDMS, MDF, universal files, LVM) have times of their own. Of variables (MATLAB, HDF5) a
vector is a column, a number or text a header field. Parquet is read like a table in memory.
"""

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from beltid.bench.files import as_utf8
from beltid.bench.raw import POSITION, Field, NumberSigns, Raw, numbers_of
from beltid.config.model import DialectSection
from beltid.errors import SHOWN, InputError, Problems
from beltid.tables.units import CONVERSIONS, T, conversion

SCALING = {  # properties that scale counts of a converter -> the value without effect
    **dict.fromkeys(("slope", "scale", "scaling", "factor", "gain", "multiplier", "lsb"), 1.0),
    **dict.fromkeys(("offset", "intercept", "y_intercept", "bias", "add_offset"), 0.0),
    "scale_factor": 1.0,
}
TIME = "time_s"  # name of the times of samples, if a format has them besides its channels
UNITS = ("unit_string", "NI_UnitDescription", "unit", "Unit", "units", "Units")  # keys
Variables = Mapping[str, "Written | Variables"]
# The header line that names the separator, which is written with the separator itself
_SEPARATOR = re.compile(r"^Separator(.)(?:Tab|Comma|Space)\b", re.MULTILINE | re.IGNORECASE)
_TECHNICAL = re.compile(  # header keys that describe the format, not the measurement
    r"LabVIEW Measurement|(Writer|Reader)_Version|(Decimal_)?Separator|Multi_Headings|X_Columns|"
    r"Time_Pref|Channels|Samples|X0|Delta_X|[XY]_Dimension|[XY]_Unit_Label|\*\*\*.*|Date|Time"
)
Header = dict[str, list[str]]  # key -> its cells, one per channel


class Written(NamedTuple):
    """A channel as a file holds it."""

    name: str
    values: Any
    unit: str = ""
    times: np.ndarray | None = None  # [s]
    scaling: str = ""  # stated, but not applied


def tables_of(
    place: str,
    name: str,
    form: str,
    channels: Iterable[Written],
    fields: Iterable[Field] = (),
    notes: Sequence[str] = (),
) -> list[Raw]:
    """Return the channels of a group, those with the same times in a table; note the others."""
    parts, left_out = dict[Any, Raw](), [*notes]
    for channel in channels:
        values, times = np.asarray(channel.values), channel.times
        if values.ndim != 1 or values.dtype.kind not in "biufOSUM":
            left_out.append(f"channel {channel.name} left out: no plain numbers")
        elif values.size:
            key = (values.size, None if times is None else (float(times[0]), float(times[-1])))
            time, units = ({}, {}) if times is None else ({TIME: times}, {TIME: "s"})
            raw = parts.setdefault(key, Raw(place, pd.DataFrame(time), name, form, units))
            alike = sum(POSITION.sub("", str(known)) == channel.name for known in raw.frame)
            own = f"{channel.name} #{alike + 1}" if alike else channel.name
            raw.frame[own] = column_of(values)
            raw.units[own], raw.scaling[own] = channel.unit, channel.scaling
    said, notes = tuple(fields), tuple(left_out)
    return [replace(raw, fields=said, notes=notes) for raw in parts.values()]


def column_of(values: np.ndarray) -> Any:
    """Return values as a column of a `Raw`: numbers as float64, all else as texts or None."""
    if values.dtype.kind in "iuf":
        return values.astype(float)
    if values.dtype.kind == "b":
        values = np.where(values, "true", "false")
    if values.dtype.kind == "M":
        values = np.datetime_as_string(values, unit="us")
    texts = [str(plain(value)).strip("\0 ") or None for value in values.tolist()]
    return pd.array(texts, dtype="str")


def plain(value: Any) -> Any:
    """Return a value of one element as an object of Python, bytes as text."""
    value = np.ravel(value)[0] if np.size(value) == 1 and not isinstance(value, str) else value
    value = value.item() if hasattr(value, "item") else value
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def written(
    name: str, values: Any, about: Mapping[str, Any], times: np.ndarray | None = None
) -> Written:
    """Return a channel with its unit and scaling, as its properties say: ``slope = 0.02``."""
    found = []
    for word, value in about.items() if values.dtype.kind in "iu" else ():
        if (neutral := SCALING.get(str(word).lower())) is not None and np.size(value) == 1:
            number = pd.to_numeric(pd.Series(np.ravel(value)), errors="coerce").iloc[0]
            if number == number and number != neutral:
                found.append(f"{word} = {number:g}")
    unit = next((str(plain(about[p])) for p in UNITS if p in about), "")
    return Written(name, values, unit, times, ", ".join(found))


def even_times(start_s: float, step_s: float, n: int) -> np.ndarray:
    """Return the times of evenly spaced samples [s], rounded: 3 * 0.02 is 0.06, as if listed."""
    return np.round(start_s + step_s * np.arange(n), 12)


def in_seconds(times: T, unit: str, place: str) -> T:
    """Convert times to seconds, also without a unit; InputError for a unit of no time."""
    by = conversion(unit, "s") or conversion(unit.lower(), "s")
    if by is None and unit.strip():
        raise InputError(
            f"{place}: the time is in {unit.strip()}, must be one of {', '.join(CONVERSIONS['s'])}"
        )
    return times if by is None or by.factor == 1.0 else by.apply(times)


# --- channels over time ------------------------------------------------------------------------


def read_tdms(path: Path, place: str) -> Iterator[Raw]:
    """Read NI TDMS: a table per group and raster of times, counted from the earliest start."""
    from nptdms import TdmsFile

    with path.open("rb") as stream:  # a stream: an index file beside it may be outdated
        file = TdmsFile.read(stream)
    if file.file_status.incomplete_final_segment:
        raise InputError(f"{place}: damaged: the last segment is cut off")
    every = (channel.properties for group in file.groups() for channel in group.channels())
    starts = (about["wf_start_time"] for about in every if "wf_start_time" in about)
    origin = np.datetime64(min(starts, default="NaT"))
    for group in file.groups():
        said = {**file.properties, **group.properties}.items()
        fields = (Field(str(k), str(v)) for k, v in said if not k.startswith(("wf_", "NI_")))
        found = list[Written]()
        for channel in group.channels():
            values, about, times = channel[:], channel.properties, None
            step = float(about.get("wf_increment") or 0.0)  # LabVIEW writes 0 if it is unknown
            if 0 < step < np.inf and len(values):
                written_s = np.array([step, float(about.get("wf_start_offset", 0.0))])
                step, offset = in_seconds(written_s, str(about.get("wf_xunit_string", "")), place)
                if "wf_start_time" in about:
                    late = np.datetime64(about["wf_start_time"]) - origin
                    offset += float(late / np.timedelta64(1, "us")) * 1e-6
                times = even_times(offset, step, len(values))
            found.append(written(channel.name, values, about, times))
        yield from tables_of(place, group.name, "NI TDMS", found, fields)


def read_mdf(path: Path, place: str) -> Iterator[Raw]:
    """Read ASAM MDF 3 or 4: a table per channel group."""
    from asammdf import MDF

    with MDF(path, use_display_names=False) as file:
        groups: list[Any] = file.groups
        for index, group in enumerate(groups):
            master = file.masters_db.get(index)
            unit = "" if master is None else str(group.channels[master].unit or "")
            name = str(getattr(group.channel_group, "acq_name", "") or "") or f"group {index + 1}"
            found = list[Written]()
            for number, channel in enumerate(group.channels):
                if number != master:
                    signal = file.get(group=index, index=number)
                    times = np.asarray(signal.timestamps, float)
                    if len(times) == len(signal.samples) and len(times):
                        seconds, own = in_seconds(times, unit, place), str(signal.unit or "")
                        found.append(Written(channel.name, signal.samples, own, seconds))
            yield from tables_of(place, name, f"ASAM MDF {file.version}", found)


def read_uff(path: Path, place: str) -> Iterator[Raw]:
    """Read a universal file: its time records in datasets 58, as text or binary."""
    import pyuff

    data = path.read_bytes()  # what the library would read wrong is refused
    if not data.rstrip().endswith(b"-1"):
        raise InputError(f"{place}: damaged: the last dataset does not end with -1: cut off")
    heads = re.findall(rb"^ *58b([^\r\n]*)", data, re.MULTILINE | re.IGNORECASE)
    if not all(re.match(rb"\s*[12]\s+2\b", head) for head in heads):
        raise InputError(f"{place}: binary numbers must be in IEEE 754 format")
    file, found, left_out = pyuff.UFF(str(path)), list[Written](), list[str]()
    for number, kind in enumerate(np.atleast_1d(file.get_set_types()).astype(int)):
        record = file.read_sets(number) if kind == 58 else {}
        if record.get("abscissa_spec_data_type") != 17 or np.iscomplexobj(record["data"]):
            left_out.append(f"dataset {number + 1} ({kind}) left out: no real numbers over time")
            continue
        said = {k: v.strip() for k, v in record.items() if isinstance(v, str)}
        said = {k: text for k, text in said.items() if text.upper() not in ("", "NONE")}
        n, stated = len(record["data"]), int(record["num_pts"])
        if n != stated:
            raise InputError(
                f"{place}: damaged: {n} samples found, the header states {stated}; if they are "
                "binary and spaced unevenly, export them as text"
            )
        even = even_times(float(record["abscissa_min"]), float(record["abscissa_inc"]), n)
        times = even if record["abscissa_spacing"] else np.asarray(record["x"], dtype=float)
        times = in_seconds(times, said.get("abscissa_axis_units_lab", ""), place)
        name = said.get("id1") or said.get("ordinate_axis_lab") or f"response {record['rsp_node']}"
        found.append(Written(name, record["data"], said.get("ordinate_axis_units_lab", ""), times))
    if not found:
        raise InputError(f"{place}: no dataset 58 holds real numbers over time")
    yield from tables_of(place, "", "universal file (UFF 58)", found, notes=left_out)


# --- LabVIEW measurements ------------------------------------------------------------------------


def read_lvm(path: Path, place: str, dialect: DialectSection) -> Iterator[Raw]:
    """Read a LabVIEW measurement; segments without a gap between them are one table."""
    data, encoding, notes = as_utf8(bytearray(path.read_bytes()), place, dialect.encoding)
    text = data.decode()
    sign = stated[1] if (stated := _SEPARATOR.search(text, 0, 10_000)) else "\t"
    lines = [[cell.strip() for cell in line.split(sign)] for line in text.split("\n")]
    starts = [i for i, cells in enumerate(lines) if cells[0].startswith("X_Value")]
    problems, parts, end = Problems(), list[tuple[Raw, float]](), 0
    own = Header()
    for at, last in itertools.pairwise([*starts, len(lines)]):
        own |= {cells[0]: [*cells[1:]] for cells in lines[end:at] if cells[0]}
        end = next(
            (i for i in range(at + 1, last) if not any(lines[i]) or lines[i][0] == "Channels"), last
        )
        clock = f"{_cell(own, 'Date')} {_cell(own, 'Time').replace(',', '.')}"
        told = pd.to_datetime(re.sub(r"(\.\d{9})\d+", r"\1", clock), errors="coerce")
        start = float("nan") if pd.isna(told) else float(told.timestamp())  # [s from 1970-01-01]
        new = [(raster, start) for raster in _segment(lines, (at, end), own, place, problems)]
        if parts and len(new) == 1 and (whole := _continued(*parts[-1], *new[0])):
            parts, new = parts[:-1], [whole]
        parts += new
        if len(problems.found) > SHOWN:
            break
    problems.raise_if_any()
    if not parts:
        raise InputError(f"{place}: holds no samples, only a header")
    for number, (raw, _) in enumerate(parts, start=1):
        name = f"segment {number}" if len(parts) > 1 else ""
        yield replace(raw, name=name, encoding=encoding, notes=tuple(notes))


def _cell(header: Header, key: str, k: int = 0) -> str:
    return next(iter(header.get(key, [])[k : k + 1]), "")


def _segment(
    lines: Sequence[Sequence[str]],
    span: tuple[int, int],
    header: Header,
    place: str,
    problems: Problems,
) -> list[Raw]:
    """Read the rows of one segment, a table per raster of times."""
    at, end = span
    names = [*itertools.takewhile(lambda name: name not in ("", "Comment"), lines[at])]
    if (rows := lines[at + 1 : end]) and len(rows[-1]) < len(names) and end >= len(lines) - 1:
        problems.add(f"{place}:{end}: the last row is cut off")
    signs = NumberSigns("," if _cell(header, "Decimal_Separator") == "," else ".")
    cells = pd.DataFrame(rows, dtype="str").reindex(columns=range(len(names)))
    own = Raw(place, cells, lines=range(at + 2, end + 1))
    columns = [numbers_of(cells[i], signs, name, own.at, problems) for i, name in enumerate(names)]
    kind = _cell(header, "X_Columns").lower() or "one"
    is_multi = kind == "multi"
    pairs = [(i * is_multi, i + 1) for i in range(0, len(names) - 1, 1 + is_multi)]
    between = (cells[1::2] for key, cells in header.items() if _TECHNICAL.fullmatch(key))
    if is_multi and not any(map(any, between)):  # a blank above the times of each channel
        header = {key: cells[::2] for key, cells in header.items()}
    found = list[Written]()
    for k, (x, y) in enumerate(pairs):
        if (stated := _cell(header, "Samples", k)).isdecimal() and int(stated) > len(rows):
            problems.add(
                f"{place}:{end}: {names[y]} has {len(rows)} samples, its header states {stated}: "
                "the file is cut off"
            )
        values = columns[y][: np.max(np.flatnonzero(~np.isnan(columns[y])), initial=-1) + 1]
        listed = columns[x][: values.size] if kind != "no" else np.full(values.size, np.nan)
        times = _time(listed, header, k, f"{place}, line {at + 1}") if values.size else None
        found.append(Written(names[y], values, _cell(header, "Y_Unit_Label", k), times))
    said = ((key, _cell(header, key)) for key in header if not _TECHNICAL.fullmatch(key))
    fields = [Field(key, cell) for key, cell in said if cell]
    return [
        replace(raw, lines=own.lines[: len(raw.frame)], header_line=at + 1)
        for raw in tables_of(place, "", "LabVIEW measurement (.lvm)", found, fields)
    ]


def _time(listed: np.ndarray, header: Header, k: int, place: str) -> np.ndarray | None:
    """Return the times of a channel [s], as listed or from its start and step."""
    if _cell(header, "X_Dimension", k).lower() not in ("", "time", "zeit"):
        return None
    if np.isnan(listed).all():
        cells = (_cell(header, key, k).replace(",", ".") for key in ("X0", "Delta_X"))
        start, step = pd.to_numeric(pd.Series([*cells]), errors="coerce").fillna(0.0)
        if not step > 0:
            return None
        listed = even_times(start, step, listed.size)
    return in_seconds(listed, _cell(header, "X_Unit_Label", k), place)


def _continued(before: Raw, start: float, after: Raw, later: float) -> tuple[Raw, float] | None:
    """Join segments, and give the clock at time 0; None if the second is not one step behind."""
    if list(before.frame) != list(after.frame) or TIME not in after.frame or len(before.frame) < 2:
        return None
    a, b = (raw.frame[TIME].to_numpy() for raw in (before, after))
    step = (b[-1] - b[0]) / (len(b) - 1) if len(b) > 1 else a[-1] - a[-2]
    gap, shift = b[0] - a[-1] - step, 0.0
    if abs(gap) > 0.5 * step:  # the time restarts: the clocks tell how late
        if start == later or not abs(gap + later - start) <= 1.5 * step:
            return None
        shift = gap
    frame = pd.concat([before.frame, after.frame.assign(**{TIME: b - shift})], ignore_index=True)
    lines = np.concatenate([before.lines, after.lines])
    return replace(before, frame=frame, lines=lines), later + shift


# --- variables -----------------------------------------------------------------------------------


def read_matlab(path: Path, place: str) -> Iterator[Raw]:
    """Read a MATLAB file of version 5."""
    from scipy.io import loadmat

    with path.open("rb") as stream:
        content = loadmat(stream, squeeze_me=True, simplify_cells=True)
    members = _struct({name: of for name, of in content.items() if not name.startswith("__")})
    yield from _tables(members, place, "MATLAB, version 5")


def _struct(members: Mapping[str, Any]) -> Variables:
    """Return the members of a struct; one named units may hold those of the others."""
    units: Any = next((members[n] for n in UNITS if isinstance(members.get(n), dict)), {})
    return {
        name: _struct(of) if isinstance(of, dict) else Written(name, of, units.get(name, ""))
        for name, of in members.items()
        if of is not units
    }


def read_hdf5(path: Path, place: str) -> Iterator[Raw]:
    """Read HDF5 or a MATLAB file of version 7.3; links, which may leave the file, are refused."""
    import h5py

    with h5py.File(path, "r") as file:
        form = "MATLAB, version 7.3" if file.userblock_size else "HDF5"
        yield from _tables(_group(file, place), place, form)


def _group(group: Any, place: str) -> Variables:
    """Return the members of a group of HDF5, and its attributes, which may be settings."""
    import h5py

    about = {n: v for n, v in group.attrs.items() if not n.startswith("MATLAB") and np.size(v) == 1}
    members: dict[str, Any] = {name: Written(name, plain(value)) for name, value in about.items()}
    for name in (name for name in group if not name.startswith("#")):
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise InputError(f"{place}: {name} is a link, which is not followed")
        item = group[name]
        is_group = isinstance(item, h5py.Group)
        members[name] = _group(item, place) if is_group else _dataset(name, item)
    return members


def _dataset(name: str, item: Any) -> Written:
    """Return a dataset: numbers or texts; None for one in another file, and for any other."""
    about, is_reference = dict(item.attrs), "ref" in (item.dtype.metadata or {})
    if item.is_virtual or item.external or is_reference or about.get("MATLAB_empty", 0):
        return Written(name, None)
    values = np.squeeze(np.asarray(item[()]))
    if about.get("MATLAB_class", b"") == b"char":
        return Written(name, "".join(chr(code) for code in np.ravel(values)))
    return written(name, values, about)


def _tables(members: Variables, place: str, form: str) -> Iterator[Raw]:
    """Yield the table of variables, then those of the structs in it; InputError without any."""
    structs, left_out, is_empty = [("", members, list[Field]())], list[str](), True
    for name, struct, above in structs:  # which grows
        fields, found = [*above], list[Written]()
        for key, member in struct.items():
            if not isinstance(member, Written):
                structs.append((f"{name}.{key}" if name else key, member, fields))
                continue
            array = np.asarray(member.values)
            kind = array.dtype.kind
            if array.size == 1 and kind in "biufOSU" and member.values is not None:
                fields.append(Field(key, str(plain(array)), member.unit))
            elif (
                array.ndim == 1
                and array.size
                and (kind in "biufSU" or all(isinstance(v, (str, bytes)) for v in array))
            ):
                found.append(member)
            elif array.size:
                left_out.append(f"{key} left out: no list of numbers or texts")
        yield from tables_of(place, name, form, found, fields, left_out)
        is_empty = is_empty and not found
    if is_empty:
        raise InputError(
            f"{place}: holds no vector of samples (found: "
            f"{', '.join(left_out or members) or 'nothing'}); save vectors, or a struct of vectors"
        )
