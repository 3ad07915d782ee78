"""Which cell is the tight one, and where the belt begins to slide as a whole."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.signal import difference_sigma, median, running_median
from beltid.identify.friction.channels import Channels, check_cells
from beltid.identify.friction.kinds import other
from beltid.identify.friction.rest_phase import Rotation, RunRejected

Array = NDArray[np.float64]


def unswapped(channels: Channels, rotation: Rotation) -> tuple[Channels, bool]:
    """Swap the cells if the slack one carries more throughout the sliding.

    Raises
    ------
    RunRejected
        If that cannot be what happened.
    """
    half = slice((rotation.full_speed + rotation.end) // 2, rotation.end)
    usable = channels.usable[half]
    difference = (channels.tight[half] - channels.slack[half])[usable]
    if difference.size < 3:
        raise RunRejected(f"too short: {difference.size} usable samples of sliding")
    if median(difference) >= 0.0:
        return channels, False
    below = np.count_nonzero(difference < 0.0) / difference.size
    if below < 0.9:
        return channels, False
    kind = channels.kind
    if kind.weight is not None:
        raise RunRejected(
            f"the cell shows the weight to hang on the {other(kind.weight)} span while the pulley "
            f"turns, rig.weight_on: {kind.weight}"
        )
    if kind.has_torque:
        raise RunRejected(
            "the torque is negative while the pulley turns; if it counts the other way, turn its "
            'sign by a minus before its name: columns: {rig: {torque_N_m: "-torque_N_m"}}'
        )
    return replace(channels, tight=channels.slack, slack=channels.tight), True


def as_if_held(channels: Channels, rotation: Rotation) -> Channels:
    """Tensions of a belt on a dead weight as they would part if its ends were held.

    At the same ratio of both tensions at any moment, their sum stays what it is while the belt
    slides. So build-up and tail of the peak look like those of a bench with two cells.

    Raises
    ------
    RunRejected
        If there are hardly any usable samples of sliding.
    """
    half = slice((rotation.full_speed + rotation.end) // 2, rotation.end)
    with np.errstate(invalid="ignore", divide="ignore"):
        total = (channels.tight + channels.slack)[half]
        share = channels.tight / (channels.tight + channels.slack)
    if np.count_nonzero(np.isfinite(total)) < 3:
        raise RunRejected(f"too short: {np.count_nonzero(np.isfinite(total))} samples of sliding")
    held = median(total[np.isfinite(total)])
    return replace(channels, tight=held * share, slack=held * (1.0 - share))


@dataclass(frozen=True, slots=True, eq=False)
class SlidingPhase:
    """Usable samples of a run until the pulley stops, and where the belt begins to slide.

    Attributes
    ----------
    time_s : ndarray
        Times [s], shape (n,).
    tensions : ndarray
        Tight and slack tension [N], shape (n, 2).
    first : int
        First sample of the rotation.
    built : int
        First sample at which nine tenths of the build-up are reached.
    slide : int
        First sample that surely lies behind the build-up.
    """

    time_s: Array
    tensions: Array
    first: int
    built: int
    slide: int


def sliding_phase(channels: Channels, rotation: Rotation) -> SlidingPhase:
    """Find where the belt begins to slide as a whole.

    Raises
    ------
    RunRejected
        If it never does, or a cell does not answer.
    """
    keep = np.flatnonzero(channels.usable[: rotation.end])
    t = channels.time_s[keep]
    tensions = np.column_stack([channels.tight[keep], channels.slack[keep]])
    first = int(np.searchsorted(keep, rotation.first))
    difference = tensions[:, 0] - tensions[:, 1]
    n = t.size
    if n - first < 8:
        raise RunRejected(f"too short: {n - first} usable samples while the pulley turns")
    sliding = slice((rotation.full_speed + rotation.first + rotation.end) // 3, rotation.end)
    check_cells(channels, rotation.first, sliding, median(tensions[:first, 1]))
    # by time: a simulated recording has most of its samples in the build-up
    middle = 0.5 * float(t[first] + t[-1])
    settled = median(difference[min(int(np.searchsorted(t, middle)), n - 1) :])
    at_rest = median(difference[:first])
    least = 6.0 * difference_sigma(difference) / np.sqrt(0.5 * (n - first))
    if settled - at_rest <= max(least, 0.01 * median(tensions[:first, 1])):
        raise RunRejected(
            f"never slides: the tensions part by {settled - at_rest:.3g} N while the pulley turns"
        )
    reached = running_median(difference[first:], 5) - at_rest >= 0.9 * (settled - at_rest)
    build_up = int(np.argmax(reached))
    if t[first + build_up] > middle:
        raise RunRejected("never slides: the tensions still part at the end of the record")
    behind = t[first] + 1.5 * (t[first + build_up] - t[first])
    slide = max(int(np.searchsorted(t, behind, side="right")), first + build_up + 1)
    slide = max(slide, int(np.searchsorted(keep, rotation.full_speed)))
    # noise reaches the level too early as often as it falls below it too late
    built = int(np.count_nonzero(~reached[: 2 * build_up + 3]))
    return SlidingPhase(t, tensions, first, first + min(built, n - first - 1), slide)
