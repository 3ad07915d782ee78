"""What is known to be wrong with the load cells of the friction rig, taken off the readings.

It is taken off before anything else, so that the difference of the cells at rest
(`friction_imbalance`) is only what is left of it: what a calibration already knows is not
corrected twice, and what it does not know still shows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from beltid.identify.friction.channels import Channels

Array = NDArray[np.float64]

CLEAR, LARGE = 5.0, 0.1
"""Standard errors, and share of the lowest stated tension or of the factor 1, from which readings
do not fit what is stated."""
ROUGH = "If the stated tensions are no more than rough: friction.check_initial_tension: false"
TOLD = "known errors of the load cells taken off"
"""How the note begins."""


@dataclass(frozen=True, slots=True)
class KnownCell:
    """Known errors of one load cell; the defaults are those of a perfect one."""

    tare_N: float = 0.0
    """Reading without a load [N]."""
    gain: float = 1.0
    """True force over reading, less tare [-]."""
    tilt_deg: float = 0.0
    """Angle between the free span of the belt and the axis of the cell [deg]."""

    @property
    def scale(self) -> float:
        """Tension over reading, less tare [-]."""
        return self.gain / float(np.cos(np.radians(self.tilt_deg)))

    @property
    def is_perfect(self) -> bool:
        """Whether there is nothing to take off."""
        return self.tare_N == 0.0 and self.scale == 1.0

    def tension(self, reading_N: ArrayLike) -> Array:
        """Tension of the span from the reading of its cell.

        The cell feels the part of the tension along its axis,
        ``T = gain (reading - tare) / cos(tilt)``.

        Parameters
        ----------
        reading_N : array_like
            Readings [N].
        """
        return self.scale * (np.asarray(reading_N, dtype=float) - self.tare_N)

    def described(self, name: str) -> str:
        """What is taken off, in words; empty for a perfect cell."""
        parts = [
            text
            for text, is_there in (
                (f"tare {self.tare_N:g} N", self.tare_N != 0.0),
                (f"gain {self.gain:g}", self.gain != 1.0),
                (f"tilt {self.tilt_deg:g} deg", self.tilt_deg != 0.0),
            )
            if is_there
        ]
        return f"{name} {', '.join(parts)}" if parts else ""


@dataclass(frozen=True, slots=True)
class KnownCells:
    """Known errors of both load cells of the rig, each that of its own column."""

    tight: KnownCell = KnownCell()
    slack: KnownCell = KnownCell()

    @property
    def note(self) -> str:
        """What is taken off, for the user; empty if there is nothing."""
        cells = (self.tight.described("tight cell"), self.slack.described("slack cell"))
        said = "; ".join(filter(None, cells))
        return f"{TOLD}: {said}" if said else ""

    def applied(self, channels: Channels) -> Channels:
        """Channels with tensions in place of readings."""
        if self.tight.is_perfect and self.slack.is_perfect:
            return channels
        step_tight, step_slack = channels.steps
        return replace(
            channels,
            tight=self.tight.tension(channels.tight),
            slack=self.slack.tension(channels.slack),
            steps=(self.tight.scale * step_tight, self.slack.scale * step_slack),
        )


def against_stated(measured_N: Array, stated_N: Array) -> str:
    """What is wrong between the tensions at rest and those that the test was to have.

    Their line ``measured = offset + factor stated`` is that through the medians of the lowest and
    of the highest third of the runs (Tukey's resistant line): a few runs set wrongly do not matter.

    Parameters
    ----------
    measured_N : ndarray
        Mean of both cells at rest [N], shape (n,).
    stated_N : ndarray
        Stated initial tensions [N], nan where there is none, shape (n,).

    Returns
    -------
    str
        Empty if they fit, or if fewer than four runs or a single tension leave it open.
    """
    known = np.isfinite(measured_N) & np.isfinite(stated_N)
    measured, stated = measured_N[known], stated_N[known]
    if known.sum() < 4:
        return ""
    order = np.argsort(stated, kind="stable")
    third = -(-order.size // 3)
    (low, high), (at_low, at_high) = (
        (np.median(x[order[:third]]), np.median(x[order[-third:]])) for x in (stated, measured)
    )
    if high - low < 0.1 * abs(high):
        return ""
    factor = float((at_high - at_low) / (high - low))
    offset = float(np.median(measured - factor * stated))
    away = measured - offset - factor * stated
    scatter = 1.4826 * float(np.median(np.abs(away))) + 1e-3 * float(np.median(stated))
    design = np.column_stack([np.ones_like(stated), stated])
    # the line of medians is some 1.25 times as uncertain as that of least squares
    errors = 1.25 * scatter * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    offset_se, factor_se = errors
    lowest = float(np.min(stated))
    if abs(offset) > max(CLEAR * offset_se, LARGE * lowest):
        return (
            f"the tensions at rest are {offset:+.3g} N (standard error {offset_se:.2g} N) off the "
            "stated initial tensions, whatever the tension: were the load cells tared? State their "
            "readings without a load as friction.tension_tight_tare_N and "
            f"friction.tension_slack_tare_N. {ROUGH}"
        )
    if abs(factor - 1.0) > max(CLEAR * factor_se, LARGE):
        return (
            f"the tensions at rest are {factor:.4g} (standard error {factor_se:.2g}) times the "
            "stated initial tensions: is the unit of the cells right (units.rig), is the force of "
            "the whole hub stated? A known error of the cells is friction.tension_tight_gain and "
            f"friction.tension_slack_gain. {ROUGH}"
        )
    return ""
