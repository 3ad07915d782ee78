"""The belt: internal and inertia forces of a planar ANCF cable element, Eqs. (9) and (10).

Coordinates are ordered node by node: position r and gradient r' = dr/ds over the path coordinate s.
A section has the axial strain ``eps = |r'|/stretch - 1`` and the curvature ``kappa = (r' x r'') /
(|r'|**2 stretch)`` per stress-free length, which is ``stretch`` times the path coordinate.
"""

from __future__ import annotations

import math

import numpy as np

from beltid.params import Belt
from beltid.rig.banded import HALF, kernel
from beltid.rig.mesh import Mesh
from beltid.rig.state import Motion, State


@kernel
def section_force(
    stiffness: float, strain: float, strain_rate: float, damping_time: float
) -> float:
    """Integrate ``sigma = E eps + c d(eps)/dt`` over the section: axial force or moment, Eq. (9).

    EA [N] goes with the strain [-], EI [N m²] with the curvature [1/m]; the damping time is c/E
    [s]. The rate may be per time step if this is in time steps, too.
    """
    return stiffness * (strain + damping_time * strain_rate)


@kernel
def add_belt(mesh: Mesh, belt: Belt, motion: Motion, s: State) -> None:
    """Add the internal forces of the belt, their tangent and their derivative in the stretch."""
    q, stretch, old, r, r_s = s.q, s.u[0], s.strains_old, s.r, s.columns[0]
    tau = belt.damping_time * motion.rate  # time in units of the step
    momentum = belt.rhoA * motion.v0**2  # its flux lowers the axial force of a flowing belt
    # strain and strain increment grow together within a step: the law at 1 for both is its slope
    EA = (section_force(belt.EA, 1.0, 1.0, tau) - momentum) / stretch
    EI = section_force(belt.EI, 1.0, 1.0, tau) / stretch
    a, e, k = np.zeros(2), np.zeros(4), np.zeros(4)
    H, G = np.zeros((4, 4)), np.zeros((4, 8))
    for el in range(mesh.h.size):
        for g in range(mesh.w_g.shape[1]):
            D, DD = mesh.D[el, g], mesh.DD[el, g]
            ax = ay = bx = by = 0.0  # r' and r''
            for j in range(4):
                x, y = q[4 * el + 2 * j], q[4 * el + 2 * j + 1]
                ax, ay, bx, by = ax + D[j] * x, ay + D[j] * y, bx + DD[j] * x, by + DD[j] * y
            p2 = ax * ax + ay * ay
            p = math.sqrt(p2)
            curl = (ax * by - ay * bx) / p2
            eps, kappa = p / stretch - 1.0, curl / stretch
            s.strains[el, g, 0], s.strains[el, g, 1] = eps, kappa
            N = section_force(belt.EA, eps, eps - old[el, g, 0], tau)
            N -= momentum * (1.0 + eps)
            M = section_force(belt.EI, kappa, kappa - old[el, g, 1], tau)
            # gradients of |r'| and of (r' x r'')/|r'|**2 in (r', r'')
            a[0], a[1], e[0], e[1] = ax, ay, ax / p, ay / p
            k[0], k[1] = (by - 2 * curl * ax) / p2, (-bx - 2 * curl * ay) / p2
            k[2], k[3] = -ay / p2, ax / p2
            for i in range(4):  # material part of the tangent, then the geometric one
                for j in range(4):
                    H[i, j] = EA * e[i] * e[j] + EI * k[i] * k[j]
            for i in range(2):
                for j in range(2):
                    unit = 1.0 if i == j else 0.0
                    H[i, j] += N / p * (unit - e[i] * e[j])
                    H[i, j] -= 2 * M / p2 * (curl * unit + a[i] * k[j] + k[i] * a[j])
                    mixed = M / p2 * (j - i - 2 * a[i] * k[2 + j])
                    H[i, 2 + j] += mixed
                    H[2 + j, i] += mixed
            for i in range(4):  # from (r', r'') to the coordinates of the element
                for m in range(4):
                    G[i, 2 * m] = H[i, 0] * D[m] + H[i, 2] * DD[m]
                    G[i, 2 * m + 1] = H[i, 1] * D[m] + H[i, 3] * DD[m]
            for j in range(4):
                d, dd = mesh.w_g[el, g] * D[j], mesh.w_g[el, g] * DD[j]
                for i in range(2):
                    row = 4 * el + 2 * j + i
                    by_kappa = d * k[i] + dd * k[2 + i]
                    r[row] += N * d * e[i] + M * by_kappa
                    r_s[row] -= (EA * p * d * e[i] + EI * curl * by_kappa) / stretch
                    at = HALF - 2 * j - i
                    for c in range(8):
                        s.A[row, at + c] += d * G[i, c] + dd * G[2 + i, c]


@kernel
def add_inertia(mesh: Mesh, belt: Belt, s: State, rate: float) -> None:
    """Add ``M dq / dt**2``, Eq. (10), for the deviation ``s.dq`` from uniform motion [m]."""
    for el in range(mesh.h.size):
        for j in range(4):
            for m in range(4):
                mass = s.u[0] * belt.rhoA * mesh.M[el, j, m] * rate * rate
                for x in range(2):
                    row = 4 * el + 2 * j + x
                    s.A[row, HALF + 2 * (m - j)] += mass
                    s.r[row] += mass * s.dq[4 * el + 2 * m + x]
