"""Tables in text files: CSV of any dialect, exports of testing machines.

Arrow reads the rows. Where a cell is not the number that its column began with, all cells are read
as texts, and `numbers` judges those that are needed; where a row has another width, the csv module
reads the rows one by one with their lines.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import csv as pa_csv

from beltid.bench.header import (
    SEARCHED,
    Head,
    distinct_names,
    find_head,
    head_at,
    is_sample,
)
from beltid.bench.numbers import MISSING, NumberSigns, contradiction, is_number
from beltid.bench.packed import as_utf8
from beltid.bench.raw import Raw
from beltid.errors import InputError, Problems

SEPARATORS: Final = (",", ";", "\t", "|")
BLANK: Final = " "
"""Any number of blanks; they separate cells if no other sign does."""
MAX_COLUMNS: Final = 2000
LONGEST_LINE: Final = 1 << 24
CELL_LINES: Final = 10
BLOCK: Final = 4 << 20
"""Bytes that Arrow reads at a time."""
_SHOWN: Final = {",": "','", ";": "';'", "\t": "tab", "|": "'|'", BLANK: "blank"}
_OPEN_CELL: Final = re.compile(r'(?:^|[,;\t|])\s*"[^"]*$')
_BLANK_BY_QUOTE: Final = re.compile(rb'" +[,;\t|]|[,;\t|] +"')
_SPACING: Final = re.compile(rb"^ +| +(?=[ \n]|\Z)", re.MULTILINE)
"""Blanks that do not separate cells."""


def read(
    path: Path,
    place: str,
    dialect: Mapping[str, Any],
    known: Collection[str],
    most: int | None = None,
) -> Iterator[Raw]:
    """Read the table in a text file.

    Parameters
    ----------
    path : Path
        The file.
    place : str
        Its name, for messages.
    dialect : mapping
        Settings of the config; what is None is detected.
    known : collection of str
        Names of our columns, or those that the config states; a first line with two of them is
        the header.
    most : int, optional
        Read only the whole lines in this number of bytes.

    Raises
    ------
    InputError
        If there is no header, or no row below it.
    """
    with path.open("rb") as file:
        data = file.read(most)
    if most is not None and len(data) == most:
        data = data[: data.rfind(b"\n") + 1]
    data, encoding, notes = as_utf8(data, place, dialect["encoding"])
    top = _top(data, place, dialect["skip_lines"])
    head, separator = _head(top, place, dialect, known)
    if separator != "," and not dialect["separator"]:
        notes.append(f"separator {_SHOWN.get(separator, repr(separator))} found in the header")
    start = _line_start(data, head.first_row)
    blank = re.match(rb"\s*\n", data[start:])  # the first rows tell how numbers are written
    first_line = head.first_row + 1 + (blank[0].count(b"\n") if blank else 0)
    body = data[start + (blank.end() if blank else 0) :]
    del data
    if not re.search(rb"\S", body):
        line = f" in line {head.row + 1}" if head.row >= 0 else ""
        raise InputError(f"{place}: holds no samples, only a header{line}")
    names = distinct_names(head.names)
    body, asides = _without_asides(body, top[max(head.row, 0) : head.first_row], separator, names)
    if separator == BLANK:
        body = _SPACING.sub(b"", body)
    rows = _Rows(body, names, separator, first_line)
    cells = rows.first_cells()
    signs = _signs(cells, dialect, f"{place}:{head.row + 1}", notes)
    if asides:
        notes.append(
            f"{asides} lines of comments (#) and repeated headers left out between the rows"
        )
    frame, lines, problems = rows.read(cells, signs, place)
    yield Raw(
        place,
        frame,
        format=_program(top),
        units={n: u for n, u in zip(names, head.units, strict=False) if u},
        fields=head.fields,
        lines=lines,
        header_line=head.row + 1,
        units_line=head.units_row + 1,
        signs=signs,
        encoding=encoding,
        notes=tuple(notes),
        problems=problems,
    )


def _program(top: Sequence[str]) -> str:
    """Recognise the program that wrote a text file from its first lines."""
    head = "\n".join(top[:60])
    if head.startswith("MTS793|"):
        return "MTS 793 text"
    words = ("Standardkraft", "Standardweg", "Traversenweg")
    return "Zwick testXpert text" if any(word in head for word in words) else "CSV"


def _top(data: bytes, place: str, skip: int) -> list[str]:
    """Return the first lines; skipped ones are blank; a cell over several lines is one line."""
    found: list[str] = []
    filled = 0
    for k, row in enumerate(io.BytesIO(data)):
        if len(row) > LONGEST_LINE:
            raise InputError(f"{place}:{k + 1}: longer than {LONGEST_LINE:,} characters")
        cells = max(row.count(s.encode()) for s in SEPARATORS) + 1
        if cells > MAX_COLUMNS:
            raise InputError(f"{place}:{k + 1}: {cells} columns, must be at most {MAX_COLUMNS}")
        found.append("" if k < skip else row.decode(errors="replace").rstrip("\n"))
        filled += bool(found[-1].strip())
        if filled > SEARCHED or k > 100_000:
            break
    for at, line in enumerate(found):
        if not _OPEN_CELL.search(line) or line.count('"') % 2 == 0:
            continue
        for end in range(at + 1, min(at + CELL_LINES, len(found))):
            if found[end].count('"') % 2:
                found[at] = " ".join(part.strip() for part in found[at : end + 1])
                found[at + 1 : end + 1] = [""] * (end - at)
                break
    return found


def _head(
    top: Sequence[str], place: str, dialect: Mapping[str, Any], known: Collection[str]
) -> tuple[Head, str]:
    """Find header and separator."""
    filled = [
        i
        for i, line in enumerate(top)
        if line.strip() and line[0] != "#" and not re.fullmatch(r"sep=.?", line.strip())
    ]
    if not filled:
        raise InputError(f"{place}: is empty: it holds no header in {len(top)} lines")
    first, separators = filled[0], (dialect["separator"],) if dialect["separator"] else SEPARATORS
    if dialect["names"]:
        return _stated_head(top, first, place, dialect)
    split = {s: [_cells(line, s) for line in top] for s in separators}
    own = max(split, key=lambda s: (len({*split[s][first]} & {*known}), len(split[s][first])))
    if len(split[own][first]) == 1 and not dialect["separator"]:
        below = top[filled[1]].split() if len(filled) > 1 else []
        if len(below) == len(top[first].split()) > 1:
            own, split[BLANK] = BLANK, [line.split() for line in top]
    found = [(head, s) for s, rows in split.items() if s != BLANK and (head := find_head(rows))]
    if len({*split[own][first]} & {*known}) < 2 and found and not dialect["skip_lines"]:
        return max(found, key=lambda pair: len(pair[0].names))
    separated = [own, *(s for s in (*split, BLANK) if s != own)]
    for sign in separated if len(filled) > 1 else ():
        cells, below = (_cells(top[filled[i]], sign) for i in (0, 1))
        if is_sample(cells, below, known):
            raise InputError(
                f"{place}:{first + 1}: line {first + 1} holds numbers, not names: state the names "
                f"of the {len(cells)} columns, dialect: {{names: [...]}}"
            )
    return head_at(split[own], first), own


def _stated_head(
    top: Sequence[str], first: int, place: str, dialect: Mapping[str, Any]
) -> tuple[Head, str]:
    """Return the head of a file whose names the config states; the first row has as many cells."""
    names = tuple(dialect["names"])
    separators = [dialect["separator"]] if dialect["separator"] else [*SEPARATORS, BLANK]
    counts = {sign: len(_cells(top[first], sign)) for sign in separators}
    sign = next((sign for sign, count in counts.items() if count == len(names)), None)
    if sign is None:
        raise InputError(
            f"{place}:{first + 1}: {max(counts.values())} cells, but dialect.names states "
            f"{len(names)} names"
        )
    head = head_at([list(names), *(_cells(line, sign) for line in top[first:])], 0)
    return replace(
        head,
        row=-1,
        units_row=head.units_row + first - 1 if head.units else -1,
        first_row=head.first_row + first - 1,
    ), sign


def _cells(line: str, sign: str) -> list[str]:
    """Split a line into cells without empty ones at its end."""
    if sign == BLANK:
        return line.split()
    try:
        cells = next(csv.reader([line], delimiter=sign, skipinitialspace=True), [])
    except csv.Error:
        return [line]
    while cells and not cells[-1].strip():
        cells.pop()
    return [cell.strip() for cell in cells]


def _line_start(data: bytes, lines: int) -> int:
    """Return where the text begins after a number of lines."""
    at = 0
    for _ in range(lines):
        at = data.find(b"\n", at) + 1 or len(data)
    return at


def _without_asides(
    body: bytes, head: Sequence[str], separator: str, names: Sequence[str]
) -> tuple[bytes, int]:
    """Blank comments and repeated headers among the rows; count them.

    A comment begins with # and has fewer cells than a row, since a label may begin with #, too.
    """
    sign = separator.encode()
    lines = {line.encode() for line in head if line.strip()} if names else set()
    if b"#" in body:
        comments = re.findall(rb"^#[^\n]*", body, re.MULTILINE)
        lines |= {line for line in comments if line.count(sign) + 1 < max(len(names), 2)}
    count = 0
    for line in lines:
        if body.startswith(line) or b"\n" + line in body:
            body, n = re.subn(rb"(?m)^%s$" % re.escape(line), b"", body)
            count += n
    return body, count


def _signs(
    columns: Mapping[str, list[str]], dialect: Mapping[str, Any], place: str, notes: list[str]
) -> NumberSigns:
    """Detect the number signs in the first rows; InputError if numbers contradict each other."""
    decimal, thousands = dialect["decimal"], dialect["thousands"]
    cells = (cell for column in columns.values() for cell in column)
    signs = NumberSigns.of(cells, decimal, thousands)
    if decimal is None and signs.decimal == ",":
        notes.append("decimal comma found in the numbers")
    if thousands is None and signs.thousands:
        notes.append(f'thousands separator "{signs.thousands}" found in the numbers')
    for name, column in columns.items() if decimal is thousands is None else ():
        if pair := contradiction(column, signs):
            raise InputError(
                f'{place}: column {name} holds "{pair[0]}" and "{pair[1]}": if the point marks '
                'thousands, set dialect: {thousands: "."}, else {decimal: "."}'
            )
    return signs


@dataclass
class _Rows:
    """The rows of a table as bytes, with the names of their columns ("" for none)."""

    body: bytes
    names: list[str]
    separator: str
    first_line: int

    def first_cells(self) -> dict[str, list[str]]:
        """Return the filled cells of the first rows, column by column."""
        columns: dict[str, list[str]] = {name: [] for name in self.names if name}
        top = self.body[:20_000]
        lines = top.decode(errors="replace").split("\n")
        for line in lines[:200] if len(top) == len(self.body) else lines[:-1][:200]:
            for name, cell in zip(self.names, _cells(line, self.separator), strict=False):
                if name and cell not in MISSING:
                    columns[name].append(cell)
        return columns

    def read(
        self, cells: Mapping[str, list[str]], signs: NumberSigns, place: str
    ) -> tuple[pd.DataFrame, Sequence[int] | np.ndarray, Problems]:
        """Return the columns, the line of every row, and the rows that cannot be read."""
        plain = {
            name: bool(column) and not signs.thousands and all(map(is_number, column))
            for name, column in cells.items()
        }
        lines = self._lines()
        for numeric in (plain, dict.fromkeys(plain, False)):
            if lines is None:
                break
            if (frame := self._by_arrow(numeric, signs.decimal, len(lines))) is not None:
                return frame, lines, Problems()
        return self._row_by_row(place)

    def _lines(self) -> Sequence[int] | np.ndarray | None:
        """Return the lines of the rows; None if Arrow cannot tell them by quotation marks."""
        if b'"' in self.body and (
            _BLANK_BY_QUOTE.search(self.body)
            or any(line.count(b'"') % 2 for line in self.body.split(b"\n"))
        ):
            return None
        ends = np.flatnonzero(np.frombuffer(self.body, np.uint8) == ord("\n"))
        if not self.body.endswith(b"\n"):
            ends = np.append(ends, len(self.body))
        filled = np.diff(ends, prepend=-1) > 1
        if filled.all():
            return range(self.first_line, self.first_line + len(ends))
        return np.flatnonzero(filled) + self.first_line

    def _by_arrow(
        self, numeric: Mapping[str, bool], decimal: str, rows: int
    ) -> pd.DataFrame | None:
        """Read with Arrow; None if a row or a cell is not as expected."""
        keys = {f"c{i}": name for i, name in enumerate(self.names)}
        types = {k: pa.float64() if numeric[n] else pa.string() for k, n in keys.items() if n}
        columns: dict[str, Any] = {
            key: np.empty(rows) if kind == pa.float64() else [] for key, kind in types.items()
        }
        at = 0
        try:  # block by block, so that memory holds the numbers once
            for batch in pa_csv.open_csv(
                pa.BufferReader(self.body),
                read_options=pa_csv.ReadOptions(column_names=list(keys), block_size=BLOCK),
                parse_options=pa_csv.ParseOptions(delimiter=self.separator),
                convert_options=pa_csv.ConvertOptions(
                    column_types=types,
                    include_columns=list(types),
                    null_values=sorted(MISSING),
                    strings_can_be_null=True,
                    decimal_point=decimal,
                ),
            ):
                for key, kind in types.items():
                    values = batch.column(key)
                    if kind == pa.float64():
                        columns[key][at : at + len(values)] = values.to_numpy(zero_copy_only=False)
                    else:
                        columns[key].append(values)
                at += batch.num_rows
        except (pa.ArrowException, ValueError, KeyError):
            return None
        if at != rows:
            return None
        frame = {
            keys[key]: values
            if isinstance(values, np.ndarray)
            else pd.array(pa.chunked_array(values, pa.string()), dtype="str")
            for key, values in columns.items()
        }
        return pd.DataFrame(frame, copy=False)

    def _row_by_row(self, place: str) -> tuple[pd.DataFrame, np.ndarray, Problems]:
        """Read row by row as texts and report every fault with its line."""
        width, problems = len(self.names), Problems()
        kept: list[list[str | None]] = []
        lines: list[int] = []
        misfits: dict[int, list[int]] = {}
        text = io.StringIO(self.body.decode(errors="replace"), newline="")
        reader = csv.reader(text, delimiter=self.separator, skipinitialspace=True)
        try:
            for row in reader:
                line = self.first_line + reader.line_num - 1
                if not any(cell.strip() for cell in row):
                    continue
                if len(row) < width or any(cell.strip() for cell in row[width:]):
                    misfits.setdefault(len(row), []).append(line)
                    continue
                lines.append(line)
                cells = (cell.strip() for cell in row[:width])
                kept.append([None if cell in MISSING else cell for cell in cells])
        except csv.Error as error:
            line = self.first_line + reader.line_num - 1
            problems.add(f"{place}:{line}: not a row of a CSV file: {error}", line)
        for count, at in misfits.items():
            misfit = f"{count} cells, must be {width}".format
            problems.add_alike(at, misfit, lambda line: (f"{place}:{line}", line))
        columns = {n: [row[i] for row in kept] for i, n in enumerate(self.names) if n}
        return pd.DataFrame(columns, dtype="str"), np.array(lines, dtype=np.int64), problems
