"""The kernels of the rig once more, in plain numpy: the page to read beside the paper.

Only what is left out here is also left out of the equations: compiled loops, banded storage, kept
statuses and borders. Forces and tangents must be those of the kernels to rounding.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltid.laws.friction_surface import FrictionSurface
from beltid.params import Belt
from beltid.rig.forces import Motion, Points, Pulley
from beltid.rig.mesh import Mesh

Array = NDArray[np.float64]

J = np.array([[0.0, 1.0], [-1.0, 0.0]])  # a x b = a.J b; t = J n
I = np.eye(2)


def outer(a: Array, b: Array) -> Array:
    return np.asarray(a[..., :, None] * b[..., None, :])


def pairs(mesh: Mesh, q: Array) -> Array:
    """Positions and gradients at both nodes of the elements, shape (n_e, 4, 2)."""
    return q.reshape(-1, 2)[2 * np.arange(mesh.h.size)[:, None] + np.arange(4)]


def belt_forces(mesh: Mesh, belt: Belt, q: Array, s: float, old: Array, rate: float) -> Any:
    """Eqs. (9), (10): forces (n_e, 8), tangent, derivative in the stretch s, strains."""
    tau = belt.damping_time * rate
    a, c = mesh.D @ pairs(mesh, q), mesh.DD @ pairs(mesh, q)  # r', r''
    p = np.linalg.norm(a, axis=-1, keepdims=True)
    kappa = np.sum(a * (c @ J.T), -1, keepdims=True) / p**2  # (r' x r'')/|r'|^2
    strains = np.concatenate([p / s - 1.0, kappa / s], -1)
    stress = np.array([belt.EA, belt.EI]) * (strains + tau * (strains - old))
    N, M = np.split(stress, 2, -1)
    EA, EI = belt.EA * (1 + tau) / s, belt.EI * (1 + tau) / s
    e, k_a, k_b = a / p, (c @ J.T - 2 * kappa * a) / p**2, -(a @ J.T) / p**2
    by_eps, by_kappa = np.concatenate([e, 0 * e], -1), np.concatenate([k_a, k_b], -1)
    B = np.einsum("egdj,kl->egdkjl", np.stack([mesh.D, mesh.DD], 2), I)
    B = B.reshape(*mesh.D.shape[:2], 4, 8)  # from the coordinates to (r', r'')
    H = EA * outer(by_eps, by_eps) + EI * outer(by_kappa, by_kappa)
    f = N * by_eps + M * by_kappa
    f_s = -(EA * p * by_eps + EI * kappa * by_kappa) / s
    N, M, kappa, p = N[..., None], M[..., None], kappa[..., None], p[..., None]
    H[..., :2, :2] += N / p * (I - outer(e, e))
    H[..., :2, :2] -= 2 * M / p**2 * (kappa * I + outer(a, k_a) + outer(k_a, a))
    mixed = M / p**2 * (J - 2 * outer(a, k_b))
    H[..., :2, 2:] += mixed
    H[..., 2:, :2] += np.swapaxes(mixed, -1, -2)
    w = mesh.w_g
    return (
        np.einsum("eg,egdi,egd->ei", w, B, f),
        np.einsum("eg,egci,egcd,egdj->eij", w, B, H, B, optimize=True),
        np.einsum("eg,egdi,egd->ei", w, B, f_s),
        strains,
    )


def contact_forces(
    mesh: Mesh,
    pulley: Pulley,
    surface: FrictionSurface,
    motion: Motion,
    q: Array,
    s: float,
    last: Points,
    status: Points,
) -> Any:
    """Eqs. (1) to (4), (11): forces of the pulley (n_e, 8), their tangent, contact points."""
    r = mesh.N @ pairs(mesh, q)
    rho = np.linalg.norm(r, axis=-1)
    n = r / rho[..., None]
    t, theta, w = n @ J.T, np.arctan2(r[..., 0], r[..., 1]), mesh.w_c * s
    half = 0.5 * pulley.edge * mesh.w_c
    grows = np.clip((pulley.R - rho + half) / (2 * half), 0.0, 1.0)
    delta = np.where(grows < 1.0, grows**2 * half, pulley.R - rho)
    f = delta * (pulley.k_linear + pulley.k_quadratic * delta)
    slope = (pulley.k_linear + 2 * pulley.k_quadratic * delta) * grows
    F_N, k, slip, v = w * f, w * slope, 0 * f, motion.omega * pulley.R + 0 * f
    if motion.rate:
        damping = pulley.C_P * w * motion.rate * ((f > 0) & (rho < last["rho"]))
        F_N, k = F_N + damping * (last["rho"] - rho), k + damping
        slip = rho * (motion.omega / motion.rate - (theta - last["theta"]))
        v = np.abs(slip) * motion.rate * pulley.R / rho
    mu, (mu_f, mu_v) = surface.mu(f, v), surface.gradient(f, v)
    share = motion.share * np.where(last["sticks"], pulley.ratio, 1.0)
    trial, limit = last["F_T"] + pulley.k_t * mesh.w_c * slip, share * mu * F_N
    sticks = status["sticks"] & (f > 0) & (motion.rate > 0)
    sign = status["sign"]
    F_T = np.where(sticks, trial, sign * limit) * (f > 0)
    by_delta = sign * share * (mu * k + mu_f * F_N * slope)
    by_delta = np.where(sticks, -pulley.k_t * mesh.w_c * slip / rho, by_delta)
    by_slip = sign * share * mu_v * F_N * motion.rate * np.sign(slip) * pulley.R / rho
    by_slip = np.where(sticks, pulley.k_t * mesh.w_c, by_slip) * (f > 0)
    c = np.stack([k, F_N / rho, F_T / rho, by_delta, by_slip])[..., None, None]
    K = c[0] * outer(n, n) + (c[4] - c[1]) * outer(t, t) + c[2] * outer(n, t) + c[3] * outer(t, n)
    force = F_N[..., None] * n + F_T[..., None] * t
    f_q = -np.einsum("ecj,eck->ejk", mesh.N, force).reshape(-1, 8)
    K_q = np.einsum("eci,eckl,ecj->eikjl", mesh.N, K, mesh.N, optimize=True).reshape(-1, 8, 8)
    return f_q, K_q, f_q / s, {"F_N": F_N, "F_T": F_T, "theta": theta, "rho": rho, "slip": slip}


def assembled(mesh: Mesh, forces: list[Array], tangents: list[Array]) -> tuple[Array, Array]:
    """Sum over the elements: residual (n,) and tangent (n, n)."""
    n = 4 * mesh.h.size + 4
    dof = 4 * np.arange(mesh.h.size)[:, None] + np.arange(8)
    r, K = np.zeros(n), np.zeros((n, n))
    for f in forces:
        np.add.at(r, dof, f)
    for k in tangents:
        np.add.at(K, (dof[:, :, None], dof[:, None, :]), k)
    return r, K
