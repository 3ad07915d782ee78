"""Errors of the two load cells: what a calibration knows, and what the rest shows.

What is known is taken off the readings before anything else, so that the difference of the cells at
rest is only what is left of it. At rest both spans carry the same tension; the difference of the
cells (tight less slack) is

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

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from beltid.identify.friction.channels import Channels

Array = NDArray[np.float64]


CLEAR, LARGE = 5.0, 0.1
"""Standard errors, and share of the lowest stated tension or of the factor 1, from which readings
do not fit what is stated."""
ROUGH = "If the stated tensions are no more than rough: friction.check_initial_tension: false"
TAKEN_OFF = "known errors of the load cells taken off"
"""How the note begins."""


@dataclass(frozen=True, slots=True)
class KnownCell:
    """Known errors of one load cell; the defaults are those of a perfect one."""

    tare_N: float = 0.0
    """Reading without a load [N]."""
    gain: float = 1.0
    """True force over reading, less tare [-]."""
    tilt_deg: float = 0.0
    """Angle between the free span of the belt and the axis of the cell [deg]."""

    @property
    def scale(self) -> float:
        """Tension over reading, less tare [-]."""
        return self.gain / float(np.cos(np.radians(self.tilt_deg)))

    @property
    def is_perfect(self) -> bool:
        """Whether there is nothing to take off."""
        return self.tare_N == 0.0 and self.scale == 1.0

    def tension(self, reading_N: ArrayLike) -> Array:
        """Tension of the span from the reading of its cell.

        The cell feels the part of the tension along its axis,
        ``T = gain (reading - tare) / cos(tilt)``.

        Parameters
        ----------
        reading_N : array_like
            Readings [N].
        """
        return self.scale * (np.asarray(reading_N, dtype=float) - self.tare_N)

    def described(self, name: str) -> str:
        """What is taken off, in words; empty for a perfect cell."""
        parts = [
            text
            for text, is_there in (
                (f"tare {self.tare_N:g} N", self.tare_N != 0.0),
                (f"gain {self.gain:g}", self.gain != 1.0),
                (f"tilt {self.tilt_deg:g} deg", self.tilt_deg != 0.0),
            )
            if is_there
        ]
        return f"{name} {', '.join(parts)}" if parts else ""


@dataclass(frozen=True, slots=True)
class KnownCells:
    """Known errors of both load cells of the rig, each that of its own column."""

    tight: KnownCell = KnownCell()
    slack: KnownCell = KnownCell()

    @property
    def note(self) -> str:
        """What is taken off, for the user; empty if there is nothing."""
        cells = (self.tight.described("tight cell"), self.slack.described("slack cell"))
        said = "; ".join(filter(None, cells))
        return f"{TAKEN_OFF}: {said}" if said else ""

    def applied(self, channels: Channels) -> Channels:
        """Channels with tensions in place of readings."""
        if self.tight.is_perfect and self.slack.is_perfect:
            return channels
        step_tight, step_slack = channels.steps
        return replace(
            channels,
            tight=self.tight.tension(channels.tight),
            slack=self.slack.tension(channels.slack),
            steps=(self.tight.scale * step_tight, self.slack.scale * step_slack),
        )


def against_stated(measured_N: Array, stated_N: Array) -> str:
    """What is wrong between the tensions at rest and those that the test was to have.

    Their line ``measured = offset + factor stated`` is that through the medians of the lowest and
    of the highest third of the runs (Tukey's resistant line): a few runs set wrongly do not matter.

    Parameters
    ----------
    measured_N : ndarray
        Mean of both cells at rest [N], shape (n,).
    stated_N : ndarray
        Stated initial tensions [N], nan where there is none, shape (n,).

    Returns
    -------
    str
        Empty if they fit, or if fewer than four runs or a single tension leave it open.
    """
    known = np.isfinite(measured_N) & np.isfinite(stated_N)
    measured, stated = measured_N[known], stated_N[known]
    if known.sum() < 4:
        return ""
    order = np.argsort(stated, kind="stable")
    third = -(-order.size // 3)
    (low, high), (at_low, at_high) = (
        (np.median(x[order[:third]]), np.median(x[order[-third:]])) for x in (stated, measured)
    )
    if high - low < 0.1 * abs(high):
        return ""
    factor = float((at_high - at_low) / (high - low))
    offset = float(np.median(measured - factor * stated))
    away = measured - offset - factor * stated
    scatter = 1.4826 * float(np.median(np.abs(away))) + 1e-3 * float(np.median(stated))
    design = np.column_stack([np.ones_like(stated), stated])
    # the line of medians is some 1.25 times as uncertain as that of least squares
    errors = 1.25 * scatter * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    offset_se, factor_se = errors
    lowest = float(np.min(stated))
    if abs(offset) > max(CLEAR * offset_se, LARGE * lowest):
        return (
            f"the tensions at rest are {offset:+.3g} N (standard error {offset_se:.2g} N) off the "
            "stated initial tensions, whatever the tension: were the load cells tared? State their "
            "readings without a load as friction.tension_tight_tare_N and "
            f"friction.tension_slack_tare_N. {ROUGH}"
        )
    if abs(factor - 1.0) > max(CLEAR * factor_se, LARGE):
        return (
            f"the tensions at rest are {factor:.4g} (standard error {factor_se:.2g}) times the "
            "stated initial tensions: is the unit of the cells right (units.rig), is the force of "
            "the whole hub stated? A known error of the cells is friction.tension_tight_gain and "
            f"friction.tension_slack_gain. {ROUGH}"
        )
    return ""


Mode = Literal["auto"] | bool

SIZES = (0.0, 3e-4, 1e-3, 3e-3, 1e-2)
"""Standard deviations that zeta, gamma, w and f may have, in units of the median initial tension;
half the probability is at zero."""
NOTED = 0.003
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


def cell_errors(
    difference: Array, se: Array, tension: Array, sliding: Array, mode: Mode
) -> CellErrors:
    """Errors of the cells of every run.

    Parameters
    ----------
    difference, se : ndarray
        Difference of the cells at rest (tight less slack) and its standard error [N], shape (R,).
    tension : ndarray
        Tension at rest [N], shape (R,).
    sliding : ndarray
        Tight and slack tension while sliding [N], shape (R, 2).
    mode : "auto", True or False
        All runs together; the whole difference a zero point of each run, half of it each cell's;
        or nothing corrected, the variance allows for it.
    """
    D, T = difference, tension
    one, other = 1.0 / sliding.T
    q, apart = 0.5 * (one + other), 0.5 * (other - one)
    if mode != "auto":
        clear = np.maximum(D**2 - se**2, 0.0)
        own = q**2 * (se**2 if mode else clear)
        words = "taken off" if mode else "not corrected: the standard error allows for it"
        notes = tuple(
            f"{_differ(d, t)}, {words}" if abs(d) > max(NOTED * t, 5.0 * s) else ""
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
    if abs(zeta) + wander > NOTED * tension_N and abs(taken_N) > NOTED * tension_N:
        also = f" and wander by {wander:.2g} N" if wander > 0.1 * abs(zeta) else ""
        parts.append(
            f"the zero points of the cells differ by {zeta:+.3g} N over all runs{also}: taken off"
        )
    if abs(gamma) > 0.001:
        parts.append(f"the gains of the cells differ by {100 * gamma:+.3g} %: taken off")
    left = difference_N - gamma * tension_N - (taken_N - gamma * tension_N if parts else taken_N)
    if not parts and abs(left) > NOTED * tension_N:
        parts.append(f"{_differ(difference_N, tension_N)}: the standard error allows for it")
    return "; ".join(parts)
