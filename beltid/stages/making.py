"""Make an artifact, unless the one that stands there was made from the same inputs.

An artifact is up to date if the hashes of its inputs, the values of all settings that matter, the
version of the software and the hash of its sources are the same. Nothing that is not this artifact
is ever replaced without being asked for; recordings, configs and whatever else is no Parquet file
are not replaced at all.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from beltid._version import __version__
from beltid.artifacts.artifact import Artifact, read_artifact, stated_kind, write_artifact
from beltid.artifacts.fingerprint import source_sha256
from beltid.artifacts.metadata_models import Metadata, metadata_of, plain
from beltid.bench.files.sources import Signature, content_sha256, signature_of
from beltid.errors import ArtifactError, InputError
from beltid.stages.beside import beside
from beltid.stages.origin import RECORDINGS, origin_of
from beltid.tables.schemas import ARTIFACTS

if TYPE_CHECKING:
    from beltid.config import ConfigSource
    from beltid.stages.outcome import Outcome
    from beltid.stages.talk import Options

BUILT_IN: Final = "built-in 5PK rig"
SUFFIX: Final = ".parquet"
RECORDED: Final = "simulated"
"""The artifact in whose place a recording may be named."""
LARGE: Final = 64 << 20
"""Bytes of inputs whose hashes take longer than the start of a thread."""
FOREIGN: Final = "a file that beltid did not write"


class Stale(Exception):
    """An artifact has to be made, but the caller only wanted to know that."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """What an artifact is made from.

    Attributes
    ----------
    kind : str
        Kind of the artifact.
    source : ConfigSource
        The config and where it came from.
    keys : tuple of str
        Sections or ``section.key`` of the config that matter for it.
    inputs : mapping of str to Path
        Files it is made from, by their role.
    choices : dict
        Settings of this call that are not in the config.
    figures : tuple of str
        What its metadata must tell for the summary; one without is made again.
    """

    kind: str
    source: ConfigSource
    keys: tuple[str, ...]
    inputs: Mapping[str, Path]
    choices: dict[str, Any] = field(default_factory=dict)
    figures: tuple[str, ...] = ()

    @property
    def settings(self) -> dict[str, Any]:
        """Every setting that matters, by its key, as JSON has it."""
        values = self.source.config.model_dump(mode="json")
        recorded = any(role in RECORDINGS for role in self.inputs)
        keys = (*self.keys, "data.origin") if recorded else self.keys
        return {**{key: _value(values, key) for key in keys}, **plain(self.choices)}


def _value(values: Mapping[str, Any], key: str) -> Any:
    section, _, name = key.partition(".")
    return plain(values[section][name] if name else values[section])


@dataclass(frozen=True, slots=True)
class Made:
    """An artifact that stands on the disk.

    Attributes
    ----------
    artifact : Artifact
        As it was read back.
    up_to_date : bool
        Whether it had been made before from the same inputs.
    """

    artifact: Artifact
    up_to_date: bool

    @property
    def origin(self) -> str | None:
        """Where its data come from: "measured", "synthetic", or None where nobody said."""
        return self.artifact.metadata.origin

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know."""
        return self.artifact.metadata.notes

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should look into."""
        return self.artifact.metadata.warnings


def make(recipe: Recipe, out: Path, options: Options, compute: Callable[[], Outcome[Any]]) -> Made:
    """Make an artifact, or keep the one that is up to date.

    Parameters
    ----------
    recipe : Recipe
        What it is made from.
    out : Path
        Where it is to stand.
    options : Options
        Force, listener, whether only to look.
    compute : callable
        Does the work; called only if it has to be done.

    Raises
    ------
    InputError
        If an input is missing or changes while it is read, or `out` is an input or a file that
        must not be replaced.
    Stale
        If it would have to be computed and the options say only to look.
    """
    seen = _signatures(recipe)
    hashes = _hashed(recipe, seen)
    standing = admit(recipe, out, options)
    if standing is not None and not options.force and _fresh(standing, recipe, hashes()):
        return Made(standing, up_to_date=True)
    if options.peek:
        raise Stale
    if standing is not None and not options.force:
        options.talk.detail(f"{out}: made from other inputs or settings, made again")
    outcome = compute()
    _refuse_changed(recipe, seen, hashes())
    write_artifact(out, recipe.kind, outcome.columns, _metadata(outcome, recipe, hashes()))
    return Made(read_artifact(out, recipe.kind), up_to_date=False)


def _hashed(recipe: Recipe, seen: Mapping[str, Signature]) -> Callable[[], dict[str, str]]:
    """Hashes of the inputs; those of large files are made while the work begins."""
    if sum(file.size for files in seen.values() for file in files) < LARGE:
        known = _input_hashes(recipe)
        return lambda: known
    return beside(partial(_input_hashes, recipe)).result


def _read_files(recipe: Recipe) -> dict[str, Path]:
    """Every input by its role, and the tables of runs that belong to recordings."""
    tables = recipe.source.config.runs.tables
    of_runs = {f"{role}_runs": tables[role] for role in recipe.inputs if role in tables}
    return {**recipe.inputs, **of_runs}


def _input_hashes(recipe: Recipe) -> dict[str, str]:
    """SHA-256 of every file that is read, by its role."""
    _refuse_folders(recipe)
    tables = recipe.source.config.runs.tables
    return {
        role: content_sha256(path, [tables[role]] if role in tables else [])
        for role, path in _read_files(recipe).items()
    }


def _refuse_folders(recipe: Recipe) -> None:
    """An artifact is one file; only recordings may be folders."""
    problems = [
        f"{path}: is a folder, a {role} artifact is needed, a file such as {path / role}{SUFFIX}"
        for role, path in recipe.inputs.items()
        if role in ARTIFACTS and role != RECORDED and path.is_dir()
    ]
    if problems:
        raise ArtifactError(problems)


def _signatures(recipe: Recipe) -> dict[str, Signature]:
    """What the file system says of every file that is read."""
    return {role: signature_of(path) for role, path in _read_files(recipe).items()}


def _refuse_changed(
    recipe: Recipe, seen: Mapping[str, Signature], hashes: Mapping[str, str]
) -> None:
    """The inputs that were read must be those whose hashes the artifact will carry."""
    if _signatures(recipe) == seen:
        return
    now = _input_hashes(recipe)
    changed = [path for role, path in _read_files(recipe).items() if now[role] != hashes[role]]
    if changed:
        raise InputError(
            [
                f"{path}: was changed while it was read (another process at work?), run again"
                for path in changed
            ]
        )


def admit(recipe: Recipe, out: Path, options: Options) -> Artifact | None:
    """Check that an artifact may stand at `out`; return the one of its kind that does.

    Raises
    ------
    InputError
        If `out` is an input or a file that must not be replaced.
    ArtifactError
        If nothing can be written there.
    """
    _refuse_inputs(out, recipe)
    standing, obstacle = _standing(out, recipe.kind)
    replaceable = obstacle != FOREIGN or out.suffix == SUFFIX
    if obstacle and not (options.force and replaceable):
        how = (
            "name another --out, or replace it with --force"
            if replaceable
            else f"only a {SUFFIX} file could be; name another --out"
        )
        even = " even with --force" if options.force else ""
        raise InputError(
            f"{out}: is {obstacle}, not replaced{even} by a {recipe.kind} artifact; {how}"
        )
    _refuse_unwritable(out)
    return standing


def _metadata(outcome: Outcome[Any], recipe: Recipe, hashes: dict[str, str]) -> Metadata:
    path = recipe.source.path
    return metadata_of(
        recipe.kind,
        {
            **outcome.extra,
            "config_sha256": recipe.source.config.sha256,
            "inputs": hashes,
            "validity": outcome.validity,
            "set_aside": outcome.set_aside,
            "settings": recipe.settings,
            # the name without its folder: the same input gives the same bytes anywhere
            "config": BUILT_IN if path is None else path.name,
            "origin": origin_of(recipe.inputs, recipe.source.config.data.origin),
            "notes": outcome.notes,
            "warnings": outcome.warnings,
        },
        f"a {recipe.kind} artifact",
    )


def _fresh(artifact: Artifact, recipe: Recipe, hashes: dict[str, str]) -> bool:
    return (
        artifact.software_version == __version__
        and artifact.software_sha256 == source_sha256()
        and artifact.metadata.inputs == hashes
        and artifact.metadata.settings == recipe.settings
        and set(recipe.figures) <= artifact.metadata.model_fields_set
    )


def _refuse_inputs(out: Path, recipe: Recipe) -> None:
    """Neither an input nor a recording that the config names is a place for a result."""
    for role, path in recipe.inputs.items():
        if _same_file(path, out):
            raise InputError(f"{out}: is the {role} input of this command, name another --out")
    for kind, path in recipe.source.config.data.files.items():
        if _same_file(path, out):
            raise InputError(f"{out}: is the {kind} recording of the config, name another --out")


def _same_file(path: Path, other: Path) -> bool:
    if os.path.realpath(path) == os.path.realpath(other):
        return True
    try:
        return os.path.samefile(path, other)
    except (OSError, ValueError):  # one of them is not there
        return False


def _standing(out: Path, kind: str) -> tuple[Artifact | None, str]:
    """The artifact of this kind that stands at `out`, and what else stands there in the way."""
    if not out.exists() or out.is_dir():
        return None, ""
    try:
        return read_artifact(out, kind), ""
    except ArtifactError:
        pass
    found = stated_kind(out) if out.is_file() else None
    if found == kind:
        return None, ""  # damaged or of an old schema: only good to be replaced
    return None, f"a {found} artifact" if found else FOREIGN


def _refuse_unwritable(out: Path) -> None:
    """Say before the work, not after it, that the result cannot be kept."""
    if out.is_dir():
        raise ArtifactError(f"{out}: is a folder, name a file in it")
    folder = out.parent
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    if not folder.is_dir():
        raise ArtifactError(f"{out}: not written: {folder} is a file, not a folder")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ArtifactError(f"{out}: not written: no permission to write in {folder}")
