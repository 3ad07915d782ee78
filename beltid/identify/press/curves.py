"""The branches of a press cycle and the curve half-way between them.

The belt's hysteresis lifts the loading branch and lowers the unloading branch. The elastic law of
Eq. (3) is the curve half-way between them *at equal penetration*. Both branches are brought to
common positions first: whichever of them the crosshead passes more slowly has more samples, but
not more weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from beltid.errors import InputError
from beltid.identify.estimators.least_squares import solve_least_squares
from beltid.identify.press.cycles import PressCycle
from beltid.identify.press.dwell import moving_part
from beltid.identify.press.preparation import PressTest

Array = NDArray[np.float64]
Samples = slice | NDArray[np.intp]

CONTACT_SHARE = 0.01
"""The fit begins where both branches carry this share of the largest force: below, ribs seat one
by one and the belt may stick to the plate or stay compressed."""
MIN_BRANCH_SAMPLES = 8
"""Fewest samples of a branch within the range of the fit."""
END_MARGIN = 5.0
"""Distance of the fit from the ends of a branch, in standard deviations of the travel's noise."""
MAX_NODES = 120
MIN_NODES = 6
PLOT_POINTS = 120


@dataclass(frozen=True, slots=True)
class Branch:
    """One branch for a figure, thinned by means of neighbouring samples.

    Attributes
    ----------
    test : str
        Name of the test.
    temperature_degC : float
        Temperature [°C], nan if unknown.
    cycle : int
        Number of the cycle.
    branch : str
        "loading" or "unloading".
    penetration_m : ndarray
        Penetration from the contact point of the law, negative before contact [m], shape (m,).
    line_force_N_m : ndarray
        Force per length of belt [N/m], shape (m,).
    """

    test: str
    temperature_degC: float
    cycle: int
    branch: str
    penetration_m: Array
    line_force_N_m: Array


@dataclass(frozen=True, slots=True)
class PressCurve:
    """The branches of one cycle at common positions.

    Attributes
    ----------
    test : str
        Name of the test.
    cycle : int
        Number of the cycle.
    temperature_degC : float
        Temperature [°C], nan if unknown.
    position_m : ndarray
        Common positions, machine compliance taken off [m], shape (m,).
    middle_N_m : ndarray
        Force half-way between the branches [N/m], shape (m,).
    half_gap_N_m : ndarray
        Half the distance of the branches [N/m], shape (m,); nan if never unloaded.
    branches : tuple of (str, ndarray, ndarray)
        Name, positions [m] and line forces [N/m] of the samples of each branch, without those
        of a dwell.
    fit_range_m : tuple of float
        Lowest and highest position of the fit [m].
    touch_m : float
        Position from which the loading branch carries force [m].
    top_position_m, top_force_N_m : float
        Largest position [m] and line force [N/m] of the cycle.
    dissipated_J_m, stored_J_m : float
        Work lost in the loop and work of the loading branch per metre of belt [J/m]; nan if never
        unloaded.
    travel_sign : float
        Sign of the recording's crosshead travel in compression.
    """

    test: str
    cycle: int
    temperature_degC: float
    position_m: Array
    middle_N_m: Array
    half_gap_N_m: Array
    branches: tuple[tuple[str, Array, Array], ...]
    fit_range_m: tuple[float, float]
    touch_m: float
    top_position_m: float
    top_force_N_m: float
    dissipated_J_m: float
    stored_J_m: float
    travel_sign: float

    @property
    def unloads(self) -> bool:
        """Whether both branches were recorded."""
        return len(self.branches) == 2

    @property
    def n_samples(self) -> int:
        """Samples of the recording within the range of the fit."""
        return sum(int(np.count_nonzero(self.inside(x))) for _, x, _ in self.branches)

    def inside(self, position_m: Array) -> NDArray[np.bool_]:
        """Mark the positions within the range of the fit."""
        low, high = self.fit_range_m
        return (position_m >= low) & (position_m <= high)


def press_curve(test: PressTest, cycle: PressCycle, segment_length_m: float) -> PressCurve:
    """Bring the branches of a cycle to common positions.

    Parameters
    ----------
    test : PressTest
        The cleaned test.
    cycle : PressCycle
        The cycle to take from it.
    segment_length_m : float
        Length of the belt segment [m].

    Raises
    ------
    InputError
        If a branch has too few samples in contact.
    """
    names = ("loading", "unloading") if cycle.complete else ("loading",)
    parts = (cycle.loading, cycle.unloading)[: len(names)]
    whole = _branches(test, names, parts, segment_length_m)
    # a dwell belongs to no branch: the force relaxes from the one towards the other
    branches = _branches(
        test,
        names,
        tuple(
            moving_part(test.time_s, test.travel_m, test.force_N, part, test.travel_noise_m)
            for part in parts
        ),
        segment_length_m,
    )
    noise = test.force_noise_N / segment_length_m
    threshold = max(CONTACT_SHARE * cycle.peak_force_N / segment_length_m, 6.0 * noise)
    # samples near an end are picked by their own noise
    margin = END_MARGIN * test.position_noise_m
    low = max(_contact_begin(b, threshold) for b in branches) + margin
    high = min(_steady_max(x) for _, x, _ in branches) - margin
    counts = [int(np.count_nonzero((x >= low) & (x <= high))) for _, x, _ in branches]
    if min(counts) < MIN_BRANCH_SAMPLES:
        found = ", ".join(f"{n} {b[0]}" for n, b in zip(counts, branches, strict=True))
        raise InputError(
            f"test {test.label}: cycle {cycle.number}: {found} samples in contact and clear of "
            f"the travel's noise ({test.position_noise_m * 1e6:.2g} µm), "
            f"must be at least {MIN_BRANCH_SAMPLES} of each branch"
        )
    edges = np.linspace(low, high, int(np.clip(min(counts) // 4, MIN_NODES, MAX_NODES)) + 1)
    levels = [_branch_at_nodes(x, f, edges) for _, x, f in branches]
    half_gap = (
        0.5 * (levels[0] - levels[1]) if len(levels) == 2 else np.full_like(levels[0], np.nan)
    )
    dissipated, stored = _loop_energies(whole)
    return PressCurve(
        test=test.label,
        cycle=cycle.number,
        temperature_degC=test.temperature_degC,
        position_m=0.5 * (edges[1:] + edges[:-1]),
        middle_N_m=np.mean(levels, axis=0),
        half_gap_N_m=half_gap,
        branches=branches,
        fit_range_m=(low, high),
        touch_m=_contact_begin(branches[0], threshold),
        top_position_m=max(_steady_max(x) for _, x, _ in whole),
        top_force_N_m=max(_steady_max(f) for _, _, f in whole),
        dissipated_J_m=dissipated,
        stored_J_m=stored,
        travel_sign=test.travel_sign,
    )


def _branches(
    test: PressTest, names: Sequence[str], parts: Sequence[Samples], segment_length_m: float
) -> tuple[tuple[str, Array, Array], ...]:
    """Name, positions [m] and line forces [N/m] of each branch."""
    return tuple(
        (name, test.position_m[part], test.force_N[part] / segment_length_m)
        for name, part in zip(names, parts, strict=True)
    )


def _steady_max(x: Array) -> float:
    """Largest value that is no noise: of the running median over a few samples.

    The ends are mirrored without repeating the last sample: there a branch ends with the sample
    that noise made the turning point.
    """
    return float(np.max(median_filter(x, size=min(5, x.size), mode="mirror")))


def _contact_begin(branch: tuple[str, Array, Array], threshold: float) -> float:
    """Position above which the branch carries more than the threshold [m]."""
    name, position, force = branch
    outward = slice(None, None, -1) if name == "loading" else slice(None)
    force, position = force[outward], position[outward]
    # walk from the peak towards the open plate
    start = int(np.argmax(force))
    below = np.flatnonzero(force[start:] < threshold)
    if below.size == 0:
        return -_steady_max(-position)
    return float(position[start + int(below[0])])


def _branch_at_nodes(position: Array, force: Array, edges: Array) -> Array:
    """Force of a branch at the middles of the bins [N/m], shape (m,).

    A polynomial takes the shape of the branch, the bin means of what it leaves are added to it.
    So neither the place of the samples within a bin nor the curvature of the branch matter, while
    the polynomial need not be exact.
    """
    inside = (position >= edges[0]) & (position <= edges[-1])
    x, f = position[inside], force[inside]
    centre, half = 0.5 * (edges[0] + edges[-1]), 0.5 * (edges[-1] - edges[0])
    degree = 5 if x.size >= 24 else 3

    def columns(at: Array) -> Array:
        return np.polynomial.chebyshev.chebvander((at - centre) / half, degree)

    fit = solve_least_squares(columns(x), f)
    bins = np.minimum(np.searchsorted(edges, x, side="right") - 1, edges.size - 2)
    count = np.bincount(bins, minlength=edges.size - 1)
    total = np.bincount(bins, weights=fit.residuals, minlength=edges.size - 1)
    nodes = 0.5 * (edges[1:] + edges[:-1])
    filled = count > 0
    rest = np.interp(nodes, nodes[filled], total[filled] / count[filled])
    return columns(nodes) @ fit.coefficients + rest


def _loop_energies(branches: tuple[tuple[str, Array, Array], ...]) -> tuple[float, float]:
    """Work lost in the loop and work of the loading branch [J/m], over their common positions."""
    if len(branches) < 2:
        return float("nan"), float("nan")
    low = max(float(np.min(x)) for _, x, _ in branches)
    high = min(float(np.max(x)) for _, x, _ in branches)
    work = []
    for _, x, f in branches:
        clipped = np.clip(x, low, high)
        work.append(abs(float(np.sum(np.diff(clipped) * 0.5 * (f[1:] + f[:-1])))))
    return work[0] - work[1], work[0]


def thinned_branches(curve: PressCurve, offset_m: float) -> tuple[Branch, ...]:
    """Branches of a curve over the penetration, at most some hundred points each.

    Parameters
    ----------
    curve : PressCurve
        The curve.
    offset_m : float
        Position of the contact point [m].
    """
    thinned = []
    for name, x, f in curve.branches:
        parts = min(PLOT_POINTS, x.size)
        starts = np.linspace(0, x.size, parts + 1).astype(int)[:-1]
        sizes = np.diff(np.append(starts, x.size))
        thinned.append(
            Branch(
                test=curve.test,
                temperature_degC=curve.temperature_degC,
                cycle=curve.cycle,
                branch=name,
                penetration_m=np.add.reduceat(x, starts) / sizes - offset_m,
                line_force_N_m=np.add.reduceat(f, starts) / sizes,
            )
        )
    return tuple(thinned)
