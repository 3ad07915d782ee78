"""Points of a friction surface as the parametric laws are fitted to them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError

Array = NDArray[np.float64]

SPEED_GAP = 0.03
"""Speeds closer than this share are one setting."""
FORCE_SPREAD = 0.05
"""Forces within this share of each other do not tell how mu depends on the force."""
FEWEST = 2


@dataclass(frozen=True, slots=True, eq=False)
class FrictionPoints:
    """Usable points, ordered by speed setting and force.

    Attributes
    ----------
    f, v, mu, se : ndarray
        Force [N/m], speed [m/s], friction coefficient and standard error (weights) [-], (n,).
    setting : ndarray of int
        Number of the speed setting of each point, shape (n,).
    errors_known : bool
        Whether the standard errors are those of the points, or made up to weigh them alike.
    notes : tuple of str
        What was left out or made up.
    """

    f: Array
    v: Array
    mu: Array
    se: Array
    setting: NDArray[np.intp]
    errors_known: bool
    notes: tuple[str, ...]

    @property
    def n_speeds(self) -> int:
        """Number of speed settings."""
        return int(self.setting.max()) + 1

    @property
    def forces_differ(self) -> bool:
        """Whether the forces spread enough to tell their influence."""
        return bool(self.f.max() > (1.0 + FORCE_SPREAD) * self.f.min())

    def along_force(self, values: Array) -> list[Array]:
        """Values of the points of each speed, by rising force."""
        return [values[self.setting == k] for k in range(self.n_speeds)]

    def exponent(self) -> float:
        """Slope of -ln mu over ln f, common to all speeds, by regression within them."""
        over = under = 0.0
        for k in range(self.n_speeds):
            mine = self.setting == k
            w = (self.mu[mine] / self.se[mine]) ** 2
            x, y = np.log(self.f[mine]), np.log(self.mu[mine])
            x, y = x - np.average(x, weights=w), y - np.average(y, weights=w)
            over, under = over + float(w @ (x * y)), under + float(w @ (x * x))
        return -over / under if under > 0.0 else 0.0


def friction_points(
    f: ArrayLike, v: ArrayLike, mu: ArrayLike, mu_se: ArrayLike | None
) -> FrictionPoints:
    """Check the points and put them in order.

    Raises
    ------
    InputError
        If arrays differ in length or too few points can be used.
    """
    named = {"normal_force_N_m": f, "slip_speed_m_s": v, "mu": mu}
    arrays = {name: np.asarray(value, dtype=float).ravel() for name, value in named.items()}
    n = arrays["mu"].size
    se = np.full(n, np.nan) if mu_se is None else np.asarray(mu_se, dtype=float).ravel()
    problems = [
        f"{name}: {a.size} values, must be {n} as many as mu"
        for name, a in {**arrays, "mu_se": se}.items()
        if a.size != n
    ]
    if problems:
        raise InputError(problems)
    arrays["slip_speed_m_s"] = np.abs(arrays["slip_speed_m_s"])
    good = np.all([np.isfinite(a) & (a > 0.0) for a in arrays.values()], axis=0)
    notes = []
    if not good.all():
        notes.append(f"{int((~good).sum())} of {n} points left out: force, speed, mu must be > 0")
    if int(good.sum()) < FEWEST:
        raise InputError(
            f"friction laws: {int(good.sum())} usable points of {n}, must be at least {FEWEST}"
        )
    force, speed, coefficient = (a[good] for a in arrays.values())
    se, errors_known, more = _weights(se[good], coefficient)
    setting = _settings(speed)
    order = np.lexsort((force, setting))
    return FrictionPoints(
        f=force[order],
        v=speed[order],
        mu=coefficient[order],
        se=se[order],
        setting=setting[order],
        errors_known=errors_known,
        notes=(*notes, *more),
    )


def _weights(se: Array, mu: Array) -> tuple[Array, bool, list[str]]:
    """Standard errors without gaps, and whether they mean something."""
    known = np.isfinite(se) & (se > 0.0)
    if not known.any():
        return mu.copy(), False, ["no standard errors of mu: points have equal relative weight"]
    if known.all():
        return se, True, []
    typical = float(np.median(se[known] / mu[known]))
    note = f"{int((~known).sum())} points without a standard error: {100 * typical:.2g} % taken"
    return np.where(known, se, typical * mu), True, [note]


def _settings(speed: Array) -> NDArray[np.intp]:
    """Number of the speed setting of each point, rising with the speed."""
    order = np.argsort(speed, kind="stable")
    steps = np.diff(speed[order]) > SPEED_GAP * speed[order][:-1]
    numbers = np.concatenate([[0], np.cumsum(steps)])
    found = np.empty(speed.size, dtype=np.intp)
    found[order] = numbers
    return found
