"""Written channels -> our columns: by the config, by our own name, by the vocabulary.

A unit is stated in the config or in the file. What is ambiguous is asked, never guessed.
"""

import difflib
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import pandas as pd

from beltid.bench.raw import (
    IN_NAME,
    POSITION,
    Field,
    NumberSigns,
    Raw,
    first_texts,
    is_clock,
    is_date,
    is_unit,
    roles_meant,
    simplified,
    span_of,
    split_unit,
)
from beltid.config.model import KINDS, Config, DialectSection
from beltid.errors import InputError, Problems
from beltid.tables import schemas
from beltid.tables.schemas import Column, Table
from beltid.tables.units import (
    CONVERSIONS,
    Calibration,
    Conversion,
    calibration,
    canonical_unit,
    conversion,
)

RAW = ("V", "mV", "mV/V", "A", "mA")  # units of raw signals, which need a calibration
NO_UNIT = ("", "-", "1")
FORCES: tuple[str, ...] = (  # any two of a friction rig give the forces of both spans
    *("tension_tight_N", "tension_slack_N", "weight_N", "torque_N_m", "hub_force_N"),
)
_IN_RPM = re.compile(  # names of speeds in turns per minute
    r"drehzahl|(?<!\d)(?<!\d )rpm|\b(?:upm|(?:u|1|r|tr|rev|tours)/min|min(?:\^?-|⁻)[1¹])(?!\w)",
    re.IGNORECASE,
)
_DIGITS = "0123456789 "
_NUMBER_AND_UNIT = re.compile(r"\s*([-+]?[\d.,]+(?:[eE][-+]?\d+)?)\s*([^\d\s.,].*)$")
_END = str.maketrans(" /", "__")
OTHER_UNITS = {  # names such as ``force_kN`` -> the column ``force_N``, and ``kN``
    column.name.removesuffix(column.unit.translate(_END)) + unit.translate(_END): (
        column.name,
        unit,
    )
    for kind in schemas.RECORDINGS
    for column in schemas.table(kind).columns
    if column.name.endswith("_" + column.unit.translate(_END))
    for unit in CONVERSIONS.get(column.unit, {})
    if unit != column.unit
}


@dataclass(frozen=True, slots=True)
class Needs:
    """What is wanted from the files of a bench: the table to fill, and what the config states."""

    table: Table
    names: Mapping[str, str] = field(default_factory=dict)  # our column -> channel or head field
    units: Mapping[str, Any] = field(default_factory=dict)  # our column -> unit, calibration
    pattern: str | None = None  # of the file names, with label and settings
    run_table: Path | None = None  # with a row per file
    rows: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # of it, by file or group
    values: Mapping[str, Any] = field(default_factory=dict)  # settings of all runs
    dialect: DialectSection = field(default_factory=DialectSection)
    measures: tuple[str, str] = ("two_cells", "tight")  # by the config, and the span of a weight
    rig: Mapping[str, str] = field(default_factory=dict)  # what the channels show
    problems: Problems = field(default_factory=Problems)

    @classmethod
    def of(cls, config: Config | None, kind: str) -> Self:
        """Return what a config states for a kind of recording."""
        table = schemas.table(kind)
        if config is None:
            return cls(table)
        kind = "rig" if kind == "points" else kind  # what is stated of a rig serves its plateaus
        runs, rig, dialect = config.runs[kind], config.rig, config.dialect
        if dialect.decimal is not None and dialect.decimal == dialect.thousands:
            raise InputError(
                f'config: dialect.decimal and dialect.thousands are both "{dialect.decimal}", must '
                "differ"
            )
        return cls(
            table,
            config.columns[kind],
            config.units[kind],
            runs["pattern"],
            runs["table"],
            values=({"weight_N": rig.weight_N} if kind == "rig" and rig.weight_N else {})
            | runs["values"],
            dialect=dialect,
            measures=(rig.kind, rig.weight_on),
        )

    @property
    def kind(self) -> str:
        """Kind of recording of which a config speaks."""
        return "rig" if self.table.kind == "points" else self.table.kind

    def say(self, section: str, role: str, *values: str) -> str:
        """Return lines of the config, one of which answers a question."""
        return " or ".join(f"{section}: {{{self.kind}: {{{role}: {v}}}}}" for v in values)


@dataclass(frozen=True, eq=False)
class Channel:
    """A column of a table as written."""

    raw: Raw
    key: str  # in the frame
    name: str  # with its group, where another one has the same
    word: str = "column"

    @property
    def values(self) -> pd.Series:
        """The cells."""
        return self.raw.frame[self.key]

    @cached_property
    def written(self) -> str:
        """How its first cells are written: "clock", "date" or "" for anything else."""
        cells = first_texts(self.values)
        is_dated = bool(cells) and all(map(is_date, cells))
        return "date" if is_dated else "clock" if cells and is_clock(cells[0]) else ""

    @property
    def base(self) -> str:
        """Name without its group, and the position among channels of the same name."""
        return POSITION.sub("", self.key)

    @cached_property
    def names(self) -> tuple[tuple[str, ...], ...]:
        """By which it is called: as written, and ever less exactly."""
        bare = split_unit(self.key)[0], split_unit(self.base)[0]
        ours = OTHER_UNITS.get(self.base, ("",))[:1]
        return (self.name, f"{self.raw.name}/{self.key}"), (self.base,), bare, ours

    @property
    def units(self) -> tuple[str, str]:
        """Units that the file states at the end of the name, and besides it."""
        of_name = split_unit(self.key)[1] or OTHER_UNITS.get(self.base, ("", ""))[1]
        return of_name, self.raw.units.get(self.key, "")

    @property
    def shown(self) -> str:
        """Name and unit, for messages."""
        unit = self.units[1].strip("[](){}<> ")
        return f"{self.name} [{unit}]" if unit and not split_unit(self.key)[1] else self.name

    @property
    def is_in_rpm_by_name(self) -> bool:
        """Whether the name alone says that a channel without a unit is in turns per minute."""
        of_name, beside = self.units
        has_unit = of_name or canonical_unit(beside) not in NO_UNIT
        return not has_unit and bool(_IN_RPM.search(self.key))

    @property
    def unit(self) -> str:
        """Unit as written in the file, in a cell or in the name; "" if there is none."""
        of_name, beside = self.units
        if canonical_unit(beside) not in NO_UNIT:
            return beside
        unknown = IN_NAME.search(self.key)
        known = of_name or ("rpm" if self.is_in_rpm_by_name else beside)
        return known or (unknown[1].strip() if unknown else "")


@dataclass(frozen=True, slots=True)
class Found:
    """A channel that is one of our columns."""

    role: str  # our column
    channel: Channel
    how: str  # "config", "own name" or "recognised"
    by: Conversion = field(default_factory=lambda: Conversion(1.0))  # with the sign
    stated: bool = False  # whether file or config states the unit
    negated: bool = False  # whether the config reverses the sign

    @property
    def is_clock(self) -> bool:
        """Whether the channel holds clock times."""
        return self.role == "time_s" and self.channel.written == "clock"

    @property
    def shown(self) -> str:
        """Name of the column in messages."""
        name = self.channel.name
        return self.role if name == self.role else f'{self.role} ({self.channel.word} "{name}")'


def channels_of(raws: Sequence[Raw]) -> list[Channel]:
    """Return the channels of tables; those of the same name by the names of their groups."""
    names = [(raw, str(name)) for raw in raws for name in raw.frame if name]
    counts = Counter(name for _, name in names)
    return [
        Channel(raw, name, f"{raw.name}/{name}" if counts[name] > 1 else name)
        for raw, name in names
    ]


def channels_of_head(fields: Sequence[Field], dialect: DialectSection) -> list[Channel]:
    """Return the fields of a header as channels: a field is a column of one row."""
    channels = []
    for entry in dict.fromkeys(fields):
        (name, unit), text = split_unit(entry.name), entry.text
        unit, number = entry.unit or unit, _NUMBER_AND_UNIT.match(text)
        if not unit and number and is_unit(number[2]):
            text, unit = number[1], number[2].strip()
        frame = pd.DataFrame({name: pd.array([text], dtype="str")})
        signs = NumberSigns.of([text], dialect.decimal, dialect.thousands)
        raw = Raw("", frame, units={name: unit}, signs=signs)
        channels.append(Channel(raw, name, name, "header field"))
    return channels


def lacking(table: Table, has: Collection[str]) -> list[str]:
    """Return the sensors that a run lacks; a friction rig needs two of its forces."""
    known = {*schemas.SETTINGS, "time_s", table.label, *has}
    missing = [c.name for c in table.columns if c.required and c.name not in known]
    if table.kind == "rig" and not missing and len({*FORCES} & {*has}) < 2:
        missing = [name for name in FORCES if name in table.names and name not in has][:1]
    return missing


def meant(channels: Sequence[Channel], needs: Needs) -> dict[str, list[Found]]:
    """Return our columns -> channels that fit; several for one column are ambiguous."""
    found = {c.name: _named(c.name, channels, needs) for c in needs.table.columns}
    taken = {id(named[0].channel) for named in found.values() if named}
    free = [c for c in channels if id(c) not in taken]
    words = {id(c): roles_meant(c.base, needs.table.kind) for c in free}
    for column in needs.table.columns:
        if found[column.name] or column.name in needs.names:
            continue
        fit = [c for c in free if column.name in words[id(c)]]
        if column.dtype != "string" and column.name not in needs.units:
            fit = [c for c in fit if _can_be(c, column)] or fit
        if column.name == "time_s":  # prefer elapsed time to time of day
            fit = [c for c in fit if c.unit and not c.written] or fit
        if len(fit) == 1 and column.name in lacking(needs.table, ()):
            # channels whose names differ by a number only are alike
            alike = simplified(fit[0].base).rstrip(_DIGITS)
            others = (c for c in free if not words[id(c)] and _can_be(c, column))
            fit += [c for c in others if simplified(c.base).rstrip(_DIGITS) == alike]
        found[column.name] = [Found(column.name, c, "recognised") for c in fit]
    return {role: matches for role, matches in found.items() if matches}


def _can_be(channel: Channel, column: Column) -> bool:
    """Return whether the unit of a channel, if stated, allows it to be a column of numbers."""
    unit = channel.unit
    if channel.written:
        return channel.written == "clock" and column.name == "time_s"
    is_raw = canonical_unit(unit) in RAW and column.name not in schemas.SETTINGS
    return not unit or is_raw or conversion(unit, column.unit) is not None


def _named(role: str, channels: Sequence[Channel], needs: Needs) -> list[Found]:
    """Find the channels that the config names for a column, or that have our name."""
    name, how = needs.names.get(role, role), "config" if role in needs.names else "own name"
    for called in (name, name[1:].strip()) if name.startswith("-") else (name,):
        for way in range(4):  # the first way of naming that fits any decides
            if named := [c for c in channels if called in c.names[way]]:
                return [Found(role, c, how, negated=called != name) for c in named]
    return []


def mapped(channels: Sequence[Channel], needs: Needs, place: str) -> dict[str, Found]:
    """Find the channel of each of our columns; report what is ambiguous or has no clear unit."""
    every = ((r, resolved(of, needs, place)) for r, of in meant(channels, needs).items())
    return {role: one for role, one in every if one is not None}


def resolved(matches: Sequence[Found], needs: Needs, place: str) -> Found | None:
    """Return the one channel that fits, with the conversion to our unit; report what is unclear."""
    match, column = matches[0], needs.table.column(matches[0].role)
    if len(matches) > 1:
        can_be = ", ".join(each.channel.shown for each in matches[:8])
        one, two, *_ = (f'"{each.channel.name}"' for each in matches)
        say = needs.say("columns", column.name, one)
        if column.name == "force_N":  # two forces and a travel are not always those of a press
            of_rig = f"{{tension_tight_N: {one}, tension_slack_N: {two}}}"
            say += f"; if it is a friction rig: columns: {{rig: {of_rig}}}"
        needs.problems.add(f"{place}: {can_be} can be {column.name}, say which: {say}")
        return None
    if column.dtype == "string" or match.is_clock:
        return replace(match, stated=match.is_clock)
    by = _conversion(column, match, needs)
    if isinstance(by, tuple):
        say = needs.say("units", column.name, *by[1:])
        needs.problems.add(f"{place}: {match.shown} {by[0]}: state {say}".removeprefix(": "))
    known = by if isinstance(by, Conversion) else Conversion(1.0)
    signed = Conversion(-known.factor if match.negated else known.factor, known.shift)
    return replace(match, by=signed, stated=isinstance(by, Conversion))


def _conversion(column: Column, found: Found, needs: Needs) -> Conversion | tuple[str, ...] | None:
    """Return the conversion of a channel; what is unclear and its answers; None: no unit stated."""
    channel, ours = found.channel, column.unit
    unit, stated = channel.unit, needs.units.get(column.name, {})
    plain, by, factors = canonical_unit(unit), conversion(unit, ours), "{factor: ..., offset: ...}"
    of = calibration(stated, ours) if isinstance(stated, str) else stated and Calibration(**stated)
    if of:
        wrong = f"is in {unit}, but the calibration of the config is for {of.per}"
        return of.conversion(unit) or (wrong, factors)
    if stated and canonical_unit(stated) == "rad/s" and channel.is_in_rpm_by_name:
        return "is in rpm by its name, not in rad/s", "rpm", "{factor: 1, offset: 0}"
    if stated:
        return conversion(stated, ours)
    both = [canonical_unit(u) for u in channel.units if conversion(u, ours)]
    ending, scaling = channel.key.rpartition("_")[2], channel.raw.scaling.get(channel.key)
    unitless, is_guess, is_turning = plain in ("", "-"), found.how == "recognised", ours == "rad/s"
    not_applied = f"holds whole numbers, but the file states {scaling}, which was not applied"
    per = f"250 {ours}/{'mV' if plain == 'mV' else 'V'}"
    unclear: tuple[tuple[Any, ...], ...] = (  # whether it is, what it is, what may be stated
        (
            len({conversion(u, ours) for u in both}) > 1,
            f"is in {' by its name and in '.join(both)} by its unit",
            *both,
        ),
        (scaling, not_applied, factors, ours),
        (unitless and is_guess, "has no unit", ours, *(["rpm"] if is_turning else [])),
        (
            unitless and conversion(ending, ours) not in (None, Conversion(1.0)),
            *(f"may be in {ending} by its name", ending, ours),
        ),
        (
            plain in RAW,
            *(f"is in {unit} without a calibration", per, "{factor: 250, offset: 0}"),
        ),
        (
            is_turning and unit.strip(" []()").replace(" ", "") in ("1/s", "s-1", "s^-1", "s⁻¹"),
            *(f"is in {unit}, turns or radians", "rev/s", "rad/s"),
        ),
        (
            is_turning and plain in ("m/s", "mm/s"),
            *(f"is in {unit}, with the radius R of the pulley in m", "{factor: 1/R}"),
        ),
    )
    if answer := next((answer for holds, *answer in unclear if holds), None):
        return tuple(answer)
    if by is None and plain not in NO_UNIT:
        allowed = CONVERSIONS.get(ours, {})
        near = difflib.get_close_matches(plain, allowed, 1, 0.8)
        what = f"is in {unit}, must be one of {', '.join(allowed)}"
        return what, *near, "{factor: ..., offset: 0}"
    return None if unitless else by


def refuse_missing(
    channels: Sequence[Channel],
    found: Mapping[str, Found],
    needs: Needs,
    place: str,
    elsewhere: Collection[str],
) -> None:
    """Report the required columns that are missing, sensors first; some are stated `elsewhere`."""
    table, names = needs.table, needs.names
    has = {*found, *elsewhere, table.label}  # runs without a label are told by their files
    required = [c.name for c in table.columns if c.required]
    wanted = dict.fromkeys([*lacking(table, has), *required, *names])
    missing = [role for role in wanted if role not in has and role in table.names]
    if not missing and (found or required):
        return
    kind, is_whole_one = bench_of(channels, [Needs(schemas.table(kind)) for kind in KINDS])
    if is_whole_one and kind != needs.kind:
        needs.problems.add(
            f"{place}: these are the columns of a recording of {schemas.table(kind).command}, "
            f"data.{kind} in a config"
        )
        return
    free = unused(channels, found)
    near = ((r, difflib.get_close_matches(names.get(r, r), free, n=1)) for r in missing)
    close = {role: matches[0] for role, matches in near if matches}
    role, how = next(iter([*close, *missing]), "mu"), ""
    if missing and not close and {*missing} <= {*schemas.NOMINAL}:
        how = (
            f"; state it in runs: {{{needs.kind}: {{values: {{{role}: ...}}}}}} for all runs, by "
            f'pattern: "{{run}}_{{{role}}}.csv" of the file names, or by table: runs.csv with a '
            "row per file"
        )
    shown = [f"{names[r]} (which the config names for {r})" if r in names else r for r in missing]
    are = "columns {} are" if len(shown) > 1 else "column {} is"
    held = ", ".join(free[:12]) + (", ..." if len(free) > 12 else "") or "none"
    say = needs.say("columns", role, f'"{close.get(role, "its name in the file")}"')
    needs.problems.add(
        f"{place}: {are.format(', '.join(shown) or f'of {table.command}')} missing{how}; not yet "
        f"read: {held}; if it has another name, state it: {say}"
    )


def unused(channels: Sequence[Channel], found: Mapping[str, Found]) -> list[str]:
    """Return the names of the channels that are none of our columns."""
    used = {match.channel.name for match in found.values()}
    return [name for name in dict.fromkeys(c.name for c in channels) if name not in used]


def bench_of(channels: Sequence[Channel], benches: Sequence[Needs]) -> tuple[str, bool]:
    """Return the kind of recording that channels are, "" if several fit alike; if it is whole."""
    ranks = {}
    for needs in benches:
        has = {*meant(channels, needs)}
        is_rig = len(has & {*FORCES}) > 1 and "pulley_speed_rad_s" in has
        whole = is_rig if needs.kind == "rig" else not lacking(needs.table, has)
        ranks[needs.kind] = whole, 0 if whole else len(has)
    best = max(ranks.values())
    kinds = [kind for kind, rank in ranks.items() if rank == best]
    return (kinds[0], best[0]) if len(kinds) == 1 else ("", False)


def rig_of(has: Mapping[str, Sequence[Found]]) -> dict[str, str]:
    """Return what the forces of a file show of the rig; nothing if they are too few."""
    tight, slack, weight, torque, hub = (name in has for name in FORCES)
    if tight and slack:
        return {"kind": "two_cells"}
    if weight and (tight or slack):
        return {"kind": "dead_weight", "holds": "weight_slack" if tight else "weight_tight"}
    if not torque or not (tight or slack or hub or weight):
        return {}
    if hub:
        return {"kind": "torque_hub"}
    named = [match.channel.key for match in has.get("weight_N", ())]
    span = span_of(named[0]) if named else ""
    return {"kind": "torque"} | ({"holds": f"weight_{span}"} if span else {})


def notes_of(found: Mapping[str, Found], table: Table, channels: Sequence[Channel]) -> list[str]:
    """Return notes on the channels that were recognised, converted and left out."""
    notes = []
    for role, match in found.items():
        channel = match.channel
        if match.how == "recognised":
            by_name = " in rpm, by its name," if channel.is_in_rpm_by_name else ""
            notes.append(f"read {channel.shown}{by_name} as {role}")
        elif match.stated and match.by != Conversion(1.0):
            ways = f"from {channel.unit or 'the unit stated'} to {table.column(role).unit}"
            notes.append(f"{match.shown} converted {ways}")
    left_out = ", ".join(unused(channels, found)[:12])
    return [*notes, *([f"columns left out: {left_out}"] if left_out else [])]
