"""Stages: a function from inputs and config to an `Outcome`, and all that follows from it.

One decorated function is the Python function (tables and results in memory), the command (files),
the step of the chain, and the test whether a result is up to date. It reads only those sections of
the config that it names; a test poisons all others.
"""

from __future__ import annotations

import functools
import hashlib
import inspect
import json
from collections.abc import Callable, Mapping
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

    from beltid.bench.recording import Recording
    from beltid.config import Config, ConfigSource
    from beltid.store.artifact import Artifact, Origin, Record

Result = TypeVar("Result")
Kind = str | tuple[str, ...] | Callable[..., str]
"""Kind of an input; several, of which the file is one; or a function of the options."""

SUFFIX: Final = ".parquet"
RECORDINGS: Final = ("press", "rig", "speedloss", "points")
HIDDEN: Final = ("workers",)
"""Keywords of a stage that are no options: they change no result."""
NO_MATTER: Final = ("jobs", *HIDDEN)
BUILT_IN: Final = "built-in 5PK rig"
OF_BENCH: Final = (
    "belt.axial_stiffness_N",
    "belt.bending_stiffness_N_m2",
    "rig.kind",
    "rig.pulley_radius_m",
    "rig.span_length_m",
    "rig.supports",
)
"""Keys of the config that identify a belt and its friction rig."""


@dataclass(frozen=True, slots=True, eq=False)
class Outcome(Generic[Result]):
    """Result of a stage: a table, single results, further tables, and what the user should know.

    Attributes
    ----------
    columns : dict of str to ndarray
        The table, with the columns of its kind; nan or None where a value is missing.
    result : object
        The scientific result with all its properties.
    facts : dict
        Single results by name; the unit is in the name.
    tables : dict of str to list of dict
        Further tables.
    validity : dict
        Ranges within which the result holds.
    set_aside : list of dict
        Runs or points that were set aside, with the reason.
    notes, warnings : tuple of str
        What the user should know, and what the user should look into.
    verdict, passed : str, bool or None
        Verdict in words; whether what was judged is within tolerance, None if nothing was.
    kind : str
        Kind of the table.
    origin : {"measured", "synthetic"} or None
        Origin of the data; None if not stated.
    """

    columns: dict[str, np.ndarray]
    result: Result
    facts: Mapping[str, Any] = field(default_factory=dict)
    tables: Mapping[str, Any] = field(default_factory=dict)
    validity: Mapping[str, Any] = field(default_factory=dict)
    set_aside: list[dict[str, Any]] = field(default_factory=list)
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    verdict: str = ""
    passed: bool | None = None
    kind: str = ""
    origin: Origin | None = None

    def to_frame(self) -> pd.DataFrame:
        """Return the table as a pandas DataFrame."""
        import pandas as pd

        return pd.DataFrame(
            {n: list(values) if values.ndim > 1 else values for n, values in self.columns.items()}
        )

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
        """Write the table as an artifact (.parquet) that every command reads, or as .csv.

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
        from beltid.report.summary import csv_bytes
        from beltid.store.artifact import write_artifact
        from beltid.store.disk import write_bytes

        path, origin = Path(path), origin or self.origin
        if path.exists() and not force:
            raise InputError(f"{path}: already exists; force=True replaces it")
        if path.suffix == ".csv":
            write_bytes(path, csv_bytes(self.columns, origin))
        elif path.suffix == SUFFIX:
            write_artifact(path, self.columns, self.record(origin=origin))
        else:
            raise InputError(f"{path}: must end in .parquet or .csv")
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

    def _repr_html_(self) -> str:
        """Render the table for a notebook, with its warnings."""
        from html import escape

        frame = self.to_frame()[[n for n, values in self.columns.items() if values.ndim == 1]]
        warnings = "".join(f"<li>{escape(line)}</li>" for line in self.warnings)
        table = frame.to_html(
            max_rows=12, na_rep="", border=0, float_format="{:.5g}".format, escape=True
        )
        origin = " (synthetic data)" if self.origin == "synthetic" else ""
        return f"<p>{escape(self.kind)}{origin}: {len(frame)} rows</p><ul>{warnings}</ul>{table}"


@dataclass(frozen=True, slots=True)
class Built:
    """An artifact that exists, and whether an earlier one from the same inputs was kept."""

    artifact: Artifact
    up_to_date: bool


@dataclass(frozen=True, slots=True)
class Work:
    """One call of a stage on files: what it reads, writes and depends on."""

    source: ConfigSource
    files: Mapping[str, Path]
    kinds: Mapping[str, str]
    names: Mapping[str, str]
    out: Path
    options: Mapping[str, Any]
    settings: Mapping[str, Any]
    contents: Mapping[str, Any]
    seen: Mapping[str, Any]
    made_from: str

    @property
    def inputs(self) -> dict[str, str]:
        """SHA-256 of the inputs by role."""
        return {role: content.sha256 for role, content in self.contents.items()}


@dataclass(eq=False)
class Stage:
    """A stage: ``stage(tables..., config)`` in memory, ``stage.run(source, files, out)`` on files.

    Attributes
    ----------
    name : str
        Name of the command.
    makes : str
        Kind of the table.
    reads : mapping of str to Kind
        Parameter -> kind of recording or artifact; a keyword is an input that may be left out.
    uses : tuple of str
        Sections of the config that it reads.
    compute : callable
        The function.
    file : str or callable
        Name of the file, or a function of the options that gives it; default: the kind.
    bench : tuple of str
        Sections of the config in which the inputs must not differ without a warning.
    guests : tuple of str
        Inputs that may be of another bench.
    finds : callable, optional
        Adds inputs that lie beside the given ones.
    writes : callable, optional
        Turns the outcome into the bytes of a file that is no artifact.
    whose : callable, optional
        Says of such a file what it is; see `check_place`.
    fails_with : int
        Exit status if `passed` is False.
    is_command : bool
        Whether it is a command.
    """

    name: str
    makes: str
    reads: Mapping[str, Kind]
    uses: tuple[str, ...]
    compute: Callable[..., Outcome[Any]]
    file: str | Callable[..., str] = ""
    bench: tuple[str, ...] = ()
    guests: tuple[str, ...] = ()
    finds: Callable[[dict[str, Path]], dict[str, Path]] | None = None
    writes: Callable[[Outcome[Any]], bytes] | None = None
    whose: Callable[[Path], str] | None = None
    fails_with: int = EXIT_OUT_OF_TOLERANCE
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
        from beltid.config import load_config

        bound = self.signature.bind(*args, **kwargs)
        bound.apply_defaults()
        given = dict(bound.arguments)
        config = given["config"] = load_config(given.get("config"))
        items = [given[role] for role in self.reads]
        for role, kind in self._kinds(given).items():
            if kind in RECORDINGS:
                given[role] = _recording(given[role], kind, config)
        outcome = self.compute(**given)
        return replace(outcome, kind=self.makes, origin=_origin_of(items, config))

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
        """Compute from files, unless `out` was made from the same.

        Parameters
        ----------
        source : ConfigSource
            The config and its origin.
        files : mapping of str to Path
            Inputs by parameter.
        out : Path
            File to write.
        force : bool
            Compute again, and replace an artifact of another kind.
        workers : Workers, optional
            Run the heavy calls; by default this process.
        **options
            Choices of the call.

        Raises
        ------
        InputError, ArtifactError
            If an input is missing, damaged or does not belong to another, or `out` is a file that
            must stay.
        """
        work, existing = self.look(source, files, out, force=force, **options)
        if existing is not None:
            return Built(existing, up_to_date=True)
        if out.exists() and not force:
            log.debug("%s: inputs or settings have changed, built again", out)
        items = self._read(work)
        given: dict[str, Any] = {role: items.get(role) for role in self.reads}
        given |= {"config": source.config, **work.options}
        if workers is not None and "workers" in self.signature.parameters:
            given["workers"] = workers
        outcome = replace(self.compute(**given), kind=self.makes)
        _refuse_changed(work)
        return Built(self._write(work, outcome, items), up_to_date=False)

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
        from beltid.bench.files import content_of, signature_of

        given = dict(files)
        if self.finds is not None:
            given = self.finds(given)
        chosen = {p.name: options.get(p.name, p.default) for p in self.options}
        reads = {role: kind for role, kind in self._kinds(chosen).items() if role in given}
        kinds = {role: _kind_of(kind, given[role]) for role, kind in reads.items()}
        # a recording in the place of an artifact is of another bench
        names = {
            role: "recording" if kind in RECORDINGS and isinstance(reads[role], tuple) else kind
            for role, kind in kinds.items()
        }
        tables = {
            kind: table
            for kind, table in source.config.run_tables.items()
            if kind in kinds.values()
        }
        read = {**given, **{f"{kind}_runs": table for kind, table in tables.items()}}
        seen = {role: signature_of(path) for role, path in read.items()}
        existing = self._check_place(source, given, out, force=force)
        contents = {
            names.get(role, role): content_of(path, _besides(source.config, kinds.get(role, "")))
            for role, path in read.items()
        }
        settings = self.settings(source.config, kinds, chosen)
        made_from = self._made_from(source.config, contents, settings)
        work = Work(source, given, kinds, names, out, chosen, settings, contents, seen, made_from)
        fresh = existing if existing and existing.record.made_from == made_from else None
        return work, None if force else fresh

    def settings(
        self, config: Config, kinds: Mapping[str, str], options: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Return all settings that matter as plain JSON values: sections of the config, options."""
        from beltid.store.artifact import plain

        values = config.model_dump(mode="json")
        found = {name: values[name] for name in self.uses}
        recorded = [kind for kind in kinds.values() if kind in RECORDINGS]
        if recorded:
            found["data"] = {"origin": values["data"]["origin"]}
            found["dialect"] = values["dialect"]
            # what is stated of a rig serves its plateaus
            recorded = ["rig" if kind == "points" else kind for kind in recorded]
            for part in ("columns", "units", "runs"):
                found[part] = {kind: values[part][kind] for kind in recorded}
        stated = {name: value for name, value in options.items() if name not in NO_MATTER}
        return {**found, **{name: plain(value) for name, value in stated.items() if value}}

    def _made_from(
        self, config: Config, contents: Mapping[str, Any], settings: Mapping[str, Any]
    ) -> str:
        from beltid.store.artifact import plain
        from beltid.store.disk import source_sha256

        stated = {
            name: sorted(getattr(config, name).model_fields_set)
            for name in self.uses
            if name in config.model_fields_set
        }
        hashes = {role: content.sha256 for role, content in contents.items()}
        parts = [__version__, source_sha256(), self.name, hashes, settings, stated]
        return hashlib.sha256(json.dumps(plain(parts), sort_keys=True).encode()).hexdigest()

    def _kinds(self, options: Mapping[str, Any]) -> dict[str, str | tuple[str, ...]]:
        names = {p.name for p in self.options}
        chosen = {name: value for name, value in options.items() if name in names}
        return {role: k(**chosen) if callable(k) else k for role, k in self.reads.items()}

    def _check_place(
        self, source: ConfigSource, files: Mapping[str, Path], out: Path, *, force: bool
    ) -> Artifact | None:
        """Refuse a place that is not for the result; return the artifact that is there."""
        from beltid.errors import ArtifactError
        from beltid.store.artifact import read_artifact, stated_kind
        from beltid.store.place import FOREIGN, OURS, check_place

        inputs = {f"{role} input of this command": path for role, path in files.items()}
        named = {f"{k} recording of the config": p for k, p in source.config.data.files.items()}
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
        check_place(out, (ending,), self.whose or whose, inputs=inputs | named, force=force)
        return existing

    def _read(self, work: Work) -> dict[str, Any]:
        """Read the inputs; refuse artifacts that do not fit together."""
        from beltid.bench.recording import read_recording
        from beltid.store.artifact import Artifact, read_artifact
        from beltid.store.together import refuse_misfits

        config, items = work.source.config, dict[str, Any]()
        for role, path in work.files.items():
            kind = work.kinds[role]
            if kind in RECORDINGS:
                items[role] = read_recording(path, kind, config)
                what = "rows" if kind == "points" else "samples"
                log.info("%s: %s %s", path, items[role].n_samples, what)
            else:
                items[role] = read_artifact(path, kind)
        artifacts = {role: item for role, item in items.items() if isinstance(item, Artifact)}
        guests = [artifacts[role] for role in self.guests if role in artifacts]
        refuse_misfits([a for role, a in artifacts.items() if role not in self.guests], guests)
        for artifact in artifacts.values():
            _warn_of_other_bench(artifact, work.source, self.bench)
        return items

    def _write(self, work: Work, outcome: Outcome[Any], items: Mapping[str, Any]) -> Artifact:
        from beltid.store.artifact import Artifact, combined_origin, plain, write_artifact
        from beltid.store.disk import sha256, source_sha256, write_bytes
        from beltid.store.together import ancestors_of

        config, path = work.source.config, work.source.path
        artifacts = [item for item in items.values() if isinstance(item, Artifact)]
        recordings = {name: sha for name, sha in work.inputs.items() if name in RECORDINGS}

        def counts(role: str) -> bool:  # a recording of another bench tells nothing of this one
            return work.names[role] != "recording" or items[role].is_artifact

        record = outcome.record(
            made_by=self.name,
            made_from=work.made_from,
            software=f"beltid {__version__}",
            sources=source_sha256(),
            origin=combined_origin(
                [_origin(item, config) for role, item in items.items() if counts(role)]
                or [config.data.origin]
            ),
            inputs=work.inputs,
            ancestors={**ancestors_of(artifacts), **recordings},
            # name without folder, so that the same input gives the same bytes anywhere
            config=BUILT_IN if path is None else path.name,
            config_sha256=config.sha256,
            settings=work.settings,
            notes=[*(n for item in items.values() for n in _notes(item)), *outcome.notes],
        )
        if self.writes is None:
            return write_artifact(work.out, outcome.columns, record)
        data = self.writes(outcome)
        write_bytes(work.out, data)
        stated = replace(record, facts=plain(record.facts), tables=plain(record.tables))
        return Artifact(outcome.columns, stated, work.out, sha256(data))


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


def _kind_of(kind: str | tuple[str, ...], path: Path) -> str:
    """Return which of several kinds a file is: the artifact, or else the recording."""
    from beltid.store.artifact import may_be_artifact

    if isinstance(kind, str):
        return kind
    return kind[0] if may_be_artifact(path) else kind[1]


def _besides(config: Config, kind: str) -> list[Path]:
    """Return what may lie among the files of a recording, and is none: the table of its runs."""
    return [config.run_tables[kind]] if kind in config.run_tables else []


def _recording(item: Any, kind: str, config: Config) -> Recording:
    from beltid.bench.recording import Recording, columns_of

    return Recording(kind, columns_of(item, kind, config), Path("frame"))


def _origin_of(items: list[Any], config: Config) -> Origin | None:
    """Combine the origins of inputs in memory.

    A result has its own; a plain table beside it takes that one, alone that of the config. A law or
    a surface given by numbers is no data.
    """
    from beltid.store.artifact import Artifact, combined_origin

    origins = [item.origin for item in items if isinstance(item, (Outcome, Artifact))]
    if config.data.origin or not origins:
        origins.append(config.data.origin)
    return combined_origin(origins)


def _origin(item: Any, config: Config) -> str | None:
    """Return the origin of an input in a file: from the config for a recording, else its own."""
    from beltid.store.artifact import Artifact

    if isinstance(item, Artifact):
        return item.origin
    return "synthetic" if item.is_artifact else config.data.origin


def _notes(item: Any) -> tuple[str, ...]:
    return getattr(item, "notes", ())


def _refuse_changed(work: Work) -> None:
    """Raise an error if an input has changed since it was read."""
    from beltid.bench.files import content_of, signature_of

    changed = [
        path
        for role, path in work.files.items()
        if signature_of(path) != work.seen[role]
        and content_of(path, _besides(work.source.config, work.kinds[role])).sha256
        != work.contents[work.names[role]].sha256
    ]
    if changed:
        raise InputError(
            [f"{p}: was changed while it was read (another process at work?), run again"
             for p in changed]
        )  # fmt: skip


def _warn_of_other_bench(
    artifact: Artifact, source: ConfigSource, sections: tuple[str, ...]
) -> None:
    """Warn if an artifact was made for another belt or rig than the config in use states."""
    differing = []
    for key in OF_BENCH:
        name, _, item = key.partition(".")
        value = getattr(getattr(source.config, name), item) if name in sections else None
        before = artifact.record.settings.get(name, {}).get(item, value)
        if name in sections and before != value:
            differing.append(f"{key} = {before} (now {value})")
    if differing:
        log.warning(
            "%s: made with %s: if it is not of this belt and bench, use its own config (%s is in "
            "use)",
            artifact.path,
            ", ".join(differing),
            source.origin,
        )
