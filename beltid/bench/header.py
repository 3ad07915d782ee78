"""The head of a table: title lines, names, row of units; names with units and positions."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from beltid.bench.clock import is_clock, is_date
from beltid.bench.numbers import MISSING, is_number
from beltid.bench.raw import POSITION, Field
from beltid.tables.units import canonical_unit, is_known_unit

SEARCHED: Final = 400
"""Rows searched for a header below title lines."""
MAX_COLUMNS: Final = 2000
BLOCK: Final = 5
"""Number of similar rows that mark the beginning of the numbers."""
_OTHER: Final = "1 - -- % # V mV mV/V A mA Hz Pa kPa MPa bar W kW J mm/s mm/min m/s m/s^2 m/s²"
OTHER_UNITS: Final = frozenset((*_OTHER.split(), "N/mm", "N/mm²", "l/min"))
"""Units that none of our columns has, but that occur in a row of units."""
_CLOCK_FORM: Final = re.compile(r"h{1,2}:mm(:ss)?([.,][sf0]+)?", re.IGNORECASE)
IN_NAME: Final = re.compile(r"[\[(<{]([^\[\](){}<>]*)[\])>}]\s*$")
"""Brackets at the end of a name, which may hold its unit."""
# "Zeit / s", "Zeit/s", "Zeit in s"; not the slash within a unit, as in "v rad/s"
_AFTER_NAME: Final = re.compile(r"(?:(?<!\s)\s+/\s*|(?<=\w{4})/|(?<!\s)\s+in\s+)(\S+)\s*$")


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
    filled = [i for i, row in enumerate(rows) if any(row)]
    for at, index in enumerate(filled[1:], start=1):
        block = [rows[i] for i in filled[at : at + BLOCK]]
        if not _is_numbers(block) or is_units_row(block[0]):
            continue
        above = [i for i in filled[:at] if any(cell.strip(" -=_*") for cell in rows[i])]
        if not above:
            return None
        units_row = above.pop() if len(above) > 1 and is_units_row(rows[above[-1]]) else -1
        notes = []
        while len(above) > 1 and sum(map(bool, rows[above[-1]])) < 2:
            notes.append(rows[above.pop()])  # a start or a rate between names and units
        names = _names_of(rows, above)
        if sum(1 for name in names if name and not is_number(name)) < 2:
            return None
        fields = fields_of([*(rows[i] for i in above[:-1]), *notes])
        units = tuple(rows[units_row]) if units_row >= 0 else ()
        return Head(names, units, above[-1], units_row, index, fields)
    return None


def head_at(rows: Sequence[Sequence[str]], row: int) -> Head:
    """Return the head whose names are in a row; a row of units may follow."""
    below = next((i for i in range(row + 1, len(rows)) if any(rows[i])), row + 1)
    fields = fields_of([r for r in rows[:row] if r and r[0].startswith("#")])
    if below < len(rows) and is_units_row(rows[below]):
        return Head(tuple(rows[row]), tuple(rows[below]), row, below, below + 1, fields)
    return Head(tuple(rows[row]), (), row, -1, below, fields)


def _names_of(rows: Sequence[Sequence[str]], above: Sequence[int]) -> tuple[str, ...]:
    """Return the column names; a blank one is taken from the row above (merged cells)."""
    names = rows[above[-1]]
    upper = rows[above[-2]] if len(above) > 1 and above[-2] == above[-1] - 1 else ()
    if sum(map(bool, upper)) > 1:  # a title is one cell
        names = [name or over for name, over in itertools.zip_longest(names, upper, fillvalue="")]
    return tuple(names)


def _is_numbers(block: Sequence[Sequence[str]]) -> bool:
    """Return whether two columns, and half of those in use, hold only numbers."""
    columns = [*itertools.zip_longest(*block, fillvalue="")]
    numeric = [
        any(map(_is_value, column)) and all(_is_value(c) or c in MISSING for c in column)
        for column in columns
    ]
    return sum(numeric) >= 2 and 2 * sum(numeric) >= sum(1 for column in columns if any(column))


def _is_value(cell: str) -> bool:
    return is_number(cell) or is_clock(cell) or is_date(cell)


def is_units_row(cells: Sequence[str]) -> bool:
    """Return whether a row holds units: no number, and at least half of its cells are units."""
    filled = [cell for cell in cells if cell]
    own = any(is_known_unit(c) or canonical_unit(c) in ("V", "mV") for c in filled)
    half = 2 * sum(map(is_unit, filled)) >= len(filled)
    return own and half and not any(is_number(c) and c != "1" for c in filled)


def is_unit(text: str) -> bool:
    """Return whether a text is one of our units or another unit common on benches."""
    known = is_known_unit(text) or canonical_unit(text) in OTHER_UNITS
    return known or bool(_CLOCK_FORM.fullmatch(text.strip("[]() ")))


def unit_in_name(name: str) -> str:
    """Extract the unit from a name: ``Kraft [N]``, ``Weg (mm)``, ``Zeit / s``; "" if none."""
    match = (IN_NAME.search(name) or _AFTER_NAME.search(name)) if len(name) <= 300 else None
    unit = match[1].strip() if match else ""
    return unit if unit and is_unit(unit) else ""


def without_unit(name: str) -> str:
    """Remove the unit from the name of a channel."""
    if not unit_in_name(name):
        return name.strip()
    return (IN_NAME if IN_NAME.search(name) else _AFTER_NAME).sub("", name).strip()


def distinct_names(names: Sequence[str]) -> list[str]:
    """Number the channel names that occur several times: ``Kraft #2 [N]``."""
    counts, positions = Counter(names), Counter[str]()
    distinct = []
    for name in names:
        positions[name] += 1
        bare = without_unit(name) if name and counts[name] > 1 else name
        mark = f" #{positions[name]}" if name and counts[name] > 1 else ""
        distinct.append(f"{bare}{mark}{name[len(bare) :]}")
    return distinct


def without_position(name: str) -> str:
    """Remove the number that `distinct_names` added."""
    return POSITION.sub("", name)


def side_by_side(names: Sequence[str]) -> list[list[str]]:
    """Split the names of a table with several recordings side by side; [] if it holds one.

    All have the same names in the same order; a name that occurs once belongs to all.
    """
    repeated: dict[str, list[str]] = {}
    for name in names:
        if POSITION.search(name):
            repeated.setdefault(without_position(name), []).append(name)
    counts = {len(alike) for alike in repeated.values()}
    if len(repeated) < 2 or len(counts) != 1 or counts == {1}:
        return []
    shared = [name for name in names if not POSITION.search(name)]
    return [[*shared, *part] for part in zip(*repeated.values(), strict=True)]


def fields_of(rows: Sequence[Sequence[str]]) -> tuple[Field, ...]:
    """Read header fields from title lines: ``name, value[, unit]`` or one cell ``name: value``."""
    fields = []
    for row in rows:
        cells = [cell.strip('" ') for cell in row]
        if len(cells) == 1:
            cells = re.split("[=:]", cells[0], maxsplit=1)
        name = cells[0].strip("#%:= ") if cells else ""
        if name and 2 <= len(cells) <= 3:
            fields.append(read_field(name, *(cell.strip() for cell in cells[1:])))
    return tuple(fields)


def read_field(name: str, text: str, unit: str = "") -> Field:
    """Build a header field; its unit is given, in the name, or after the number."""
    unit = unit or unit_in_name(name)
    number = re.match(r"\s*([-+]?[\d.,]+(?:[eE][-+]?\d+)?)\s*([^\d\s.,].*)$", text)
    if not unit and number and is_unit(number[2]):
        return Field(without_unit(name), number[1], number[2].strip())
    return Field(without_unit(name), text, unit)
