"""Read tables in text files (CSV, exports of testing machines) into raw tables."""

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
    are_recordings,
    how_to_state,
    map_channels,
    notes_of,
    sensors_of,
    stated_elsewhere,
)
from beltid.bench.channels.vocabulary import roles_meant
from beltid.bench.files.sniff import Decoded
from beltid.bench.formats.clock import Clock, written_as
from beltid.bench.formats.csv_table import Wanted, read_rows
from beltid.bench.formats.dialect import (
    IN_NAME,
    Layout,
    asides_note,
    blank_asides,
    layout,
    side_by_side,
    unit_in_name,
)
from beltid.bench.formats.numbers import first_no_number
from beltid.bench.read_options import ReadOptions
from beltid.tables import schemas
from beltid.tables.columns import Table
from beltid.tables.schemas import NOMINAL, RUN_TEXTS
from beltid.tables.units import Conversion, allowed_units


def text_layout(decoded: Decoded, name: str, options: ReadOptions, table: Table) -> Layout:
    """Find header, units and separators of a text file."""
    our_names = [c.name for c in table.columns if c.name not in RUN_TEXTS]
    names_in_file = [options.names.get(name, name) for name in our_names]
    return layout(decoded.text, name, options.dialect, names_in_file)


def candidates_of(text_layout: Layout) -> list[Candidate]:
    """Return the columns of a text file as candidates for ours."""
    units = (*text_layout.unit_cells, *[""] * len(text_layout.header))
    cells = text_layout.first_cells()
    return [
        Candidate(name, units[i], i, written=written_as(cells[i]), sample=first_no_number(cells[i]))
        for i, name in enumerate(text_layout.header)
        if name
    ]


def read_text(decoded: Decoded, context: MappingContext) -> list[RawTable]:
    """Read the table in a text file, or several tables side by side.

    Parameters
    ----------
    decoded : Decoded
        The text.
    context : MappingContext
        Columns needed; nothing is returned if the header is wrong.
    """
    file_layout = text_layout(decoded, context.place, context.options, context.table)
    file_layout, asides = blank_asides(file_layout)
    candidates, stem = candidates_of(file_layout), PurePath(context.place).stem
    by_column = {c.key: replace(c, name=c.base) for c in candidates}
    parts = [[by_column[i] for i in part] for part in side_by_side(file_layout.header)]
    labels = [f"{stem}-{number}" for number in range(1, len(parts) + 1)]
    if not parts or not are_recordings(parts, candidates, context):
        parts, labels = [candidates], [stem]
    read = [
        raw
        for label, part in zip(labels, parts, strict=True)
        if (raw := _read_part(file_layout, label, part, context)) is not None
    ]
    notes = (*decoded.notes, *file_layout.notes, *asides_note(asides))
    return [replace(raw, notes=(*notes, *raw.notes)) for raw in read]


def _read_part(
    file_layout: Layout, label: str, candidates: Sequence[Candidate], context: MappingContext
) -> RawTable | None:
    """Read the recording in some columns of a text file; None if the header is wrong."""
    table, name, problems = context.table, context.place, context.problems
    path = PurePath(name)
    names = (*([label] if label != path.stem else []), path.name, path.stem)
    not_needed = stated_elsewhere(context.options.runs, file_layout.fields, table)
    wrong = problems.count
    mappings, wanted = wanted_columns(file_layout, candidates, context, not_needed)
    if problems.count > wrong:
        return None
    rows = read_rows(file_layout, wanted, name)
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
    clock_notes = [] if clock is None else clock.notes()
    notes = (*notes_of(mappings, table, [c.name for c in candidates]), *clock_notes)
    place = f"{name}:{file_layout.header_line}"
    return RawTable(
        name, names, label, columns, mappings, file_layout.fields, rows.all_lines(), notes, place
    )


def wanted_columns(
    file_layout: Layout,
    candidates: Sequence[Candidate],
    context: MappingContext,
    not_needed: Collection[str] = (),
) -> tuple[dict[str, ChannelMapping], dict[str, Wanted]]:
    """Find our columns in a text file and decide how to read them.

    Parameters
    ----------
    file_layout : Layout
        Header and units of the file.
    candidates : sequence of Candidate
        Its columns.
    context : MappingContext
        Columns needed.
    not_needed : collection of str
        Columns that the file need not contain.
    """
    at_header = replace(context, place=f"{context.place}:{file_layout.header_line}")
    at_units = replace(context, place=f"{context.place}:{file_layout.first_line - 1}")
    wrong = context.problems.count
    mappings = map_channels(candidates, at_units if file_layout.unit_cells else at_header)
    if context.problems.count == wrong:
        check_header([c.name for c in candidates], at_header, mappings, not_needed)
    return mappings, wanted_of(mappings, context)


def wanted_of(mappings: Mapping[str, ChannelMapping], context: MappingContext) -> dict[str, Wanted]:
    """Return which columns of a text file to read, and how."""
    return {
        role: Wanted(
            mapping.candidate.key,
            context.table.column(role).dtype == "string",
            mapping.shown,
            Clock(mapping.candidate.name) if mapping.is_clock else None,
            None if mapping.date is None else mapping.date.key,
        )
        for role, mapping in mappings.items()
    }


def convert(columns: dict[str, np.ndarray], mappings: Mapping[str, ChannelMapping]) -> None:
    """Convert the numbers of the file to our units and signs, in place."""
    for role, mapping in mappings.items():
        conversion = mapping.conversion
        if conversion != Conversion(1.0) and columns[role].dtype != object:
            columns[role] = conversion.apply(columns[role])


def check_header(
    header: Sequence[str],
    context: MappingContext,
    mappings: Mapping[str, ChannelMapping],
    not_needed: Collection[str] = (),
) -> None:
    """Report missing columns and suggest which columns may be meant.

    A table without required columns must still have at least one column.

    Parameters
    ----------
    header : sequence of str
        Names of the columns in the file.
    context : MappingContext
        Columns needed, and the place of the header.
    mappings : mapping of str to ChannelMapping
        Our columns that were found.
    not_needed : collection of str
        Columns that may be missing because they are stated elsewhere.
    """
    table, place, problems = context.table, context.place, context.problems
    names_in_file = {c.name: context.options.names.get(c.name, c.name) for c in table.columns}
    names_in_file |= {role: mapping.candidate.name for role, mapping in mappings.items()}
    shown = ", ".join(header[:20]) + (", ..." if len(header) > 20 else "")
    missing = []
    messages: list[str] = []
    for ours, theirs in names_in_file.items():
        if (
            ours in mappings
            or ours in not_needed
            or not (table.column(ours).required or theirs != ours)
        ):
            continue
        free = [column for column in header if column not in names_in_file.values()]
        close = difflib.get_close_matches(theirs, free, n=1, cutoff=0.6)
        guess = f", did you mean {close[0]}?" if close else _unknown_unit(ours, free, table)
        called = ours if ours == theirs else f"{theirs} (which the config names for {ours})"
        setting = ours in NOMINAL and not close
        if not setting:
            missing.append((ours, close))
        advice = how_to_state(ours, table.kind) if setting else guess
        messages.append(f"{place}: column {called} is missing{advice}")
    if not mappings and not any(column.required for column in table.columns):
        first = next(column.name for column in table.columns if column.dtype == "float64")
        missing.append((first, []))
        messages.append(f"{place}: holds no column of {table.command}")
    meant = kind_of_columns(header) if missing else ""
    if meant not in ("", table.kind):
        problems.add(
            f"{place}: these are the columns of a recording of {schemas.table(meant).command}, "
            f"not of {table.command}; in a config its key is data.{meant}",
        )
        return
    for text in messages if missing else ():  # missing settings alone are reported elsewhere
        problems.add(text)
    if missing and (rig_kind := _rig_kind_of(header, table)):
        problems.add(f"{place}: these are the channels of {rig_kind}")
    elif missing:
        ours, close = missing[0]
        example = close[0] if close else "its name in the file"
        problems.add(
            f"{place}: the columns found are {shown}; if they have other names, state them in the "
            f'config, columns: {{{table.kind}: {{{ours}: "{example}"}}}}'
        )


def _unknown_unit(ours: str, names: Sequence[str], table: Table) -> str:
    """Return advice on a channel that could be our column but for its unit; "" if there is none."""
    for name in names:
        bare = IN_NAME.sub("", name).strip()
        if bare != name and not unit_in_name(bare) and ours in roles_meant(bare, table.kind):
            units = ", ".join(allowed_units(table.column(ours).unit))
            return (
                f': the unit of "{name}" must be one of {units}, or state columns: '
                f'{{{table.kind}: {{{ours}: "{name}"}}}} and units: {{{table.kind}: {{{ours}: '
                "{factor: ..., offset: 0}}}"
            )
    return ""


def kind_of_columns(header: Sequence[str]) -> str:
    """Recognise a kind of recording by the sensors in its header; "" if none or several fit."""
    rigs = [schemas.rig_table(measures, weight_on) for measures, weight_on in schemas.RIG_KINDS]
    tables = (schemas.table("press"), schemas.table("speedloss"), *rigs)
    kinds = {t.kind for t in tables if set(sensors_of(t)) <= _columns_meant(header, t.kind)}
    return kinds.pop() if len(kinds) == 1 else ""


def _columns_meant(header: Sequence[str], kind: str) -> set[str]:
    """Return our columns that a header contains, by our names or by known words."""
    return {role for name in header for role in (name, *roles_meant(name, kind))}


def _rig_kind_of(header: Sequence[str], table: Table) -> str:
    """Return the config entry of another friction rig kind that the header fits, or ""."""
    if table.kind != "rig":
        return ""
    meant = _columns_meant(header, "rig")
    tensions = {"tension_tight_N", "tension_slack_N"}
    for measures, weight_on in schemas.RIG_KINDS:
        other_table = schemas.rig_table(measures, weight_on)
        needed = {c.name for c in other_table.columns if c.required} - {
            *schemas.SETTINGS,
            table.label,
        }
        enough = measures != "torque" or bool(meant & tensions)
        if (
            other_table != table
            and enough
            and needed | {"weight_N"} & set(other_table.names) <= meant
        ):
            on = f", weight_on: {weight_on}" if measures == "dead_weight" else ""
            return f"rig: {{kind: {measures}{on}}}"
    return ""
