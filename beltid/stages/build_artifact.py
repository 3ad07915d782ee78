"""Build an artifact, unless the existing one was built from the same inputs.

An artifact is up to date if the hashes of its inputs, the config sections that matter, the version
of the software and the hash of its sources are unchanged. Only an artifact of the same kind is
replaced without --force. Recordings, configs and all other files that are not Parquet are never
replaced.

Typical use in a stage::

    build = Build(KIND, source, USES, inputs, out, options)
    built = build.up_to_date()
    if built is None:
        recording = read_recording(...)
        built = build.write(compute(recording, ...))
    return summarise(built)
"""

from __future__ import annotations

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
from beltid.artifacts.together import ancestors_of, refuse_misfits
from beltid.bench.files import Content, Signature, content_of, signature_of
from beltid.errors import ArtifactError, InputError
from beltid.report.summary import Summary, combined_origin
from beltid.stages.outcome import Outcome
from beltid.tables.schemas import ARTIFACTS, RECORDINGS

if TYPE_CHECKING:
    from beltid.config import ConfigSource
    from beltid.stages.reporter import Options

BUILT_IN: Final = "built-in 5PK rig"
SUFFIX: Final = ".parquet"
OTHER_FORMATS: Final = frozenset({".csv", ".txt", ".tsv", ".xlsx", ".json", ".yaml", ".html"})
"""File endings that do not fit a result, which is always Parquet."""
UNCERTAINTY: Final = "uncertainty"
"""Section of the config where it also matters which values are stated and which are defaults."""
LARGE: Final = 64 << 20
"""Size of inputs from which hashing takes longer than starting a thread [bytes]."""
FOREIGN: Final = "a file that beltid did not write"
OF_BENCH: Final = (
    "belt.axial_stiffness_N",
    "belt.bending_stiffness_N_m2",
    "rig.kind",
    "rig.pulley_radius_m",
    "rig.span_length_m",
    "rig.supports",
)
"""Keys of the config that identify a belt and its friction rig."""


def reading(kind: str) -> tuple[str, ...]:
    """Return the parts of the config that matter for how a recording of this kind is read."""
    return (f"columns.{kind}", f"units.{kind}", f"runs.{kind}", "dialect")


class Stale(Exception):
    """Raised if an artifact has to be built but the caller asked for a check only."""


@dataclass(frozen=True, slots=True)
class Built:
    """An artifact that exists.

    Attributes
    ----------
    artifact : Artifact
        The artifact as read back from its file.
    up_to_date : bool
        Whether it had already been built from the same inputs.
    """

    artifact: Artifact
    up_to_date: bool

    def summary(self, stage: str, title: str, **shown: Any) -> Summary:
        """Summarise it: the fields common to all artifacts, plus `shown` (see `Summary`)."""
        metadata = self.artifact.metadata
        common: dict[str, Any] = {
            "out": self.artifact.path,
            "notes": metadata.notes,
            "warnings": metadata.warnings,
            "up_to_date": self.up_to_date,
            "origin": metadata.origin,
        }
        return Summary(stage, title, **(common | shown))


@dataclass(slots=True, eq=False)
class Build:
    """Inputs, settings and output path of one artifact of a stage.

    Attributes
    ----------
    kind : str
        Kind of the artifact.
    source : ConfigSource
        The config and its origin.
    uses : tuple of str
        Sections of the config that matter for it; of those with a part per kind of recording, the
        part, such as ``columns.rig``.
    inputs : mapping of str to Path
        Files it is built from, by their role.
    out : Path
        Output path.
    options : Options
        Force, reporter, whether only to check.
    choices : dict
        Settings of this call that are not in the config.
    guests : tuple of str
        Roles of inputs that may be of another bench.
    """

    kind: str
    source: ConfigSource
    uses: tuple[str, ...]
    inputs: Mapping[str, Path]
    out: Path
    options: Options
    choices: dict[str, Any] = field(default_factory=dict)
    guests: tuple[str, ...] = ()
    _seen: dict[str, Signature] = field(init=False)
    _contents: Future[dict[str, Content]] = field(init=False)
    _artifacts: dict[str, Artifact] = field(init=False)

    def up_to_date(self) -> Built | None:
        """Return the existing artifact if it is up to date, or None if it has to be built.

        Raises
        ------
        InputError
            If an input is missing, or `out` is an input or a file that must not be replaced.
        ArtifactError
            If `out` cannot be written, or the inputs do not fit together.
        Stale
            If it has to be built but `options.peek` is set.
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
            reporter.detail(f"{self.out}: inputs or settings have changed, built again")
        self._read_artifacts()
        return None

    def write(self, outcome: Outcome[Any]) -> Built:
        """Write the outcome and return the artifact as read back.

        Raises
        ------
        InputError
            If an input has changed since it was read.
        ArtifactError
            If a value violates the schema, or the file cannot be written.
        """
        self._refuse_changed()
        data = artifact_bytes(self.kind, outcome.columns, self._metadata(outcome), str(self.out))
        artifact = artifact_from_bytes(data, self.out, self.kind)
        write_bytes(self.out, data)
        return Built(artifact, up_to_date=False)

    def read(self, role: str, section: str = "") -> Artifact:
        """Read the artifact in a role; warn if it was made for another bench.

        Parameters
        ----------
        role : str
            Role and kind of the artifact.
        section : str
            As in `of_other_bench`.
        """
        artifact = self._artifacts[role]
        for line in of_other_bench(artifact, self.source, section):
            self.options.reporter.warn(line)
        return artifact

    @property
    def settings(self) -> dict[str, Any]:
        """Every setting that matters, by its key, as plain JSON values."""
        values = self.source.config.model_dump(mode="json")
        recorded = any(role in RECORDINGS for role in self.inputs)
        uses = (*self.uses, "data.origin") if recorded else self.uses
        stated: dict[str, Any] = {}
        if UNCERTAINTY in uses:
            stated["uncertainty_stated"] = sorted(self.source.config.uncertainty.model_fields_set)
        return {**{name: _value(values, name) for name in uses}, **stated, **plain(self.choices)}

    def _metadata(self, outcome: Outcome[Any]) -> Metadata:
        path = self.source.path
        return outcome.metadata(
            config_sha256=self.source.config.sha256,
            inputs=self._hashes(),
            ancestors=ancestors_of(self._artifacts.values()),
            settings=self.settings,
            # name without folder, so that the same input gives the same bytes anywhere
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
        """Return every input by its role, with the run tables of the recordings."""
        tables = self.source.config.run_tables
        run_tables = {f"{role}_runs": tables[role] for role in self.inputs if role in tables}
        return {**self.inputs, **run_tables}

    def _signatures(self) -> dict[str, Signature]:
        """Return the file-system signatures (size, time) of every input."""
        return {role: signature_of(path) for role, path in self._files().items()}

    def _read_contents(self) -> Future[dict[str, Content]]:
        """Start hashing the inputs; large files are hashed in a thread while the work begins.

        The thread is a daemon, so that an interrupted program does not wait for it.
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
        except Exception as error:  # raised again when the contents are requested
            contents.set_exception(error)

    def _hashes(self) -> dict[str, str]:
        """Return the SHA-256 of every input file by its role."""
        return {role: content.sha256 for role, content in self._contents.result().items()}

    def _input_contents(self) -> dict[str, Content]:
        """Return the content of every input file by its role."""
        folders = [  # an artifact is a single file; only recordings may be folders
            f"{path}: is a folder, a {role} artifact is needed, "
            f"a file such as {path / role}{SUFFIX}"
            for role, path in self.inputs.items()
            if role in ARTIFACTS and path.is_dir()
        ]
        if folders:
            raise ArtifactError(folders)
        tables = self.source.config.run_tables
        return {
            role: content_of(path, [tables[role]] if role in tables else [])
            for role, path in self._files().items()
        }

    def _read_artifacts(self) -> None:
        """Read the inputs that are artifacts; refuse those that do not fit together."""
        paths = {role: path for role, path in self.inputs.items() if role in ARTIFACTS}
        self._artifacts = {role: read_artifact(path, role) for role, path in paths.items()}
        hosts = dict(self._artifacts)
        guests = [hosts.pop(role) for role in self.guests if role in hosts]
        refuse_misfits(hosts.values(), guests)

    def _origin(self) -> Origin | None:
        """Return the combined origin of the inputs' data."""
        return combined_origin([self._origin_of(role, path) for role, path in self.inputs.items()])

    def _origin_of(self, role: str, path: Path) -> Origin | None:
        """Return the origin of one input: from the config for a recording, else its own."""
        if role in self._artifacts:
            return self._artifacts[role].metadata.origin
        if role not in RECORDINGS:  # of another bench: it does not change the origin of this one
            return "measured"
        is_simulated = self._contents.result()[role].is_parquet and may_be_artifact(path)
        return "synthetic" if is_simulated else self.source.config.data.origin

    def _refuse_changed(self) -> None:
        """Raise an error if an input has changed since its hash was taken."""
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

    # --- output path

    def _check_place(self) -> Artifact | None:
        """Return the artifact of this kind at `out`; refuse files that must not be replaced."""
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
            )
        _refuse_unwritable(out)
        return existing

    def _refuse_inputs(self) -> None:
        """Refuse to write over an input or a recording named in the config."""
        out = self.out
        for role, path in self.inputs.items():
            if _same_file(path, out):
                text = f"{out}: is the {role} input of this command, name another --out"
                raise InputError(text)
        for kind, path in self.source.config.data.files.items():
            if _same_file(path, out):
                text = f"{out}: is the {kind} recording of the config, name another --out"
                raise InputError(text)


def of_other_bench(artifact: Artifact, source: ConfigSource, section: str = "") -> list[str]:
    """Warn if an artifact was made for another belt or rig than the config in use states.

    Parameters
    ----------
    artifact : Artifact
        Holds the settings it was made with.
    source : ConfigSource
        The config in use.
    section : str
        Compare the keys of this section only, such as ``belt``; "" compares all of `OF_BENCH`.

    Returns
    -------
    list of str
        A warning with all differences; empty if there are none.
    """
    stored = artifact.metadata.settings
    differing = []
    for key in OF_BENCH:
        name, _, field = key.partition(".")
        value = getattr(getattr(source.config, name), field)
        before = stored.get(name, {}).get(field, value)
        if before != value and section in ("", name):
            differing.append(f"{key} = {before} (now {value})")
    if not differing:
        return []
    return [
        f"{artifact.path}: made with {', '.join(differing)}: if it is not of this belt and bench, "
        f"use its own config ({source.origin} is in use)"
    ]


def already_exists(path: Path) -> str:
    """Return the problem of a file that only --force overwrites."""
    return f"{path}: already exists; use --force to overwrite, or name another --out"


def _value(values: Mapping[str, Any], key: str) -> Any:
    section, _, name = key.partition(".")
    return plain(values[section][name] if name else values[section])


def _same_file(path: Path, other: Path) -> bool:
    if os.path.realpath(path) == os.path.realpath(other):
        return True
    try:
        return os.path.samefile(path, other)
    except (OSError, ValueError):  # one of the files does not exist
        return False


def _existing(out: Path, kind: str) -> tuple[Artifact | None, str]:
    """Return the artifact of this kind at `out`, or the name of whatever else is there."""
    if not out.exists() or out.is_dir():
        return None, ""
    try:
        return read_artifact(out, kind), ""
    except ArtifactError:
        pass
    other_kind = stated_kind(out) if out.is_file() else None
    if other_kind == kind:
        return None, ""  # damaged or written with an old schema: may be replaced
    return None, f"a {other_kind} artifact" if other_kind else FOREIGN


def _refuse_unwritable(out: Path) -> None:
    """Raise an error before the work starts if the result cannot be written."""
    if out.is_dir():
        raise ArtifactError(f"{out}: is a folder, name a file in it")
    folder = out.parent
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    if not folder.is_dir():
        text = f"{out}: not written: {folder} is a file, not a folder"
        raise ArtifactError(text)
    if not os.access(folder, os.W_OK | os.X_OK):
        text = f"{out}: not written: no permission to write in {folder}"
        raise ArtifactError(text)
