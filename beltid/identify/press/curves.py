"""The branches of a press cycle and the curve half-way between them.

The belt's hysteresis lifts the loading branch and lowers the unloading branch. The elastic law of
Eq. (3) is the curve half-way between them *at equal penetration*. Both branches are brought to
common positions first: whichever of them the crosshead passes more slowly has more samples, but
not more weight. Where the crosshead turns, the branch after the turn begins on the one before it
(friction within the rubber and lost motion of the machine turn round over some way): there the
curve is the branch before the turn less the width that the loop has farther away from it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from beltid.errors import InputError
from beltid.identify.estimators.least_squares import solve_linear
from beltid.identify.estimators.statistics import integrated_autocorrelation_time
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
RATE_SPAN = 2.0
"""Cycles whose speeds differ by this factor tell how force and loss depend on the rate."""
MIN_BRANCH_SAMPLES = 8  # fewest of a branch within the range of the fit
TURN_SHARE = 0.3  # most of the nodes that a turn of the crosshead may reach to
LEAST_TURN = 2.0e-3  # share of the largest force below which a turn does nothing
FEWEST_NODES = 12  # that tell how far a turn reaches


@dataclass(frozen=True, slots=True)
class BranchSamples:
    """Samples of one branch: "loading" or "unloading", positions [m], line forces [N/m], (n,)."""

    name: str
    position_m: Array
    force_N_m: Array


@dataclass(frozen=True, slots=True, eq=False)
class PressCurve:
    """The branches of one cycle at common positions; forces per length of belt."""

    test: str
    cycle: int
    n_cycles: int  # of the test
    temperature_degC: float  # nan if unknown
    position_m: Array  # common positions, machine compliance taken off, shape (m,)
    middle_N_m: Array  # half-way between the branches, shape (m,)
    turn_N_m: Array  # what another width of the loop would add to it near a turn, else 0, (m,)
    branches: tuple[BranchSamples, ...]  # loading, and unloading if recorded; without a hold
    fit_range_m: tuple[float, float]
    touch_m: float  # position from which the loading branch carries force
    top_position_m: float  # largest of the cycle
    top_force_N_m: float
    dissipated_J_m: float  # work lost in the loop, nan if never unloaded
    stored_J_m: float  # work of the loading branch, nan if never unloaded
    sample_interval_s: float  # 0 or nan if the clock does not run
    hold_force_N_m: float  # at the end of a hold at the top, nan without one
    virgin_share: float  # force of the first cycle over that of this one, less one; or nan
    free_travel: bool  # whether the zero of the load cell could be checked before contact
    drift_N_m: float  # what the zero has drifted by half-way through the cycle, 0 if not seen
    travel_sign: float  # of the recorded crosshead travel in compression

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
    """Curves of the usable tests, one per chosen cycle, and the account of the rest."""

    curves: tuple[PressCurve, ...]
    set_aside: tuple[tuple[str, str], ...]  # tests that are not used, with the reason
    n_missing: int  # samples left out of the tests used
    n_spikes: int
    notes: tuple[str, ...]


def read_recording(press: Mapping[str, NDArray], settings: StiffnessSettings) -> PressRecording:
    """Clean the tests of a recording, choose their cycles and bring the branches together.

    `press` holds the columns ``test``, ``time_s``, ``displacement_mm``, ``force_N`` and, if known,
    ``temperature_degC``, shape (n,) each; nan where missing. :class:`InputError` if columns are
    missing or no test can be used; every problem is named.
    """
    used: list[tuple[PressTest, list[PressCurve], tuple[str, ...]]] = []
    set_aside: list[tuple[str, str]] = []
    for label, part in read_tests(press).items():
        try:
            test = prepare_test(label, part, settings)
            cycles = find_cycles(test)
            chosen, about_cycles = choose_cycles(cycles, settings.cycles)
            found = [press_curve(test, c, settings.segment_length_m, cycles) for c in chosen]
        except InputError as error:
            set_aside.append((label, "; ".join(error.problems)))
            continue
        speeds = _speeds_note(test, cycles, chosen)
        used.append((test, found, (*test.notes, *about_cycles, *speeds)))
    unloaded = [entry for entry in used if entry[1][0].unloads]
    if unloaded:
        alone = [test.label for test, found, _ in used if not found[0].unloads]
        set_aside += [(t, f"test {t}: never unloaded, while other tests are") for t in alone]
        used = unloaded
    if not used:
        raise InputError([reason for _, reason in set_aside] or "press recording: no samples")
    labels: dict[str, list[str]] = {}
    for test, _, texts in used:
        for text in texts:
            labels.setdefault(text, []).append(test.label)
    notes = [
        f"test{'s' if len(tests) > 1 else ''} {', '.join(tests)}: {text}"
        for text, tests in labels.items()
    ]
    return PressRecording(
        curves=tuple(curve for _, found, _ in used for curve in found),
        set_aside=tuple(set_aside),
        n_missing=sum(test.n_missing for test, _, _ in used),
        n_spikes=sum(test.n_spikes for test, _, _ in used),
        notes=(*notes, *(f"set aside: {reason}" for _, reason in set_aside)),
    )


def _speeds_note(
    test: PressTest, cycles: Sequence[PressCycle], chosen: Sequence[PressCycle]
) -> tuple[str, ...]:
    """A note if the cycles of a test differ in speed and those chosen do not."""

    def ratio(some: Sequence[PressCycle]) -> float:
        steps = [float(np.median(np.diff(test.travel_m[c.loading]))) for c in some]
        return max(steps) / min(steps) if min(steps) > 0.0 else 1.0

    if ratio(cycles) < RATE_SPAN or ratio(chosen) >= RATE_SPAN:
        return ()
    return (
        f"its cycles were pressed at speeds up to {ratio(cycles):.2g} times apart, those used at "
        "one: what the speed does is told by press.cycles: all, or by tests at two speeds",
    )


def press_curve(
    test: PressTest, cycle: PressCycle, segment_length_m: float, cycles: Sequence[PressCycle] = ()
) -> PressCurve:
    """Bring the branches of a cycle, one of `cycles` of a cleaned test, to common positions.

    :class:`InputError` if a branch has too few samples in contact.
    """
    # five standard deviations clear of the ends, where samples are picked by their own noise
    margin = 5.0 * test.position_noise_m
    parts, hold = _without_hold(test, cycle, margin)
    whole, branches = (
        tuple(
            BranchSamples(name, test.position_m[part], test.force_N[part] / segment_length_m)
            for name, part in zip(
                ("loading", "unloading")[: 1 + cycle.complete], ways, strict=False
            )
        )
        for ways in ((cycle.loading, cycle.unloading), parts)
    )
    noise = test.force_noise_N / segment_length_m
    threshold = max(CONTACT_SHARE * cycle.peak_force_N / segment_length_m, 6.0 * noise)
    low = max(_contact_begin(b, threshold) for b in branches) + margin
    high = min(_steady_max(b.position_m) for b in branches) - margin
    counts = [int(np.sum((b.position_m >= low) & (b.position_m <= high))) for b in branches]
    _require_enough(counts, test, cycle)
    edges = np.linspace(low, high, int(np.clip(min(counts) // 4, 6, 120)) + 1)
    nodes = 0.5 * (edges[1:] + edges[:-1])
    levels = [_branch_at_nodes(b.position_m, b.force_N_m, edges) for b in branches]
    in_contact = bool(np.min(branches[0].force_N_m) >= threshold)
    middle, turn = _middle(nodes, levels, turns_in_contact=in_contact)
    dissipated, stored = _loop_energies(whole)
    steps = np.diff(test.time_s[np.isfinite(test.time_s)])
    half_way = 0.5 * (cycle.loading.start + cycle.unloading.stop)
    return PressCurve(
        test=test.label,
        cycle=cycle.number,
        n_cycles=max(len(cycles), 1),
        temperature_degC=test.temperature_degC,
        position_m=nodes,
        middle_N_m=middle,
        turn_N_m=turn,
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
        drift_N_m=test.drift_N / segment_length_m * half_way / test.force_N.size,
        travel_sign=test.travel_sign,
    )


def _require_enough(counts: Sequence[int], test: PressTest, cycle: PressCycle) -> None:
    if min(counts) < MIN_BRANCH_SAMPLES:
        names = ("loading", "unloading")[: len(counts)]
        found = ", ".join(f"{n} {name}" for n, name in zip(counts, names, strict=True))
        raise InputError(
            f"test {test.label}: cycle {cycle.number}: {found} samples in contact and clear of "
            f"the travel's noise ({test.position_noise_m * 1e6:.2g} µm), "
            f"must be at least {MIN_BRANCH_SAMPLES} of each branch"
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


def _virgin_share(test: PressTest, cycle: PressCycle, cycles: Sequence[PressCycle]) -> float:
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
    """Largest value that is no noise: of the running median over a few samples."""
    # mirrored without repeating the last sample, which noise made the turning point
    return float(np.max(median_filter(x, size=min(5, x.size), mode="mirror")))


def _contact_begin(branch: BranchSamples, threshold: float) -> float:
    """Position above which the branch carries more than the threshold [m]."""
    # walk from the peak towards the open plate
    outward = slice(None, None, -1) if branch.name == "loading" else slice(None)
    force, position = branch.force_N_m[outward], branch.position_m[outward]
    start = int(np.argmax(force))
    below = np.flatnonzero(force[start:] < threshold)
    return float(position[start + int(below[0])]) if below.size else -_steady_max(-position)


def _branch_at_nodes(position: Array, force: Array, edges: Array) -> Array:
    """Force of a branch at the middles of the bins [N/m], shape (m,).

    A polynomial takes the shape of the branch, so that the place of the samples within a bin does
    not matter; the bin means of what it leaves are added, so that it need not be exact.
    """
    inside = (position >= edges[0]) & (position <= edges[-1])
    x, f = position[inside], force[inside]
    centre, half = 0.5 * (edges[0] + edges[-1]), 0.5 * (edges[-1] - edges[0])
    degree = 5 if x.size >= 24 else 3
    nodes = 0.5 * (edges[1:] + edges[:-1])
    columns, at_nodes = (
        np.polynomial.chebyshev.chebvander((at - centre) / half, degree) for at in (x, nodes)
    )
    fit = solve_linear(columns, f)
    bins = np.minimum(np.searchsorted(edges, x, side="right") - 1, nodes.size - 1)
    count = np.bincount(bins, minlength=nodes.size)
    total = np.bincount(bins, weights=fit.residuals, minlength=nodes.size)
    filled = count > 0
    rest = np.interp(nodes, nodes[filled], total[filled] / count[filled])
    return at_nodes @ fit.parameters + rest


def _middle(x: Array, levels: Sequence[Array], *, turns_in_contact: bool) -> tuple[Array, Array]:
    """Force half-way between the branches [N/m], and what another width near the turns would add.

    How far a turn reaches is what leaves least about a cubic polynomial, if that is worth the two
    unknowns (BIC); where it reaches to, half the width is the parabola in x of the other nodes. The
    other width is the one next to these nodes, in proportion to the force. The loading branch
    begins with a turn only if the belt was not released before, `turns_in_contact`.
    """
    n, plain = x.size, np.mean(levels, axis=0)
    if n < FEWEST_NODES or len(levels) == 1:
        return plain, np.zeros(n)
    loading, unloading = levels
    scaled = (x - x[0]) / (x[-1] - x[0])
    smooth, powers = np.linalg.qr(np.vander(scaled, 4))[0], np.vander(scaled, 3)
    half_width = 0.5 * (loading - unloading)

    def tried(low: int, top: int) -> tuple[Array, Array]:
        """Middle and what it leaves about the polynomial, if the turns reach over these nodes."""
        rest = slice(low, n - top)
        parabola = powers @ np.linalg.lstsq(powers[rest], half_width[rest], rcond=None)[0]
        parts = unloading[:low] + parabola[:low], plain[rest], (loading - parabola)[n - top :]
        middle = np.concatenate(parts)
        return middle, middle - smooth @ (smooth.T @ middle)

    reach = range(int(TURN_SHARE * n) + 1)
    trials = {(a, b): tried(a, b) for a in reach[: None if turns_in_contact else 1] for b in reach}
    (low, top), (middle, left) = min(trials.items(), key=lambda t: float(t[1][1] @ t[1][1]))
    m = n / integrated_autocorrelation_time(left)
    floor = n * (1e-10 * float(np.max(plain))) ** 2  # of rounding
    before, after = (max(float(r @ r), floor) for r in (trials[0, 0][1], left))
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
    # no more than the turn itself does
    return middle, np.clip(other - middle, -np.abs(middle - plain), np.abs(middle - plain))


def _loop_energies(branches: tuple[BranchSamples, ...]) -> tuple[float, float]:
    """Work lost in the loop and work of the loading branch [J/m], over their common positions."""
    if len(branches) < 2:
        return float("nan"), float("nan")
    low = max(float(np.min(b.position_m)) for b in branches)
    high = min(float(np.max(b.position_m)) for b in branches)
    up, down = (
        abs(float(np.trapezoid(b.force_N_m, np.clip(b.position_m, low, high)))) for b in branches
    )
    return up - down, up
