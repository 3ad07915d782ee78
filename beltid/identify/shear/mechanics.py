"""Mechanics of the build-up: the belt sticks to a pulley that begins to turn.

If the tension member moves by u relative to the foot of the ribs, the ribs react with k_s u per
length. While the belt sticks, the tension difference rises with the travel x of the pulley's
surface by

    d(T_tight - T_slack)/dx = 2 / [C + lambda coth(l / (2 lambda)) / EA*],   lambda² = EA*/k_s, (B1)

with the compliance C of a span and its end of the contact, the length l in contact, and
1/EA* = 1/EA + 1/(R² k_t): on the arc the belt yields by stretching and by penetrating deeper.
At each end of the arc, bending holds the belt off the pulley over

    e = b - c - (b² - T/k)/(2 L),   b² = EI/T,   c² = 2 p + T/k,   p² = EI/k,                (B2)

and higher tension straightens the bent belt, with a compliance

    B = [b³ - (T/k)(5 c² - 5 p - 2 p²/c²)/c - 2 (b⁴ - (T/k)²)/L] / (8 R² T),                 (B3)

so that l = R beta - 2 e and C = L/EA + B + e/EA*, with the effective length L of a span. Where the
line force rises from zero, over sqrt(T/k), the belt slips from the start, (B4).

Derived in docs/theory.md, "Build-up of the rig".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.identify.shear.build_up import SHARE
from beltid.laws.penalty import stiffness_under

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class LaidBelt:
    """A belt laid on the pulley of the rig, without supports and rib shear; arrays (n,).

    Attributes
    ----------
    EA : float
        Axial stiffness of the belt [N].
    arc_EA : ndarray
        EA* of (B1) [N].
    lift_off : ndarray
        Arc at each end over which bending holds the belt off the pulley, e of (B2) [m]; negative
        if the belt touches before its tangent point, as on a soft bed.
    end_compliance : ndarray
        Compliance due to bending at one end, B of (B3) [m/N].
    rise : ndarray
        Length over which the line force would rise from zero to T/R [m].
    """

    EA: float
    arc_EA: Array
    lift_off: Array
    end_compliance: Array
    rise: Array

    def build_up_slope(self, k_s: float, arc: Array, span: float) -> Array:
        """Calculate the slope of T_tight - T_slack over pulley travel in full stick, Eq. (B1).

        Parameters
        ----------
        k_s : float
            Shear stiffness of the ribs [N/m²].
        arc : ndarray
            Length of the arc between the tangent points, R beta [m], shape (n,).
        span : float
            Effective length of a free span [m]: half the sum of both spans, plus EA times the
            compliance of a support.

        Returns
        -------
        ndarray
            [N/m], shape (n,).
        """
        decay = np.sqrt(self.arc_EA / k_s)
        contact = arc - 2.0 * self.lift_off
        ribs = decay / np.tanh(contact / (2.0 * decay)) / self.arc_EA
        return np.asarray(2.0 / (self._end(span) + ribs))

    def micro_slip(self, k_s: float, arc: Array, span: float) -> Array:
        """Calculate the relative loss of slope by slip at the ends of the contact, Eq. (B4).

        The loss [-] is that of a line through the build-up up to `SHARE` of the plateau difference,
        shape (n,); the parameters are those of :meth:`build_up_slope`.
        """
        contact = arc - 2.0 * self.lift_off
        slip_area = SHARE * self.rise * contact
        decay = np.sqrt(self.arc_EA / k_s + slip_area / 8.0)
        bend = np.tanh(contact / (2.0 * decay))
        free = self._end(span) * self.arc_EA
        return np.asarray(slip_area / (2.0 * decay * bend) ** 2 / (1.0 + free / decay * bend))

    def _end(self, span: float) -> Array:
        """Return the compliance of a span and its end of the contact, C of (B1) [m/N]."""
        return np.asarray(span / self.EA + self.end_compliance + self.lift_off / self.arc_EA)


def laid_belt(
    EA: float,
    EI: float,
    T: Array,
    R: float,
    span: float,
    normal_law: tuple[float, float],
    bending: float = 1.0,
) -> LaidBelt:
    """Lay a belt on the pulley, without friction.

    Parameters
    ----------
    EA : float
        Axial stiffness [N].
    EI : float
        Bending stiffness [N m²].
    T : ndarray
        Tensions [N], shape (n,).
    R : float
        Radius of the belt's centreline on the pulley [m].
    span : float
        Length of a free span [m].
    normal_law : pair of float
        k_linear [N/m²] and k_quadratic [N/m³] of Eq. (3). Only the linear part acts at the ends
        of the contact.
    bending : float
        Factor on (B2) and (B3).
    """
    k, k_quadratic = normal_law
    b = np.sqrt(EI / T)
    p, soft = math.sqrt(EI / k), T / k
    c = np.sqrt(2.0 * p + soft)
    bent = b**3 - soft * (5.0 * c**2 - 5.0 * p - 2.0 * p**2 / c**2) / c
    raised = 2.0 * (b**4 - soft**2) / span
    arc_compliance = 1.0 / EA + 1.0 / (R**2 * stiffness_under(T / R, k, k_quadratic))
    return LaidBelt(
        EA=EA,
        arc_EA=1.0 / arc_compliance,
        lift_off=bending * (b - c - (b**2 - soft) / (2.0 * span)),
        end_compliance=bending * ((bent - raised) / (8.0 * R**2 * T)),
        rise=np.sqrt(soft),
    )
