"""A table as a file holds it, before anything is mapped to our columns; names of its channels."""

from __future__ import annotations

import functools
import re
import unicodedata
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import types

from beltid.bench.numbers import NumberSigns, word_of
from beltid.errors import InputError
from beltid.store.parquet import damaged, open_parquet
from beltid.tables import schemas
from beltid.tables.units import canonical_unit, is_known_unit

LONGEST_TEXT: Final = 1000  # bytes of a text; a file can repeat a long one in every row at no cost
_NUMERIC: Final = (types.is_null, types.is_decimal, types.is_integer, types.is_floating)
POSITION: Final = re.compile(r" #\d{1,4}(?=\s|$)")  # number of a channel among those of its name
# Units that none of our columns has, but that occur in a row of units
_OTHER: Final = "1 - -- % # V mV mV/V A mA Hz Pa kPa MPa bar W kW J mm/s mm/min m/s m/s^2 m/s²"
OTHER_UNITS: Final = frozenset((*_OTHER.split(), "N/mm", "N/mm²", "l/min"))
IN_NAME: Final = re.compile(r"[\[(<{]([^\[\](){}<>]*)[\])>}]\s*$")  # may hold the unit
# "Zeit / s", "Zeit/s", "Zeit in s"; not the slash within a unit, as in "v rad/s"
_AFTER_NAME: Final = re.compile(r"(?:(?<!\s)\s+/\s*|(?<=\w{4})/|(?<!\s)\s+in\s+)(\S+)\s*$")
_BEFORE_NAME: Final = re.compile(r"^\[([^\[\]]*[^\W\d_][^\[\]]*)\](?=\s*\S)")  # "[1]" is a number
_CHANNEL: Final = re.compile(r"^(?:channel|kanal|voie|ch|ai|c) ?\d+ (?=.)")  # of the recorder
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


def is_text(values: pd.Series) -> bool:
    """Return whether a column holds texts, not numbers."""
    return not pd.api.types.is_numeric_dtype(values)


def first_texts(values: pd.Series) -> list[str]:
    """Return the texts among the first 200 values; none for a column of numbers."""
    return [v for v in values.iloc[:200] if isinstance(v, str)] if is_text(values) else []


def stretches(*columns: np.ndarray) -> np.ndarray:
    """Return the rows with which stretches of equal values begin."""
    changed = np.logical_or.reduce([values[1:] != values[:-1] for values in columns])
    return np.flatnonzero(np.append(True, changed))[: len(columns[0])]


def codes_of(labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of every label, -1 for none, and the labels, in order of appearance."""
    begins = stretches(labels)
    codes, words = pd.factorize(labels[begins])
    return codes.repeat(np.diff(begins, append=len(labels))), words


# --- Parquet and tables in memory ----------------------------------------------------------------


def read_parquet(path: Path, place: str) -> Iterator[Raw]:
    """Read a Parquet file."""
    file = open_parquet(path.read_bytes(), place, InputError)
    try:
        table = file.read()
        table.validate(full=True)
    except Exception as error:  # a damaged file can raise nearly anything
        raise InputError(f"{place}: {damaged(error)}") from None
    yield table_of(table, place)


def table_of(table: pa.Table, place: str) -> Raw:
    """Return an Arrow table as written; a column that is neither numbers nor texts is left out."""
    columns, units, left_out = {}, {}, []
    for entry, values in zip(table.schema, table.columns, strict=True):
        name, kind = entry.name, values.type
        if name in columns:
            raise InputError(f"{place}: column {name} occurs several times, must be once")
        units[name] = (entry.metadata or {}).get(b"unit", b"").decode(errors="replace")
        if types.is_duration(kind):
            nanoseconds = values.cast(pa.duration("ns")).cast(pa.int64()).to_numpy()
            columns[name], units[name] = nanoseconds / 1e9, "s"
        elif any(is_kind(kind) for is_kind in _NUMERIC):
            columns[name] = values.cast(pa.float64(), safe=False).to_numpy()
        elif types.is_nested(kind) or types.is_binary(kind) or hasattr(kind, "extension_name"):
            left_out.append(f"column {name} holds {kind}, left out")
        else:  # texts; times and true or false as texts
            for chunk in values.chunks:
                words = chunk.dictionary if types.is_dictionary(chunk.type) else chunk
                is_words = types.is_string(words.type) or types.is_large_string(words.type)
                if is_words and (pc.max(pc.binary_length(words)).as_py() or 0) > LONGEST_TEXT:
                    long = f"texts of more than {LONGEST_TEXT} bytes"
                    raise InputError(f"{place}: column {name} holds {long}")
            columns[name] = pd.array(values.cast(pa.large_string()), dtype="str")
    frame, notes = pd.DataFrame(columns, copy=False), tuple(left_out)
    return Raw(place, frame, format="Parquet", units=units, notes=notes)


def frame_of(frame: Any, place: str) -> Raw:
    """Return a DataFrame, pyarrow Table or mapping as written; what is no list is left out."""
    if not (isinstance(frame, Mapping) or hasattr(frame, "columns")):
        raise InputError(
            f"{place}: is a {type(frame).__name__}, must be a DataFrame, an Arrow table or a dict "
            "of columns"
        )
    names = getattr(frame, "column_names", getattr(frame, "columns", frame))
    lists = {str(name): frame[name] for name in dict.fromkeys(names) if np.ndim(frame[name]) == 1}
    for name, values in lists.items():
        try:
            is_arrow = isinstance(values, (pa.Array, pa.ChunkedArray))
            lists[name] = values if is_arrow else pa.array(values, from_pandas=True)
        except (pa.ArrowException, ValueError, TypeError):  # values of several types
            lists[name] = pa.array([word_of(value) for value in values], pa.string())
    lengths = sorted({len(values) for values in lists.values()})
    if len(lengths) > 1:
        raise InputError(f"{place}: the columns have different lengths {lengths}")
    if lengths in ([], [0]):
        raise InputError(f"{place}: holds no samples")
    return table_of(pa.table(lists), place)


# --- names ----------------------------------------------------------------------------------------


def is_unit(text: str) -> bool:
    """Return whether a text is one of our units or another unit common on benches."""
    return is_known_unit(text) or canonical_unit(text) in OTHER_UNITS


def split_unit(name: str) -> tuple[str, str]:
    """Split a name from its unit: ``Kraft [N]``, ``Weg (mm)``, ``Zeit / s``, ``[N] Force``."""
    ways = (IN_NAME, _AFTER_NAME, _BEFORE_NAME) if len(name) <= 300 else ()
    match = next(filter(None, (way.search(name) for way in ways)), None)
    if match is None or not is_unit(match[1].strip()):
        return name.strip(), ""
    return (name[: match.start()] + name[match.end() :]).strip(), match[1].strip()


def distinct_names(names: Sequence[str]) -> list[str]:
    """Number the channel names that occur several times: ``Kraft #2 [N]``."""
    distinct = [*names]
    for name in (name for name, count in Counter(names).items() if name and count > 1):
        bare = split_unit(name)[0] if name.startswith(split_unit(name)[0]) else name
        places = (i for i, other in enumerate(names) if other == name)
        for k, i in enumerate(places, start=1):
            distinct[i] = f"{bare} #{k}{name[len(bare) :]}"
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
    return tuple(
        role
        for role, (keys, fillers) in _vocabulary().items()
        if role in columns
        and any(
            fillers.issuperset(key.sub(" ", plain, count=1).split())
            for key in keys
            if key.search(plain)
        )
    )


def span_of(name: str) -> str:
    """Return the span that a channel's name tells: "tight", "slack" or ""."""
    told = [
        span
        for span in ("tight", "slack")
        if any(key.search(simplified(name)) for key in _vocabulary()[f"tension_{span}_N"][0])
    ]
    return told[0] if len(told) == 1 else ""
