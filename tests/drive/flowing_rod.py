"""A belt that runs over one pulley, solved as a boundary-value problem that shares nothing.

Six unknown functions of the stress-free length (place, direction, effective force, shear force,
curvature), the box scheme of second order on a fine mesh, Newton's method on the sparse matrix.
Friction is smoothed, ``mu f g/sqrt(g² + smooth²)`` with the slip ``g`` over ``v0``; the smoothing
is lowered step by step.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]

EA, EI, MASS = 1.0e5, 0.02, 0.1
K_LINEAR, K_QUADRATIC = 6.5e7, 3.0256e11
MU, SPAN, WRAP = 0.5, 0.10, math.pi
FINE, COARSE = 4.0e-5, 2.0e-4  # steps near the ends of the contact and elsewhere [m]
SIZES = np.array([0.1, 0.1, 1.0, 300.0, 100.0, 20.0])  # of the functions
SMOOTHINGS = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6)


class Smoothed(NamedTuple):
    """Speed of the pulley over v0 [1/m] and torque on the belt [N m] with a smoothing [-]."""

    smooth: float
    W: float
    torque: float


def derivatives(y: Array, length: float, W: float, R: float, flow: float, smooth: float) -> Array:
    """Derivatives (6, n) of x, y, direction, P, Q and curvature by the share of the length."""
    x, height, direction, P, Q, curvature = y
    stretch = (EA + P) / (EA - flow)
    rho = np.hypot(x, height)
    n_x, n_y = x / rho, height / rho
    delta = np.maximum(R - rho, 0.0)
    f = K_LINEAR * delta + K_QUADRATIC * delta**2
    c, s = np.cos(direction), np.sin(direction)
    slip = R * (W - stretch * (n_y * c - n_x * s) / rho)
    friction = MU * f * slip / np.sqrt(slip**2 + smooth**2)
    p_x, p_y = f * n_x + friction * n_y, f * n_y - friction * n_x
    along, across = p_x * c + p_y * s, p_y * c - p_x * s
    return length * np.array(
        [
            stretch * c,
            stretch * s,
            curvature,
            Q * curvature - along,
            -P * curvature - across,
            -stretch * Q / EI,
        ]
    )


def torque_on_belt(
    y: Array, share: Array, length: float, W: float, R: float, flow: float, smooth: float
) -> float:
    """Moment of the friction about the axis [N m]: what P and Q lose along the belt, less f."""
    middle = 0.5 * (y[:, 1:] + y[:, :-1])
    x, height, direction, P, Q, curvature = middle
    slopes = derivatives(middle, length, W, R, flow, smooth)
    c, s = np.cos(direction), np.sin(direction)
    along, across = Q * curvature * length - slopes[3], -P * curvature * length - slopes[4]
    p_x, p_y = along * c - across * s, along * s + across * c
    return float(np.sum((height * p_x - x * p_y) * np.diff(share)))


def places(R: float, wrap: float) -> Array:
    """Path coordinates [m], fine where the contact ends."""
    total, at = 2.0 * SPAN + R * wrap, [0.0]
    while at[-1] < total:
        s = at[-1]
        off = min(max(end - 0.02 - s, s - end - 0.02, 0.0) for end in (SPAN, SPAN + R * wrap))
        at.append(s + min(COARSE, FINE + 0.02 * off))
    return np.array(at) * total / at[-1]


def flowing_rod(
    R: float,
    v0: float,
    P_in: float,
    P_out: float,
    wrap: float = WRAP,
    smoothings: Sequence[float] = SMOOTHINGS,
) -> Iterator[Smoothed]:
    """Speed and torque of the pulley with the forces of both spans given, for each smoothing."""
    s = places(R, wrap)
    share, n, flow = s / s[-1], s.size, MASS * v0**2
    h, half = np.diff(share), 0.5 * wrap
    theta = np.clip((s - SPAN) / R - half, -half, half)
    off = np.minimum(s - SPAN, 0.0) + np.maximum(s - SPAN - R * wrap, 0.0)
    mean = 0.5 * (P_in + P_out)
    low = R - mean / R / (K_LINEAR + K_QUADRATIC * mean / R / K_LINEAR)
    y = np.zeros((6, n))
    y[0] = low * np.sin(theta) + off * np.cos(theta)
    y[1] = low * np.cos(theta) - off * np.sin(theta)
    y[2], y[3] = -theta, P_in + (P_out - P_in) * 0.5 * (theta / half + 1.0)
    y[5] = -np.where(np.abs(theta) < half, 1.0 / R, 0.0)
    unknown = np.array([s[-1] / (1.0 + mean / EA), (1.0 + mean / EA) / low])
    end_x = R * math.sin(half) + SPAN * math.cos(half)
    end_y = R * math.cos(half) - SPAN * math.sin(half)

    def residual(y: Array, unknown: Array, smooth: float) -> Array:
        slopes = derivatives(0.5 * (y[:, 1:] + y[:, :-1]), *unknown, R, flow, smooth)
        boxes = (np.diff(y) - h * slopes) / SIZES[:, None]
        ends = np.array([[-end_x, end_y, P_in], [end_x, end_y, P_out]])
        here = y[:, [0, -1]].T
        force = np.hypot(here[:, 3], here[:, 4])
        held = np.stack([here[:, 0], here[:, 1], force], axis=1) - ends
        held /= SIZES[[0, 1, 3]]
        bent = here[:, 5:] / SIZES[5]
        at_ends = np.hstack([held, bent])
        return np.concatenate([at_ends[0], boxes.T.ravel(), at_ends[1]])

    for smooth in smoothings:
        for _ in range(100):
            r = residual(y, unknown, smooth)
            step = splu(_jacobian(y, unknown, h, R, flow, smooth)).solve(-r)
            by_y, by_unknown = step[: 6 * n].reshape(n, 6).T, step[6 * n :]
            factor = min(1.0, 3e-3 / np.abs(by_y[:2]).max(), 0.1 / np.abs(by_y[2]).max())
            while factor > 1e-3:
                r_new = residual(y + factor * by_y, unknown + factor * by_unknown, smooth)
                if np.linalg.norm(r_new) < np.linalg.norm(r) or np.linalg.norm(r) < 1e-11:
                    break
                factor *= 0.5
            y, unknown = y + factor * by_y, unknown + factor * by_unknown
            if np.abs(by_unknown / unknown).max() < 1e-11 and np.abs(by_y[3]).max() < 1e-6:
                break
        else:
            raise RuntimeError(f"no solution with the friction smoothed over {smooth:g}")
        torque = torque_on_belt(y, share, *unknown, R, flow, smooth)
        yield Smoothed(smooth, float(unknown[1]), torque)


def _jacobian(
    y: Array, unknown: Array, h: Array, R: float, flow: float, smooth: float
) -> csc_matrix:
    """Derivatives of the residual; those of the boxes by central differences."""
    n = y.shape[1]
    boxes = np.arange(n - 1)
    middle = 0.5 * (y[:, 1:] + y[:, :-1])
    rows, columns, values = [], [], []

    def add(row: Array, column: Array, value: Array) -> None:
        rows.append(np.atleast_1d(row))
        columns.append(np.atleast_1d(column))
        values.append(np.atleast_1d(value))

    for k in range(6):
        away = np.zeros((6, 1))
        away[k] = 1e-7 * SIZES[k]
        above, below = (
            derivatives(middle + sign * away, *unknown, R, flow, smooth) for sign in (1, -1)
        )
        slopes = (above - below) / (2.0 * away[k])
        for i in range(6):
            for side, unit in ((0, -1.0), (1, 1.0)):
                value = (unit * (i == k) - 0.5 * h * slopes[i]) / SIZES[i]
                add(4 + 6 * boxes + i, 6 * (boxes + side) + k, value)
    for k in range(2):
        more = unknown.copy()
        more[k] *= 1.0 + 1e-7
        slopes = derivatives(middle, *more, R, flow, smooth)
        slopes = (slopes - derivatives(middle, *unknown, R, flow, smooth)) / (more - unknown)[k]
        for i in range(6):
            add(4 + 6 * boxes + i, np.full(n - 1, 6 * n + k), -h * slopes[i] / SIZES[i])
    for first, node in ((0, 0), (4 + 6 * (n - 1), n - 1)):
        force = np.hypot(y[3, node], y[4, node])
        add(first, 6 * node, 1.0 / SIZES[0])
        add(first + 1, 6 * node + 1, 1.0 / SIZES[1])
        add(first + 2, 6 * node + 3, y[3, node] / force / SIZES[3])
        add(first + 2, 6 * node + 4, y[4, node] / force / SIZES[3])
        add(first + 3, 6 * node + 5, 1.0 / SIZES[5])
    at = np.concatenate(rows), np.concatenate(columns)
    return csc_matrix((np.concatenate(values), at), shape=(6 * n + 2, 6 * n + 2))
