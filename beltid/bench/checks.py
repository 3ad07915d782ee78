"""Check that the columns of a recording are plausible."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial
from typing import Final

import numpy as np
import pandas as pd

from beltid.bench.runs import MIN_SAMPLES
from beltid.errors import PlaceOf, Problems
from beltid.tables.columns import Column, Table
from beltid.tables.schemas import NOMINAL, RUN_TEXTS
from beltid.tables.values import absent, outside, shown_value

OTHER_RUN: Final = 100.0
"""Least ratio of the largest run to a run in another unit; benches vary their load far less."""
TRUTHS: Final = {
    **dict.fromkeys(("1", "yes", "ja", "oui"), "true"),
    **dict.fromkeys(("0", "no", "nein", "non"), "false"),
}


class Checker:
    """Check the columns of one recording and collect the problems.

    Parameters
    ----------
    name : str
        Name of the recording, for messages.
    columns : dict of str to ndarray
        The columns, in our names and units; settings that only some rows of a run state are
        filled in, and words brought to their form.
    table : Table
        The schema.
    place : callable
        Index of a row -> its place for messages and its line.
    problems : Problems
        Collects the problems.
    """

    def __init__(
        self,
        name: str,
        columns: dict[str, np.ndarray],
        table: Table,
        place: PlaceOf,
        problems: Problems,
    ) -> None:
        self.name, self.columns, self.table = name, columns, table
        self.place, self.problems = place, problems
        self.suspects: set[str] = set()

    def run(self, units_stated: Collection[str]) -> list[str]:
        """Run all checks; return notes on what is allowed but worth knowing.

        The unit of columns in `units_stated` is not questioned.
        """
        self._units(units_stated)
        timed = "time_s" in self.columns
        codes = self._labels()
        notes: list[str] = []
        for column in self.table.columns:
            if column.name in self.columns and column.choices:
                self._choices(column)
        if timed:
            self._settings(codes)
        for column in self.table.columns:
            if column.dtype == "float64" and column.name in {*self.columns} - self.suspects:
                notes += self._numbers(column)
        if timed:
            self._time(codes)
            if not self.problems.count:
                self._compare_runs(codes, units_stated)
        return notes

    def _report(self, rows: np.ndarray, text: Callable[[int], str]) -> None:
        self.problems.add_alike(rows, text, self.place)

    def _units(self, units_stated: Collection[str]) -> None:
        """Report columns whose numbers are about a thousand times too small or large.

        A few samples of a sensor, most likely of a belt at rest, do not show its unit.
        """
        few = "time_s" in self.columns and len(self.columns["time_s"]) < MIN_SAMPLES
        for column in self.table.columns:
            if column.dtype != "float64" or column.name in units_stated:
                continue
            values = self.columns.get(column.name, np.empty(0))
            finite = values[np.isfinite(values)]
            if not finite.size or (few and column.name not in NOMINAL):
                continue
            if guess := _other_unit(column, self.table.kind, finite):
                setting = f"units: {{{self.table.kind}: {{{column.name}: {guess}}}}}"
                advice = f"if it is in {guess}, say so: {setting}"
                self._report_unit(self.name, column, finite, advice)

    def _report_unit(self, place: str, column: Column, finite: np.ndarray, advice: str) -> None:
        self.suspects.add(column.name)
        span = f"lies between {finite.min():g} and {finite.max():g}"
        self.problems.add(
            f"{place}: {column.name} {span}, not plausible in {column.unit}; {advice}"
        )

    def _compare_runs(self, codes: np.ndarray, units_stated: Collection[str]) -> None:
        """Report runs in another unit than the others."""
        label, idle = self.columns[self.table.label], self.columns.get("idle")
        order = np.argsort(codes, kind="stable")
        runs = np.split(order, np.flatnonzero(np.diff(codes[order])) + 1)
        believed = {*NOMINAL, *units_stated, *self.suspects}
        for column in self.table.columns:
            if column.unit not in ("N", "mm") or column.name in believed:
                continue
            values = [v[np.isfinite(v)] for v in (self.columns[column.name][r] for r in runs)]
            shift = 0.5 if column.unit == "mm" else 0.0  # a travel may begin anywhere
            sizes = [np.abs(v - shift * (v.min() + v.max())).max() if v.size else 0 for v in values]
            for rows, finite, size in zip(runs, values, sizes, strict=True):
                is_small = 0.0 < OTHER_RUN * size < max(sizes)
                guess = _other_unit(column, self.table.kind, finite) if is_small else ""
                if guess and (idle is None or "true" not in idle[rows]):
                    where = f"{self.name}, {self.table.label} {label[rows[0]]}"
                    setting = f"units: {{{self.table.kind}: {{{column.name}: {column.unit}}}}}"
                    advice = f"is this run alone in {guess}? If it is not, say so: {setting}"
                    self._report_unit(where, column, finite, advice)

    def _labels(self) -> np.ndarray:
        """Return the number of the run of every row, -1 without a label."""
        labels = self.columns[self.table.label]
        codes = np.asarray(pd.factorize(labels)[0], dtype=np.int64)
        missing = np.flatnonzero(codes < 0)
        self._report(missing, lambda i: f"{self.table.label} is empty, it must label the recording")
        return codes

    def _settings(self, codes: np.ndarray) -> None:
        """Fill in settings that only some rows of a run state; report those that change in it."""
        for column in (*NOMINAL, *RUN_TEXTS):
            values = self.columns.get(column)
            if values is None:
                continue
            is_text = values.dtype == object
            stated = ~absent(values) & (codes >= 0)
            given = np.flatnonzero(stated)
            _, first = np.unique(codes[given], return_index=True)
            nominal = np.full(codes.max(initial=-1) + 2, None if is_text else np.nan, values.dtype)
            nominal[codes[given[first]]] = values[given[first]]
            expected = nominal[codes]
            same = np.equal if is_text else partial(np.isclose, rtol=1e-6, atol=0.0)
            rows = given[~np.asarray(same(values[given], expected[given]), dtype=bool)]
            _, at = np.unique(codes[rows], return_index=True)  # report the first of every run
            self._report(
                np.sort(rows[at]),
                lambda i, v=values, e=expected, c=column: (  # type: ignore[misc]
                    f"{c} = {shown_value(v[i])}, must stay {shown_value(e[i])} within "
                    f"{self.table.label} {self.columns[self.table.label][i]} (is the label used "
                    "twice?)"
                ),
            )
            np.copyto(values, expected, where=~stated & (codes >= 0))

    def _numbers(self, column: Column) -> list[str]:
        """Check the numbers of a column: range, infinite and missing values."""
        values = self.columns[column.name]
        wrong = np.isinf(values) | outside(values, column)
        negative = int((values < 0.0).sum())
        if column.low == 0.0 and column.unit == "N" and negative > max(9, 0.5 * values.size):
            self.suspects.add(column.name)
            self.problems.add(
                f"{self.name}: {column.name} is negative nearly everywhere; if the sign of the "
                f"cell is reversed, put a minus before its name in the file: columns: "
                f'{{{self.table.kind}: {{{column.name}: "-{column.name}"}}}}'
            )
            return []
        self._report(
            np.flatnonzero(wrong),
            lambda i: f"{column.name} = {values[i]:g}, must be {column.allowed}",
        )
        missing = np.flatnonzero(np.isnan(values))
        if not column.nullable:
            missing = missing[~self._reported(missing)]
            self._report(missing, lambda i: f"{column.name} is empty, must be {column.allowed}")
        elif missing.size == values.size and values.size and column.required:
            self.problems.add(f"{self.name}: {column.name} holds no numbers")
        elif missing.size and missing.size < values.size:
            return [f"{missing.size} of {values.size} samples of {column.name} are missing"]
        return []

    def _reported(self, rows: np.ndarray) -> np.ndarray:
        """Return which rows have been reported already: an unreadable cell or no label."""
        reported = absent(self.columns[self.table.label][rows])
        if self.problems.unread:
            unread = [self.place(int(i))[0] in self.problems.unread for i in rows]
            reported |= np.array(unread, dtype=bool)
        return reported

    def _choices(self, column: Column) -> None:
        """Check a column that allows certain words only; case does not matter, and 1 is true."""
        truths = TRUTHS if column.choices == ("true", "false") else {}
        values = self.columns[column.name]
        words = {
            word: None if word is None else truths.get(word.lower(), word.lower())
            for word in set(values)
        }
        wrong = {word for word, low in words.items() if low not in (None, *column.choices)}
        if wrong:
            rows = np.flatnonzero([v in wrong for v in values])
            self._report(rows, lambda i: f"{column.name} = {values[i]}, must be {column.allowed}")
        values[:] = [words[word] for word in values]

    def _time(self, codes: np.ndarray) -> None:
        """Report times that go backwards within a run."""
        time, label = self.columns["time_s"], self.columns[self.table.label]
        order = np.argsort(codes, kind="stable")
        back = (np.diff(time[order]) < 0) & (np.diff(codes[order]) == 0) & (codes[order][1:] >= 0)
        rows = order[1:][back]
        before = dict(zip(rows.tolist(), time[order[:-1][back]].tolist(), strict=True))
        self._report(
            np.sort(rows),
            lambda i: (
                f"time_s = {time[i]:g} after {before[i]:g} in {self.table.label} {label[i]}, "
                "must not go backwards (is the label used twice?)"
            ),
        )


def _other_unit(column: Column, kind: str, finite: np.ndarray) -> str:
    """Return the unit in which the numbers would be plausible, or "" if they are so already.

    The bounds are about halfway, on a logarithmic scale, between what belt benches record (tensions
    of 20 to 2000 N, forces of 50 to 3000 N, travels of 0.03 to 5 mm) and a thousandth or a thousand
    times that.
    """
    size = np.abs(finite)
    if kind == "points" and column.name != "arc_deg":
        return ""  # tables written by hand, for belts of any size
    if column.unit == "N" and "tension" in column.name:
        if finite.max() > 0.0 and size.max() < 5.0:
            return "kN"
        return "mN" if np.median(size) > 1e4 else ""
    if column.name == "force_N":
        if size.max() < 5.0:
            return "kN"
        return "mN" if size.max() > 2e4 else ""
    if column.name == "displacement_mm":
        travel = float(np.ptp(finite))
        if travel > 30.0:
            return "um" if travel < 1e6 else ""
        return "m" if 0 < travel < 5e-3 else ""
    if column.name == "torque_N_m":
        if 0 < size.max() < 0.1:
            return "kN m"
        return "N mm" if size.max() > 1000.0 else ""
    if column.name == "arc_deg":
        return "rad" if size.max() < 2 * np.pi else ""
    if column.name == "temperature_degC":
        return "K" if finite.min() > 200.0 else ""
    return ""
