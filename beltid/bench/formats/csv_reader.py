"""CSV rows to columns: fast where the file is clean, exact about places where it is not."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from beltid.bench.formats.dialect import MISSING_WORDS, Layout
from beltid.bench.problems import Problems
from beltid.tables.values import absent

NUMBER: Final = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?")
_COMMA_TO_POINT: Final = str.maketrans(",.", ".?")
_INFINITE: Final = re.compile(r"[-+]?(inf|infinity)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Wanted:
    """A column that is to be read.

    Attributes
    ----------
    index : int
        Its position in the rows of the file.
    is_text : bool
        Whether it holds labels rather than numbers.
    shown : str
        How messages call it.
    """

    index: int
    is_text: bool
    shown: str


@dataclass(frozen=True, slots=True)
class Rows:
    """Columns of a CSV file.

    Attributes
    ----------
    columns : dict of str to ndarray
        float64 with nan where a number is missing; object arrays of str (or None) for labels.
    lines : ndarray
        Line number of every row in the file, from 1.
    """

    columns: dict[str, np.ndarray]
    lines: np.ndarray


def read_rows(layout: Layout, wanted: Mapping[str, Wanted], name: str, problems: Problems) -> Rows:
    """Read the wanted columns.

    Parameters
    ----------
    layout : Layout
        The file.
    wanted : mapping
        Our names of the columns -> where they stand.
    name : str
        File name for messages.
    problems : Problems
        Collects ragged rows and cells that are no numbers.

    Returns
    -------
    Rows
        The columns; rows with none of the wanted cells filled are left out.
    """
    rows = _fast(layout, wanted) or _exact(layout, wanted, name, problems)
    filled = np.zeros(len(rows.lines), dtype=bool)
    for values in rows.columns.values():
        filled |= ~absent(values)
    if filled.all():
        return rows
    return Rows({key: v[filled] for key, v in rows.columns.items()}, rows.lines[filled])


def _fast(layout: Layout, wanted: Mapping[str, Wanted]) -> Rows | None:
    """Read with Arrow; None if a row or a cell is not as expected."""
    import pyarrow as pa
    from pyarrow import csv as pa_csv

    body = layout.body.encode()
    if b'"' in body and any(line.count(b'"') % 2 for line in body.split(b"\n")):
        return None  # a cell over several lines: line numbers need the exact reader
    names = [f"c{i}" for i in range(len(layout.header))]
    types = {names[w.index]: pa.string() if w.is_text else pa.float64() for w in wanted.values()}
    try:
        table = pa_csv.read_csv(
            pa.BufferReader(body),
            read_options=pa_csv.ReadOptions(column_names=names),
            parse_options=pa_csv.ParseOptions(delimiter=layout.separator),
            convert_options=pa_csv.ConvertOptions(
                column_types=types,
                include_columns=list(types),
                null_values=sorted(MISSING_WORDS),
                strings_can_be_null=True,
                decimal_point=layout.decimal,
            ),
        )
    except (pa.ArrowException, ValueError, KeyError):
        return None
    columns: dict[str, np.ndarray] = {}
    for key, w in wanted.items():
        chunked = table.column(names[w.index])
        columns[key] = _labels(chunked) if w.is_text else np.array(chunked.to_numpy(), dtype=float)
    lines = _lines(body, layout.first_line)
    return Rows(columns, lines) if len(lines) == table.num_rows else None


def _labels(chunked: object) -> np.ndarray:
    """Object array of labels; equal labels share one str."""
    encoded = chunked.combine_chunks().dictionary_encode()  # type: ignore[attr-defined]
    words = [None if w is None else w.strip() or None for w in encoded.dictionary.to_pylist()]
    table = np.empty(len(words) + 1, dtype=object)
    table[:-1] = words  # the last entry stays None, for missing labels
    codes = encoded.indices.fill_null(len(words)).to_numpy(zero_copy_only=False)
    return table[codes.astype(np.int64)]


def _lines(body: bytes, first_line: int) -> np.ndarray:
    """Line numbers of the lines that are not empty."""
    ends = np.flatnonzero(np.frombuffer(body, dtype=np.uint8) == ord("\n"))
    if not body.endswith(b"\n"):
        ends = np.append(ends, len(body))
    lengths = np.diff(ends, prepend=-1) - 1
    return np.flatnonzero(lengths > 0) + first_line


def _exact(layout: Layout, wanted: Mapping[str, Wanted], name: str, problems: Problems) -> Rows:
    """Read row by row, noting the line of everything that is wrong."""
    width = len(layout.header)
    cells: dict[str, list[float | str | None]] = {key: [] for key in wanted}
    lines: list[int] = []
    comma = layout.decimal == ","
    reader = csv.reader(io.StringIO(layout.body, newline=""), delimiter=layout.separator)
    try:
        for row in reader:
            line = layout.first_line + reader.line_num - 1
            if not any(cell.strip() for cell in row):
                continue
            if len(row) < width or any(cell.strip() for cell in row[width:]):
                problems.add(f"{name}:{line}: {len(row)} cells, must be {width}", line)
                continue
            lines.append(line)
            for key, w in wanted.items():
                value, good = _cell(row[w.index].strip(), w.is_text, comma)
                cells[key].append(value)
                if not good:
                    text = row[w.index].strip()
                    shown = text if len(text) <= 40 else text[:37] + "..."
                    problems.add(f'{name}:{line}: {w.shown} = "{shown}", must be a number', line)
    except csv.Error as error:
        line = layout.first_line + reader.line_num - 1
        problems.add(f"{name}:{line}: not a row of a CSV file: {error}", line)
    columns = {
        key: np.array(cells[key], dtype=object if w.is_text else float) for key, w in wanted.items()
    }
    return Rows(columns, np.array(lines, dtype=np.int64))


def _cell(text: str, is_text: bool, comma: bool) -> tuple[float | str | None, bool]:
    """Value of a cell, and whether it could be read."""
    if text in MISSING_WORDS:
        return (None if is_text else np.nan), True
    if is_text:
        return text, True
    # under a decimal comma a point would be a thousands separator: 1.234 is not read as 1.234
    number = text.translate(_COMMA_TO_POINT) if comma else text
    if NUMBER.fullmatch(number) or _INFINITE.fullmatch(number):
        return float(number), True
    return np.nan, False
