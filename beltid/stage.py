"""Stages: a function from inputs and config to an `Outcome`, and all that follows from it.

One decorated function is the Python function (tables and results in memory), the command (files),
the step of the chain, and the test whether a result is up to date. It reads only those sections of
the config that it names; a test poisons all others.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from beltid._version import __version__
from beltid.errors import ArtifactError, InputError
from beltid.notes import log
from beltid.store import disk
from beltid.store.artifact import (
    RECORDINGS,
    Artifact,
    Record,
    Said,
    artifact_from_bytes,
    combined_origin,
    kind_in,
    may_be_artifact,
    plain,
    read_artifact,
    refuse_misfits,
    write_artifact,
)

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    from matplotlib.figure import Figure

    from beltid.config import Config, ConfigSource

Result = TypeVar("Result")
Kind = str | tuple[str, ...]  # of an input; or several, of which the file is one

SUFFIX = ".parquet"


@dataclass(frozen=True, slots=True, eq=False)
class Outcome(Said, Generic[Result]):
    """Result of a stage: a table, single results, further tables, and what the user should know."""

    columns: dict[str, np.ndarray]  #: the table; nan or None where a value is missing
    result: Result  #: the scientific result with all its properties
    kind: str = field(default="", kw_only=True)  #: of the table

    def to_frame(self) -> pd.DataFrame:
        """Return the table as a pandas DataFrame, whose ``attrs`` are the facts about a rig."""
        import pandas as pd

        frame = pd.DataFrame(
            {n: list(values) if values.ndim > 1 else values for n, values in self.columns.items()}
        )
        frame.attrs |= {name: fact for name, fact in self.facts.items() if name.startswith("rig_")}
        return frame

    def said(self) -> dict[str, Any]:
        """Return what the record of an artifact says of the result, as plain JSON values."""
        return {
            of.name: plain(getattr(self, of.name))
            for of in fields(Record)
            if hasattr(self, of.name)
        }

    def plot(self, figure: str | None = None) -> Figure:
        """Plot the table with matplotlib, as ``beltid show`` does.

        The figure is labelled if the data are synthetic.

        Parameters
        ----------
        figure : str, optional
            Name of the figure; by default the most informative one.

        Raises
        ------
        InputError
            If there is no such figure; the message lists those that exist.
        """
        from beltid.report.charts import pictures_of
        from beltid.report.results import Sheet

        figures = {p.key: p.figure for p in pictures_of(Sheet.of(self.as_artifact()))}
        name = figure or next(iter(figures), "")
        if name not in figures:
            raise InputError(f"figure = {name}, must be one of: {', '.join(figures) or 'none'}")
        return figures[name]

    def save(self, path: str | Path, *, origin: str | None = None, force: bool = False) -> Path:
        """Write the table as an artifact (.parquet) that every command reads.

        Parameters
        ----------
        path : path
            The file.
        origin : {"measured", "synthetic"}, optional
            Origin of the data, which the file states; by default that of the result.
        force : bool
            Whether to overwrite an existing file.

        Raises
        ------
        InputError
            If the file has another ending, or already exists.
        ArtifactError
            If it cannot be written.
        """
        path, origin = Path(path), origin or self.origin
        if path.exists() and not force:
            raise InputError(f"{path}: already exists; force=True replaces it")
        if path.suffix != SUFFIX:
            raise InputError(f"{path}: must end in {SUFFIX}")
        write_artifact(path, self.columns, Record(**{**self.said(), "origin": origin}))
        return path

    def as_artifact(self) -> Artifact:
        """Return the result as if it were read from a file."""
        return Artifact(self.columns, Record(**self.said()), Path(self.kind), "")

    def __repr__(self) -> str:
        from beltid.report.results import text_of

        return text_of(self.as_artifact())


@dataclass(frozen=True, slots=True)
class Input:
    """A file that a stage reads: its kind, and its name in the record."""

    path: Path
    kind: str
    name: str
    besides: list[Path]  # files among those of the path that do not belong to it

    def content(self) -> str:
        """Return the checksum of what is there now."""
        from beltid.bench.files import content_of

        return content_of(self.path, self.besides)


@dataclass(eq=False)
class Stage:
    """A stage: ``stage(tables..., config)`` in memory, ``run(source, files, out)`` on files."""

    name: str  # of the command
    makes: str  # kind of the table
    reads: Mapping[str, Kind]  # parameter -> kind of input; a keyword may be left out
    uses: tuple[str, ...]  # sections of the config that it reads
    compute: Callable[..., Outcome[Any]]
    file: str | Callable[..., str] = ""  # name of the file, or its function of the options
    finds: Callable[[dict[str, Path]], dict[str, Path]] | None = None
    """Adds inputs that lie beside the given ones."""
    is_command: bool = True

    def __post_init__(self) -> None:
        self.signature = inspect.signature(self.compute)

    @property
    def options(self) -> list[inspect.Parameter]:
        """Keywords of the function that are choices of the call."""
        return [
            p
            for p in self.signature.parameters.values()
            if p.kind is p.KEYWORD_ONLY and p.name not in (*self.reads, "workers")
        ]

    def file_name(self, options: Mapping[str, Any] | None = None) -> str:
        """Return the name of the file that it writes, by default without any choice."""
        if callable(self.file):
            return self.file(**{p.name: p.default for p in self.options} | dict(options or {}))
        return self.file or f"{self.makes}{SUFFIX}"

    def __call__(self, *args: Any, **kwargs: Any) -> Outcome[Any]:
        """Compute from tables, results and laws in memory."""
        from beltid.bench.recording import recording_in
        from beltid.config import load_config

        bound = self.signature.bind(*args, **kwargs)
        bound.apply_defaults()
        given = bound.arguments
        config = as_measured(load_config(given.get("config")), given.get("friction"))
        # a result has its own origin; a plain table beside it takes that one, alone the config's
        results = map(given.get, self.reads)
        origins = [r.origin for r in results if isinstance(r, (Outcome, Artifact))]
        for role, kind in self.reads.items():
            if kind in RECORDINGS:
                given[role] = recording_in(given[role], str(kind), config)
        if config.data.origin or not origins:
            origins.append(config.data.origin)
        outcome = self.compute(**{**given, "config": config})
        return replace(outcome, kind=self.makes, origin=combined_origin(origins))

    def run(
        self,
        source: ConfigSource,
        files: Mapping[str, Path],
        out: Path,
        *,
        force: bool = False,
        **options: Any,
    ) -> tuple[Artifact, bool]:
        """Compute from files, unless `out` was made from the same: the artifact, whether it was.

        Options that the function does not have are left out.
        """
        reads, planned, existing = self.look(source, files, out, force=force, **options)
        if existing is not None:
            return existing, True
        if out.exists() and not force:
            log.debug("%s: inputs or settings have changed, built again", out)
        items, made_of = self._read(reads, planned.inputs, source.config)
        known = {n: x for n, x in options.items() if n in self.signature.parameters}
        known["config"] = as_measured(source.config, items.get("friction"))
        outcome = self.compute(**dict.fromkeys(self.reads) | items | known)
        heard = [note for item in items.values() for note in getattr(item, "notes", ())]
        outcome = replace(outcome, kind=self.makes, notes=(*heard, *outcome.notes))
        if changed := [f for f in reads.values() if f.content() != planned.inputs[f.name]]:
            raise InputError([f"{file.path}: was changed while it was read" for file in changed])
        record = replace(planned, **outcome.said() | made_of)
        if self.file_name().endswith(SUFFIX):
            return write_artifact(out, outcome.columns, record), False
        # for the operator of the bench
        text = outcome.to_frame().to_csv(index=False, float_format="%.6g", lineterminator="\n")
        disk.write_bytes(out, text.encode())
        return Artifact(outcome.columns, record, out, ""), False

    def look(
        self,
        source: ConfigSource,
        files: Mapping[str, Path],
        out: Path,
        *,
        force: bool = False,
        **options: Any,
    ) -> tuple[dict[str, Input], Record, Artifact | None]:
        """Return what is read, as far as known the record, and what was made of the same before."""
        config, reads = source.config, dict[str, Input]()
        given = dict(files) if self.finds is None else self.finds(dict(files))
        for role in (role for role in self.reads if role in given):
            kind = self.reads[role]
            name = str(kind)
            if not isinstance(kind, str):  # the artifact, or else the recording of another bench
                kind = kind[0] if may_be_artifact(given[role]) else kind[1]
                name = "recording" if kind in RECORDINGS else kind
            besides = [config.run_tables[kind]] if kind in config.run_tables else []
            reads[role] = Input(given[role], kind, name, besides)
        kinds = [file.kind for file in reads.values()]
        for kind, path in config.run_tables.items():
            if kind in kinds:
                reads[f"{kind}_runs"] = Input(path, f"{kind}_runs", f"{kind}_runs", [])
        existing = self._check_place(source, reads, out, force=force)
        inputs = {file.name: file.content() for file in reads.values()}
        settings = self._settings(config, kinds, options)
        stated = {
            name: sorted(getattr(config, name).model_fields_set)
            for name in config.model_fields_set.intersection(self.uses)
        }
        parts = [__version__, disk.source_sha256(), self.name, inputs, settings, stated]
        planned = Record(
            self.makes,
            made_by=self.name,
            made_from=disk.sha256(json.dumps(parts, sort_keys=True).encode()),
            software=f"beltid {__version__}",
            sources=disk.source_sha256(),
            inputs=inputs,
            config="built-in 5PK rig" if source.path is None else source.path.name,
            config_sha256=config.sha256,
            settings=settings,
        )
        fresh = existing is not None and existing.record.made_from == planned.made_from
        return reads, planned, existing if fresh and not force else None

    def _settings(
        self, config: Config, kinds: Iterable[str], options: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Return all settings that matter as plain JSON values: sections of the config, options."""
        values = config.model_dump(mode="json")
        found = {name: values[name] for name in self.uses}
        if recorded := [kind for kind in kinds if kind in RECORDINGS]:
            found |= {"data": {"origin": values["data"]["origin"]}, "dialect": values["dialect"]}
            for part in ("columns", "units", "runs"):
                found[part] = {kind: values[part][kind] for kind in recorded}
        chosen = {p.name: options.get(p.name, p.default) for p in self.options if p.name != "jobs"}
        return found | plain({name: value for name, value in chosen.items() if value})

    def _check_place(
        self, source: ConfigSource, reads: Mapping[str, Input], out: Path, *, force: bool
    ) -> Artifact | None:
        """Refuse a place that is not for the result; return the artifact that is there."""
        data, existing, ending = b"", None, Path(self.file_name()).suffix
        if ending == SUFFIX and out.suffix == SUFFIX and out.is_file():
            with disk.opened(out, ArtifactError) as file:
                data = file.read()
        kind = kind_in(data)
        if kind == self.makes:
            with contextlib.suppress(ArtifactError):  # damaged, or of an earlier version
                existing = artifact_from_bytes(data, out, kind)
        whose = disk.OURS if kind == self.makes else f"a {kind} artifact" if kind else disk.FOREIGN
        inputs = {f"{file.kind} file that is read": file.path for file in reads.values()}
        for name, path in source.config.data.files.items():
            inputs[f"{name} recording of the config"] = path
        owner = (lambda path: whose) if ending == SUFFIX else None
        disk.check_place(out, (ending,), owner, inputs=inputs, force=force)
        return existing

    def _read(
        self, reads: Mapping[str, Input], contents: Mapping[str, str], config: Config
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Read the inputs, which must fit together; return also their origin and ancestors."""
        from beltid.bench.recording import read_recording

        items, origins, ancestors = dict[str, Any](), list[str | None](), dict[str, str]()
        hosts, guests = list[Artifact](), list[Artifact]()
        for role, file in ((role, reads[role]) for role in self.reads if role in reads):
            if file.kind not in RECORDINGS:
                items[role] = found = read_artifact(file.path, file.kind)
                p = self.signature.parameters[role]
                (guests if p.kind is p.KEYWORD_ONLY else hosts).append(found)
                origins.append(found.origin)
                ancestors |= found.record.ancestors | {found.name: found.sha256}
                continue
            items[role] = recording = read_recording(file.path, file.kind, config)
            what = "rows" if recording.kind == "points" else "samples"
            log.info("%s: %s %s", file.path, len(next(iter(recording.columns.values()))), what)
            is_own = file.name == file.kind  # another bench tells nothing of this one
            if is_own or recording.is_artifact:
                origins.append("synthetic" if recording.is_artifact else config.data.origin)
            if is_own:
                ancestors[file.name] = contents[file.name]
        refuse_misfits(hosts, guests)
        return items, {
            "origin": combined_origin(origins or [config.data.origin]),
            "ancestors": ancestors,
        }


STAGES: dict[str, Stage] = {}  # by the name of their command, in the order of the work


def stage(
    name: str, **about: Any
) -> Callable[[Callable[..., Outcome[Any]]], Callable[..., Outcome[Any]]]:
    """Make a stage of a function, in `STAGES`; see `Stage`. Returns the function for Python."""

    def registered(compute: Callable[..., Outcome[Any]]) -> Callable[..., Outcome[Any]]:
        made = STAGES[name] = Stage(name, compute=compute, **about)

        return functools.wraps(compute)(lambda *args, **kwargs: made(*args, **kwargs))

    return registered


def as_measured(config: Config, friction: Any) -> Config:
    """Return a config with what the channels of the rig showed when a friction table was made."""
    facts = getattr(friction, "facts", getattr(friction, "attrs", {})).items()
    return config.with_rig(
        {key.removeprefix("rig_"): word for key, word in facts if key.startswith("rig_")}
    )
