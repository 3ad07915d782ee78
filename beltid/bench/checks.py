"""Check that the columns of a recording are plausible."""

from __future__ import annotations

from collections.abc import Callable, Collection
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

    Settings that only some rows of a run state are filled in, and words brought to their form.
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
        self.kind = "rig" if table.kind == "points" else table.kind  # of which a config speaks
        self.label, self.timed = columns[table.label], "time_s" in columns
        self.codes = np.asarray(pd.factorize(self.label)[0], dtype=np.int64)
        self.suspects: set[str] = set()

    def run(self, units_stated: Collection[str]) -> list[str]:
        """Run all checks; return notes on what is allowed but worth knowing.

        The unit of columns in `units_stated` is not questioned.
        """
        self._units(units_stated)
        missing = np.flatnonzero(self.codes < 0)
        self._report(missing, lambda i: f"{self.table.label} is empty, it must label the recording")
        present = [column for column in self.table.columns if column.name in self.columns]
        for column in present:
            if column.choices:
                self._choices(column)
        if self.timed:
            self._settings()
        notes: list[str] = []
        for column in present:
            if column.dtype == "float64" and column.name not in self.suspects:
                notes += self._numbers(column)
        if self.timed:
            self._time()
            if not self.problems.count:
                self._compare_runs(units_stated)
        return notes

    def _report(self, rows: np.ndarray, text: Callable[[int], str]) -> None:
        self.problems.add_alike(rows, text, self.place)

    def _units(self, units_stated: Collection[str]) -> None:
        """Report columns whose numbers are about a thousand times too small or large.

        A few samples of a sensor, most likely of a belt at rest, do not show its unit.
        """
        few = self.timed and len(self.columns["time_s"]) < MIN_SAMPLES
        for column in self.table.columns:
            if column.dtype != "float64" or column.name in units_stated:
                continue
            values = self.columns.get(column.name, np.empty(0))
            finite = values[np.isfinite(values)]
            if not finite.size or (few and column.name not in NOMINAL):
                continue
            if guess := other_unit(column, self.table.kind, finite):
                advice = f"if it is in {guess}, say so"
                self._report_unit(self.name, column, finite, advice, guess)

    def _report_unit(
        self, place: str, column: Column, finite: np.ndarray, advice: str, unit: str
    ) -> None:
        self.suspects.add(column.name)
        span = f"lies between {finite.min():g} and {finite.max():g}"
        self.problems.add(
            f"{place}: {column.name} {span}, not plausible in {column.unit}; {advice}: "
            f"units: {{{self.kind}: {{{column.name}: {unit}}}}}"
        )

    def _compare_runs(self, units_stated: Collection[str]) -> None:
        """Report runs in another unit than the others."""
        idle = self.columns.get("idle")
        order = np.argsort(self.codes, kind="stable")
        starts = np.flatnonzero(np.diff(self.codes[order], prepend=-1))
        believed = {*NOMINAL, *units_stated, *self.suspects}
        for column in self.table.columns:
            if column.unit not in ("N", "mm") or column.name in believed:
                continue
            values = self.columns[column.name][order]
            low, high = (f.reduceat(values, starts) for f in (np.fmin, np.fmax))
            sizes = np.maximum(np.abs(low), np.abs(high))
            if column.unit == "mm":  # a travel may begin anywhere
                sizes = 0.5 * (high - low)
            for run in np.flatnonzero((sizes > 0.0) & (OTHER_RUN * sizes < np.fmax.reduce(sizes))):
                rows = order[starts[run] : [*starts, len(order)][run + 1]]
                finite = self.columns[column.name][rows]
                finite = finite[np.isfinite(finite)]
                guess = other_unit(column, self.table.kind, finite)
                if guess and (idle is None or "true" not in idle[rows]):
                    where = f"{self.name}, {self.table.label} {self.label[rows[0]]}"
                    advice = f"is this run alone in {guess}? If it is not, say so"
                    self._report_unit(where, column, finite, advice, column.unit)

    def _settings(self) -> None:
        """Fill in settings that only some rows of a run state; report those that change in it."""
        codes = self.codes
        for column in (*NOMINAL, *RUN_TEXTS):
            values = self.columns.get(column)
            if values is None:
                continue
            is_text = values.dtype == object
            stated = ~absent(values) & (codes >= 0)
            nominal = np.full(codes.max(initial=-1) + 2, None if is_text else np.nan, values.dtype)
            backwards = np.flatnonzero(stated)[::-1]  # the first row of a run is written last
            nominal[codes[backwards]] = values[backwards]
            expected = nominal[codes]
            rows = np.flatnonzero((values != expected) & stated)
            if not is_text:
                rows = rows[~np.isclose(values[rows], expected[rows], rtol=1e-6, atol=0.0)]
            _, at = np.unique(codes[rows], return_index=True)  # report the first of every run
            self._report(
                rows[np.sort(at)],
                lambda i, v=values, e=expected, c=column: (  # type: ignore[misc]
                    f"{c} = {shown_value(v[i])}, must stay {shown_value(e[i])} within "
                    f"{self.table.label} {self.label[i]} (is the label used twice?)"
                ),
            )
            if not stated.all():
                self.columns[column] = np.where(stated | (codes < 0), values, expected)

    def _numbers(self, column: Column) -> list[str]:
        """Check the numbers of a column: range, infinite and missing values."""
        values = self.columns[column.name]
        negative = int((values < 0.0).sum())
        if column.low == 0.0 and column.unit == "N" and negative > max(9, 0.5 * values.size):
            self.problems.add(
                f"{self.name}: {column.name} is negative nearly everywhere; if the sign of the "
                f"cell is reversed, put a minus before its name in the file: columns: "
                f'{{{self.kind}: {{{column.name}: "-{column.name}"}}}}'
            )
            return []
        self._report(
            np.flatnonzero(np.isinf(values) | outside(values, column)),
            lambda i: f"{column.name} = {values[i]:g}, must be {column.allowed}",
        )
        missing = np.flatnonzero(np.isnan(values))
        if not column.nullable:
            unread = self.problems.unread
            told = absent(self.label[missing])  # no label, or an unreadable cell
            if unread:
                told |= np.array([self.place(int(i))[0] in unread for i in missing], dtype=bool)
            allowed = f"{column.name} is empty, must be {column.allowed}"
            self._report(missing[~told], lambda i: allowed)
        elif missing.size == values.size and values.size and column.required:
            self.problems.add(f"{self.name}: {column.name} holds no numbers")
        elif missing.size and missing.size < values.size:
            return [f"{missing.size} of {values.size} samples of {column.name} are missing"]
        return []

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

    def _time(self) -> None:
        """Report times that go backwards within a run."""
        time, codes = self.columns["time_s"], self.codes
        order = np.argsort(codes, kind="stable")
        back = (np.diff(time[order]) < 0) & (np.diff(codes[order]) == 0) & (codes[order][1:] >= 0)
        rows = order[1:][back]
        before = dict(zip(rows.tolist(), time[order[:-1][back]].tolist(), strict=True))
        self._report(
            np.sort(rows),
            lambda i: (
                f"time_s = {time[i]:g} after {before[i]:g} in {self.table.label} {self.label[i]}, "
                "must not go backwards (is the label used twice?)"
            ),
        )


def other_unit(column: Column, kind: str, finite: np.ndarray) -> str:
    """Return the unit in which the numbers would be plausible, or "" if they are so already.

    The bounds are about halfway, on a logarithmic scale, between what belt benches record (tensions
    of 20 to 2000 N, forces of 50 to 3000 N, travels of 0.03 to 5 mm) and a thousandth or a thousand
    times that.
    """
    largest, name = np.abs(finite).max(), column.name
    travel = float(np.ptp(finite))
    if kind == "points" and name != "arc_deg":
        return ""  # tables written by hand, for belts of any size
    is_tension = column.unit == "N" and "tension" in name
    plausible = (
        (is_tension and finite.max() > 0.0 and largest < 5.0, "kN"),
        (is_tension and np.median(np.abs(finite)) > 1e4, "mN"),
        (name == "force_N" and largest < 5.0, "kN"),
        (name == "force_N" and largest > 2e4, "mN"),
        (name == "displacement_mm" and 30.0 < travel < 1e6, "um"),
        (name == "displacement_mm" and 0.0 < travel < 5e-3, "m"),
        (name == "torque_N_m" and 0.0 < largest < 0.1, "kN m"),
        (name == "torque_N_m" and largest > 1000.0, "N mm"),
        (name == "arc_deg" and largest < 2 * np.pi, "rad"),
        (name == "temperature_degC" and finite.min() > 200.0, "K"),
    )
    return next((unit for holds, unit in plausible if holds), "")
