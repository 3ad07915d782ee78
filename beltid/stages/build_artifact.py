"""Build an artifact, unless the existing one was built from the same inputs.

An artifact is up to date if the hashes of its inputs, the values of all settings that matter, the
version of the software and the hash of its sources are the same. Nothing but this artifact is ever
replaced without being asked for; recordings, configs and whatever else is no Parquet file are not
replaced at all.

A stage reads like this::

    build = Build(KIND, source, KEYS, inputs, out, options)
    built = build.up_to_date()
    if built is None:
        recording = read_recording(...)
        built = build.write(compute(recording, ...))
    return summarise(built)
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from beltid._version import __version__
from beltid.artifacts.artifact import (
    Artifact,
    artifact_bytes,
    artifact_from_bytes,
    may_be_artifact,
    read_artifact,
    stated_kind,
)
from beltid.artifacts.file_bytes import source_sha256, write_bytes
from beltid.artifacts.metadata_models import Metadata, Origin, plain
from beltid.bench.files.sources import Content, Signature, content_of, signature_of
from beltid.errors import ArtifactError, InputError, Problem
from beltid.report.summary import Summary, combined_origin
from beltid.stages.outcome import Outcome
from beltid.tables.schemas import ARTIFACTS, RECORDINGS

if TYPE_CHECKING:
    from beltid.config import ConfigSource
    from beltid.stages.reporter import Options

BUILT_IN: Final = "built-in 5PK rig"
SUFFIX: Final = ".parquet"
OTHER_FORMATS: Final = frozenset({".csv", ".txt", ".tsv", ".xlsx", ".json", ".yaml", ".html"})
"""Endings of files that a result would not be what it is called."""
UNCERTAINTY: Final = "uncertainty"
"""Section of the config of which it matters, too, which values are stated and which assumed."""
RECORDED: Final = "simulated"
"""The artifact in whose place a recording may be named."""
LARGE: Final = 64 << 20
"""Bytes of inputs whose hashes take longer than the start of a thread."""
FOREIGN: Final = "a file that beltid did not write"


class Stale(Exception):
    """An artifact has to be built, but the caller only wanted to know that."""


@dataclass(frozen=True, slots=True)
class Built:
    """An artifact that exists.

    Attributes
    ----------
    artifact : Artifact
        As it reads.
    up_to_date : bool
        Whether it had been built before from the same inputs.
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

    def summary(self, stage: str, title: str, **shown: Any) -> Summary:
        """Sum it up: what every artifact tells, and what is shown of this one (see `Summary`)."""
        told: dict[str, Any] = {
            "out": self.artifact.path,
            "notes": self.notes,
            "warnings": self.warnings,
            "up_to_date": self.up_to_date,
            "origin": self.origin,
        }
        return Summary(stage, title, **(told | shown))


@dataclass(slots=True, eq=False)
class Build:
    """One artifact of a stage: what it is built from, and where it goes.

    Attributes
    ----------
    kind : str
        Kind of the artifact.
    source : ConfigSource
        The config and where it came from.
    keys : tuple of str
        Sections or ``section.key`` of the config that matter for it.
    inputs : mapping of str to Path
        Files it is built from, by their role.
    out : Path
        Where it goes.
    options : Options
        Force, reporter, whether only to look.
    choices : dict
        Settings of this call that are not in the config.
    """

    kind: str
    source: ConfigSource
    keys: tuple[str, ...]
    inputs: Mapping[str, Path]
    out: Path
    options: Options
    choices: dict[str, Any] = field(default_factory=dict)
    _seen: dict[str, Signature] = field(init=False)
    _contents: Future[dict[str, Content]] = field(init=False)

    def up_to_date(self) -> Built | None:
        """The existing artifact if it is up to date; None if it has to be built.

        Raises
        ------
        InputError
            If an input is missing, or `out` is an input or a file that must not be replaced.
        ArtifactError
            If nothing can be written there.
        Stale
            If it has to be built and the options say only to look.
        """
        self._seen = self._signatures()
        self._contents = self._read_contents()
        existing = self._check_place()
        rebuild = self.options.force or existing is None
        if existing is not None and not rebuild and self._is_fresh(existing):
            return Built(existing, up_to_date=True)
        if self.options.peek:
            raise Stale
        if not rebuild:
            reporter = self.options.reporter
            reporter.detail(f"{self.out}: built from other inputs or settings, built again")
        return None

    def write(self, outcome: Outcome[Any]) -> Built:
        """Write what was computed, and return it as it reads.

        Raises
        ------
        InputError
            If an input was changed meanwhile.
        ArtifactError
            If a value is not what the schema allows, or the file cannot be written.
        """
        self._refuse_changed()
        data = artifact_bytes(self.kind, outcome.columns, self._metadata(outcome), str(self.out))
        artifact = artifact_from_bytes(data, self.out, self.kind)
        write_bytes(self.out, data)
        return Built(artifact, up_to_date=False)

    @property
    def settings(self) -> dict[str, Any]:
        """Every setting that matters, by its key, as JSON has it."""
        values = self.source.config.model_dump(mode="json")
        recorded = any(role in RECORDINGS for role in self.inputs)
        keys = (*self.keys, "data.origin") if recorded else self.keys
        stated: dict[str, Any] = {}
        if UNCERTAINTY in keys:
            stated["uncertainty_stated"] = sorted(self.source.config.uncertainty.model_fields_set)
        return {**{key: _value(values, key) for key in keys}, **stated, **plain(self.choices)}

    def _metadata(self, outcome: Outcome[Any]) -> Metadata:
        path = self.source.path
        return outcome.metadata(
            config_sha256=self.source.config.sha256,
            inputs=self._hashes(),
            settings=self.settings,
            # the name without its folder: the same input gives the same bytes anywhere
            config=BUILT_IN if path is None else path.name,
            origin=self._origin(),
        )

    def _is_fresh(self, artifact: Artifact) -> bool:
        return (
            artifact.software_version == __version__
            and artifact.software_sha256 == source_sha256()
            and artifact.metadata.inputs == self._hashes()
            and artifact.metadata.settings == self.settings
        )

    # --- inputs

    def _files(self) -> dict[str, Path]:
        """Every input by its role, and the tables of runs that belong to recordings."""
        tables = self.source.config.runs.tables
        of_runs = {f"{role}_runs": tables[role] for role in self.inputs if role in tables}
        return {**self.inputs, **of_runs}

    def _signatures(self) -> dict[str, Signature]:
        """What the file system says of every input."""
        return {role: signature_of(path) for role, path in self._files().items()}

    def _read_contents(self) -> Future[dict[str, Content]]:
        """Contents of the inputs; those of large files are hashed while the work begins.

        Signals do not reach a thread, and an interrupted program does not wait for a daemon.
        """
        contents: Future[dict[str, Content]] = Future()
        if sum(file.size for files in self._seen.values() for file in files) < LARGE:
            contents.set_result(self._input_contents())
        else:
            threading.Thread(target=self._read_into, args=(contents,), daemon=True).start()
        return contents

    def _read_into(self, contents: Future[dict[str, Content]]) -> None:
        try:
            contents.set_result(self._input_contents())
        except Exception as error:  # raised where the contents are asked for
            contents.set_exception(error)

    def _hashes(self) -> dict[str, str]:
        """SHA-256 of every file that is read, by its role."""
        return {role: content.sha256 for role, content in self._contents.result().items()}

    def _input_contents(self) -> dict[str, Content]:
        """Content of every file that is read, by its role."""
        folders = [  # an artifact is one file; only recordings may be folders
            f"{path}: is a folder, a {role} artifact is needed, "
            f"a file such as {path / role}{SUFFIX}"
            for role, path in self.inputs.items()
            if role in ARTIFACTS and role != RECORDED and path.is_dir()
        ]
        if folders:
            raise ArtifactError(folders)
        tables = self.source.config.runs.tables
        return {
            role: content_of(path, [tables[role]] if role in tables else [])
            for role, path in self._files().items()
        }

    def _origin(self) -> Origin | None:
        """Where the data of the inputs come from."""
        return combined_origin([self._origin_of(role, path) for role, path in self.inputs.items()])

    def _origin_of(self, role: str, path: Path) -> Origin | None:
        """The config states the origin of recordings; artifacts hand it on."""
        artifact = None
        if self._contents.result()[role].is_parquet and may_be_artifact(path):
            with contextlib.suppress(ArtifactError):
                artifact = read_artifact(path)
        if artifact is None:  # a recording as the bench wrote it, of any size
            # a simulation that is brought along as a table adds no data of a bench
            return self.source.config.data.origin if role in RECORDINGS else "measured"
        if role in RECORDINGS:
            return "synthetic"  # a simulated recording in the place of a measured one
        return artifact.metadata.origin

    def _refuse_changed(self) -> None:
        """The inputs that were read must be those whose hashes the artifact will carry."""
        if self._signatures() == self._seen:
            return
        before, now = self._contents.result(), self._input_contents()
        changed = [path for role, path in self._files().items() if now[role] != before[role]]
        if changed:
            raise InputError(
                [
                    f"{path}: was changed while it was read (another process at work?), run again"
                    for path in changed
                ]
            )

    # --- the place of the result

    def _check_place(self) -> Artifact | None:
        """The artifact of this kind that exists at `out`; refuse what must not be replaced."""
        self._refuse_inputs()
        out, force = self.out, self.options.force
        if out.suffix.lower() in OTHER_FORMATS:
            raise InputError(
                f"{out}: ends in {out.suffix}, but results are Parquet files: name it "
                f"{out.with_suffix(SUFFIX).name}; `beltid show` writes its table as .csv"
            )
        existing, obstacle = _existing(out, self.kind)
        replaceable = obstacle != FOREIGN or out.suffix == SUFFIX
        if obstacle and not (force and replaceable):
            how = (
                "name another --out, or replace it with --force"
                if replaceable
                else f"only a {SUFFIX} file could be; name another --out"
            )
            even = " even with --force" if force else ""
            raise InputError(
                f"{out}: is {obstacle}, not replaced{even} by a {self.kind} artifact; {how}",
                code="not-replaced",
            )
        _refuse_unwritable(out)
        return existing

    def _refuse_inputs(self) -> None:
        """Neither an input nor a recording that the config names is a place for a result."""
        out = self.out
        for role, path in self.inputs.items():
            if _same_file(path, out):
                text = f"{out}: is the {role} input of this command, name another --out"
                raise InputError(text, code="not-replaced")
        for kind, path in self.source.config.data.files.items():
            if _same_file(path, out):
                text = f"{out}: is the {kind} recording of the config, name another --out"
                raise InputError(text, code="not-replaced")


def already_exists(path: Path) -> Problem:
    """What to say of a file that only --force replaces."""
    text = f"{path}: already exists; use --force to overwrite, or name another --out"
    return Problem(text, "not-replaced")


def _value(values: Mapping[str, Any], key: str) -> Any:
    section, _, name = key.partition(".")
    return plain(values[section][name] if name else values[section])


def _same_file(path: Path, other: Path) -> bool:
    if os.path.realpath(path) == os.path.realpath(other):
        return True
    try:
        return os.path.samefile(path, other)
    except (OSError, ValueError):  # one of them is not there
        return False


def _existing(out: Path, kind: str) -> tuple[Artifact | None, str]:
    """The artifact of this kind at `out`, and what else is in the way there."""
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
        text = f"{out}: not written: {folder} is a file, not a folder"
        raise ArtifactError(text, code="not-written")
    if not os.access(folder, os.W_OK | os.X_OK):
        text = f"{out}: not written: no permission to write in {folder}"
        raise ArtifactError(text, code="not-written")
