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
