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
import pyarrow as pa
import pyarrow.compute as pc

from beltid.errors import PlaceOf, Problems

DAY_S: Final = 86400.0
_DATE: Final = (
    r"(?P<a>\d{4}|\d{1,2})(?P<mark>[-./])(?P<b>\d{1,2})(?P<mark2>[-./])(?P<c>\d{4}|\d{1,2})"
)
_TIME: Final = (
    r"(?P<h>\d{1,2}):(?P<m>\d\d):(?P<s>\d\d)(?:[.,](?P<f>\d{1,30})|:(?P<ms>\d{3}|\d{6}))?"
)
_REST: Final = (
    r"(?:\s*(?P<half>[AaPp])\.?\s?[Mm]\.?)?"
    r"(?:\s*(?P<zone>Z|UTC|GMT|(?P<sign>[-+])(?P<zh>\d\d):?(?P<zm>\d\d)?))?"
)
_CLOCK: Final = rf"\s*(?:{_DATE}(?:T|,?\s+))?{_TIME}{_REST}\s*"
_IS_CLOCK: Final = re.compile(_CLOCK, re.ASCII)
_CUT: Final = re.compile(r"\s*\d{1,3}:\d\d(?:[.,]\d+)?\s*", re.ASCII)
"""A clock time cut by a spreadsheet: minutes and seconds, or hours and minutes."""
_IS_DATE: Final = re.compile(rf"\s*{_DATE}(?:[T ]00:00(?::00(?:[.,]0+)?)?)?\s*", re.ASCII)
NOT_READ: Final = "must be a clock time such as 13:45:02.125 or 2026-11-20T13:45:02+01:00"
UNLIKE: Final = "must be like the first time: with or without a date, with or without a zone"
DAY_OR_MONTH: Final = "may be day/month or month/day: write dates as 2026-11-20"


def is_date(cell: str) -> bool:
    """Return whether a cell is a date without a time; spreadsheets may append midnight."""
    return len(cell) <= 80 and bool(_IS_DATE.fullmatch(cell))


def is_clock(cell: str) -> bool:
    """Return whether a cell is a time of day, with or without a date and a zone."""
    return len(cell) <= 80 and bool(_IS_CLOCK.fullmatch(cell))


def written_as(cells: Sequence[str]) -> str:
    """Classify the first filled cells of a column: "date", "clock", or "" for anything else."""
    if cells and all(map(is_date, cells)):
        return "date"
    return "clock" if cells and (is_clock(cells[0]) or _CUT.fullmatch(cells[0])) else ""


@dataclass(slots=True)
class Clock:
    """Reader of the clock times of a recording; the first time sets the form and the day.

    Attributes
    ----------
    name, first : str
        Name of the channel, and the first time as written.
    dated, zoned : bool
        Whether the first time has a date, and a zone.
    first_day : int
        Day of the first time, from 1970-01-01; seconds are counted from its midnight.
    midnights : int
        Number of times that a time of day has passed midnight.
    """

    name: str = ""
    first: str = ""
    dated: bool = False
    zoned: bool = False
    first_day: int = 0
    midnights: int = 0

    def read(
        self, times: pd.Series, dates: pd.Series | None, place: PlaceOf, problems: Problems
    ) -> np.ndarray:
        """Convert clock times to seconds from the midnight before the first; nan if there is none.

        Parameters
        ----------
        times, dates : Series
            Texts, and the texts of dates beside them, shape (n,).
        place : callable
            Index of a row -> its location as text, and its line.
        problems : Problems
            Collects times that cannot be read, with their lines.
        """
        self.name = self.name or str(times.name)
        if dates is not None and not re.match(r"\s*\d+[-./]", next(iter(times.dropna()), "")):
            day = dates.astype("str").str.replace(r"[T ]00:00.*", "", regex=True)
            times = (day + " " + times.astype("str")).rename(str(times.name))
        texts = pa.array(times, pa.string(), from_pandas=True)
        parts = pc.extract_regex(texts, rf"\A{_CLOCK}\z")
        filled = ~np.asarray(texts.is_null())
        wrong = {NOT_READ: filled & np.asarray(parts.is_null())}
        rows = np.flatnonzero(filled & ~wrong[NOT_READ])
        seconds = np.full(len(times), np.nan)
        if rows.size:
            kept = parts.take(pa.array(rows))
            columns = {f.name: kept.field(i) for i, f in enumerate(kept.type)}
            values, reasons = self._seconds(columns, str(times.iloc[rows[0]]).strip())
            seconds[rows] = values
            for why, mask in reasons.items():
                wrong.setdefault(why, np.zeros(len(times), dtype=bool))[rows] |= mask
        for why, mask in wrong.items():
            at = np.flatnonzero(mask)
            seconds[at] = np.nan
            problems.add_alike(
                at,
                lambda i, why=why: f'{self.name} = "{str(times.iloc[i])[:40]}", {why}',  # type: ignore[misc]
                place,
            )
            problems.unread.update(place(int(row))[0] for row in at)
        return seconds

    def _seconds(
        self, parts: dict[str, pa.Array], first: str
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return the seconds of times in parts, and masks of those that are wrong, by reason."""

        def numbers(name: str) -> np.ndarray:
            filled = pc.if_else(pc.equal(parts[name], ""), "0", parts[name])
            return np.asarray(filled.cast(pa.int64()))

        def has(name: str) -> np.ndarray:
            return np.asarray(pc.not_equal(parts[name], ""))

        hour, minute, second = (numbers(part) for part in "hms")
        bad = (hour > 23) | (minute > 59) | (second > 59)
        if has("half").any():
            half = has("half")
            bad |= half & ((hour < 1) | (hour > 12))
            late = np.asarray(pc.equal(pc.utf8_lower(parts["half"]), "p"))
            hour = np.where(half, hour % 12 + 12 * late, hour)
        fraction = pc.binary_join_element_wise(
            "0.", pc.utf8_slice_codeunits(parts["f"], 0, 9), parts["ms"], "0", ""
        )
        seconds = (hour * 3600 + minute * 60 + second) + np.asarray(fraction.cast(pa.float64()))
        ahead = numbers("zh") * 3600 + numbers("zm") * 60
        seconds -= np.where(np.asarray(pc.equal(parts["sign"], "-")), -ahead, ahead)
        dated, zoned = has("a"), has("zone")
        is_first = not self.first
        if is_first:
            self.first, self.dated, self.zoned = first, bool(dated[0]), bool(zoned[0])
        wrong = {NOT_READ: bad, UNLIKE: (dated != self.dated) | (zoned != self.zoned)}
        if not self.dated:
            return seconds, wrong
        a, b, c = (numbers(part) for part in "abc")
        is_iso = np.asarray(pc.equal(pc.utf8_length(parts["a"]), 4))
        with_points = np.asarray(pc.equal(parts["mark"], "."))
        # 20/11 shows the order for all dates of the column; 03/04 alone does not
        month_first = bool((~is_iso & ~with_points & (b > 12)).any())
        shown = month_first or bool(((a > 12) & ~is_iso).any() or (with_points | is_iso).all())
        year = np.where(is_iso, a, np.where(c < 100, c + 2000, c))
        month = np.where(is_iso, b, a if month_first else b)
        day = np.where(is_iso, c, b if month_first else a)
        months = ((year - 1970) * 12 + month - 1).astype("datetime64[M]")
        days = months.astype("datetime64[D]") + (day - 1)
        no_date = (month < 1) | (month > 12) | (days.astype("datetime64[M]") != months)
        no_date |= np.asarray(pc.not_equal(parts["mark"], parts["mark2"]))
        number = days.astype(np.int64)
        if is_first:
            self.first_day = int(number[0])
        if not shown:  # on the first day itself the order does not matter
            wrong[DAY_OR_MONTH] = ~is_iso & (number != self.first_day)
            no_date &= ~wrong[DAY_OR_MONTH]
        wrong[NOT_READ] = bad | (no_date & ~wrong[UNLIKE])
        return seconds + (number - self.first_day) * DAY_S, wrong

    def elapsed(
        self, seconds: np.ndarray, runs: np.ndarray, place: PlaceOf, problems: Problems
    ) -> np.ndarray:
        """Return the times from the first sample of each run [s], continued past midnight.

        Parameters
        ----------
        seconds : ndarray
            Seconds from `read`, shape (n,).
        runs : ndarray of int
            Number of the run of every sample, shape (n,).
        place : callable
            Index of a sample -> its location as text, and its line.
        problems : Problems
            Collects times that go back, and times that are too coarse for the samples.
        """
        time = seconds.copy()
        order = np.argsort(runs, kind="stable")
        order = order[np.isfinite(time[order])]
        for rows in np.split(order, np.flatnonzero(np.diff(runs[order])) + 1):
            if not rows.size:
                continue
            steps = np.diff(time[rows])
            night = (steps < -0.5 * DAY_S) & (not self.dated)
            back = np.flatnonzero((steps < 0) & ~night)
            if back.size:
                before, after = rows[back[0]], rows[back[0] + 1]
                where, line = place(int(after))
                more = f"; it goes back {back.size - 1} more times" if back.size > 1 else ""
                problems.add(
                    f"{where}: {self.name} goes back from {_shown(time[before])} to "
                    f"{_shown(time[after])} without passing midnight, must not go backwards{more}",
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
            time[rows] -= time[rows[0]]
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


def _shown(seconds: float) -> str:
    """Format seconds from midnight as a time of day."""
    return str(pd.Timestamp(0) + pd.Timedelta(round(seconds % DAY_S, 3), "s"))[11:23]
