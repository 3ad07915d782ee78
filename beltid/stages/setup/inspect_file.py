"""beltid inspect: show how the files of a bench are read, and the matching config section."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path, PurePath
from typing import Any, Final

from beltid.bench.channels.channel_mapping import ChannelMapping, sensors_of, unit_of
from beltid.bench.inspection import FileView, Inspection, RunView, inspect_recording
from beltid.config import Config, ConfigSource
from beltid.config.name_pattern import name_pattern
from beltid.errors import EXIT_DONE, EXIT_INPUT, InputError
from beltid.report.summary import Summary
from beltid.stages.outcome import finite_or_none
from beltid.tables import schemas
from beltid.tables.units import canonical_unit

COMMANDS: Final = {
    "press": "fit-stiffness",
    "rig": "fit-friction",
    "speedloss": "fit-slip",
    "points": "fit-friction --table",
}
SHOWN_RUNS: Final = 8

_NUMBER: Final = r"[-+]?\d+(?:[.,p]\d+)?"


def run(source: ConfigSource, paths: Sequence[Path], kind: str | None = None) -> Summary:
    """Summarise how files, folders, patterns or zip files are read.

    Parameters
    ----------
    source : ConfigSource
        What is already known about the files.
    paths : sequence of Path
        The recordings, inspected one by one.
    kind : str or None
        Kind of the recordings; None derives it from the channels.

    Raises
    ------
    InputError
        If the only file cannot be read at all.
    """
    if len(paths) == 1:
        return _summary(source.config, paths[0], kind)
    parts = []
    for path in paths:
        try:
            parts.append(_summary(source.config, path, kind))
        except InputError as error:
            parts.append(_unreadable(path, error))
    understood = sum(part.exit_status == EXIT_DONE for part in parts)
    return Summary(
        stage="inspect",
        title=f"{len(parts)} recordings",
        parts=tuple(parts),
        notes=tuple(f"{path}: {n}" for path, p in zip(paths, parts, strict=True) for n in p.notes),
        warnings=tuple(w for part in parts for w in part.warnings),
        verdict=f"{understood} of {len(parts)} understood",
        exit_status=EXIT_DONE if understood == len(parts) else EXIT_INPUT,
    )


def _unreadable(path: Path, error: InputError) -> Summary:
    return Summary(
        stage="inspect",
        title=str(path),
        warnings=error.problems,
        verdict=f"cannot be read: {error.problems[0]}",
        exit_status=EXIT_INPUT,
    )


def _summary(config: Config, path: Path, stated: str | None) -> Summary:
    """Summarise how one recording is read."""
    inspection = inspect_recording(path, config, stated)
    kind, runs, problems = inspection.kind, inspection.runs, inspection.problems
    if not problems:
        verdict = f"understood: beltid {COMMANDS[kind]} {path} can read it"
    else:
        verdict = "not yet understood: see what is still missing"
    rows = _channel_rows(inspection)
    bench = f"recording of the {_bench(kind)}" if kind else "recording of an unknown bench"
    return Summary(
        stage="inspect",
        title=f"{path}, {bench}{'' if stated or not kind else ' (guessed)'}",
        facts=_facts(inspection.files, kind, runs),
        table=rows,
        shown=tuple(
            name for name in next(iter(rows), {}) if name != "first"
        ),  # a terminal has 80 columns
        extra_tables={"runs": _run_rows(runs[:SHOWN_RUNS])} if runs else {},
        details={"all runs": _run_rows(runs)} if len(runs) > SHOWN_RUNS else {},
        notes=inspection.notes,
        warnings=problems,
        verdict=verdict,
        exit_status=EXIT_INPUT if problems else EXIT_DONE,
        snippet=_snippet(path, config, inspection),
    )


def _bench(kind: str) -> str:
    return schemas.table(kind).command.removeprefix("the ")


def _facts(views: Sequence[FileView], kind: str, runs: Sequence[RunView]) -> dict[str, Any]:
    facts: dict[str, Any] = {"format": ", ".join(dict.fromkeys(view.format for view in views))}
    if views[0].encoding:
        facts["encoding"] = ", ".join(dict.fromkeys(view.encoding for view in views))
    facts |= {"kind": kind or None, "files": len(views)}
    if not runs:
        return facts
    facts |= {"runs": len(runs), "samples": sum(run.n_samples for run in runs)}
    for name in ("arc_deg", "initial_tension_N"):
        values = sorted({run.settings[name] for run in runs if name in run.settings})
        if values:
            facts[name] = values
    facts["runs_with_gaps"] = sum(1 for run in runs if run.gaps)
    return facts


def _channel_rows(inspection: Inspection) -> list[dict[str, Any]]:
    """Return a row per channel of the first file; groups of equal channels appear once."""
    channels, mappings = inspection.files[0].channels, inspection.mappings.values()
    roles = {m.candidate.qualified: m.role for m in mappings}
    roles |= {m.date.qualified: "date of time_s" for m in mappings if m.date is not None}
    by_name = {qualified.partition("/")[2]: role for qualified, role in roles.items()}
    rows = []
    seen: set[str] = set()
    for channel in channels:
        candidate = channel.candidate
        if candidate.name in seen:
            continue
        seen.add(candidate.name)
        named = (candidate.qualified, candidate.name, candidate.base)
        rows.append(
            {
                "channel": candidate.name,
                "unit": candidate.written or unit_of(candidate) or None,
                "read_as": roles.get(named[0]) or by_name.get(named[1]) or by_name.get(named[2]),
                "samples": channel.n_samples,
                "rate_Hz": finite_or_none(channel.rate_Hz),
                "min": finite_or_none(channel.low),
                "max": finite_or_none(channel.high),
                "first": finite_or_none(channel.first),
                "can_be": ", ".join(inspection.can_be.get(candidate.qualified, ())) or None,
            }
        )
    for name in ("rate_Hz", "can_be", "read_as"):
        if all(row[name] is None for row in rows):
            for row in rows:
                del row[name]
    return rows


def _run_rows(runs: Sequence[RunView]) -> list[dict[str, Any]]:
    return [
        {
            "run": run.label,
            **run.settings,
            "duration_s": run.duration_s,
            "samples": run.n_samples,
            "rate_Hz": finite_or_none(run.rate_Hz),
            "gaps_at_s": list(run.gaps[:5]) or None,
        }
        for run in runs
    ]


def _snippet(path: Path, config: Config, inspection: Inspection) -> str:
    """Return the config section for what was recognised, with comments for what is missing."""
    kind, mappings, lines = inspection.kind, inspection.mappings, []
    if kind and kind != "points":  # a table of plateaus is an argument of the command
        lines += ["data:", f"  {kind}: {_quoted(str(path.absolute()))}"]
    if inspection.rig:
        lines += ["rig:", *(f"  {name}: {word}" for name, word in inspection.rig.items())]
    mapped = {role: r for role, r in mappings.items() if r.how != "own name"}
    if mapped:
        lines += ["columns:", f"  {kind}:"]
        lines += [
            f"    {role}: {_quoted(('-' if r.negated else '') + r.candidate.name)}"
            for role, r in mapped.items()
        ]
    lines += _open_columns(inspection, inside=bool(mapped))
    if kind:
        units = _units(kind, config, mappings)
        if units:
            lines += ["units:", f"  {kind}:"]
            lines += [f"    {role}: {unit}" for role, unit in units.items()]
        lines += _open_units(kind, mappings, inside=bool(units))
        unknown = {c.name for c in schemas.table(kind).columns if c.required} - set(mappings)
        lacks_settings = bool(inspection.problems) and bool(unknown & {*schemas.SETTINGS})
        lines += _runs_lines(kind, config, inspection.files, lacks_settings)
    for problem in dict.fromkeys(inspection.problems):
        lines += [f"# still missing: {problem}"]
    return "\n".join(lines) + "\n"


def _open_columns(inspection: Inspection, *, inside: bool) -> list[str]:
    """Return commented lines for columns without a channel, with the channels that would fit."""
    names = {c.qualified: c.name for c in inspection.files[0].candidates}
    channels_by_role: dict[str, list[str]] = {}
    for qualified, roles in inspection.can_be.items():
        for role in roles:
            channels_by_role.setdefault(role, []).append(names[qualified])
    lines: list[str] = []
    used: set[str] = set()
    for kind in [inspection.kind] if inspection.kind else schemas.RECORDINGS:
        used.clear()
        sensors = set(sensors_of(schemas.table(kind)))
        if not inspection.kind and not (sensors and sensors <= set(channels_by_role)):
            continue
        candidates = [c.name for c in schemas.table(kind).columns if c.name in channels_by_role]
        if candidates and not inside:
            lines += ["# columns:", f"#   {kind}:"]
        for role in candidates:
            channels = list(dict.fromkeys(channels_by_role[role]))
            first = next((name for name in channels if name not in used), channels[0])
            used.add(first)
            others = [name for name in channels if name != first]
            alternatives = f"  # or {', '.join(map(_quoted, others[:5]))}" if others else ""
            lines.append(f"#     {role}: {_quoted(first)}{alternatives}")
    return lines


def _units(kind: str, config: Config, mappings: dict[str, ChannelMapping]) -> dict[str, str]:
    """Return the units stated in the config, else those written in the file."""
    stated = config.units[kind]
    units: dict[str, str] = {}
    for role, mapping in mappings.items():
        setting = stated.get(role)
        if isinstance(setting, dict):
            units[role] = f"{{factor: {setting['factor']!r}, offset: {setting['offset']!r}}}"
        elif setting is not None:
            units[role] = _quoted(setting)
        elif mapping.unit_stated and unit_of(mapping.candidate):
            units[role] = _quoted(canonical_unit(unit_of(mapping.candidate)))
    return units


def _open_units(kind: str, mappings: dict[str, ChannelMapping], *, inside: bool) -> list[str]:
    """Return commented lines with the default units of columns whose units are not stated."""
    lines = [
        f"#     {role}: {_quoted(unit)}  # if correct{', or rpm' if unit == 'rad/s' else ''}"
        for role, mapping in mappings.items()
        if mapping.how == "recognised" and not mapping.unit_stated
        if (unit := schemas.table(kind).column(role).unit)
        if not canonical_unit(unit_of(mapping.candidate)).strip("-")
    ]
    return lines if inside or not lines else ["# units:", f"#   {kind}:", *lines]


def _runs_lines(
    kind: str, config: Config, views: Sequence[FileView], lacks_settings: bool
) -> list[str]:
    """Return the config lines about the runs; a commented pattern if settings are missing."""
    runs = config.runs[kind]
    entries = []
    if runs["pattern"]:
        entries.append(f"    pattern: {_quoted(runs['pattern'])}")
    if runs["table"]:
        entries.append(f"    table: {_quoted(str(runs['table'].absolute()))}")
    for part in ("fields", "values"):
        if runs[part]:
            inside = ", ".join(f"{k}: {_quoted(v)}" for k, v in runs[part].items())
            entries.append(f"    {part}: {{{inside}}}")
    if entries:
        return ["runs:", f"  {kind}:", *entries]
    if lacks_settings:
        pattern = _proposed_pattern([PurePath(view.name).name for view in views], kind)
        if pattern:
            return [
                f"# runs: {{{kind}: {{pattern: {_quoted(pattern)}}}}}  # if this fits the names"
            ]
    return []


def _proposed_pattern(names: Sequence[str], kind: str) -> str:
    """Return a pattern that the names of all files follow; "" if none is obvious."""
    label = schemas.table(kind).label
    pattern = names[0].rsplit(".", 1)[0]
    ending = names[0][len(pattern) :]
    for words, role in (
        (r"(?i:deg|grad|°)", "arc_deg"),
        (r"(?:N|n)", "initial_tension_N"),
        (r"(?:C|degC|°C)", "temperature_degC"),
    ):
        if role in schemas.table(kind).names:
            pattern = re.sub(
                rf"(?<![\w{{]){_NUMBER}(?={words}(?![A-Za-z]))|(?<=_){_NUMBER}(?={words}(?![A-Za-z]))",
                f"{{{role}}}",
                pattern,
                count=1,
            )
    if "{" not in pattern:
        return ""
    first, separator, remainder = pattern.partition("_")
    numbered = re.match(rf"{_NUMBER}(?=[_.-]|$)", remainder)
    if separator and "{" not in first:
        pattern = f"{{{label}}}_{remainder}"
        if numbered and all(name.startswith(first + separator) for name in names):
            pattern = f"{first}_{{{label}}}{remainder[numbered.end() :]}"
    pattern = re.sub(rf"(?<=[_-]){_NUMBER}(?=[_.-]|$)", "{}", pattern) + ending
    compiled = name_pattern(pattern)
    return pattern if all(compiled.values(name) is not None for name in names) else ""


def _quoted(value: Any) -> str:
    if isinstance(value, str) and not re.fullmatch(r"[A-Za-z][\w./-]*", value):
        return json.dumps(value, ensure_ascii=False)
    return str(value)
