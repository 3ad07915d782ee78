"""Split a raw table without labels into runs where settings change or time restarts."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Final

import numpy as np

from beltid.errors import Problems
from beltid.tables.schemas import NOMINAL

RESTART: Final = 0.05
"""A new run begins when time falls back into the first part, this share, of the run before."""
MIN_SAMPLES: Final = 10
PHASE: Final = 5
"""Fewest consecutive samples of a phase in which the pulley stands or turns."""


def row_labels(length: int, labels: np.ndarray | None = None) -> np.ndarray:
    """Label the rows of a table of plateaus; a row without a label gets its number from 1."""
    words = [None] * length if labels is None else labels.tolist()
    return np.array(
        [str(row + 1) if word is None else word for row, word in enumerate(words)], dtype=object
    )


def run_labels(
    columns: Mapping[str, np.ndarray], label: str, place: str, problems: Problems
) -> tuple[np.ndarray, list[str]]:
    """Label every sample of a raw table.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Columns of the raw table, in our units.
    label : str
        Label of the raw table; used for its run if there is only one.
    place : str
        Name of the raw table, for messages.
    problems : Problems
        Collects runs that are too short or unclear.

    Returns
    -------
    labels : ndarray
        Object array of str.
    notes : list of str
        Note on how the runs were split.
    """
    time = columns["time_s"]
    starts = _starts(columns, time)
    bounds = [0, *starts, len(time)]
    lengths = np.diff(bounds)
    labels = np.empty(len(time), dtype=object)
    labels[:] = label
    if not starts:
        _refuse_second_rotation(columns, place, problems)
        return labels, []
    if lengths.min() < MIN_SAMPLES:
        row = bounds[int(lengths.argmin())] + 1
        problems.add(
            f"{place}: no column labels the runs; split at changes of the settings and restarts of "
            f"the time, the run at row {row} has {int(lengths.min())} samples, must be at least "
            f"{MIN_SAMPLES}: add a column of labels"
        )
        return labels, []
    for number, (first, end) in enumerate(itertools.pairwise(bounds), start=1):
        labels[first:end] = f"{label}-{number}"
        part = {name: values[first:end] for name, values in columns.items()}
        _refuse_second_rotation(part, f"{place}, run {label}-{number}", problems)
    note = (
        f"{place}: no column labels the runs, {len(lengths)} separated by changes of the settings "
        "and restarts of the time"
    )
    return labels, [note]


def _starts(columns: Mapping[str, np.ndarray], time: np.ndarray) -> list[int]:
    changed = np.zeros(len(time), dtype=bool)
    for name in NOMINAL:
        values = columns.get(name)
        if values is not None and values.dtype != object:
            with np.errstate(invalid="ignore"):
                changed[1:] |= np.abs(np.diff(values)) > 1e-6 * np.abs(values[1:])
    begin = 0
    starts = []
    for i in np.flatnonzero(changed | np.concatenate([[False], np.diff(time) < 0])):
        length = time[i - 1] - time[begin]
        restarts = time[i] <= time[begin] + RESTART * length and time[i] < time[i - 1]
        if changed[i] or restarts:  # other decreases of time are reported by the checks
            starts.append(int(i))
            begin = int(i)
    return starts


def _refuse_second_rotation(
    columns: Mapping[str, np.ndarray], place: str, problems: Problems
) -> None:
    """Refuse a run in which the pulley stops and turns again: it contains several runs."""
    speed = columns.get("pulley_speed_rad_s")
    if speed is None or speed.dtype == object or np.isfinite(speed).sum() < 4 * PHASE:
        return
    size = np.abs(speed[np.isfinite(speed)])
    noise = float(np.median(np.abs(np.diff(speed[np.isfinite(speed)])))) * 1.05
    turning = size > max(0.02 * float(np.quantile(size, 0.99)), 6.0 * noise)
    edges = np.flatnonzero(np.diff(turning.astype(np.int8))) + 1
    phases = [part for part in np.split(turning, edges) if part.size >= PHASE]
    states = [bool(part[0]) for part in phases]
    merged = [s for i, s in enumerate(states) if i == 0 or s != states[i - 1]]
    if merged.count(True) > 1:
        problems.add(
            f"{place}: the pulley turns {merged.count(True)} times with stops between, and no "
            "column labels the runs: add one"
        )
