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

from beltid.rigsim.beam.belt import BeltArrays
from beltid.rigsim.compiled import leaf
from beltid.rigsim.contact.points import SLIDE, STICK, Motion, Patches, Points

Array = NDArray[np.float64]

SLIP_TOLERANCE = 1.0e-13  # of a sticking patch in one step [m]
CONE_TOLERANCE = 1.0e-9  # force beyond the cone over the largest limit of the arc [-]
BEYOND, BACKWARD = 1, 2  # how a patch breaks the law: force beyond its limit, slip backwards


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


@leaf
def violations(belt: BeltArrays, points: Points) -> Certificate:
    """Certificate of the contact state of :func:`beltid.rigsim.contact.points.add_contact`."""
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

    Patches that break the law change sides, and with them what a slip front would sweep by Newton's
    rule for its place (:func:`let_go`, :func:`catch`). That can go in circles; with
    ``most_changes`` = 1 only the first patch that breaks the law changes (Murty's least-index rule,
    which ends for every right-hand side if the compliance of the patches is a P-matrix).

    Returns
    -------
    int
        Patches that changed between stick and slide.
    """
    n_e = patches.size
    found = 0
    for e in range(n_e):
        patch = patches[e]
        patch.broken = 0
        if patch.limit <= 0.0:
            # a patch that closes is dragged by the pulley until it is seen to stick: held at once
            # with a slip that is not yet small, it would be torn off again
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
    """Whether there is a patch ``e``, it touches and sticks."""
    return 0 <= e < patches.size and patches[e].limit > 0.0 and patches[e].status == STICK


@leaf
def let_go(patches: Patches, begin: int, end: int, ahead: bool) -> int:
    """Make the patches ``begin`` to ``end`` slide and, with ``ahead``, those beyond that follow.

    A front that has to advance shows as a force on the first patches behind it. What these cannot
    take falls on the next ones, so the front moves on until they have taken all of it. For a
    rod of length L sliding behind its front with the surplus g of its friction per length, the
    force is ``g (L_1**2 - L**2)/(2 L)`` if the front belongs at ``L_1``: the patches swept are
    Newton's step for ``L**2 = L_1**2``, however fine the mesh.
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
    """Make the patches ``begin`` to ``end``, that would slip backwards, stick.

    Behind a front that is too far ahead by d the slip is a parabola, backwards over 2 d. With
    ``half`` the half next to the patches that stick is caught, so the front moves back to where it
    belongs.
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
