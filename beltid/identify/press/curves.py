"""Branches of a press cycle and the curve midway between them.

Hysteresis of the belt raises the loading branch and lowers the unloading branch. The elastic law of
Eq. (3) is the curve midway between them *at equal penetration*. Both branches are interpolated to
common positions first, so that the slower branch, which has more samples, does not get more weight.
Where the crosshead reverses, the new branch starts on the old one, because internal friction of the
rubber and backlash of the machine need some travel to reverse. There the curve is the branch before
the reversal, corrected by half the loop width found farther away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from beltid.errors import InputError
from beltid.identify.estimators.least_squares import solve_linear
from beltid.identify.estimators.statistics import integrated_autocorrelation_time
from beltid.identify.press.recording import (
    COLUMNS,
    PressCycle,
    PressTest,
    StiffnessSettings,
    choose_cycles,
    prepare_test,
)

Array = NDArray[np.float64]

CONTACT_SHARE = 0.01
"""Share of the largest force, on both branches, at which the fit begins: below it, ribs seat one by
one and the belt may stick to the plate or stay compressed."""
RATE_SPAN = 2.0
"""Ratio of speeds from which the rate dependence of force and loss can be determined."""
MIN_BRANCH_SAMPLES = 8  # minimum per branch within the range of the fit
TURN_SHARE = 0.3  # largest share of the nodes that a crosshead reversal may affect
LEAST_TURN = 2.0e-3  # share of the largest force below which a reversal is negligible
FEWEST_NODES = 12  # minimum number of nodes to find the reach of a reversal


NAMES = ("loading", "unloading")


@dataclass(frozen=True, slots=True)
class BranchSamples:
    """Samples of one branch, one of `NAMES`: positions [m], line forces [N/m], (n,)."""

    name: str
    position_m: Array
    force_N_m: Array

    def between(self, low_m: float, high_m: float) -> BranchSamples:
        """Return the samples within a range of positions."""
        inside = (self.position_m >= low_m) & (self.position_m <= high_m)
        return BranchSamples(self.name, self.position_m[inside], self.force_N_m[inside])


@dataclass(frozen=True, slots=True, eq=False)
class PressCurve:
    """Branches of one cycle at common positions; forces per length of belt."""

    recorded: PressTest
    cycle: int
    position_m: Array  # common positions without machine compliance, shape (m,)
    middle_N_m: Array  # midway between the branches, shape (m,)
    turn_N_m: Array  # its change with another loop width near reversals, else 0, (m,)
    branches: tuple[BranchSamples, ...]  # loading, and unloading if recorded; holds removed
    fitted: tuple[BranchSamples, ...]  # their samples within the range of the fit
    touch_m: float  # position where the loading branch begins to carry force
    top_position_m: float  # largest position in the cycle
    top_force_N_m: float
    dissipated_J_m: float  # work lost in the loop, nan if never unloaded
    stored_J_m: float  # work of the loading branch, nan if never unloaded
    hold_force_N_m: float  # at the end of a hold at the top; nan without a hold
    virgin_share: float  # force of the first cycle over that of this one, minus 1; or nan
    drift_N_m: float  # drift of the zero halfway through the cycle; 0 if none is seen

    @property
    def test(self) -> str:
        """Label of the test."""
        return self.recorded.label

    @property
    def unloads(self) -> bool:
        """True if both branches were recorded."""
        return len(self.branches) == 2


@dataclass(frozen=True, slots=True)
class PressRecording:
    """Curves of the usable tests, one per selected cycle, and what was rejected."""

    curves: tuple[PressCurve, ...]
    set_aside: tuple[tuple[str, str], ...]  # rejected tests, with the reason
    n_missing: int  # samples removed from the tests used
    n_spikes: int
    notes: tuple[str, ...]


def read_recording(press: Mapping[str, NDArray], settings: StiffnessSettings) -> PressRecording:
    """Clean the tests of a recording, select their cycles and build the curves.

    `press` holds the columns ``test``, ``time_s``, ``displacement_mm``, ``force_N`` and, if known,
    ``temperature_degC``, shape (n,) each, checked when they were read; nan where missing. Raises
    :class:`InputError`, with all problems, if no test can be used.
    """
    labels = np.asarray(press["test"]).astype(str)
    unknown = {"temperature_degC": np.full(labels.size, np.nan)}
    columns = {name: np.asarray({**unknown, **press}[name], dtype=float) for name in COLUMNS}
    curves: list[PressCurve] = []
    notes: dict[str, tuple[str, ...]] = {}
    set_aside: list[tuple[str, str]] = []
    for label in dict.fromkeys(labels.tolist()):
        part = {name: values[labels == label] for name, values in columns.items()}
        try:
            test = prepare_test(label, part, settings)
            chosen, cycle_notes = choose_cycles(test.cycles, settings.cycles)
            curves += [press_curve(test, c, settings.segment_length_m) for c in chosen]
        except InputError as error:
            set_aside.append((label, "; ".join(f"test {label}: {p}" for p in error.problems)))
            continue
        notes[label] = (*test.notes, *cycle_notes, *_speeds_note(test, chosen))
    if any(c.unloads for c in curves):
        loading_only = dict.fromkeys(c.test for c in curves if not c.unloads)
        set_aside += [(t, f"test {t}: never unloaded, while other tests are") for t in loading_only]
        curves = [c for c in curves if c.unloads]
    if not curves:
        raise InputError([reason for _, reason in set_aside] or "press recording: no samples")
    used = {c.test: c.recorded for c in curves}
    tests_by_note: dict[str, list[str]] = {}
    for label in used:
        for text in notes[label]:
            tests_by_note.setdefault(text, []).append(label)
    return PressRecording(
        curves=tuple(curves),
        set_aside=tuple(set_aside),
        n_missing=sum(test.n_missing for test in used.values()),
        n_spikes=sum(test.n_spikes for test in used.values()),
        notes=(
            *(
                f"test{'s' if len(tests) > 1 else ''} {', '.join(tests)}: {text}"
                for text, tests in tests_by_note.items()
            ),
            *(f"set aside: {reason}" for _, reason in set_aside),
        ),
    )


def _speeds_note(test: PressTest, chosen: Sequence[PressCycle]) -> tuple[str, ...]:
    """Note a test whose cycles differ in speed although the selected ones do not."""

    def ratio(group: Sequence[PressCycle]) -> float:
        """Return the ratio of the largest to the smallest speed."""
        steps = [float(np.median(np.diff(test.travel_m[c.loading]))) for c in group]
        return max(steps) / min(steps) if min(steps) > 0.0 else 1.0

    if ratio(test.cycles) < RATE_SPAN or ratio(chosen) >= RATE_SPAN:
        return ()
    return (
        f"its cycles were pressed at speeds up to {ratio(test.cycles):.2g} times apart, but those "
        "used at one speed: to see the effect of speed, set press.cycles: all, or press tests at "
        "two speeds",
    )


def press_curve(test: PressTest, cycle: PressCycle, segment_length_m: float) -> PressCurve:
    """Build the curve of one cycle of a cleaned test.

    Raises :class:`InputError` if a branch has too few samples in contact.
    """
    # stay five standard deviations off the ends, where noise decides which samples belong
    margin = 5.0 * test.position_noise_m
    ways, hold_N = _without_hold(test, cycle, margin)
    whole, branches = (
        tuple(
            BranchSamples(name, test.position_m[part], test.force_N[part] / segment_length_m)
            for name, part in zip(NAMES[: 1 + cycle.complete], parts, strict=False)
        )
        for parts in ((cycle.loading, cycle.unloading), ways)
    )
    noise = test.force_noise_N / segment_length_m
    threshold = max(CONTACT_SHARE * cycle.peak_force_N / segment_length_m, 6.0 * noise)
    low = max(_contact_begin(b, threshold) for b in branches) + margin
    high = min(_steady_max(b.position_m) for b in branches) - margin
    fitted = tuple(b.between(low, high) for b in branches)
    fewest = min(b.position_m.size for b in fitted)
    if fewest < MIN_BRANCH_SAMPLES:
        counts = ", ".join(f"{b.position_m.size} {b.name}" for b in fitted)
        raise InputError(
            f"cycle {cycle.number}: {counts} samples in contact and beyond the noise of the travel "
            f"({test.position_noise_m * 1e6:.2g} µm), must be at least {MIN_BRANCH_SAMPLES} per "
            "branch"
        )
    edges = np.linspace(low, high, int(np.clip(fewest // 4, 6, 120)) + 1)
    nodes = 0.5 * (edges[1:] + edges[:-1])
    levels = [_branch_at_nodes(b.position_m, b.force_N_m, edges) for b in fitted]
    in_contact = bool(np.min(branches[0].force_N_m) >= threshold)
    middle, turn = _middle(nodes, levels, turns_in_contact=in_contact)
    dissipated, stored = _loop_energies(whole)
    halfway = 0.5 * (cycle.loading.start + cycle.unloading.stop)
    return PressCurve(
        recorded=test,
        cycle=cycle.number,
        position_m=nodes,
        middle_N_m=middle,
        turn_N_m=turn,
        branches=branches,
        fitted=fitted,
        touch_m=_contact_begin(branches[0], threshold),
        top_position_m=max(_steady_max(b.position_m) for b in whole),
        top_force_N_m=max(_steady_max(b.force_N_m) for b in whole),
        dissipated_J_m=dissipated,
        stored_J_m=stored,
        hold_force_N_m=hold_N / segment_length_m,
        virgin_share=_virgin_share(test, cycle),
        drift_N_m=test.drift_N / segment_length_m * halfway / test.force_N.size,
    )


def _without_hold(
    test: PressTest, cycle: PressCycle, margin: float
) -> tuple[tuple[slice, slice], float]:
    """Remove a hold at the top; return both branches and the force at the end of the hold [N].

    A hold belongs to neither branch: the force relaxes from one towards the other. Fewer than
    :data:`MIN_BRANCH_SAMPLES` samples at the top are a reversal, not a hold.
    """
    begin, stop = cycle.loading.start, cycle.unloading.stop
    travel = test.travel_m[begin:stop]
    # the crosshead creeps in a hold, but far less than it travels
    near = max(margin, 2e-3 * float(np.ptp(travel)))
    top = begin + np.flatnonzero(travel >= float(np.max(travel)) - near)
    first, last = int(top[0]), int(top[-1]) + 1
    usual = int(np.count_nonzero(travel[: first - begin] >= float(np.max(travel)) - 3.0 * near))
    if last - first < max(MIN_BRANCH_SAMPLES, 4 * usual):
        return (cycle.loading, cycle.unloading), float("nan")
    tail = test.force_N[max(last - 1 - (last - first) // 8, first) : last]
    return (slice(begin, first + 1), slice(last - 1, stop)), float(np.median(tail))


def _virgin_share(test: PressTest, cycle: PressCycle) -> float:
    """Return the force of the first loading over that of this cycle at equal position, minus 1."""
    if len(test.cycles) < 2 or cycle.number == 1:
        return float("nan")
    loadings = [
        (test.position_m[c.loading], test.force_N[c.loading]) for c in (test.cycles[0], cycle)
    ]
    low = max(float(x[f > CONTACT_SHARE * cycle.peak_force_N][0]) for x, f in loadings)
    high = min(float(np.max(x)) for x, _ in loadings)
    at = low + np.linspace(0.3, 0.95, 50) * (high - low)
    first, this = (np.interp(at, np.maximum.accumulate(x), f).sum() for x, f in loadings)
    return float(first / this - 1.0)


def _steady_max(x: Array) -> float:
    """Return the largest value of a short running median, so that noise does not count."""
    # mirror without repeating the last sample, which may be the reversal because of noise
    return float(np.max(median_filter(x, size=min(5, x.size), mode="mirror")))


def _contact_begin(branch: BranchSamples, threshold: float) -> float:
    """Return the position above which the branch carries more than the threshold [m]."""
    # walk from the peak towards the open plate
    outward = slice(None, None, -1) if branch.name == "loading" else slice(None)
    force, position = branch.force_N_m[outward], branch.position_m[outward]
    start = int(np.argmax(force))
    below = np.flatnonzero(force[start:] < threshold)
    return float(position[start + int(below[0])]) if below.size else -_steady_max(-position)


def _branch_at_nodes(x: Array, f: Array, edges: Array) -> Array:
    """Interpolate the force f of a branch to the centres of the bins [N/m], shape (m,).

    A polynomial follows the shape of the branch, so that the distribution of samples within a bin
    does not matter. The bin means of its residuals are added, so that it need not be exact.
    """
    centre, half = 0.5 * (edges[0] + edges[-1]), 0.5 * (edges[-1] - edges[0])
    degree = 5 if x.size >= 24 else 3
    nodes = 0.5 * (edges[1:] + edges[:-1])
    at_samples, at_nodes = (chebvander((at - centre) / half, degree) for at in (x, nodes))
    fit = solve_linear(at_samples, f)
    filled, bins, count = np.unique(
        np.digitize(x, edges[1:-1]), return_inverse=True, return_counts=True
    )
    rest = np.bincount(bins, weights=fit.residuals) / count
    return at_nodes @ fit.parameters + np.interp(nodes, nodes[filled], rest)


def _middle(x: Array, levels: Sequence[Array], *, turns_in_contact: bool) -> tuple[Array, Array]:
    """Return the force midway between the branches [N/m], and its change with another loop width.

    The reach of a reversal is chosen for the smallest residuals about a cubic polynomial, if the
    gain justifies the additional unknowns (BIC). Within the reach, half the loop width is a
    parabola in x fitted to the other nodes. The alternative width is that next to the reach, scaled
    with the force. The loading branch begins with a reversal only if the belt was not released
    before (`turns_in_contact`).
    """
    n, plain = x.size, np.mean(levels, axis=0)
    if n < FEWEST_NODES or len(levels) == 1:
        return plain, np.zeros(n)
    loading, unloading = levels
    scaled = (x - x[0]) / (x[-1] - x[0])
    smooth, powers = np.linalg.qr(np.vander(scaled, 4))[0], np.vander(scaled, 3)
    half_width = 0.5 * (loading - unloading)

    def trial(low: int, top: int) -> tuple[Array, Array]:
        """Return the middle and its residuals if the reversals affect these end nodes."""
        rest = slice(low, n - top)
        parabola = powers @ np.linalg.lstsq(powers[rest], half_width[rest], rcond=None)[0]
        parts = unloading[:low] + parabola[:low], plain[rest], (loading - parabola)[n - top :]
        middle = np.concatenate(parts)
        return middle, middle - smooth @ (smooth.T @ middle)

    reach = range(int(TURN_SHARE * n) + 1)
    trials = {(a, b): trial(a, b) for a in reach[: None if turns_in_contact else 1] for b in reach}
    (low, top), (middle, residuals) = min(trials.items(), key=lambda t: float(t[1][1] @ t[1][1]))
    m = n / integrated_autocorrelation_time(residuals)
    floor = n * (1e-10 * float(np.max(plain))) ** 2  # rounding
    before, after = (max(float(r @ r), floor) for r in (trials[0, 0][1], residuals))
    gain = m * np.log(before / after) - 2.0 * ((low > 0) + (top > 0)) * np.log(m)
    if gain <= 0.0 or np.max(np.abs(middle - plain)) < LEAST_TURN * np.max(plain):
        return plain, np.zeros(n)
    share = half_width / plain
    nearest = (
        float(np.mean(share[low : 2 * low + 2])),
        float(np.mean(share[-2 * top - 2 : n - top])),
    )
    other = middle.copy()
    other[:low] = unloading[:low] / (1.0 - nearest[0])
    other[n - top :] = loading[n - top :] / (1.0 + nearest[1])
    # limit the change to the effect of the reversal itself
    return middle, np.clip(other - middle, -np.abs(middle - plain), np.abs(middle - plain))


def _loop_energies(branches: tuple[BranchSamples, ...]) -> tuple[float, float]:
    """Return the work lost in the loop and the work of loading [J/m] over common positions."""
    if len(branches) < 2:
        return float("nan"), float("nan")
    low = max(float(np.min(b.position_m)) for b in branches)
    high = min(float(np.max(b.position_m)) for b in branches)
    up, down = (
        abs(float(np.trapezoid(b.force_N_m, np.clip(b.position_m, low, high)))) for b in branches
    )
    return up - down, up
