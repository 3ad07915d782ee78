"""beltid --version --verbose and beltid config: show versions and effective settings."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

from beltid.config import ConfigSource, load_config
from beltid.config.loading import ENVIRONMENT_VARIABLE, effective_values
from beltid.config.source import format_path
from beltid.errors import ConfigError
from beltid.report.summary import Summary
from beltid.stages.named_recordings import WITHOUT, lacking, unread_recordings, wrong_recordings
from beltid.store.artifact import plain
from beltid.store.disk import source_sha256

LIBRARIES: Final = (
    *("numpy", "scipy", "numba", "pandas", "pyarrow", "pydantic", "rich", "ruamel.yaml", "typer"),
    *("matplotlib", "jinja2", "nptdms", "asammdf", "h5py", "openpyxl", "distributed"),
)
VARIABLES: Final = (
    *(ENVIRONMENT_VARIABLE, "DASK_SCHEDULER_ADDRESS", "NO_COLOR", "COLUMNS", "NUMBA_CACHE_DIR"),
)


def program() -> Summary:
    """Summarise the installation, for a bug report: program, Python, libraries, environment."""
    return Summary(
        stage="version",
        title="",
        facts={
            "sources_sha256": source_sha256(),
            "folder": str(Path(__file__).parents[1]),
            "python": f"{platform.python_version()} ({sys.executable})",
            "platform": platform.platform(),
            "processors": os.cpu_count(),
        },
        table=[{"library": name, "version": _version(name)} for name in LIBRARIES],
        extra_tables={
            "environment": [
                {"variable": name, "value": os.environ.get(name, "not set")} for name in VARIABLES
            ]
        },
    )


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def config_values(source: ConfigSource, *, complete: bool) -> Summary:
    """Summarise the values that are stated, or with `complete` all values in effect."""
    values = list(effective_values(source.config))
    n_stated = sum(stated for _, _, stated in values)
    return Summary(
        stage="config show",
        title=source.origin,
        facts={
            "config_sha256": source.config.sha256,
            "stated": n_stated,
            "defaults": len(values) - n_stated,
        },
        table=[
            {"key": format_path(path), "value": plain(value)}
            for path, value, stated in values
            if stated or complete
        ],
        origin=source.config.data.origin,
    )


def check_configs(paths: Sequence[Path]) -> Summary:
    """Check configs, and whether the recordings they name exist and can be read."""
    problems, warnings, rows = list[str](), list[str](), []
    for path in paths:
        try:
            config = load_config(path)
        except ConfigError as error:
            problems += error.problems
            continue
        wrong = wrong_recordings(ConfigSource(config, str(path), path))
        problems += wrong
        unread = () if wrong else unread_recordings(config)
        warnings += [f"{path}: cannot be read with these settings: {line}" for line in unread]
        warnings += [f"{path}: {WITHOUT[kind]}" for kind in lacking(config)]
        recordings = ", ".join(config.data.files)
        rows.append({"config": str(path), "belt": config.belt.name, "recordings": recordings})
    if problems:
        raise ConfigError(problems)
    return Summary(
        stage="config check",
        title="all keys known, all values allowed, all recordings found",
        table=rows,
        warnings=tuple(warnings),
    )
