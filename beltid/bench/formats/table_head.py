"""Where the title lines, the header, the row of units and the numbers of a table stand."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from beltid.bench.formats.bench_file import Field
from beltid.tables.units import canonical_unit, is_known_unit

SEARCHED: Final = 400
"""Rows in which the header is looked for."""
BLOCK: Final = 5
"""Rows that must look alike to be the begin of the numbers."""
_OTHER: Final = "1 - -- % # V mV mV/V A mA Hz Pa kPa MPa bar W kW J g kg mm/s mm/min m/s m/s^2 m/s²"
OTHER_UNITS: Final = frozenset((*_OTHER.split(), "N/mm", "N/mm²", "l/min"))
"""Units that no column of ours has, but that stand in a row of units."""
NUMBER: Final = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?", re.ASCII)
MISSING_WORDS: Final = frozenset(
    ("", "nan", "NaN", "NAN", "NA", "N/A", "n/a", "null", "NULL", "None", "-")
)
LONGEST_NAME: Final = 300
"""Longer names of channels are not searched for a unit."""
_IN_NAME: Final = re.compile(r"[\[(<{]([^\[\](){}<>]*)[\])>}]\s*$")
# "Zeit / s", "Zeit/s", "Zeit in s"; not the slash within a unit, as in "v rad/s"
_AFTER_NAME: Final = re.compile(r"(?:(?<!\s)\s+/\s*|(?<=\w{4})/|(?<!\s)\s+in\s+)(\S+)\s*$")


@dataclass(frozen=True, slots=True)
class TableHead:
    """What stands above the numbers of a table.

    Attributes
    ----------
    names : tuple of str
        Cells of the header.
    units : tuple of str
        Cells of the row of units, empty without one.
    header_row, first_row : int
        Index of the header and of the first row of numbers.
    fields : tuple of Field
        Title lines of the form name and value.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    header_row: int
    first_row: int
    fields: tuple[Field, ...]


def is_number(text: str) -> bool:
    """Whether a cell reads as a number, with a decimal point or a decimal comma."""
    return bool(NUMBER.fullmatch(text.replace(",", ".")))


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
        if at == 0 or not _is_numbers(block):
            continue
        above = [i for i in filled[:at] if not _is_ruler(rows[i])]
        if not above:
            return None
        units: tuple[str, ...] = ()
        if len(above) > 1 and is_units_row(rows[above[-1]]):
            units = tuple(cell.strip() for cell in rows[above[-1]])
            above.pop()
        names = tuple(cell.strip() for cell in rows[above[-1]])
        if sum(1 for name in names if name and not is_number(name)) < 2:
            return None
        fields = fields_of([rows[i] for i in above[:-1]])
        return TableHead(names, units, above[-1], index, fields)
    return None


def _is_numbers(block: Sequence[Sequence[str]]) -> bool:
    """Whether at least two columns hold numbers only, and most of the cells are numbers."""
    width = max(len(row) for row in block)
    columns = [[row[i].strip() if i < len(row) else "" for row in block] for i in range(width)]
    numeric = [
        all(is_number(c) or c in MISSING_WORDS for c in column) and any(map(is_number, column))
        for column in columns
    ]
    used = sum(1 for column in columns if any(column))
    return sum(numeric) >= 2 and 2 * sum(numeric) >= used


def _is_ruler(row: Sequence[str]) -> bool:
    return all(not cell.strip(" -=_*") for cell in row)


def is_units_row(cells: Sequence[str]) -> bool:
    """Whether a row holds units: no number, and at least half of its cells are known units."""
    filled = [cell.strip() for cell in cells if cell.strip()]
    known = sum(1 for cell in filled if is_unit(cell))
    real = sum(1 for cell in filled if is_known_unit(cell) or canonical_unit(cell) in ("V", "mV"))
    return (
        real > 0 and 2 * known >= len(filled) and not any(is_number(c) and c != "1" for c in filled)
    )


def is_unit(text: str) -> bool:
    """Whether a text is a unit, of ours or another one of benches."""
    return is_known_unit(text) or canonical_unit(text) in OTHER_UNITS


def unit_in_name(name: str) -> str:
    """Unit that stands in a channel's name: ``Kraft [N]``, ``Weg (mm)``, ``Zeit / s``; else ""."""
    if len(name) > LONGEST_NAME:
        return ""
    found = _IN_NAME.search(name) or _AFTER_NAME.search(name)
    unit = found[1].strip() if found else ""
    return unit if unit and is_unit(unit) else ""


def without_unit(name: str) -> str:
    """The name of a channel without the unit that stands in it."""
    if not unit_in_name(name):
        return name.strip()
    where = _IN_NAME if _IN_NAME.search(name) else _AFTER_NAME
    return where.sub("", name).strip()


def fields_of(rows: Sequence[Sequence[str]]) -> tuple[Field, ...]:
    """Header fields of title lines: ``name, value[, unit]`` or ``name: value`` in one cell."""
    fields = []
    for row in rows:
        cells = [cell.strip().strip('"').strip() for cell in row]
        while cells and not cells[-1]:
            cells.pop()
        if not cells:
            continue
        cells[0] = cells[0].lstrip("#%").strip()
        if len(cells) == 1:
            name, mark, text = _parted(cells[0])
            if mark and name:
                fields.append(read_field(name, text, ""))
        elif len(cells) <= 3 and cells[0]:
            fields.append(
                read_field(cells[0].rstrip(":= "), cells[1], cells[2] if len(cells) > 2 else "")
            )
    return tuple(fields)


def _parted(text: str) -> tuple[str, str, str]:
    mark = next((m for m in ("=", ":") if m in text), "")
    name, _, value = text.partition(mark) if mark else (text, "", "")
    return name.strip(), mark, value.strip()


def read_field(name: str, text: str, unit: str = "") -> Field:
    """A field whose unit stands in a cell of its own, in its name, or after the number."""
    unit = unit or unit_in_name(name)
    number = re.match(r"\s*([-+]?[\d.,]+(?:[eE][-+]?\d+)?)\s*([^\d\s.,].*)$", text)
    if not unit and number and is_unit(number[2]):
        return Field(without_unit(name), number[1], number[2].strip())
    return Field(without_unit(name), text, unit)
