"""Read recordings of the benches: files of any format in, validated columns out."""

import logging
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import pandas as pd

from beltid.bench import cells, formats
from beltid.bench.files import Source, is_many, sources_of
from beltid.bench.mapping import Channel, Found, Needs, bench_of, channels_of, mapped, meant, rig_of
from beltid.bench.raw import (
    Raw,
    codes_of,
    frame_of,
    is_text,
    numbers_of,
    read_parquet,
    word_of,
)
from beltid.bench.runs import (
    Checker,
    Part,
    is_timed,
    joined,
    read_part,
    run_table,
    settings_in_head,
    tables_of_runs,
)
from beltid.config.checks import name_pattern
from beltid.config.model import KINDS
from beltid.errors import InputError, Problems
from beltid.tables import schemas
from beltid.tables.values import absent

IN_OUR_UNITS = "in_our_units"
"""Attribute of a DataFrame that is in our names and units: read with its config, or computed."""
READERS: dict[str, Callable[[Path, str], Iterator[Raw]]] = {  # texts take the dialect, too
    "tdms": formats.read_tdms,
    "mdf": formats.read_mdf,
    "uff": formats.read_uff,
    "mat": formats.read_matlab,
    "hdf5": formats.read_hdf5,
    "excel": cells.read_excel,
    "parquet": read_parquet,
}
SETTINGS = ("arc_deg", "initial_tension_N", "weight_N", "temperature_degC")
_NUMBER = r"[-+]?\d+(?:[.,p]\d+)?"
_UNIT_WORDS = {  # setting -> how its unit is written behind a number in the name of a file
    "arc_deg": r"(?i:deg|grad|°)",
    "initial_tension_N": r"[Nn]",
    "temperature_degC": r"(?:C|degC|°C)",
}
GAP = 3.0  # steps of time over which samples are missing


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
    return recording_of(parts, path, needs)


def found_in(raws: Sequence[Raw], needs: Needs) -> dict[str, list[Found]]:
    """Return which of our columns the fields of the head and the channels of a file are."""
    fields = [entry for raw in raws for entry in raw.fields]
    return settings_in_head(fields, needs) | meant(channels_of(raws), needs)


def of_bench(raws: Sequence[Raw], needs: Needs) -> Needs:
    """Return what a recording of the rig needs with the forces that it holds, or its plateaus."""
    if needs.table.kind != "rig":
        return needs
    has = {**dict.fromkeys(needs.values, ()), **found_in(raws, needs)}
    if "time_s" not in has and not any(is_timed(raw, "rig") for raw in raws):
        # a row per plateau has a speed, an arc or mu, and a label of its own
        plateaus = replace(needs, table=schemas.table("points"))
        found = meant(channels_of(raws), plateaus)
        labels = [match.channel.values for match in found.get("run", ())]
        if (
            {"pulley_speed_rad_s", "slip_speed_m_s"} & {*found} and {"arc_deg", "mu"} & {*found}
        ) and all(2 * column.nunique() >= len(column) for column in labels):
            return plateaus
    rig, (measures, weight_on) = rig_of(has), needs.measures
    weight_on = rig.get("holds", f"weight_{weight_on}").removeprefix("weight_")
    kind, running = rig.get("kind", measures), "belt_speed_m_s" in has
    return replace(needs, table=schemas.rig_table(kind, weight_on, running=running), rig=rig)


def tables_in(source: Source, needs: Needs) -> list[Raw]:
    """Read the tables of one file as written, and report what is wrong with it."""
    dialect, problems, place = needs.dialect, needs.problems, source.name
    readers = READERS | {
        "text": partial(cells.read_text, dialect=dialect, problems=problems),
        "lvm": partial(formats.read_lvm, dialect=dialect),
    }
    try:
        with source.plain() as (file, form), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            logging.getLogger("asammdf").disabled = True
            tables = list(readers[form](file, place))
            if form in READERS and not any(len(table.frame) for table in tables):
                raise InputError(f"{place}: is empty: it holds no channel with samples")
            return tables
    except MemoryError:
        raise
    except Exception as error:  # a damaged file can raise nearly anything
        damaged = (
            f"{place}: damaged, not of this format, or not to be read here: "
            f"{type(error).__name__}: {error}",
        )
        for line in error.problems if isinstance(error, InputError) else damaged:
            problems.add(line)
    return []


def parts_of(inside: PurePath, place: str, raws: Sequence[Raw], needs: Needs) -> list[Part]:
    """Read the runs in the tables of one file."""
    if not raws:
        return []
    (runs, notes), parts = tables_of_runs(raws, needs), list[Part]()
    for tables in runs:
        names: tuple[str, ...] = (inside.name, inside.stem)
        if len(runs) > 1 and (name := tables[0].name):
            names = (f"{inside.name}/{name}", name, *names)
            tables = [replace(raw, place=f"{place}, {name}") for raw in tables]
        parts += filter(None, [read_part(tables, needs, names)])
    if parts:
        parts[0].notes.extend(notes)
    for note in () if parts else notes:  # the missing columns may be among those left out
        needs.problems.add(f"{place}: {note}")
    return parts


def recording_of(parts: Sequence[Part], path: Path, needs: Needs) -> Recording:
    """Join the parts of a recording and check it; InputError with all errors."""
    needs.problems.raise_if_any()
    columns, place, notes, stated = joined(parts, needs)
    notes += Checker(str(path), columns, place, needs).run({*needs.units, *stated})
    needs.problems.raise_if_any()
    found = {role: match for part in parts for role, match in part.found.items()}
    rig = dict(needs.rig)
    if needs.table.kind == "points":
        rig = rig_of({name: () for name, values in columns.items() if not absent(values).all()})
    if np.nan_to_num(np.asarray(columns.get("belt_speed_m_s", 0.0), dtype=float)).any():
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
    return Recording(kind, {name: artifact.columns[name] for name in names}, path, is_artifact=True)


def as_frame(columns: dict[str, np.ndarray], notes: Sequence[str] = ()) -> pd.DataFrame:
    """Move columns in our names and units to a DataFrame, marked as such, its notes in attrs."""
    written: dict[str, Any] = {}  # to which one can write
    for name in [*columns]:
        values = columns.pop(name)
        codes, words = codes_of(values) if values.dtype == object else (values, values[:0])
        texts = pd.array(words, dtype="str")
        numbers = np.require(values, requirements="W")
        written[name] = texts.take(codes, allow_fill=True) if len(words) else numbers
    frame = pd.DataFrame(written, copy=False)
    frame.attrs.update({"notes": list(notes), IN_OUR_UNITS: True})
    return frame


def recording_in(frame: Any, kind: str, config: Any = None) -> Recording:
    """Return a recording in memory, checked like a file; InputError with all errors, by their rows.

    `frame` is a DataFrame, pyarrow Table, mapping of columns or `Recording`; columns that the kind
    does not have are ignored.
    """
    needs = Needs.of(config, kind)
    if isinstance(frame, Recording) or getattr(frame, "attrs", {}).get(IN_OUR_UNITS):
        needs = Needs(needs.table, measures=needs.measures)  # names and units are ours already
    raw = frame_of(frame.columns if isinstance(frame, Recording) else frame, "frame")
    # a frame has neither a name nor a head that states anything
    names = {n: theirs for n, theirs in needs.names.items() if n not in raw.frame}
    needs = of_bench([raw], replace(needs, pattern=None, run_table=None, names=names))
    parts, table = parts_of(PurePath("frame"), "frame", [raw], needs), needs.table
    if parts and table.label not in parts[0].found and "time_s" in table.names:
        raise InputError(f"frame: column {table.label} is missing")  # it may be the index
    return recording_of(parts, Path("frame"), needs)


def table_columns(frame: Any, table: schemas.Table, name: str) -> dict[str, np.ndarray]:
    """Return the columns of numbers and texts that a table in memory has of a schema."""
    raw, columns, problems = frame_of(frame, name).frame, {}, Problems()
    for column in table.columns:
        if (values := raw.get(column.name)) is None or column.dtype in ("list", "bool"):
            continue
        if column.dtype == "string":
            columns[column.name] = np.array([word_of(v) for v in values], dtype=object)
        elif is_text(values):
            problems.add(f"{name}: column {column.name} holds texts, must hold numbers")
        else:
            columns[column.name] = values.to_numpy()
    problems.raise_if_any()
    return columns


# --- what is in a file ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Inspection:
    """Result of inspecting a recording."""

    kind: str  # stated or recognised; "" if it cannot be recognised
    names: tuple[str, ...]  # of its files
    tables: list[Raw]  # of the first file as written
    channels: list[Channel]  # of these tables
    found: dict[str, Found] = field(default_factory=dict)  # our columns, as far as known
    runs: list[dict[str, Any]] = field(default_factory=list)  # a row of facts per run, if readable
    notes: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()  # to be stated or corrected; without, the command reads it
    rig: dict[str, str] = field(default_factory=dict)  # what stays while the pulley turns
    pattern: str = ""  # guessed, of the file names, for settings that are nowhere else


def inspect_recording(
    path: Path, config: Any, kind: str | None = None, *, guess: bool = False
) -> Inspection:
    """Look into the first file of a recording, and read all of it as the stage of its kind does.

    Without a `kind`, it is told by the channels. With `guess`, settings of the runs are read
    from the names of the files if it cannot be read without.
    """
    benches = {k: Needs.of(config, k) for k in ([kind] if kind else KINDS)}
    sources = sources_of(path, [n.run_table for n in benches.values() if n.run_table is not None])
    names = tuple(source.inside.name for source in sources)
    first = next(iter(benches.values()))
    if not (tables := tables_in(sources[0], first)):
        first.problems.raise_if_any()
    channels = [channel for table in tables for channel in channels_of([table])]
    if not kind:
        are_plateaus = of_bench(tables, benches["rig"]).table.kind == "points"
        kind = "rig" if are_plateaus else bench_of(channels, [*benches.values()])[0]
    seen = Inspection(kind, names, tables, channels, notes=tables[0].notes)
    if not kind:
        held = ", ".join(c.name for c in channels[:12]) or "none"
        problem = (
            f"{path}: the channels do not tell which bench this is (found: {held}); state it "
            f"with --kind {', '.join(KINDS[:-1])} or {KINDS[-1]}"
        )
        return replace(seen, problems=(problem, *(text for _, text in first.problems.found)))
    try:
        recording = read_recording(path, kind, config)
    except InputError as error:
        needs, has = of_bench(tables, benches[kind]), found_in(tables, benches[kind])
        if guess and (pattern := _pattern(names, needs, {*has}, len(tables))):
            runs = config.runs | {kind: {**config.runs[kind], "pattern": pattern}}
            told = inspect_recording(path, config.model_copy(update={"runs": runs}), kind)
            return replace(told, pattern=pattern)
        every = [mapped(channels_of([table]), needs, "") for table in tables]
        found = {role: match for of in reversed(every) for role, match in of.items()}
        return replace(seen, found=found, problems=error.problems)
    rig, found, problems = recording.rig, recording.found, tuple[str, ...]()
    spans = {"tension_tight_N", "tension_slack_N"} & {*found}
    if rig.get("kind") == "torque" and not spans and not (config.rig.holds or "holds" in rig):
        problems = (
            f"{path}: a weight beside a torque: state the span that carries it, rig: {{holds: "
            "weight_tight}} or weight_slack",
        )
    return replace(
        seen,
        found=found,
        runs=runs_found(recording),
        notes=recording.notes,
        problems=problems,
        rig={name: word for name, word in rig.items() if name == "holds"},
    )


def _pattern(names: Sequence[str], needs: Needs, found: set[str], n_tables: int) -> str:
    """Return a pattern of all file names with a setting that is found nowhere else, or ""."""
    units = {n: u for n, u in _UNIT_WORDS.items() if n in needs.table.names and n not in found}
    label = f"{{{needs.table.label}}}" if n_tables == 1 else "{}"
    pattern = ""
    for word, *others in zip(*(re.split("([_-])", PurePath(n).stem) for n in names), strict=False):
        own = word
        for role, unit in units.items():
            own = re.sub(rf"^{_NUMBER}(?={unit}(?![A-Za-z]))", f"{{{role}}}", own)
        if own == word and (re.fullmatch(_NUMBER, word) or {*others} - {word}):
            own, label = label, "{}"
        pattern += own
    pattern += PurePath(names[0]).suffix
    fits = any(f"{{{role}}}" in pattern for role in units)
    return pattern if fits and all(map(name_pattern(pattern).values, names)) else ""


def ranges(channel: Channel) -> dict[str, float]:
    """Return count, rate, smallest, largest and first number of a channel; nan for texts."""
    raw, values = channel.raw, channel.values
    if is_text(values):  # times are no numbers
        texts = values[:0] if channel.written else values
        values = pd.Series(numbers_of(texts, raw.signs, "", raw.at, Problems()))
    finite, time = values[np.isfinite(values)], raw.frame.get(formats.TIME, values[:0])
    return {
        "samples": len(finite) or int(channel.values.count()),
        "rate_Hz": 1.0 / _step(time.to_numpy()) if not is_text(time) else np.nan,
        "min": float(finite.min()),
        "max": float(finite.max()),
        "first": float(finite.iloc[0]) if len(finite) else np.nan,
    }


def _step(time: np.ndarray) -> float:
    """Return the median step of time [s], nan if it does not go on."""
    step = float(np.median(np.diff(time))) if len(time) > 1 else np.nan
    return step if step > 0 else np.nan


def runs_found(recording: Recording) -> list[dict[str, Any]]:
    """Return a row per run: its settings, the speed or force it reached, its length, its gaps."""
    columns, kind = recording.columns, recording.kind
    sensors = pd.DataFrame({name: x for name, x in columns.items() if x.dtype != object})
    speed = "driver_speed_rad_s" if kind == "speedloss" else "pulley_speed_rad_s"
    rows = []
    for label, run in sensors.groupby(columns[schemas.table(kind).label], sort=False):
        row: dict[str, Any] = {"run": str(label)}
        row |= {n: float(run[n].median()) for n in SETTINGS if n in run and run[n].count()}
        if speed in run and run[speed].count():
            turning = run[speed].abs()
            # omit the rest phase; the highest samples alone would show sensor noise
            row[speed] = float(turning[turning >= 0.5 * turning.quantile(0.9)].median())
        if kind == "press":
            row["force_N"] = float(run["force_N"].abs().max())
        time = run["time_s"].to_numpy() if "time_s" in run else np.zeros(1)
        step = _step(time)
        row |= {
            "duration_s": float(time[-1] - time[0]),
            "samples": len(run),
            "rate_Hz": 1.0 / step if step > 0 else None,
            "gaps_at_s": time[:-1][np.diff(time) > GAP * step][:5].tolist() or None,
        }
        rows.append(row)
    return rows
