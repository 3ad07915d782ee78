"""A table as a file holds it, before anything is mapped to our columns; names of its channels."""

from __future__ import annotations

import functools
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd

from beltid.bench.numbers import NumberSigns
from beltid.errors import InputError, Problems
from beltid.tables import schemas
from beltid.tables.units import CONVERSIONS, T, canonical_unit, conversion, is_known_unit

SCALING: Final = {
    **dict.fromkeys(("slope", "scale", "scaling", "factor", "gain", "multiplier", "lsb"), 1.0),
    **dict.fromkeys(("offset", "intercept", "y_intercept", "bias", "add_offset"), 0.0),
    "scale_factor": 1.0,
}
"""Properties that scale the counts of a converter -> the value that has no effect."""
TIME: Final = "time_s"  # name of the times of samples, if a format has them besides its channels
UNITS: Final = ("unit_string", "NI_UnitDescription", "unit", "Unit", "units", "Units")
"""Properties that hold the unit of a channel."""
POSITION: Final = re.compile(r" #\d{1,4}(?=\s|$)")
"""Number that distinguishes channels of the same name."""
_OTHER: Final = "1 - -- % # V mV mV/V A mA Hz Pa kPa MPa bar W kW J mm/s mm/min m/s m/s^2 m/s²"
OTHER_UNITS: Final = frozenset((*_OTHER.split(), "N/mm", "N/mm²", "l/min"))
"""Units that none of our columns has, but that occur in a row of units."""
IN_NAME: Final = re.compile(r"[\[(<{]([^\[\](){}<>]*)[\])>}]\s*$")
"""Brackets at the end of a name, which may hold its unit."""
# "Zeit / s", "Zeit/s", "Zeit in s"; not the slash within a unit, as in "v rad/s"
_AFTER_NAME: Final = re.compile(r"(?:(?<!\s)\s+/\s*|(?<=\w{4})/|(?<!\s)\s+in\s+)(\S+)\s*$")
_CHANNEL: Final = re.compile(r"^(?:channel|kanal|voie|ch|ai|c) ?\d+ (?=.)")
"""Prefix that a recorder puts before the name of a channel."""
_UMLAUTS: Final = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})


@dataclass(frozen=True, slots=True)
class Field:
    """An entry of a header: name, value as text, unit as written ("" if none is given)."""

    name: str
    text: str
    unit: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Raw:
    """A table of a file: all of it, or a group, sheet, struct, raster or segment."""

    place: str  # file, and group in it, for messages
    frame: pd.DataFrame  # by written names: float64 with nan where one is missing, or texts
    name: str = ""  # of the group or sheet; "" if it is the whole file
    format: str = ""  # in words
    units: dict[str, str] = field(default_factory=dict)  # written name -> unit, if stated
    fields: tuple[Field, ...] = ()  # entries of the header
    scaling: dict[str, str] = field(default_factory=dict)  # stated, but not applied
    lines: Sequence[int] | np.ndarray = ()  # of the rows in the file, from 1; empty: none
    header_line: int = 0  # of the names; 0 if there is none
    units_line: int = 0  # of the units; 0 if there is none
    signs: NumberSigns = field(default_factory=NumberSigns)  # of numbers among the texts
    encoding: str = ""
    notes: tuple[str, ...] = ()  # what was detected or left out
    problems: Problems = field(default_factory=Problems)  # rows that could not be read

    def at(self, row: int) -> tuple[str, int]:
        """Return the place of a row for messages, and its line to sort them."""
        if len(self.lines):
            return f"{self.place}:{self.lines[row]}", int(self.lines[row])
        word = "row" if self.format == "Parquet" else "sample"
        return f"{self.place}, {word} {row + 1}", row + 1

    @property
    def head(self) -> str:
        """Place of the names, for messages."""
        return f"{self.place}:{self.header_line}" if self.header_line else self.place


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
    parts: dict[Any, Raw] = {}
    left_out = [*notes]
    for channel in channels:
        values, times = np.asarray(channel.values), channel.times
        if values.ndim != 1 or values.dtype.kind not in "biufOSUM":
            left_out.append(f"channel {channel.name} left out: no plain numbers")
        elif values.size:
            key = (values.size, None if times is None else (float(times[0]), float(times[-1])))
            of_time = {} if times is None else {TIME: times}
            units = dict.fromkeys(of_time, "s")
            raw = parts.setdefault(key, Raw(place, pd.DataFrame(of_time), name, form, units))
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
        return pd.array(np.where(values, "true", "false").tolist(), dtype="str")
    if values.dtype.kind == "M":
        values = np.datetime_as_string(values, unit="us")
    texts = [str(plain(value)).strip("\0 ") or None for value in values.tolist()]
    return pd.array(texts, dtype="str")


def plain(value: Any) -> Any:
    """Return a value of one element as an object of Python, bytes as text."""
    value = np.ravel(value)[0] if np.size(value) == 1 and not isinstance(value, str) else value
    value = value.item() if hasattr(value, "item") else value
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def is_text(values: pd.Series) -> bool:
    """Return whether a column holds texts, not numbers."""
    return not pd.api.types.is_numeric_dtype(values)


def first_texts(values: pd.Series) -> list[str]:
    """Return the texts among the first 200 values; none for a column of numbers."""
    return [v for v in values.iloc[:200] if isinstance(v, str)] if is_text(values) else []


def written(
    name: str, values: Any, about: Mapping[str, Any], times: np.ndarray | None = None
) -> Written:
    """Return a channel with its unit and scaling, as its properties say: ``slope = 0.02``."""
    found = []
    for word, value in about.items() if values.dtype.kind in "iu" else ():
        neutral = SCALING.get(str(word).lower())
        if neutral is not None and np.size(value) == 1:
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
        allowed = ", ".join(CONVERSIONS["s"])
        raise InputError(f"{place}: the time is in {unit.strip()}, must be one of {allowed}")
    return times if by is None or by.factor == 1.0 else by.apply(times)


def stretches(*columns: np.ndarray) -> np.ndarray:
    """Return the rows with which stretches of equal values begin."""
    changed = np.logical_or.reduce([values[1:] != values[:-1] for values in columns])
    return np.flatnonzero(np.append(True, changed))[: len(columns[0])]


def codes_of(labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of every label, -1 for none, and the labels, in order of appearance."""
    begins = stretches(labels)
    codes, words = pd.factorize(labels[begins])
    return codes.repeat(np.diff(begins, append=len(labels))), words


# --- names ----------------------------------------------------------------------------------------


def is_unit(text: str) -> bool:
    """Return whether a text is one of our units or another unit common on benches."""
    return is_known_unit(text) or canonical_unit(text) in OTHER_UNITS


def split_unit(name: str) -> tuple[str, str]:
    """Split a name from the unit at its end: ``Kraft [N]``, ``Weg (mm)``, ``Zeit / s``."""
    match = (IN_NAME.search(name) or _AFTER_NAME.search(name)) if len(name) <= 300 else None
    unit = match[1].strip() if match else ""
    if match is None or not unit or not is_unit(unit):
        return name.strip(), ""
    return name[: match.start()].strip(), unit


def distinct_names(names: Sequence[str]) -> list[str]:
    """Number the channel names that occur several times: ``Kraft #2 [N]``."""
    counts, positions = Counter(names), Counter[str]()
    distinct = []
    for name in names:
        positions[name] += 1
        if name and counts[name] > 1:
            bare = split_unit(name)[0]
            name = f"{bare} #{positions[name]}{name[len(bare) :]}"
        distinct.append(name)
    return distinct


@functools.cache
def _vocabulary() -> dict[str, tuple[list[re.Pattern[str]], set[str]]]:
    """Return the words that identify each of our columns, and those that may be added."""
    text = (Path(__file__).parent / "vocabulary.txt").read_text(encoding="utf-8")
    words: dict[str, tuple[list[re.Pattern[str]], set[str]]] = {}
    for entry in re.sub(r"\n +", " ", re.sub(r"#.*\n", "", text)).splitlines():
        role, _, rest = entry.partition(": ")
        keys, _, added = rest.partition(" / ")
        fillers = {f for f in added.split() if f[0] != "@"}
        fillers.update(*(words[f[1:]][1] for f in added.split() if f[0] == "@"))
        words[role] = [re.compile(rf"\b{re.escape(key)}\b") for key in keys.split(", ")], fillers
    return words


def simplified(name: str) -> str:
    """Reduce a channel's name to lower-case words without brackets, unit, accents and signs."""
    bare = IN_NAME.sub("", split_unit(name)[0]) or name
    low = re.sub(r"(?<=[a-zäöüéè])(?=[A-Z])", " ", bare).lower().translate(_UMLAUTS)
    plain = unicodedata.normalize("NFKD", low).encode("ascii", "ignore").decode()
    return _CHANNEL.sub("", " ".join(re.findall(r"[a-z0-9]+", POSITION.sub("", plain))))


@functools.lru_cache(256)  # files of one bench have the same few names
def roles_meant(name: str, kind: str) -> tuple[str, ...]:
    """Return our columns that a channel's name can mean: a key with fillers only around it."""
    plain, columns = simplified(name), (*schemas.table(kind).names, "file")
    roles = []
    for role, (keys, fillers) in _vocabulary().items():
        rests = (key.sub(" ", plain, count=1) for key in keys if key.search(plain))
        if role in columns and any(fillers.issuperset(rest.split()) for rest in rests):
            roles.append(role)
    return tuple(roles)


def span_of(name: str) -> str:
    """Return the span that a channel's name tells: "tight", "slack" or ""."""
    plain, words = simplified(name), _vocabulary()
    keys = {span: words[f"tension_{span}_N"][0] for span in ("tight", "slack")}
    told = [span for span, of in keys.items() if any(key.search(plain) for key in of)]
    return told[0] if len(told) == 1 else ""
