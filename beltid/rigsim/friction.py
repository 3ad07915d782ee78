"""Set-valued Coulomb friction of one implicit step, Eqs. (11) and (12), without regularisation.

Every touching patch either sticks (its slip in the step is zero, its force anywhere in the cone) or
slides (its force on the cone's edge, against its slip). :func:`violations` is the certificate of a
step: by how much these rules are broken. :func:`revise` is the active-set update that mends them,
the semismooth Newton method on the friction law (Alart & Curnier 1991). The force of a sticking
patch is its multiplier ``la_T`` plus ``augmentation * slip``; as the slip goes to zero the
multiplier carries all of it, so the limit is exact stick, whatever the augmentation, and the
tangent stays banded.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.rigsim.belt import BeltArrays
from beltid.rigsim.compiled import kernel
from beltid.rigsim.contact import SLIDE, STICK, Motion, Points

Array = NDArray[np.float64]

SLIP_TOLERANCE = 1.0e-13  # of a sticking patch in one step [m]
CONE_TOLERANCE = 1.0e-9  # force beyond the cone over the largest limit of the arc [-]


class Certificate(NamedTuple):
    """How well the friction law holds at all touching patches.

    Attributes
    ----------
    slip : float
        Largest slip of a sticking patch, or backward slip of a sliding one [m].
    cone : float
        Largest force beyond the cone over the largest limit of the arc [-].
    sticking, touching : float
        Length of belt in contact that sticks, and in all [m].
    """

    slip: float
    cone: float
    sticking: float
    touching: float


@kernel
def violations(belt: BeltArrays, points: Points) -> Certificate:
    """Certificate of the contact state of :func:`beltid.rigsim.contact.add_contact`."""
    slip = cone = limit = sticking = touching = 0.0
    for e in range(points.status.size):
        if points.limit[e] <= 0.0:
            continue
        length = 0.0
        for c in range(belt.w_c.shape[1]):
            if points.F_N[e, c] > 0.0:
                length += belt.w_c[e, c]
        touching += length
        limit = max(limit, points.limit[e])
        if points.status[e] == STICK:
            sticking += length
            slip = max(slip, abs(points.slip[e]))
            cone = max(cone, abs(points.force[e]) - points.limit[e])
        else:
            slip = max(slip, -points.sign[e] * points.slip[e])
    return Certificate(slip, cone / limit if limit > 0.0 else 0.0, sticking, touching)


@kernel
def revise(motion: Motion, points: Points, step: Array, most_changes: int) -> int:
    """Update multipliers and statuses with the solution ``step`` (n,) of the linearised system.

    All patches that break the law change sides at once, which can go in circles; with
    ``most_changes`` = 1 only the first one does (Murty's least-index rule, which ends for every
    right-hand side if the compliance of the patches is a P-matrix).

    Returns
    -------
    int
        Patches that changed between stick and slide.
    """
    changes = 0
    for e in range(points.status.size):
        if points.limit[e] <= 0.0:
            # a patch that closes is dragged by the pulley until it is seen to stick: held at once
            # with a slip that is not yet small, it would be torn off again
            points.status[e] = SLIDE if motion.omega > 0.0 else STICK
            points.sign[e] = 1.0
            points.la_T[e] = 0.0
            continue
        moved = 0.0  # advance of the patch along t
        for j in range(8):
            moved += points.pull[e, j] * step[4 * e + j]
        if points.status[e] == STICK:
            la_T = points.force[e] - motion.augmentation * moved
            beyond = abs(la_T) > points.limit[e] * (1.0 + 0.1 * CONE_TOLERANCE)
            if beyond and changes < most_changes:
                points.status[e] = SLIDE
                points.sign[e] = math.copysign(1.0, la_T)
                changes += 1
            else:
                points.la_T[e] = la_T
        elif (
            changes < most_changes
            and points.sign[e] * (points.slip[e] - moved) < -0.1 * SLIP_TOLERANCE
        ):
            points.status[e] = STICK
            points.la_T[e] = points.force[e]
            changes += 1
    return changes
