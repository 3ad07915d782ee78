"""Errors of the press in the coefficients of the contact law, Eq. (3).

With a force gain e_F, a travel gain e_x and a segment length e_L that are wrong by a share,

    k_linear -> k_linear (1 + e_F) / ((1 + e_L) (1 + e_x)),
    k_quadratic -> k_quadratic (1 + e_F) / ((1 + e_L) (1 + e_x)²).

A compliance of the machine that is wrong by c moves a point of force f per length by c L f along
the travel. The law is fitted with a free contact point, so that the change of its coefficients is
the projection of f'(delta) c L f on (delta, delta², f'(delta)) over the range of the fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.laws.penalty import NormalLaw
from beltid.uncertainty.sources import Errors

Array = NDArray[np.float64]

POINTS = 200


@dataclass(frozen=True, slots=True)
class PressLaw:
    """A contact law with what is known of its making.

    Attributes
    ----------
    law : NormalLaw
        The law.
    covariance : ndarray, shape (2, 2)
        Covariance of (k_linear, k_quadratic) by the scatter of the press; zero if not known.
    max_penetration_m : float
        Deepest penetration of the fit [m].
    segment_length_m : float
        Length of belt under the press [m].
    """

    law: NormalLaw
    covariance: Array
    max_penetration_m: float
    segment_length_m: float

    @property
    def has_scatter(self) -> bool:
        """Whether the covariance is known."""
        return bool(np.any(self.covariance != 0.0))

    def coefficients(self, errors: Errors) -> Array:
        """Coefficients (2,) with errors put right; one that would be negative is zero."""
        k = np.array([self.law.k_linear_N_m2, self.law.k_quadratic_N_m3])
        k = k + self._scatter_factor() @ [errors.at("law", 0), errors.at("law", 1)]
        k = k + self._per_compliance() * errors.at("machine_compliance")
        force = (1.0 + errors.at("press_force")) / (1.0 + errors.at("segment_length"))
        travel = 1.0 + errors.at("press_displacement")
        corrected = k * force / np.array([travel, travel**2])
        return np.asarray(np.maximum(corrected, 0.0))

    def corrected(self, errors: Errors) -> NormalLaw:
        """The law with errors put right."""
        return NormalLaw(*self.coefficients(errors).tolist())

    def _scatter_factor(self) -> Array:
        """Matrix S (2, 2) with S S' the covariance; one that is not positive counts as such."""
        # by the correlations: both coefficients are of very different size
        scale = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        safe = np.where(scale > 0.0, scale, 1.0)
        values, vectors = np.linalg.eigh(self.covariance / np.outer(safe, safe))
        return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))

    def _per_compliance(self) -> Array:
        """Change of the coefficients (2,) per compliance [m/N] put right."""
        delta = self.max_penetration_m * np.linspace(0.0, 1.0, POINTS)[1:]
        slope, force = self.law.stiffness(delta), self.law.force(delta)
        present = np.array([self.law.k_linear_N_m2 > 0.0, self.law.k_quadratic_N_m3 > 0.0])
        design = np.column_stack([np.column_stack([delta, delta**2])[:, present], slope])
        size = np.linalg.norm(design, axis=0)
        moved = slope * self.segment_length_m * force
        found = np.linalg.lstsq(design / size, moved, rcond=None)[0] / size
        change = np.zeros(2)
        change[present] = found[:-1]  # the last one moves the contact point
        return change
