"""Parametric friction laws mu(f, v), for codes that take a formula in place of a surface.

===================  =========================================================================
coulomb              mu = mu0
power                mu = mu0 (f/f0)^(-a)
power_log            mu = mu0 (f/f0)^(-a) [1 + b ln(1 + v/v0)]
power_stribeck_d     mu = (f/f0)^(-a) [mu_k + (mu_s - mu_k) exp(-(v/v_s)^d) + c v], d = 1 or 2
===================  =========================================================================

f is the normal force per length of belt [N/m], v >= 0 the sliding speed [m/s], and f0 a chosen
reference force [N/m]. For a given exponent a and speed scale (v0 or v_s), every law is linear in
amplitudes c: ``mu = (f/f0)^(-a) sum_k c_k phi_k(v)`` with the terms phi_k of the law.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from beltid.arrays import Array

COMPLEX_STEP = 1e-30  # nothing is subtracted, so the derivative is exact to rounding


@dataclass(frozen=True, slots=True)
class FrictionLaw:
    """A law ``mu = (f/f0)^(-a) sum_k c_k phi_k(v)`` without the values of its parameters."""

    name: str
    parameters: Mapping[str, str]  # in order -> unit; empty for a dimensionless one
    pattern: str  # the law as text, with the names of its parameters and f0 in braces
    phi: Callable[..., Sequence[Any]]  # terms at speeds v and a speed scale, both [m/s]
    amplitudes: tuple[str, ...] = ("mu0",)  # parameters c_k
    relative: bool = False  # whether all amplitudes but the first are given in units of the first
    scale: str = ""  # parameter that is a speed scale, if there is one
    speeds_needed: int = 1  # least number of speeds that determines the dependence on speed

    def terms(self, v: Array, scale: float) -> Array:
        """Evaluate the terms phi_k at speeds v [m/s] for a speed scale [m/s], shape (n, m)."""
        return np.column_stack([phi_k + 0.0 * v for phi_k in self.phi(v, scale)])

    def from_amplitudes(self, c: Array, a: float, scale: float) -> Array:
        """Convert amplitudes c, exponent a and speed scale [m/s] to the parameters of the law."""
        values = {"a": a, self.scale: scale, **dict(zip(self.amplitudes, c, strict=True))}
        if self.relative:
            values |= {name: values[name] / c[0] for name in self.amplitudes[1:]}
        return np.array([values[name] for name in self.parameters])

    def mu(self, p: Sequence[float] | Array, f: Array, v: Array) -> Array:
        """Evaluate mu [-] with parameters p at forces f [in f0] and speeds v [m/s]."""
        at = dict(zip(self.parameters, p, strict=True))
        first, *others = (at[name] for name in self.amplitudes)
        c = [first, *(first * c_k if self.relative else c_k for c_k in others)]
        terms = self.phi(v, at.get(self.scale, 1.0))
        total = sum(c_k * phi_k for c_k, phi_k in zip(c, terms, strict=True))
        return np.asarray(f ** -at.get("a", 0.0) * total + 0.0 * v)

    def gradient(self, p: Sequence[float] | Array, f: Array, v: Array) -> Array:
        """Differentiate mu with respect to the parameters, shape (n, p)."""
        steps = 1j * COMPLEX_STEP * np.eye(len(p))
        return np.column_stack([self.mu(p + step, f, v).imag / COMPLEX_STEP for step in steps])

    def text(self, p: Sequence[float] | Array, f0: float) -> str:
        """Write the law with parameters p and a reference force f0 [N/m]; f in N/m, v in m/s."""
        values = {name: f"{x:.6g}" for name, x in zip(self.parameters, p, strict=True)}
        return self.pattern.format(f0=f"{f0:g}", **values)


def _stribeck(d: int) -> FrictionLaw:
    def phi(v: Array, scale: float) -> tuple[Array, Array, Array]:
        decay = np.exp(-((v / scale) ** d))
        return decay, 1.0 - decay, v

    return FrictionLaw(
        name=f"power_stribeck_{d}",
        parameters={"mu_s": "", "mu_k": "", "a": "", "v_s": "m/s", "c": "s/m"},
        pattern="mu = (f / {f0})^(-({a})) * "
        f"({{mu_k}} + ({{mu_s}} - {{mu_k}}) * exp(-(v / {{v_s}})^{d}) + ({{c}}) * v)",
        phi=phi,
        amplitudes=("mu_s", "mu_k", "c"),
        scale="v_s",
        speeds_needed=4,
    )


_LAWS = (
    FrictionLaw("coulomb", {"mu0": ""}, "mu = {mu0}", lambda v, scale: [1.0]),
    FrictionLaw(
        "power", {"mu0": "", "a": ""}, "mu = {mu0} * (f / {f0})^(-({a}))", lambda v, scale: [1.0]
    ),
    FrictionLaw(
        name="power_log",
        parameters={"mu0": "", "a": "", "b": "", "v0": "m/s"},
        pattern="mu = {mu0} * (f / {f0})^(-({a})) * (1 + ({b}) * ln(1 + v / {v0}))",
        phi=lambda v, scale: [1.0, np.log1p(v / scale)],
        amplitudes=("mu0", "b"),
        relative=True,
        scale="v0",
        speeds_needed=3,
    ),
    _stribeck(1),
    _stribeck(2),
)
# by name, in order of increasing complexity
FRICTION_LAWS: Mapping[str, FrictionLaw] = {law.name: law for law in _LAWS}
