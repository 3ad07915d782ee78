"""Parametric friction laws mu(f, v), for codes that take a formula in place of a surface.

All are of the form ``mu = (f/f0)^(-a) sum_k c_k phi_k(v; v*)``, linear in the amplitudes c:

=================  ==============================================================================
coulomb            mu = mu0
power              mu = mu0 (f/f0)^(-a)
power_log          mu = mu0 (f/f0)^(-a) [1 + b ln(1 + v/v0)]
power_stribeck_1   mu = (f/f0)^(-a) [mu_k + (mu_s - mu_k) exp(-(v/v_s)^d) + c v], d = 1
power_stribeck_2   the same with d = 2
=================  ==============================================================================

f is the normal force per length of belt [N/m], v >= 0 the sliding speed [m/s], f0 a chosen
reference force [N/m].
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
FrictionLawName = Literal["coulomb", "power", "power_log", "power_stribeck_1", "power_stribeck_2"]
FRICTION_LAWS: tuple[FrictionLawName, ...] = (
    "coulomb",
    "power",
    "power_log",
    "power_stribeck_1",
    "power_stribeck_2",
)
PARAMETERS: Mapping[FrictionLawName, tuple[str, ...]] = {
    "coulomb": ("mu0",),
    "power": ("mu0", "a"),
    "power_log": ("mu0", "a", "b", "v0"),
    "power_stribeck_1": ("mu_s", "mu_k", "a", "v_s", "c"),
    "power_stribeck_2": ("mu_s", "mu_k", "a", "v_s", "c"),
}
UNITS: Mapping[str, str] = {"v0": "m/s", "v_s": "m/s", "c": "s/m"}
"""Units of the parameters that have one."""


@dataclass(frozen=True, slots=True)
class FrictionFormula:
    """A parametric friction law with its values.

    Parameters
    ----------
    law : str
        One of :data:`FRICTION_LAWS`.
    reference_force_N_m : float
        f0 [N/m].
    values : mapping of str to float
        Parameters by name, see :data:`PARAMETERS`.
    """

    law: FrictionLawName
    reference_force_N_m: float
    values: Mapping[str, float]

    def mu(self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike) -> Array:
        """Friction coefficient [-]; the sign of the speed does not matter.

        Parameters
        ----------
        normal_force_N_m : array_like
            Normal force per length of belt [N/m], > 0.
        slip_speed_m_s : array_like
            Sliding speed [m/s].
        """
        f = np.asarray(normal_force_N_m, dtype=float)
        v = np.abs(np.asarray(slip_speed_m_s, dtype=float))
        f, v = np.broadcast_arrays(f, v)
        p = self.values
        if self.law == "coulomb":
            return np.full(f.shape, p["mu0"])
        falling = (f / self.reference_force_N_m) ** -p["a"]
        if self.law == "power":
            return p["mu0"] * falling
        if self.law == "power_log":
            return p["mu0"] * falling * (1.0 + p["b"] * np.log1p(v / p["v0"]))
        fading = np.exp(-((v / p["v_s"]) ** stribeck_exponent(self.law)))
        return falling * (p["mu_k"] + (p["mu_s"] - p["mu_k"]) * fading + p["c"] * v)

    @property
    def text(self) -> str:
        """The law with its numbers, to be read or copied; f in N/m, v in m/s."""
        p = {name: f"{value:.6g}" for name, value in self.values.items()}
        if self.law == "coulomb":
            return f"mu = {p['mu0']}"
        falling = f"(f / {self.reference_force_N_m:g})^(-({p['a']}))"
        if self.law == "power":
            return f"mu = {p['mu0']} * {falling}"
        if self.law == "power_log":
            return f"mu = {p['mu0']} * {falling} * (1 + ({p['b']}) * ln(1 + v / {p['v0']}))"
        d = stribeck_exponent(self.law)
        fading = f"exp(-(v / {p['v_s']})^{d:g})"
        return (
            f"mu = {falling} * ({p['mu_k']} + ({p['mu_s']} - {p['mu_k']}) * {fading} "
            f"+ ({p['c']}) * v)"
        )


def stribeck_exponent(law: FrictionLawName) -> float:
    """Exponent d of a Stribeck law."""
    return 2.0 if law == "power_stribeck_2" else 1.0


def has_force_exponent(law: FrictionLawName) -> bool:
    """Whether mu depends on the force."""
    return law != "coulomb"


def has_speed_scale(law: FrictionLawName) -> bool:
    """Whether the law has a characteristic speed, v0 or v_s."""
    return law not in ("coulomb", "power")


def speed_terms(law: FrictionLawName, v: Array, log_scale: float) -> tuple[Array, Array]:
    """Terms phi_k(v) of a law, and their derivatives by the logarithm of the speed scale.

    Parameters
    ----------
    law : str
        The law.
    v : ndarray
        Sliding speeds [m/s], shape (n,).
    log_scale : float
        ln v0 or ln v_s; not used by laws without a scale.

    Returns
    -------
    terms, derivatives : ndarray, shape (n, m)
        The amplitudes that belong to them are mu0 and mu0 b of the logarithmic law, and mu_s,
        mu_k and c of the Stribeck laws.
    """
    one, zero = np.ones_like(v), np.zeros_like(v)
    if not has_speed_scale(law):
        return one[:, None], zero[:, None]
    ratio = v / np.exp(log_scale)
    if law == "power_log":
        return (
            np.column_stack([one, np.log1p(ratio)]),
            np.column_stack([zero, -ratio / (1.0 + ratio)]),
        )
    d = stribeck_exponent(law)
    power = ratio**d
    fading = np.exp(-power)
    by_scale = d * power * fading
    return (
        np.column_stack([fading, 1.0 - fading, v]),
        np.column_stack([by_scale, -by_scale, zero]),
    )
