"""Read tables in Parquet files into raw tables; columns are mapped as in any other file."""

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
    stated_elsewhere,
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
    """Return the columns of a Parquet file as candidates for ours."""
    import pyarrow as pa

    schema = part.schema
    time_names = [
        n for n in schema.names if means_date(n) or "time_s" in roles_meant(n, context.kind)
    ]
    time_names.append(context.options.names.get("time_s", "time_s"))
    written = {name: written_as(cells) for name, cells in first_texts(part, time_names).items()}
    fields = {field.name: field for field in schema}
    units = {
        n: (f.metadata or {}).get(b"unit", b"").decode(errors="replace") for n, f in fields.items()
    }
    units |= {n: "s" for n in time_names if n in fields and pa.types.is_duration(fields[n].type)}
    names = dict.fromkeys(schema.names)
    return [Candidate(n, units.get(n, ""), n, written=written.get(n, "")) for n in names if n]


def map_columns(
    part: ParquetTable, context: MappingContext, not_needed: Collection[str] = ()
) -> Mappings:
    """Find our columns in a Parquet file.

    Parameters
    ----------
    part : ParquetTable
        The file.
    context : MappingContext
        Columns needed; collects the problems.
    not_needed : collection of str
        Columns that the file need not contain.
    """
    context, wrong = replace(context, place=part.name), context.problems.count
    candidates = candidates_of(part, context)
    mappings = map_channels(candidates, context)
    if context.problems.count == wrong:
        check_header([c.name for c in candidates], context, mappings, not_needed)
    return mappings


def read_parquet(
    tables: Sequence[ParquetTable], path: Path, context: MappingContext
) -> list[RawTable]:
    """Read the columns of a table from Parquet files.

    Files with labelled rows are parts of one table, unless the file names or a table of runs state
    the settings. Otherwise each file is one run.

    Parameters
    ----------
    tables : sequence of ParquetTable
        The files.
    path : Path
        The path that the user named.
    context : MappingContext
        Columns needed; nothing is returned if some are missing.
    """
    runs, label = context.options.runs, context.table.label
    not_needed = stated_elsewhere(runs, (), context.table)
    mapped = [(part, map_columns(part, context, not_needed)) for part in tables]
    if context.problems.count:
        return []
    named = runs["pattern"] or runs["table"]
    parts = [mapped] if all(label in m for _, m in mapped) and not named else [[f] for f in mapped]
    return [_raw(part, str(path) if len(part) > 1 else part[0][0].name, context) for part in parts]


def _raw(
    mapped: Sequence[tuple[ParquetTable, Mappings]], name: str, context: MappingContext
) -> RawTable:
    """Join files, each with its mappings, into one raw table."""
    table, problems, row, parts = context.table, context.problems, 1, []
    first: dict[str, Wanted] = {}
    for part, mappings in mapped:
        wanted = _wanted(part, mappings, first, context)
        for rows in parquet_blocks(part, wanted, table, row):
            row += len(rows)
            problems.take(rows.problems)
            columns = rows.columns()
            convert(columns, mappings)
            parts.append(columns)
    if row == 1:
        raise InputError(f"{name}: holds no samples")
    columns, mappings = together(parts, table), mapped[0][1]
    clock = first["time_s"].clock if "time_s" in first else None
    if clock is not None:
        runs = Texts.of(columns[table.label]).codes if table.label in columns else None
        columns["time_s"] = clock.elapsed(
            columns["time_s"], lambda i: (f"{name}, row {i + 1}", i + 1), problems, runs
        )
    names = [c.name for c in candidates_of(mapped[0][0], context)]
    notes = (*notes_of(mappings, table, names), *([] if clock is None else clock.notes()))
    stated = {
        role: replace(m, unit_stated=all(role in o and o[role].unit_stated for _, o in mapped))
        for role, m in mappings.items()
    }
    inside = mapped[0][0].inside
    return RawTable(
        name,
        (inside.name, inside.stem),
        inside.stem,
        {role: values for role, values in columns.items() if any(role in m for _, m in mapped)},
        stated,
        notes=notes,
        name_place=name,
        row_word="row",
    )


def _wanted(
    part: ParquetTable, mappings: Mappings, first: dict[str, Wanted], context: MappingContext
) -> dict[str, Wanted]:
    """Decide how to read the columns of a file; the clock of the first file reads all times."""
    wanted = wanted_of(mappings, context)
    if not first:
        first.update(wanted)
    time, first_time = wanted.get("time_s"), first.get("time_s")
    if time is None or first_time is None or (time.clock is None and first_time.clock is None):
        return wanted
    if time.clock is None or first_time.clock is None:
        differs = (
            "no clock times, but the first file does"
            if time.clock is None
            else "clock times, but the first file does not"
        )
        raise InputError(f"{part.name}: column {time.index} holds {differs}")
    if first_time.date is not None and time.date is None:
        raise InputError(
            f"{part.name}: date column {first_time.date} is missing, but the first file has it"
        )
    return wanted | {"time_s": replace(time, clock=first_time.clock)}


def stream_parquet(
    sources: Sequence[Source], context: MappingContext
) -> tuple[Mappings, Clock | None, Iterator[Rows]]:
    """Return the column mappings of the first file, the clock reader, and the rows of all files.

    Raises
    ------
    InputError
        If columns of the first file are missing; for other files when their rows are read.
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
            part_mappings = mappings if part is head else map_columns(part, context)
            context.problems.raise_if_any()
            for role, mapping in part_mappings.items():
                if mapping.conversion != getattr(mappings.get(role), "conversion", Conversion(1.0)):
                    text = (
                        f"{part.name}: {mapping.shown} has a different unit than in the first file"
                    )
                    raise InputError(text)
            wanted = _wanted(part, part_mappings, first, context)
            for rows in parquet_blocks(part, wanted, context.table, row):
                yield rows
                row += len(rows)

    return mappings, first["time_s"].clock, blocks()
