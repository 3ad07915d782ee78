"""Solve set-valued Coulomb friction in one implicit step, Eqs. (11), (12), without regularisation.

Every touching patch either sticks (its slip in the step is zero, its force lies in the cone) or
slides (its force is on the edge of the cone and opposes its slip). :func:`violations` certifies a
step: it measures by how much these rules are violated. :func:`revise` is the active-set update that
restores them, the semismooth Newton method on the friction law (Alart & Curnier 1991). The force of
a sticking patch is its multiplier ``la_T`` plus ``augmentation * slip``. As the slip goes to zero
the multiplier carries the whole force, so the limit is exact stick for any augmentation, and the
tangent stays banded.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.rigsim.beam.belt import BeltArrays
from beltid.rigsim.compiled import leaf
from beltid.rigsim.contact.points import SLIDE, STICK, Motion, Patches, Points

Array = NDArray[np.float64]

SLIP_TOLERANCE = 1.0e-13  # slip of a sticking patch in one step [m]
CONE_TOLERANCE = 1.0e-9  # force beyond the cone over the largest limit of the arc [-]
BEYOND, BACKWARD = 1, 2  # violations of a patch: force beyond its limit, slip backwards


class Certificate(NamedTuple):
    """Violations of the friction law at the touching patches.

    Attributes
    ----------
    slip : float
        Largest slip of a sticking patch, or backward slip of a sliding one [m].
    cone : float
        Largest force beyond the cone over the largest limit of the arc [-].
    sticking, touching : float
        Length of belt that sticks, and that touches in total [m].
    """

    slip: float
    cone: float
    sticking: float
    touching: float


@leaf
def violations(belt: BeltArrays, points: Points) -> Certificate:
    """Certify the contact state of :func:`beltid.rigsim.contact.forces.add_contact`."""
    patches = points.patches
    slip = cone = limit = sticking = touching = 0.0
    for e in range(patches.size):
        patch = patches[e]
        if patch.limit <= 0.0:
            continue
        length = 0.0
        for c in range(belt.w_c.shape[1]):
            if points.F_N[e, c] > 0.0:
                length += belt.w_c[e, c]
        touching += length
        limit = max(limit, patch.limit)
        if patch.status == STICK:
            sticking += length
            slip = max(slip, abs(patch.slip))
            cone = max(cone, abs(patch.force) - patch.limit)
        else:
            slip = max(slip, -patch.sign * patch.slip)
    return Certificate(slip, cone / limit if limit > 0.0 else 0.0, sticking, touching)


@leaf
def revise(motion: Motion, patches: Patches, step: Array, most_changes: int) -> int:
    """Update multipliers and statuses with the solution ``step`` (n,) of the linearised system.

    Patches that violate the law change status, together with those that a slip front sweeps in a
    Newton step for its position (:func:`let_go`, :func:`catch`). This can cycle; with
    ``most_changes`` = 1 only the first violating patch changes (Murty's least-index rule, which
    terminates for every right-hand side if the compliance of the patches is a P-matrix).

    Returns
    -------
    int
        Number of patches that changed between stick and slide.
    """
    n_e = patches.size
    found = 0
    for e in range(n_e):
        patch = patches[e]
        patch.broken = 0
        if patch.limit <= 0.0:
            # a closing patch starts by sliding with the pulley: if it stuck at once, while its
            # slip is not yet small, it would break loose again
            patch.status = SLIDE if motion.omega > 0.0 else STICK
            patch.sign = 1.0
            patch.la_T = 0.0
            continue
        moved = 0.0  # advance of the patch along t
        for j in range(8):
            moved += patch.carry[j] * step[4 * e + j]
        if patch.status == STICK:
            patch.la_T = patch.force - motion.augmentation * moved
            edge = patch.limit * (1.0 + 0.1 * CONE_TOLERANCE)
            if found < most_changes and abs(patch.la_T) > edge:
                patch.broken = BEYOND
                found += 1
        elif found < most_changes and patch.sign * (patch.slip - moved) < -0.1 * SLIP_TOLERANCE:
            patch.broken = BACKWARD
            found += 1
    free = most_changes == n_e
    changes = end = 0
    for begin in range(n_e):
        if begin < end:
            continue
        end = begin + 1
        how = patches[begin].broken
        if how == 0:
            continue
        while end < n_e and patches[end].broken == how:
            end += 1
        if how == BEYOND:
            changes += let_go(patches, begin, end, free)
        else:
            changes += catch(patches, begin, end, free)
    return changes


@leaf
def sticks(patches: Patches, e: int) -> bool:
    """Return whether patch ``e`` exists, touches and sticks."""
    return 0 <= e < patches.size and patches[e].limit > 0.0 and patches[e].status == STICK


@leaf
def let_go(patches: Patches, begin: int, end: int, ahead: bool) -> int:
    """Make the patches ``begin`` to ``end`` slide and, with ``ahead``, those beyond that follow.

    If a slip front has to advance, the force on the sticking patches next to it is too large. The
    excess loads the following patches, so the front advances until they carry all of it. For a rod
    of length L that slides behind its front with a friction surplus g per length, the excess force
    is ``g (L_1**2 - L**2)/(2 L)`` for a front that belongs at ``L_1``: sweeping these patches is
    Newton's step for ``L**2 = L_1**2`` on any mesh.
    """
    left, right = sticks(patches, begin - 1), sticks(patches, end)
    carried = 0.0
    for e in range(begin, end):
        carried += patches[e].la_T
    sign = math.copysign(1.0, carried)
    for e in range(begin, end):
        patch = patches[e]
        patch.status = SLIDE
        patch.sign = sign if ahead else math.copysign(1.0, patch.la_T)
        carried -= sign * patch.limit
    changes = end - begin
    if not ahead:
        return changes
    if left and right:
        carried *= 0.5
    for direction in (-1, 1):
        surplus = sign * carried
        e = end if direction == 1 else begin - 1
        while sticks(patches, e):
            patch = patches[e]
            surplus += sign * patch.la_T - patch.limit
            if surplus <= 0.0:
                break
            patch.status = SLIDE
            patch.sign = sign
            changes += 1
            e += direction
    return changes


@leaf
def catch(patches: Patches, begin: int, end: int, half: bool) -> int:
    """Make the patches ``begin`` to ``end``, which would slip backwards, stick.

    Behind a front that is a distance d too far ahead, the slip is a parabola, backwards over 2 d.
    With ``half`` only the half next to the sticking patches sticks, which moves the front back to
    its correct position.
    """
    left, right = sticks(patches, begin - 1), sticks(patches, end)
    if half and left != right:
        middle = (end - begin + 1) // 2
        if left:
            end = begin + middle
        else:
            begin = end - middle
    for e in range(begin, end):
        patches[e].status = STICK
        patches[e].la_T = patches[e].force
    return end - begin
