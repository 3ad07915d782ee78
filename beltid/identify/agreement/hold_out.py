"""Hold-out validation: choose the runs to leave out; the surface is refined from the others.

A fitted surface agrees with the runs it was fitted to; only runs that it has not seen test it.
All runs of one contact arc, or of one speed, are left out together, because leaving out one of
several repetitions would be no test. Beyond the lowest and highest speed the law uses the nearest
measured value without any claim, so only the speeds in between are left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from beltid.errors import TooFewSettings
from beltid.identify.agreement.compare import SAME_SETTING
from beltid.identify.estimators.statistics import settings_of

HoldOut = Literal["arc", "speed"]

SETTING: Final[dict[HoldOut, tuple[str, str]]] = {
    "arc": ("arc_deg", "°"),
    "speed": ("pulley_speed_rad_s", " rad/s"),
}
"""Column of each setting, and its unit as printed."""
FEWEST: Final[dict[HoldOut, int]] = {"arc": 2, "speed": 3}
FEWEST_RUNS: Final = 4
"""Minimum number of runs to refine a surface from."""


@dataclass(frozen=True, slots=True)
class Fold:
    """A setting that is left out."""

    name: str  # such as "arc 40°"
    left_out: NDArray[np.intp]  # rows of the runs to predict
    rest: NDArray[np.intp]  # rows of the runs to refine the surface from


def folds(
    columns: Mapping[str, np.ndarray], usable: NDArray[np.intp], by: HoldOut
) -> tuple[Fold, ...]:
    """List the settings that can be left out, in ascending order.

    Parameters
    ----------
    columns : mapping of str to ndarray (n,)
        Columns of the reduced runs.
    usable : ndarray of int
        Rows of the usable runs.
    by : {"arc", "speed"}
        Setting to leave out.

    Raises
    ------
    TooFewSettings
        If too few settings or runs would remain.
    """
    column, unit = SETTING[by]
    values = np.abs(np.asarray(columns[column], dtype=float)[usable])
    label = settings_of(values, SAME_SETTING[column])
    count = int(label.max()) + 1 if label.size else 0
    if count < FEWEST[by]:
        raise TooFewSettings(
            f"compare.hold_out = {by}: {count} {by}{'' if count == 1 else 's'} measured, must be "
            f"at least {FEWEST[by]} to leave one out"
        )
    inner = range(count) if by == "arc" else range(1, count - 1)
    result = tuple(
        Fold(
            f"{by} {np.median(values[label == k]):.4g}{unit}",
            usable[label == k],
            usable[label != k],
        )
        for k in inner
    )
    short = [
        f"compare.hold_out = {by}: {fold.rest.size} runs are left without {fold.name}, must be at "
        f"least {FEWEST_RUNS}"
        for fold in result
        if fold.rest.size < FEWEST_RUNS
    ]
    if short:
        raise TooFewSettings(short)
    return result
