"""Where the surface must be known: weighted points (f_N, v), and their regions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from beltid.plan.design import Knowledge
from beltid.plan.knowledge import SAME_SPEED
from beltid.refine.curves import Curves

Array = NDArray[np.float64]

PLACES: Final = 30  # forces at each speed
REGIONS: Final = 3  # along each axis


@dataclass(frozen=True, slots=True)
class Target:
    """Points at which ln mu must be known, arrays (q,)."""

    normal_force: Array  # line forces [N/m] and sliding speeds [m/s]
    slip_speed: Array
    weight: Array  # weights of the points; their sum is one
    rows: Array  # ln mu at the points per parameter of the surface, (q, size)

    @property
    def W(self) -> Array:
        """Weights of the parameters (size, size): ``p' W p`` is the mean square of ln mu."""
        return np.asarray(self.rows.T @ (self.weight[:, None] * self.rows))

    def variances(self, knowledge: Knowledge) -> Array:
        """Return the variance of ln mu at the points (q,)."""
        scatter = np.einsum("qp,pr,qr->q", self.rows, knowledge.scatter, self.rows)
        return np.asarray(scatter + np.sum(np.square(self.rows @ knowledge.changes), axis=1))

    def regions(self) -> Iterator[NDArray[np.bool_]]:
        """Yield masks (q,) of the regions with weight, by force, then speed: thirds in ln."""
        force, speed = (_thirds(np.log(x)) for x in (self.normal_force, self.slip_speed))
        for number in range(REGIONS**2):
            here = (force == number // REGIONS) & (speed == number % REGIONS)
            if self.weight[here].sum() > 0.0:
                yield here


def _thirds(x: Array) -> NDArray[np.intp]:
    """Return the index of the third of the range in which each value lies."""
    width = max(float(np.ptp(x)), 1.0e-12)
    return np.asarray(np.floor(REGIONS * (x - x.min()) / width * (1.0 - 1.0e-9)), dtype=np.intp)


def surface_target(
    curves: Curves, force: tuple[float, float], speed: tuple[float, float]
) -> Target:
    """Weigh a range of forces [N/m] and speeds [m/s] uniformly in ln f and ln v.

    The speeds are those of the curves within the range, each weighted by half of its gaps to the
    next ones; a curve just outside an end of the range, by up to `SAME_SPEED`, counts too.
    """
    low, high = np.log(speed)
    inside = (curves.log_speed >= low - SAME_SPEED) & (curves.log_speed <= high + SAME_SPEED)
    v = np.exp(curves.log_speed[inside])
    f = np.geomspace(*force, PLACES)
    gaps = np.diff(np.log(v))
    share = 0.5 * (np.append(gaps, 0.0) + np.append(0.0, gaps)) if v.size > 1 else np.ones(1)
    weight = np.repeat(share / share.sum() / PLACES, PLACES)
    rows = np.kron(np.eye(inside.size)[inside], curves.basis(np.log(f)))
    return Target(np.tile(f, v.size), np.repeat(v, PLACES), weight, rows)
