"""Which channel of a file is which of our columns: stated or recognised."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

from beltid.bench.channels.channel_units import RAW, unit_conversion
from beltid.bench.channels.readings import Candidate, How, Question, Reading
from beltid.bench.channels.vocabulary import roles_meant
from beltid.bench.formats.bench_file import Field
from beltid.bench.formats.dialect import ReadOptions
from beltid.bench.formats.table_head import unit_in_name, without_unit
from beltid.config.name_pattern import name_pattern
from beltid.tables.columns import Column, Table
from beltid.tables.units import Conversion, canonical_unit, conversion

SETTINGS: Final = ("arc_deg", "initial_tension_N", "temperature_degC")
"""Columns that may be told once for a whole run."""


def readings_of(
    candidates: Sequence[Candidate], question: Question, roles: Collection[str] | None = None
) -> dict[str, Reading]:
    """Find the channel of every column of a table.

    Parameters
    ----------
    candidates : sequence of Candidate
        Channels of the file.
    question : Question
        What is needed and what the config states.
    roles : collection of str, optional
        Only these of our columns.

    Returns
    -------
    dict
        Our columns that were found; those that are missing are left to the caller.
    """
    options = question.options
    columns = [c for c in question.table.columns if roles is None or c.name in roles]
    found: dict[str, tuple[Candidate, How, bool]] = {}
    for column in columns:
        chosen = _named(column.name, candidates, question)
        if chosen is not None:
            found[column.name] = chosen
    taken = {id(candidate) for candidate, _, _ in found.values()}
    free = [c for c in candidates if c.name and id(c) not in taken]
    for column in columns:
        if column.name in found or column.name in options.names:
            continue
        meant = [c for c in free if column.name in roles_meant(c.name, question.kind)]
        fitting = [c for c in meant if _fits(c, column, options)] or meant
        if len(fitting) == 1:
            found[column.name] = (fitting[0], "recognised", False)
        elif fitting:
            question.complain(_ambiguous(column, fitting, question.kind))
    return {
        column.name: _reading(column, *found[column.name], question)
        for column in columns
        if column.name in found
    }


def notes_of(readings: Mapping[str, Reading], table: Table) -> list[str]:
    """What was recognised or converted, in words."""
    notes = []
    for role, reading in readings.items():
        if reading.how == "recognised":
            notes.append(f"read {reading.candidate.shown} as {role}")
        elif reading.unit_stated and reading.conversion != Conversion(1.0):
            unit = table.column(role).unit
            theirs = reading.candidate.unit or "the unit stated"
            notes.append(f"{reading.shown} converted from {theirs} to {unit}")
    return notes


def _named(
    role: str, candidates: Sequence[Candidate], question: Question
) -> tuple[Candidate, How, bool] | None:
    """The channel that the config names, or that is called like our column."""
    options = question.options
    theirs = options.names.get(role, role)
    how: How = "config" if role in options.names else "own name"
    named, negated = _called(theirs, candidates, loosely=how == "config"), False
    if not named and how == "config" and theirs.startswith("-"):
        named, negated = _called(theirs[1:].strip(), candidates, loosely=True), True
    if len(named) > 1:
        groups = ", ".join(c.group for c in named if c.group)
        where = f" (in {groups}; name one as group/channel)" if groups else ""
        question.complain(f"column {theirs} stands {len(named)} times{where}")
    return (named[0], how, negated) if named else None


def _called(name: str, candidates: Sequence[Candidate], *, loosely: bool) -> list[Candidate]:
    exact = [c for c in candidates if name in (c.name, c.qualified)]
    if exact or not loosely:
        return exact
    return [c for c in candidates if without_unit(c.name) == name]


def _fits(candidate: Candidate, column: Column, options: ReadOptions) -> bool:
    """Whether the unit of a channel, where it is told, can be that of a column."""
    unit = candidate.unit or unit_in_name(candidate.name)
    known = canonical_unit(unit)
    if not unit or column.dtype == "string" or column.name in options.units:
        return True
    return known in RAW or conversion(unit, column.unit) is not None


def _ambiguous(column: Column, meant: Sequence[Candidate], kind: str) -> str:
    first = meant[0]
    groups = {c.group for c in meant}
    name = first.qualified if len(groups) > 1 else first.name
    shown = ", ".join(c.qualified if len(groups) > 1 else c.shown for c in meant[:8])
    return (
        f'{shown} can be {column.name}, say which: columns: {{{kind}: {{{column.name}: "{name}"}}}}'
    )


def _reading(
    column: Column, candidate: Candidate, how: How, negated: bool, question: Question
) -> Reading:
    if column.dtype == "string":
        return Reading(column.name, candidate, how)
    unit = candidate.unit or unit_in_name(candidate.name)
    converted = unit_conversion(column, candidate.name, unit, question, how == "recognised")
    if isinstance(converted, str):
        question.complain(converted)
        converted = None
    known = converted or Conversion(1.0)
    sign = -1.0 if negated else 1.0
    return Reading(
        column.name,
        candidate,
        how,
        Conversion(sign * known.factor, known.shift),
        converted is not None,
        negated,
    )


def told_elsewhere(
    runs: Any, names: Sequence[str], fields: Sequence[Field], table: Table
) -> set[str]:
    """Columns that need not stand in the file: label and settings that are told elsewhere."""
    roles = {table.label}
    if runs is None:
        return roles | _told_by(fields, table)
    roles |= {role for role in SETTINGS if getattr(runs.values, role, None) is not None}
    roles |= {role for role in SETTINGS if getattr(runs.fields, role, None) is not None}
    if runs.pattern:
        roles |= set(name_pattern(runs.pattern).names)
    if runs.table is not None:
        roles |= set(SETTINGS)
    return roles | _told_by(fields, table)


def _told_by(fields: Sequence[Field], table: Table) -> set[str]:
    return {role for f in fields for role in roles_meant(f.name, table.kind) if role in SETTINGS}
