"""What is there: versions, the settings of a config and its recordings, any artifact."""

import os
import platform
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from beltid.bench.files import sources_of
from beltid.config import Config, ConfigSource, load_config
from beltid.config.loading import KeyPath, effective_values, format_path, read_source
from beltid.errors import ConfigError, InputError
from beltid.report.summary import Summary
from beltid.store.artifact import plain, read_artifact
from beltid.store.disk import check_place, source_sha256, write_bytes

LIBRARIES = (
    *("numpy", "scipy", "numba", "pandas", "pyarrow", "pydantic", "rich", "ruamel.yaml", "typer"),
    *("matplotlib", "jinja2", "nptdms", "asammdf", "h5py", "openpyxl", "distributed"),
)

WITHOUT = {
    "press": "no recording of the press (data.press): no contact law; the surface is not refined, "
    "nothing is simulated, compared or predicted",
    "rig": "no recording of the friction rig (data.rig): only contact law and sliding speeds",
}
"""Kind of recording needed by the full chain -> warning if it is missing."""
TABLE = ".csv"


def program() -> Summary:
    """Summarise the installation, for a bug report: program, Python, libraries."""
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
    """Check configs, and whether the recordings they name exist."""
    sources, problems = checked(paths)
    if problems:
        raise ConfigError(problems)
    return Summary(
        stage="config check",
        title="all keys known, all values allowed, all recordings found",
        table=[
            {"config": s.origin, "belt": s.name, "recordings": ", ".join(s.config.data.files)}
            for s in sources
        ],
        warnings=tuple(f"{s.path}: {WITHOUT[kind]}" for s in sources for kind in lacking(s.config)),
    )


def checked(paths: Sequence[Path]) -> tuple[list[ConfigSource], list[str]]:
    """Load configs; return those that load, and all problems."""
    sources, problems = list[ConfigSource](), list[str]()
    for path in paths:
        try:
            sources.append(ConfigSource(load_config(path), str(path), path))
            problems += wrong_recordings(sources[-1])
        except ConfigError as error:
            problems += error.problems
    return sources, problems


def lacking(config: Config) -> list[str]:
    """Return the kinds of recordings that the full chain needs and a config does not name."""
    return [kind for kind in WITHOUT if kind not in config.data.files]


def wrong_recordings(source: ConfigSource) -> list[str]:
    """Return problems of the recordings that a config names, each with its line in the config."""
    if source.path is None:
        return ["no config given: beltid run CONFIG.yaml, or set $BELTID_CONFIG"]
    data, tables = source.config.data.files, source.config.run_tables
    named: dict[KeyPath, Path] = {("data", kind): file for kind, file in data.items()}
    named |= {("runs", kind, "table"): file for kind, file in tables.items()}
    nothing = " names no recording, must be at least one of press, rig and speedloss"
    wrong: list[tuple[KeyPath, str]] = [] if data else [(("data",), nothing)]
    for keys, file in named.items():
        try:
            sources_of(file, list(tables.values()))
        except InputError as error:
            wrong += [(keys, f" = {line}") for line in error.problems]
    if not wrong:
        return []
    places = read_source(source.path)
    return [f"{places.at(places.place(k))}{format_path(k)}{text}" for k, text in wrong]


def shown(path: Path, out: Path | None, name: str | None, *, force: bool = False) -> Summary:
    """Show an artifact as a table and its figures; or write it as CSV or as one of its figures."""
    from beltid.report.charts import NO_DATES, pictures_of, saved
    from beltid.report.results import Sheet, shown_of
    from beltid.report.summary import csv_bytes

    artifact, figures = read_artifact(path), tuple(f".{kind}" for kind in NO_DATES)
    ending, endings = "" if out is None else out.suffix.lower(), (TABLE, *figures)
    if out is not None:
        check_place(out, endings, inputs={"artifact that is shown": path}, force=force)
    if name is not None and ending in ("", TABLE):
        raise InputError(
            f"--figure = {name}: needs --out, a file that ends in {', '.join(figures)}"
        )
    pictures = [] if ending == TABLE else pictures_of(Sheet.of(artifact))
    if out is None:
        return shown_of(artifact, [(picture.key, picture.title) for picture in pictures])
    if ending == TABLE:
        write_bytes(out, csv_bytes(artifact.columns, artifact.origin))
    elif chosen := [picture.figure for picture in pictures if name in (None, picture.key)]:
        write_bytes(out, saved(chosen[0], ending[1:]))
    else:
        keys = ", ".join(picture.key for picture in pictures)
        wrong = f"--figure = {name}, must be one of: {keys}" if keys else "nothing to draw"
        raise InputError(f"{path}: {wrong}")
    return Summary("show", "", out, origin=artifact.origin)
