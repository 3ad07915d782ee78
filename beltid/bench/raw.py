"""A table as a file holds it, before anything is mapped to our columns: names, numbers, times.

A number is read only if it has a single meaning. ``1,000.12`` and ``1.000,85`` have both signs,
``1,234,567`` has two groups, and an apostrophe or a blank is never a decimal sign. ``1,250`` alone
is 1.25 if the decimal sign of the file is the comma, and 1250 only if the config or another number
of the file shows that the comma separates thousands.

Clock times become seconds from the first sample of a run: times of day (``13:45:02,125``), alone or
after a date; ISO; offsets such as +02:00, Z and UTC. Time stamps of Arrow and Excel come as texts.
"""

import functools
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import types

from beltid.errors import InputError, PlaceOf, Problems
from beltid.store.parquet import damaged, open_parquet
from beltid.tables import schemas
from beltid.tables.units import canonical_unit, is_known_unit
from beltid.tables.values import is_missing

# Texts that people, spreadsheets and compilers write for a missing number
_WORDS = "- -- --- – — nan NaN NAN -nan -NaN nan(ind) -nan(ind) NA N/A n/a n.a. <NA> 1.#IND"
_ERRORS = "null NULL None #N/A #NA #NV #DIV/0! #VALUE! #WERT! #NUM! #ZAHL! 1.#QNAN -1.#IND"
MISSING = frozenset(("", "-1.#QNAN", *_WORDS.split(), *_ERRORS.split()))
NO_NUMBER = "must be a number"
# Typographic apostrophes, blanks and minus signs -> those of a keyboard
_PLAIN = str.maketrans("’\u00a0\u2007\u2009\u202f−–", "'    --")
_SINGLE = re.compile(r"[-+]?(?=[.,]?\d)\d*(?:(?P<point>[.,])\d*)?(?:[eE][-+]?\d+)?", re.ASCII)
GROUPED = re.compile(
    r"[-+]?[1-9]\d{0,2}(?P<sign>[.,' ])\d{3}(?P<more>(?:(?P=sign)\d{3})*)"
    r"(?:(?!(?P=sign))(?P<point>[.,])\d*)?(?:[eE][-+]?\d+)?",
    re.ASCII,
)
_OTHER = {",": ".", ".": ","}
DAY_S = 86400.0
_DATE = re.compile(
    r"(?P<a>\d{4}|\d{1,2})(?P<mark>[-./])(?P<b>\d{1,2})[-./](?P<c>\d{4}|\d{1,2})"
    r"(?:[T ]00:00(?::00(?:[.,]0+)?)?)?",
    re.ASCII,
)
_CLOCK = re.compile(
    r"^(?:(?P<date>[\d./-]{6,10})(?:T|,?\s+))?"
    r"(?P<time>(?:[01]?\d|2[0-3]):[0-5]\d:[0-5]\d(?:[.,]\d{1,30}|:\d{3}|:\d{6})?)"
    r"(?:\s*(?P<zone>Z|UTC|GMT|[-+]\d\d(?::?\d\d)?))?$",
    re.ASCII,
)
LONGEST_TEXT = 1000  # bytes of a text; a file can repeat a long one in every row at no cost
_NUMERIC = (types.is_null, types.is_decimal, types.is_integer, types.is_floating)
POSITION = re.compile(r" #\d{1,4}(?=\s|$)")  # number of a channel among those of its name
# Units that none of our columns has, but that occur in a row of units
_SEEN = "1 - -- % # V mV mV/V A mA Hz Pa kPa MPa bar W kW J mm/s mm/min m/s m/s^2 m/s²"
OTHER_UNITS = frozenset((*_SEEN.split(), "N/mm", "N/mm²", "l/min"))
IN_NAME = re.compile(r"[\[(<{]([^\[\](){}<>]*)[\])>}]\s*$")  # may hold the unit
# "Zeit / s", "Zeit/s", "Zeit in s"; not the slash within a unit, as in "v rad/s"
_AFTER_NAME = re.compile(r"(?:(?<!\s)\s+/\s*|(?<=\w{4})/|(?<!\s)\s+in\s+)(\S+)\s*$")
_BEFORE_NAME = re.compile(r"^\[([^\[\]]*[^\W\d_][^\[\]]*)\](?=\s*\S)")  # "[1]" is a number
_CHANNEL = re.compile(r"^(?:channel|kanal|voie|ch|ai|c) ?\d+ (?=.)")  # of the recorder
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, with either decimal sign, with or without groups."""
    plain = cell.translate(_PLAIN)
    return bool(_SINGLE.fullmatch(plain) or GROUPED.fullmatch(plain))


@dataclass(frozen=True, slots=True)
class NumberSigns:
    """Decimal sign and thousands separator of a file; "" if no thousands are known."""

    decimal: str = "."
    thousands: str = ""

    @classmethod
    def of(
        cls, cells: Iterable[str], decimal: str | None = None, thousands: str | None = None
    ) -> Self:
        """Detect the signs in some cells; stated signs take precedence."""
        decimals, groups = set[str | None](), set[str]()
        for plain in (cell.translate(_PLAIN) for cell in cells):
            if (match := GROUPED.fullmatch(plain)) is None:
                single = _SINGLE.fullmatch(plain)
                decimals.add(single["point"] if single else None)
            elif match["point"] or match["more"] or match["sign"] in "' ":
                groups.add(match["sign"])
                decimals.add(match["point"] or _OTHER.get(match["sign"]))
        if decimal is None:
            decimal = _OTHER.get(thousands or "", "," if decimals - {None} == {","} else ".")
        if thousands is None:
            thousands = min(groups - {decimal}, default="")
        return cls(decimal, thousands)

    def number(self, cell: str) -> float | str:
        """Convert a cell to a number, or say why it is not one."""
        text = cell.translate(_PLAIN)
        match = _SINGLE.fullmatch(text)
        if match and match["point"] in (None, self.decimal):
            return float(text.replace(",", "."))
        if (match := GROUPED.fullmatch(text)) is None:
            return NO_NUMBER
        sign, point = match["sign"], match["point"]
        if point not in (None, self.decimal) or sign == self.decimal:
            stated = '"{0}": dialect: {{decimal: "{0}"}}'.format(point or _OTHER[sign])
            return f"{NO_NUMBER} (if its decimal sign is {stated})"
        if sign == self.thousands or point or match["more"] or sign in "' ":
            return float(text.replace(sign, "").replace(",", "."))
        return (
            f"may be {text.replace(sign, '.')} or {text.replace(sign, '')}: set dialect: "
            f'{{decimal: "{sign}"}} or {{thousands: "{sign}"}}'
        )


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
                    raise InputError(
                        f"{place}: column {name} holds texts of more than {LONGEST_TEXT} bytes"
                    )
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
    if len(lengths := sorted({len(values) for values in lists.values()})) > 1:
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


# --- numbers and labels --------------------------------------------------------------------------


def numbers_of(
    texts: pd.Series, signs: NumberSigns, shown: str, place: PlaceOf, problems: Problems
) -> np.ndarray:
    """Convert texts to numbers, nan for a missing one; report what is none or ambiguous."""
    codes, cells = pd.factorize(texts)
    words = [str(cell).strip() for cell in cells]
    read = [np.nan if word in MISSING else signs.number(word) for word in words]
    wrong = {code: why for code, why in enumerate(read) if isinstance(why, str)}

    def told(row: int) -> str:
        """Quote the text in a row, and say why it is no number."""
        word = words[codes[row]]
        short = word if len(word) <= 40 else word[:37] + "..."
        return f'{shown} = "{short}", {wrong[codes[row]]}'

    problems.add_alike(np.flatnonzero(np.isin(codes, list(wrong))), told, place)
    return np.array([*(np.nan if isinstance(v, str) else v for v in read), np.nan])[codes]


def word_of(value: Any) -> str | None:
    """Return a label as text: whole numbers without a decimal point, None if it is missing."""
    if isinstance(value, (float, np.floating)) and float(value).is_integer():
        value = int(value)
    return None if is_missing(value) else str(value).strip() or None


def words_of(values: pd.Series) -> np.ndarray:
    """Return a column of labels as an object array of str, None where one is missing."""
    codes, labels = pd.factorize(values)
    words = (word_of(label) for label in labels)
    return np.array([*(None if w in MISSING else w for w in words), None], dtype=object)[codes]


# --- clock times ---------------------------------------------------------------------------------


def is_date(cell: str) -> bool:
    """Return whether a cell is a date without a time; spreadsheets may append midnight."""
    return len(cell) <= 80 and bool(_DATE.fullmatch(cell.strip()))


def is_clock(cell: str) -> bool:
    """Return whether a cell is a time of day, with or without a date and a zone."""
    return len(cell) <= 80 and bool(_CLOCK.fullmatch(cell.strip()))


def moments(texts: pd.Series) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the nanoseconds from 1970 or midnight, what is no such time, and day or month."""
    parts = texts.str.extract(_CLOCK)
    has = parts[["date", "zone"]].notna()
    time = pd.to_timedelta(parts["time"].str.replace(r"(:\d\d:\d\d)[,:]", r"\1.", regex=True))
    codes, zones = pd.factorize(parts["zone"].str.replace(r"[A-Z]+", "+00:00", regex=True))
    east = [pd.Timedelta(f"{zone[:3]}:{zone[3:].strip(':') or '00'}:00") for zone in zones]
    time = time - pd.Series(np.array([*east, pd.Timedelta(0)])[codes], dtype=time.dtype)
    codes, written = pd.factorize(parts["date"])
    days, unclear = _days(pd.Series([*written, "1970-01-01"], dtype="str"))
    moment = pd.Series(days.to_numpy()[codes]) + time
    wrong = moment.isna() | (has != has.loc[texts.first_valid_index() or 0]).any(axis=1)
    nanoseconds = moment.to_numpy("datetime64[ns]").view(np.int64)
    return nanoseconds, wrong.to_numpy(), unclear.to_numpy()[codes]


def _days(texts: pd.Series) -> tuple[pd.Series, pd.Series]:
    """Read dates, and tell which can be month/day as well as day/month."""
    parts = texts.str.extract(_DATE)
    a, b, c = (pd.to_numeric(parts[name]) for name in "abc")
    is_iso = parts["a"].str.len() == 4
    either = ~(is_iso | (parts["mark"] == ".") | a.isna())
    # 20/11 shows the order for all dates of the column; 03/04 alone does not
    month_first = bool((either & (b > 12)).any())
    shown = month_first or (either & (a > 12)).any()
    day_month_year = (b if month_first else a, a if month_first else b, c.where(c >= 100, c + 2000))
    units = zip(("day", "month", "year"), (c, b, a), day_month_year, strict=True)
    table = pd.DataFrame({unit: iso.where(is_iso, other) for unit, iso, other in units})
    # on the first day itself the order does not matter
    return pd.to_datetime(table, errors="coerce"), either & (not shown) & (texts.index > 0)


@dataclass(slots=True)
class Clock:
    """Reader of the clock times of a recording; the first time sets the form and the day."""

    problems: Problems
    name: str = ""  # of the channel
    first: str = ""  # the first time as written
    midnight_ns: int | None = None  # before the first time [ns from 1970-01-01]

    def read(self, times: pd.Series, place: PlaceOf) -> np.ndarray:
        """Convert clock times to seconds from the midnight before the first; nan for none."""
        self.name = self.name or str(times.name)
        text = times.astype("str").str.strip().reset_index(drop=True)
        self.first = self.first or next(iter(text.dropna()), "")
        counts, wrong, unclear = moments(text)
        missing, day_ns = text.isna().to_numpy(), int(DAY_S * 1e9)
        why = (
            "must be a clock time such as 13:45:02.125 or 2026-11-20T13:45:02+01:00, like the "
            "first time with or without a date or a zone",
            "may be day/month or month/day: write dates as 2026-11-20",
        )
        self.problems.add_alike(
            np.flatnonzero((wrong & ~missing) | unclear),
            lambda i: f'{self.name} = "{str(text.iloc[i])[:40]}", {why[int(unclear[i])]}',
            place,
        )
        read = ~(wrong | unclear | missing)
        if self.midnight_ns is None and read.any():
            self.midnight_ns = int(counts[read][0] // day_ns * day_ns)
        return np.where(read, (counts - (self.midnight_ns or 0)) * 1e-9, np.nan)

    def elapsed(self, seconds: np.ndarray, runs: np.ndarray, place: PlaceOf) -> np.ndarray:
        """Return the times from the first sample of each run [s], continued past midnight."""
        time, dated = seconds.copy(), not re.match(r"\d{1,2}:", self.first)
        order = np.argsort(runs, kind="stable")
        order = order[np.isfinite(time[order])]
        for rows in np.split(order, np.flatnonzero(np.diff(runs[order])) + 1):
            steps = np.diff(time[rows])
            night = (steps < -0.5 * DAY_S) & (not dated)
            back, wrong = np.flatnonzero((steps < 0) & ~night), ""
            if back.size:
                of_day = pd.to_timedelta(np.round(time[rows[back[0] :][:2]] % DAY_S, 3), "s")
                span = " to ".join(str(pd.Timestamp(0) + of)[11:23] for of in of_day)
                wrong = f"goes back from {span} without passing midnight, must not go backwards"
                time[rows] = np.maximum.accumulate(time[rows])  # reported once
            elif 2 * np.count_nonzero(steps == 0) > max(steps.size, 9):
                wrong = "stays the same from sample to sample more often than it changes: its "
                wrong += "resolution is too coarse for the time of the samples"
            if wrong:
                where, line = place(int(rows[back[0] + 1 if back.size else 0]))
                self.problems.add(f"{where}: {self.name} {wrong}", line)
            time[rows[1:]] += np.cumsum(night) * DAY_S
            time[rows] -= time[rows[:1]]
        return np.round(time, 9)  # finer digits are rounding errors
