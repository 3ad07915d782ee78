"""beltid init: write a commented config for a new belt."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.bench.inspection import Inspection, RunView, inspect_recording
from beltid.config import Config, load_config
from beltid.config.layout import KINDS
from beltid.config.loading import effective_values
from beltid.config.source import format_path
from beltid.config.writing import SECTIONS, template_text
from beltid.errors import InputError
from beltid.identify.agreement.compare import SAME_SETTING
from beltid.notes import log
from beltid.report.summary import Summary
from beltid.stages.inspect_file import file_sections, section_lines
from beltid.stages.planned_runs import nominal_settings
from beltid.store.artifact import plain
from beltid.store.disk import write_text
from beltid.store.place import anyone_s, check_place

SETTINGS: Final = {
    "rig.arcs_deg": (("arc_deg",), SAME_SETTING["arc_deg"]),
    "rig.initial_tensions_N": (
        ("initial_tension_N", "weight_N"),
        SAME_SETTING["nominal_tension_N"],
    ),
    "rig.pulley_speeds_rad_s": (("pulley_speed_rad_s",), SAME_SETTING["pulley_speed_rad_s"]),
}
"""List of the config -> columns of a recording that contain it, relative gap of one setting."""
MOST_SETTINGS: Final = 30
"""Number of values above which every run is assumed to have its own setting."""


def run(name: str, files: Sequence[Path], out: Path | None, *, force: bool = False) -> Summary:
    """Write the config of a new belt."""
    path, values = out or Path(f"{name}.yaml"), _of_name(name)
    sources = dict.fromkeys(values, "from the name")
    _config(values)  # checks the name
    recordings = {f"recording {file}": file for file in files}
    check_place(path, (".yaml", ".yml"), anyone_s, inputs=recordings, force=force)
    problems, sections = list[str](), []
    for file in files:
        try:
            inspection = _inspected(file)
        except InputError as error:
            problems += error.problems
            continue
        key, found = f"data.{inspection.kind}", _stated_by(inspection)
        if key in values:
            problems.append(f"{file}: a second recording for {key}, beside {values[key]}")
        values |= {key: Path(os.path.relpath(file, path.parent)).as_posix(), **found}
        sources |= {key: "recognised by its channels", **dict.fromkeys(found, f"from {file}")}
        sections.append(file_sections(inspection, Config()))
    if problems:
        raise InputError(problems)
    config = _config(values)
    write_text(path, "\n".join([template_text(config, sources), *section_lines(sections), ""]))
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


def _of_name(name: str) -> dict[str, Any]:
    """Return the values that follow from a name: 6pk is a 6PK with six ribs."""
    match = re.fullmatch(r"(\d{1,2})p[hjklm]", name, re.IGNORECASE)
    more = {"belt.type": name.upper(), "belt.ribs": int(match[1])} if match else {}
    return {"belt.name": name, **more}


def _inspected(file: Path) -> Inspection:
    """Inspect a recording, whose kind must be one that a config names; warn of what is missing."""
    inspection = inspect_recording(file, Config(), guess=True)
    if not inspection.kind:
        raise InputError(
            f"{file}: recording of an unknown bench, must be of {', '.join(KINDS)}; "
            f"`beltid inspect {file}` shows its channels"
        )
    for line in inspection.problems[:1]:
        more = f"`beltid inspect {file}` lists everything that must be stated"
        log.warning("data.%s: %s; %s", inspection.kind, line, more)
    return inspection


def _stated_by(inspection: Inspection) -> dict[str, Any]:
    """Return what a recording of the rig states by config key: its kind and its settings."""
    if inspection.kind != "rig":
        return {}
    return {f"rig.{name}": word for name, word in inspection.rig.items()} | _settings(
        inspection.runs
    )


def _settings(runs: Sequence[RunView]) -> dict[str, list[float]]:
    """Return arcs, tensions and speeds of the runs of a rig, by config key."""
    values = {}
    for key, (columns, gap) in SETTINGS.items():
        recorded = [run.settings[c] for run in runs for c in columns if c in run.settings]
        snapped = nominal_settings(np.array(recorded), gap)
        settings = sorted({float(f"{value:.4g}") for value in snapped})
        if len(settings) > MOST_SETTINGS:
            text = "%s is left open: the recording has %d values, which are used"
            log.info(text, key, len(settings))
        elif settings:
            values[key] = settings
    return values


def _config(values: Mapping[str, Any]) -> Config:
    sections: dict[str, dict[str, Any]] = {}
    for key, value in values.items():
        section, _, name = key.partition(".")
        sections.setdefault(section, {})[name] = value
    return load_config(sections)
