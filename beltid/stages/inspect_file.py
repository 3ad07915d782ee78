"""beltid inspect: show how the files of a bench are read, and the matching config section."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from beltid.bench.inspection import Inspection, RunView, inspect_recording, ranges
from beltid.bench.options import ReadOptions
from beltid.config import Config, ConfigSource
from beltid.config.writing import value_text
from beltid.errors import EXIT_DONE, EXIT_INPUT, InputError
from beltid.report.summary import Summary
from beltid.stages.columns import finite_or_none
from beltid.tables import schemas
from beltid.tables.units import Calibration, canonical_unit

COMMANDS: Final = {"press": "fit-stiffness", "rig": "fit-friction", "speedloss": "fit-slip"}
SHOWN_RUNS: Final = 8
Sections = dict[str, dict[str, list[str]]]
"""Section of a config -> kind of recording -> its lines."""


def run(source: ConfigSource, paths: Sequence[Path], kind: str | None = None) -> Summary:
    """Summarise how files, folders, patterns or zip files are read."""
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
    bench = schemas.table(kind).command if kind else "an unknown bench"
    guessed = "" if stated or not kind else " (guessed)"
    rows = _channel_rows(inspection)
    return Summary(
        stage="inspect",
        title=f"{path}, recording of {bench}{guessed}",
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
    encoding = {"encoding": first.encoding} if first.encoding else {}
    facts: dict[str, Any] = {"format": first.format, **encoding, "kind": inspection.kind or None}
    facts["files"] = len(inspection.names)
    if not runs:
        return facts
    facts |= {"runs": len(runs), "samples": sum(run.n_samples for run in runs)}
    for name in ("arc_deg", "initial_tension_N"):
        if values := sorted({run.settings[name] for run in runs if name in run.settings}):
            facts[name] = values
    return facts | {"runs_with_gaps": sum(1 for run in runs if run.gaps)}


def _channel_rows(inspection: Inspection) -> list[dict[str, Any]]:
    """Return a row per channel of the first file; groups of equal channels appear once."""
    found = inspection.found.values()
    roles = {match.channel.base: match.role for match in found}
    roles |= {m.date.base: "date of time_s" for m in found if m.date is not None}
    rows: dict[str, dict[str, Any]] = {}
    for channel in inspection.channels:
        if channel.name not in rows:
            rows[channel.name] = {
                "channel": channel.name,
                "unit": channel.written or channel.unit or None,
                "read_as": roles.get(channel.base),
                "samples": len(channel.raw.frame),
                **{name: finite_or_none(value) for name, value in ranges(channel).items()},
            }
    empty = [n for n in ("rate_Hz", "read_as") if not any(r[n] for r in rows.values())]
    return [{n: v for n, v in row.items() if n not in empty} for row in rows.values()]


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
    if kind:
        lines += ["data:", f"  {kind}: {value_text(path.absolute())}"]
    if inspection.rig:
        lines += ["rig:", *(f"  {name}: {word}" for name, word in inspection.rig.items())]
    lines += section_lines([file_sections(inspection, config)])
    lines += [f"# still missing: {problem}" for problem in dict.fromkeys(inspection.problems)]
    return "\n".join(lines) + "\n"


def section_lines(of_files: Sequence[Sections]) -> list[str]:
    """Return the config sections about files, kind by kind; without an entry they are comments."""
    lines = []
    for name in ("columns", "units", "runs"):
        stated = {kind: of for found in of_files for kind, of in found.get(name, {}).items() if of}
        mark = "# " if all(line[0] == "#" for of in stated.values() for line in of) else ""
        lines += [f"{mark}{name}:"] if stated else []
        for kind, of in stated.items():
            lines += [f"{mark}  {kind}:", *of]
    return lines


def file_sections(inspection: Inspection, config: Config) -> Sections:
    """Return the entries of columns, units and runs that read these files."""
    kind, found = inspection.kind, inspection.found
    if not kind:
        return {}
    columns = [
        f"    {role}: {value_text('-' * match.negated + match.channel.name)}"
        + ("  # recognised by its name" if match.how == "recognised" else "")
        for role, match in found.items()
        if match.how != "own name"
    ]
    options = ReadOptions.of(config, kind)
    return {
        "columns": {kind: columns},
        "units": {kind: _units(inspection, options.units)},
        "runs": {kind: _runs(inspection, options)},
    }


def _units(inspection: Inspection, stated: Mapping[str, Any]) -> list[str]:
    """Return the units of the config, else of the file; the others, by default, as comments."""
    lines, comments = [], []
    for role, match in inspection.found.items():
        unit = stated.get(role)
        if isinstance(unit, Calibration):
            unit = {"factor": unit.factor, "offset": unit.offset}
        if unit is not None:
            lines.append(f"    {role}: {value_text(unit)}")
        elif match.stated and match.channel.unit:
            lines.append(f"    {role}: {value_text(canonical_unit(match.channel.unit))}")
        ours = schemas.table(inspection.kind).column(role).unit
        open_unit = not match.stated and not canonical_unit(match.channel.unit).strip("-")
        if match.how == "recognised" and open_unit and ours:
            rpm = ", or rpm" if ours == "rad/s" else ""
            comments.append(f"#     {role}: {value_text(ours)}  # if correct{rpm}")
    return lines + comments


def _runs(inspection: Inspection, options: ReadOptions) -> list[str]:
    """Return the entries about the runs; a commented pattern if settings are missing."""
    entries = list[str]()
    if options.pattern:
        entries.append(f"    pattern: {value_text(options.pattern)}")
    if options.run_table is not None:
        entries.append(f"    table: {value_text(options.run_table.absolute())}")
    if options.values:
        entries.append(f"    values: {value_text(dict(options.values))}")
    if inspection.pattern:
        how = "    {} # guessed from the file names" if inspection.runs else "#     {} # if it fits"
        entries.append(how.format(f"pattern: {value_text(inspection.pattern)} "))
    return entries
