"""beltid inspect and init: how the files of a bench are read, and the config that says so."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from beltid.bench.recording import Inspection, inspect_recording, ranges
from beltid.config import Config, ConfigSource, load_config
from beltid.config.loading import SECTIONS, effective_values, format_path, template_text, value_text
from beltid.config.model import KINDS
from beltid.errors import EXIT_DONE, EXIT_INPUT, InputError
from beltid.identify.agreement import SAME_SETTING
from beltid.notes import log
from beltid.report.summary import Summary
from beltid.stages.inputs import nominal_settings
from beltid.store.artifact import plain
from beltid.store.disk import check_place, write_bytes
from beltid.tables import schemas
from beltid.tables.units import canonical_unit

COMMANDS = {"press": "fit-stiffness", "rig": "fit-friction", "speedloss": "fit-slip"}
SHOWN_RUNS = 8
SETTINGS = {
    "rig.arcs_deg": ("arc_deg",),
    "rig.initial_tensions_N": ("initial_tension_N", "weight_N"),
    "rig.pulley_speeds_rad_s": ("pulley_speed_rad_s",),
}
"""List of the config -> columns of a recording that contain it, in the order of `SAME_SETTING`."""
MOST_SETTINGS = 30  # number of values above which every run has its own setting


def run(source: ConfigSource, paths: Sequence[Path], kind: str | None = None) -> Summary:
    """Summarise how files, folders, patterns or zip files are read."""
    parts = []
    for path in paths:
        try:
            parts.append(_summary(source.config, path, kind))
        except InputError as error:
            if len(paths) == 1:
                raise
            unread = Summary("inspect", str(path), warnings=error.problems, exit_status=EXIT_INPUT)
            parts.append(replace(unread, verdict=f"cannot be read: {error.problems[0]}"))
    if len(parts) == 1:
        return parts[0]
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
    bench = "an unknown bench"
    if kind:
        bench = schemas.table(kind).command + ("" if stated else " (guessed)")
    rows = _channel_rows(inspection)
    tables = {"runs": runs[:SHOWN_RUNS], "all runs": runs if len(runs) > SHOWN_RUNS else []}
    return Summary(
        stage="inspect",
        title=f"{path}, recording of {bench}",
        facts=_facts(inspection),
        table=rows,
        shown=tuple(n for n in next(iter(rows), {}) if n != "first"),  # terminals have 80 columns
        details={name: rows for name, rows in tables.items() if rows},
        always=("runs",) if runs else (),
        notes=inspection.notes,
        warnings=problems,
        verdict=verdict,
        exit_status=EXIT_INPUT if problems else EXIT_DONE,
        snippet=_snippet(path, config, inspection),
    )


def _facts(inspection: Inspection) -> dict[str, Any]:
    first, runs = inspection.tables[0], inspection.runs
    facts: dict[str, Any] = {
        "format": first.format,
        **({"encoding": first.encoding} if first.encoding else {}),
        "kind": inspection.kind or None,
        "files": len(inspection.names),
    }
    if not runs:
        return facts
    settings = {
        name: sorted({run[name] for run in runs if name in run})
        for name in ("arc_deg", "initial_tension_N")
    }
    return facts | {
        "runs": len(runs),
        "samples": sum(run["samples"] for run in runs),
        **{name: values for name, values in settings.items() if values},
        "runs_with_gaps": sum(1 for run in runs if run["gaps_at_s"]),
    }


def _channel_rows(inspection: Inspection) -> list[dict[str, Any]]:
    """Return a row per channel of the first file; groups of equal channels appear once."""
    roles = {match.channel.base: match.role for match in inspection.found.values()}
    rows: dict[str, dict[str, Any]] = {}
    for channel in inspection.channels:
        if channel.name not in rows:
            rows[channel.name] = {
                "channel": channel.name,
                "unit": channel.written or channel.unit or None,
                "read_as": roles.get(channel.base),
                **plain(ranges(channel)),
            }
    empty = [n for n in ("rate_Hz", "read_as") if not any(r[n] for r in rows.values())]
    return [{n: v for n, v in row.items() if n not in empty} for row in rows.values()]


def _snippet(path: Path, config: Config, inspection: Inspection) -> str:
    """Return the config section for what was recognised, with comments for what is missing."""
    lines = list[str]()
    if inspection.kind:
        lines += ["data:", f"  {inspection.kind}: {value_text(path.absolute())}"]
    if inspection.rig:
        lines += ["rig:", *(f"  {name}: {word}" for name, word in inspection.rig.items())]
    lines += section_lines([inspection], config)
    lines += [f"# still missing: {problem}" for problem in dict.fromkeys(inspection.problems)]
    return "\n".join(lines) + "\n"


def section_lines(inspections: Sequence[Inspection], config: Config) -> list[str]:
    """Return the config sections about files, kind by kind; without an entry they are comments."""
    lines = []
    for name, entries in (("columns", _columns), ("units", _units), ("runs", _runs)):
        stated = {i.kind: of for i in inspections if i.kind and (of := entries(i, config))}
        mark = "# " if all(line[0] == "#" for of in stated.values() for line in of) else ""
        lines += [f"{mark}{name}:"] if stated else []
        for kind, of in stated.items():
            lines += [f"{mark}  {kind}:", *of]
    return lines


def _columns(inspection: Inspection, config: Config) -> list[str]:
    return [
        f"    {role}: {value_text('-' * match.negated + match.channel.name)}"
        + ("  # recognised by its name" if match.how == "recognised" else "")
        for role, match in inspection.found.items()
        if match.how != "own name"
    ]


def _units(inspection: Inspection, config: Config) -> list[str]:
    """Return the units of the config, else of the file; the others, by default, as comments."""
    lines, comments, stated = list[str](), list[str](), config.units[inspection.kind]
    columns = {
        c.name: c for kind in ("points", inspection.kind) for c in schemas.table(kind).columns
    }
    for role, match in inspection.found.items():
        if unit := stated.get(role) or (match.stated and canonical_unit(match.channel.unit)):
            lines.append(f"    {role}: {value_text(unit)}")
        ours = columns[role].unit
        is_open = not match.stated and not canonical_unit(match.channel.unit).strip("-")
        if match.how == "recognised" and is_open and ours:
            correct = "correct, or rpm" if ours == "rad/s" else "correct"
            comments.append(f"#     {role}: {value_text(ours)}  # if {correct}")
    return lines + comments


def _runs(inspection: Inspection, config: Config) -> list[str]:
    """Return the entries about the runs, with a guess of init."""
    stated = config.runs[inspection.kind]
    entries = [f"    {key}: {value_text(value)}" for key, value in stated.items() if value]
    if inspection.pattern:
        pattern = value_text(inspection.pattern)
        entries.append(f"    pattern: {pattern}  # guessed from the file names")
    return entries


def new_config(
    name: str, files: Sequence[Path], out: Path | None, *, force: bool = False
) -> Summary:
    """Write the config of a new belt."""
    path, values = out or Path(f"{name}.yaml"), dict[str, Any]({"belt.name": name})
    if match := re.fullmatch(r"(\d{1,2})p[hjklm]", name, re.IGNORECASE):
        values |= {"belt.type": name.upper(), "belt.ribs": int(match[1])}
    sources = dict.fromkeys(values, "from the name")
    _config(values)  # checks the name
    check_place(
        path, (".yaml", ".yml"), inputs={f"recording {file}": file for file in files}, force=force
    )
    problems, inspections = list[str](), list[Inspection]()
    for file in files:
        try:
            inspections.append(_inspected(file))
        except InputError as error:
            problems += error.problems
            continue
        key, found = f"data.{inspections[-1].kind}", _stated_by(inspections[-1])
        if key in values:
            problems.append(f"{file}: a second recording for {key}, beside {values[key]}")
        values |= {key: Path(os.path.relpath(file, path.parent)).as_posix(), **found}
        sources |= {key: "recognised by its channels", **dict.fromkeys(found, f"from {file}")}
    if problems:
        raise InputError(problems)
    config = _config(values)
    lines = [template_text(config, sources), *section_lines(inspections, Config()), ""]
    write_bytes(path, "\n".join(lines).encode())
    rows = [
        {"key": key, "value": plain(value), "origin": sources.get(key, "default")}
        for place, value, _ in effective_values(config)
        if place[0] in SECTIONS and (key := format_path(place))
    ]
    return Summary(
        stage="init",
        title=f"config of the belt {config.belt.name}",
        out=path,
        facts={"stated": len(sources), "defaults": len(rows) - len(sources)},
        table=rows,
        overview=[row for row in rows if row["key"] in sources],
        origin=config.data.origin,
    )


def _inspected(file: Path) -> Inspection:
    """Inspect a recording, whose kind must be one that a config names; warn of what is missing."""
    inspection = inspect_recording(file, Config(), guess=True)
    if not inspection.kind:
        raise InputError(
            f"{file}: of an unknown bench, must be {', '.join(KINDS)}; see `beltid inspect {file}`"
        )
    for line in inspection.problems[:1]:
        log.warning(
            "data.%s: %s; `beltid inspect %s` lists everything that must be stated",
            *(inspection.kind, line, file),
        )
    return inspection


def _stated_by(inspection: Inspection) -> dict[str, Any]:
    """Return what a recording of the rig states by config key: holds, arcs, tensions, speeds."""
    if inspection.kind != "rig":
        return {}
    values: dict[str, Any] = {f"rig.{name}": word for name, word in inspection.rig.items()}
    for (key, columns), gap in zip(SETTINGS.items(), SAME_SETTING.values(), strict=True):
        recorded = [run[c] for run in inspection.runs for c in columns if c in run]
        settings = sorted(
            {float(f"{value:.4g}") for value in nominal_settings(np.array(recorded), gap)}
        )
        if 0 < len(settings) <= MOST_SETTINGS:
            values[key] = settings
    return values


def _config(values: Mapping[str, Any]) -> Config:
    sections: dict[str, dict[str, Any]] = {}
    for key, value in values.items():
        section, _, name = key.partition(".")
        sections.setdefault(section, {})[name] = value
    return load_config(sections)
