# ruff: noqa: D102 (the overridden methods are documented in Coulomb)
"""Parametric friction laws mu(f, v), for codes that take a formula in place of a surface.

=======================  =========================================================================
:class:`Coulomb`         mu = mu0
:class:`Power`           mu = mu0 (f/f0)^(-a)
:class:`PowerLog`        mu = mu0 (f/f0)^(-a) [1 + b ln(1 + v/v0)]
:class:`PowerStribeck`   mu = (f/f0)^(-a) [mu_k + (mu_s - mu_k) exp(-(v/v_s)^d) + c v], d = 1 or 2
=======================  =========================================================================

f is the normal force per length of belt [N/m], v >= 0 the sliding speed [m/s], and f0 a chosen
reference force [N/m]. For a given exponent a and speed scale (v0 or v_s), every law is linear in
amplitudes c: ``mu = (f/f0)^(-a) sum_k c_k phi_k(v)`` with the terms phi_k of the law.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class Coulomb:
    """A constant coefficient; base class of all laws.

    Attributes
    ----------
    name : str
        Name of the law.
    units : dict of str to str
        Units by parameter, in order; empty for a dimensionless parameter.
    scale : str
        Name of the parameter that is a speed scale; empty if there is none.
    reach : float
        Factor by which the search range of the scale extends beyond the measured speeds each way.
    speeds_needed : int
        Least number of speeds that determines the dependence on speed.
    open_below, open_above : tuple of str
        Parameters that are undetermined if the speed scale may lie far below or above all speeds.
    """

    name: str = "coulomb"
    units: ClassVar[Mapping[str, str]] = {"mu0": ""}
    scale: str = ""
    reach: float = 1.0
    speeds_needed: int = 1
    open_below: tuple[str, ...] = ()
    open_above: tuple[str, ...] = ()

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters in order."""
        return tuple(self.units)

    def terms(self, v: Array, scale: float) -> Array:
        """Evaluate the terms phi_k at speeds v [m/s] for a speed scale [m/s], shape (n, m)."""
        return np.ones((v.size, 1))

    def from_amplitudes(self, c: Array, a: float, scale: float) -> Array:
        """Convert amplitudes c, exponent a and speed scale [m/s] to the parameters of the law."""
        return np.array([c[0]])

    def mu(self, p: Sequence[float] | Array, f: Array, v: Array) -> Array:
        """Evaluate mu [-] with parameters p at forces f [in f0] and speeds v [m/s]."""
        return np.full(np.broadcast(f, v).shape, p[0])

    def gradient(self, p: Sequence[float] | Array, f: Array, v: Array) -> Array:
        """Differentiate mu with respect to the parameters, shape (n, p)."""
        return np.ones((v.size, 1))

    def text(self, p: Sequence[str], f0: str) -> str:
        """Format the law with its numbers; f in N/m, v in m/s."""
        return f"mu = {p[0]}"


class Power(Coulomb):
    """A coefficient that decreases with a power of the force."""

    name = "power"
    units: ClassVar[Mapping[str, str]] = {"mu0": "", "a": ""}

    def from_amplitudes(self, c: Array, a: float, scale: float) -> Array:
        return np.array([c[0], a])

    def mu(self, p: Sequence[float] | Array, f: Array, v: Array) -> Array:
        return p[0] * f ** -p[1] * np.ones_like(v)

    def gradient(self, p: Sequence[float] | Array, f: Array, v: Array) -> Array:
        force_power = f ** -p[1]
        return np.column_stack([force_power, -np.log(f) * p[0] * force_power])

    def text(self, p: Sequence[str], f0: str) -> str:
        return f"mu = {p[0]} * (f / {f0})^(-({p[1]}))"


class PowerLog(Coulomb):
    """A power of the force and a logarithm of the speed above a scale v0."""

    name = "power_log"
    units: ClassVar[Mapping[str, str]] = {"mu0": "", "a": "", "b": "", "v0": "m/s"}
    scale = "v0"
    reach = 1.0e3
    speeds_needed = 3
    open_below = ("v0", "mu0", "b")
    open_above = ("v0", "b")

    def terms(self, v: Array, scale: float) -> Array:
        return np.column_stack([np.ones_like(v), np.log1p(v / scale)])

    def from_amplitudes(self, c: Array, a: float, scale: float) -> Array:
        return np.array([c[0], a, c[1] / c[0], scale])

    def mu(self, p: Sequence[float] | Array, f: Array, v: Array) -> Array:
        return p[0] * f ** -p[1] * (1.0 + p[2] * np.log1p(v / p[3]))

    def gradient(self, p: Sequence[float] | Array, f: Array, v: Array) -> Array:
        mu0, a, b, v0 = p
        force_power, log = f**-a, np.log1p(v / v0)
        speed_factor = 1.0 + b * log
        by_scale = -b * v / (v0 * (v0 + v))
        columns = [speed_factor, -np.log(f) * mu0 * speed_factor, mu0 * log, mu0 * by_scale]
        return force_power[:, None] * np.column_stack(columns)

    def text(self, p: Sequence[str], f0: str) -> str:
        mu0, a, b, v0 = p
        return f"mu = {mu0} * (f / {f0})^(-({a})) * (1 + ({b}) * ln(1 + v / {v0}))"


class PowerStribeck(Coulomb):
    """A power of the force and a Stribeck curve of the speed with exponent d."""

    units: ClassVar[Mapping[str, str]] = {"mu_s": "", "mu_k": "", "a": "", "v_s": "m/s", "c": "s/m"}
    scale = "v_s"
    reach = 10.0
    speeds_needed = 4
    open_below = ("v_s", "mu_s")
    open_above = ("v_s", "mu_k", "c")

    def __init__(self, d: int) -> None:
        self.d, self.name = d, f"power_stribeck_{d}"

    def terms(self, v: Array, scale: float) -> Array:
        decay = np.exp(-((v / scale) ** self.d))
        return np.column_stack([decay, 1.0 - decay, v])

    def from_amplitudes(self, c: Array, a: float, scale: float) -> Array:
        return np.array([c[0], c[1], a, scale, c[2]])

    def mu(self, p: Sequence[float] | Array, f: Array, v: Array) -> Array:
        mu_s, mu_k, a, v_s, c = p
        return f**-a * (mu_k + (mu_s - mu_k) * np.exp(-((v / v_s) ** self.d)) + c * v)

    def gradient(self, p: Sequence[float] | Array, f: Array, v: Array) -> Array:
        mu_s, mu_k, a, v_s, _ = p
        power = (v / v_s) ** self.d
        decay = np.exp(-power)
        by_scale = (mu_s - mu_k) * decay * self.d * power / v_s
        by_a = -np.log(f) * self.mu(p, np.ones_like(f), v)
        columns = [decay, 1.0 - decay, by_a, by_scale, v]
        return (f**-a)[:, None] * np.column_stack(columns)

    def text(self, p: Sequence[str], f0: str) -> str:
        mu_s, mu_k, a, v_s, c = p
        return (
            f"mu = (f / {f0})^(-({a})) * ({mu_k} + ({mu_s} - {mu_k}) * exp(-(v / {v_s})^{self.d}) "
            f"+ ({c}) * v)"
        )


FRICTION_LAWS: Final[Mapping[str, Coulomb]] = {
    law.name: law for law in (Coulomb(), Power(), PowerLog(), PowerStribeck(1), PowerStribeck(2))
}
"""All laws by name, in order of increasing complexity."""


@dataclass(frozen=True, slots=True)
class FrictionFormula:
    """A parametric friction law with the values of its parameters.

    Parameters
    ----------
    law : str
        One of :data:`FRICTION_LAWS`.
    reference_force_N_m : float
        f0 [N/m].
    values : mapping of str to float
        Parameters by name.
    """

    law: str
    reference_force_N_m: float
    values: Mapping[str, float]

    def mu(self, normal_force_N_m: ArrayLike, slip_speed_m_s: ArrayLike) -> Array:
        """Evaluate mu [-] at forces per length [N/m] > 0 and speeds of either sign."""
        f = np.asarray(normal_force_N_m, dtype=float) / self.reference_force_N_m
        v = np.abs(np.asarray(slip_speed_m_s, dtype=float))
        law = FRICTION_LAWS[self.law]
        return law.mu([self.values[name] for name in law.parameters], *np.broadcast_arrays(f, v))

    @property
    def text(self) -> str:
        """The law with its numbers as plain text; f in N/m, v in m/s."""
        law = FRICTION_LAWS[self.law]
        values = [f"{self.values[name]:.6g}" for name in law.parameters]
        return law.text(values, f"{self.reference_force_N_m:g}")
