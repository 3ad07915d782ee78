"""Convert clock times and time stamps to the time of a recording: seconds from its first sample.

Reads times of day (``13:45:02,125``, ``1:45:02 PM``), alone, after a date or with a column of
dates, with or without a zone, and the times and time stamps of Arrow. Dates are read only here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from beltid.errors import PlaceOf, Problems

DAY_S: Final = 86400.0
MIDNIGHT_S: Final = 0.5 * DAY_S
"""A larger drop in the time of day means midnight: a 12-hour clock cannot drop by as much."""
LONGEST: Final = 80
MOST_SHAPES: Final = 50
"""Maximum number of ways to write times of one length: am and pm, signs of zones."""
_DATE: Final = r"(?P<a>\d{4}|\d{1,2})(?P<mark>[-./])(?P<b>\d{1,2})(?P=mark)(?P<c>\d{4}|\d{1,2})"
_TIME: Final = (
    r"(?P<h>\d{1,2}):(?P<m>\d\d):(?P<s>\d\d)(?:(?:[.,]|:(?=(?:\d{3}){1,2}(?!\d)))(?P<f>\d{1,30}))?"
)
_HALF: Final = r"(?:\s*(?P<half>[AaPp])\.?\s?[Mm]\.?)?"
_OFFSET: Final = r"(?P<sign>[-+])(?P<zh>\d\d):?(?P<zm>\d\d)?"
_ZONE: Final = rf"(?:\s*(?P<zone>Z|UTC|GMT|{_OFFSET}))?"
_CLOCK: Final = re.compile(rf"\s*(?:{_DATE}(?:T|,?\s+))?{_TIME}{_HALF}{_ZONE}\s*", re.ASCII)
_CLOCK_CUT: Final = re.compile(r"\s*\d{1,3}:\d\d(?:[.,]\d+)?\s*", re.ASCII)
"""A clock time cut by a spreadsheet: minutes and seconds, or hours and minutes."""
_DATE_ALONE: Final = re.compile(rf"\s*{_DATE}(?:[T ]00:00(?::00(?:[.,]0+)?)?)?\s*", re.ASCII)

NOT_READ: Final = "must be a clock time such as 13:45:02.125 or 2026-11-20T13:45:02+01:00"
UNLIKE: Final = "must be like the first time: with or without a date, with or without a zone"
DAY_OR_MONTH: Final = "may be day/month or month/day: write dates as 2026-11-20"


def is_date(cell: str) -> bool:
    """Whether a cell is a date without a time; spreadsheets may append midnight."""
    return len(cell) <= LONGEST and bool(_DATE_ALONE.fullmatch(cell))


def is_clock(cell: str) -> bool:
    """Whether a cell is a time of day, with or without a date and a zone."""
    return len(cell) <= LONGEST and bool(_CLOCK.fullmatch(cell))


def written_as(cells: Sequence[str]) -> str:
    """Classify the first filled cells of a column as "date", "clock", or "" for anything else.

    A clock time that was cut counts as a clock time; its reader refuses it.
    """
    if cells and all(map(is_date, cells)):
        return "date"
    return "clock" if cells and (is_clock(cells[0]) or _CLOCK_CUT.fullmatch(cells[0])) else ""


@dataclass(slots=True)
class Clock:
    """Reader of the clock times of one channel, block by block; the first time sets the form.

    Attributes
    ----------
    name : str
        Name of the channel, for messages.
    first : str
        The first time as written.
    dated, zoned : bool
        Whether the first time has a date, and a zone.
    day_first : bool or None
        Whether the day comes before the month in dates such as 20/11/2026; None if that is
        ambiguous.
    first_day : int
        Day of the first time, counted from 1970-01-01; seconds are counted from its midnight.
    midnights : int
        Number of times that a time of day has passed midnight.
    """

    name: str
    first: str = ""
    dated: bool = False
    zoned: bool = False
    day_first: bool | None = None
    first_day: int = 0
    midnights: int = 0

    def read(self, times: Any, dates: Any = None) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Convert clock times to seconds.

        Parameters
        ----------
        times : pyarrow Array or ChunkedArray
            Texts, times of day or time stamps, shape (n,).
        dates : pyarrow Array or ChunkedArray, optional
            Dates of times of day, or their texts, shape (n,).

        Returns
        -------
        seconds : ndarray
            Seconds from the midnight before the first time, shape (n,); for a time of day without a
            date, from its own midnight; nan where there is no time.
        wrong : dict of str to ndarray
            Reason -> the rows that cannot be read for this reason.
        """
        import pyarrow as pa
        import pyarrow.compute as pc

        times = _plain(times)
        if dates is not None and not _are_dated(times):
            days = pc.replace_substring_regex(_plain(dates).cast(pa.string()), r"[T ]00:00.*", "")
            times = pc.binary_join_element_wise(days, times.cast(pa.string()), " ")
        if not (pa.types.is_string(times.type) or pa.types.is_large_string(times.type)):
            return self._of_arrow(times)
        return self._of_texts(times)

    def _of_arrow(self, times: Any) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Convert Arrow's times of day and time stamps; stamps with a zone are stored as UTC."""
        import pyarrow as pa

        self.dated = pa.types.is_timestamp(times.type)
        self.zoned = self.dated and times.type.tz is not None
        per_second = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[times.type.unit]
        counts = times.cast(pa.int32() if times.type.bit_width == 32 else pa.int64())
        filled = np.flatnonzero(~np.asarray(times.is_null()))
        if not self.first and filled.size:
            self.first = str(times[int(filled[0])])
            if self.dated:
                self.first_day = counts[int(filled[0])].as_py() // (86400 * per_second)
        # subtract the first midnight as integers: nanoseconds have 19 digits
        whole = (
            np.asarray(counts.cast(pa.int64()).fill_null(0)) - self.first_day * 86400 * per_second
        )
        seconds = whole / per_second
        seconds[np.asarray(times.is_null())] = np.nan
        return seconds, {}

    def _of_texts(self, times: Any) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        seconds = np.full(len(times), np.nan)
        wrong: dict[str, list[np.ndarray]] = {}
        shapes = list(_shapes(times))
        for rows, digits, shape in sorted(shapes, key=lambda rows_alike: int(rows_alike[0][0])):
            match = _CLOCK.fullmatch(shape)
            if match is None:
                wrong.setdefault(NOT_READ, []).append(rows)
                continue
            if not self.first:
                self._learn(times[int(rows[0])].as_py().strip(), match, digits)
            if (match["a"] is not None, match["zone"] is not None) != (self.dated, self.zoned):
                wrong.setdefault(UNLIKE, []).append(rows)
                continue
            values, bad = _time_of_day(match, digits)
            wrong.setdefault(NOT_READ, []).append(rows[bad])
            if self.dated:
                days, no_day, unclear = self._days(match, digits)
                wrong.setdefault(NOT_READ, []).append(rows[no_day])
                wrong.setdefault(DAY_OR_MONTH, []).append(rows[unclear])
                values += (days - self.first_day) * DAY_S
            seconds[rows] = values
        return seconds, {why: rows for why, parts in wrong.items() if (rows := _joined(parts)).size}

    def _learn(self, text: str, match: re.Match[str], digits: np.ndarray) -> None:
        """Learn the form of the times from the first one."""
        self.first, self.dated, self.zoned = text, match["a"] is not None, match["zone"] is not None
        if self.dated:
            a, b = (int(_number(digits[:1], match.span(part))[0]) for part in "ab")
            is_day_first = match["mark"] == "." or a > 12 or a == b
            self.day_first = is_day_first or (None if b <= 12 else False)
            self.first_day = int(self._days(match, digits[:1])[0][0])

    def _days(
        self, match: re.Match[str], digits: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return days from 1970-01-01, and masks of invalid and of ambiguous dates."""
        a, b, c = (_number(digits, match.span(part)) for part in "abc")
        unclear = np.zeros(len(digits), dtype=bool)
        if len(match["a"]) == 4:
            year, month, day = a, b, c
        else:
            year = c + (2000 if len(match["c"]) < 4 else 0)
            day, month = (b, a) if self.day_first is False else (a, b)
        months = ((year - 1970) * 12 + month - 1).astype("datetime64[M]")
        days = months.astype("datetime64[D]") + (day - 1)
        bad = (month < 1) | (month > 12) | (days.astype("datetime64[M]") != months)
        if len(match["a"]) < 4 and self.day_first is None and self.first_day:
            # on the first day itself the order does not matter
            unclear = days.astype(np.int64) != self.first_day
        return days.astype(np.int64), bad & ~unclear, unclear

    def elapsed(
        self,
        seconds: np.ndarray,
        place: PlaceOf,
        problems: Problems,
        runs: np.ndarray | None = None,
        *,
        from_first: bool = True,
    ) -> np.ndarray:
        """Return the times of samples [s], continued past midnight; report any other step back.

        Parameters
        ----------
        seconds : ndarray
            Seconds from `read`, shape (n,).
        place : callable
            Index of a sample -> its location as text, and its line.
        problems : Problems
            Collects times that go back and times that are too coarse for the samples.
        runs : ndarray of int, optional
            Number of the run of every sample, shape (n,); each run has its own time.
        from_first : bool
            Whether to count from the first sample of the run.

        Returns
        -------
        ndarray
            Times [s], shape (n,).
        """
        time = seconds.copy()
        numbers = np.zeros(len(time), dtype=np.int64) if runs is None else runs
        order = np.argsort(numbers, kind="stable")
        order = order[np.isfinite(time[order])]
        starts = np.flatnonzero(np.diff(numbers[order])) + 1
        for rows in np.split(order, starts):
            if not rows.size:
                continue
            steps = np.diff(time[rows])
            nights = np.zeros(0) if self.dated else np.cumsum(steps < -MIDNIGHT_S)
            back = np.flatnonzero((steps < 0) & (self.dated | (steps >= -MIDNIGHT_S)))
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
            if nights.size:
                time[rows[1:]] += nights * DAY_S
                self.midnights += int(nights[-1])
            if from_first:
                time[rows] -= time[rows[0]]
        return np.round(time, 9)  # finer digits are rounding errors

    def report_wrong(
        self,
        wrong: dict[str, np.ndarray],
        cells: Any,
        place: PlaceOf,
        problems: Problems,
    ) -> None:
        """Report the rows that `read` could not convert."""
        for why, rows in wrong.items():

            def text(i: int, why: str = why) -> str:
                return f'{self.name} = "{str(cells[i])[:40]}", {why}'

            problems.add_alike(rows, text, place)
            problems.unread.update(place(int(row))[0] for row in rows)

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


def _are_dated(times: Any) -> bool:
    """Whether Arrow times, or the first of their texts, include a date."""
    import pyarrow as pa

    if pa.types.is_timestamp(times.type) or pa.types.is_time(times.type):
        return bool(pa.types.is_timestamp(times.type))
    match = _CLOCK.fullmatch(next((t.as_py() for t in times if t.is_valid), ""))
    return match is not None and match["a"] is not None


def _plain(values: Any) -> Any:
    """Return an Arrow array in one chunk, with dictionaries decoded."""
    import pyarrow as pa

    if isinstance(values, pa.ChunkedArray):
        values = values.combine_chunks()
        if isinstance(values, pa.ChunkedArray):
            values = values.chunk(0) if values.num_chunks else pa.array([], values.type)
    return values.dictionary_decode() if pa.types.is_dictionary(values.type) else values


def _shapes(texts: Any) -> Iterator[tuple[np.ndarray, np.ndarray, str]]:
    """Yield groups of rows that differ only in digits: rows, their bytes, and the common pattern.

    The pattern is empty for texts that are too long or written in too many ways to be times.
    """
    import pyarrow as pa

    texts = texts.cast(pa.large_string())
    offsets = np.frombuffer(texts.buffers()[1], np.int64)[
        texts.offset : texts.offset + len(texts) + 1
    ]
    data = np.frombuffer(texts.buffers()[2] or b"", np.uint8)
    lengths = np.where(np.asarray(texts.is_null()), 0, np.diff(offsets))
    if (long := np.flatnonzero(lengths > LONGEST)).size:
        yield long, data[:0], ""
    for length in np.unique(lengths[(lengths > 0) & (lengths <= LONGEST)]).tolist():
        rows = np.flatnonzero(lengths == length)
        signs = data[offsets[rows, None] + np.arange(length)]
        masked = np.where((signs >= ord("0")) & (signs <= ord("9")), ord("0"), signs)
        for _ in range(MOST_SHAPES):
            alike = (masked == masked[0]).all(axis=1)
            yield rows[alike], signs[alike], masked[0].tobytes().decode(errors="replace")
            rows, signs, masked = rows[~alike], signs[~alike], masked[~alike]
            if not rows.size:
                break
        else:
            yield rows, signs, ""


def _number(signs: np.ndarray, span: tuple[int, int], most: int = 9) -> np.ndarray:
    """Read the integers in the same columns of all texts."""
    start, end = span[0], min(span[1], span[0] + most)
    powers = 10 ** np.arange(end - start - 1, -1, -1, dtype=np.int64)
    numbers: np.ndarray = (signs[:, start:end].astype(np.int64) - ord("0")) @ powers
    return numbers


def _time_of_day(match: re.Match[str], signs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return seconds from midnight less the offset of the zone, and a mask of invalid times."""
    hour, minute, second = (_number(signs, match.span(part)) for part in "hms")
    bad = (hour > 23) | (minute > 59) | (second > 59)
    if match["half"]:
        bad |= (hour < 1) | (hour > 12)
        hour = hour % 12 + (12 if match["half"] in "pP" else 0)
    values = (hour * 3600 + minute * 60 + second).astype(float)
    if match["f"]:
        length = min(len(match["f"]), 9)
        values += _number(signs, match.span("f")) / 10**length
    if match["zh"]:
        ahead = _number(signs, match.span("zh")) * 3600
        if match["zm"]:
            ahead += _number(signs, match.span("zm")) * 60
        values -= ahead if match["sign"] == "+" else -ahead
    return values, bad


def _joined(parts: Sequence[np.ndarray]) -> np.ndarray:
    return np.sort(np.concatenate(parts))


def _shown(seconds: float) -> str:
    """Format seconds from midnight as a time of day."""
    whole, milliseconds = divmod(round(seconds % DAY_S * 1000), 1000)
    text = f"{whole // 3600:02d}:{whole // 60 % 60:02d}:{whole % 60:02d}"
    return f"{text}.{milliseconds:03d}" if milliseconds else text
