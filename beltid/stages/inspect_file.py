"""beltid inspect: show how the files of a bench are read, and the matching config section."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from beltid.bench.inspection import Inspection, RunView, inspect_recording, ranges
from beltid.config import Config, ConfigSource
from beltid.errors import EXIT_DONE, EXIT_INPUT, InputError
from beltid.report.summary import Summary
from beltid.stages.columns import finite_or_none
from beltid.stages.file_sections import file_sections, quoted, section_lines
from beltid.tables import schemas

COMMANDS: Final = {
    "press": "fit-stiffness",
    "rig": "fit-friction",
    "speedloss": "fit-slip",
}
SHOWN_RUNS: Final = 8


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
        }
    for name in ("rate_Hz", "read_as"):
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
    if kind:
        lines += ["data:", f"  {kind}: {quoted(str(path.absolute()))}"]
    if inspection.rig:
        lines += ["rig:", *(f"  {name}: {word}" for name, word in inspection.rig.items())]
    lines += section_lines({kind: file_sections(inspection, config)})
    lines += [f"# still missing: {problem}" for problem in dict.fromkeys(inspection.problems)]
    return "\n".join(lines) + "\n"
