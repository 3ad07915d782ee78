"""Resample channels of different rates and starts to a common time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from beltid.errors import Problems

MASTERS: Final = {
    "press": ("force_N", "displacement_mm"),
    "rig": ("tension_tight_N", "tension_slack_N", "pulley_speed_rad_s"),
    "speedloss": ("driver_speed_rad_s", "driven_speed_rad_s", "torque_N_m"),
}
"""Kind of recording -> channels that determine the result; the first one gives the time."""
MAX_RATE_RATIO: Final = 20.0
"""Largest ratio of rates at which two of these channels may still record one event."""
MIN_OVERLAP: Final = 5
"""Fewest samples of the master in the time that all channels share."""


@dataclass(frozen=True, slots=True)
class Timed:
    """A channel and its time [s]; both of shape (n,)."""

    name: str
    values: np.ndarray
    time_s: np.ndarray

    @property
    def rate_Hz(self) -> float:
        """Median rate [1/s]; nan for a single sample."""
        steps = np.diff(self.time_s)
        step = float(np.median(steps)) if steps.size else 0.0
        return 1.0 / step if step > 0 else float("nan")


def aligned(
    channels: Mapping[str, Timed], kind: str, place: str, problems: Problems
) -> tuple[dict[str, np.ndarray], np.ndarray, list[str]]:
    """Interpolate all channels linearly to the times of the master.

    Only the time that the sensors of `MASTERS` share is kept. Other channels are missing outside
    the time they cover; nothing is extrapolated. A missing sample stays missing.

    Parameters
    ----------
    channels : mapping of str to Timed
        Channels by our columns, without the time.
    kind : str
        Kind of recording: it decides which channel gives the time.
    place : str
        File or group, for messages.
    problems : Problems
        Collects the reasons why channels cannot be aligned.

    Returns
    -------
    values : dict
        Values by our columns, shape (m,).
    time_s : ndarray
        Times of the master within the shared time, shape (m,).
    notes : list of str
        Notes on interpolated channels and dropped samples.
    """
    role = next(role for role in (*MASTERS[kind], *channels) if role in channels)
    master = channels[role]
    others = {r: c for r, c in channels.items() if not _same_time(c, master)}
    if not others:
        return {r: c.values for r, c in channels.items()}, master.time_s, []
    wrong = problems.count
    for r, channel in others.items():
        _check(r, channel, master, kind, place, problems)
    if problems.count > wrong:
        return {}, master.time_s[:0], []
    bounding = [c for r, c in channels.items() if r in MASTERS[kind]]
    first = max(c.time_s[0] for c in bounding)
    last = min(c.time_s[-1] for c in bounding)
    kept = (master.time_s >= first) & (master.time_s <= last)
    if int(kept.sum()) < MIN_OVERLAP:
        problems.add(
            f"{place}: the channels share {int(kept.sum())} samples of time, from {first:g} to "
            f"{last:g} s; must be at least {MIN_OVERLAP}"
        )
        return {}, master.time_s[:0], []
    time = master.time_s[kept]
    values = {
        r: _interpolated(c, time) if r in others else c.values[kept] for r, c in channels.items()
    }
    shown = ", ".join(f"{c.name} ({c.rate_Hz:.4g}/s)" for c in others.values())
    notes = [
        f"{shown} interpolated linearly to the times of {master.name} ({master.rate_Hz:.4g}/s)"
    ]
    if not kept.all():
        notes.append(
            f"{int((~kept).sum())} samples outside the time shared by the sensors, {first:g} to "
            f"{last:g} s, left out"
        )
    return values, time, notes


def _same_time(channel: Timed, master: Timed) -> bool:
    if channel.time_s is master.time_s:
        return True
    if channel.time_s.shape != master.time_s.shape:
        return False
    step = 1.0 / master.rate_Hz if np.isfinite(master.rate_Hz) else 0.0
    return bool(np.all(np.abs(channel.time_s - master.time_s) <= 1e-6 * step))


def _check(
    role: str, channel: Timed, master: Timed, kind: str, place: str, problems: Problems
) -> None:
    for timed in (channel, master):
        if not np.all(np.isfinite(timed.time_s)) or np.any(np.diff(timed.time_s) <= 0):
            problems.add(
                f"{place}: the time of {timed.name} does not increase from sample to sample, so "
                "channels of other rates cannot be aligned with it"
            )
            return
    if channel.time_s.size < 2:
        problems.add(f"{place}: {channel.name} has only one sample and cannot be aligned")
        return
    ratio = max(channel.rate_Hz / master.rate_Hz, master.rate_Hz / channel.rate_Hz)
    if role in MASTERS[kind] and ratio > MAX_RATE_RATIO:
        problems.add(
            f"{place}: {channel.name} has {channel.rate_Hz:.4g} samples per second, {master.name} "
            f"{master.rate_Hz:.4g}; rates that differ by more than {MAX_RATE_RATIO:g} times are "
            "not aligned"
        )


def _interpolated(channel: Timed, time: np.ndarray) -> np.ndarray:
    if channel.values.dtype == object:  # a label applies until the next one
        at = np.searchsorted(channel.time_s, time, side="right") - 1
        labels: np.ndarray = channel.values[np.maximum(at, 0)]
        return labels
    return np.interp(time, channel.time_s, channel.values, left=np.nan, right=np.nan)
