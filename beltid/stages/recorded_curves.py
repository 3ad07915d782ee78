"""What the figures need of the recordings: the branches of the press, some runs over time.

They are kept beside the results, thinned, so that a report can be written from the folder of a belt
alone, when the recordings are elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from beltid.artifacts.artifact import read_artifact
from beltid.bench.big_recording import BigRecording
from beltid.bench.recording import Recording, read_recording, read_rig
from beltid.config import ConfigSource
from beltid.errors import InputError
from beltid.identify.estimators.statistics import as_set
from beltid.identify.friction.load_cells import KnownCells
from beltid.identify.press.curves import Branch
from beltid.identify.press.stiffness import fit_stiffness
from beltid.laws.capstan import friction_coefficient
from beltid.stages.build_artifact import Build, Built
from beltid.stages.outcome import Outcome
from beltid.stages.reduction import (
    CELL_KEYS,
    friction_settings,
    stiffness_settings,
)
from beltid.stages.reporter import Options

PRESS: Final = "press_curves"
RIG: Final = "rig_curves"
PRESS_KEYS: Final = ("press", "columns.press", "units.press", "runs.press", "dialect")
RIG_KEYS: Final = ("columns.rig", "units.rig", "runs.rig", "dialect", *CELL_KEYS)
"""The load cells, too: what is known of them is taken off here as in the reduction."""
MOST_SET_ASIDE: Final = 12
"""Runs set aside that are kept to be looked at."""
MOST_NAMED: Final = 5
MOST_RUNS: Final = 480
"""Runs of a campaign that are kept as small pictures, the first ones."""
SMALL_SAMPLES: Final = 80
NEEDED: Final = (
    "time_s",
    "tension_tight_N",
    "tension_slack_N",
    "pulley_speed_rad_s",
    "arc_deg",
)
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
    """Runs over time: typical ones and those set aside as recorded, all others thinned.

    Raises
    ------
    InputError
        If the recording has not all of these runs: it is not the one of the friction table.
    """
    build = Build(RIG, source, RIG_KEYS, {"rig": rig, "friction": friction}, out, options)
    built = build.up_to_date()
    if built is None:
        samples = samples_of_runs(read_artifact(friction, "friction").columns)
        parts = _thinned_runs(read_rig(rig, source.config), samples)
        missing = sorted(set(samples) - set(parts))
        if missing:
            raise InputError(
                f"{rig}: has no run {', '.join(missing[:MOST_NAMED])}; {friction} was made from "
                "another recording"
            )
        runs = [parts[run] for run in samples]
        columns = {name: np.concatenate([part[name] for part in runs]) for name in runs[0]}
        cells = friction_settings(source.config).cells
        built = build.write(Outcome(RIG, _run_columns(columns, cells), tuple(samples)))
    return built


def samples_of_runs(friction: Mapping[str, np.ndarray]) -> dict[str, int]:
    """Runs to keep, and how many samples of each at most.

    The typical run of every arc comes first, then runs that were set aside: these are looked at
    one by one. Of all others as many samples are kept as a gallery of small pictures shows.
    """
    labels, good = friction["run"], friction["status"] == "ok"
    aside = np.flatnonzero(~good)[:MOST_SET_ASIDE].tolist()
    looked_at = [str(labels[row]) for row in (*typical_runs(friction), *aside)]
    others = {str(label): SMALL_SAMPLES for label in labels[:MOST_RUNS]}
    return dict.fromkeys(looked_at, MOST_SAMPLES) | {
        label: most for label, most in others.items() if label not in looked_at
    }


def _thinned_runs(
    recording: Recording | BigRecording, samples: Mapping[str, int]
) -> dict[str, dict[str, np.ndarray]]:
    """Columns of the runs to keep, thinned; of a big recording one run at a time."""
    found = {}
    for label, columns in _runs_of(recording):
        if label in samples:
            tight = columns["tension_tight_N"]
            rows = thinned(np.arange(tight.size), tight, samples[label])
            found[label] = {name: columns[name][rows] for name in NEEDED}
            found[label]["run"] = np.full(rows.size, label, dtype=object)
    return found


def _runs_of(
    recording: Recording | BigRecording,
) -> Iterator[tuple[str, Mapping[str, np.ndarray]]]:
    if isinstance(recording, BigRecording):
        for run in recording:
            yield run.label, run.columns
        return
    labels, places = np.unique(recording.columns["run"].astype(str), return_inverse=True)
    for k, label in enumerate(labels.tolist()):
        rows = np.flatnonzero(places == k)
        yield label, {name: recording.columns[name][rows] for name in NEEDED}


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


def _run_columns(rig: Mapping[str, np.ndarray], cells: KnownCells) -> dict[str, np.ndarray]:
    tight = cells.tight.tension(rig["tension_tight_N"])
    slack = cells.slack.tension(rig["tension_slack_N"])
    good = (tight > 0.0) & (slack > 0.0)
    mu = np.full(tight.size, np.nan)
    mu[good] = friction_coefficient(tight[good], slack[good], np.radians(rig["arc_deg"][good]))
    return {
        "run": rig["run"],
        "time_s": rig["time_s"],
        "tension_tight_N": tight,
        "tension_slack_N": slack,
        "mu": mu,
        "pulley_speed_rad_s": rig["pulley_speed_rad_s"],
    }


def thinned(rows: np.ndarray, values: np.ndarray, most: int = MOST_SAMPLES) -> np.ndarray:
    """Rows of a run, or of a long one those with the extremes of every bunch of neighbours."""
    if rows.size <= most:
        return rows
    kept = []
    for bunch in np.array_split(rows, most // 2):
        v = values[bunch]
        known = bunch[np.isfinite(v)]
        if known.size:
            kept += [known[np.argmin(values[known])], known[np.argmax(values[known])]]
    return np.unique(np.array(kept, dtype=rows.dtype))
