"""Tables in text files: CSV, exports of testing machines -> a raw table."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import PurePath

import numpy as np

from beltid.bench.channels.channel_mapping import (
    Candidate,
    ChannelMapping,
    MappingContext,
    RawTable,
    how_to_tell,
    is_whole,
    map_channels,
    notes_of,
    sensors_of,
    told_elsewhere,
)
from beltid.bench.channels.vocabulary import roles_meant
from beltid.bench.files.sniff import Decoded
from beltid.bench.formats.clock import Clock, written_as
from beltid.bench.formats.csv_table import Wanted, read_rows
from beltid.bench.formats.dialect import Layout, asides_note, blank_asides, layout, side_by_side
from beltid.bench.read_options import ReadOptions
from beltid.tables import schemas
from beltid.tables.columns import Table
from beltid.tables.schemas import NOMINAL, SAID_OF_RUNS
from beltid.tables.units import Conversion


def text_layout(decoded: Decoded, name: str, options: ReadOptions, table: Table) -> Layout:
    """Header, units and separators of a text file."""
    asked_for = [c.name for c in table.columns if c.name not in SAID_OF_RUNS]
    in_file = [options.names.get(name, name) for name in asked_for]
    return layout(decoded.text, name, options.dialect, in_file)


def candidates_of(found: Layout) -> list[Candidate]:
    """The columns of a text file, as candidates for ours."""
    units = (*found.unit_cells, *[""] * len(found.header))
    cells = found.first_cells()
    return [
        Candidate(name, units[i], i, written=written_as(cells[i]))
        for i, name in enumerate(found.header)
        if name
    ]


def read_text(decoded: Decoded, context: MappingContext) -> list[RawTable]:
    """Read the columns of a table in a text file; of several, where they stand side by side.

    Parameters
    ----------
    decoded : Decoded
        The text.
    context : MappingContext
        What is needed of the file; nothing is returned if its header is wrong.
    """
    found = text_layout(decoded, context.place, context.options, context.table)
    found, asides = blank_asides(found)
    candidates, stem = candidates_of(found), PurePath(context.place).stem
    by_column = {c.key: replace(c, name=c.base) for c in candidates}
    parts = [[by_column[i] for i in part] for part in side_by_side(found.header)]
    labels = [f"{stem}-{number}" for number in range(1, len(parts) + 1)]
    if not parts or not all(is_whole(part, context) for part in parts):
        parts, labels = [candidates], [stem]
    read = [
        raw
        for label, part in zip(labels, parts, strict=True)
        if (raw := _read_part(found, label, part, context)) is not None
    ]
    notes = (*decoded.notes, *found.notes, *asides_note(asides))
    return [replace(raw, notes=(*notes, *raw.notes)) for raw in read]


def _read_part(
    found: Layout, label: str, candidates: Sequence[Candidate], context: MappingContext
) -> RawTable | None:
    """The recording that some columns of a text file hold; None if the header is wrong."""
    table, name, problems = context.table, context.place, context.problems
    path = PurePath(name)
    names = (*([label] if label != path.stem else []), path.name, path.stem)
    told = told_elsewhere(context.options.runs, found.fields, table)
    wrong = problems.count
    mappings, wanted = wanted_columns(found, candidates, context, told)
    if problems.count > wrong:
        return None
    rows = read_rows(found, wanted, name)
    problems.take(rows.problems)
    columns = rows.columns()
    clock = wanted["time_s"].clock if "time_s" in wanted else None
    if clock is not None:
        runs = rows.texts.get(table.label)
        columns["time_s"] = clock.elapsed(
            columns["time_s"],
            lambda i: (f"{name}:{rows.line_of(i)}", rows.line_of(i)),
            problems,
            None if runs is None else runs.codes,
        )
    convert(columns, mappings)
    of_clock = [] if clock is None else clock.notes()
    notes = (*notes_of(mappings, table, [c.name for c in candidates]), *of_clock)
    place = f"{name}:{found.header_line}"
    return RawTable(
        name, names, label, columns, mappings, found.fields, rows.all_lines(), notes, place
    )


def wanted_columns(
    found: Layout,
    candidates: Sequence[Candidate],
    context: MappingContext,
    told: Collection[str] = (),
) -> tuple[dict[str, ChannelMapping], dict[str, Wanted]]:
    """Where our columns stand in a text file, and how they are read.

    Parameters
    ----------
    found : Layout
        Header and units of the file.
    candidates : sequence of Candidate
        Its columns.
    context : MappingContext
        What is needed of the file.
    told : collection of str
        Columns that need not stand in the file.
    """
    at_header = replace(context, place=f"{context.place}:{found.header_line}")
    at_units = replace(context, place=f"{context.place}:{found.first_line - 1}")
    wrong = context.problems.count
    mappings = map_channels(candidates, at_units if found.unit_cells else at_header)
    if context.problems.count == wrong:
        check_header([c.name for c in candidates], at_header, mappings, told)
    return mappings, wanted_of(mappings, context)


def wanted_of(mappings: Mapping[str, ChannelMapping], context: MappingContext) -> dict[str, Wanted]:
    """Columns of a text file to be read, as it is decided."""
    return {
        role: Wanted(
            r.candidate.key,
            context.table.column(role).dtype == "string",
            r.shown,
            Clock(r.candidate.name, context.options.dialect.time_zone) if r.is_clock else None,
            None if r.date is None else r.date.key,
        )
        for role, r in mappings.items()
    }


def convert(columns: dict[str, np.ndarray], mappings: Mapping[str, ChannelMapping]) -> None:
    """Bring columns from the numbers of the file to our units and signs, in place."""
    for role, mapping in mappings.items():
        by = mapping.conversion
        if by != Conversion(1.0) and columns[role].dtype != object:
            columns[role] = by.apply(columns[role])


def check_header(
    header: Sequence[str],
    context: MappingContext,
    found: Mapping[str, ChannelMapping],
    told: Collection[str] = (),
) -> None:
    """Note columns that are missing, with what they may be called instead.

    A table of which no column must be there has at least one.

    Parameters
    ----------
    header : sequence of str
        Names of the columns found.
    context : MappingContext
        What is needed, and where the header stands.
    found : mapping of str to ChannelMapping
        Our columns that were found.
    told : collection of str
        Columns that need not be found, since they are told elsewhere.
    """
    table, place, problems = context.table, context.place, context.problems
    in_file = {c.name: context.options.names.get(c.name, c.name) for c in table.columns}
    in_file |= {role: mapping.candidate.name for role, mapping in found.items()}
    shown = ", ".join(header[:20]) + (", ..." if len(header) > 20 else "")
    missing = []
    told_so: list[str] = []
    for ours, theirs in in_file.items():
        if ours in found or ours in told or not (table.column(ours).required or theirs != ours):
            continue
        free = [column for column in header if column not in in_file.values()]
        close = difflib.get_close_matches(theirs, free, n=1, cutoff=0.6)
        guess = f", did you mean {close[0]}?" if close else ""
        called = ours if ours == theirs else f"{theirs} (which the config names for {ours})"
        setting = ours in NOMINAL and not close
        if not setting:
            missing.append((ours, close))
        advice = how_to_tell(ours, table.kind) if setting else guess
        told_so.append(f"{place}: column {called} is missing{advice}")
    if not found and not any(column.required for column in table.columns):
        first = next(column.name for column in table.columns if column.dtype == "float64")
        missing.append((first, []))
        told_so.append(f"{place}: holds no column of {table.command}")
    other = kind_of_columns(header) if missing else ""
    if other not in ("", table.kind):
        problems.add(
            f"{place}: these are the columns of a recording of {schemas.table(other).command}, "
            f"not of {table.command}; a config names it as data.{other}",
            code="columns",
        )
        return
    for text in told_so if missing else ():  # settings alone: who gives them their values says it
        problems.add(text, code="columns")
    if missing and (kind := _rig_kind_of(header, table)):
        problems.add(f"{place}: these are the channels of {kind}", code="columns")
    elif missing:
        ours, close = missing[0]
        example = close[0] if close else "its name in the file"
        problems.add(
            f"{place}: the columns found are {shown}; other names are told by the config, "
            f'columns: {{{table.kind}: {{{ours}: "{example}"}}}}'
        )


def kind_of_columns(header: Sequence[str]) -> str:
    """The kind of recording whose sensors a header names, by our names or known words; else ""."""
    rigs = [schemas.rig_table(measures, weight_on) for measures, weight_on in schemas.RIG_KINDS]
    tables = (schemas.table("press"), schemas.table("speedloss"), *rigs)
    found = {t.kind for t in tables if set(sensors_of(t)) <= _columns_meant(header, t.kind)}
    return found.pop() if len(found) == 1 else ""


def _columns_meant(header: Sequence[str], kind: str) -> set[str]:
    """Our columns that a header names, by our names or known words."""
    return {role for name in header for role in (name, *roles_meant(name, kind))}


def _rig_kind_of(header: Sequence[str], table: Table) -> str:
    """Another kind of friction rig whose channels a header has, as the config states it; or ""."""
    if table.kind != "rig":
        return ""
    meant = _columns_meant(header, "rig")
    tensions = {"tension_tight_N", "tension_slack_N"}
    for measures, weight_on in schemas.RIG_KINDS:
        other = schemas.rig_table(measures, weight_on)
        needed = {c.name for c in other.columns if c.required} - {*schemas.SETTINGS, table.label}
        enough = measures != "torque" or bool(meant & tensions)
        if other != table and enough and needed | {"weight_N"} & set(other.names) <= meant:
            on = f", weight_on: {weight_on}" if measures == "dead_weight" else ""
            return f"rig: {{kind: {measures}{on}}}"
    return ""
