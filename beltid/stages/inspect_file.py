"""beltid inspect: what is understood of a bench's files, and the config section that says so."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, Final

import numpy as np

from beltid.bench.channels.channel_mapping import ChannelMapping, unit_of
from beltid.bench.inspection import FileView, RunView, inspect_recording
from beltid.config import ConfigSource
from beltid.config.name_pattern import name_pattern
from beltid.errors import EXIT_DONE, EXIT_INPUT
from beltid.report.summary import Summary
from beltid.stages.reporter import Options
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


@dataclass(frozen=True, slots=True)
class InspectOptions(Options):
    """Options of an inspection.

    Attributes
    ----------
    kind : str or None
        What it is a recording of; None: found out from the channels.
    """

    kind: str | None = None


def run(source: ConfigSource, path: Path, options: InspectOptions) -> Summary:
    """Say what is understood of a file, folder, pattern or zip file.

    Parameters
    ----------
    source : ConfigSource
        What is known about the files already.
    path : Path
        The file or files.
    options : InspectOptions
        The kind of recording, if it is stated.

    Raises
    ------
    InputError
        If a file cannot be read at all, or its kind cannot be found out.
    """
    config = source.config
    found = inspect_recording(path, config, options.kind)
    kind, views, mappings = found.kind, found.files, found.mappings
    runs, problems, understood = found.runs, found.problems, not found.problems
    if understood:
        verdict = f"understood: beltid {COMMANDS[kind]} {path} can read it"
    else:
        verdict = "not yet understood: see what is still to be told"
    return Summary(
        stage="inspect",
        title=f"{path}, recording of the {_bench(kind)}{'' if options.kind else ' (guessed)'}",
        facts=_facts(views, kind, runs),
        table=_channel_rows(views[0], mappings, kind),
        beside={"runs": _run_rows(runs[:SHOWN_RUNS])} if runs else {},
        details={"all runs": _run_rows(runs)} if len(runs) > SHOWN_RUNS else {},
        notes=found.notes,
        warnings=problems,
        verdict=verdict,
        exit_status=EXIT_DONE if understood else EXIT_INPUT,
        snippet=_snippet(path, kind, config, mappings, problems, views, found.rig),
    )


def _bench(kind: str) -> str:
    return schemas.table(kind).command.removeprefix("the ")


def _facts(views: Sequence[FileView], kind: str, runs: Sequence[RunView]) -> dict[str, Any]:
    facts: dict[str, Any] = {"format": ", ".join(dict.fromkeys(view.format for view in views))}
    if views[0].encoding:
        facts["encoding"] = ", ".join(dict.fromkeys(view.encoding for view in views))
    facts |= {"kind": kind, "files": len(views)}
    if not runs:
        return facts
    facts |= {"runs": len(runs), "samples": sum(run.n_samples for run in runs)}
    for name in ("arc_deg", "initial_tension_N"):
        values = sorted({run.settings[name] for run in runs if name in run.settings})
        if values:
            facts[name] = values
    facts["runs_with_gaps"] = sum(1 for run in runs if run.gaps)
    return facts


def _channel_rows(
    view: FileView, mappings: dict[str, ChannelMapping], kind: str
) -> list[dict[str, Any]]:
    """A row per channel of the first file; groups of equal channels once."""
    roles = {(r.candidate.name, r.candidate.group): role for role, r in mappings.items()}
    by_name = {r.candidate.name: role for role, r in mappings.items()}
    names = [channel.candidate.name for channel in view.channels]
    repeated = len(set(names)) < len(names)
    rows = []
    seen: set[str] = set()
    for channel in view.channels:
        name = channel.candidate.name
        if repeated and name in seen:
            continue
        seen.add(name)
        rows.append(
            {
                "channel": name,
                "unit": unit_of(channel.candidate) or None,
                "read_as": roles.get((name, channel.candidate.group)) or by_name.get(name),
                "samples": channel.n_samples,
                "rate_Hz": _plain(channel.rate_Hz),
                "min": _plain(channel.low),
                "max": _plain(channel.high),
                "first": _plain(channel.first),
            }
        )
    if all(row["rate_Hz"] is None for row in rows):
        for row in rows:
            del row["rate_Hz"]
    return rows


def _plain(value: float) -> float | None:
    return None if np.isnan(value) else value


def _run_rows(runs: Sequence[RunView]) -> list[dict[str, Any]]:
    return [
        {
            "run": run.label,
            **run.settings,
            "duration_s": run.duration_s,
            "samples": run.n_samples,
            "rate_Hz": _plain(run.rate_Hz),
            "gaps_at_s": list(run.gaps[:5]) or None,
        }
        for run in runs
    ]


def _snippet(
    path: Path,
    kind: str,
    config: Any,
    mappings: dict[str, ChannelMapping],
    problems: Sequence[str],
    views: Sequence[FileView],
    rig: Mapping[str, str],
) -> str:
    """A section of a config that says what was understood, with what is still to be told."""
    lines = []
    if kind != "points":  # a table is named to the command
        lines += ["data:", f"  {kind}: {_quoted(str(path.absolute()))}"]
    if rig:
        lines += ["rig:", *(f"  {name}: {word}" for name, word in rig.items())]
    own = {role: r for role, r in mappings.items() if r.how != "own name"}
    if own:
        lines += ["columns:", f"  {kind}:"]
        lines += [
            f"    {role}: {_quoted(('-' if r.negated else '') + r.candidate.name)}"
            for role, r in own.items()
        ]
    units = _units(kind, config, mappings)
    if units:
        lines += ["units:", f"  {kind}:", *(f"    {role}: {unit}" for role, unit in units.items())]
    untold = {c.name for c in schemas.table(kind).columns if c.required} - set(mappings)
    lines += _runs_lines(kind, config, views, bool(problems) and bool(untold & {*schemas.SETTINGS}))
    for problem in dict.fromkeys(problems):
        lines += [f"# still to be told: {problem}"]
    return "\n".join(lines) + "\n"


def _units(kind: str, config: Any, mappings: dict[str, ChannelMapping]) -> dict[str, str]:
    """Units as stated by the config, else as the file writes them."""
    stated = config.units.of(kind)
    units: dict[str, str] = {}
    for role, mapping in mappings.items():
        setting = stated.get(role)
        if isinstance(setting, Calibration):
            units[role] = f"{{factor: {setting.factor!r}, offset: {setting.offset!r}}}"
        elif setting is not None:
            units[role] = _quoted(setting)
        elif mapping.unit_stated and unit_of(mapping.candidate):
            units[role] = _quoted(canonical_unit(unit_of(mapping.candidate)))
    return units


def _runs_lines(kind: str, config: Any, views: Sequence[FileView], untold: bool) -> list[str]:
    """What the config says about the runs; a pattern for settings untold, as a comment."""
    runs = config.runs.of(kind)
    said = []
    if runs.pattern:
        said.append(f"    pattern: {_quoted(runs.pattern)}")
    if runs.table is not None:
        said.append(f"    table: {_quoted(str(runs.table.absolute()))}")
    for part in ("fields", "values"):
        stated = getattr(runs, part).model_dump(exclude_none=True)
        if stated:
            inside = ", ".join(f"{k}: {_quoted(v)}" for k, v in stated.items())
            said.append(f"    {part}: {{{inside}}}")
    if said:
        return ["runs:", f"  {kind}:", *said]
    if untold:
        pattern = _proposed_pattern([PurePath(view.name).name for view in views], kind)
        if pattern:
            return [f"# runs: {{{kind}: {{pattern: {_quoted(pattern)}}}}}  # if the names say so"]
    return []


def _proposed_pattern(names: Sequence[str], kind: str) -> str:
    """A pattern that the names of all files follow; "" if none is plain to see."""
    label = schemas.table(kind).label
    pattern = names[0].rsplit(".", 1)[0]
    ending = names[0][len(pattern) :]
    for words, role in (
        (r"(?:deg|grad|°)", "arc_deg"),
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
    first, mark, rest = pattern.partition("_")
    if mark and "{" not in first:
        pattern = f"{{{label}}}_{rest}"
    pattern = re.sub(rf"(?<=[_-]){_NUMBER}(?=[_.-]|$)", "{}", pattern) + ending
    compiled = name_pattern(pattern)
    return pattern if all(compiled.values(name) is not None for name in names) else ""


def _quoted(value: Any) -> str:
    if isinstance(value, str) and not re.fullmatch(r"[A-Za-z][\w./-]*", value):
        return json.dumps(value, ensure_ascii=False)
    return str(value)
