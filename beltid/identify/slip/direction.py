"""Direction in which the drive of a speed-loss recording turns."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SPEEDS = ("driver_speed_rad_s", "driven_speed_rad_s")
STANDS = 0.05
"""A driven pulley slower than this share of the driver says nothing about its direction."""


def forward_runs(
    runs: Mapping[str, Mapping[str, Array]],
) -> tuple[dict[str, dict[str, Array]], list[str]]:
    """Runs of a drive that turns backwards as those of the mirrored drive, and what was turned.

    Parameters
    ----------
    runs : mapping of str to mapping of str to ndarray
        Columns of each run.

    Returns
    -------
    tuple
        Runs with both speeds turned where both are negative, and notes. The torque of these runs
        is turned with them if it is negative on the whole: then it is counted in the direction of
        the pulleys' axis. A torque that stays positive is counted in the direction of the turning.
    """
    backward = [label for label, run in runs.items() if _turns_backwards(run)]
    if not backward:
        return {label: dict(run) for label, run in runs.items()}, []
    torque = np.concatenate([runs[label]["torque_N_m"] for label in backward])
    turned = SPEEDS if not np.nansum(torque) < 0.0 else (*SPEEDS, "torque_N_m")
    forward = {
        label: {
            name: -values if label in backward and name in turned else values
            for name, values in run.items()
        }
        for label, run in runs.items()
    }
    what = "speeds" if turned is SPEEDS else "speeds and of the torque"
    which = "all runs" if len(backward) == len(runs) else ", ".join(backward)
    return forward, [f"the drive turns backwards in {which}: sign of the {what} turned"]


def turns_opposite(driver_rad_s: float, driven_rad_s: float) -> bool:
    """Whether the driven pulley turns against the driver, as no open belt lets it."""
    return driver_rad_s * driven_rad_s < 0.0 and abs(driven_rad_s) > STANDS * abs(driver_rad_s)


def _turns_backwards(run: Mapping[str, Array]) -> bool:
    driver, driven = (run[name][np.isfinite(run[name])] for name in SPEEDS)
    if not (driver.size and driven.size) or not np.median(driver) < 0.0:
        return False
    return not turns_opposite(float(np.median(driver)), float(np.median(driven)))
