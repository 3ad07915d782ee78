"""A friction surface with its uncertainty: combined uncertainty and band.

The errors of ln mu at the nodes are correlated: an error of a load cell moves the whole surface. A
standard error per node is therefore not enough. The surface has a factor S of the covariance
``S S'`` of all nodes, with one column for each shared source and more columns for the scatter. Any
later use (a simulation, a band in a figure) follows from S.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from beltid.errors import InputError
from beltid.laws.friction_surface import FrictionSurface

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class UncertainSurface(FrictionSurface):
    """Friction surface with the covariance of its nodes.

    Parameters
    ----------
    surface : FrictionSurface
        The surface with the standard errors of its nodes.
    factor : array_like (nf, nv, r), optional
        Factor of the covariance of ln mu at the nodes. Without it, the only uncertainty is the
        standard error of each node.
    sources : sequence of str
        Names of the first columns of the factor, which are errors common to all nodes. The other
        columns are scatter.

    Raises
    ------
    InputError
        If shapes do not match.
    """

    factor: Array | None
    sources: tuple[str, ...]

    def __init__(
        self,
        surface: FrictionSurface,
        factor: ArrayLike | None = None,
        sources: Sequence[str] = (),
    ) -> None:
        FrictionSurface.__init__(self, *surface._given)
        S = None if factor is None else np.array(factor, dtype=float)
        shape = surface.mu_nodes.shape
        if S is not None:
            if S.shape[:2] != shape or S.ndim != 3 or S.shape[2] < len(sources):
                raise InputError(f"factor: shape {S.shape}, must be {(*shape, '>= sources')}")
            S.flags.writeable = False
        object.__setattr__(self, "factor", S)
        object.__setattr__(self, "sources", tuple(sources))

    def mu_se(self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike) -> Array:
        """Return the standard error of mu from scatter alone [-]; see :meth:`mu_se_at`."""
        return self.mu_se_at(normal_force_N_m, slip_speed_m_s)

    def mu_u(self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike) -> Array:
        """Compute the combined standard uncertainty of mu [-]: scatter and shared errors (k = 1).

        Outside the range it is that of the nearest node, like mu itself.
        """
        if self.factor is None:
            return self.mu_se_at(normal_force_N_m, slip_speed_m_s)
        rows = self.factor_at(normal_force_N_m, slip_speed_m_s)
        mu = self.mu(normal_force_N_m, slip_speed_m_s)
        return np.asarray(mu * np.sqrt(np.sum(np.square(rows), axis=-1)))[()]

    def factor_at(self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike) -> Array:
        """Interpolate the rows of the factor of ln mu bilinearly between nodes, shape (..., r).

        The covariance of two points is the product of their rows, ``cov = row_1 . row_2``.

        Raises
        ------
        InputError
            If the surface has no factor.
        """
        if self.factor is None:
            raise InputError("the surface has no covariance: it was built without uncertainties")
        return self._bilinear(self.factor, normal_force_N_m, slip_speed_m_s)

    def band(
        self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike, level: float = 0.95
    ) -> tuple[Array, Array]:
        """Compute the limits of mu [-] that cover the truth with a probability of `level`.

        Based on the combined standard uncertainty of ln mu, so that the lower limit is positive.

        Raises
        ------
        InputError
            If the level is not in (0, 1).
        """
        if not 0.0 < level < 1.0:
            raise InputError(f"level = {level!r}, must be in (0, 1)")
        mu = self.mu(normal_force_N_m, slip_speed_m_s)
        k = float(ndtri(0.5 + 0.5 * level))
        width = np.exp(k * self.mu_u(normal_force_N_m, slip_speed_m_s) / mu)
        return np.asarray(mu / width)[()], np.asarray(mu * width)[()]

    def __reduce__(self) -> tuple[Any, ...]:
        plain = FrictionSurface(*self._given)
        return type(self), (plain, self.factor, self.sources)
