"""beltid inspect: show how the files of a bench are read, and the matching config section."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path, PurePath
from typing import Any, Final

from beltid.bench.inspection import Inspection, RunView, inspect_recording, ranges
from beltid.bench.mapping import sensors_of
from beltid.bench.options import ReadOptions
from beltid.config import Config, ConfigSource
from beltid.config.name_pattern import name_pattern
from beltid.errors import EXIT_DONE, EXIT_INPUT, InputError
from beltid.report.summary import Summary
from beltid.stages.outcome import finite_or_none
from beltid.tables import schemas
from beltid.tables.units import Calibration, canonical_unit

COMMANDS: Final = {
    "press": "fit-stiffness",
    "rig": "fit-friction",
    "speedloss": "fit-slip",
    "points": "fit-friction --table",
}
SHOWN_RUNS: Final = 8
_NUMBER: Final = r"[-+]?\d+(?:[.,p]\d+)?"
Lines = dict[str, list[str]]


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
            parts.append(
                Summary(
                    stage="inspect",
                    title=str(path),
                    warnings=error.problems,
                    verdict=f"cannot be read: {error.problems[0]}",
                    exit_status=EXIT_INPUT,
                )
            )
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


def _summary(config: Config, path: Path, stated: str | None) -> Summary:
    """Summarise how one recording is read."""
    inspection = inspect_recording(path, config, stated)
    kind, runs, problems = inspection.kind, inspection.runs, inspection.problems
    verdict = "not yet understood: see what is still missing"
    if not problems:
        verdict = f"understood: beltid {COMMANDS[kind]} {path} can read it"
    bench = schemas.table(kind).command.removeprefix("the ") if kind else "an unknown bench"
    rows = _channel_rows(inspection)
    guessed = "" if stated or not kind else " (guessed)"
    return Summary(
        stage="inspect",
        title=f"{path}, recording of {'the ' if kind else ''}{bench}{guessed}",
        facts=_facts(inspection),
        table=rows,
        shown=tuple(n for n in next(iter(rows), {}) if n != "first"),  # terminals have 80 columns
        extra_tables={"runs": _run_rows(runs[:SHOWN_RUNS])} if runs else {},
        details={"all runs": _run_rows(runs)} if len(runs) > SHOWN_RUNS else {},
        notes=inspection.notes,
        warnings=problems,
        verdict=verdict,
        exit_status=EXIT_INPUT if problems else EXIT_DONE,
        snippet=_snippet(path, config, inspection),
    )


def _facts(inspection: Inspection) -> dict[str, Any]:
    first, runs = inspection.tables[0], inspection.runs
    facts: dict[str, Any] = {"format": first.format}
    if first.encoding:
        facts["encoding"] = first.encoding
    facts |= {"kind": inspection.kind or None, "files": len(inspection.names)}
    if not runs:
        return facts
    facts |= {"runs": len(runs), "samples": sum(run.n_samples for run in runs)}
    for name in ("arc_deg", "initial_tension_N"):
        values = sorted({run.settings[name] for run in runs if name in run.settings})
        if values:
            facts[name] = values
    return facts | {"runs_with_gaps": sum(1 for run in runs if run.gaps)}


def _channel_rows(inspection: Inspection) -> list[dict[str, Any]]:
    """Return a row per channel of the first file; groups of equal channels appear once."""
    found = inspection.found.values()
    roles = {match.channel.base: match.role for match in found}
    roles |= {m.date.base: "date of time_s" for m in found if m.date is not None}
    rows: dict[str, dict[str, Any]] = {}
    for channel in inspection.channels:
        if channel.name in rows:
            continue
        span = ranges(channel)
        rows[channel.name] = {
            "channel": channel.name,
            "unit": channel.written or channel.unit or None,
            "read_as": roles.get(channel.base),
            "samples": len(channel.raw.frame),
            **{name: finite_or_none(value) for name, value in span.items()},
            "can_be": ", ".join(inspection.can_be.get(channel.qualified, ())) or None,
        }
    for name in ("rate_Hz", "can_be", "read_as"):
        if all(row[name] is None for row in rows.values()):
            for row in rows.values():
                del row[name]
    return list(rows.values())


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
    kind, lines = inspection.kind, list[str]()
    if kind and kind != "points":  # a table of plateaus is an argument of the command
        lines += ["data:", f"  {kind}: {_quoted(str(path.absolute()))}"]
    if inspection.rig:
        lines += ["rig:", *(f"  {name}: {word}" for name, word in inspection.rig.items())]
    lines += section_lines({kind: file_sections(inspection, config)})
    lines += [f"# still missing: {problem}" for problem in dict.fromkeys(inspection.problems)]
    return "\n".join(lines) + "\n"


def section_lines(by_kind: dict[str, dict[str, Lines]]) -> list[str]:
    """Return the config sections about files, kind by kind; without an entry they are comments."""
    lines = []
    for name in ("columns", "units", "runs"):
        parts = {k: found[name] for k, found in by_kind.items() if found.get(name)}
        for of_kind in parts.values():
            lines += [line for kind, entries in of_kind.items() if not kind for line in entries]
        stated = {
            kind: entries for part in parts.values() for kind, entries in part.items() if kind
        }
        is_open = all(line[0] == "#" for entries in stated.values() for line in entries)
        mark = "# " if is_open else ""
        lines += [f"{mark}{name}:"] if stated else []
        for kind, entries in stated.items():
            lines += [f"{mark}  {kind}:", *entries]
    return lines


def file_sections(inspection: Inspection, config: Config) -> dict[str, Lines]:
    """Return the entries of columns, units and runs that read these files, by section and kind."""
    kind, found = inspection.kind, inspection.found
    columns = {
        role: _quoted(("-" if match.negated else "") + match.channel.name)
        + ("  # recognised by its name" if match.how == "recognised" else "")
        for role, match in found.items()
        if match.how != "own name"
    }
    sections = {"columns": {kind: [f"    {role}: {name}" for role, name in columns.items()]}}
    for other, lines in _open_columns(inspection).items():
        sections["columns"].setdefault(other, []).extend(lines)
    if kind:
        options = ReadOptions.of(config, kind)
        units = _units(inspection, options)
        sections["units"] = {kind: [f"    {role}: {unit}" for role, unit in units.items()]}
        sections["units"][kind] += _open_units(inspection)
        sections["runs"] = _runs(inspection, options)
    return {
        name: {k: lines for k, lines in by_kind.items() if lines}
        for name, by_kind in sections.items()
    }


def _open_columns(inspection: Inspection) -> Lines:
    """Return commented entries for columns without a channel, with the channels that would fit."""
    names = {c.qualified: c.name for c in inspection.channels}
    fitting: dict[str, list[str]] = {}
    for qualified, roles in inspection.can_be.items():
        for role in roles:
            fitting.setdefault(role, []).append(names[qualified])
    found: Lines = {}
    for kind in [inspection.kind] if inspection.kind else schemas.RECORDINGS:
        sensors, used = {*sensors_of(schemas.table(kind))}, set[str]()
        if not inspection.kind and not (sensors and sensors <= {*fitting}):
            continue
        for role in (c.name for c in schemas.table(kind).columns if c.name in fitting):
            channels = list(dict.fromkeys(fitting[role]))
            first = next((name for name in channels if name not in used), channels[0])
            used.add(first)
            others = [_quoted(name) for name in channels if name != first][:5]
            alternatives = f"  # or {', '.join(others)}" if others else ""
            found.setdefault(kind, []).append(f"#     {role}: {_quoted(first)}{alternatives}")
    return found


def _units(inspection: Inspection, options: ReadOptions) -> dict[str, str]:
    """Return the units stated in the config, else those written in the file."""
    units: dict[str, str] = {}
    for role, match in inspection.found.items():
        stated = options.units.get(role)
        if isinstance(stated, Calibration):
            units[role] = f"{{factor: {stated.factor!r}, offset: {stated.offset!r}}}"
        elif stated is not None:
            units[role] = _quoted(stated)
        elif match.stated and match.channel.unit:
            units[role] = _quoted(canonical_unit(match.channel.unit))
    return units


def _open_units(inspection: Inspection) -> list[str]:
    """Return commented entries with the default units of columns whose units are not stated."""
    table = schemas.table(inspection.kind)
    return [
        f"#     {role}: {_quoted(unit)}  # if correct{', or rpm' if unit == 'rad/s' else ''}"
        for role, match in inspection.found.items()
        if match.how == "recognised" and not match.stated and (unit := table.column(role).unit)
        if not canonical_unit(match.channel.unit).strip("-")
    ]


def _runs(inspection: Inspection, options: ReadOptions) -> Lines:
    """Return the entries about the runs; a commented pattern if settings are missing."""
    kind, entries = inspection.kind, list[str]()
    if options.pattern:
        entries.append(f"    pattern: {_quoted(options.pattern)}")
    if options.run_table is not None:
        entries.append(f"    table: {_quoted(str(options.run_table.absolute()))}")
    if options.values:
        inside = ", ".join(f"{k}: {_quoted(v)}" for k, v in options.values.items())
        entries.append(f"    values: {{{inside}}}")
    required = {c.name for c in schemas.table(kind).columns if c.required}
    lacking = (required - {*inspection.found}) & {*schemas.SETTINGS}
    if not entries and inspection.problems and lacking:
        pattern = _proposed_pattern([PurePath(name).name for name in inspection.names], kind)
        if pattern:
            entries = [f"#     pattern: {_quoted(pattern)}  # if this fits the names"]
    return {kind: entries}


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
            unit = rf"{_NUMBER}(?={words}(?![A-Za-z]))"
            places = rf"(?<![\w{{]){unit}|(?<=_){unit}"
            pattern = re.sub(places, f"{{{role}}}", pattern, count=1)
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
