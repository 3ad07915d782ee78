"""The sliding of one run in some fifty numbers: all that the campaign keeps of its record.

The quantity is z = ln(T_tight/T_slack), linearised about the smooth course m of both tensions,

    z = ln(m_t/m_s) + (T_t/m_t - 1) - (T_s/m_s - 1),                                         (S1)

since the plain logarithm of noisy samples is biased by -sigma²/(2 T²). It is averaged over blocks
of samples whose length grows with the travel: fine where the tail of the peak is steep, coarse
where only the level is left to tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.identify.estimators.signal import (
    NOISE_FLOOR,
    converter_rounding,
    difference_sigma,
    line_columns,
    noise_before_rounding,
    strongest_line,
)
from beltid.identify.estimators.statistics import mad_sigma
from beltid.identify.friction.tail_shapes import tail_basis

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

GROWTH = 0.1
"""Length of a block over the length of the record before it."""
FINEST = 256
"""Blocks as short as a sample in a record of so many samples; longer ones of a longer record."""
TAKE_UP = np.geomspace(0.06, 0.35, 5)
"""Lengths over which the rest of the build-up decays, over its travel: so dense that a recording
without noise shows no other decay between two of them."""
LINES = 3
"""Most ripples of a run."""
OUTLIER = 6.0
"""Distance from the smooth course beyond which a sample is dropped, in robust sigmas."""


@dataclass(frozen=True, slots=True, eq=False)
class SlidingRecord:
    """Block means of the sliding phase of a run, shape (m,) where not said otherwise.

    Attributes
    ----------
    first_s, last_s : ndarray
        Times of the first and the last sample of each block [s].
    count : ndarray
        Samples of each block.
    travel : ndarray
        Mean travel of the pulley's surface since the end of the build-up [m].
    z, log_mean : ndarray
        ln(T_tight/T_slack) (S1), and ln of the geometric mean of the tensions in N.
    basis : ndarray, shape (m, RANK)
        The tails' basis functions.
    waves : ndarray, shape (m, 2 k)
        Cosine and sine of the ripples found.
    take_up : ndarray, shape (m, TAKE_UP.size)
        Decays of what may be left of the build-up where the sliding begins.
    turn : ndarray, shape (m, 2)
        Cosine and sine of the angle of the pulley.
    temperature : ndarray
        Temperature [°C], nan where it is not known.
    rest_s : tuple of float
        First and last time at rest, when the zeros of the cells showed [s].
    rest_count : int
        Samples at rest.
    tensions_N : tuple of float
        Tight and slack tension in the second half of the sliding [N].
    noise_N : float
        White noise of a sample in z over `sensitivity` [N].
    rounding : float
        Error of z that coarse converters leave whatever the number of samples [-].
    step_m : float
        Travel between samples [m]; shorter tails do not show.
    ripple_N, ripple_s : float
        Amplitude of the strongest ripple in the tight tension [N], and its period [s].
    unrest_N : float
        Scatter of z over pieces as long as the rest, without ripple, over `sensitivity` [N].
    n_samples, n_outliers : int
        Samples that were averaged, and left out.
    noisy : tuple of float
        1 for a tension with errors, 0 for that of a dead weight.
    """

    first_s: Array
    last_s: Array
    count: Array
    travel: Array
    z: Array
    log_mean: Array
    basis: Array
    waves: Array
    take_up: Array
    turn: Array
    temperature: Array
    rest_s: tuple[float, float]
    rest_count: int
    tensions_N: tuple[float, float]
    noise_N: float
    rounding: float
    step_m: float
    ripple_N: float
    ripple_s: float
    unrest_N: float
    n_samples: int
    n_outliers: int
    noisy: tuple[float, float] = (1.0, 1.0)

    @property
    def sensitivity(self) -> float:
        """Change of z by independent errors of 1 N in both cells [1/N]."""
        return _sensitivity(self.tensions_N, self.noisy)

    @property
    def speed_m_s(self) -> float:
        """Mean speed of the pulley's surface [m/s]."""
        middle_s = 0.5 * (self.first_s + self.last_s)
        return float(np.ptp(self.travel) / max(np.ptp(middle_s), 1e-12))

    @property
    def level(self) -> float:
        """Mean of z over the later half of the travel, roughly [-]."""
        tight, slack = self.tensions_N
        return float(np.log(tight / slack))


def sliding_record(
    t: Array,
    tensions: Array,
    angle: Array,
    travel: Array,
    temperature: Array,
    rest_s: tuple[float, float],
    rest_count: int,
    built_m: float,
    steps: tuple[float, float],
    noisy: tuple[float, float] = (1.0, 1.0),
) -> SlidingRecord:
    """Average the sliding phase of a run over blocks.

    Parameters
    ----------
    t : ndarray
        Times [s], non-decreasing, shape (n,).
    tensions : ndarray
        Tight and slack tension [N], finite, shape (n, 2).
    angle : ndarray
        Angle of the pulley since it began to turn [rad], shape (n,).
    travel : ndarray
        Travel of its surface since the end of the build-up [m], shape (n,).
    temperature : ndarray
        Temperature [°C], nan where it is not known, shape (n,).
    rest_s, rest_count : tuple of float, int
        First and last time at rest [s], samples at rest.
    built_m : float
        Travel of the build-up [m].
    steps : tuple of float
        Steps of the converters of both cells [N]; zero if they are fine.
    noisy : tuple of float
        1 for a tension with errors, 0 for that of a dead weight.
    """
    smooth, lines, kept = _smooth_course(t, tensions, travel, steps)
    t, tensions, angle, travel, temperature, smooth = (
        a[kept] for a in (t, tensions, angle, travel, temperature, smooth)
    )
    n = t.size
    ratio = tensions / smooth - 1.0
    z = np.log(smooth[:, 0] / smooth[:, 1]) + ratio[:, 0] - ratio[:, 1]
    log_mean = 0.5 * np.sum(np.log(smooth) + ratio, axis=1)
    waves = [line_columns(t - t[0], frequency) for frequency in lines]
    wave = np.hstack(waves) if waves else np.zeros((n, 0))
    half = slice(n // 2, None)
    level = np.median(tensions[half], axis=0)
    sensitivity = _sensitivity(level, noisy)
    residual = ratio[:, 0] - ratio[:, 1]
    if waves:
        residual = residual - wave @ np.linalg.lstsq(wave, residual, rcond=None)[0]
    noise = max(difference_sigma(residual), NOISE_FLOOR) / sensitivity
    ripple_N = 0.0
    if waves:
        of_tight = np.linalg.lstsq(wave, tensions[:, 0] - smooth[:, 0], rcond=None)[0]
        ripple_N = float(np.hypot(*of_tight[:2]))
    recorded = [difference_sigma(tensions[:, k]) for k in (0, 1)]
    rounding = converter_rounding(noise_before_rounding(recorded, steps), steps)
    starts = block_starts(n)
    count = np.diff(np.append(starts, n)).astype(float)

    def means(x: Array) -> Array:
        total = np.add.reduceat(x, starts, axis=0)
        return np.asarray(total / (count if x.ndim == 1 else count[:, None]))

    return SlidingRecord(
        first_s=t[starts],
        last_s=t[np.append(starts[1:], n) - 1],
        count=count,
        travel=means(travel),
        z=means(z),
        log_mean=means(log_mean),
        basis=means(tail_basis(travel)),
        waves=means(wave),
        take_up=means(np.exp(-(travel - travel[0])[:, None] / np.maximum(TAKE_UP * built_m, 1e-9))),
        turn=means(np.column_stack([np.cos(angle), np.sin(angle)])),
        temperature=means(temperature),
        rest_s=rest_s,
        rest_count=rest_count,
        tensions_N=(float(level[0]), float(level[1])),
        noise_N=noise,
        rounding=float(np.linalg.norm(rounding / level)),
        step_m=float(travel[-1] - travel[0]) / max(n - 1, 1),
        ripple_N=ripple_N,
        ripple_s=1.0 / lines[0] if lines else float("nan"),
        unrest_N=_scatter_of_pieces(t, residual, rest_s[1] - rest_s[0]) / sensitivity,
        n_samples=n,
        n_outliers=int(np.count_nonzero(~kept)),
        noisy=noisy,
    )


def _sensitivity(tensions_N: Sequence[float] | Array, noisy: tuple[float, float]) -> float:
    return float(np.hypot(noisy[0] / tensions_N[0], noisy[1] / tensions_N[1]))


def _scatter_of_pieces(t: Array, x: Array, length_s: float) -> float:
    """Scatter about a straight line, median over pieces of a length: as it is seen at rest."""
    pieces = np.floor((t - t[0]) / max(length_s, 1e-9)).astype(int)
    found = []
    for k in range(int(pieces[-1]) + 1):
        mine = pieces == k
        if np.count_nonzero(mine) >= 8:
            away = t[mine] - t[mine].mean()
            y = x[mine] - x[mine].mean()
            y = y - away * (away @ y) / max(float(away @ away), 1e-300)
            found.append(float(np.sqrt(y @ y / (y.size - 2))))
    return float(np.median(found)) if found else 0.0


def block_starts(n: int) -> NDArray[np.intp]:
    """First samples of the blocks of a record of n samples."""
    finest = max(-(-n // FINEST), 1)
    starts, k = [], 0
    while k < n:
        starts.append(k)
        k += max(finest, int(GROWTH * k))
    if n - starts[-1] < 0.5 * max(finest, GROWTH * n) and len(starts) > 1:
        starts.pop()  # the rest belongs to the last block
    return np.array(starts, dtype=np.intp)


def _smooth_course(
    t: Array, tensions: Array, travel: Array, steps: tuple[float, float]
) -> tuple[Array, list[float], Mask]:
    """Both tensions without noise and ripple (n, 2), frequencies of the ripples, usable samples."""
    reach = max(float(travel[-1] - travel[0]), 1e-9)
    x = travel - travel[0]
    decays = np.exp(-x[:, None] / (reach * np.array([0.01, 0.04, 0.15, 0.6])))
    columns = np.column_stack([np.ones(t.size), decays])
    kept = np.ones(t.size, dtype=bool)
    lines: list[float] = []
    # a weak prior keeps neighbouring decays from cancelling each other
    ridge = np.diag([0.0, *([0.03] * decays.shape[1])]) * np.sqrt(t.size)
    for _ in range(LINES + 2):
        waves = [line_columns(t - t[0], frequency) for frequency in lines]
        design = np.hstack([columns, *waves])
        prior = np.zeros((ridge.shape[0], design.shape[1]))
        prior[:, : ridge.shape[1]] = ridge
        system = np.vstack([design[kept], prior])
        target = np.vstack([tensions[kept], np.zeros((prior.shape[0], 2))])
        solution = np.linalg.lstsq(system, target, rcond=None)[0]
        residual = tensions - design @ solution
        sigma = np.array([max(mad_sigma(column), 1e-12) for column in residual.T])
        # a coarse converter may repeat one value: its rounding is no outlier
        rounding = np.asarray(steps) / np.sqrt(12.0)
        floor = np.maximum(NOISE_FLOOR * np.abs(np.median(tensions, axis=0)), rounding)
        kept = np.all(np.abs(residual) <= OUTLIER * np.maximum(sigma, floor), axis=1)
        if len(lines) == LINES:
            break
        found = _ripple(t[kept], residual[kept] / np.maximum(sigma, floor), design[kept])
        if found is None:
            break
        lines.append(found)
    smooth = columns @ solution[: columns.shape[1]]
    level = np.median(tensions, axis=0)
    return np.maximum(smooth, 0.1 * np.abs(level)), lines, kept


def _ripple(t: Array, residual: Array, design: Array) -> float | None:
    """Frequency of a ripple that stands out of the residuals, with their memory taken out."""
    if t.size < 24 or float(np.max(np.abs(residual))) < 1e-9:
        return None
    basis = np.linalg.qr(design)[0]
    memory = [float(np.clip(r[1:] @ r[:-1] / (r @ r), 0.0, 0.98)) for r in residual.T]
    white = residual.copy()
    white[1:] -= residual[:-1] * memory
    white /= np.std(white, axis=0)
    return strongest_line(t, white, basis)
