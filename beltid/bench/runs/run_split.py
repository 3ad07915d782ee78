"""Runs of a raw table without labels: told apart where settings change or time restarts."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Final

import numpy as np

from beltid.errors import Problems
from beltid.tables.schemas import NOMINAL

RESTART: Final = 0.05
"""A time that falls to the first this share of the run before begins a new run."""
MIN_SAMPLES: Final = 10
PHASE: Final = 5
"""Samples in a row that make the pulley stand or turn."""


def row_labels(length: int, known: np.ndarray | None = None) -> np.ndarray:
    """Labels of the rows of a table of plateaus: where there is none, their number from 1."""
    words = [None] * length if known is None else known.tolist()
    return np.array(
        [str(row + 1) if word is None else word for row, word in enumerate(words)], dtype=object
    )


def run_labels(
    columns: Mapping[str, np.ndarray], label: str, place: str, problems: Problems
) -> tuple[np.ndarray, list[str]]:
    """Label of every sample of a raw table.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Columns of the raw table, in our units.
    label : str
        Label of the raw table: that of its run if it holds one only.
    place : str
        Name of the raw table, for messages.
    problems : Problems
        Collects what cannot be decided.

    Returns
    -------
    labels : ndarray
        Object array of str.
    notes : list of str
        How the runs were told apart.
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
            f"{place}: no column labels the runs, and what changes of settings and restarts of the "
            f"time tell apart has {int(lengths.min())} samples at row {row}; a run needs "
            f"{MIN_SAMPLES}: add a column of labels"
        )
        return labels, []
    for number, (first, end) in enumerate(itertools.pairwise(bounds), start=1):
        labels[first:end] = f"{label}-{number}"
        part = {name: values[first:end] for name, values in columns.items()}
        _refuse_second_rotation(part, f"{place}, run {label}-{number}", problems)
    note = (
        f"{place}: no column labels the runs, {len(lengths)} told apart by changes of the settings "
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
        if changed[i] or restarts:  # a time that falls otherwise is told by the checks
            starts.append(int(i))
            begin = int(i)
    return starts


def _refuse_second_rotation(
    columns: Mapping[str, np.ndarray], place: str, problems: Problems
) -> None:
    """Refuse a run in which the pulley stops and turns again: it holds several."""
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
            f"{place}: the pulley turns {merged.count(True)} times with rests between, and no "
            "column labels the runs: add one"
        )
