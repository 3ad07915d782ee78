"""beltid init: a commented config for a new belt."""

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
from beltid.config.loading import DEFAULT, ConfigSource, effective_values
from beltid.config.template import SECTIONS, template_text
from beltid.errors import ConfigError, InputError
from beltid.identify.agreement.compare import SAME_SETTING
from beltid.report.summary import Summary
from beltid.stages.build_artifact import already_exists
from beltid.stages.reporter import Options
from beltid.stages.simulation.planned_runs import snap_to_settings
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
"""Lists of the config -> the columns of a recording that tell them, and what is one setting."""
MOST_SETTINGS: Final = 30
"""Values of a list beyond which every run has its own."""


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
    values = _with_type_of_name(dict(stated))
    path = out or Path(f"{values.get('belt.name', Config().belt.name)}.yaml")
    config = load_config(_sections(_relative(values, path.parent)))
    found = _rig_found(stated.get("data.rig"), config, options)
    found = {key: value for key, value in found.items() if key not in values}
    if found:
        values |= found
        config = load_config(_sections(values))
    if path.exists() and not options.force:
        raise InputError(already_exists(path))
    if path.suffix not in (".yaml", ".yml"):
        raise InputError(f"{path}: a config is a YAML file, name it {path.stem}.yaml")
    write_text(path, template_text(config, frozenset(values)))
    for kind, file in load_config(path).data.files.items():  # what was written is what is read
        if not exists(file):
            options.reporter.warn(f"data.{kind}: there is no {file} yet")
    summary = _summary(path, config, frozenset(values), frozenset(found))
    if not found:
        return summary
    words = "; ".join(f"{key}: {plain(value)}" for key, value in found.items())
    return replace(summary, notes=(f"the recording of the rig says {words}",))


def default_of(key: str, answers: Mapping[str, Any]) -> Any:
    """What a key is if nothing more is said; None for a file and where nothing is built in."""
    section, _, name = key.partition(".")
    given = _with_type_of_name(dict(answers)).get(key)
    return getattr(getattr(Config(), section), name) if given is None else given


def problems_of_answer(key: str, value: Any) -> tuple[str, ...]:
    """What is wrong with a value by itself: not allowed, or no file of that name is there."""
    try:
        load_config(_sections({key: value}))
    except ConfigError as error:
        return error.problems
    if key in RECORDED and not exists(Path(value)):
        return (f"{key} = {value}: there is no such file; the same answer again keeps it",)
    return ()


def _rig_found(recording: Path | None, config: Config, options: Options) -> dict[str, Any]:
    """What a recording of the rig tells, by the keys of the config: its kind and its settings."""
    if recording is None or not exists(Path(recording)):
        return {}
    try:
        seen = inspect_recording(Path(recording), config, "rig")
    except InputError as error:  # a config can be written before its recording can be read
        options.reporter.warn(f"data.rig: {error.problems[0]}")
        return {}
    for line in seen.problems[:1]:
        options.reporter.warn(
            f"data.rig: arcs, tensions and speeds are not read from it: {line}; "
            f"`beltid inspect {recording}` tells all that is to be stated"
        )
    found: dict[str, Any] = {f"rig.{name}": word for name, word in seen.rig.items()}
    for key, (columns, gap) in SETTINGS.items():
        told = [run.settings[c] for run in seen.runs for c in columns if c in run.settings]
        snapped = snap_to_settings(np.array(told), gap)
        settings = sorted({float(f"{value:.4g}") for value in snapped})
        if len(settings) > MOST_SETTINGS:
            options.reporter.report(
                f"{key} is left open: the recording has {len(settings)} values, which hold as long "
                "as the config states none"
            )
        elif settings:
            found[key] = settings
    return found


def _with_type_of_name(values: dict[str, Any]) -> dict[str, Any]:
    """A belt that is called 6pk is of the type 6PK and has six ribs, if nothing else is said."""
    match = re.fullmatch(r"(\d{1,2})(p[hjklm])", str(values.get("belt.name", "")), re.IGNORECASE)
    if match:
        values.setdefault("belt.type", match[0].upper())
    of_type = re.match(r"(\d{1,2})\s*P[HJKLM]", str(values.get("belt.type", "")), re.IGNORECASE)
    if of_type:
        values.setdefault("belt.ribs", int(of_type[1]))
    return values


def _relative(values: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Recordings as paths from the folder of the config."""
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
    """Every key with its value and where that is from; a person sees those that are no defaults."""

    def origin(key: str) -> str:
        return "recording" if key in recorded else "stated" if key in stated else DEFAULT

    rows = [
        {"key": entry.key, "value": plain(entry.value), "origin": origin(entry.key)}
        for entry in effective_values(ConfigSource(config, ""))
        if entry.key.partition(".")[0] in SECTIONS
    ]
    assumed = sum(row["origin"] == DEFAULT for row in rows)
    return Summary(
        stage="init",
        title=f"config of the belt {config.belt.name}",
        out=path,
        facts={"stated": len(rows) - assumed, "defaults": assumed},
        table=rows,
        overview=[row for row in rows if row["origin"] != DEFAULT],
        origin=config.data.origin,
    )
