"""Rows of a table as they were read: numbers, texts, and where they stand in the file."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from beltid.errors import Problems
from beltid.tables.columns import Table
from beltid.tables.schemas import SAID_OF_RUNS
from beltid.tables.values import is_missing


@dataclass(frozen=True, slots=True)
class Texts:
    """A column of texts: every text once in memory, however often it is there.

    Attributes
    ----------
    words : ndarray
        Object array of the texts; the last one is None, for what is missing.
    codes : ndarray of int64
        Index of the text of every row.
    """

    words: np.ndarray
    codes: np.ndarray

    @classmethod
    def of(cls, texts: Iterable[str | None]) -> Texts:
        """Texts, one after the other."""
        known: dict[str | None, int] = {}
        codes = [known.setdefault(text, len(known)) for text in texts]
        words = np.empty(len(known) + 1, dtype=object)
        words[:-1] = list(known)
        return cls(words, np.array(codes, dtype=np.int64))

    @classmethod
    def of_arrow(cls, column: Any, missing: Collection[str] = ()) -> Texts:
        """Texts of an Arrow array; numbers become the texts that stand for them.

        Parameters
        ----------
        column : pyarrow Array or ChunkedArray
            Texts or numbers, plain or as a dictionary.
        missing : collection of str
            Texts that stand for a missing one.
        """
        import pyarrow as pa

        if pa.types.is_null(column.type):
            column = column.cast(pa.string())
        encoded = column if pa.types.is_dictionary(column.type) else column.dictionary_encode()
        if isinstance(encoded, pa.ChunkedArray):
            encoded = encoded.unify_dictionaries().combine_chunks()
        words = np.empty(len(encoded.dictionary) + 1, dtype=object)
        for i, value in enumerate(encoded.dictionary.to_pylist()):
            word = word_of(value)
            words[i] = None if word in missing else word
        codes = encoded.indices.cast(pa.int64()).fill_null(len(words) - 1)
        return cls(words, codes.to_numpy(zero_copy_only=False))

    def objects(self) -> np.ndarray:
        """The texts as an object array of str, None where one is missing."""
        texts: np.ndarray = self.words[self.codes]
        return texts

    def given(self) -> np.ndarray:
        """Which rows have a text."""
        known = np.array([word is not None for word in self.words])
        return known[self.codes]

    def starts(self) -> list[tuple[int, str | None]]:
        """Rows at which the text changes, and the text; the first row is one of them."""
        if not self.codes.size:
            return []
        rows = np.append(0, np.flatnonzero(np.diff(self.codes)) + 1)
        return [(row, self.words[self.codes[row]]) for row in rows.tolist()]


def numbers_of(values: Any) -> np.ndarray:
    """float64 array of an Arrow array of numbers, nan where one is missing; durations in seconds.

    Parameters
    ----------
    values : pyarrow Array
        Numbers of any type, or durations, shape (n,).
    """
    import pyarrow as pa

    if pa.types.is_duration(values.type):
        return np.asarray(values.to_numpy(zero_copy_only=False) / np.timedelta64(1, "s"))
    if not pa.types.is_float64(values.type):
        values = values.cast(pa.float64(), safe=False)  # the nearest float64, as everywhere
    return np.asarray(values.to_numpy(zero_copy_only=False))


def word_of(value: Any) -> str | None:
    """A label as text: whole numbers without a decimal point, None where it is missing."""
    if is_missing(value):
        return None
    if isinstance(value, (float, np.floating)) and float(value).is_integer():
        value = int(value)
    return str(value).strip() or None


@dataclass(frozen=True, slots=True)
class Rows:
    """Some rows of a table, or all of them.

    Attributes
    ----------
    numbers : dict of str to ndarray
        float64 columns, nan where a number is missing; they may belong to Arrow.
    texts : dict of str to Texts
        Columns of texts.
    lines : ndarray or int
        Line (or row) of every row in the file, from 1, or that of the first if none is left out.
    problems : Problems
        Rows and cells that cannot be read, with their lines.
    """

    numbers: dict[str, np.ndarray]
    texts: dict[str, Texts]
    lines: np.ndarray | int
    problems: Problems = field(default_factory=Problems)

    def __len__(self) -> int:
        if self.numbers:
            return len(next(iter(self.numbers.values())))
        return len(next(iter(self.texts.values())).codes)

    def line_of(self, row: int) -> int:
        """Line of a row in the file."""
        return self.lines + row if isinstance(self.lines, int) else int(self.lines[row])

    def all_lines(self) -> np.ndarray:
        """Line of every row."""
        if isinstance(self.lines, int):
            return np.arange(self.lines, self.lines + len(self))
        return self.lines

    def columns(self) -> dict[str, np.ndarray]:
        """All columns as arrays that may be written to."""
        own = {n: x if x.flags.writeable else x.copy() for n, x in self.numbers.items()}
        return {**own, **{name: texts.objects() for name, texts in self.texts.items()}}

    def filled(self) -> Rows:
        """The rows in which any cell holds something."""
        filled = np.zeros(len(self), dtype=bool)
        for values in self.numbers.values():
            filled |= ~np.isnan(values)
            if filled.all():
                return self
        for texts in self.texts.values():
            filled |= texts.given()
        if filled.all():
            return self
        return Rows(
            {name: values[filled] for name, values in self.numbers.items()},
            {name: Texts(texts.words, texts.codes[filled]) for name, texts in self.texts.items()},
            self.all_lines()[filled],
            self.problems,
        )


def together(parts: Sequence[dict[str, np.ndarray]], table: Table) -> dict[str, np.ndarray]:
    """Columns of several parts one after the other; what a part does not have is missing in it."""
    if len(parts) == 1:
        return parts[0]
    there = {name for part in parts for name in part}
    filled = [completed(part, table, len(next(iter(part.values()))), there) for part in parts]
    return {name: np.concatenate([part[name] for part in filled]) for name in filled[0]}


def completed(
    columns: Mapping[str, np.ndarray], table: Table, length: int, also: Collection[str] = ()
) -> dict[str, np.ndarray]:
    """Columns in the order of the schema; an optional one that is absent holds nothing.

    What may be said of a run (`SAID_OF_RUNS`) is left out where nobody says it, but for those
    `also` wanted.
    """
    whole = {}
    for column in table.columns:
        if column.name in columns:
            whole[column.name] = columns[column.name]
        elif column.name not in SAID_OF_RUNS or column.name in also:
            whole[column.name] = (
                np.full(length, None, dtype=object)
                if column.dtype == "string"
                else np.full(length, np.nan)
            )
    return whole
