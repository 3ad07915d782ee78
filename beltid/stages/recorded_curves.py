"""What the figures need of the recordings: the branches of the press, some runs over time.

They are kept beside the results, thinned, so that a report can be written from the folder of a belt
alone, when the recordings are elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.artifact import read_artifact
from beltid.bench.big_recording import BigRecording
from beltid.bench.recording import read_recording, read_rig
from beltid.config import Config, ConfigSource
from beltid.errors import InputError
from beltid.identify.estimators.statistics import as_set
from beltid.identify.friction.rig_table import run_records
from beltid.identify.press.curves import Branch
from beltid.identify.press.stiffness import fit_stiffness
from beltid.laws.capstan import friction_coefficient
from beltid.stages.build_artifact import Build, Built
from beltid.stages.outcome import Outcome
from beltid.stages.reduction import (
    CELL_KEYS,
    columns_of_runs,
    friction_settings,
    rig_kind,
    stiffness_settings,
)
from beltid.stages.reporter import Options

PRESS: Final = "press_curves"
RIG: Final = "rig_curves"
PRESS_KEYS: Final = ("press", "columns.press", "units.press", "runs.press", "dialect")
RIG_KEYS: Final = (
    "columns.rig",
    "units.rig",
    "runs.rig",
    "dialect",
    "rig.kind",
    "rig.weight_on",
    "rig.running_measures",
    "rig.belt_speed_m_s",
    *CELL_KEYS,
)
"""The load cells, too: what is known of them is taken off here as in the reduction."""
MOST_SET_ASIDE: Final = 12
"""Runs set aside that are kept to be looked at."""
MOST_NAMED: Final = 5
MOST_SAMPLES: Final = 1200
"""Samples of a run that are kept; of a longer one the extremes of neighbouring samples."""


def press_curves(source: ConfigSource, press: Path, out: Path, options: Options) -> Built:
    """Branches of the press cycles that the stiffness was fitted to, over the penetration."""
    build = Build(PRESS, source, PRESS_KEYS, {"press": press}, out, options)
    built = build.up_to_date()
    if built is None:
        recording = read_recording(press, "press", source.config)
        branches = fit_stiffness(
            recording.columns, stiffness_settings(source.config.press)
        ).branches
        built = build.write(Outcome(PRESS, _branch_columns(branches), branches))
    return built


def rig_curves(
    source: ConfigSource, rig: Path, friction: Path, out: Path, options: Options
) -> Built:
    """A typical run of every arc over time, and runs that were set aside.

    Raises
    ------
    InputError
        If the recording has not all of these runs: it is not the one of the friction table.
    """
    build = Build(RIG, source, RIG_KEYS, {"rig": rig, "friction": friction}, out, options)
    built = build.up_to_date()
    if built is None:
        runs = chosen_runs(read_artifact(friction, "friction").columns)
        recording = read_rig(rig, source.config)
        if isinstance(recording, BigRecording):
            columns = columns_of_runs(recording, {*runs, *map(_whole, runs)})
        else:
            columns = recording.columns
        # of a run that was cut into bins of the speed, the whole of it is shown
        there = set(columns["run"])
        runs = tuple(dict.fromkeys(run if run in there else _whole(run) for run in runs))
        missing = sorted(set(runs) - set(columns["run"]))
        if missing:
            raise InputError(
                f"{rig}: has no run {', '.join(missing[:MOST_NAMED])}; {friction} was made from "
                "another recording"
            )
        built = build.write(Outcome(RIG, _run_columns(columns, runs, source.config), runs))
    return built


def _whole(run: str) -> str:
    return run.rpartition(":")[0] or run


def chosen_runs(friction: Mapping[str, np.ndarray]) -> tuple[str, ...]:
    """Labels of runs worth looking at: the typical one of every arc, and those set aside."""
    labels, good = friction["run"], friction["status"] == "ok"
    aside = np.flatnonzero(~good)[:MOST_SET_ASIDE].tolist()
    return tuple(str(labels[row]) for row in (*typical_runs(friction), *aside))


def typical_runs(friction: Mapping[str, np.ndarray]) -> tuple[int, ...]:
    """Rows of the runs nearest to the middle settings of every arc, in the order of the arcs.

    Parameters
    ----------
    friction : mapping of str to ndarray
        Columns of the friction table.
    """
    good = friction["status"] == "ok"
    tension, speed = (
        np.log(friction[name], where=good & (friction[name] > 0.0), out=np.full(good.size, np.nan))
        for name in ("nominal_tension_N", "slip_speed_m_s")
    )
    arcs = as_set(friction["arc_deg"])
    chosen = []
    for arc in np.unique(arcs[good & np.isfinite(arcs)]):
        rows = np.flatnonzero(good & (arcs == arc))
        away = np.zeros(rows.size)
        for setting in (tension[rows], speed[rows]):
            if np.isfinite(setting).any():
                away += np.nan_to_num(np.abs(setting - np.nanmedian(setting)), nan=np.inf)
        chosen.append(int(rows[np.argmin(away)]))
    return tuple(chosen)


def _branch_columns(branches: tuple[Branch, ...]) -> dict[str, np.ndarray]:
    sizes = [b.penetration_m.size for b in branches]

    def repeated(values: list[Any], dtype: Any) -> np.ndarray:
        return np.repeat(np.array(values, dtype=dtype), sizes)

    return {
        "test": repeated([b.test for b in branches], object),
        "temperature_degC": repeated([b.temperature_degC for b in branches], float),
        "cycle": repeated([b.cycle for b in branches], np.int64),
        "branch": repeated([b.branch for b in branches], object),
        "penetration_m": np.concatenate([b.penetration_m for b in branches]),
        "line_force_N_m": np.concatenate([b.line_force_N_m for b in branches]),
    }


def _run_columns(
    rig: Mapping[str, np.ndarray], runs: tuple[str, ...], config: Config
) -> dict[str, np.ndarray]:
    """Tensions of some runs over time, as the kind of the rig gives them."""
    kind, cells = rig_kind(config), friction_settings(config).cells
    records = {r.run: r for r in run_records(rig, config.rig.pulley_radius_m, kind)}
    parts = []
    for run in runs:
        record, rows = records[run], np.flatnonzero(rig["run"] == run)
        tight, slack = record.tension_tight_N, record.tension_slack_N
        if not kind.is_derived:  # else they were taken off before
            tight, slack = cells.tight.tension(tight), cells.slack.tension(slack)
        kept = thinned(np.arange(rows.size), tight)
        tight, slack = tight[kept], slack[kept]
        parts.append(
            {
                "run": rig["run"][rows][kept],
                "time_s": record.time_s[kept],
                "tension_tight_N": tight,
                "tension_slack_N": slack,
                "mu": friction_coefficient(tight, slack, np.radians(record.arc_deg)),
                "pulley_speed_rad_s": rig["pulley_speed_rad_s"][rows][kept],
            }
        )
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def thinned(rows: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Rows of a run, or of a long one those with the extremes of every bunch of neighbours."""
    if rows.size <= MOST_SAMPLES:
        return rows
    kept = []
    for bunch in np.array_split(rows, MOST_SAMPLES // 2):
        v = values[bunch]
        known = bunch[np.isfinite(v)]
        if known.size:
            kept += [known[np.argmin(values[known])], known[np.argmax(values[known])]]
    return np.unique(np.array(kept, dtype=rows.dtype))
