"""The branches of a press cycle and the curve half-way between them.

The belt's hysteresis lifts the loading branch and lowers the unloading branch. The elastic law of
Eq. (3) is the curve half-way between them *at equal penetration*. Both branches are brought to
common positions first: whichever of them the crosshead passes more slowly has more samples, but
not more weight.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from beltid.errors import InputError
from beltid.identify.estimators.least_squares import solve_linear
from beltid.identify.press.recording import (
    PressCycle,
    PressTest,
    StiffnessSettings,
    choose_cycles,
    find_cycles,
    prepare_test,
    read_tests,
)

Array = NDArray[np.float64]

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
class BranchSamples:
    """Samples of one branch: "loading" or "unloading", positions [m], line forces [N/m], (n,)."""

    name: str
    position_m: Array
    force_N_m: Array


@dataclass(frozen=True, slots=True, eq=False)
class PressCurve:
    """The branches of one cycle at common positions.

    Attributes
    ----------
    test : str
        Name of the test.
    cycle, n_cycles : int
        Number of the cycle, and how many the test has.
    temperature_degC : float
        Temperature [°C], nan if unknown.
    position_m, middle_N_m : ndarray
        Common positions, machine compliance taken off [m], and force half-way between the branches
        [N/m]; shape (m,) each.
    branches : tuple of BranchSamples
        Loading, and unloading if recorded; without a hold between them.
    fit_range_m : tuple of float
        Lowest and highest position of the fit [m].
    touch_m : float
        Position from which the loading branch carries force [m].
    top_position_m, top_force_N_m : float
        Largest position [m] and line force [N/m] of the cycle.
    dissipated_J_m, stored_J_m : float
        Work lost in the loop and work of the loading branch per metre of belt [J/m]; nan if never
        unloaded.
    sample_interval_s : float
        Typical time between samples [s], 0 or nan if the clock does not run.
    hold_force_N_m : float
        Force at the end of a hold at the top [N/m]; nan without one.
    virgin_share : float
        Force of the first cycle over that of this one, less one; nan if not known.
    free_travel : bool
        Whether the zero of the load cell could be checked before contact.
    travel_sign : float
        Sign of the recording's crosshead travel in compression.
    """

    test: str
    cycle: int
    n_cycles: int
    temperature_degC: float
    position_m: Array
    middle_N_m: Array
    branches: tuple[BranchSamples, ...]
    fit_range_m: tuple[float, float]
    touch_m: float
    top_position_m: float
    top_force_N_m: float
    dissipated_J_m: float
    stored_J_m: float
    sample_interval_s: float
    hold_force_N_m: float
    virgin_share: float
    free_travel: bool
    travel_sign: float

    @property
    def unloads(self) -> bool:
        """Whether both branches were recorded."""
        return len(self.branches) == 2

    @property
    def n_samples(self) -> int:
        """Samples of the recording within the range of the fit."""
        return sum(int(np.count_nonzero(self.inside(b.position_m))) for b in self.branches)

    def inside(self, position_m: Array) -> NDArray[np.bool_]:
        """Mark the positions within the range of the fit."""
        low, high = self.fit_range_m
        return (position_m >= low) & (position_m <= high)


@dataclass(frozen=True, slots=True)
class PressRecording:
    """Curves of the usable tests and the account of the rest.

    Attributes
    ----------
    curves : tuple of PressCurve
        One per chosen cycle, in the order of the recording.
    set_aside : tuple of (str, str)
        Tests that are not used, with the reason.
    n_missing, n_spikes : int
        Samples left out of the tests used.
    notes : tuple of str
        What the user should know.
    """

    curves: tuple[PressCurve, ...]
    set_aside: tuple[tuple[str, str], ...]
    n_missing: int
    n_spikes: int
    notes: tuple[str, ...]


def read_recording(press: Mapping[str, NDArray], settings: StiffnessSettings) -> PressRecording:
    """Clean the tests of a recording, choose their cycles and bring the branches together.

    `press` holds the columns ``test``, ``time_s``, ``displacement_mm``, ``force_N`` and, if known,
    ``temperature_degC``, shape (n,) each; nan where missing. :class:`InputError` if columns are
    missing or no test can be used; every problem is named.
    """
    curves: list[PressCurve] = []
    used: list[PressTest] = []
    notes: list[str] = []
    set_aside: list[tuple[str, str]] = []
    for label, part in read_tests(press).items():
        try:
            test = prepare_test(label, part, settings)
            cycles = find_cycles(test)
            chosen, said = choose_cycles(label, cycles, settings.cycles)
            curves += [press_curve(test, c, settings.segment_length_m, cycles) for c in chosen]
        except InputError as error:
            set_aside.append((label, "; ".join(error.problems)))
            continue
        used.append(test)
        notes += [*test.notes, *said]
    if any(c.unloads for c in curves):
        alone = {c.test for c in curves if not c.unloads}
        set_aside += [(t, f"test {t}: never unloaded, while other tests are") for t in alone]
        notes = [n for n in notes if not any(n.startswith(f"test {t}: ") for t in alone)]
        curves = [c for c in curves if c.unloads]
        used = [t for t in used if t.label not in alone]
    if not curves:
        raise InputError([reason for _, reason in set_aside] or "press recording: no samples")
    notes += [f"set aside: {reason}" for _, reason in set_aside]
    return PressRecording(
        tuple(curves),
        tuple(set_aside),
        sum(t.n_missing for t in used),
        sum(t.n_spikes for t in used),
        merged_notes(notes),
    )


def merged_notes(notes: list[str]) -> tuple[str, ...]:
    """Notes of several tests that say the same, as one note."""
    tests: dict[str, list[str]] = {}
    for note in notes:
        place, colon, text = note.partition(": ")
        if colon and place.startswith("test "):
            tests.setdefault(text, []).append(place.removeprefix("test "))
        else:
            tests.setdefault(note, [])
    return tuple(
        f"test{'s' if len(labels) > 1 else ''} {', '.join(labels)}: {text}" if labels else text
        for text, labels in tests.items()
    )


def press_curve(
    test: PressTest,
    cycle: PressCycle,
    segment_length_m: float,
    cycles: tuple[PressCycle, ...] = (),
) -> PressCurve:
    """Bring the branches of a cycle, one of `cycles` of a cleaned test, to common positions.

    :class:`InputError` if a branch has too few samples in contact.
    """
    # samples near an end are picked by their own noise
    margin = END_MARGIN * test.position_noise_m
    parts = (cycle.loading, cycle.unloading)[: 2 if cycle.complete else 1]
    whole = _branches(test, parts, segment_length_m)
    moving, hold = _without_hold(test, cycle, margin)
    branches = _branches(test, moving[: len(parts)], segment_length_m)
    noise = test.force_noise_N / segment_length_m
    threshold = max(CONTACT_SHARE * cycle.peak_force_N / segment_length_m, 6.0 * noise)
    low = max(_contact_begin(b, threshold) for b in branches) + margin
    high = min(_steady_max(b.position_m) for b in branches) - margin
    counts = [
        int(np.count_nonzero((b.position_m >= low) & (b.position_m <= high))) for b in branches
    ]
    if min(counts) < MIN_BRANCH_SAMPLES:
        found = ", ".join(f"{n} {b.name}" for n, b in zip(counts, branches, strict=True))
        raise InputError(
            f"test {test.label}: cycle {cycle.number}: {found} samples in contact and clear of "
            f"the travel's noise ({test.position_noise_m * 1e6:.2g} µm), "
            f"must be at least {MIN_BRANCH_SAMPLES} of each branch"
        )
    edges = np.linspace(low, high, int(np.clip(min(counts) // 4, MIN_NODES, MAX_NODES)) + 1)
    levels = [_branch_at_nodes(b.position_m, b.force_N_m, edges) for b in branches]
    dissipated, stored = _loop_energies(whole)
    steps = np.diff(test.time_s[np.isfinite(test.time_s)])
    return PressCurve(
        test=test.label,
        cycle=cycle.number,
        n_cycles=max(len(cycles), 1),
        temperature_degC=test.temperature_degC,
        position_m=0.5 * (edges[1:] + edges[:-1]),
        middle_N_m=np.mean(levels, axis=0),
        branches=branches,
        fit_range_m=(low, high),
        touch_m=_contact_begin(branches[0], threshold),
        top_position_m=max(_steady_max(b.position_m) for b in whole),
        top_force_N_m=max(_steady_max(b.force_N_m) for b in whole),
        dissipated_J_m=dissipated,
        stored_J_m=stored,
        sample_interval_s=float(np.median(steps)) if steps.size else float("nan"),
        hold_force_N_m=hold / segment_length_m,
        virgin_share=_virgin_share(test, cycle, cycles),
        free_travel=test.free_travel,
        travel_sign=test.travel_sign,
    )


def _branches(
    test: PressTest, parts: tuple[slice, ...], segment_length_m: float
) -> tuple[BranchSamples, ...]:
    return tuple(
        BranchSamples(name, test.position_m[part], test.force_N[part] / segment_length_m)
        for name, part in zip(("loading", "unloading"), parts, strict=False)
    )


def _without_hold(
    test: PressTest, cycle: PressCycle, margin: float
) -> tuple[tuple[slice, slice], float]:
    """The branches up to and from the top, and the force at the end of a hold there [N].

    A hold belongs to no branch: the force relaxes from the one towards the other. Fewer than
    :data:`MIN_BRANCH_SAMPLES` at the top are a turn and no hold.
    """
    begin, stop = cycle.loading.start, cycle.unloading.stop
    travel = test.travel_m[begin:stop]
    # what the crosshead creeps in a hold is far less than what it travels
    near = max(margin, 2e-3 * float(np.ptp(travel)))
    top = begin + np.flatnonzero(travel >= float(np.max(travel)) - near)
    first, last = int(top[0]), int(top[-1]) + 1
    usual = int(np.count_nonzero(travel[: first - begin] >= float(np.max(travel)) - 3.0 * near))
    if last - first < max(MIN_BRANCH_SAMPLES, 4 * usual):
        return (cycle.loading, cycle.unloading), float("nan")
    tail = test.force_N[max(last - 1 - (last - first) // 8, first) : last]
    return (slice(begin, first + 1), slice(last - 1, stop)), float(np.median(tail))


def _virgin_share(test: PressTest, cycle: PressCycle, cycles: tuple[PressCycle, ...]) -> float:
    """Force of the first loading over that of this cycle at equal position, less one."""
    if len(cycles) < 2 or cycle.number == 1:
        return float("nan")
    ways = [(test.position_m[c.loading], test.force_N[c.loading]) for c in (cycles[0], cycle)]
    low = max(float(x[f > CONTACT_SHARE * cycle.peak_force_N][0]) for x, f in ways)
    high = min(float(np.max(x)) for x, _ in ways)
    at = low + np.linspace(0.3, 0.95, 50) * (high - low)
    first, this = (np.interp(at, np.maximum.accumulate(x), f).sum() for x, f in ways)
    return float(first / this - 1.0)


def _steady_max(x: Array) -> float:
    """Largest value that is no noise: of the running median over a few samples.

    The ends are mirrored without repeating the last sample: there a branch ends with the sample
    that noise made the turning point.
    """
    return float(np.max(median_filter(x, size=min(5, x.size), mode="mirror")))


def _contact_begin(branch: BranchSamples, threshold: float) -> float:
    """Position above which the branch carries more than the threshold [m]."""
    outward = slice(None, None, -1) if branch.name == "loading" else slice(None)
    force, position = branch.force_N_m[outward], branch.position_m[outward]
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

    fit = solve_linear(columns(x), f)
    bins = np.minimum(np.searchsorted(edges, x, side="right") - 1, edges.size - 2)
    count = np.bincount(bins, minlength=edges.size - 1)
    total = np.bincount(bins, weights=fit.residuals, minlength=edges.size - 1)
    nodes = 0.5 * (edges[1:] + edges[:-1])
    filled = count > 0
    rest = np.interp(nodes, nodes[filled], total[filled] / count[filled])
    return columns(nodes) @ fit.parameters + rest


def _loop_energies(branches: tuple[BranchSamples, ...]) -> tuple[float, float]:
    """Work lost in the loop and work of the loading branch [J/m], over their common positions."""
    if len(branches) < 2:
        return float("nan"), float("nan")
    low = max(float(np.min(b.position_m)) for b in branches)
    high = min(float(np.max(b.position_m)) for b in branches)
    work = []
    for b in branches:
        clipped = np.clip(b.position_m, low, high)
        work.append(abs(float(np.trapezoid(b.force_N_m, clipped))))
    return work[0] - work[1], work[0]


def thinned_branches(curve: PressCurve, offset_m: float) -> tuple[Branch, ...]:
    """Branches over the penetration from `offset_m` [m], at most some hundred points each."""
    thinned = []
    for b in curve.branches:
        n = b.position_m.size
        starts = np.linspace(0, n, min(PLOT_POINTS, n) + 1).astype(int)[:-1]
        sizes = np.diff(np.append(starts, n))
        thinned.append(
            Branch(
                test=curve.test,
                temperature_degC=curve.temperature_degC,
                cycle=curve.cycle,
                branch=b.name,
                penetration_m=np.add.reduceat(b.position_m, starts) / sizes - offset_m,
                line_force_N_m=np.add.reduceat(b.force_N_m, starts) / sizes,
            )
        )
    return tuple(thinned)
