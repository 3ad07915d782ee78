"""Map the channels of a file to our columns and find the conversion to the unit of the column.

A channel is found by the name that the config states, by our own name, or by the words of
`vocabulary`. Its unit is stated in the config or in the file.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal

import numpy as np

from beltid.bench.channels.vocabulary import means_date, roles_meant, simplified
from beltid.bench.formats.bench_file import Field
from beltid.bench.formats.dialect import IN_NAME, unit_in_name, without_position, without_unit
from beltid.bench.read_options import ReadOptions
from beltid.config.name_pattern import name_pattern
from beltid.errors import Problems
from beltid.tables.columns import Column, Table
from beltid.tables.schemas import RECORDINGS, SETTINGS
from beltid.tables.schemas import table as table_of
from beltid.tables.units import (
    CONVERSIONS,
    Calibration,
    Conversion,
    allowed_units,
    calibration,
    canonical_unit,
    conversion,
)

How = Literal["config", "own name", "recognised"]
RAW: Final = ("V", "mV", "mV/V", "A", "mA")
"""Units of raw signals, which need a calibration."""
_TURNS: Final = ("drehzahl", "rpm", "rev", "tour")
_IN_RPM: Final = re.compile(
    r"drehzahl|(?<!\d)(?<!\d )rpm|\b(?:upm|(?:u|1|r|tr|rev|tours)/min|min(?:\^?-|⁻)[1¹])(?!\w)",
    re.IGNORECASE,
)
"""Names of speeds in turns per minute."""


def _in_other_units(column: Column) -> dict[str, tuple[str, str]]:
    """Return names of a column with the ending of another unit -> our name and that unit."""
    ending = _ending(column.unit)
    stem = column.name.removesuffix(ending)
    if stem == column.name:
        return {}
    units = CONVERSIONS.get(column.unit, {})
    return {stem + _ending(u): (column.name, u) for u in units if u != column.unit}


def _ending(unit: str) -> str:
    return "_" + re.sub(r"[ /]", "_", unit)


OTHER_UNITS: Final = {
    name: column_and_unit
    for kind in RECORDINGS
    for column in table_of(kind).columns
    if column.dtype == "float64"
    for name, column_and_unit in _in_other_units(column).items()
}
"""Names such as ``force_kN`` -> the column ``force_N``, and ``kN``."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A channel that may be one of our columns.

    Attributes
    ----------
    name, unit : str
        As the file writes them.
    key : object
        Key by which the reader finds it.
    group : str
        Its group, "" if the file has no groups.
    written : {"", "clock", "date"}
        "clock" or "date" if its cells are clock times or dates, not numbers or other texts.
    scaling : str
        Scaling stated in the file that was not applied.
    sample : str
        Its first cell, if that is no number.
    """

    name: str
    unit: str
    key: Any
    group: str = ""
    written: str = ""
    scaling: str = ""
    sample: str = ""

    @property
    def shown(self) -> str:
        """Name and unit, for messages."""
        unit = self.unit.strip("[](){}<> ")
        return f"{self.name} [{unit}]" if unit and not unit_in_name(self.name) else self.name

    @property
    def base(self) -> str:
        """Name without the position among channels of the same name."""
        return without_position(self.name)

    @property
    def qualified(self) -> str:
        """Name with its group: ``group/name``."""
        return f"{self.group}/{self.name}"


@dataclass(frozen=True, slots=True)
class ChannelMapping:
    """Mapping of a channel to one of our columns.

    Attributes
    ----------
    role : str
        Our column.
    candidate : Candidate
        The channel.
    how : {"config", "own name", "recognised"}
        How the channel was identified.
    conversion : Conversion
        Conversion of the numbers in the file, including the sign.
    unit_stated : bool
        Whether file or config states the unit.
    negated : bool
        Whether the sign is reversed.
    date : Candidate or None
        Channel with the dates that belong to the clock times of this one.
    """

    role: str
    candidate: Candidate
    how: How
    conversion: Conversion = field(default_factory=lambda: Conversion(1.0))
    unit_stated: bool = False
    negated: bool = False
    date: Candidate | None = None

    @property
    def is_clock(self) -> bool:
        """Whether the channel holds clock times, not numbers or other texts."""
        return self.role == "time_s" and self.candidate.written == "clock"

    @property
    def shown(self) -> str:
        """Name of the column in messages."""
        name = self.candidate.name
        return self.role if name == self.role else f'{self.role} (column "{name}")'


@dataclass(frozen=True, slots=True)
class MappingContext:
    """Requirements for the channels of a file.

    Attributes
    ----------
    table : Table
        Columns needed.
    options : ReadOptions
        Options stated in the config.
    place : str
        Place of the channel names, for messages.
    problems : Problems
        Collects what is ambiguous or wrong.
    """

    table: Table
    options: ReadOptions
    place: str = ""
    problems: Problems = field(default_factory=Problems)

    @property
    def kind(self) -> str:
        """Kind of recording."""
        return self.table.kind

    def complain(self, text: str) -> None:
        """Report a problem at the place of the channel names."""
        self.problems.add(f"{self.place}: {text}")


def map_channels(
    candidates: Sequence[Candidate], context: MappingContext, roles: Collection[str] | None = None
) -> dict[str, ChannelMapping]:
    """Find the channel of every column of a table.

    Parameters
    ----------
    candidates : sequence of Candidate
        Channels of the file.
    context : MappingContext
        Columns needed and options of the config.
    roles : collection of str, optional
        Search for these of our columns only.

    Returns
    -------
    dict
        Our columns that were found; the caller deals with missing ones.
    """
    matches_by_role = channels_meant(candidates, context, roles)
    for role, matches in matches_by_role.items():
        if len(matches) > 1:
            channels = [candidate for candidate, _, _ in matches]
            context.complain(_ambiguous(context.table.column(role), channels, context.kind))
    mappings = {
        role: _mapping(context.table.column(role), *matches[0], context)
        for role, matches in matches_by_role.items()
        if len(matches) == 1
    }
    time = mappings.get("time_s")
    if time is not None and time.is_clock:
        taken = {
            id(candidate) for matches in matches_by_role.values() for candidate, _, _ in matches
        }
        free = [c for c in candidates if c.name and id(c) not in taken]
        mappings["time_s"] = replace(time, date=_date_of(time.candidate, free, context))
    return mappings


def channels_meant(
    candidates: Sequence[Candidate],
    context: MappingContext,
    roles: Collection[str] | None = None,
    *,
    numbered: bool = True,
) -> dict[str, list[tuple[Candidate, How, bool]]]:
    """Return our columns -> channels that fit, how they were identified, and if the sign reverses.

    Several channels for one column are ambiguous. With `numbered`, channels whose names differ by
    a number only count as well. See `map_channels`.
    """
    columns = [c for c in context.table.columns if roles is None or c.name in roles]
    matches = {c.name: named for c in columns if (named := _named(c.name, candidates, context))}
    taken = {id(candidate) for named in matches.values() for candidate, _, _ in named[:1]}
    free = [c for c in candidates if c.name and id(c) not in taken]
    for column in columns:
        if column.name in matches or column.name in context.options.names:
            continue
        meant = [c for c in free if column.name in roles_meant(c.name, context.kind)]
        any_unit = column.dtype == "string" or column.name in context.options.units
        fitting = [c for c in meant if any_unit or can_be(c, column)] or meant
        if column.name == "time_s":  # prefer elapsed time to time of day
            fitting = [c for c in fitting if unit_of(c) and not c.written] or fitting
        if numbered and len(fitting) == 1 and column.name in sensors_of(context.table):
            fitting = [*fitting, *_numbered_alike(fitting[0], free, column, context.kind)]
        if fitting:
            matches[column.name] = [(c, "recognised", False) for c in fitting]
    return {column.name: matches[column.name] for column in columns if column.name in matches}


def _numbered_alike(
    channel: Candidate, others: Sequence[Candidate], column: Column, kind: str
) -> list[Candidate]:
    """Return unrecognised channels whose names differ by a number only, as Force 2 and Force."""

    def bare(candidate: Candidate) -> str:
        return simplified(without_unit(candidate.base)).rstrip("0123456789 ")

    return [
        c
        for c in others
        if c is not channel
        and bare(c) == bare(channel)
        and can_be(c, column)
        and not roles_meant(c.name, kind)
    ]


def sensors_of(table: Table) -> list[str]:
    """Return our columns that sensors record and that a run must have."""
    return [
        c.name
        for c in table.columns
        if c.required and c.dtype != "string" and c.name not in (*SETTINGS, "time_s")
    ]


def is_whole(candidates: Sequence[Candidate], context: MappingContext) -> bool:
    """Return whether the channels include all sensors that a run needs."""
    meant = channels_meant(candidates, context, numbered=False)
    return all(len(meant.get(role, ())) == 1 for role in sensors_of(context.table))


def are_recordings(
    parts: Sequence[Sequence[Candidate]], candidates: Sequence[Candidate], context: MappingContext
) -> bool:
    """Return whether channels side by side in a table are recordings of their own.

    They are not if the channels whose names occur once make a recording without the repeated ones.
    """
    once = [c for c in candidates if c.name == c.base]
    return all(is_whole(part, context) for part in parts) and not is_whole(once, context)


def unit_of(candidate: Candidate) -> str:
    """Return the unit of a channel as written in the file, in a unit cell or in the name."""
    if canonical_unit(candidate.unit) not in ("", "-", "1"):
        return candidate.unit
    in_rpm = "rpm" if _is_in_rpm_by_name(candidate) else ""
    return _unit_in_name(candidate) or in_rpm or candidate.unit


def _unit_in_name(candidate: Candidate) -> str:
    return unit_in_name(candidate.name) or OTHER_UNITS.get(candidate.base, ("", ""))[1]


def _is_in_rpm_by_name(candidate: Candidate) -> bool:
    """Return whether the name alone says that a channel without a unit is in turns per minute."""
    unitless = canonical_unit(candidate.unit) in ("", "-", "1") and not _unit_in_name(candidate)
    return unitless and bool(_IN_RPM.search(candidate.name))


def _date_of(
    time: Candidate, candidates: Sequence[Candidate], context: MappingContext
) -> Candidate | None:
    """Find the date channel that belongs to a channel of clock times."""
    dates = [
        c
        for c in candidates
        if c.written == "date" and c.group == time.group and means_date(c.name)
    ]
    if len(dates) > 1:
        shown = ", ".join(c.name for c in dates)
        context.complain(f"{shown} can be the date of {time.name}: keep only one of them")
    return dates[0] if dates else None


def notes_of(
    mappings: Mapping[str, ChannelMapping], table: Table, names: Sequence[str]
) -> list[str]:
    """Return notes on the channels that were recognised, converted and left out."""
    notes = []
    for role, mapping in mappings.items():
        if mapping.how == "recognised":
            by_name = " in rpm, by its name," if _is_in_rpm_by_name(mapping.candidate) else ""
            notes.append(f"read {mapping.candidate.shown}{by_name} as {role}")
        elif mapping.unit_stated and mapping.conversion != Conversion(1.0):
            unit = table.column(role).unit
            unit_in_file = unit_of(mapping.candidate) or "the unit stated"
            notes.append(f"{mapping.shown} converted from {unit_in_file} to {unit}")
    used_names = {c.name for m in mappings.values() for c in (m.candidate, m.date) if c is not None}
    left_out = [name for name in dict.fromkeys(names) if name and name not in used_names]
    if left_out:
        notes.append("columns left out: " + ", ".join(left_out[:12]))
    return notes


def _named(
    role: str, candidates: Sequence[Candidate], context: MappingContext
) -> list[tuple[Candidate, How, bool]]:
    """Find the channels that the config names for a column, or that have our name."""
    name_in_file = context.options.names.get(role, role)
    how: How = "config" if role in context.options.names else "own name"
    named, negated = _called(name_in_file, candidates), False
    if not named and name_in_file.startswith("-"):
        named, negated = _called(name_in_file[1:].strip(), candidates), True
    return [(candidate, how, negated) for candidate in named]


def _called(name: str, candidates: Sequence[Candidate]) -> list[Candidate]:
    matches = [c for c in candidates if name in (c.name, c.qualified)]
    matches = matches or [c for c in candidates if c.base == name]
    matches = matches or [
        c for c in candidates if name in (without_unit(c.name), without_unit(c.base))
    ]
    return matches or [c for c in candidates if OTHER_UNITS.get(c.base, ("",))[0] == name]


def can_be(candidate: Candidate, column: Column) -> bool:
    """Return whether the unit of a channel, if stated, allows it to be a column of numbers."""
    if candidate.written:
        return candidate.written == "clock" and column.name == "time_s"
    unit = unit_of(candidate)
    is_raw = canonical_unit(unit) in RAW and column.name not in (*SETTINGS, "time_s")
    return not unit or is_raw or conversion(unit, column.unit) is not None


def _ambiguous(column: Column, candidates: Sequence[Candidate], kind: str) -> str:
    """Return the message that several channels can be a column."""
    first = candidates[0]
    groups = {c.group for c in candidates}
    name = first.qualified if len(groups) > 1 else first.name
    shown = ", ".join(c.qualified if len(groups) > 1 else c.shown for c in candidates[:8])
    message = (
        f'{shown} can be {column.name}, say which: columns: {{{kind}: {{{column.name}: "{name}"}}}}'
    )
    if column.name == "force_N":  # two forces and a travel are not always those of a press
        message += (
            f'; if it is a friction rig: columns: {{rig: {{tension_tight_N: "{name}", '
            f'tension_slack_N: "{candidates[1].name}"}}}}'
        )
    return message


def _mapping(
    column: Column, candidate: Candidate, how: How, negated: bool, context: MappingContext
) -> ChannelMapping:
    mapping = ChannelMapping(column.name, candidate, how)
    if column.dtype == "string":
        return mapping
    if mapping.is_clock:
        return replace(mapping, unit_stated=True)
    unit = unit_of(candidate)
    if how == "recognised" and candidate.sample and not unit:
        number = "a clock time such as 13:45:02.125" if column.name == "time_s" else "a number"
        context.complain(
            f'{candidate.name}, read as {column.name}, holds "{candidate.sample}", must be {number}'
        )
        return mapping
    unclear = _unclear(column, mapping, context)
    converted = unclear or unit_conversion(
        column, candidate.name, unit, context, how == "recognised"
    )
    if isinstance(converted, str):
        context.complain(converted)
        converted = None
    applied = converted or Conversion(1.0)
    sign = -1.0 if negated else 1.0
    return ChannelMapping(
        column.name,
        candidate,
        how,
        Conversion(sign * applied.factor, applied.shift),
        converted is not None,
        negated,
    )


def _unclear(column: Column, mapping: ChannelMapping, context: MappingContext) -> str:
    """Return why the unit of a channel is unclear; "" if it is clear or the config states it.

    Either name and unit cell contradict each other, or the config calls turns per minute radians,
    or the file states a scaling for whole numbers that may be counts.
    """
    candidate, shown = mapping.candidate, mapping.shown
    line = f"units: {{{context.kind}: {{{column.name}: "
    stated = context.options.units.get(column.name)
    in_radians = isinstance(stated, str) and canonical_unit(stated) == "rad/s"
    if in_radians and _is_in_rpm_by_name(candidate):
        return (
            f"{shown} is in rpm by its name, not in rad/s: state {line}rpm}}}}, or "
            f"{line}{{factor: 1, offset: 0}}}}}} if its numbers are in rad/s in spite of its name"
        )
    if stated is not None:
        return ""
    in_name = _unit_in_name(candidate)
    units = [unit for unit in (in_name, candidate.unit) if conversion(unit, column.unit)]
    if len({conversion(unit, column.unit) for unit in units}) > 1:
        name, cell = map(canonical_unit, units)
        return (
            f"{shown} is in {name} by its name and in {cell} by its unit: "
            f"say which, {line}{name}}}}} or {line}{cell}}}}}"
        )
    if candidate.scaling:
        return (
            f"{shown} holds whole numbers, but the file states {candidate.scaling}, which was not "
            f"applied: state {line}{{factor: ..., offset: ...}}}}}} if they are counts, or "
            f"{line}{column.unit}}}}} if they are not"
        )
    return ""


def stated_elsewhere(runs: Mapping[str, Any], fields: Sequence[Field], table: Table) -> set[str]:
    """Return columns that a file need not contain: label and settings stated elsewhere."""
    roles = {table.label, *runs["values"]} | {*runs["fields"]} & {*SETTINGS}
    if runs["pattern"]:
        roles |= set(name_pattern(runs["pattern"]).names)
    if runs["table"]:
        roles |= set(SETTINGS)
    return roles | _stated_in_fields(fields, table)


def _stated_in_fields(fields: Sequence[Field], table: Table) -> set[str]:
    return {role for f in fields for role in roles_meant(f.name, table.kind) if role in SETTINGS}


def unit_conversion(
    column: Column, name: str, unit: str, context: MappingContext, recognised: bool
) -> Conversion | str | None:
    """Find the conversion of a channel's numbers to a column's unit.

    Parameters
    ----------
    column : Column
        Our column.
    name, unit : str
        As the file writes them.
    context : MappingContext
        Options of the config; no problems are added to it.
    recognised : bool
        Whether the channel was recognised by its name alone; its unit must then be stated.

    Returns
    -------
    Conversion, str or None
        A str is an error message; None: no unit is stated, the unit of the column is assumed.
    """
    shown = column.name if name == column.name else f'{column.name} (column "{name}")'
    setting, kind = context.options.units.get(column.name), context.kind
    calibrated = setting if isinstance(setting, Calibration) else None
    if isinstance(setting, str):
        calibrated = calibration(setting, column.unit)
    if calibrated is not None:
        converted = calibrated.conversion(unit)
        return converted or (
            f"{shown} is in {unit}, but the calibration of the config is for {calibrated.per}"
        )
    if isinstance(setting, str):
        return conversion(setting, column.unit)
    plain = canonical_unit(unit)
    line = f"units: {{{kind}: {{{column.name}: "
    if plain in ("", "-"):
        if not recognised:
            base, _, ending = name.rpartition("_")
            other = conversion(ending, column.unit) if base and name != column.name else None
            if other in (None, Conversion(1.0)):
                return None
            return f"{shown}: is it in {ending}? say {line}{ending}}}}} or {line}{column.unit}}}}}"
        bracket = IN_NAME.search(name)
        what = f'is "{bracket[1]}", which is not known' if bracket else "is missing"
        or_rpm = f" or {line}rpm}}}}" if column.unit == "rad/s" else ""
        return (
            f"the unit of {name}, read as {column.name}, {what}; "
            f"state it: {line}{column.unit}}}}}{or_rpm}"
        )
    if plain in RAW:
        return (
            f"{shown} is in {unit}, its calibration is missing; state it: "
            f"{line}250 {column.unit}/{'mV' if plain == 'mV' else 'V'}}}}}, "
            f"or {{factor: 250, offset: 0}}"
        )
    if column.unit == "rad/s" and plain == "rev/s" and _unclear_turns(unit, name):
        return f"{shown} is in {unit}: turns or radians? say {line}rev/s}}}} or {line}rad/s}}}}"
    if column.unit == "rad/s" and plain in ("m/s", "mm/s"):
        return (
            f"{shown} is in {unit}; divide by the radius R of the pulley: "
            f"{line}{{factor: 1/R, offset: 0}}}}}}, 1/R as a number in 1/m"
        )
    converted = conversion(unit, column.unit)
    if converted is None and plain == "1":
        return None
    return converted or f"{shown} is in {unit}, must be one of " + ", ".join(
        allowed_units(column.unit)
    )


def _unclear_turns(unit: str, name: str) -> bool:
    """Return whether 1/s may mean turns as well as radians."""
    per_second = unit.strip(" []()").replace(" ", "") in ("1/s", "s-1", "s^-1", "s⁻¹")
    return per_second and not any(word in simplified(name) for word in _TURNS)


@dataclass(frozen=True, slots=True)
class RawTable:
    """Columns read from one file or group.

    Attributes
    ----------
    place : str
        File, and group in it, for messages.
    names : tuple of str
        Names that patterns and tables of runs may use for it, the most specific first.
    label : str
        Default label of its run.
    columns : dict of str to ndarray
        Our columns that were found, in our units.
    mappings : mapping
        How they were read.
    fields : tuple of Field
        Header fields of the file and the group.
    rows : ndarray
        Line or row of every sample in the file, from 1; empty if the file has none.
    notes : tuple of str
        Notes for the user.
    name_place : str
        Place of the channel names, for messages.
    row_word : str
        Word for a sample in messages if the file has no lines.
    """

    place: str
    names: tuple[str, ...]
    label: str
    columns: dict[str, np.ndarray]
    mappings: Mapping[str, ChannelMapping]
    fields: tuple[Field, ...] = ()
    rows: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    notes: tuple[str, ...] = ()
    name_place: str = ""
    row_word: str = "sample"

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def place_of(self, index: int) -> tuple[str, int]:
        """Return the place of a sample for messages, and its line to sort them."""
        if self.rows.size:
            return f"{self.place}:{self.rows[index]}", int(self.rows[index])
        return f"{self.place}, {self.row_word} {index + 1}", index + 1


def missing_setting(setting: str, kind: str, place: str) -> str:
    """Return the problem that a setting is stated nowhere, with the ways to state it."""
    return f"{place}: column {setting} is missing{how_to_state(setting, kind)}"


def how_to_state(setting: str, kind: str) -> str:
    """Return advice on how to state a setting that no column holds."""
    return (
        f"; if it is the same for every run: runs: {{{kind}: {{values: {{{setting}: ...}}}}}}; if "
        f"the file names contain it: runs: {{{kind}: {{pattern: "
        f'"{{run}}_{{{setting}}}.csv"}}}}; or in a table of the files: runs: {{{kind}: '
        "{table: runs.csv}}"
    )
