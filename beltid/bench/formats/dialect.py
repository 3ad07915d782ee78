"""Detect the layout of a table: title lines, header, row of units, separators of text files."""

from __future__ import annotations

import csv
import itertools
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from beltid.bench.formats.bench_file import Field
from beltid.bench.formats.clock import is_clock, is_date
from beltid.bench.formats.numbers import MISSING_WORDS, NumberSigns, contradiction, is_number
from beltid.errors import InputError
from beltid.tables.units import canonical_unit, is_known_unit

if TYPE_CHECKING:
    from beltid.config.model import DialectSection

SEPARATORS: Final = (",", ";", "\t", "|")
BLANK: Final = " "
"""Any number of blanks; they separate cells if no other sign does."""
MAX_COLUMNS: Final = 2000
MAX_LINES: Final = 50_000_000
"""Maximum number of lines in a file that is read at once; blank lines take memory, too."""
LONGEST_LINE: Final = 1 << 24
"""Maximum length of a line [characters]: cells take far more memory than their text."""
TOP: Final = 10_000
"""Lines searched for the header and the row of units, after the skipped lines."""
_NAMES: Final = {",": "','", ";": "';'", "\t": "tab", "|": "'|'", BLANK: "blank"}
FIRST_BYTES: Final = 20_000
FIRST_ROWS: Final = 200
"""Rows used to detect how numbers and times are written."""
SEARCHED: Final = 400
"""Rows searched for a header below title lines."""
CELL_LINES: Final = 10
"""Maximum number of lines in a cell of the header."""
BLOCK: Final = 5
"""Number of similar rows that mark the beginning of the numbers."""
_OTHER: Final = "1 - -- % # V mV mV/V A mA Hz Pa kPa MPa bar W kW J mm/s mm/min m/s m/s^2 m/s²"
OTHER_UNITS: Final = frozenset((*_OTHER.split(), "N/mm", "N/mm²", "l/min"))
"""Units that none of our columns has, but that occur in a row of units."""
LONGEST_NAME: Final = 300
"""Longest channel name [characters] that is searched for a unit."""
_COMMENT: Final = re.compile(rb"^#[^\n]*", re.MULTILINE)
_OPEN_CELL: Final = re.compile(r'(?:^|[,;\t|])\s*"[^"]*$')
"""A line that ends inside a quoted cell."""
_CLOCK_FORM: Final = re.compile(r"h{1,2}:mm(:ss)?([.,][sf0]+)?", re.IGNORECASE)
"""Format of clock times in place of a unit."""
IN_NAME: Final = re.compile(r"[\[(<{]([^\[\](){}<>]*)[\])>}]\s*$")
"""Brackets at the end of a name, which may hold its unit."""
POSITION: Final = re.compile(r" #\d{1,4}(?=\s|$)")
"""Number that distinguishes channels of the same name."""
# "Zeit / s", "Zeit/s", "Zeit in s"; not the slash within a unit, as in "v rad/s"
_AFTER_NAME: Final = re.compile(r"(?:(?<!\s)\s+/\s*|(?<=\w{4})/|(?<!\s)\s+in\s+)(\S+)\s*$")


class NoRowsError(InputError):
    """A text without a header, or without a row below it."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Layout of a CSV file, as detected at its top.

    Attributes
    ----------
    header : tuple of str
        Names of the columns in the file.
    unit_cells : tuple of str
        Cells of the row of units, empty if there is none.
    separator : str
        Sign between cells.
    signs : NumberSigns
        Decimal sign and thousands separator.
    body : bytes
        The rows as UTF-8, with single line feeds.
    first_line : int
        Line number of the first row in the file, from 1.
    notes : tuple of str
        What was detected, not set by the user.
    header_line : int
        Line number of the header, from 1.
    fields : tuple of Field
        Header fields from the lines above the header.
    head : tuple of bytes
        Lines of the header and the row of units, as they appear when repeated in the body.
    """

    header: tuple[str, ...]
    unit_cells: tuple[str, ...]
    separator: str
    signs: NumberSigns
    body: bytes
    first_line: int
    notes: tuple[str, ...]
    header_line: int
    fields: tuple[Field, ...] = ()
    head: tuple[bytes, ...] = ()

    def first_cells(self) -> list[list[str]]:
        """Return the filled cells of the first rows, column by column."""
        first = self.body[:FIRST_BYTES]
        if len(self.body) > FIRST_BYTES:  # drop the row that is cut
            first = first[: first.rfind(b"\n") + 1] or first
        columns: list[list[str]] = [[] for _ in self.header]
        for line in first.decode(errors="replace").split("\n")[:FIRST_ROWS]:
            for column, cell in zip(columns, cells_or_line(line, self.separator), strict=False):
                if cell.strip() not in MISSING_WORDS:
                    column.append(cell.strip())
        return columns


def blank_asides(found: Layout) -> tuple[Layout, int]:
    """Blank the comments and repeated headers in the body; return the layout and their number.

    A comment begins with # and has fewer cells than a row, since a label may begin with #, too.
    """
    body, separator = found.body, found.separator.encode()
    comments: list[bytes] = []
    if b"#" in body:  # faster than searching for lines that begin with it
        width = len(found.header)
        comments = [
            line for line in _COMMENT.findall(body) if line.count(separator) + 1 < max(width, 2)
        ]
    count = 0
    for line in {*comments, *found.head}:
        if body.startswith(line) or b"\n" + line in body:
            body, n = re.subn(rb"(?m)^%s$" % re.escape(line), b"", body)
            count += n
    return (replace(found, body=body), count) if count else (found, 0)


def asides_note(count: int) -> list[str]:
    """Note the number of lines that `blank_asides` left out."""
    text = "lines of comments (#) and repeated headers left out between the rows"
    return [f"{count} {text}"] if count else []


def layout(text: str, name: str, dialect: DialectSection, wanted: Iterable[str]) -> Layout:
    """Detect the header, the separator and the decimal sign.

    Parameters
    ----------
    text : str
        Text of the file.
    name : str
        File name for messages.
    dialect : DialectSection
        Settings of the config.
    wanted : iterable of str
        Names in the file of the wanted columns.

    Raises
    ------
    InputError
        If there is no header, or no row below it.
    """
    _refuse_huge(text, name)
    notes: list[str] = []
    names, skipped = set(wanted), dialect.skip_lines
    top = _whole_cells(text.split("\n", skipped + TOP)[: skipped + TOP], skipped)
    at = _header_row(top, skipped, name, notes)
    fields: tuple[Field, ...] = ()
    if dialect.names:
        header, units_at = dialect.names, at
        separator = _separator_of_names(top[at], dialect, f"{name}:{at + 1}")
    else:
        separator = dialect.separator or best_separator(top[at], names)
        if not dialect.separator and _is_separated_by_blanks(top, at):
            separator = BLANK
        row = top[at].strip() if separator == BLANK else top[at]
        header = tuple(cell.strip() for cell in _cells(row, separator, f"{name}:{at + 1}"))
        units_at = at + 1
        if not skipped and not names <= set(header):
            titled = _search(top[:SEARCHED], dialect.separator)
            if titled is not None:
                if (titled[0].header_row, titled[1]) != (at, separator):
                    notes.append(f"header found in line {titled[0].header_row + 1}")
                head, separator = titled
                at, header, fields = head.header_row, head.names, head.fields
                units_at = head.below
        while header and not header[-1]:  # a separator at the end of the line
            header = header[:-1]
        _refuse_sample(top, at, dialect.separator, names, name)
    fields = fields or fields_of([[row] for row in top[:at] if row.startswith("#")])
    if separator != "," and not dialect.separator:
        notes.append(f"separator {_NAMES.get(separator, repr(separator))} found in the header")
    place = f"{name}:{at + 1}"
    if len(header) > MAX_COLUMNS:
        raise InputError(f"{place}: {len(header)} columns, must be at most {MAX_COLUMNS}")
    unit_cells, first = _units_row(top, units_at, separator)
    body = "".join(text.split("\n", first)[first:])
    if not body.strip():
        raise NoRowsError(f"{name}: holds no samples, only a header in line {at + 1}")
    blank = body[: len(body) - len(body.lstrip())]  # the first rows tell how numbers are written
    body = body[blank.rfind("\n") + 1 :]
    unsigned = Layout(
        distinct_names(header),
        unit_cells,
        separator,
        NumberSigns(),
        body.encode(),
        first + blank.count("\n") + 1,
        (),
        at + 1,
        fields,
        () if dialect.names else tuple(row.encode() for row in top[at:first] if row.strip()),
    )
    signs = _number_signs(unsigned, dialect, notes, place)
    return replace(unsigned, signs=signs, notes=tuple(notes))


def _refuse_huge(text: str, name: str) -> None:
    """Refuse a text with too many lines, or a line too long, for memory or time."""
    if text.count("\n") > MAX_LINES:
        raise InputError(f"{name}: more than {MAX_LINES:,} lines, split the recording")
    start = 0
    while len(text) - start > LONGEST_LINE:
        end = text.rfind("\n", start, start + LONGEST_LINE + 1)
        if end < 0:
            line = text.count("\n", 0, start) + 1
            raise InputError(f"{name}:{line}: longer than {LONGEST_LINE:,} characters")
        start = end + 1


def _whole_cells(top: Sequence[str], skip: int) -> list[str]:
    """Join quoted cells that span several lines, as spreadsheets write them, into one line.

    Their continuation lines become blank, so that all other lines keep their number.
    """
    lines = list(top)
    for at in range(skip, min(skip + SEARCHED, len(lines))):
        if not _OPEN_CELL.search(lines[at]) or lines[at].count('"') % 2 == 0:
            continue
        for end in range(at + 1, min(at + CELL_LINES, len(lines))):
            if lines[end].count('"') % 2:
                lines[at] = " ".join(line.strip() for line in lines[at : end + 1])
                lines[at + 1 : end + 1] = [""] * (end - at)
                break
    return lines


def _header_row(top: Sequence[str], skip: int, name: str, notes: list[str]) -> int:
    """Find the header: after skipped, blank and comment (#) lines, and the ``sep=`` of Excel."""
    comments = 0
    for at in range(skip, len(top)):
        row = top[at].strip()
        if row.startswith("#"):
            comments += 1
        elif row and not re.fullmatch(r"sep=.?", row):
            if comments:
                notes.append(f"{comments} lines beginning with # before the header left out")
            return at
    raise NoRowsError(f"{name}: holds no header in {len(top)} lines ({skip} of them skipped)")


def _separator_of_names(row: str, dialect: DialectSection, place: str) -> str:
    """Return the separator that splits the first row into as many cells as there are names."""
    names = dialect.names or ()
    counts = {sign: len(_row_cells(row, sign)) for sign in _separators(dialect.separator)}
    for sign, count in counts.items():
        if count == len(names):
            return sign
    raise InputError(
        f"{place}: {max(counts.values())} cells, but dialect.names states {len(names)} names"
    )


def _refuse_sample(
    top: Sequence[str], at: int, stated: str | None, wanted: set[str], name: str
) -> None:
    """Refuse a sample in place of the header: like the row below it, at least half numbers."""
    below = next((row for row in top[at + 1 :] if row.strip()), top[at])
    for sign in _separators(stated):
        first, second = _row_cells(top[at], sign), _row_cells(below, sign)
        is_value = [_is_value(cell) for cell in first]
        if sum(is_value) < 2 or 2 * sum(is_value) < len(first):
            continue
        cells = zip(first, second, is_value, strict=False)
        named = any(a in wanted and a != b and not value for a, b, value in cells)
        if is_value == [_is_value(cell) for cell in second] and not named:
            raise InputError(
                f"{name}:{at + 1}: line {at + 1} holds numbers, not names: state the names of the "
                f"{len(first)} columns, dialect: {{names: [...]}}"
            )


def _separators(stated: str | None) -> tuple[str, ...]:
    return (stated,) if stated else (*SEPARATORS, BLANK)


def _row_cells(row: str, separator: str) -> list[str]:
    """Return the cells of a row without empty ones at its end."""
    if separator == BLANK:
        return row.split()
    cells = [cell.strip() for cell in cells_or_line(row, separator)]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _is_separated_by_blanks(top: Sequence[str], at: int) -> bool:
    """Whether only blanks separate the header and the rows, into equally many cells."""
    below = next((row for row in top[at + 1 :] if row.strip()), "")
    cells = len(top[at].split())
    has_separator = any(sign in top[at] for sign in SEPARATORS)
    return not has_separator and cells > 1 and len(below.split()) == cells


def _units_row(top: Sequence[str], start: int, separator: str) -> tuple[tuple[str, ...], int]:
    """Return the row of units below the header, if there is one, and where the rows begin."""
    below = next((i for i in range(start, len(top)) if top[i].strip()), None)
    if below is None:
        return (), start
    cells = tuple(cell.strip() for cell in cells_or_line(top[below], separator))
    return (cells, below + 1) if is_units_row(cells) else ((), below)


def _search(top: Sequence[str], stated: str | None) -> tuple[TableHead, str] | None:
    """Find the header below title lines and above the first numbers, and its separator."""
    best: tuple[TableHead, str] | None = None
    for separator in (stated,) if stated else SEPARATORS:
        head = find_head([cells_or_line(line, separator) for line in top])
        if head is not None and (best is None or len(head.names) > len(best[0].names)):
            best = head, separator
    return best


def cells_or_line(line: str, separator: str) -> list[str]:
    """Split a line into cells; one cell with the whole line if it is not valid CSV."""
    try:
        return _cells(line, separator, "")
    except InputError:
        return [line]


def _cells(row: str, separator: str, place: str) -> list[str]:
    try:
        return next(csv.reader([row], delimiter=separator, skipinitialspace=True), [])
    except csv.Error as error:
        raise InputError(f"{place}: not a row of a CSV file: {error}") from None


def best_separator(head: str, wanted: set[str]) -> str:
    """Choose the separator that yields the most wanted names, then the most cells."""

    def score(separator: str) -> tuple[int, int]:
        cells = {cell.strip().strip('"') for cell in head.split(separator)}
        return len(cells & wanted), len(cells)

    return max(SEPARATORS, key=score)


def _number_signs(
    table: Layout, dialect: DialectSection, notes: list[str], place: str
) -> NumberSigns:
    """Detect the number signs in the first rows; InputError if numbers contradict each other."""
    columns = table.first_cells()
    cells = (cell for column in columns for cell in column)
    signs = NumberSigns.of(cells, dialect.decimal, dialect.thousands)
    if dialect.decimal is None and signs.decimal == ",":
        notes.append("decimal comma found in the numbers")
    if dialect.thousands is None and signs.thousands:
        notes.append(f'thousands separator "{signs.thousands}" found in the numbers')
    if dialect.decimal is None and dialect.thousands is None:
        for name, column in zip(table.header, columns, strict=True):
            if pair := contradiction(column, signs):
                raise InputError(
                    f'{place}: column {name} holds "{pair[0]}" and "{pair[1]}": if the point marks '
                    'thousands, set dialect: {thousands: "."}, else {decimal: "."}',
                )
    return signs


@dataclass(frozen=True, slots=True)
class TableHead:
    """Header lines above the numbers of a table.

    Attributes
    ----------
    names : tuple of str
        Cells of the header.
    units : tuple of str
        Cells of the row of units, empty if there is none.
    header_row, below, first_row : int
        Index of the header, of the row of units (else of numbers), and of the first row of numbers.
    fields : tuple of Field
        Title lines of the form name and value.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    header_row: int
    below: int
    first_row: int
    fields: tuple[Field, ...]


def find_head(rows: Sequence[Sequence[str]]) -> TableHead | None:
    """Find the header above the first block of numbers; None if there is none.

    Parameters
    ----------
    rows : sequence of sequence of str
        Cells of the first rows of a file or sheet, blank rows included.
    """
    filled = [i for i, row in enumerate(rows) if any(cell.strip() for cell in row)]
    for at, index in enumerate(filled):
        block = [rows[i] for i in filled[at : at + BLOCK]]
        if at == 0 or not _is_numbers(block) or is_units_row(block[0]):
            continue
        above = [i for i in filled[:at] if not _is_ruler(rows[i])]
        if not above:
            return None
        units: tuple[str, ...] = ()
        below = index
        if len(above) > 1 and is_units_row(rows[above[-1]]):
            below = above.pop()
            units = tuple(cell.strip() for cell in rows[below])
        notes = []
        while len(above) > 1 and sum(1 for cell in rows[above[-1]] if cell.strip()) < 2:
            notes.append(rows[above.pop()])  # a start or a rate between names and units
        names = _names_of(rows, above)
        if sum(1 for name in names if name and not is_number(name)) < 2:
            return None
        fields = fields_of([*(rows[i] for i in above[:-1]), *notes])
        return TableHead(names, units, above[-1], below, index, fields)
    return None


def _names_of(rows: Sequence[Sequence[str]], above: Sequence[int]) -> tuple[str, ...]:
    """Return the column names; a blank one is taken from the row above (merged cells)."""
    names = [cell.strip() for cell in rows[above[-1]]]
    upper = rows[above[-2]] if len(above) > 1 and above[-2] == above[-1] - 1 else ()
    if sum(1 for cell in upper if cell.strip()) > 1:  # a title is one cell
        names += [""] * (len(upper) - len(names))
        names = [n or u.strip() for n, u in itertools.zip_longest(names, upper, fillvalue="")]
    return tuple(names)


def _is_numbers(block: Sequence[Sequence[str]]) -> bool:
    """Whether at least two columns, and at least half of those in use, hold only numbers."""
    width = max(len(row) for row in block)
    columns = [[row[i].strip() if i < len(row) else "" for row in block] for i in range(width)]
    numeric = [
        all(_is_value(c) or c in MISSING_WORDS for c in column) and any(map(_is_value, column))
        for column in columns
    ]
    used = sum(1 for column in columns if any(column))
    return sum(numeric) >= 2 and 2 * sum(numeric) >= used


def _is_value(cell: str) -> bool:
    return is_number(cell) or is_clock(cell) or is_date(cell)


def _is_ruler(row: Sequence[str]) -> bool:
    return all(not cell.strip(" -=_*") for cell in row)


def is_units_row(cells: Sequence[str]) -> bool:
    """Whether a row holds units: no number, and at least half of its cells are known units."""
    filled = [cell.strip() for cell in cells if cell.strip()]
    units = sum(1 for cell in filled if is_unit(cell))
    own_units = sum(
        1 for cell in filled if is_known_unit(cell) or canonical_unit(cell) in ("V", "mV")
    )
    return (
        own_units > 0
        and 2 * units >= len(filled)
        and not any(is_number(c) and c != "1" for c in filled)
    )


def is_unit(text: str) -> bool:
    """Whether a text is one of our units or another unit common on benches."""
    known = is_known_unit(text) or canonical_unit(text) in OTHER_UNITS
    return known or bool(_CLOCK_FORM.fullmatch(text.strip("[]() ")))


def unit_in_name(name: str) -> str:
    """Extract the unit from a name: ``Kraft [N]``, ``Weg (mm)``, ``Zeit / s``; "" if none."""
    if len(name) > LONGEST_NAME:
        return ""
    match = IN_NAME.search(name) or _AFTER_NAME.search(name)
    unit = match[1].strip() if match else ""
    return unit if unit and is_unit(unit) else ""


def without_unit(name: str) -> str:
    """Remove the unit from the name of a channel."""
    if not unit_in_name(name):
        return name.strip()
    pattern = IN_NAME if IN_NAME.search(name) else _AFTER_NAME
    return pattern.sub("", name).strip()


def distinct_names(names: Sequence[str]) -> tuple[str, ...]:
    """Number the channel names that occur several times: ``Kraft #2 [N]``."""
    positions: dict[str, int] = {}
    distinct = []
    for name in names:
        positions[name] = positions.get(name, 0) + 1
        if name and names.count(name) > 1:
            bare = without_unit(name)
            name = f"{bare} #{positions[name]}{name[len(bare) :]}"
        distinct.append(name)
    return tuple(distinct)


def without_position(name: str) -> str:
    """Remove the number that `distinct_names` added."""
    return POSITION.sub("", name)


def side_by_side(names: Sequence[str]) -> list[list[int]]:
    """Split the columns of a table with several recordings side by side; [] if it holds one.

    All recordings have the same names in the same order; a name that occurs once belongs to all.

    Parameters
    ----------
    names : sequence of str
        Names of the columns from `distinct_names`.

    Returns
    -------
    list of list of int
        Indices of the columns of each recording.
    """
    repeated: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        if POSITION.search(name):
            repeated.setdefault(without_position(name), []).append(i)
    counts = {len(indices) for indices in repeated.values()}
    if len(repeated) < 2 or len(counts) != 1 or counts == {1}:
        return []
    shared = [i for i, name in enumerate(names) if name and not POSITION.search(name)]
    return [sorted([*shared, *part]) for part in zip(*repeated.values(), strict=True)]


def fields_of(rows: Sequence[Sequence[str]]) -> tuple[Field, ...]:
    """Read header fields from title lines: ``name, value[, unit]`` or one cell ``name: value``."""
    fields = []
    for row in rows:
        cells = [cell.strip().strip('"').strip() for cell in row]
        while cells and not cells[-1]:
            cells.pop()
        if not cells:
            continue
        cells[0] = cells[0].lstrip("#%").strip()
        if len(cells) == 1:
            name, mark, text = _split_field(cells[0])
            if mark and name:
                fields.append(read_field(name, text, ""))
        elif len(cells) <= 3 and cells[0]:
            fields.append(
                read_field(cells[0].rstrip(":= "), cells[1], cells[2] if len(cells) > 2 else "")
            )
    return tuple(fields)


def _split_field(text: str) -> tuple[str, str, str]:
    mark = next((m for m in ("=", ":") if m in text), "")
    name, _, value = text.partition(mark) if mark else (text, "", "")
    return name.strip(), mark, value.strip()


def read_field(name: str, text: str, unit: str = "") -> Field:
    """Build a header field; its unit is given, in the name, or after the number."""
    unit = unit or unit_in_name(name)
    number = re.match(r"\s*([-+]?[\d.,]+(?:[eE][-+]?\d+)?)\s*([^\d\s.,].*)$", text)
    if not unit and number and is_unit(number[2]):
        return Field(without_unit(name), number[1], number[2].strip())
    return Field(without_unit(name), text, unit)
