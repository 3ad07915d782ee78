"""Stages: a function from inputs and config to an `Outcome`, and all that follows from it.

One decorated function is the Python function (tables and results in memory), the command (files),
the step of the chain, and the test whether a result is up to date. It reads only those sections of
the config that it names; a test poisons all others.
"""

from __future__ import annotations

import functools
import inspect
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Generic, TypeVar

from beltid._version import __version__
from beltid.errors import EXIT_OUT_OF_TOLERANCE, InputError
from beltid.notes import log

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    from matplotlib.figure import Figure

    from beltid.config import Config, ConfigSource
    from beltid.store.artifact import Artifact, Origin, Record

Result = TypeVar("Result")
Kind = str | tuple[str, ...]
"""Kind of an input; or several, of which the file is one."""

SUFFIX: Final = ".parquet"
RECORDINGS: Final = ("press", "rig", "speedloss")
HIDDEN: Final = ("workers",)
"""Keywords of a stage that are no options."""
NO_MATTER: Final = ("jobs", *HIDDEN)
"""Keywords that change no result."""
BUILT_IN: Final = "built-in 5PK rig"


@dataclass(frozen=True, slots=True, eq=False)
class Outcome(Generic[Result]):
    """Result of a stage: a table, single results, further tables, and what the user should know."""

    columns: dict[str, np.ndarray]
    """The table, with the columns of its kind; nan or None where a value is missing."""
    result: Result
    """The scientific result with all its properties."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """Single results by name; the unit is in the name."""
    tables: Mapping[str, Any] = field(default_factory=dict)
    """Further tables: lists of rows."""
    validity: Mapping[str, Any] = field(default_factory=dict)
    """Ranges within which the result holds."""
    set_aside: list[dict[str, Any]] = field(default_factory=list)
    """Runs or points that were set aside, with the reason."""
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    verdict: str = ""
    passed: bool | None = None
    """Whether what was judged is within tolerance, None if nothing was."""
    kind: str = ""
    """Kind of the table."""
    origin: Origin | None = None
    """Origin of the data, "measured" or "synthetic"; None if not stated."""

    def to_frame(self) -> pd.DataFrame:
        """Return the table as a pandas DataFrame, whose ``attrs`` are the facts about a rig."""
        import pandas as pd

        frame = pd.DataFrame(
            {n: list(values) if values.ndim > 1 else values for n, values in self.columns.items()}
        )
        frame.attrs |= {name: fact for name, fact in self.facts.items() if name.startswith("rig_")}
        return frame

    def record(self, **made: Any) -> Record:
        """Return the record of an artifact that holds the table, with further provenance."""
        from beltid.store.artifact import Record

        said = ("facts", "tables", "validity", "set_aside", "verdict", "passed", "origin")
        stated: dict[str, Any] = {name: getattr(self, name) for name in said}
        lines = {"notes": list(self.notes), "warnings": list(self.warnings)}
        return Record(self.kind, **{**stated, **lines, **made})

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
        from beltid.report.results import sheet_of

        figures = {p.key: p.figure for p in pictures_of(sheet_of(self.as_artifact()))}
        name = figure or next(iter(figures), "")
        if name not in figures:
            raise InputError(f"figure = {name}, must be one of: {', '.join(figures) or 'none'}")
        return figures[name]

    def save(self, path: str | Path, *, origin: Origin | None = None, force: bool = False) -> Path:
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
        from beltid.store.artifact import write_artifact

        path, origin = Path(path), origin or self.origin
        if path.exists() and not force:
            raise InputError(f"{path}: already exists; force=True replaces it")
        if path.suffix != SUFFIX:
            raise InputError(f"{path}: must end in {SUFFIX}")
        write_artifact(path, self.columns, self.record(origin=origin))
        return path

    def as_artifact(self) -> Artifact:
        """Return the result as if it were read from a file."""
        from beltid.store.artifact import Artifact, plain

        record = self.record()
        record = replace(record, facts=plain(record.facts), tables=plain(record.tables))
        return Artifact(self.columns, record, Path(self.kind), "")

    def __repr__(self) -> str:
        from beltid.report.view import text_of

        return text_of(self.as_artifact())


@dataclass(frozen=True, slots=True)
class Built:
    """An artifact that exists, and whether an earlier one from the same inputs was kept."""

    artifact: Artifact
    up_to_date: bool


@dataclass(frozen=True, slots=True)
class Input:
    """A file that a stage reads: its kind, its name in the record, its content when it was read."""

    path: Path
    kind: str
    name: str
    besides: list[Path]
    """Files among those of the path that do not belong to it."""
    seen: Any
    sha256: str

    @classmethod
    def of(cls, path: Path, kind: str, name: str, config: Config) -> Input:
        """Return an input with the hash of its content."""
        from beltid.bench.files import content_of, signature_of

        besides = [table for of, table in config.run_tables.items() if of == kind]
        seen = signature_of(path)
        return cls(path, kind, name, besides, seen, content_of(path, besides))

    @property
    def is_recording(self) -> bool:
        """Whether it is no artifact."""
        return self.kind in RECORDINGS

    def has_changed(self) -> bool:
        """Return whether the file has changed since."""
        from beltid.bench.files import content_of, signature_of

        if signature_of(self.path) == self.seen:
            return False
        return content_of(self.path, self.besides) != self.sha256


@dataclass(frozen=True, slots=True)
class Work:
    """One call of a stage on files: what it reads and depends on."""

    source: ConfigSource
    files: Mapping[str, Input]
    tables: Sequence[Input]
    """Tables of the runs of its recordings."""
    options: Mapping[str, Any]
    settings: Mapping[str, Any]
    made_from: str = ""

    @property
    def inputs(self) -> dict[str, str]:
        """SHA-256 of all that is read, by name."""
        return {file.name: file.sha256 for file in (*self.files.values(), *self.tables)}


@dataclass(eq=False)
class Stage:
    """A stage: ``stage(tables..., config)`` in memory, ``run(source, files, out)`` on files."""

    name: str
    """Name of the command."""
    makes: str
    """Kind of the table."""
    reads: Mapping[str, Kind]
    """Parameter -> kind of recording or artifact; a keyword is an input that may be left out."""
    uses: tuple[str, ...]
    """Sections of the config that it reads."""
    compute: Callable[..., Outcome[Any]]
    file: str | Callable[..., str] = ""
    """Name of the file, or a function of the options that gives it; default: the kind."""
    guests: tuple[str, ...] = ()
    """Inputs that may be of another bench."""
    finds: Callable[[dict[str, Path]], dict[str, Path]] | None = None
    """Adds inputs that lie beside the given ones."""
    writes: Callable[[Outcome[Any]], bytes] | None = None
    """Turns the outcome into the bytes of a file that is no artifact."""
    fails_with: int = EXIT_OUT_OF_TOLERANCE
    """Exit status if `passed` is False."""
    is_command: bool = True

    def __post_init__(self) -> None:
        self.signature = inspect.signature(self.compute)

    @property
    def options(self) -> list[inspect.Parameter]:
        """Keywords of the function that are choices of the call."""
        return [
            p
            for p in self.signature.parameters.values()
            if p.kind is p.KEYWORD_ONLY and p.name not in (*self.reads, *HIDDEN)
        ]

    def file_name(self, options: Mapping[str, Any]) -> str:
        """Return the name of the file that it writes."""
        name = self.file(**options) if callable(self.file) else self.file
        return name or f"{self.makes}{SUFFIX}"

    def __call__(self, *args: Any, **kwargs: Any) -> Outcome[Any]:
        """Compute from tables, results and laws in memory."""
        from beltid.bench.recording import recording_in
        from beltid.config import load_config
        from beltid.store.artifact import Artifact, combined_origin

        bound = self.signature.bind(*args, **kwargs)
        bound.apply_defaults()
        given = dict(bound.arguments)
        config = as_measured(load_config(given.get("config")), given.get("friction"))
        given["config"] = config
        # a result has its own origin; a plain table beside it takes that one, alone the config's
        results = map(given.get, self.reads)
        origins = [r.origin for r in results if isinstance(r, (Outcome, Artifact))]
        for role, kind in self.reads.items():
            if kind in RECORDINGS:
                given[role] = recording_in(given[role], str(kind), config)
        outcome = self.compute(**given)
        if config.data.origin or not origins:
            origins.append(config.data.origin)
        return replace(outcome, kind=self.makes, origin=combined_origin(origins))

    def run(
        self,
        source: ConfigSource,
        files: Mapping[str, Path],
        out: Path,
        *,
        force: bool = False,
        workers: Any = None,
        **options: Any,
    ) -> Built:
        """Compute from files, unless `out` was made from the same."""
        work, existing = self.look(source, files, out, force=force, **options)
        if existing is not None:
            return Built(existing, up_to_date=True)
        if out.exists() and not force:
            log.debug("%s: inputs or settings have changed, built again", out)
        items = self._read(work)
        given: dict[str, Any] = {role: items.get(role) for role in self.reads}
        given |= {"config": as_measured(source.config, given.get("friction")), **work.options}
        if workers is not None and "workers" in self.signature.parameters:
            given["workers"] = workers
        outcome = replace(self.compute(**given), kind=self.makes)
        if changed := [file.path for file in work.files.values() if file.has_changed()]:
            raise InputError([f"{path}: was changed while it was read" for path in changed])
        return Built(self._write(work, outcome, items, out), up_to_date=False)

    def look(
        self,
        source: ConfigSource,
        files: Mapping[str, Path],
        out: Path,
        *,
        force: bool = False,
        **options: Any,
    ) -> tuple[Work, Artifact | None]:
        """Return the work, and what it made before from the same inputs; compute nothing."""
        config = source.config
        given = dict(files) if self.finds is None else self.finds(dict(files))
        chosen = {p.name: options.get(p.name, p.default) for p in self.options}
        reads = {role: kind for role, kind in self.reads.items() if role in given}
        kinds = {role: _kind_of(kind, given[role]) for role, kind in reads.items()}
        existing = self._check_place(source, given, kinds, out, force=force)
        inputs = {
            role: Input.of(given[role], kind, _name_of(kind, reads[role]), config)
            for role, kind in kinds.items()
        }
        tables = [
            Input.of(table, "", f"{kind}_runs", config)
            for kind, table in config.run_tables.items()
            if kind in kinds.values()
        ]
        settings = self._settings(config, kinds.values(), chosen)
        work = Work(source, inputs, tables, chosen, settings)
        work = replace(work, made_from=self._made_from(work))
        fresh = existing is not None and existing.record.made_from == work.made_from
        return work, existing if fresh and not force else None

    def _settings(
        self, config: Config, kinds: Iterable[str], options: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Return all settings that matter as plain JSON values: sections of the config, options."""
        from beltid.store.artifact import plain

        values = config.model_dump(mode="json")
        found = {name: values[name] for name in self.uses}
        if recorded := [kind for kind in kinds if kind in RECORDINGS]:
            found |= {"data": {"origin": values["data"]["origin"]}, "dialect": values["dialect"]}
            for part in ("columns", "units", "runs"):
                found[part] = {kind: values[part][kind] for kind in recorded}
        stated = {name: plain(v) for name, v in options.items() if v and name not in NO_MATTER}
        return found | stated

    def _made_from(self, work: Work) -> str:
        from beltid.store.artifact import plain
        from beltid.store.disk import sha256, source_sha256

        config = work.source.config
        stated = {
            name: sorted(getattr(config, name).model_fields_set)
            for name in self.uses
            if name in config.model_fields_set
        }
        parts = [__version__, source_sha256(), self.name, work.inputs, work.settings, stated]
        return sha256(json.dumps(plain(parts), sort_keys=True).encode())

    def _check_place(
        self,
        source: ConfigSource,
        files: Mapping[str, Path],
        kinds: Mapping[str, str],
        out: Path,
        *,
        force: bool,
    ) -> Artifact | None:
        """Refuse a place that is not for the result; return the artifact that is there."""
        from beltid.errors import ArtifactError
        from beltid.store.artifact import read_artifact, stated_kind
        from beltid.store.place import FOREIGN, OURS, anyone_s, check_place

        named = {
            f"{kind} recording of the config": p for kind, p in source.config.data.files.items()
        }
        of = {kind: "recording" if kind in RECORDINGS else "table" for kind in kinds.values()}
        read = {f"{kind} {of[kind]} that is read": files[role] for role, kind in kinds.items()}
        existing = None

        def whose(path: Path) -> str:
            nonlocal existing
            try:
                existing = read_artifact(path, self.makes)
            except ArtifactError:
                kind = stated_kind(path) if path.is_file() else None
                if kind == self.makes:  # damaged, or of an earlier version
                    return OURS
                return f"a {kind} artifact" if kind else FOREIGN
            return OURS

        ending = Path(self.file_name({p.name: p.default for p in self.options})).suffix
        owner = whose if self.writes is None else anyone_s
        check_place(out, (ending,), owner, inputs=read | named, force=force)
        return existing

    def _read(self, work: Work) -> dict[str, Any]:
        """Read the inputs; refuse artifacts that do not fit together."""
        from beltid.bench.recording import read_recording
        from beltid.store.artifact import Artifact, read_artifact
        from beltid.store.together import refuse_misfits

        config, items = work.source.config, dict[str, Any]()
        for role, file in work.files.items():
            if file.is_recording:
                items[role] = read_recording(file.path, file.kind, config)
                what = "rows" if items[role].kind == "points" else "samples"
                log.info("%s: %s %s", file.path, items[role].n_samples, what)
            else:
                items[role] = read_artifact(file.path, file.kind)
        artifacts = {role: item for role, item in items.items() if isinstance(item, Artifact)}
        guests = [artifacts[role] for role in self.guests if role in artifacts]
        refuse_misfits([a for role, a in artifacts.items() if role not in self.guests], guests)
        return items

    def _write(
        self, work: Work, outcome: Outcome[Any], items: Mapping[str, Any], out: Path
    ) -> Artifact:
        from beltid.store.artifact import Artifact, combined_origin, plain, write_artifact
        from beltid.store.disk import sha256, source_sha256, write_bytes
        from beltid.store.together import ancestors_of

        config, path, files = work.source.config, work.source.path, work.files
        artifacts = [item for item in items.values() if isinstance(item, Artifact)]
        origins = []
        for role, item in items.items():
            if isinstance(item, Artifact):
                origins.append(item.origin)
            elif item.is_artifact:  # a simulated recording
                origins.append("synthetic")
            elif files[role].name == files[role].kind:  # another bench tells nothing of this one
                origins.append(config.data.origin)
        record = outcome.record(
            made_by=self.name,
            made_from=work.made_from,
            software=f"beltid {__version__}",
            sources=source_sha256(),
            origin=combined_origin(origins or [config.data.origin]),
            inputs=work.inputs,
            ancestors={
                **ancestors_of(artifacts),
                **{f.name: f.sha256 for f in files.values() if f.name in RECORDINGS},
            },
            # name without folder, so that the same input gives the same bytes anywhere
            config=BUILT_IN if path is None else path.name,
            config_sha256=config.sha256,
            settings=work.settings,
            notes=[*(n for i in items.values() for n in getattr(i, "notes", ())), *outcome.notes],
        )
        if self.writes is None:
            return write_artifact(out, outcome.columns, record)
        data = self.writes(outcome)
        write_bytes(out, data)
        stated = replace(record, facts=plain(record.facts), tables=plain(record.tables))
        return Artifact(outcome.columns, stated, out, sha256(data))


STAGES: Final[dict[str, Stage]] = {}
"""All stages by the name of their command, in the order of the work."""


def stage(
    name: str, **about: Any
) -> Callable[[Callable[..., Outcome[Any]]], Callable[..., Outcome[Any]]]:
    """Make a stage of a function, in `STAGES`; see `Stage`. Returns the function for Python."""

    def registered(compute: Callable[..., Outcome[Any]]) -> Callable[..., Outcome[Any]]:
        made = STAGES[name] = Stage(name, compute=compute, **about)

        @functools.wraps(compute)
        def call(*args: Any, **kwargs: Any) -> Outcome[Any]:
            return made(*args, **kwargs)

        return call

    return registered


def as_measured(config: Config, friction: Any) -> Config:
    """Return a config with what the channels of the rig showed when a friction table was made."""
    facts = getattr(friction, "facts", getattr(friction, "attrs", {})).items()
    return config.with_rig(
        {key.removeprefix("rig_"): word for key, word in facts if key.startswith("rig_")}
    )


def _kind_of(kind: Kind, path: Path) -> str:
    """Return which of several kinds a file is: the artifact, or else the recording."""
    from beltid.store.artifact import may_be_artifact

    if isinstance(kind, str):
        return kind
    return kind[0] if may_be_artifact(path) else kind[1]


def _name_of(kind: str, allowed: Kind) -> str:
    """Return the name of an input; a recording in the place of an artifact is of another bench."""
    return "recording" if kind in RECORDINGS and isinstance(allowed, tuple) else kind
