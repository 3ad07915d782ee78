"""Clock times -> the time of a recording: seconds from the first sample of a run.

Times of day (``13:45:02,125``, ``1:45:02 PM``), alone or after a date; ISO;
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
HALF_DAY: Final = pd.Timedelta(12, "h")
_DATE: Final = r"(?P<a>\d{4}|\d{1,2})(?P<mark>[-./])(?P<b>\d{1,2})[-./](?P<c>\d{4}|\d{1,2})"
_IS_DATE: Final = re.compile(rf"{_DATE}(?:[T ]00:00(?::00(?:[.,]0+)?)?)?", re.ASCII)
_IS_CLOCK: Final = re.compile(
    r"^(?:(?P<date>[\d./-]{6,10})(?:T|,?\s+))?"
    r"(?P<time>(?:[01]?\d|2[0-3]):[0-5]\d:[0-5]\d(?:[.,]\d{1,30}|:\d{3}|:\d{6})?)"
    r"(?:\s*(?P<half>[AaPp])\.?\s?[Mm]\.?)?(?:\s*(?P<zone>Z|UTC|GMT|[-+]\d\d(?::?\d\d)?))?$",
    re.ASCII,
)
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
    return "clock" if cells and is_clock(cells[0]) else ""


def moments(texts: pd.Series) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Read clock times like the first of them.

    Returns the nanoseconds from 1970-01-01 in UTC, or from midnight where no date is written; which
    cannot be read; and which may be day/month as well as month/day.
    """
    parts = texts.str.extract(_IS_CLOCK)
    has = parts[["date", "half", "zone"]].notna()
    time = pd.to_timedelta(parts["time"].str.replace(r"(:\d\d:\d\d)[,:]", r"\1.", regex=True))
    half = parts["half"].str.lower()
    time = time.mask(half.notna() & (time >= HALF_DAY), time - HALF_DAY)
    time = time.mask(half == "p", time + HALF_DAY)
    codes, zones = pd.factorize(parts["zone"].str.replace(r"[A-Z]+", "+00:00", regex=True))
    east = [pd.Timedelta(f"{zone[:3]}:{zone[3:].strip(':') or '00'}:00") for zone in zones]
    time = time - pd.Series(np.array([*east, pd.Timedelta(0)])[codes], dtype=time.dtype)
    codes, days = pd.factorize(parts["date"])
    iso, is_unclear = _iso_days([str(day) for day in days])
    dates = pd.to_datetime(pd.Series([*iso, "1970-01-01"]), format="%Y-%m-%d", errors="coerce")
    moment = pd.Series(dates.to_numpy()[codes]) + time
    wrong = moment.isna() | (has != has.loc[texts.first_valid_index() or 0]).any(axis=1)
    counts = moment.to_numpy("datetime64[ns]").view(np.int64)
    return counts, wrong.to_numpy(), np.array([*is_unclear, False])[codes]


@dataclass(slots=True)
class Clock:
    """Reader of the clock times of a recording; the first time sets the form and the day."""

    name: str = ""  # of the channel
    first: str = ""  # the first time as written
    dated: bool = False  # whether it has a date
    midnight_ns: int | None = None  # before the first time [ns from 1970-01-01]
    midnights: int = 0  # passed by times of day

    def read(self, times: pd.Series, place: PlaceOf, problems: Problems) -> np.ndarray:
        """Convert clock times to seconds from the midnight before the first; nan for none."""
        self.name = self.name or str(times.name)
        text = times.astype("str").str.strip().reset_index(drop=True)
        self.first = self.first or next(iter(text.dropna()), "")
        counts, wrong, unclear = moments(text)
        self.dated = not re.match(r"\d{1,2}:", self.first)
        missing = text.isna().to_numpy()
        for why, rows in ((NOT_READ, wrong & ~missing & ~unclear), (DAY_OR_MONTH, unclear)):
            at = np.flatnonzero(rows)
            problems.add_alike(
                at,
                lambda i, why=why: f'{self.name} = "{str(text.iloc[i])[:40]}", {why}',  # type: ignore[misc]
                place,
            )
        read, day_ns = ~(wrong | unclear), int(DAY_S * 1e9)
        if self.midnight_ns is None and read.any():
            self.midnight_ns = int(counts[read][0] // day_ns * day_ns)
        return np.where(read, (counts - (self.midnight_ns or 0)) * 1e-9, np.nan)

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
        """Return a note on how the time was obtained."""
        past = f", {self.midnights} times past midnight" if self.midnights else ""
        return [f"{self.name}: seconds are counted from the first, {self.first}{past}"]


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
