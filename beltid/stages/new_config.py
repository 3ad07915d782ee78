"""beltid init: a commented config for a new belt."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from beltid.artifacts.file_bytes import write_text
from beltid.bench.files.sources import exists
from beltid.bench.inspection import rig_of_file
from beltid.config import Config, load_config
from beltid.config.effective import DEFAULT, effective_values
from beltid.config.loading import ConfigSource
from beltid.config.template import SECTIONS, template_text
from beltid.errors import InputError
from beltid.report.summary import Summary, json_value
from beltid.stages.build_artifact import already_exists
from beltid.stages.reporter import Options
from beltid.tables.schemas import RECORDINGS


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
    found = {} if "rig.kind" in values else _rig_found(stated.get("data.rig"), config, options)
    if found:
        values |= found
        config = load_config(_sections(values))
    if path.exists() and not options.force:
        raise InputError(already_exists(path))
    if path.suffix not in (".yaml", ".yml"):
        raise InputError(f"{path}: a config is a YAML file, name it {path.stem}.yaml")
    write_text(path, template_text(config, frozenset(values)))
    for kind, file in load_config(path).data.files.items():  # what was written is what is read
        if not file.exists():
            options.reporter.warn(f"data.{kind}: there is no {file} yet")
    summary = _summary(path, config, frozenset(values))
    if not found:
        return summary
    words = ", ".join(f"{key}: {word}" for key, word in found.items())
    return replace(summary, notes=(f"the channels of the recording of the rig say {words}",))


def _rig_found(recording: Path | None, config: Config, options: Options) -> dict[str, str]:
    """What the channels of a recording say of the rig, by its keys."""
    if recording is None or not exists(Path(recording)):
        return {}
    try:
        found = rig_of_file(Path(recording), config)
    except InputError as error:  # a config can be written before its recording can be read
        options.reporter.warn(f"data.rig: {error.problems[0]}")
        return {}
    return {f"rig.{name}": word for name, word in found.items()}


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


def _summary(path: Path, config: Config, stated: frozenset[str]) -> Summary:
    rows = [
        {
            "key": entry.key,
            "value": json_value(entry.value),
            "origin": "stated" if entry.key in stated else DEFAULT,
        }
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
