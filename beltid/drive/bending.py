"""Extra length of a belt that bends: the effect of its stiffness where it leaves a pulley, (D15).

A belt that resists bending leaves the circle early and enters a span that runs further out than the
tangent of the circle. Its path is longer than that of a string, more so in a looser span: at fixed
centres the slack span dominates. The result holds to leading order in the bending length over the
radius.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from beltid.drive.geometry import Layout
from beltid.drive.model import Drive

Array = NDArray[np.float64]


def extra_length(drive: Drive, laid: Layout, P: Array) -> float:
    """Return the length of the loop beyond that of a string [m], (D15).

    Parameters
    ----------
    drive : Drive
        Belt, contact law and pulleys.
    laid : Layout
        Spans and wraps.
    P : ndarray (n,)
        Effective forces of the spans [N], > 0; span i leaves pulley i.
    """
    total = 0.0
    for i, force in enumerate(P.tolist()):
        ends = (i, (i + 1) % P.size)
        total += sum(extra_at_end(drive, k, force) for k in ends)
        # both ends of the span move outwards, each to its side; the span tilts by the difference
        offsets = [laid.senses[k] * further_out(drive, k, force) for k in ends]
        total -= (offsets[0] - offsets[1]) ** 2 / (2.0 * laid.spans[i])
    return float(total)


def further_out(drive: Drive, i: int, P: float) -> float:
    """Return the offset of a span outwards from the tangent of pulley i, ``b²/(2R)`` [m]."""
    return drive.belt.EI / (2.0 * P * drive.pulleys[i].R)


def extra_at_end(drive: Drive, i: int, P: float) -> float:
    """Return the length beyond that of a string at one end of the arc of pulley i [m].

    ``b³/(12 R²)`` with ``b = sqrt(EI/P)`` on a rigid pulley; on a bed that of a beam under tension.
    """
    R, EI = drive.pulleys[i].R, drive.belt.EI
    b = math.sqrt(EI / P)
    if drive.law is None or not drive.pulleys[i].ribs:
        return b**3 / (12.0 * R * R)
    bed = P / (R * float(drive.law.penetration(P / R)))
    m = math.sqrt(bed / EI)  # product of the decay rates on the bed
    s = math.sqrt(1.0 / b**2 + 2.0 * m)  # their sum
    # at the end of the contact, all times R: penetration of the bed without bending, slope and
    # curvature relative to the circle, distance from the tangent point
    delta = 1.0 / (b * m) ** 2
    slope = (1.0 / b + (s + 1.0 / b) * m * delta) / (s * s + s / b - m)
    curvature = s * slope - m * delta
    place = slope - b + b * curvature
    in_span = 0.5 * b**3 * (1.0 - curvature) ** 2
    of_slopes = (slope**2 + m * delta**2) / (2.0 * s)
    between = place * delta - (s * delta - slope) / m
    return 0.5 * (of_slopes - 2.0 * between + in_span + place**3 / 3.0) / R**2
