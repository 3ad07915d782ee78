"""Check that the columns of a recording are plausible."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Final

import numpy as np
import pandas as pd

from beltid.bench.runs import MIN_SAMPLES
from beltid.errors import PlaceOf, Problems
from beltid.tables.schemas import NOMINAL, RUN_TEXTS, Column, Table
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

    def run(self, units_stated: Collection[str]) -> list[str]:
        """Run all checks; return notes on what is allowed but worth knowing.

        The unit of columns in `units_stated` is not questioned.
        """
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
            if column.dtype == "float64":
                is_doubted = column.name not in units_stated and self._doubts_unit(column)
                notes += [] if is_doubted else self._numbers(column)
        if self.timed:
            self._time()
            for column in present if not self.problems.count else ():
                if column.unit in ("N", "mm") and column.name not in {*NOMINAL, *units_stated}:
                    self._compare_runs(column)
        return notes

    def _report(self, rows: np.ndarray, text: Callable[[int], str]) -> None:
        self.problems.add_alike(rows, text, self.place)

    def _doubts_unit(self, column: Column) -> bool:
        """Report a column whose numbers are about a thousand times too small or large."""
        # a few samples of a sensor, most likely of a belt at rest, do not show its unit
        few = self.timed and len(self.columns["time_s"]) < MIN_SAMPLES
        values = self.columns[column.name]
        guess = other_unit(column, self.table.kind, values)
        if not guess or (few and column.name not in NOMINAL):
            return False
        self._report_unit(self.name, column, values, f"if it is in {guess}, say so", guess)
        return True

    def _report_unit(
        self, place: str, column: Column, values: np.ndarray, advice: str, unit: str
    ) -> None:
        span = f"lies between {np.nanmin(values):g} and {np.nanmax(values):g}"
        self.problems.add(
            f"{place}: {column.name} {span}, not plausible in {column.unit}; {advice}: "
            f"units: {{{self.kind}: {{{column.name}: {unit}}}}}"
        )

    def _compare_runs(self, column: Column) -> None:
        """Report runs whose numbers are in another unit than those of the others."""
        values, idle = self.columns[column.name], self.columns.get("idle")
        runs = pd.Series(values).groupby(self.codes)
        low, high = runs.min(), runs.max()
        size = (high - low) / 2 if column.unit == "mm" else high.abs().combine(low.abs(), max)
        sizes, largest = size.to_dict(), size.max()
        for run, rows in runs.indices.items():
            if not 0.0 < OTHER_RUN * sizes[run] < largest:
                continue
            guess = other_unit(column, self.table.kind, values[rows])
            if guess and (idle is None or "true" not in idle[rows]):
                where = f"{self.name}, {self.table.label} {self.label[rows[0]]}"
                advice = f"is this run alone in {guess}? If it is not, say so"
                self._report_unit(where, column, values[rows], advice, column.unit)

    def _settings(self) -> None:
        """Fill in settings that only some rows of a run state; report those that change in it."""
        codes = self.codes
        for column in (*NOMINAL, *RUN_TEXTS):
            values = self.columns.get(column)
            if values is None:
                continue
            first = pd.Series(values).groupby(codes).transform("first").to_numpy(values.dtype)
            stated = ~absent(values) & (codes >= 0)
            differ = (values != first) & stated
            if values.dtype != object:
                differ &= ~np.isclose(values, first, rtol=1e-6, atol=0.0)
            rows = np.flatnonzero(differ)
            _, at = np.unique(codes[rows], return_index=True)  # report the first of every run
            self._report(
                rows[np.sort(at)],
                lambda i, v=values, e=first, c=column: (  # type: ignore[misc]
                    f"{c} = {shown_value(v[i])}, must stay {shown_value(e[i])} within "
                    f"{self.table.label} {self.label[i]} (is the label used twice?)"
                ),
            )
            if not stated.all():
                self.columns[column] = np.where(stated | (codes < 0), values, first)

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
            told = absent(self.label[missing])
            allowed = f"{column.name} is empty, must be {column.allowed}"
            self._report(missing[~told], lambda i: allowed)
        elif missing.size == values.size and column.required:
            self.problems.add(f"{self.name}: {column.name} holds no numbers")
        elif 0 < missing.size < values.size:
            return [f"{missing.size} of {values.size} samples of {column.name} are missing"]
        return []

    def _choices(self, column: Column) -> None:
        """Check a column that allows certain words only; case does not matter, and 1 is true."""
        truths = TRUTHS if column.choices == ("true", "false") else {}
        values = self.columns[column.name]
        lower = {word: word and truths.get(word.lower(), word.lower()) for word in set(values)}
        wrong = {word for word, low in lower.items() if low not in (None, *column.choices)}
        rows = np.flatnonzero([word in wrong for word in values])
        self._report(rows, lambda i: f"{column.name} = {values[i]}, must be {column.allowed}")
        self.columns[column.name] = np.array([lower[word] for word in values], dtype=object)

    def _time(self) -> None:
        """Report times that go backwards within a run."""
        time, codes = self.columns["time_s"], self.codes
        order = np.argsort(codes, kind="stable")
        back = (np.diff(time[order]) < 0) & (np.diff(codes[order]) == 0) & (codes[order][1:] >= 0)
        before = dict(zip(order[1:][back].tolist(), time[order[:-1][back]].tolist(), strict=True))
        self._report(
            np.sort(order[1:][back]),
            lambda i: (
                f"time_s = {time[i]:g} after {before[i]:g} in {self.table.label} {self.label[i]}, "
                "must not go backwards (is the label used twice?)"
            ),
        )


def other_unit(column: Column, kind: str, values: np.ndarray) -> str:
    """Return the unit in which the numbers would be plausible, or "" if they are so already.

    The bounds are about halfway, on a logarithmic scale, between what belt benches record (tensions
    of 20 to 2000 N, forces of 50 to 3000 N, travels of 0.03 to 5 mm) and a thousandth or a thousand
    times that.
    """
    finite, name = values[np.isfinite(values)], column.name
    if not finite.size or (kind == "points" and name != "arc_deg"):
        return ""  # tables written by hand, for belts of any size
    largest, travel = np.abs(finite).max(), float(np.ptp(finite))
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
