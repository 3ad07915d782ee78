"""Rows of a table as read: numbers, texts, and their lines in the file."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from beltid.errors import Problems
from beltid.tables.columns import Table
from beltid.tables.schemas import RUN_TEXTS
from beltid.tables.values import is_missing


@dataclass(frozen=True, slots=True)
class Texts:
    """A column of texts that stores every distinct text once.

    Attributes
    ----------
    words : ndarray
        Object array of the distinct texts; the last one is None, for missing texts.
    codes : ndarray of int64
        Index of the text of every row.
    """

    words: np.ndarray
    codes: np.ndarray

    @classmethod
    def of(cls, texts: Iterable[str | None]) -> Texts:
        """Encode texts."""
        code_of: dict[str | None, int] = {}
        codes = [code_of.setdefault(text, len(code_of)) for text in texts]
        words = np.empty(len(code_of) + 1, dtype=object)
        words[:-1] = list(code_of)
        return cls(words, np.array(codes, dtype=np.int64))

    @classmethod
    def of_arrow(cls, column: Any, missing: Collection[str] = ()) -> Texts:
        """Encode the texts of an Arrow array; numbers are converted to texts.

        Parameters
        ----------
        column : pyarrow Array or ChunkedArray
            Texts or numbers, plain or dictionary-encoded.
        missing : collection of str
            Texts that mean a missing text.
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
        """Return the texts as an object array of str, None where one is missing."""
        texts: np.ndarray = self.words[self.codes]
        return texts

    def given(self) -> np.ndarray:
        """Return a mask of the rows that have a text."""
        is_given = np.array([word is not None for word in self.words])
        return is_given[self.codes]

    def starts(self) -> list[tuple[int, str | None]]:
        """Return the rows at which the text changes, including the first row, with the new text."""
        if not self.codes.size:
            return []
        rows = np.append(0, np.flatnonzero(np.diff(self.codes)) + 1)
        return [(row, self.words[self.codes[row]]) for row in rows.tolist()]


def numbers_of(values: Any) -> np.ndarray:
    """Convert an Arrow array to float64, nan where a number is missing; durations in seconds.

    Parameters
    ----------
    values : pyarrow Array
        Numbers of any type, or durations, shape (n,).
    """
    import pyarrow as pa

    if pa.types.is_duration(values.type):
        return np.asarray(values.to_numpy(zero_copy_only=False) / np.timedelta64(1, "s"))
    if not pa.types.is_float64(values.type):
        values = values.cast(pa.float64(), safe=False)  # rounded to the nearest float64
    return np.asarray(values.to_numpy(zero_copy_only=False))


def word_of(value: Any) -> str | None:
    """Convert a label to text: whole numbers without a decimal point, None if missing."""
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
        float64 columns, nan where a number is missing; Arrow may own the memory.
    texts : dict of str to Texts
        Columns of texts.
    lines : ndarray or int
        Line (or row) of every row in the file, from 1; of the first only if none is left out.
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
        """Return the line of a row in the file."""
        return self.lines + row if isinstance(self.lines, int) else int(self.lines[row])

    def all_lines(self) -> np.ndarray:
        """Return the line of every row."""
        if isinstance(self.lines, int):
            return np.arange(self.lines, self.lines + len(self))
        return self.lines

    def columns(self) -> dict[str, np.ndarray]:
        """Return all columns as writable arrays."""
        writable = {n: x if x.flags.writeable else x.copy() for n, x in self.numbers.items()}
        return {**writable, **{name: texts.objects() for name, texts in self.texts.items()}}

    def filled(self) -> Rows:
        """Return the rows with at least one filled cell."""
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
    """Concatenate the columns of several parts; columns that a part lacks are missing values."""
    if len(parts) == 1:
        return parts[0]
    present = {name for part in parts for name in part}
    filled = [completed(part, table, len(next(iter(part.values()))), present) for part in parts]
    return {name: np.concatenate([part[name] for part in filled]) for name in filled[0]}


def completed(
    columns: Mapping[str, np.ndarray], table: Table, length: int, also: Collection[str] = ()
) -> dict[str, np.ndarray]:
    """Return the columns in the order of the schema; absent ones hold missing values.

    Absent columns that describe a run (`RUN_TEXTS`) are left out unless listed in `also`.
    """
    complete = {}
    for column in table.columns:
        if column.name in columns:
            complete[column.name] = columns[column.name]
        elif column.name not in RUN_TEXTS or column.name in also:
            complete[column.name] = (
                np.full(length, None, dtype=object)
                if column.dtype == "string"
                else np.full(length, np.nan)
            )
    return complete
