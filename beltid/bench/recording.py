"""Read recordings of the benches: files of any format in, validated columns out."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath
from typing import Any, Final

import numpy as np
import pandas as pd

from beltid.bench import cells, formats
from beltid.bench.columns import Part, read_part, run_table, settings_in_head
from beltid.bench.files import Source, is_many, sources_of
from beltid.bench.mapping import Found, Needs, channels_of, meant, rig_of
from beltid.bench.numbers import word_of
from beltid.bench.raw import Raw, codes_of
from beltid.bench.runs import Checker, is_timed, joined, tables_of_runs
from beltid.errors import InputError
from beltid.tables import schemas
from beltid.tables.schemas import Table
from beltid.tables.values import absent

IN_OUR_UNITS: Final = "in_our_units"
"""Attribute of a DataFrame that is in our names and units: read with its config, or computed."""
READERS: Final[dict[str, Callable[[Path, str], Iterator[Raw]]]] = {
    "tdms": formats.read_tdms,
    "mdf": formats.read_mdf,
    "uff": formats.read_uff,
    "mat": formats.read_matlab,
    "hdf5": formats.read_hdf5,
    "excel": cells.read_excel,
    "parquet": formats.read_parquet,
}
"""Format -> reader of the tables of a file; texts also take the dialect of the config."""


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording of a bench, validated.

    Its columns are those of the schema, in their order and units: float64 with nan for missing
    numbers, object arrays of str for labels; an optional one that the file lacks is all nan.
    """

    kind: str  # "press", "rig" or "speedloss"; "points" for a row per plateau of the rig
    columns: dict[str, np.ndarray]
    path: Path
    notes: tuple[str, ...] = ()  # on what was recognised, left out or missing
    found: dict[str, Found] = field(default_factory=dict)  # our columns -> how they were read
    is_artifact: bool = False  # a simulated recording: an artifact of ours
    rig: Mapping[str, str] = field(default_factory=dict)  # its kind, what it holds, if running

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return len(self.columns[schemas.table(self.kind).label])


def read_recording(path: str | Path, kind: str, config: Any = None) -> Recording:
    """Read a recording and check that it is plausible; InputError with all errors, by their lines.

    `path` is a file of any format that benches write, plain, in a zip file or packed with gzip; or
    a folder or a pattern such as ``runs/*.lvm`` with a file per run. A file of the rig without a
    time is a table of plateaus.
    """
    path, needs, parts = Path(path), Needs.of(config, kind), list[Part]()
    sources = sources_of(path, [needs.run_table] if needs.run_table else [])
    if len(sources) == 1 and (simulated := _simulated(path, kind)) is not None:
        return simulated
    for source in sources:  # one file after the other, so that only one is in memory as written
        raws = tables_in(source, needs)
        if source is sources[0]:
            needs = of_bench(raws, needs)
            needs = replace(needs, rows=run_table(needs))
        parts += parts_of(source.inside, source.name, raws, needs)
    if len(sources) > 1:
        needs.problems.merge_repeated([source.name for source in sources])
    return recording_of(parts, path, needs)


def found_in(raws: Sequence[Raw], needs: Needs) -> dict[str, list[Found]]:
    """Return which of our columns the fields of the head and the channels of a file are."""
    fields = [entry for raw in raws for entry in raw.fields]
    return settings_in_head(fields, needs) | meant(channels_of(raws), needs)


def of_bench(raws: Sequence[Raw], needs: Needs) -> Needs:
    """Return what a recording of the rig needs with the forces that it holds, or its plateaus."""
    if needs.table.kind != "rig":
        return needs
    plateaus = replace(needs, table=schemas.table("points"))
    has = {**dict.fromkeys(needs.values, ()), **found_in(raws, needs)}
    timed = any(is_timed(raw, "rig") for raw in raws) or "time_s" in has
    if not timed and _are_plateaus(meant(channels_of(raws), plateaus)):
        return plateaus
    rig, (measures, weight_on) = rig_of(has), needs.measures
    weight_on = rig.get("holds", f"weight_{weight_on}").removeprefix("weight_")
    kind, running = rig.get("kind", measures), "belt_speed_m_s" in has
    return replace(needs, table=schemas.rig_table(kind, weight_on, running=running), rig=rig)


def _are_plateaus(found: Mapping[str, Sequence[Found]]) -> bool:
    """Return whether a table has a row per plateau: a speed, an arc or mu, no label repeated."""
    labels = [match.channel.values for match in found.get("run", ())]
    repeated = any(2 * column.nunique() < len(column) for column in labels)
    has_speed = bool({"pulley_speed_rad_s", "slip_speed_m_s"} & {*found})
    return has_speed and bool({"arc_deg", "mu"} & {*found}) and not repeated


def tables_in(source: Source, needs: Needs) -> list[Raw]:
    """Read the tables of one file as written, and report what is wrong with it."""
    dialect, problems = needs.dialect, needs.problems
    try:
        with source.plain() as (file, form), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            logging.getLogger("asammdf").disabled = True
            if form == "text":
                return list(cells.read_text(file, source.name, dialect))
            if form == "lvm":
                return list(formats.read_lvm(file, source.name, dialect))
            tables = list(READERS[form](file, source.name))
            if not any(len(table.frame) for table in tables):
                raise InputError(f"{source.name}: is empty: it holds no channel with samples")
            return tables
    except InputError as error:
        for line in error.problems:
            problems.add(line)
    except MemoryError:
        raise
    except Exception as error:  # a damaged file can raise nearly anything
        what = f"damaged, or not a file of this format: {type(error).__name__}: {error}"
        problems.add(f"{source.name}: {what}")
    return []


def parts_of(inside: PurePath, place: str, raws: Sequence[Raw], needs: Needs) -> list[Part]:
    """Read the runs in the tables of one file."""
    if not raws:
        return []
    (runs, notes), parts = tables_of_runs(raws, needs), list[Part]()
    for tables in runs:
        name = tables[0].name if len(runs) > 1 else ""
        names: tuple[str, ...] = (inside.name, inside.stem)
        names = (f"{inside.name}/{name}", name, *names) if name else names
        tables = [replace(raw, place=f"{place}, {name}" if name else place) for raw in tables]
        parts += filter(None, [read_part(tables, needs, names)])
    if parts:
        parts[0].notes.extend(notes)
    else:  # the missing columns may be among those left out
        for note in notes:
            needs.problems.add(f"{place}: {note}")
    return parts


def recording_of(parts: Sequence[Part], path: Path, needs: Needs) -> Recording:
    """Join the parts of a recording and check it; InputError with all errors."""
    needs.problems.raise_if_any()
    columns, place, notes, stated = joined(parts, needs)
    checker = Checker(str(path), columns, place, needs)
    notes += checker.run({*needs.units, *stated})
    needs.problems.raise_if_any()
    found = {role: match for part in parts for role, match in part.found.items()}
    rig = dict(needs.rig)
    if needs.table.kind == "points":
        rig = rig_of({name: () for name, values in columns.items() if not absent(values).all()})
    if np.any(np.nan_to_num(np.asarray(columns.get("belt_speed_m_s", 0.0), dtype=float))):
        rig["running"] = "yes"
    return Recording(needs.table.kind, columns, path, tuple(notes), found, rig=rig)


def _simulated(path: Path, kind: str) -> Recording | None:
    """Read our artifact of the simulated rig; None if the file is no artifact."""
    from beltid.store.artifact import may_be_artifact, read_artifact

    if is_many(path) or not may_be_artifact(path):
        return None
    artifact = read_artifact(path, "simulated" if kind == "rig" else None)
    if kind != "rig":
        raise InputError(f"{path}: is a {artifact.kind} artifact, a {kind} recording is needed")
    names = [name for name in schemas.rig_table().names if name in artifact.columns]
    columns = {name: artifact.columns[name] for name in names}
    return Recording(kind, columns, path, is_artifact=True)


def as_frame(columns: Mapping[str, np.ndarray], notes: Sequence[str] = ()) -> pd.DataFrame:
    """Return columns in our names and units as a DataFrame, marked as such, its notes in attrs."""
    frame = pd.DataFrame({name: _words(x) for name, x in columns.items()}, copy=False)
    frame.attrs.update({"notes": list(notes), IN_OUR_UNITS: True})
    return frame


def _words(values: np.ndarray) -> Any:
    """Return labels as a column of pandas, as it makes of them; numbers as they are."""
    codes, words = codes_of(values) if values.dtype == object else (values, values[:0])
    return pd.array(words, dtype="str").take(codes, allow_fill=True) if len(words) else values


def recording_in(frame: Any, kind: str, config: Any = None) -> Recording:
    """Return a recording in memory, checked like a file; InputError with all errors, by their rows.

    `frame` is a DataFrame, pyarrow Table, mapping of columns or `Recording`; columns that the kind
    does not have are ignored.
    """
    needs = Needs.of(config, kind)
    if isinstance(frame, Recording) or getattr(frame, "attrs", {}).get(IN_OUR_UNITS):
        # names and units are ours already
        needs = Needs(needs.table, measures=needs.measures)
        frame = frame.columns if isinstance(frame, Recording) else frame
    raw = formats.frame_of(frame, "frame")
    # a frame has neither a name nor a head that states anything
    names = {n: theirs for n, theirs in needs.names.items() if n not in raw.frame}
    needs = replace(needs, pattern=None, run_table=None, names=names)
    needs = of_bench([raw], needs)
    parts, table = parts_of(PurePath("frame"), "frame", [raw], needs), needs.table
    if parts and table.label not in parts[0].found and "time_s" in table.names:
        raise InputError(f"frame: column {table.label} is missing")  # it may be the index
    return recording_of(parts, Path("frame"), needs)


def table_columns(frame: Any, table: Table, name: str) -> dict[str, np.ndarray]:
    """Return the columns of numbers and texts that a table in memory has of a schema."""
    raw, columns, problems = formats.frame_of(frame, name).frame, {}, []
    for column in table.columns:
        values = raw.get(column.name)
        if values is None or column.dtype in ("list", "bool"):
            continue
        if column.dtype == "string":
            columns[column.name] = np.array([word_of(v) for v in values], dtype=object)
        elif pd.api.types.is_numeric_dtype(values):
            columns[column.name] = values.to_numpy()
        else:
            problems.append(f"{name}: column {column.name} holds texts, must hold numbers")
    if problems:
        raise InputError(problems)
    return columns
