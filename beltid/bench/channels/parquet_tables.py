"""Tables in Parquet files, their columns found as those of any other file -> raw tables."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from beltid.bench.channels.channel_mapping import (
    Candidate,
    ChannelMapping,
    MappingContext,
    RawTable,
    map_channels,
    notes_of,
    told_elsewhere,
)
from beltid.bench.channels.text_tables import check_header, convert, wanted_of
from beltid.bench.channels.vocabulary import means_date, roles_meant
from beltid.bench.files.sources import Source
from beltid.bench.formats.clock import Clock, written_as
from beltid.bench.formats.csv_table import Wanted
from beltid.bench.formats.parquet import ParquetTable, first_texts, parquet_blocks
from beltid.bench.formats.rows import Rows, Texts, together
from beltid.errors import InputError
from beltid.tables.units import Conversion

Mappings = dict[str, ChannelMapping]


def candidates_of(part: ParquetTable, context: MappingContext) -> list[Candidate]:
    """Columns of a Parquet file and of the names of its folders, as candidates for ours."""
    import pyarrow as pa

    there = part.schema
    of_time = [n for n in there.names if means_date(n) or "time_s" in roles_meant(n, context.kind)]
    of_time.append(context.options.names.get("time_s", "time_s"))
    written = {name: written_as(cells) for name, cells in first_texts(part, of_time).items()}
    fields = {field.name: field for field in there}
    units = {
        n: (f.metadata or {}).get(b"unit", b"").decode(errors="replace") for n, f in fields.items()
    }
    units |= {n: "s" for n in of_time if n in fields and pa.types.is_duration(fields[n].type)}
    names = dict.fromkeys([*there.names, *part.folders])
    return [Candidate(n, units.get(n, ""), n, written=written.get(n, "")) for n in names if n]


def map_columns(
    part: ParquetTable, context: MappingContext, told: Collection[str] = ()
) -> Mappings:
    """Find our columns in a Parquet file.

    Parameters
    ----------
    part : ParquetTable
        The file.
    context : MappingContext
        What is needed of it; takes what is wrong.
    told : collection of str
        Columns that need not stand in the file.
    """
    context, wrong = replace(context, place=part.name), context.problems.count
    candidates = candidates_of(part, context)
    mappings = map_channels(candidates, context)
    if context.problems.count == wrong:
        check_header([c.name for c in candidates], context, mappings, told)
    return mappings


def read_parquet(
    tables: Sequence[ParquetTable], path: Path, context: MappingContext
) -> list[RawTable]:
    """Read the columns of a table from Parquet files.

    Files whose rows are labelled are parts of one table, unless the names of the files or a table
    tell the settings; others are a run each.

    Parameters
    ----------
    tables : sequence of ParquetTable
        The files.
    path : Path
        What was named.
    context : MappingContext
        What is needed; nothing is returned if columns are missing.
    """
    runs, label = context.options.runs, context.table.label
    told = told_elsewhere(runs, (), context.table)
    found = [(part, map_columns(part, context, told)) for part in tables]
    if context.problems.count:
        return []
    named = runs.pattern is not None or runs.table is not None
    parts = [found] if all(label in m for _, m in found) and not named else [[f] for f in found]
    return [_raw(part, str(path) if len(part) > 1 else part[0][0].name, context) for part in parts]


def _raw(
    found: Sequence[tuple[ParquetTable, Mappings]], name: str, context: MappingContext
) -> RawTable:
    """The raw table that some files are together."""
    table, problems, row, parts = context.table, context.problems, 1, []
    first: dict[str, Wanted] = {}
    for part, mappings in found:
        wanted = _wanted(part, mappings, first, context)
        for rows in parquet_blocks(part, wanted, table, row):
            row += len(rows)
            problems.take(rows.problems)
            columns = rows.columns()
            convert(columns, mappings)
            parts.append(columns)
    if row == 1:
        raise InputError(f"{name}: holds no samples")
    columns, mappings = together(parts, table), found[0][1]
    clock = first["time_s"].clock if "time_s" in first else None
    if clock is not None:
        runs = Texts.of(columns[table.label]).codes if table.label in columns else None
        columns["time_s"] = clock.elapsed(
            columns["time_s"], lambda i: (f"{name}, row {i + 1}", i + 1), problems, runs
        )
    names = [c.name for c in candidates_of(found[0][0], context)]
    notes = (*notes_of(mappings, table, names), *([] if clock is None else clock.notes()))
    stated = {
        role: replace(m, unit_stated=all(role in o and o[role].unit_stated for _, o in found))
        for role, m in mappings.items()
    }
    inside = found[0][0].inside
    return RawTable(
        name,
        (inside.name, inside.stem),
        inside.stem,
        {role: values for role, values in columns.items() if any(role in m for _, m in found)},
        stated,
        notes=notes,
        name_place=name,
        row_word="row",
    )


def _wanted(
    part: ParquetTable, mappings: Mappings, first: dict[str, Wanted], context: MappingContext
) -> dict[str, Wanted]:
    """How columns of a file are read; the clock of the first file reads the times of all."""
    wanted = wanted_of(mappings, context)
    if not first:
        first.update(wanted)
    time, known = wanted.get("time_s"), first.get("time_s")
    if time is None or known is None or (time.clock is None and known.clock is None):
        return wanted
    if time.clock is None or known.clock is None:
        holds = "no clock times, as" if time.clock is None else "clock times, unlike"
        raise InputError(f"{part.name}: column {time.index} holds {holds} the first file does")
    if known.date is not None and time.date is None:
        text = f"{part.name}: column {known.date} of dates is missing, the first file has it"
        raise InputError(text)
    return wanted | {"time_s": replace(time, clock=known.clock)}


def stream_parquet(
    sources: Sequence[Source], context: MappingContext
) -> tuple[Mappings, Clock | None, Iterator[Rows]]:
    """Columns of the first of some files, the reader of their clock, and the rows of all.

    Raises
    ------
    InputError
        If columns of the first file are missing; those of others when their rows are asked for.
    """
    head = ParquetTable.of(sources[0])
    mappings = map_columns(head, context)
    context.problems.raise_if_any()
    first: dict[str, Wanted] = {}
    _wanted(head, mappings, first, context)

    def blocks() -> Iterator[Rows]:
        row = 1
        for source in sources:
            part = head if source is sources[0] else ParquetTable.of(source)
            found = mappings if part is head else map_columns(part, context)
            context.problems.raise_if_any()
            for role, mapping in found.items():
                if mapping.conversion != getattr(mappings.get(role), "conversion", Conversion(1.0)):
                    text = f"{part.name}: {mapping.shown} has another unit than in the first file"
                    raise InputError(text)
            wanted = _wanted(part, found, first, context)
            for rows in parquet_blocks(part, wanted, context.table, row):
                yield rows
                row += len(rows)

    return mappings, first["time_s"].clock, blocks()
