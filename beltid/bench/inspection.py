"""What is in a file, and how it is read: the same functions that read it, with their answers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from beltid.bench.files import sources_of
from beltid.bench.mapping import Channel, Found, Needs, bench_of, channels_of, mapped
from beltid.bench.numbers import numbers_of
from beltid.bench.raw import TIME, Raw, is_text
from beltid.bench.recording import found_in, of_bench, read_recording, tables_in
from beltid.config.checks import name_pattern
from beltid.config.model import KINDS
from beltid.errors import InputError, Problems
from beltid.tables import schemas

SETTINGS: Final = ("arc_deg", "initial_tension_N", "weight_N", "temperature_degC")
_NUMBER: Final = r"[-+]?\d+(?:[.,p]\d+)?"
_UNIT_WORDS: Final = {
    "arc_deg": r"(?i:deg|grad|°)",
    "initial_tension_N": r"[Nn]",
    "temperature_degC": r"(?:C|degC|°C)",
}
"""Setting -> how its unit is written behind a number in the name of a file."""
GAP: Final = 3.0
"""Steps of time over which samples are missing."""


@dataclass(frozen=True, slots=True)
class RunView:
    """A run found in a recording."""

    label: str
    n_samples: int
    duration_s: float
    rate_Hz: float  # median
    gaps: list[float]  # times after which samples are missing [s]
    settings: dict[str, float]  # arc, tension, temperature, speed reached


@dataclass(frozen=True, slots=True)
class Inspection:
    """Result of inspecting a recording."""

    kind: str  # stated or recognised; "" if it cannot be recognised
    names: tuple[str, ...]  # of its files
    tables: list[Raw]  # of the first file as written
    channels: list[Channel]  # of these tables
    found: dict[str, Found]  # our columns -> how they are read, as far as known
    runs: list[RunView]  # empty if it cannot be read yet
    notes: tuple[str, ...]
    problems: tuple[str, ...]  # to be stated or corrected; without, the command reads it
    rig: dict[str, str]  # what the channels show that stays while the pulley turns
    pattern: str  # of the file names, for settings that are nowhere else; "" if none


def inspect_recording(
    path: Path, config: Any, kind: str | None = None, *, guess: bool = False
) -> Inspection:
    """Look into the first file of a recording, and read all of it as the stage of its kind does.

    Parameters
    ----------
    path : Path
        File, folder, pattern or zip file.
    config : Config
        Options stated so far.
    kind : {"press", "rig", "speedloss"}, optional
        Kind of recording; None: recognised from the channels.
    guess : bool
        Whether to read the settings of the runs from the names of the files if they seem to be
        there and nowhere else.

    Raises
    ------
    InputError
        If its first file cannot be read at all.
    """
    benches = {k: Needs.of(config, k) for k in ([kind] if kind else KINDS)}
    sources = sources_of(path, [n.run_table for n in benches.values() if n.run_table is not None])
    names = tuple(source.inside.name for source in sources)
    first = next(iter(benches.values()))
    tables = tables_in(sources[0], first)
    first.problems.raise_if_any()
    channels = channels_of(tables)
    if not kind:
        are_plateaus = of_bench(tables, benches["rig"]).table.kind == "points"
        kind = "rig" if are_plateaus else bench_of(channels, [*benches.values()])[0]
    if not kind:
        held = ", ".join(c.name for c in channels[:12]) or "none"
        problem = (
            f"{path}: the channels do not tell which bench this is (found: {held}); state it "
            f"with --kind {', '.join(KINDS[:-1])} or {KINDS[-1]}"
        )
        return Inspection("", names, tables, channels, {}, [], tables[0].notes, (problem,), {}, "")
    needs, has = of_bench(tables, benches[kind]), found_in(tables, benches[kind])
    pattern = _pattern(names, needs, {*has}, len(tables))
    if pattern and guess:
        stated = {kind: {**config.runs[kind], "pattern": pattern}}
        config = config.model_copy(update={"runs": config.runs | stated})
    runs, problems = list[RunView](), tuple[str, ...]()
    rig: Mapping[str, str] = {}
    try:
        recording = read_recording(path, kind, config)
        found, notes = recording.found, recording.notes
        runs = runs_found(recording.columns, recording.kind)
        rig = recording.rig
        spans = {"tension_tight_N", "tension_slack_N"} & {*recording.found}
        if rig.get("kind") == "torque" and not spans and not (config.rig.holds or "holds" in rig):
            ask = "state the span that carries it, rig: {holds: weight_tight} or weight_slack"
            problems = (f"{path}: a weight beside a torque: {ask}",)
    except InputError as error:
        found, notes, problems = {}, tables[0].notes, error.problems
        for table in tables:
            found = mapped(channels_of([table]), needs, "") | found
    holds = {key: word for key, word in rig.items() if key == "holds"}
    return Inspection(kind, names, tables, channels, found, runs, notes, problems, holds, pattern)


def _pattern(names: Sequence[str], needs: Needs, found: set[str], n_tables: int) -> str:
    """Return a pattern of all file names with a setting that is found nowhere else, or ""."""
    required = {c.name for c in needs.table.columns if c.required and c.name in schemas.NOMINAL}
    if not required - found - {*needs.values} or needs.pattern or needs.run_table:
        return ""
    pattern, dot, ending = names[0].rpartition(".")
    for role, words in _UNIT_WORDS.items():
        if role in needs.table.names and role not in found:
            unit = rf"{_NUMBER}(?={words}(?![A-Za-z]))"
            places = rf"(?<![\w{{]){unit}|(?<=_){unit}"
            pattern = re.sub(places, f"{{{role}}}", pattern, count=1)
    if "{" not in pattern:
        return ""
    first, separator, remainder = pattern.partition("_")
    numbered = re.match(rf"{_NUMBER}(?=[_.-]|$)", remainder)
    if separator and "{" not in first and n_tables == 1:
        pattern = f"{{{needs.table.label}}}_{remainder}"
        if numbered and all(name.startswith(first + separator) for name in names):
            pattern = f"{first}_{{{needs.table.label}}}{remainder[numbered.end() :]}"
    pattern = re.sub(rf"(?<=[_-]){_NUMBER}(?=[_.-]|$)", "{}", pattern) + dot + ending
    values = name_pattern(pattern).values
    return pattern if all(values(name) is not None for name in names) else ""


def ranges(channel: Channel) -> dict[str, float]:
    """Return rate, smallest, largest and first number of a channel; nan for texts."""
    raw, values = channel.raw, channel.values
    numbers = np.full(len(values), np.nan)
    if not is_text(values):
        numbers = values.to_numpy()
    elif not channel.written:
        numbers = numbers_of(values, raw.signs, "", raw.at, Problems())
    finite = numbers[np.isfinite(numbers)]
    low, high, first = (finite.min(), finite.max(), finite[0]) if finite.size else [np.nan] * 3
    is_timed = TIME in raw.frame and not is_text(raw.frame[TIME])
    step = _step(raw.frame[TIME].to_numpy() if is_timed else finite[:0])
    rate = 1.0 / step if step > 0 else np.nan
    return {"rate_Hz": rate, "min": float(low), "max": float(high), "first": float(first)}


def _step(time: np.ndarray) -> float:
    return float(np.median(np.diff(time))) if len(time) > 1 else 0.0


def runs_found(columns: dict[str, np.ndarray], kind: str) -> list[RunView]:
    """Return the runs of a recording, in the order of their first sample."""
    sensors = pd.DataFrame({name: x for name, x in columns.items() if x.dtype != object})
    runs = sensors.groupby(columns[schemas.table(kind).label], sort=False)
    return [
        _run_view(str(label), {str(name): run[name].to_numpy() for name in run}, kind)
        for label, run in runs
    ]


def _run_view(label: str, columns: dict[str, np.ndarray], kind: str) -> RunView:
    """Return what is seen of a run: its length, its settings, the speed or force it reached."""
    known = {name: x[np.isfinite(x)] for name, x in columns.items()}
    settings = {n: float(np.median(known[n])) for n in SETTINGS if len(known.get(n, ()))}
    speed = "driver_speed_rad_s" if kind == "speedloss" else "pulley_speed_rad_s"
    if len(turning := np.abs(known.get(speed, np.empty(0)))):
        # omit the rest phase; the highest samples alone would show sensor noise
        settings[speed] = float(np.median(turning[turning >= 0.5 * np.quantile(turning, 0.9)]))
    if kind == "press":
        settings["force_N"] = float(np.abs(known["force_N"]).max())
    time = columns.get("time_s", np.zeros(1))
    step = _step(time)
    gaps = time[:-1][np.diff(time) > GAP * step].tolist() if step > 0 else []
    rate, duration = (1.0 / step if step > 0 else np.nan), float(time[-1] - time[0])
    return RunView(label, len(time), duration, rate, gaps, settings)
