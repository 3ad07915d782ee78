"""beltid info and beltid config: show version, file metadata and effective settings."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

from beltid._version import __version__
from beltid.artifacts.artifact import Artifact, read_artifact
from beltid.artifacts.file_bytes import source_sha256
from beltid.artifacts.metadata_models import plain
from beltid.config import ConfigSource, config_text, load_cases
from beltid.config.loading import DEFAULT, ENVIRONMENT_VARIABLE, effective_values
from beltid.errors import ConfigError
from beltid.report.summary import Summary
from beltid.stages.setup.named_recordings import (
    WITHOUT,
    lacking,
    unread_recordings,
    wrong_recordings,
)
from beltid.stages.tables import load_law

LIBRARIES: Final = ("numpy", "scipy", "numba", "pandas", "pyarrow", "pydantic", "matplotlib")
VARIABLES: Final = (ENVIRONMENT_VARIABLE, "NO_COLOR", "COLUMNS", "NUMBA_CACHE_DIR")


def program() -> Summary:
    """Summarise the installation: program, Python, libraries, environment."""
    rows = [{"library": name, "version": _version(name)} for name in LIBRARIES]
    return Summary(
        stage="info",
        title=f"beltid {__version__}",
        facts={
            "version": __version__,
            "sources_sha256": source_sha256(),
            "folder": str(Path(__file__).parents[2]),
            "python": f"{platform.python_version()} ({sys.executable})",
            "platform": platform.platform(),
            "processors": os.cpu_count(),
        },
        table=rows,
        extra_tables={
            "environment": [
                {"variable": name, "value": os.environ.get(name, "not set")} for name in VARIABLES
            ]
        },
    )


def file_info(path: Path) -> Summary:
    """Summarise the metadata of an artifact or a law file.

    Raises
    ------
    ArtifactError
        If it is damaged or neither of them.
    """
    if path.suffix == ".json":
        return _law_info(path)
    artifact = read_artifact(path)
    metadata = artifact.metadata
    rows = len(next(iter(artifact.columns.values())))
    measured = metadata.figures.get("measured", {})
    known = {"notes", "warnings", "origin", "config", "method", "measured"}
    return Summary(
        stage="info",
        title=f"{path.name}: {artifact.kind} artifact",
        facts={
            "kind": artifact.kind,
            "schema_version": artifact.schema_version,
            "rows": rows,
            **({"method": metadata.method} if metadata.method else {}),
            "written_by": f"beltid {artifact.software_version}",
            "config": metadata.config,
            "file_sha256": artifact.sha256,
            "config_sha256": metadata.config_sha256,
            "sources_sha256": artifact.software_sha256,
            **{f"measured {name}": span for name, span in measured.items()},
            **{f"valid {name}": span for name, span in metadata.validity.items()},
            "set_aside": len(metadata.set_aside),
        },
        table=_columns(artifact),
        details={
            "made from": [{"input": name, "sha256": sha} for name, sha in metadata.inputs.items()],
            "set aside": list(metadata.set_aside),
            "settings": [
                {"setting": key, "value": plain(value)} for key, value in metadata.settings.items()
            ],
            "further": [
                {"name": key, "value": plain(value)}
                for key, value in metadata.figures.items()
                if key not in known
            ],
        },
        notes=metadata.notes,
        warnings=metadata.warnings,
        origin=metadata.origin,
    )


def _law_info(path: Path) -> Summary:
    law = load_law(path)
    return Summary(
        stage="info",
        title=f"{path.name}: contact law of the belt {law.belt.name}",
        facts={
            "kind": law.format,
            "version": law.version,
            "belt": law.belt.type or law.belt.name,
            "method": law.friction.method,
            "written_by": law.provenance.software,
            "config": law.provenance.config,
            **{f"valid {name}": span for name, span in law.validity.model_dump().items() if span},
        },
        table=[
            {"made from": name, "sha256": sha}
            for name, sha in {**law.provenance.artifacts, **law.provenance.recordings}.items()
        ],
        notes=law.provenance.notes,
        origin=law.origin,
    )


def _columns(artifact: Artifact) -> list[dict[str, Any]]:
    return [{"column": name, "unit": artifact.units.get(name, "")} for name in artifact.columns]


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def shown_config(source: ConfigSource) -> str:
    """Return the effective values as YAML text, every key with its range."""
    return config_text(source.config)


def config_origins(source: ConfigSource) -> Summary:
    """Summarise every effective value with the file and line that state it."""
    rows = [
        {"key": entry.key, "value": plain(entry.value), "from": entry.origin}
        for entry in effective_values(source)
    ]
    stated = [row for row in rows if row["from"] != DEFAULT]
    return Summary(
        stage="config show",
        title=source.origin,
        facts={
            "config_sha256": source.config.sha256,
            "stated": len(stated),
            "defaults": len(rows) - len(stated),
        },
        table=rows,
        origin=source.config.data.origin,
    )


def check_configs(paths: Sequence[Path]) -> Summary:
    """Check configs, and whether the recordings they name exist and can be read.

    Raises
    ------
    ConfigError
        With all problems of all configs.
    """
    problems: list[str] = []
    warnings: list[str] = []
    rows: list[dict[str, Any]] = []
    for path in paths:
        try:
            cases = load_cases(path)
        except ConfigError as error:
            problems += error.problems
            continue
        config = cases[0][2]
        wrong = wrong_recordings(ConfigSource(config, str(path), path))
        problems += wrong
        unread = () if wrong else unread_recordings(config)
        warnings += [f"{path}: cannot be read with these settings: {line}" for line in unread]
        warnings += [f"{path}: {WITHOUT[kind]}" for kind in lacking(config)]
        rows.append(
            {
                "config": str(path),
                "belt": config.belt.name,
                "cases": len(cases),
                "recordings": ", ".join(config.data.files),
            }
        )
    if problems:
        raise ConfigError(problems)
    return Summary(
        stage="config check",
        title="all keys known, all values allowed, all recordings found",
        table=rows,
        warnings=tuple(warnings),
    )
