"""Parts of the recordings that the figures need: branches of the press, some runs over time.

They are thinned and stored with the results, so that a report can be written from the folder of a
belt alone, without the recordings.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from beltid.bench.recording import Recording
from beltid.config import Config
from beltid.errors import InputError
from beltid.identify.estimators import snap_to_settings
from beltid.identify.friction.run import RunRecord
from beltid.identify.press.recording import StiffnessSettings
from beltid.identify.press.stiffness import StiffnessResult, fit_stiffness
from beltid.laws.capstan import friction_coefficient
from beltid.stage import Outcome
from beltid.stages.friction import records_of
from beltid.store.artifact import Artifact

MOST_ARCS: Final = 4
MOST_BRANCH_POINTS: Final = 120
MOST_SET_ASIDE: Final = 12
"""Number of runs set aside that are kept for inspection."""
MOST_NAMED: Final = 5
MOST_RUNS: Final = 480
"""Number of runs of a campaign that are kept as small pictures: the first ones."""
SMALL_SAMPLES: Final = 80
MOST_SAMPLES: Final = 1200
"""Number of samples kept of a run; a longer run keeps the extremes of neighbouring samples."""


def press_branches(press: Recording, config: Config) -> Outcome[StiffnessResult]:
    """Return the branches of the press cycles that the stiffness was fitted to."""
    result = fit_stiffness(press.columns, StiffnessSettings(**config.press.si()))
    parts: list[dict[str, np.ndarray]] = []
    for curve in result.recording.curves:
        for branch in curve.branches:
            n = branch.position_m.size  # thinned to means of neighbours
            starts = np.linspace(0, n, min(MOST_BRANCH_POINTS, n) + 1).astype(int)[:-1]
            sizes = np.diff(np.append(starts, n))
            position, force = (
                np.add.reduceat(v, starts) / sizes for v in (branch.position_m, branch.force_N_m)
            )
            labels = {
                "test": np.array(curve.test, dtype=object),
                "temperature_degC": np.array(curve.recorded.temperature_degC),
                "cycle": np.array(curve.cycle, dtype=np.int64),
                "branch": np.array(branch.name, dtype=object),
            }
            parts.append(
                {name: np.full(starts.size, label) for name, label in labels.items()}
                | {"penetration_m": position - result.pooled.contact_m[curve.test]}
                | {"line_force_N_m": force}
            )
    return Outcome(_joined(parts), result)


def rig_runs(rig: Recording, friction: Artifact, config: Config) -> Outcome[tuple[str, ...]]:
    """Return runs over time: typical runs and runs set aside in detail, all others thinned."""
    samples = samples_of_runs(friction.columns)
    records = {record.result.run: record for record in records_of(rig, config)}
    if missing := sorted(set(samples) - set(records)):
        raise InputError(
            f"{rig.path}: has no run {', '.join(missing[:MOST_NAMED])}; {friction.path} was made "
            "from another recording"
        )
    parts = [_thinned_run(records[run], most) for run, most in samples.items()]
    return Outcome(_joined(parts), tuple(samples))


def _joined(parts: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def samples_of_runs(friction: Mapping[str, np.ndarray]) -> dict[str, int]:
    """Return the runs to keep, and the maximum number of samples of each."""
    labels = friction["run"]
    aside = np.flatnonzero(friction["status"] != "ok")[:MOST_SET_ASIDE].tolist()
    detailed = [str(labels[row]) for row in (*typical_runs(friction), *aside)]
    kept = dict.fromkeys(detailed, MOST_SAMPLES)
    for label in labels[:MOST_RUNS]:
        kept.setdefault(str(label), SMALL_SAMPLES)
    return kept


def _thinned_run(record: RunRecord, most: int) -> dict[str, np.ndarray]:
    """Return the thinned tensions of a run, as measured or derived on this rig."""
    tight, slack = record.tension_tight_N, record.tension_slack_N
    kept = _thinned(tight, most)
    return {
        "run": np.full(kept.size, record.result.run, dtype=object),
        "time_s": record.time_s[kept],
        "tension_tight_N": tight[kept],
        "tension_slack_N": slack[kept],
        "mu": friction_coefficient(tight[kept], slack[kept], np.radians(record.result.arc_deg)),
        "pulley_speed_rad_s": record.pulley_speed_rad_s[kept],
    }


def typical_runs(friction: Mapping[str, np.ndarray]) -> tuple[int, ...]:
    """Return the rows of the runs nearest to the median settings of every arc, in order of arcs."""
    good = friction["status"] == "ok"
    tension, speed = (
        np.log(friction[name], where=good & (friction[name] > 0.0), out=np.full(good.size, np.nan))
        for name in ("nominal_tension_N", "slip_speed_m_s")
    )
    arcs = np.where(good, snap_to_settings(friction["arc_deg"]), np.nan)
    groups = [np.flatnonzero(arcs == arc) for arc in np.unique(arcs[np.isfinite(arcs)])]
    if len(groups) > MOST_ARCS:
        used = np.concatenate(groups)
        groups = np.array_split(used[np.argsort(friction["arc_deg"][used])], MOST_ARCS)
    chosen = []
    for rows in groups:
        distance = np.zeros(rows.size)
        for setting in (tension[rows], speed[rows]):
            if np.isfinite(setting).any():
                distance += np.nan_to_num(np.abs(setting - np.nanmedian(setting)), nan=np.inf)
        chosen.append(int(rows[np.argmin(distance)]))
    return tuple(chosen)


def _thinned(values: np.ndarray, most: int) -> np.ndarray:
    """Return the rows of a run; of a long run, those with the extremes of neighbouring samples."""
    rows = np.arange(values.size)
    if rows.size <= most:
        return rows
    kept = []
    for group in np.array_split(rows, most // 2):
        finite = group[np.isfinite(values[group])]
        if finite.size:
            kept += [finite[np.argmin(values[finite])], finite[np.argmax(values[finite])]]
    return np.unique(np.array(kept, dtype=rows.dtype))
