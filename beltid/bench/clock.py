"""Clock times -> the time of a recording: seconds from the first sample of a run.

Times of day (``13:45:02,125``, ``1:45:02 PM``), alone, after a date or with a date beside; ISO;
offsets such as +02:00, Z and UTC. Time stamps of Arrow and Excel come as such texts.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd

from beltid.errors import PlaceOf, Problems

DAY_S: Final = 86400.0
_DATE: Final = r"(?P<a>\d{4}|\d{1,2})(?P<mark>[-./])(?P<b>\d{1,2})[-./](?P<c>\d{4}|\d{1,2})"
_AFTER_DATE: Final = r"(?:T|,?\s+)"
_IS_DATE: Final = re.compile(rf"{_DATE}(?:[T ]00:00(?::00(?:[.,]0+)?)?)?", re.ASCII)
_IS_CLOCK: Final = re.compile(
    rf"(?:{_DATE}{_AFTER_DATE})?\d{{1,2}}:\d\d:\d\d(?:[.,]\d{{1,30}}|:\d{{3}}|:\d{{6}})?"
    r"(?P<half>\s*[AaPp]\.?\s?[Mm]\.?)?(?P<zone>\s*(?:Z|UTC|GMT|[-+]\d\d(?::?\d\d)?))?",
    re.ASCII,
)
_CUT: Final = re.compile(r"\d{1,3}:\d\d(?:[.,]\d+)?", re.ASCII)
"""A clock time cut by a spreadsheet: minutes and seconds, or hours and minutes."""
_IN_ONE_WAY: Final = (
    ("", r" (\d:\d\d:)", r" 0\1"),
    ("", r"(:\d\d:\d\d)[.,:](\d{1,9})\d*", r"\1.\2"),
    ("", r"(:\d\d:\d\d)($|[^.\d])", r"\1.0\2"),
    ("%p", r" ?([AaPp])\.? ?[Mm]\.?", r"\1m"),
    ("%z", r" ?(?:Z|UTC|GMT)$", "+00:00"),
    ("%z", r"(\.\d+m?) ?([-+]\d\d)$", r"\1\2:00"),
    ("%z", r" ?([-+]\d\d):?(\d\d)$", r"\1:\2"),
)
"""Part of the form, pattern, and what replaces it, until all times are written in one way."""
NOT_READ: Final = (
    "must be a clock time such as 13:45:02.125 or 2026-11-20T13:45:02+01:00, like the first time "
    "with or without a date or a zone"
)
DAY_OR_MONTH: Final = "may be day/month or month/day: write dates as 2026-11-20"


def is_date(cell: str) -> bool:
    """Return whether a cell is a date without a time; spreadsheets may append midnight."""
    return len(cell) <= 80 and bool(_IS_DATE.fullmatch(cell.strip()))


def is_clock(cell: str) -> bool:
    """Return whether a cell is a time of day, with or without a date and a zone."""
    return len(cell) <= 80 and bool(_IS_CLOCK.fullmatch(cell.strip()))


def written_as(cells: Sequence[str]) -> str:
    """Classify the first filled cells of a column: "date", "clock", or "" for anything else."""
    if cells and all(map(is_date, cells)):
        return "date"
    return "clock" if cells and (is_clock(cells[0]) or _CUT.fullmatch(cells[0].strip())) else ""


@dataclass(slots=True)
class Clock:
    """Reader of the clock times of a recording; the first time sets the form and the day."""

    name: str = ""  # of the channel
    first: str = ""  # the first time as written
    form: str = ""  # of it, for `pandas.to_datetime`
    dated: bool = False  # whether it has a date
    midnight_ns: int | None = None  # before the first time [ns from 1970-01-01]
    midnights: int = 0  # passed by times of day

    def read(
        self, times: pd.Series, dates: pd.Series | None, place: PlaceOf, problems: Problems
    ) -> np.ndarray:
        """Convert clock times to seconds from the midnight before the first; nan for none."""
        self.name = self.name or str(times.name)
        text = times.astype("str").str.strip()
        if dates is not None and not re.match(r"\d+[-./]", next(iter(text.dropna()), "")):
            text = dates.astype("str").str.replace(r"[T ]00:00.*", "", regex=True) + " " + text
        if not self.first:
            self._begin(next(iter(text.dropna()), ""))
        plain, unclear = "1970-01-01 " + text, np.zeros(len(text), dtype=bool)
        if self.dated:
            day = text.str.replace(rf"{_AFTER_DATE}\d{{1,2}}:.*$", "", regex=True)
            codes, days = pd.factorize(day)
            iso, is_unclear = _iso_days([str(d) for d in days])
            unclear = np.array([*is_unclear, False])[codes]
            clock = text.str.replace(rf"^[-./\d]+{_AFTER_DATE}", "", regex=True)
            plain = pd.Series(np.array([*iso, None], dtype=object)[codes], dtype="str") + " "
            plain += clock.reset_index(drop=True)
        for part, pattern, replacement in _IN_ONE_WAY:
            if part in self.form:
                plain = plain.str.replace(pattern, replacement, regex=True)
        utc = "%z" in self.form
        moments = pd.to_datetime(plain, format=self.form, errors="coerce", utc=utc)
        counts = moments.to_numpy("datetime64[ns]").view(np.int64)
        wrong = moments.isna().to_numpy()
        if self.midnight_ns is None and not wrong.all():
            self.midnight_ns = int(counts[~wrong][0] // int(DAY_S * 1e9) * int(DAY_S * 1e9))
        for why, rows in ((NOT_READ, wrong & text.notna() & ~unclear), (DAY_OR_MONTH, unclear)):
            at = np.flatnonzero(rows)
            problems.add_alike(
                at,
                lambda i, why=why: f'{self.name} = "{str(text.iloc[i])[:40]}", {why}',  # type: ignore[misc]
                place,
            )
            problems.unread.update(place(int(row))[0] for row in at)
        return np.where(wrong | unclear, np.nan, (counts - (self.midnight_ns or 0)) * 1e-9)

    def _begin(self, first: str) -> None:
        """Take the form of the first time."""
        found = _IS_CLOCK.fullmatch(first)
        half, zone = (found is not None and found[name] for name in ("half", "zone"))
        self.first, self.dated = first, bool(found and found["a"])
        self.form = "%Y-%m-%d " + ("%I:%M:%S.%f%p" if half else "%H:%M:%S.%f")
        self.form += "%z" if zone else ""

    def elapsed(
        self, seconds: np.ndarray, runs: np.ndarray, place: PlaceOf, problems: Problems
    ) -> np.ndarray:
        """Return the times from the first sample of each run [s], continued past midnight."""
        time = seconds.copy()
        order = np.argsort(runs, kind="stable")
        order = order[np.isfinite(time[order])]
        for rows in np.split(order, np.flatnonzero(np.diff(runs[order])) + 1):
            steps = np.diff(time[rows])
            night = (steps < -0.5 * DAY_S) & (not self.dated)
            back = np.flatnonzero((steps < 0) & ~night)
            if back.size:
                before, after = rows[back[0]], rows[back[0] + 1]
                where, line = place(int(after))
                problems.add(
                    f"{where}: {self.name} goes back from {_shown(time[before])} to "
                    f"{_shown(time[after])} without passing midnight, must not go backwards",
                    line,
                )
                time[rows] = np.maximum.accumulate(time[rows])  # reported once
            elif 2 * np.count_nonzero(steps == 0) > max(steps.size, 9):
                where, line = place(int(rows[0]))
                problems.add(
                    f"{where}: {self.name} stays the same from sample to sample more often than "
                    "it changes: its resolution is too coarse for the time of the samples",
                    line,
                )
            time[rows[1:]] += np.cumsum(night) * DAY_S
            self.midnights += int(night.sum())
            time[rows] -= time[rows[:1]]
        return np.round(time, 9)  # finer digits are rounding errors

    def notes(self) -> list[str]:
        """Return notes on how the time was obtained."""
        if not self.first:
            return []
        what = "time stamps" if self.dated else "times of day"
        notes = [f"{self.name} holds {what}: seconds are counted from the first, {self.first}"]
        if self.midnights:
            times = "once" if self.midnights == 1 else f"{self.midnights} times"
            notes.append(f"{self.name} passes midnight {times}: the seconds continue")
        return notes


def _iso_days(days: Sequence[str]) -> tuple[list[str | None], list[bool]]:
    """Return dates as 2026-11-20, and which of them can be month/day as well as day/month."""
    dates = [_IS_DATE.fullmatch(day) for day in days]
    ours = [d for d in dates if d is not None and len(d["a"]) < 4]
    # 20/11 shows the order for all dates of the column; 03/04 alone does not
    month_first = any(d["mark"] != "." and int(d["b"]) > 12 for d in ours)
    shown = (
        month_first or all(d["mark"] == "." for d in ours) or any(int(d["a"]) > 12 for d in ours)
    )
    iso: list[str | None] = []
    for date in dates:
        year, month, day = (date["a"], date["b"], date["c"]) if date is not None else ("", "", "")
        if date in ours:
            month, day = (year, month) if month_first else (month, year)
            year = date["c"] if len(date["c"]) == 4 else f"20{date['c']}"
        iso.append(f"{year}-{month:0>2}-{day:0>2}" if date is not None else None)
    # on the first day itself the order does not matter
    unclear = [
        date in ours and not shown and text != days[0]
        for date, text in zip(dates, days, strict=True)
    ]
    return iso, unclear


def _shown(seconds: float) -> str:
    """Format seconds from midnight as a time of day."""
    return str(pd.Timestamp(0) + pd.Timedelta(round(seconds % DAY_S, 3), "s"))[11:23]
