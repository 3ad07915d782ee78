"""beltid init: write a commented config for a new belt."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.file_bytes import write_text
from beltid.artifacts.metadata_models import plain
from beltid.bench.files.sources import exists
from beltid.bench.inspection import inspect_recording
from beltid.config import Config, load_config
from beltid.config.loading import effective_values
from beltid.config.template import SECTIONS, template_text
from beltid.errors import ConfigError, InputError
from beltid.identify.agreement.compare import SAME_SETTING
from beltid.report.summary import Summary
from beltid.stages.build_artifact import already_exists
from beltid.stages.reporter import Options
from beltid.stages.simulation.planned_runs import nominal_settings
from beltid.tables.schemas import RECORDINGS

RECORDED: Final = tuple(f"data.{kind}" for kind in RECORDINGS)
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


def run(stated: Mapping[str, Any], out: Path | None, options: Options) -> Summary:
    """Write the config of a new belt.

    Parameters
    ----------
    stated : mapping
        Values by their key (``section.key``); recordings as paths from the current folder.
    out : Path or None
        The file; None for ``<name>.yaml``.
    options : Options
        Force and reporter.

    Raises
    ------
    InputError
        If a value is not allowed, or the file already exists.
    """
    values = _with_derived_type(dict(stated))
    path = out or Path(f"{values.get('belt.name', Config().belt.name)}.yaml")
    config = load_config(_sections(_relative(values, path.parent)))
    recorded = _rig_values(stated.get("data.rig"), config, options)
    recorded = {key: value for key, value in recorded.items() if key not in values}
    if recorded:
        values |= recorded
        config = load_config(_sections(values))
    if path.exists() and not options.force:
        raise InputError(already_exists(path))
    if path.suffix not in (".yaml", ".yml"):
        raise InputError(f"{path}: a config is a YAML file, name it {path.stem}.yaml")
    write_text(path, template_text(config, frozenset(values)))
    for kind, file in load_config(path).data.files.items():  # checks that the config can be read
        if not exists(file):
            options.reporter.warn(f"data.{kind}: there is no {file} yet")
    summary = _summary(path, config, frozenset(values), frozenset(recorded))
    if not recorded:
        return summary
    listing = "; ".join(f"{key}: {plain(value)}" for key, value in recorded.items())
    return replace(summary, notes=(f"read from the recording of the rig: {listing}",))


def default_of(key: str, answers: Mapping[str, Any]) -> Any:
    """Return the default of a key after the given answers; None if it has none, as for a file."""
    section, _, name = key.partition(".")
    answered = _with_derived_type(dict(answers)).get(key)
    return getattr(getattr(Config(), section), name) if answered is None else answered


def problems_of_answer(key: str, value: Any) -> tuple[str, ...]:
    """Return the problems of a single value: not allowed, or no such file."""
    try:
        load_config(_sections({key: value}))
    except ConfigError as error:
        return error.problems
    if key in RECORDED and not exists(Path(value)):
        return (f"{key} = {value}: there is no such file; repeat the answer to keep it",)
    return ()


def _rig_values(recording: Path | None, config: Config, options: Options) -> dict[str, Any]:
    """Return what a recording of the rig contains, by config key: its kind and its settings."""
    if recording is None or not exists(Path(recording)):
        return {}
    try:
        inspection = inspect_recording(Path(recording), config, "rig")
    except InputError as error:  # a config can be written before its recording can be read
        options.reporter.warn(f"data.rig: {error.problems[0]}")
        return {}
    for line in inspection.problems[:1]:
        options.reporter.warn(
            f"data.rig: arcs, tensions and speeds are not read from it: {line}; "
            f"`beltid inspect {recording}` lists everything that must be stated"
        )
    values: dict[str, Any] = {f"rig.{name}": word for name, word in inspection.rig.items()}
    for key, (columns, gap) in SETTINGS.items():
        recorded = [
            run.settings[c] for run in inspection.runs for c in columns if c in run.settings
        ]
        snapped = nominal_settings(np.array(recorded), gap)
        settings = sorted({float(f"{value:.4g}") for value in snapped})
        if len(settings) > MOST_SETTINGS:
            options.reporter.report(
                f"{key} is left open: the recording has {len(settings)} values, which are used "
                "unless the config states others"
            )
        elif settings:
            values[key] = settings
    return values


def _with_derived_type(values: dict[str, Any]) -> dict[str, Any]:
    """Derive type and ribs from the name or type, unless stated: 6pk is type 6PK with six ribs."""
    match = re.fullmatch(r"(\d{1,2})(p[hjklm])", str(values.get("belt.name", "")), re.IGNORECASE)
    if match:
        values.setdefault("belt.type", match[0].upper())
    rib_match = re.match(r"(\d{1,2})\s*P[HJKLM]", str(values.get("belt.type", "")), re.IGNORECASE)
    if rib_match:
        values.setdefault("belt.ribs", int(rib_match[1]))
    return values


def _relative(values: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Make the paths of the recordings relative to the folder of the config."""
    for kind in RECORDINGS:
        key = f"data.{kind}"
        if values.get(key) is not None:
            values[key] = Path(os.path.relpath(values[key], folder)).as_posix()
    return values


def _sections(values: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    sections: dict[str, dict[str, Any]] = {}
    for key, value in values.items():
        section, _, name = key.partition(".")
        sections.setdefault(section, {})[name] = value
    return sections


def _summary(
    path: Path, config: Config, stated: frozenset[str], recorded: frozenset[str]
) -> Summary:
    """Summarise every key with its value and origin; the overview omits defaults."""

    def origin(key: str) -> str:
        return "recording" if key in recorded else "stated" if key in stated else "default"

    rows = [
        {"key": key, "value": plain(value), "origin": origin(key)}
        for key, value, _ in effective_values(config)
        if key.partition(".")[0] in SECTIONS
    ]
    assumed = sum(row["origin"] == "default" for row in rows)
    return Summary(
        stage="init",
        title=f"config of the belt {config.belt.name}",
        out=path,
        facts={"stated": len(rows) - assumed, "defaults": assumed},
        table=rows,
        overview=[row for row in rows if row["origin"] != "default"],
        origin=config.data.origin,
    )
