"""Whether the header of a CSV file names the columns that are needed, and what to do if not."""

from __future__ import annotations

import difflib
from collections.abc import Mapping

from beltid.store import schemas
from beltid.store.csv_reader import Wanted, is_number
from beltid.store.dialect import Layout
from beltid.store.problems import Problems


def check_header(
    header: tuple[str, ...],
    in_file: Mapping[str, str],
    table: schemas.Table,
    place: str,
    problems: Problems,
) -> None:
    """Note columns that are missing or stand twice, with what they may be called instead."""
    shown = ", ".join(header[:20]) + (", ..." if len(header) > 20 else "")
    missing = []
    for ours, theirs in in_file.items():
        if header.count(theirs) > 1:
            problems.add(f"{place}: column {theirs} stands {header.count(theirs)} times")
        if theirs in header or not (table.column(ours).required or theirs != ours):
            continue
        free = [column for column in header if column not in in_file.values()]
        close = difflib.get_close_matches(theirs, free, n=1, cutoff=0.6)
        guess = f", did you mean {close[0]}?" if close else ""
        called = ours if ours == theirs else f"{theirs} (which the config names for {ours})"
        missing.append((ours, close))
        problems.add(f"{place}: column {called} is missing{guess}")
    other = _kind_of(header, table.kind)
    if missing and other:
        problems.add(
            f"{place}: these are the columns of a {other} recording, not of a {table.kind}"
        )
    elif missing:
        ours, close = missing[0]
        example = close[0] if close else "its name in the file"
        problems.add(
            f"{place}: the columns found are {shown}; other names are told by the config, "
            f'columns: {{{table.kind}: {{{ours}: "{example}"}}}}'
        )


def _kind_of(header: tuple[str, ...], kind: str) -> str:
    """Another kind of recording that has all its columns in the header, or ""."""
    for other in schemas.RECORDINGS:
        names = {c.name for c in schemas.table(other).columns if c.required}
        if other != kind and names <= set(header):
            return other
    return ""


def hint_units_row(
    found: Layout, wanted: Mapping[str, Wanted], name: str, problems: Problems
) -> None:
    """Say it first when the first row holds no number: most likely it is the row of units."""
    first = found.body.lstrip("\n").split("\n", 1)[0].split(found.separator)
    cells = [
        first[w.index].strip(' "')
        for w in wanted.values()
        if not w.is_text and w.index < len(first)
    ]
    if found.unit_cells or not any(cells) or any(is_number(c) for c in cells):
        return
    problems.found.insert(
        0,
        (
            -1,
            f"{name}:{found.first_line}: holds no number; "
            "if it is a row of units, set dialect: {units_row: true}",
        ),
    )
    problems.count += 1
