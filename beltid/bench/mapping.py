"""Written channels -> our columns: by the config, by our own name, by the vocabulary.

A unit is stated in the config or in the file. What is ambiguous is asked, never guessed.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import pandas as pd

from beltid.bench.clock import written_as
from beltid.bench.header import IN_NAME, read_field, unit_in_name, without_position, without_unit
from beltid.bench.numbers import NumberSigns, is_number
from beltid.bench.options import ReadOptions
from beltid.bench.raw import Field, Raw, first_texts
from beltid.bench.vocabulary import means_date, roles_meant, simplified
from beltid.errors import Problems
from beltid.tables import schemas
from beltid.tables.columns import Column, Table
from beltid.tables.units import (
    CONVERSIONS,
    Calibration,
    Conversion,
    allowed_units,
    calibration,
    canonical_unit,
    conversion,
)

RAW: Final = ("V", "mV", "mV/V", "A", "mA")
"""Units of raw signals, which need a calibration."""
NO_UNIT: Final = ("", "-", "1")
FORCES: Final[tuple[str, ...]] = (
    *("tension_tight_N", "tension_slack_N", "weight_N", "torque_N_m", "hub_force_N"),
)
"""Channels of a friction rig; any two of them give the forces of both spans."""
_IN_RPM: Final = re.compile(
    r"drehzahl|(?<!\d)(?<!\d )rpm|\b(?:upm|(?:u|1|r|tr|rev|tours)/min|min(?:\^?-|⁻)[1¹])(?!\w)",
    re.IGNORECASE,
)
"""Names of speeds in turns per minute."""
_TURNS: Final = ("drehzahl", "rpm", "rev", "tour")


def _ending(unit: str) -> str:
    return "_" + re.sub(r"[ /]", "_", unit)


OTHER_UNITS: Final = {
    column.name.removesuffix(_ending(column.unit)) + _ending(unit): (column.name, unit)
    for kind in schemas.RECORDINGS
    for column in schemas.table(kind).columns
    if column.name.endswith(_ending(column.unit))
    for unit in CONVERSIONS.get(column.unit, {})
    if unit != column.unit
}
"""Names such as ``force_kN`` -> the column ``force_N``, and ``kN``."""


@dataclass(frozen=True, eq=False)
class Channel:
    """A column of a table as written; `group` is the table's name if the file has several."""

    raw: Raw
    name: str
    group: str = ""
    word: str = "column"

    @cached_property
    def cells(self) -> list[str]:
        """First texts of the column; none if it holds numbers."""
        return first_texts(self.raw.frame[self.name])

    @cached_property
    def written(self) -> str:
        """How its cells are written: "clock", "date" or "" for anything else."""
        return written_as(self.cells)

    @property
    def unit_cell(self) -> str:
        """Unit that the file states besides the name."""
        return self.raw.units.get(self.name, "")

    @property
    def base(self) -> str:
        """Name without the position among channels of the same name."""
        return without_position(self.name)

    @property
    def qualified(self) -> str:
        """Name with its group: ``group/name``."""
        return f"{self.group}/{self.name}"

    @property
    def shown(self) -> str:
        """Name and unit, for messages."""
        unit = self.unit_cell.strip("[](){}<> ")
        return f"{self.name} [{unit}]" if unit and not unit_in_name(self.name) else self.name

    @property
    def unit_of_name(self) -> str:
        """Unit at the end of the name."""
        return unit_in_name(self.name) or OTHER_UNITS.get(self.base, ("", ""))[1]

    @property
    def is_in_rpm_by_name(self) -> bool:
        """Whether the name alone says that a channel without a unit is in turns per minute."""
        unitless = canonical_unit(self.unit_cell) in NO_UNIT and not self.unit_of_name
        return unitless and bool(_IN_RPM.search(self.name))

    @property
    def unit(self) -> str:
        """Unit as written in the file, in a cell or in the name; "" if there is none."""
        if canonical_unit(self.unit_cell) not in NO_UNIT:
            return self.unit_cell
        unknown = IN_NAME.search(self.name)
        by_name = self.unit_of_name or ("rpm" if self.is_in_rpm_by_name else self.unit_cell)
        return by_name or (unknown[1].strip() if unknown else "")


@dataclass(frozen=True, slots=True)
class Found:
    """A channel that is one of our columns."""

    role: str  # our column
    channel: Channel
    how: str  # "config", "own name" or "recognised"
    by: Conversion = field(default_factory=lambda: Conversion(1.0))  # with the sign
    stated: bool = False  # whether file or config states the unit
    negated: bool = False  # whether the config reverses the sign
    date: Channel | None = None  # with the dates of its clock times

    @property
    def is_clock(self) -> bool:
        """Whether the channel holds clock times."""
        return self.role == "time_s" and self.channel.written == "clock"

    @property
    def shown(self) -> str:
        """Name of the column in messages."""
        name = self.channel.name
        return self.role if name == self.role else f'{self.role} ({self.channel.word} "{name}")'


@dataclass(frozen=True, slots=True)
class Needs:
    """What is wanted from a file: the table to fill, what the config states, the problems."""

    table: Table
    options: ReadOptions
    problems: Problems = field(default_factory=Problems)

    def line(self, section: str, role: str) -> str:
        """Return the beginning of a line for the config."""
        kind = "rig" if self.table.kind == "points" else self.table.kind
        return f"{section}: {{{kind}: {{{role}: "


def channels_of(raws: Sequence[Raw]) -> list[Channel]:
    """Return the channels of the tables of a file."""
    several = len(raws) > 1
    group = {id(raw): raw.name if several else "" for raw in raws}
    return [Channel(r, str(name), group[id(r)]) for r in raws for name in r.frame if name]


def channels_of_head(fields: Sequence[Field], dialect: Mapping[str, object]) -> list[Channel]:
    """Return the fields of a header as channels: a field is a column of one row."""
    plain = [read_field(f.name, f.text, f.unit) for f in dict.fromkeys(fields)]
    stated = dialect["decimal"], dialect["thousands"]
    channels = []
    for entry in plain:
        signs = NumberSigns.of([entry.text], *stated)  # type: ignore[arg-type]
        if isinstance(signs.number(entry.text), str):  # others may show the decimal sign
            signs = NumberSigns.of([f.text for f in plain], *stated)  # type: ignore[arg-type]
        frame = pd.DataFrame({entry.name: pd.array([entry.text], dtype="str")})
        units = {entry.name: entry.unit} if entry.unit else {}
        channels.append(
            Channel(Raw("", frame, units=units, signs=signs), entry.name, "", "header field")
        )
    return channels


def sensors_of(table: Table) -> list[str]:
    """Return our columns that sensors record and that a run must have."""
    return [
        c.name
        for c in table.columns
        if c.required and c.dtype != "string" and c.name not in (*schemas.SETTINGS, "time_s")
    ]


def lacking(table: Table, has: Collection[str]) -> list[str]:
    """Return the sensors that a run lacks; a friction rig needs two of its forces."""
    missing: list[str] = [name for name in sensors_of(table) if name not in has]
    if table.kind == "rig" and not missing and len({*FORCES} & {*has}) < 2:
        missing = [name for name in FORCES if name in table.names and name not in has][:1]
    return missing


def meant(
    channels: Sequence[Channel],
    needs: Needs,
    roles: Collection[str] | None = None,
    *,
    numbered: bool = False,
) -> dict[str, list[Found]]:
    """Return our columns -> channels that fit; several for one column are ambiguous.

    With `numbered`, channels whose names differ by a number only count as well.
    """
    table, options = needs.table, needs.options
    columns = [c for c in table.columns if roles is None or c.name in roles]
    found = {c.name: named for c in columns if (named := _named(c.name, channels, options))}
    taken = {id(named[0].channel) for named in found.values()}
    free = [c for c in channels if id(c) not in taken]
    words = {id(c): roles_meant(c.name, table.kind) for c in free}
    for column in columns:
        if column.name in found or column.name in options.names:
            continue
        fit = [c for c in free if column.name in words[id(c)]]
        if column.dtype != "string" and column.name not in options.units:
            fit = [c for c in fit if can_be(c, column)] or fit
        if column.name == "time_s":  # prefer elapsed time to time of day
            fit = [c for c in fit if c.unit and not c.written] or fit
        if numbered and len(fit) == 1 and column.name in sensors_of(table):
            bare = _without_number(fit[0])
            others = (c for c in free if not words[id(c)] and can_be(c, column))
            fit += [c for c in others if _without_number(c) == bare]
        if fit:
            found[column.name] = [Found(column.name, c, "recognised") for c in fit]
    return {column.name: found[column.name] for column in columns if column.name in found}


def _without_number(channel: Channel) -> str:
    return simplified(without_unit(channel.base)).rstrip("0123456789 ")


def _named(role: str, channels: Sequence[Channel], options: ReadOptions) -> list[Found]:
    """Find the channels that the config names for a column, or that have our name."""
    name, how = options.names.get(role, role), "config" if role in options.names else "own name"
    named, negated = _called(name, channels), False
    if not named and name.startswith("-"):
        named, negated = _called(name[1:].strip(), channels), True
    return [Found(role, channel, how, negated=negated) for channel in named]


def _called(name: str, channels: Sequence[Channel]) -> list[Channel]:
    for names_of in (
        lambda c: (c.name, c.qualified),
        lambda c: (c.base,),
        lambda c: (without_unit(c.name), without_unit(c.base)),
        lambda c: (OTHER_UNITS.get(c.base, ("",))[0],),
    ):
        if matches := [c for c in channels if name in names_of(c)]:
            return matches
    return []


def can_be(channel: Channel, column: Column) -> bool:
    """Return whether the unit of a channel, if stated, allows it to be a column of numbers."""
    if channel.written:
        return channel.written == "clock" and column.name == "time_s"
    unit = channel.unit
    is_raw = canonical_unit(unit) in RAW and column.name not in (*schemas.SETTINGS, "time_s")
    return not unit or is_raw or conversion(unit, column.unit) is not None


def is_whole(channels: Sequence[Channel], needs: Needs) -> bool:
    """Return whether the channels include all sensors that a run needs, each once."""
    return not lacking(needs.table, [r for r, f in meant(channels, needs).items() if len(f) == 1])


def mapped(
    channels: Sequence[Channel], needs: Needs, place: str, roles: Collection[str] | None = None
) -> dict[str, Found]:
    """Find the channel of each of our columns; report what is ambiguous or has no clear unit."""
    found: dict[str, Found] = {}
    fitting = meant(channels, needs, roles, numbered=True)
    taken = {id(match.channel) for matches in fitting.values() for match in matches}
    for role, (match, *others) in fitting.items():
        if others:
            problem = _ambiguous([match.channel, *(m.channel for m in others)], role, needs)
            needs.problems.add(f"{place}: {problem}")
        elif match.is_clock:
            dates = [
                c
                for c in channels
                if c.written == "date" and c.raw is match.channel.raw and id(c) not in taken
                if means_date(c.name)
            ]
            if len(dates) > 1:
                names = ", ".join(c.name for c in dates)
                needs.problems.add(
                    f"{place}: {names} can be the date of {match.channel.name}: keep one"
                )
            found[role] = replace(match, stated=True, date=dates[0] if dates else None)
        else:
            found[role] = with_unit(match, needs, place)
    return found


def with_unit(match: Found, needs: Needs, place: str) -> Found:
    """Return a channel with the conversion to our unit; report what is unclear."""
    column = needs.table.column(match.role)
    if column.dtype == "string":
        return match
    by = _conversion(column, match, needs)
    if isinstance(by, str):
        needs.problems.add(f"{place}: {by}" if place else by)
    known = by if isinstance(by, Conversion) else Conversion(1.0)
    signed = Conversion(-known.factor if match.negated else known.factor, known.shift)
    return replace(match, by=signed, stated=isinstance(by, Conversion))


def _ambiguous(channels: Sequence[Channel], role: str, needs: Needs) -> str:
    """Return the message that several channels can be a column."""
    grouped = len({c.group for c in channels}) > 1
    names = [c.qualified if grouped else c.name for c in channels]
    shown = names if grouped else [c.shown for c in channels]
    text = f"{', '.join(shown[:8])} can be {role}, say which: {needs.line('columns', role)}"
    text += f'"{names[0]}"}}}}'
    if role == "force_N":  # two forces and a travel are not always those of a press
        text += (
            f'; if it is a friction rig: columns: {{rig: {{tension_tight_N: "{names[0]}", '
            f'tension_slack_N: "{names[1]}"}}}}'
        )
    return text


def _conversion(column: Column, found: Found, needs: Needs) -> Conversion | str | None:
    """Return the conversion of a channel; a text says what is unclear; None: no unit is stated."""
    channel, shown, unit = found.channel, found.shown, found.channel.unit
    ours, plain, line = column.unit, canonical_unit(unit), needs.line("units", column.name)
    stated = needs.options.units.get(column.name)
    cell = channel.cells[0][:40] if channel.cells else "0"
    recognised = found.how == "recognised" and channel.name != column.name
    if recognised and plain in NO_UNIT and not is_number(cell):
        what = "a clock time such as 13:45:02.125" if column.name == "time_s" else "a number"
        return f'{channel.name}, read as {column.name}, holds "{cell}", must be {what}'
    if isinstance(stated, str):
        if canonical_unit(stated) == "rad/s" and channel.is_in_rpm_by_name:
            return (
                f"{shown} is in rpm by its name, not in rad/s: state {line}rpm}}}}, or {line}"
                "{factor: 1, offset: 0}}} if its numbers are in rad/s in spite of its name"
            )
        setting = calibration(stated, ours) or conversion(stated, ours)
    else:
        setting = stated
    if isinstance(setting, Calibration):
        return setting.conversion(unit) or (
            f"{shown} is in {unit}, but the calibration of the config is for {setting.per}"
        )
    if setting is not None:
        return setting
    both = [u for u in (channel.unit_of_name, channel.unit_cell) if conversion(u, ours)]
    if len({conversion(u, ours) for u in both}) > 1:
        first, second = map(canonical_unit, both)
        return (
            f"{shown} is in {first} by its name and in {second} by its unit: "
            f"say which, {line}{first}}}}} or {line}{second}}}}}"
        )
    if scaling := channel.raw.scaling.get(channel.name):
        return (
            f"{shown} holds whole numbers, but the file states {scaling}, which was not applied: "
            f"state {line}{{factor: ..., offset: ...}}}}}} if they are counts, or {line}{ours}}}}} "
            "if they are not"
        )
    if plain in ("", "-") and recognised:
        or_rpm = f" or {line}rpm}}}}" if ours == "rad/s" else ""
        return (
            f"the unit of {channel.name}, read as {column.name}, is missing; "
            f"state it: {line}{ours}}}}}{or_rpm}"
        )
    if plain in ("", "-"):
        base, _, ending = channel.name.rpartition("_")
        other = conversion(ending, ours) if base and channel.name != column.name else None
        if other in (None, Conversion(1.0)):
            return None
        return f"{shown}: is it in {ending}? say {line}{ending}}}}} or {line}{ours}}}}}"
    if plain in RAW:
        per = "mV" if plain == "mV" else "V"
        return (
            f"{shown} is in {unit}, its calibration is missing; state it: "
            f"{line}250 {ours}/{per}}}}}, or {{factor: 250, offset: 0}}"
        )
    is_per_second = unit.strip(" []()").replace(" ", "") in ("1/s", "s-1", "s^-1", "s⁻¹")
    is_turn = any(word in simplified(channel.name) for word in _TURNS)
    if ours == "rad/s" and is_per_second and not is_turn:
        return f"{shown} is in {unit}: turns or radians? say {line}rev/s}}}} or {line}rad/s}}}}"
    if ours == "rad/s" and plain in ("m/s", "mm/s"):
        return (
            f"{shown} is in {unit}; divide by the radius R of the pulley: "
            f"{line}{{factor: 1/R, offset: 0}}}}}}, 1/R as a number in 1/m"
        )
    by = conversion(unit, ours)
    if by is None and plain == "1":
        return None
    return by or (
        f"{shown} is in {unit}, must be one of {', '.join(allowed_units(ours))}, or state "
        f"{line}{{factor: ..., offset: 0}}}}}}"
    )


def refuse_missing(
    channels: Sequence[Channel],
    found: Mapping[str, Found],
    needs: Needs,
    place: str,
    elsewhere: Collection[str],
) -> None:
    """Report the required columns that are missing, sensors first, in one message.

    `elsewhere` lists our columns that are stated elsewhere. If only settings are missing, nothing
    is reported here: they may still come from outside the file.
    """
    table, names = needs.table, needs.options.names
    has = {*found, *elsewhere}
    used = {match.channel.name for match in found.values()}
    free = [c.name for c in channels if c.name not in used]
    required = [*lacking(table, has), *(c.name for c in table.columns if c.required), *names]
    missing = [r for r in dict.fromkeys(required) if r not in has and r in table.names]
    close = {
        role: match[0]
        for role in missing
        if (match := difflib.get_close_matches(names.get(role, role), free, n=1, cutoff=0.6))
    }
    missing = [r for r in missing if r not in schemas.NOMINAL or r in close or r in names]
    if not missing and (found or any(c.required for c in table.columns)):
        return
    kind = bench_of(channels, table)
    if kind and kind != table.kind:
        needs.problems.add(
            f"{place}: these are the columns of a recording of {schemas.table(kind).command}, "
            f"not of {table.command}; in a config its key is data.{kind}"
        )
        return
    if table.kind == "rig" and (keys := rig_of(_possible(channels, "rig"), needs)):
        stated = ", ".join(f"{key}: {word}" for key, word in keys.items())
        needs.problems.add(
            f"{place}: column {missing[0]} is missing; these are the channels of rig: {{{stated}}}"
        )
        return
    shown = [
        names.get(role, role)
        + (f" (which the config names for {role})" if names.get(role, role) != role else "")
        + (f" (is it {close[role]}?)" if role in close else "")
        for role in missing
    ] or [f"of {table.command}"]
    first = next((r for r in missing if r in close), next(iter(missing), "mu"))
    held = ", ".join(free[:12]) + (", ..." if len(free) > 12 else "")
    verb = "is missing" if len(shown) == 1 else "are missing"
    needs.problems.add(
        f"{place}: column{'s' * (len(shown) > 1)} {', '.join(shown)} {verb}; not yet read: "
        f"{held or 'none'}; if it has another name, state it: {needs.line('columns', first)}"
        f'"{close.get(first, "its name in the file")}"}}}}'
    )


def how_to_state(setting: str, kind: str) -> str:
    """Return advice on how to state a setting that no column holds."""
    return (
        f"; if it is the same for every run: runs: {{{kind}: {{values: {{{setting}: ...}}}}}}; if "
        f"the file names contain it: runs: {{{kind}: {{pattern: "
        f'"{{run}}_{{{setting}}}.csv"}}}}; or in a table of the files: runs: {{{kind}: '
        "{table: runs.csv}}"
    )


def _possible(channels: Sequence[Channel], kind: str) -> set[str]:
    """Return our columns of a kind that the names of the channels can mean."""
    return {role for c in channels for role in (c.name, *roles_meant(c.name, kind))}


def bench_of(channels: Sequence[Channel], table: Table) -> str:
    """Return the only kind of recording whose sensors are all there; "" if none or several."""
    kinds = []
    for kind in ("press", "speedloss", "rig"):
        has = _possible(channels, kind)
        forces = "pulley_speed_rad_s" in has and len(has & {*FORCES}) > 1
        if forces if kind == "rig" else not lacking(schemas.table(kind), has):
            kinds.append(kind)
    return kinds[0] if len(kinds) == 1 else ""


def rig_of(has: Collection[str], needs: Needs) -> dict[str, str]:
    """Return the `rig` keys of the forces that a file has, if they are not those of the config."""
    tight, slack, weight, torque, hub = (name in has for name in FORCES)
    if (tight and slack) or not lacking(needs.table, has):
        return {}
    if weight and (tight or slack):
        return {"kind": "dead_weight", "holds": "weight_slack" if tight else "weight_tight"}
    return (
        {"kind": "torque_hub" if hub else "torque"}
        if torque and (tight or slack or hub or weight)
        else {}
    )


def notes_of(found: Mapping[str, Found], table: Table, channels: Sequence[Channel]) -> list[str]:
    """Return notes on the channels that were recognised, converted and left out."""
    notes = []
    for role, match in found.items():
        if match.how == "recognised":
            by_name = " in rpm, by its name," if match.channel.is_in_rpm_by_name else ""
            notes.append(f"read {match.channel.shown}{by_name} as {role}")
        elif match.stated and match.by != Conversion(1.0):
            unit = match.channel.unit or "the unit stated"
            notes.append(f"{match.shown} converted from {unit} to {table.column(role).unit}")
    used = {c.name for m in found.values() for c in (m.channel, m.date) if c is not None}
    left_out = [n for n in dict.fromkeys(c.name for c in channels) if n not in used]
    return [*notes, *(["columns left out: " + ", ".join(left_out[:12])] if left_out else [])]
