"""What is in a file, and how it is read: the same functions that read it, with their answers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath
from typing import Any, Final

import numpy as np
import pandas as pd

from beltid.bench.files import sources_of
from beltid.bench.mapping import Channel, Found, Needs, bench_of, channels_of, mapped
from beltid.bench.numbers import numbers_of
from beltid.bench.raw import TIME, Raw, is_text
from beltid.bench.recording import Recording, found_in, of_bench, read_recording, tables_in
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
GAP: Final = 3.0  # steps of time over which samples are missing


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
    pattern: str = ""  # of the file names, for settings that are nowhere else


def inspect_recording(
    path: Path, config: Any, kind: str | None = None, *, guess: bool = False
) -> Inspection:
    """Look into the first file of a recording, and read all of it as the stage of its kind does.

    Without a `kind`, it is told by the channels. With `guess`, settings of the runs are read
    from the names of the files if they seem to be there and nowhere else.
    """
    benches = {k: Needs.of(config, k) for k in ([kind] if kind else KINDS)}
    sources = sources_of(path, [n.run_table for n in benches.values() if n.run_table is not None])
    names = tuple(source.inside.name for source in sources)
    first = next(iter(benches.values()))
    tables = tables_in(sources[0], first)
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
        return replace(seen, problems=(problem,))
    needs, has = of_bench(tables, benches[kind]), found_in(tables, benches[kind])
    seen = replace(seen, pattern=_pattern(names, needs, {*has}, len(tables)))
    if seen.pattern and guess:
        stated = {kind: {**config.runs[kind], "pattern": seen.pattern}}
        config = config.model_copy(update={"runs": config.runs | stated})
    try:
        recording = read_recording(path, kind, config)
    except InputError as error:
        found: dict[str, Found] = {}
        for table in tables:
            found = mapped(channels_of([table]), needs, "") | found
        return replace(seen, found=found, problems=error.problems)
    rig, found, problems = dict(recording.rig), recording.found, tuple[str, ...]()
    spans = {"tension_tight_N", "tension_slack_N"} & {*found}
    if rig.get("kind") == "torque" and not spans and not (config.rig.holds or "holds" in rig):
        ask = "state the span that carries it, rig: {holds: weight_tight} or weight_slack"
        problems = (f"{path}: a weight beside a torque: {ask}",)
    rig, runs = {"holds": rig["holds"]} if "holds" in rig else {}, runs_found(recording)
    notes = recording.notes
    return replace(seen, found=found, runs=runs, notes=notes, problems=problems, rig=rig)


def _pattern(names: Sequence[str], needs: Needs, found: set[str], n_tables: int) -> str:
    """Return a pattern of all file names with a setting that is found nowhere else, or ""."""
    required = {c.name for c in needs.table.columns if c.required and c.name in schemas.NOMINAL}
    if not required - found - {*needs.values} or needs.pattern or needs.run_table:
        return ""
    units = {n: u for n, u in _UNIT_WORDS.items() if n in needs.table.names and n not in found}
    label = f"{{{needs.table.label}}}" if n_tables == 1 else "{}"
    pattern, ending = "", PurePath(names[0]).suffix
    for word, *others in zip(*(re.split("([_-])", PurePath(n).stem) for n in names), strict=False):
        own = word
        for role, unit in units.items():
            own = re.sub(rf"^{_NUMBER}(?={unit}(?![A-Za-z]))", f"{{{role}}}", own)
        if own == word and (re.fullmatch(_NUMBER, word) or {*others} - {word}):
            own, label = label, "{}"
        pattern += own
    if not any(role in pattern for role in units):
        return ""
    values = name_pattern(pattern + ending).values
    return pattern + ending if all(map(values, names)) else ""


def ranges(channel: Channel) -> dict[str, float]:
    """Return rate, smallest, largest and first number of a channel; nan for texts."""
    raw, values = channel.raw, channel.values
    if is_text(values):
        is_number = not channel.written
        numbers: Any = numbers_of(values, raw.signs, "", raw.at, Problems()) if is_number else []
        values = pd.Series(numbers, dtype=float)
    finite, time = values[np.isfinite(values)], raw.frame.get(TIME, values[:0])
    return {
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
        gaps = time[:-1][np.diff(time) > GAP * step][:5].tolist()
        row |= {"duration_s": float(time[-1] - time[0]), "samples": len(run)}
        rows.append(row | {"rate_Hz": 1.0 / step if step > 0 else None, "gaps_at_s": gaps or None})
    return rows
