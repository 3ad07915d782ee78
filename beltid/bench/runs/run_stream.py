"""Read a friction rig recording run by run in bounded memory: a season is 10^8 samples.

Each run gets the same checks as a recording that is read at once (`checks`). In addition, the rows
of a run must be consecutive, and no run may be longer than `MOST_SAMPLES`.
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
from beltid.tables.schemas import NOMINAL, RUN_TEXTS, Table
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
        Numeric columns of the table, in its units; nan for missing numbers.
    texts : dict of str to str
        Texts in the rows that describe the run, such as its conditions, by column.
    """

    label: str
    columns: dict[str, np.ndarray]
    texts: dict[str, str] = field(default_factory=dict)


@dataclass(slots=True)
class _RunRows:
    """Rows of a run read so far."""

    label: str | None
    first_line: int
    parts: list[tuple[Rows, int, int]] = field(default_factory=list)
    """Blocks with rows of the run, its first row in the block and the one after its last."""

    def __len__(self) -> int:
        return sum(end - start for _, start, end in self.parts)

    def columns(self) -> dict[str, np.ndarray]:
        # a copy, so that the blocks can be freed
        return {
            name: np.concatenate([rows.numbers[name][start:end] for rows, start, end in self.parts])
            for name in self.parts[0][0].numbers
        }

    def texts(self, label: str) -> dict[str, np.ndarray]:
        """Return the text columns except the label."""
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
    """A recording that is read run by run; iterate over it to get its runs.

    Parameters
    ----------
    path : Path
        The file or folder.
    blocks : iterable of Rows
        The rows.
    table : Table
        Schema of the recording.
    mappings : mapping of str to ChannelMapping
        How columns are converted to their units.
    clock : Clock or None
        Reader of clock times, if the time column holds any.
    read_notes : list of str
        Notes so far; the readers of the rows append to it.
    row_word : str
        Separator of name and line in messages.

    Attributes
    ----------
    n_samples : int
        Number of samples read so far.
    missing : dict of str to int
        Number of missing values, for columns that may have some.
    """

    def __init__(
        self,
        path: Path,
        blocks: Iterable[Rows],
        table: Table,
        mappings: Mapping[str, ChannelMapping],
        clock: Clock | None,
        read_notes: list[str],
        row_word: str = ":",
    ) -> None:
        self.path, self.name, self.row_word = path, str(path), row_word
        self.blocks, self.table, self.clock, self.read_notes = blocks, table, clock, read_notes
        stated = {role: m for role, m in mappings.items() if m.unit_stated or m.negated}
        self.conversions = {role: m.conversion for role, m in stated.items()}
        self.problems = Problems()
        self.n_samples = 0
        self.missing: dict[str, int] = {}
        self._began: dict[str | None, int] = {}
        self._judged: set[str] = set()

    def __iter__(self) -> Iterator[RunColumns]:
        """Yield the runs in the order of the file.

        Raises
        ------
        InputError
            With the errors: at the end of the recording, or as soon as there are many.
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
        """Notes on what was recognised, left out or missing; complete after all runs are read."""
        missing = (
            f"{count} of {self.n_samples} samples of {column} are missing"
            for column, count in self.missing.items()
            if 0 < count < self.n_samples
        )
        of_clock = [] if self.clock is None else self.clock.notes()
        return (*self.read_notes, *of_clock, *missing)

    def _place(self, line: int) -> str:
        return f"{self.name}{self.row_word}{line}"

    def _begun(self, label: str | None, block: Rows, start: int) -> _RunRows:
        line = block.line_of(start)
        if label in self._began and label is not None:
            self.problems.add(
                f"{self._place(line)}: {self.table.label} {label} continues here after others, it "
                f"began in line {self._began[label]}: a recording of this size is read run by run; "
                f"sort it by {self.table.label}, or give every run its own label",
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
        for name, conversion in self.conversions.items():
            if conversion != Conversion(1.0):
                columns[name] = conversion.apply(columns[name])
        for column in self.table.columns:
            given = column.name in columns or column.name in RUN_TEXTS
            if column.dtype == "float64" and not given:
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
            of_run = {name: words[0] for name, words in texts.items() if words[0] is not None}
            yield RunColumns(run.label, columns, of_run)

    def _is_suspect(self, columns: Mapping[str, np.ndarray]) -> bool:
        """Return whether a quick test finds anything that the full checks must locate."""
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
        """Return whether texts differ within a run or use words other than ours."""
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
        if checker.suspects:  # most likely the same in all runs: report it once
            self.problems.raise_if_any()
        columns.update({name: ordered[name] for name in columns})
