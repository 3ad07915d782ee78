"""Whether the header of a CSV file names the columns that are needed, and what to do if not."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Mapping

from beltid.bench.channels.vocabulary import NOMINAL
from beltid.bench.formats.csv_table import Wanted
from beltid.bench.formats.dialect import Layout
from beltid.bench.formats.table_head import is_number
from beltid.bench.problems import Problems
from beltid.tables import schemas


def check_header(
    header: tuple[str, ...],
    in_file: Mapping[str, str],
    table: schemas.Table,
    place: str,
    problems: Problems,
    told: Collection[str] = (),
) -> None:
    """Note columns that are missing, with what they may be called instead.

    Parameters
    ----------
    header : tuple of str
        Names of the columns found.
    in_file : mapping
        Our columns -> their names in the file.
    table : Table
        What is needed.
    place : str
        Place of the header.
    problems : Problems
        Collects what is missing.
    told : collection of str
        Columns that were found, or need not be since they are told elsewhere.
    """
    shown = ", ".join(header[:20]) + (", ..." if len(header) > 20 else "")
    missing = []
    told_so: list[str] = []
    for ours, theirs in in_file.items():
        if ours in told or not (table.column(ours).required or theirs != ours):
            continue
        free = [column for column in header if column not in in_file.values()]
        close = difflib.get_close_matches(theirs, free, n=1, cutoff=0.6)
        guess = f", did you mean {close[0]}?" if close else ""
        called = ours if ours == theirs else f"{theirs} (which the config names for {ours})"
        setting = ours in NOMINAL and not close
        if not setting:
            missing.append((ours, close))
        advice = _advice(ours, table.kind) if setting else guess
        told_so.append(f"{place}: column {called} is missing{advice}")
    for text in told_so if missing else ():  # settings alone: who gives them their values says it
        problems.add(text)
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


def missing_setting(setting: str, kind: str, place: str) -> str:
    """Say that neither a column nor anything else tells a setting, and how it can be told."""
    return f"{place}: column {setting} is missing{_advice(setting, kind)}"


def _advice(setting: str, kind: str) -> str:
    """The ways to tell a setting that no column holds."""
    return (
        f"; if it holds for every run: runs: {{{kind}: {{values: {{{setting}: ...}}}}}}; if the "
        f"names of the files tell it: runs: {{{kind}: {{pattern: "
        f'"{{run}}_{{{setting}}}.csv"}}}}; or in a table of the files: runs: {{{kind}: '
        "{table: runs.csv}}"
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
    first = found.body.lstrip(b"\n").split(b"\n", 1)[0].decode().split(found.separator)
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
