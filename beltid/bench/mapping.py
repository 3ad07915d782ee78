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

from beltid.bench.clock import written_as
from beltid.bench.header import IN_NAME, unit_in_name, without_position, without_unit
from beltid.bench.numbers import is_number
from beltid.bench.options import ReadOptions
from beltid.bench.raw import Raw, first_texts
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
_IN_RPM: Final = re.compile(
    r"drehzahl|(?<!\d)(?<!\d )rpm|\b(?:upm|(?:u|1|r|tr|rev|tours)/min|min(?:\^?-|⁻)[1¹])(?!\w)",
    re.IGNORECASE,
)
"""Names of speeds in turns per minute."""
EITHER: Final = frozenset(("tension_tight_N", "tension_slack_N", "weight_N"))
"""Of these, one is enough beside a torque."""
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
        return self.unit_of_name or ("rpm" if self.is_in_rpm_by_name else self.unit_cell)


@dataclass(frozen=True, slots=True)
class Found:
    """A channel that is one of our columns.

    Attributes
    ----------
    role : str
        Our column.
    channel : Channel
        The channel.
    how : {"config", "own name", "recognised"}
        How it was identified.
    by : Conversion
        Conversion of the numbers in the file, including the sign.
    stated : bool
        Whether file or config states the unit.
    negated : bool
        Whether the config reverses the sign.
    date : Channel or None
        Channel with the dates of its clock times.
    """

    role: str
    channel: Channel
    how: str
    by: Conversion = field(default_factory=lambda: Conversion(1.0))
    stated: bool = False
    negated: bool = False
    date: Channel | None = None

    @property
    def is_clock(self) -> bool:
        """Whether the channel holds clock times."""
        return self.role == "time_s" and self.channel.written == "clock"

    @property
    def shown(self) -> str:
        """Name of the column in messages."""
        name = self.channel.name
        return self.role if name == self.role else f'{self.role} (column "{name}")'


@dataclass(frozen=True, slots=True)
class Needs:
    """What is wanted from a file: the table to fill, what the config states, the problems."""

    table: Table
    options: ReadOptions
    problems: Problems = field(default_factory=Problems)

    def line(self, section: str, role: str) -> str:
        """Return the beginning of a line for the config."""
        return f"{section}: {{{self.table.kind}: {{{role}: "


def channels_of(raws: Sequence[Raw]) -> list[Channel]:
    """Return the channels of the tables of a file."""
    several = len(raws) > 1
    return [Channel(r, name, r.name if several else "") for r in raws for name in r.names if name]


def sensors_of(table: Table) -> list[str]:
    """Return our columns that sensors record and that a run must have."""
    return [
        c.name
        for c in table.columns
        if c.required and c.dtype != "string" and c.name not in (*schemas.SETTINGS, "time_s")
    ]


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
    """Return whether the channels include all sensors that a run needs."""
    found = meant(channels, needs)
    return all(len(found.get(role, ())) == 1 for role in sensors_of(needs.table))


def mapped(
    channels: Sequence[Channel], needs: Needs, place: str, roles: Collection[str] | None = None
) -> dict[str, Found]:
    """Find the channel of each of our columns; report what is ambiguous or has no clear unit.

    Parameters
    ----------
    channels : sequence of Channel
        Channels of a recording.
    needs : Needs
        Columns needed; collects the problems.
    place : str
        Place of the units, for messages.
    roles : collection of str, optional
        Search for these of our columns only.
    """
    found: dict[str, Found] = {}
    problems = needs.problems
    fitting = meant(channels, needs, roles, numbered=True)
    for role, matches in fitting.items():
        if len(matches) > 1:
            problems.add(f"{place}: {_ambiguous([m.channel for m in matches], role, needs)}")
            continue
        match = matches[0]
        column = needs.table.column(role)
        if column.dtype == "string":
            found[role] = match
        elif match.is_clock:
            taken = {id(m.channel) for all_ in fitting.values() for m in all_}
            dates = [
                c
                for c in channels
                if c.written == "date" and c.raw is match.channel.raw and id(c) not in taken
                if means_date(c.name)
            ]
            if len(dates) > 1:
                names = ", ".join(c.name for c in dates)
                problems.add(f"{place}: {names} can be the date of {match.channel.name}: keep one")
            found[role] = replace(match, stated=True, date=dates[0] if dates else None)
        else:
            by = _conversion(column, match, needs)
            if isinstance(by, str):
                problems.add(f"{place}: {by}")
            known = by if isinstance(by, Conversion) else Conversion(1.0)
            signed = Conversion(-known.factor if match.negated else known.factor, known.shift)
            found[role] = replace(match, by=signed, stated=isinstance(by, Conversion))
    return found


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
    channel, line = found.channel, needs.line("units", column.name)
    stated = needs.options.units.get(column.name)
    cell = channel.cells[0][:40] if channel.cells else "0"
    if found.how == "recognised" and not channel.unit and not is_number(cell):
        what = "a clock time such as 13:45:02.125" if column.name == "time_s" else "a number"
        return f'{channel.name}, read as {column.name}, holds "{cell}", must be {what}'
    if isinstance(stated, str) and canonical_unit(stated) == "rad/s" and channel.is_in_rpm_by_name:
        return (
            f"{found.shown} is in rpm by its name, not in rad/s: state {line}rpm}}}}, or "
            f"{line}{{factor: 1, offset: 0}}}}}} if its numbers are in rad/s in spite of its name"
        )
    if stated is None:
        both = [u for u in (channel.unit_of_name, channel.unit_cell) if conversion(u, column.unit)]
        if len({conversion(unit, column.unit) for unit in both}) > 1:
            name, cell = map(canonical_unit, both)
            return (
                f"{found.shown} is in {name} by its name and in {cell} by its unit: "
                f"say which, {line}{name}}}}} or {line}{cell}}}}}"
            )
        if scaling := channel.raw.scaling.get(channel.name):
            return (
                f"{found.shown} holds whole numbers, but the file states {scaling}, which was not "
                f"applied: state {line}{{factor: ..., offset: ...}}}}}} if they are counts, or "
                f"{line}{column.unit}}}}} if they are not"
            )
    return to_unit(column, channel.name, channel.unit, needs, recognised=found.how == "recognised")


def to_unit(
    column: Column, name: str, unit: str, needs: Needs, *, recognised: bool
) -> Conversion | str | None:
    """Return the conversion of a written unit; a text says what is wrong; None: none is stated."""
    shown = column.name if name == column.name else f'{column.name} (column "{name}")'
    line, plain = needs.line("units", column.name), canonical_unit(unit)
    stated = needs.options.units.get(column.name)
    setting: Calibration | Conversion | None = None
    if isinstance(stated, str):
        setting = calibration(stated, column.unit) or conversion(stated, column.unit)
    elif stated is not None:
        setting = stated
    if isinstance(setting, Calibration):
        return setting.conversion(unit) or (
            f"{shown} is in {unit}, but the calibration of the config is for {setting.per}"
        )
    if setting is not None:
        return setting
    if plain in ("", "-") and not recognised:
        base, _, ending = name.rpartition("_")
        other = conversion(ending, column.unit) if base and name != column.name else None
        if other in (None, Conversion(1.0)):
            return None
        return f"{shown}: is it in {ending}? say {line}{ending}}}}} or {line}{column.unit}}}}}"
    if plain in ("", "-"):
        bracket = IN_NAME.search(name)
        what = f'is "{bracket[1]}", which is not known' if bracket else "is missing"
        or_rpm = f" or {line}rpm}}}}" if column.unit == "rad/s" else ""
        return (
            f"the unit of {name}, read as {column.name}, {what}; "
            f"state it: {line}{column.unit}}}}}{or_rpm}"
        )
    if plain in RAW:
        per = "mV" if plain == "mV" else "V"
        return (
            f"{shown} is in {unit}, its calibration is missing; state it: "
            f"{line}250 {column.unit}/{per}}}}}, or {{factor: 250, offset: 0}}"
        )
    if column.unit == "rad/s" and plain == "rev/s" and _may_be_radians(unit, name):
        return f"{shown} is in {unit}: turns or radians? say {line}rev/s}}}} or {line}rad/s}}}}"
    if column.unit == "rad/s" and plain in ("m/s", "mm/s"):
        return (
            f"{shown} is in {unit}; divide by the radius R of the pulley: "
            f"{line}{{factor: 1/R, offset: 0}}}}}}, 1/R as a number in 1/m"
        )
    by = conversion(unit, column.unit)
    if by is None and plain == "1":
        return None
    return by or f"{shown} is in {unit}, must be one of " + ", ".join(allowed_units(column.unit))


def _may_be_radians(unit: str, name: str) -> bool:
    """Return whether 1/s may mean radians as well as turns."""
    per_second = unit.strip(" []()").replace(" ", "") in ("1/s", "s-1", "s^-1", "s⁻¹")
    return per_second and not any(word in simplified(name) for word in _TURNS)


def refuse_missing(
    channels: Sequence[Channel],
    found: Mapping[str, Found],
    needs: Needs,
    place: str,
    elsewhere: Collection[str],
) -> None:
    """Report required columns that are missing, sensors first, with the names that may be meant.

    `elsewhere` lists our columns that are stated elsewhere. If only settings are missing, nothing
    is reported here: they may still come from outside the file.
    """
    table, names, problems = needs.table, needs.options.names, needs.problems
    header = [c.name for c in channels]
    used = {match.channel.name for match in found.values()}
    free = [name for name in header if name not in used]
    missing: list[tuple[str, list[str]]] = []
    messages: list[str] = []
    columns = sorted(table.columns, key=lambda c: c.name in schemas.SETTINGS or c.name == "time_s")
    for column in columns:
        theirs = names.get(column.name, column.name)
        if column.name in {*found, *elsewhere} or not (column.required or theirs != column.name):
            continue
        close = difflib.get_close_matches(theirs, free, n=1, cutoff=0.6)
        advice = f", did you mean {close[0]}?" if close else _unknown_unit(column, free, table)
        if column.name in schemas.NOMINAL and not close and theirs == column.name:
            advice = how_to_state(column.name, table.kind)
        else:
            missing.append((column.name, close))
        config = f" (which the config names for {column.name})" if theirs != column.name else ""
        messages.append(f"{place}: column {theirs}{config} is missing{advice}")
    if not found and not any(column.required for column in table.columns):
        missing.append((next(c.name for c in table.columns if c.dtype == "float64"), []))
        messages.append(f"{place}: holds no column of {table.command}")
    if not missing:
        return
    kind, rig = bench_of(channels, table)
    if kind not in ("", table.kind):
        problems.add(
            f"{place}: these are the columns of a recording of {schemas.table(kind).command}, "
            f"not of {table.command}; in a config its key is data.{kind}"
        )
        return
    for text in messages:
        problems.add(text)
    if rig:
        problems.add(f"{place}: these are the channels of {rig}")
        return
    role, close = missing[0]
    shown = ", ".join(header[:20]) + (", ..." if len(header) > 20 else "")
    problems.add(
        f"{place}: the columns found are {shown}; if they have other names, state them in the "
        f'config, {needs.line("columns", role)}"{(close or ["its name in the file"])[0]}"}}}}'
    )


def _unknown_unit(column: Column, names: Sequence[str], table: Table) -> str:
    """Return advice on a channel that could be our column but for its unit; "" if there is none."""
    for name in names:
        bare = IN_NAME.sub("", name).strip()
        if bare != name and not unit_in_name(bare) and column.name in roles_meant(bare, table.kind):
            units = ", ".join(allowed_units(column.unit))
            return (
                f': the unit of "{name}" must be one of {units}, or '
                f'state columns: {{{table.kind}: {{{column.name}: "{name}"}}}} and units: '
                f"{{{table.kind}: {{{column.name}: {{factor: ..., offset: 0}}}}}}"
            )
    return ""


def how_to_state(setting: str, kind: str) -> str:
    """Return advice on how to state a setting that no column holds."""
    return (
        f"; if it is the same for every run: runs: {{{kind}: {{values: {{{setting}: ...}}}}}}; if "
        f"the file names contain it: runs: {{{kind}: {{pattern: "
        f'"{{run}}_{{{setting}}}.csv"}}}}; or in a table of the files: runs: {{{kind}: '
        "{table: runs.csv}}"
    )


def bench_of(channels: Sequence[Channel], table: Table) -> tuple[str, str]:
    """Return the only kind of recording, and the other kind of rig, whose sensors are all there."""
    names = [c.name for c in channels]
    kinds, rig = set(), ""
    for other, entry in kinds_of_benches():
        has = {role for name in names for role in (name, *roles_meant(name, other.kind))}
        sensors = {*sensors_of(other), *({"weight_N"} & {*_required(other)})}
        if not sensors <= has:
            continue
        kinds.add(other.kind)
        enough = "torque}" not in entry or bool(EITHER & has)
        if other.kind == table.kind and other != table and enough:
            rig = rig or entry
    return (kinds.pop() if len(kinds) == 1 else ""), rig


def _required(table: Table) -> list[str]:
    return [c.name for c in table.columns if c.required]


def kinds_of_benches() -> list[tuple[Table, str]]:
    """Return the tables of all kinds of benches, with the config entry of those of a rig."""
    rigs = []
    for measures, weight_on in schemas.RIG_KINDS:
        on = f", weight_on: {weight_on}" if measures == "dead_weight" else ""
        entry = "" if measures == "two_cells" else f"rig: {{kind: {measures}{on}}}"
        rigs.append((schemas.rig_table(measures, weight_on), entry))
    return [(schemas.table("press"), ""), (schemas.table("speedloss"), ""), *rigs]


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
