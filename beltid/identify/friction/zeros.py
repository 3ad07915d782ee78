"""Zero points and gains of the two load cells, from what they show at rest.

At rest both spans carry the same tension. The difference of the cells (tight less slack) is

    D_r = zeta + gamma T_r + w_r + f_r T_r + noise,                                          (S4)

with what all runs share, a difference zeta of the zero points and gamma of the gains, and what
differs from run to run: zeros that wander, w, and friction left over from tightening, f, which
sliding does away with. One run cannot tell these apart; runs at several tensions can. Each has its
own standard deviation, unknown, and possibly zero; the errors of ln(T_tight/T_slack)

    e_r = q_r (zeta + w_r) + gamma,   q_r = (1/T_tight + 1/T_slack)/2                         (S5)

are averaged over all of them. What both zeros have in common never shows at rest; it is as large as
half their difference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from beltid.identify.friction.rest_phase import Rest

Array = NDArray[np.float64]
Mode = Literal["auto"] | bool

SIZES = (0.0, 3e-4, 1e-3, 3e-3, 1e-2)
"""Standard deviations that zeta, gamma, w and f may have, in units of the median initial tension;
half the probability is at zero."""
TOLD = 0.003
"""Correction over the initial tension from which on a run tells of it."""


@dataclass(frozen=True, slots=True, eq=False)
class CellErrors:
    """Errors of ln(T_tight/T_slack) by the cells, shape (R,).

    Attributes
    ----------
    mean : ndarray
        What is to be taken off.
    variance : ndarray
        What is not known of it, of each run by itself.
    shared : ndarray
        Standard deviation of what all runs share.
    notes : tuple of str
        What a user should know of each run; empty where there is nothing.
    """

    mean: Array
    variance: Array
    shared: Array
    notes: tuple[str, ...]


def cell_errors(rests: Sequence[Rest], tight: Array, slack: Array, mode: Mode) -> CellErrors:
    """Errors of the cells of every run.

    Parameters
    ----------
    rests : sequence of Rest
        The rest phases.
    tight, slack : ndarray
        Tensions while sliding [N], shape (R,).
    mode : "auto", True or False
        All runs together; the whole difference a zero point of each run, half of it each cell's;
        or nothing corrected, the variance allows for it.
    """
    D = np.array([rest.imbalance_N for rest in rests])
    se = np.array([rest.imbalance_se_N for rest in rests])
    T = np.array([rest.tension_N for rest in rests])
    q, apart = 0.5 * (1.0 / tight + 1.0 / slack), 0.5 * (1.0 / slack - 1.0 / tight)
    if mode != "auto":
        clear = np.maximum(D**2 - se**2, 0.0)
        own = q**2 * (se**2 if mode else clear)
        words = "taken off" if mode else "not corrected: the standard error allows for it"
        notes = tuple(
            f"{_differ(d, t)}, {words}" if abs(d) > max(TOLD * t, 5.0 * s) else ""
            for d, s, t in zip(D, se, T, strict=True)
        )
        return CellErrors(q * D * bool(mode), own + apart**2 * clear, np.zeros(D.size), notes)
    return _of_bench(D, se, T, q, apart)


def _differ(difference_N: float, tension_N: float) -> str:
    relative = 100.0 * abs(difference_N) / tension_N
    return f"the cells differ by {difference_N:+.3g} N at rest ({relative:.2g} %)"


def _of_bench(D: Array, se: Array, T: Array, q: Array, apart: Array) -> CellErrors:
    unit = float(np.median(T))
    sizes = np.array(SIZES)
    noise = np.square(np.maximum(se, 1e-5 * T))
    X = np.column_stack([np.ones(D.size), T / unit])
    pairs = np.array(list(product(sizes, sizes)))
    S = np.square(pairs * unit)  # variances of zeta and gamma
    n_present = np.count_nonzero(pairs, axis=1)
    log_p, given = [], []
    for (s_w, s_f), n_more in zip(pairs, n_present, strict=True):
        variance = noise + (s_w * unit) ** 2 + (s_f * T) ** 2
        weighted = X / variance[:, None]
        M, b = X.T @ weighted, weighted.T @ D
        A = np.eye(2) + S[:, :, None] * M
        C = np.linalg.solve(A, S[:, :, None] * np.eye(2))  # posterior covariances
        found = C @ b
        base = -0.5 * float(np.sum(D**2 / variance + np.log(variance)))
        log_det = np.linalg.slogdet(A)[1]
        log_p.append(base + 0.5 * (found @ b - log_det) - (n_present + n_more) * np.log(4.0))
        given.append((s_w * unit, (s_w * unit) ** 2 / variance, C, found))
    weights = np.exp(np.array(log_p) - np.max(log_p))
    weights /= weights.sum()
    mean, square, own, shared = np.zeros((4, D.size))
    common, fixed = 0.0, np.zeros(3)
    for p, (wander_N, k, C, found) in zip(weights, given, strict=True):
        zero = found[:, :1] + k * (D - found @ X.T)
        error = q * zero + found[:, 1:] / unit
        # what both zeros have in common is as large in every run, whatever their difference
        own += wander_N**2 * (q**2 * (1.0 - k) + apart**2) * p.sum()
        common += p @ (found[:, 0] ** 2 + C[:, 0, 0])
        slopes = np.column_stack([q * (1.0 - k), (1.0 - q * k * T) / unit])
        shared += np.einsum("rk,kl,rl->r", slopes, np.tensordot(p, C, axes=1), slopes)
        mean += p @ error
        square += p @ error**2
        fixed += [p @ found[:, 0], p @ found[:, 1] / unit, p.sum() * wander_N]
    between = np.maximum(square - mean**2, 0.0)
    zeta, gamma, wander = fixed
    shared += apart**2 * common
    return CellErrors(
        mean=mean,
        variance=own,
        shared=np.where(mean < 0.0, -1.0, 1.0) * np.sqrt(shared + between),
        notes=tuple(
            _note(e / half, gamma, d, t, zeta, wander)
            for e, half, d, t in zip(mean, q, D, T, strict=True)
        ),
    )


def _note(
    taken_N: float, gamma: float, difference_N: float, tension_N: float, zeta: float, wander: float
) -> str:
    """What was found of the cells of a run, from its correction as one of the zeros [N]."""
    parts = []
    if abs(zeta) + wander > TOLD * tension_N and abs(taken_N) > TOLD * tension_N:
        also = f" and wander by {wander:.2g} N" if wander > 0.1 * abs(zeta) else ""
        parts.append(
            f"the zero points of the cells differ by {zeta:+.3g} N over all runs{also}: taken off"
        )
    if abs(gamma) > 0.001:
        parts.append(f"the gains of the cells differ by {100 * gamma:+.3g} %: taken off")
    left = difference_N - gamma * tension_N - (taken_N - gamma * tension_N if parts else taken_N)
    if not parts and abs(left) > TOLD * tension_N:
        parts.append(f"{_differ(difference_N, tension_N)}: the standard error allows for it")
    return "; ".join(parts)
