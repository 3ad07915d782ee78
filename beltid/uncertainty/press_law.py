"""Errors of the press in the coefficients of the contact law, Eq. (3).

With relative errors e_F of the force gain, e_x of the travel gain, e_L of the segment length and
e_k of the law in service (rubber that the press never unloaded, another rate, another specimen),

    k_linear -> k_linear (1 + e_k) (1 + e_F) / ((1 + e_L) (1 + e_x)),
    k_quadratic -> k_quadratic (1 + e_k) (1 + e_F) / ((1 + e_L) (1 + e_x)²).

An error c of the machine compliance moves a point of force f per length by c L f along the travel.
The law is fitted with a free contact point, so the change of its coefficients is the projection of
f'(delta) c L f on (delta, delta², f'(delta)) over the range of the fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.laws.penalty import NormalLaw
from beltid.mixed import root
from beltid.uncertainty.sources import Errors

Array = NDArray[np.float64]

POINTS = 200


@dataclass(frozen=True, slots=True)
class PressLaw:
    """A contact law with covariance and range of its fit."""

    law: NormalLaw  # the law
    covariance: Array
    """Covariance of (k_linear, k_quadratic) by the scatter of the press; zero if not known, (2,
    2)."""
    max_penetration_m: float  # deepest penetration of the fit [m]
    segment_length_m: float  # length of belt under the press [m]

    @property
    def has_scatter(self) -> bool:
        """Whether the covariance is known."""
        return bool(np.any(self.covariance != 0.0))

    def coefficients(self, errors: Errors) -> Array:
        """Return the coefficients (2,) with errors corrected; negative ones become zero."""
        k = np.array([self.law.k_linear_N_m2, self.law.k_quadratic_N_m3])
        k = k + root(self.covariance) @ [errors.at("law", 0), errors.at("law", 1)]
        k = k + self._per_compliance() * errors.at("machine_compliance")
        force = (1.0 + errors.at("press_force")) * (1.0 + errors.at("press_law"))
        force = force / (1.0 + errors.at("segment_length"))
        travel = 1.0 + errors.at("press_displacement")
        corrected = k * force / np.array([travel, travel**2])
        return np.asarray(np.maximum(corrected, 0.0))

    def corrected(self, errors: Errors) -> NormalLaw:
        """Return the law with errors corrected."""
        return NormalLaw(*self.coefficients(errors).tolist())

    def _per_compliance(self) -> Array:
        """Return the change of the coefficients (2,) per corrected compliance [m/N]."""
        delta = self.max_penetration_m * np.linspace(0.0, 1.0, POINTS)[1:]
        slope, force = self.law.stiffness(delta), self.law.force(delta)
        present = np.array([self.law.k_linear_N_m2 > 0.0, self.law.k_quadratic_N_m3 > 0.0])
        design = np.column_stack([np.column_stack([delta, delta**2])[:, present], slope])
        size = np.linalg.norm(design, axis=0)
        force_change = slope * self.segment_length_m * force
        solution = np.linalg.lstsq(design / size, force_change, rcond=None)[0] / size
        change = np.zeros(2)
        change[present] = solution[:-1]  # the last one moves the contact point
        return change
