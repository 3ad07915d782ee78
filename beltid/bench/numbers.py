"""Numbers and clock times as people, spreadsheets and instruments write them.

A number is read only if it has a single meaning. ``1,000.12`` and ``1.000,85`` have both signs,
``1,234,567`` has two groups, and an apostrophe or a blank is never a decimal sign. ``1,250`` alone
is 1.25 if the decimal sign of the file is the comma, and 1250 only if the config or another number
of the file shows that the comma separates thousands.

Clock times become seconds from the first sample of a run: times of day (``13:45:02,125``), alone or
after a date; ISO; offsets such as +02:00, Z and UTC. Time stamps of Arrow and Excel come as texts.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from beltid.errors import PlaceOf, Problems
from beltid.tables.values import is_missing

# Texts that people, spreadsheets and compilers write for a missing number
_WORDS: Final = "- -- --- – — nan NaN NAN -nan -NaN nan(ind) -nan(ind) NA N/A n/a n.a. <NA> 1.#IND"
_ERRORS: Final = "null NULL None #N/A #NA #NV #DIV/0! #VALUE! #WERT! #NUM! #ZAHL! 1.#QNAN -1.#IND"
MISSING: Final = frozenset(("", "-1.#QNAN", *_WORDS.split(), *_ERRORS.split()))
NO_NUMBER: Final = "must be a number"
# Typographic apostrophes, blanks and minus signs -> those of a keyboard
_PLAIN: Final = str.maketrans("’\u00a0\u2007\u2009\u202f−–", "'    --")
_SINGLE: Final = re.compile(
    r"[-+]?(?=[.,]?\d)\d*(?:(?P<point>[.,])\d*)?(?:[eE][-+]?\d+)?", re.ASCII
)
GROUPED: Final = re.compile(
    r"[-+]?[1-9]\d{0,2}(?P<sign>[.,' ])\d{3}(?P<more>(?:(?P=sign)\d{3})*)"
    r"(?:(?!(?P=sign))(?P<point>[.,])\d*)?(?:[eE][-+]?\d+)?",
    re.ASCII,
)
_OTHER: Final = {",": ".", ".": ","}
DAY_S: Final = 86400.0
_DATE: Final = re.compile(
    r"(?P<a>\d{4}|\d{1,2})(?P<mark>[-./])(?P<b>\d{1,2})[-./](?P<c>\d{4}|\d{1,2})"
    r"(?:[T ]00:00(?::00(?:[.,]0+)?)?)?",
    re.ASCII,
)
_CLOCK: Final = re.compile(
    r"^(?:(?P<date>[\d./-]{6,10})(?:T|,?\s+))?"
    r"(?P<time>(?:[01]?\d|2[0-3]):[0-5]\d:[0-5]\d(?:[.,]\d{1,30}|:\d{3}|:\d{6})?)"
    r"(?:\s*(?P<zone>Z|UTC|GMT|[-+]\d\d(?::?\d\d)?))?$",
    re.ASCII,
)


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
    ) -> NumberSigns:
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
        match = GROUPED.fullmatch(text)
        if match is None:
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
    midnights: int = 0  # passed by times of day

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
            self.midnights += int(night.sum())
            time[rows] -= time[rows[:1]]
        return np.round(time, 9)  # finer digits are rounding errors

    @property
    def note(self) -> str:
        """How the time was obtained."""
        past = f", {self.midnights} times past midnight" if self.midnights else ""
        return f"{self.name}: seconds are counted from the first, {self.first}{past}"
