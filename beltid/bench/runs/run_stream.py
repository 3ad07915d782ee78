"""A recording of the friction rig run by run, in bounded memory: a season is 10^8 samples.

The checks are those of a recording that is read at once (`checks`), run by run. What differs:
the rows of a run must stand together, and no run may be longer than `MOST_SAMPLES`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from beltid.bench.channels.channel_mapping import ChannelMapping
from beltid.bench.formats.clock import Clock
from beltid.bench.formats.rows import Rows
from beltid.bench.runs.checks import Checker, no_number
from beltid.errors import SHOWN, InputError, PlaceOf, Problems
from beltid.tables.schemas import NOMINAL, SAID_OF_RUNS, Table
from beltid.tables.units import Conversion
from beltid.tables.values import outside

MOST_SAMPLES: Final = 20_000_000


@dataclass(frozen=True, slots=True)
class RunColumns:
    """The samples of one run.

    Attributes
    ----------
    label : str
        Its label.
    columns : dict of str to ndarray
        Numeric columns of the table, in its units; nan where a number is missing.
    said : dict of str to str
        Texts that the rows say of the run, such as its conditions, by their column.
    """

    label: str
    columns: dict[str, np.ndarray]
    said: dict[str, str] = field(default_factory=dict)


@dataclass(slots=True)
class _RunRows:
    """The rows of a run that have come so far."""

    label: str | None
    first_line: int
    parts: list[tuple[Rows, int, int]] = field(default_factory=list)
    """Blocks that hold rows of the run, the first of them and the one after the last."""

    def __len__(self) -> int:
        return sum(end - start for _, start, end in self.parts)

    def columns(self) -> dict[str, np.ndarray]:
        # a copy, which lets go of the blocks
        return {
            name: np.concatenate([rows.numbers[name][start:end] for rows, start, end in self.parts])
            for name in self.parts[0][0].numbers
        }

    def texts(self, label: str) -> dict[str, np.ndarray]:
        """Columns of texts but for the label."""
        parts = [(rows.texts, start, end) for rows, start, end in self.parts]
        return {
            name: np.concatenate([t[name].words[t[name].codes[a:b]] for t, a, b in parts])
            for name in parts[0][0]
            if name != label
        }

    def line_of(self, row: int) -> int:
        for rows, start, end in self.parts:
            if row < end - start:
                return rows.line_of(start + row)
            row -= end - start
        raise IndexError(row)


class BigRecording:
    """A recording that is read run by run: its runs, one after the other.

    Parameters
    ----------
    path : Path
        The file or folder.
    blocks : iterable of Rows
        The rows.
    table : Table
        Schema of the recording.
    mappings : mapping of str to ChannelMapping
        How columns come to their units.
    clock : Clock or None
        Reader of the time, where it is that of a clock.
    told : list of str
        Takes notes before and while the rows are read.
    row_word : str
        What messages put between the name and a line.

    Attributes
    ----------
    n_samples : int
        Samples of the runs that have been read.
    missing : dict of str to int
        Missing values of the columns that may miss some.
    """

    def __init__(
        self,
        path: Path,
        blocks: Iterable[Rows],
        table: Table,
        mappings: Mapping[str, ChannelMapping],
        clock: Clock | None,
        told: list[str],
        row_word: str = ":",
    ) -> None:
        self.path, self.name, self.row_word = path, str(path), row_word
        self.blocks, self.table, self.clock, self.told = blocks, table, clock, told
        stated = {role: m for role, m in mappings.items() if m.unit_stated or m.negated}
        self.conversions = {role: m.conversion for role, m in stated.items()}
        self.problems = Problems()
        self.n_samples = 0
        self.missing: dict[str, int] = {}
        self._began: dict[str | None, int] = {}
        self._judged: set[str] = set()

    def __iter__(self) -> Iterator[RunColumns]:
        """The runs, in the order of the file.

        Raises
        ------
        InputError
            With what is wrong: at the end of the recording, or as soon as enough has been found.
        """
        run: _RunRows | None = None
        for block in self.blocks:
            self.problems.take(block.problems)
            labels = block.texts[self.table.label].starts()
            ends = [row for row, _ in labels[1:]] + [len(block)] * bool(labels)
            for (start, label), end in zip(labels, ends, strict=True):
                if run is None or run.label != label:
                    if run is not None:
                        yield from self._finished(run)
                    run = self._begun(label, block, start)
                run.parts.append((block, start, end))
                if len(run) > MOST_SAMPLES:
                    raise InputError(
                        f"{self._place(run.first_line)}: {self.table.label} {label} holds more "
                        f"than {MOST_SAMPLES:,} samples: split it, or record it at a lower rate"
                    )
            if self.problems.count > SHOWN:
                self.problems.raise_if_any()
        if run is not None:
            yield from self._finished(run)
        if not self.n_samples and not self.problems.count:
            raise InputError(f"{self.name}: holds no samples")
        for column in self.table.columns:
            if column.required and 0 < self.missing.get(column.name, 0) == self.n_samples:
                self.problems.add(no_number(self.name, column))
        self.problems.raise_if_any()

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found out, left out or missing; complete once the runs have been read."""
        missing = (
            f"{count} of {self.n_samples} samples of {column} are missing"
            for column, count in self.missing.items()
            if 0 < count < self.n_samples
        )
        return (*self.told, *([] if self.clock is None else self.clock.notes()), *missing)

    def _place(self, line: int) -> str:
        return f"{self.name}{self.row_word}{line}"

    def _begun(self, label: str | None, block: Rows, start: int) -> _RunRows:
        line = block.line_of(start)
        if label in self._began and label is not None:
            self.problems.add(
                f"{self._place(line)}: {self.table.label} {label} goes on here after others, it "
                f"began in line {self._began[label]}: a recording of this size is read run by run, "
                f"sort it by {self.table.label}, or give every run a label of its own",
                line,
            )
            self.problems.raise_if_any()
        self._began[label] = line
        return _RunRows(label, line)

    def _finished(self, run: _RunRows) -> Iterator[RunColumns]:
        columns = run.columns()
        n = len(run)

        def place(index: int) -> tuple[str, int]:
            line = run.line_of(index)
            return self._place(line), line

        if self.clock is not None:
            columns["time_s"] = self.clock.elapsed(columns["time_s"], place, self.problems)
        for name, by in self.conversions.items():
            if by != Conversion(1.0):
                columns[name] = by.apply(columns[name])
        for column in self.table.columns:
            known = column.name in columns or column.name in SAID_OF_RUNS
            if column.dtype == "float64" and not known:
                columns[column.name] = np.full(n, np.nan)
        shown = {n for n in {*columns} - self._judged if np.isfinite(columns[n]).any()}
        texts = run.texts(self.table.label)
        if shown or run.label is None or self._is_suspect(columns) or self._is_unclear(texts):
            self._check(columns, texts, run, place)
        self._judged |= shown
        for column in self.table.columns:
            if column.nullable and column.name in columns:
                count = int(np.count_nonzero(np.isnan(columns[column.name])))
                self.missing[column.name] = self.missing.get(column.name, 0) + count
        self.n_samples += n
        if run.label is not None:
            said = {name: words[0] for name, words in texts.items() if words[0] is not None}
            yield RunColumns(run.label, columns, said)

    def _is_suspect(self, columns: Mapping[str, np.ndarray]) -> bool:
        """Whether anything in a run asks for the checks that tell what and where."""
        for column in self.table.columns:
            if column.name not in columns:
                continue
            values = columns[column.name]
            low, high = float(np.min(values)), float(np.max(values))  # nan if any value is
            if not column.nullable and not np.isfinite(high - low):
                return True
            if np.isnan(high - low):
                if np.any(np.isinf(values) | outside(values, column)):
                    return True
            elif np.any(outside(np.array([low, high]), column)) or np.isinf(high - low):
                return True
        if any(np.any(columns[name] != columns[name][0]) for name in NOMINAL if name in columns):
            return True
        return bool(np.any(np.diff(columns["time_s"]) < 0.0))

    def _is_unclear(self, texts: Mapping[str, np.ndarray]) -> bool:
        """Whether the rows of a run say two things, or one in other words than ours."""
        for name, cells in texts.items():
            choices = self.table.column(name).choices
            if np.any(cells != cells[0]) or (choices and cells[0] not in (None, *choices)):
                return True
        return False

    def _check(
        self,
        columns: dict[str, np.ndarray],
        texts: dict[str, np.ndarray],
        run: _RunRows,
        place: PlaceOf,
    ) -> None:
        label = np.full(len(run), run.label, dtype=object)
        whole = {self.table.label: label, **columns, **texts}
        ordered = {name: whole[name] for name in self.table.names if name in whole}
        checker = Checker(self.name, ordered, self.table, place, self.problems)
        checker.run(self.conversions, self._judged)
        if checker.suspects:  # most likely it is the same in all runs: told once
            self.problems.raise_if_any()
        columns.update({name: ordered[name] for name in columns})
