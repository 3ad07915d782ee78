"""Tables of cells: text files (CSV of any dialect, exports of testing machines), workbooks (.xlsx).

Arrow reads the rows of a text. Where a cell is not the number that its column began with, all cells
are read as texts, and `raw` judges those that are needed.
"""

import csv
import datetime
import itertools
import os
import re
import zipfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import csv as pa_csv

from beltid.bench.files import as_utf8
from beltid.bench.raw import (
    GROUPED,
    MISSING,
    Field,
    NumberSigns,
    Raw,
    distinct_names,
    first_texts,
    is_clock,
    is_date,
    is_number,
    is_unit,
)
from beltid.config.model import DialectSection
from beltid.errors import InputError, Problems
from beltid.store.disk import MAX_BYTES
from beltid.tables.schemas import RECORDINGS, table
from beltid.tables.units import canonical_unit, is_known_unit

Piece = tuple[int, int, int]  # begin and end of some lines of a text, and their number
SEARCHED = 400  # rows searched for a header below title lines
MAX_COLUMNS = 2000
SIMILAR = 5  # number of similar rows that mark the beginning of the numbers
SEPARATORS = (",", ";", "\t", "|", " ")  # the likelier first, blanks only if no other does
OURS = frozenset(name for kind in RECORDINGS for name in table(kind).names)
TOP = 1 << 18  # bytes in which the header is searched
BLOCK = 2 << 20  # bytes that Arrow reads at a time
LONGEST_LINE = 1 << 24
csv.field_size_limit(LONGEST_LINE)  # a long cell is refused by what it holds
_WHOLE = re.compile(r"[-+]?[1-9]\d\d", re.ASCII)  # without decimals, as long as a group
_ZWICK = re.compile("Standardkraft|Standardweg|Traversenweg")  # in exports of testXpert
# A formula without a value in the XML of a sheet
_UNCOMPUTED = re.compile(rb"(?:</f>|<f/>|<f [^>]*/>)\s*(?:<v\s*/>|<v>\s*</v>|</c>)")


@dataclass(frozen=True, slots=True)
class Head:
    """Header lines above the numbers of a table, by their index."""

    names: tuple[str, ...]
    units: tuple[str, ...]  # empty if there is no row of units
    row: int  # of the names
    units_row: int  # -1 if there is none
    first_row: int  # below the header
    fields: tuple[Field, ...] = ()  # title lines of the form name and value


def find_head(rows: Sequence[Sequence[str]]) -> Head | None:
    """Find the header above the first block of numbers in the first rows of a file or sheet."""
    filled = _filled(rows)
    for at in range(1, len(filled)):
        block = [rows[i] for i in filled[at : at + SIMILAR]]
        if _is_numbers(block) and not _is_units_row(block[0]):
            row = filled[at - 2 if at > 1 and _is_units_row(rows[filled[at - 1]]) else at - 1]
            if sum(1 for name in rows[row] if name and not is_number(name)) < 2:
                return None
            # a blank name is taken from the row above (merged cells); a title is one cell
            upper = rows[row - 1] if row and sum(map(bool, rows[row - 1])) > 1 else ()
            pairs = [*itertools.zip_longest(rows[row], upper, fillvalue="")]
            wide = max(len(rows[row]), *map(len, block))
            return replace(head_at(rows, row), names=tuple(n or over for n, over in pairs[:wide]))
    return None


def head_at(rows: Sequence[Sequence[str]], row: int) -> Head:
    """Return the head whose names are in a row; a row of units may follow."""
    below = [i for i in _filled(rows) if i > row] or [row + 1]
    head = Head(tuple(rows[row]), (), row, -1, below[0], fields_of(rows[:row]))
    if below[0] < len(rows) and _is_units_row(rows[below[0]]):
        below.append(below[0] + 1)
        return replace(head, units=tuple(rows[below[0]]), units_row=below[0], first_row=below[1])
    return head


def _filled(rows: Sequence[Sequence[str]]) -> list[int]:
    """List the rows that are neither empty nor a line drawn with signs."""
    return [i for i, row in enumerate(rows) if any(cell.strip(" -=_*") for cell in row)]


def _is_numbers(block: Sequence[Sequence[str]]) -> bool:
    """Return whether two columns, and half of those in use, hold only numbers."""
    columns = [column for column in itertools.zip_longest(*block, fillvalue="") if any(column)]
    numeric = sum(
        any(map(_is_value, column)) and all(_is_value(c) or c in MISSING for c in column)
        for column in columns
    )
    return numeric >= max(2, 0.5 * len(columns))


def _is_value(cell: str) -> bool:
    return is_number(cell) or is_clock(cell) or is_date(cell)


def _is_units_row(cells: Sequence[str]) -> bool:
    """Return whether a row holds units: no number, and at least half of its cells are units."""
    filled = [cell for cell in cells if cell]
    return (
        any(is_known_unit(c) or canonical_unit(c) in ("V", "mV") for c in filled)
        and 2 * sum(map(is_unit, filled)) >= len(filled)
        and not any(is_number(c) and c != "1" for c in filled)
    )


def fields_of(rows: Sequence[Sequence[str]]) -> tuple[Field, ...]:
    """Read header fields from title lines: ``name, value[, unit]`` or one cell ``name: value``."""
    fields = []
    for row in rows:
        cells = [cell.strip('" ') for cell in row]
        if len(cells) == 1:
            cells = re.split("[=:]", cells[0], maxsplit=1)
        name = cells[0].strip("#%:= ") if cells else ""
        if name and 2 <= len(cells) <= 3:
            fields.append(Field(name, *(cell.strip() for cell in cells[1:])))
    return tuple(fields)


# --- texts ---------------------------------------------------------------------------------------


def read_text(path: Path, place: str, dialect: DialectSection, problems: Problems) -> Iterator[Raw]:
    """Read the table in a text file; what is None in `dialect` is detected."""
    written = bytearray(path.stat().st_size)  # whose head is taken off without a copy
    with path.open("rb") as file:
        file.readinto(written)
    body, encoding, notes = as_utf8(written, place, dialect.encoding)
    top, skipped = _top(body, place), dialect.skip_lines
    head, separator = _head([*[""] * skipped, *top[skipped:]], place, dialect)
    if separator != "," and not dialect.separator:
        notes.append(f"separator {separator!r} found in the header")
    above = sum(len(line.encode()) + 1 for line in top[: head.first_row])
    del body[:above]
    names = distinct_names(
        [name.lstrip("# ") if i == 0 else name for i, name in enumerate(head.names)]
    )
    if not re.search(rb"\S", body):
        line = f" in line {head.row + 1}" if head.row >= 0 else ""
        raise InputError(f"{place}: holds no samples, only a header{line}")
    if separator == " ":  # those between no cells go
        body = bytearray(re.sub(rb"(?m)^ +| +(?=[ \n]|\Z)", b"", body))
    cells = _first_cells(body, separator)
    names += [""] * (len(cells) - len(names)) if not any(map(any, cells[len(names) :])) else []
    columns = {
        name: [c for c in column if c not in MISSING]
        for name, column in zip(names, cells, strict=False)
        if name
    }
    signs = _signs(columns, dialect, f"{place}:{head.row + 1}", notes)
    plain = {n for n, c in columns.items() if c and not signs.thousands and all(map(is_number, c))}
    body = body if body.endswith(b"\n") else body + b"\n"
    pieces, between = _pieces(body), (separator, signs.decimal, '"' if b'"' in body else False)
    written.clear()  # memory need not hold what the file does
    fetch, first = partial(_bytes, body, path, above), head.first_row + 1
    # a cell may be no number
    read = (_by_arrow(fetch, pieces, names, numeric, between) for numeric in (plain, ()))
    frame, lines, misfits = next(filter(None, read), (None, np.zeros(0), []))
    if frame is None:
        raise InputError(f'{place}:{first}: quotation marks (") do not match')
    problems.add_alike(
        range(len(misfits)),
        lambda i: f"{misfits[i][1]} cells, must be {len(names)}",
        lambda i: (f"{place}:{first + misfits[i][0]}", first + misfits[i][0]),
    )
    yield Raw(
        place,
        frame,
        format="Zwick testXpert text" if _ZWICK.search("\n".join(top[:60])) else "CSV",
        units={n: u for n, u in zip(names, head.units, strict=False) if u},
        fields=head.fields,
        lines=lines + first,
        header_line=head.row + 1,
        units_line=head.units_row + 1,
        signs=signs,
        encoding=encoding,
        notes=tuple(notes),
    )


def _top(data: bytearray, place: str) -> list[str]:
    """Return the first lines; a line that no table has is refused."""
    top = data[: data.find(b"\n", TOP) + 1 or len(data)].removesuffix(b"\n").split(b"\n")
    for number, line in enumerate(top, start=1):
        signs = SEPARATORS[:4] if len(line) >= MAX_COLUMNS else ()
        cells = max((line.count(sign.encode()) for sign in signs), default=0) + 1
        if cells > MAX_COLUMNS or len(line) > LONGEST_LINE:
            raise InputError(f"{place}:{number}: {cells} columns, must be at most {MAX_COLUMNS}")
    return [line.decode() for line in top]


def _head(top: Sequence[str], place: str, dialect: DialectSection) -> tuple[Head, str]:
    remark = re.compile(r"\s*$|#|sep=.?\s*$")
    if (first := next((i for i, line in enumerate(top) if not remark.match(line)), None)) is None:
        raise InputError(f"{place}: holds no header: it is empty, or blank lines and remarks only")
    separators = (dialect.separator,) if dialect.separator else SEPARATORS
    lines, starts = top[: first + SEARCHED], {s: cells_of(top[first], s) for s in separators}
    if names := dialect.names:
        sign = max(starts, key=lambda sign: (len(starts[sign]) == len(names), sign != " "))
        if (count := len(starts[sign])) != len(names):
            raise InputError(
                f"{place}:{first + 1}: {count} cells, but dialect.names states {len(names)} names"
            )
        cells = [cells_of(line, sign) for line in lines]
        head = head_at([*cells[:first], list(names), *cells[first:]], first)
        units_row = head.units_row - bool(head.units)
        return replace(head, row=-1, units_row=units_row, first_row=head.first_row - 1), sign
    # two of our names in the first line make it the header
    ours = {sign: len(OURS & {*cells}) for sign, cells in starts.items()}
    own = max(starts, key=lambda sign: (ours[sign], sign != " ", len(starts[sign])))
    if ours[own] > 1:
        return head_at([cells_of(line, own) for line in lines], first), own
    rows = {sign: [cells_of(line, sign) for line in lines] for sign in separators}
    found = [
        (above, sign)
        for sign, cells in rows.items()
        if (above := find_head(cells))
        and (sign != " " or len(above.names) == len(cells[above.first_row]))
    ]
    if found:
        return max(found, key=lambda pair: (pair[1] != " ", len(pair[0].names)))
    values = sum(map(_is_value, rows[own][first]))
    if not ours[own] and values >= 2 and 2 * values >= len(rows[own][first]):
        raise InputError(
            f"{place}:{first + 1}: line {first + 1} holds numbers, not names: state the names of "
            f"the {len(rows[own][first])} columns, dialect: {{names: [...]}}"
        )
    return head_at(rows[own], first), own


def split(line: str, sign: str) -> list[str]:
    """Split a line into cells."""
    return line.split() if sign == " " else next(csv.reader([line], delimiter=sign), [])


def cells_of(line: str, sign: str) -> list[str]:
    """Split a line into cells without empty ones at its end."""
    cells = [cell.strip() for cell in split(line, sign)]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _first_cells(body: bytearray, separator: str) -> list[tuple[str, ...]]:
    """Return the cells of the first rows, column by column, without remarks (# and few cells)."""
    top = body[: 1 + max(body.rfind(b"\n", 0, 20_000), body.find(b"\n"))] or body
    lines = [line for line in top.decode(errors="replace").split("\n")[:200] if line.strip()]
    full = max(line.count(separator) for line in lines)
    kept = [line for line in lines if line[0] != "#" or line.count(separator) == full]
    columns = [*itertools.zip_longest(*(cells_of(line, separator) for line in kept), fillvalue="")]
    return columns + [("",)] * (len(split(kept[0], separator)) - len(columns))


def _signs(
    columns: Mapping[str, list[str]], dialect: DialectSection, place: str, notes: list[str]
) -> NumberSigns:
    """Detect the number signs in the first rows; InputError if numbers contradict each other."""
    decimal, thousands = dialect.decimal, dialect.thousands
    signs = NumberSigns.of(itertools.chain(*columns.values()), decimal, thousands)
    if decimal is None and signs.decimal == ",":
        notes.append("decimal comma found in the numbers")
    if thousands is None and signs.thousands:
        notes.append(f'thousands separator "{signs.thousands}" found in the numbers')
    if decimal is not None or thousands is not None or signs != NumberSigns():
        return signs
    for name, column in columns.items():
        # numbers that write 950 without decimals drop zeros, so they would write 1.25, not 1.250
        whole, pointed = filter(_WHOLE.fullmatch, column), [c for c in column if "." in c]
        both = next(whole, ""), next((c for c in pointed if c.endswith("0")), "")
        if all(both) and all(map(GROUPED.fullmatch, pointed)):
            raise InputError(
                f'{place}: column {name} holds "{both[0]}" and "{both[1]}": if the point marks '
                'thousands, set dialect: {thousands: "."}, else {decimal: "."}'
            )
    return signs


def _pieces(body: bytearray) -> list[Piece]:
    """Cut a text into pieces of whole lines, none of which leaves quotation marks open."""
    pieces, begin = list[Piece](), 0
    while begin < len(body):
        end = body.rfind(b"\n", begin, begin + BLOCK) + 1 or body.find(b"\n", begin) + 1
        while body.count(b'"', body.rfind(b"\n", begin, end - 1) + 1, end) % 2 and end < len(body):
            end = body.find(b"\n", end) + 1
        pieces.append((begin, end, body.count(b"\n", begin, end)))
        begin = end
    return pieces


def _by_arrow(
    fetch: Callable[[int, int], np.ndarray],
    pieces: Sequence[Piece],
    names: Sequence[str],
    numeric: Collection[str],  # the others are texts
    signs: tuple[str, str, str | bool],  # between cells, of decimals, around cells
) -> tuple[pd.DataFrame, np.ndarray, list[tuple[int, int]]] | None:
    """Read columns, lines of the rows and rows of another width; None if a cell is unexpected."""
    # memory holds the numbers of all pieces once, and texts that repeat
    words = pa.dictionary(pa.int32(), pa.large_string())
    types = {name: pa.float64() if name in numeric else words for name in names if name}
    read = pa_csv.ReadOptions(column_names=names, block_size=1 << 30, use_threads=False)
    convert = pa_csv.ConvertOptions(
        column_types=types,
        include_columns=list(types),
        null_values=sorted(MISSING),
        strings_can_be_null=True,
        decimal_point=signs[1],
    )
    count, at, above = sum(n for _, _, n in pieces), 0, 0
    lines, misfits = np.empty(count, np.int32), list[tuple[int, int]]()
    columns: dict[str, Any] = {name: np.empty(count) if name in numeric else [] for name in types}
    work = partial(_rows_of, fetch, signs, read, convert)
    try:
        with ThreadPoolExecutor(min(4, os.cpu_count() or 1)) as pool:
            for (_, _, n), (table, own, wrong) in zip(pieces, pool.map(work, pieces), strict=True):
                span = slice(at, at + len(table))
                for name, values in zip(types, table.columns, strict=True):
                    if name in numeric:
                        columns[name][span] = values.to_numpy()
                    else:
                        columns[name] += values.chunks
                lines[span] = own + above
                misfits += [(line + above, width) for line, width in wrong]
                at, above = span.stop, above + n
    except (pa.ArrowException, ValueError):
        return None
    for name, held in columns.items():
        columns[name] = held[:at] if name in numeric else pa.chunked_array(held, words).to_pandas()
    return pd.DataFrame(columns, copy=False), lines[:at], misfits


def _bytes(body: bytearray, path: Path, above: int, begin: int, end: int) -> np.ndarray:
    """Return a part of a text, which the file holds below its head if `body` does not."""
    if not body:
        return np.fromfile(path, np.uint8, end - begin, offset=above + begin)
    return np.frombuffer(body, np.uint8, end - begin, begin)


def _rows_of(
    fetch: Callable[[int, int], np.ndarray],
    signs: tuple[str, str, str | bool],
    read: pa_csv.ReadOptions,
    convert: pa_csv.ConvertOptions,
    piece: Piece,
) -> tuple[pa.Table, np.ndarray, list[tuple[int, int]]]:
    """Read some lines: the rows, their lines, and line and width of those of another width."""
    begin, end, n = piece
    text, misfits = fetch(begin, end), list[Any]()
    options = pa_csv.ParseOptions(
        delimiter=signs[0],
        quote_char=signs[2],
        invalid_row_handler=lambda row: misfits.append(row) or "skip",  # type: ignore[func-returns-value]
    )
    table = pa_csv.read_csv(pa.BufferReader(text), read, options, convert)
    if len(table) == n:
        return table, np.arange(n), []
    ends = np.flatnonzero(text == ord("\n"))
    lines = np.flatnonzero(np.diff(ends, prepend=-1) > 1)
    rows = [row.number - 1 for row in misfits]
    if len(table) + len(rows) != len(lines):
        raise ValueError("a line break stands in quotation marks")
    told = [row for row in misfits if not re.match(r"\s*(?:#|$)", row.text)]
    wrong = [(int(lines[row.number - 1]), row.actual_columns) for row in told]
    return table, np.delete(lines, rows), wrong


# --- workbooks ------------------------------------------------------------------------------------


def read_excel(path: Path, place: str) -> Iterator[Raw]:
    """Read the sheets of a workbook that are shown and hold a table."""
    from openpyxl import load_workbook

    found, left_out = list[Raw](), list[str]()
    with zipfile.ZipFile(path) as archive, path.open("rb") as stream:
        if sum(entry.file_size for entry in archive.infolist()) > MAX_BYTES:
            raise InputError(f"{place}: unpacks to more than {MAX_BYTES >> 20} MB, split it")
        if broken := archive.testzip():
            raise InputError(f"{place}: damaged: {broken} in it does not match its checksum")
        book = load_workbook(stream, read_only=True, data_only=True, keep_links=False)
        for sheet in book.worksheets:
            is_shown = sheet.sheet_state == "visible"
            rows = [_trimmed(row, place) for row in sheet.iter_rows(values_only=True) if is_shown]
            if (table := _table(place, sheet.title, rows)) is not None:
                found.append(table)
            elif any(rows) or not is_shown:
                left_out.append(sheet.title)
        if not found or any(table.frame.isna().to_numpy().any() for table in found):
            sheets = (name for name in archive.namelist() if name.startswith("xl/worksheets/"))
            if any(map(_UNCOMPUTED.search, map(archive.read, sheets))):
                raise InputError(
                    f"{place}: holds formulas without their values: open it in a spreadsheet "
                    "program, which computes them, and save it"
                )
    if not found:
        raise InputError(f"{place}: no sheet holds a table: a header and rows of numbers below it")
    notes = (f"sheet {t} left out: hidden, or without a table of numbers" for t in left_out)
    yield from (replace(found[0], notes=tuple(notes)), *found[1:])


def _trimmed(row: tuple[Any, ...], place: str) -> list[Any]:
    length = max((i + 1 for i, cell in enumerate(row) if cell not in (None, "")), default=0)
    if length > MAX_COLUMNS:
        raise InputError(f"{place}: {length} columns, must be at most {MAX_COLUMNS}")
    return [*row[:length]]


def _table(place: str, title: str, rows: list[list[Any]]) -> Raw | None:
    """Return the table of a sheet; None if it holds none."""
    if (head := find_head([[_shown(cell) for cell in row] for row in rows[:SEARCHED]])) is None:
        return None
    body, names = rows[head.first_row :], distinct_names(head.names)
    frame = pd.DataFrame(
        {
            name: _column([row[i] if i < len(row) else None for row in body])
            for i, name in enumerate(names)
            if name
        }
    )
    return Raw(
        place,
        frame,
        title,
        "Excel workbook",
        dict(zip(names, head.units, strict=False)),
        head.fields,
        lines=range(head.first_row + 1, head.first_row + 1 + len(body)),
        header_line=head.row + 1,
        units_line=head.units_row + 1,
        signs=NumberSigns.of(text for name in frame for text in first_texts(frame[name])),
    )


def _shown(cell: Any) -> str:
    if isinstance(cell, datetime.datetime) and cell.year <= 1900:  # a time of day past midnight
        cell = cell.time()
    return repr(cell) if isinstance(cell, float) else str("" if cell is None else cell).strip()


def _column(cells: list[Any]) -> Any:
    kinds = {type(cell) for cell in cells if cell is not None and cell != ""}
    if kinds and kinds <= {int, float}:
        return np.array([np.nan if c is None or c == "" else float(c) for c in cells])
    return pd.array([_shown(cell) or None for cell in cells], dtype="str")
