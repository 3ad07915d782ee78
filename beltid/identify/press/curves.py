"""Branches of a press cycle and the curve midway between them.

Hysteresis of the belt raises the loading branch and lowers the unloading branch by as much, so the
elastic law of Eq. (3) is the curve midway between them *at equal penetration*. Both branches are
interpolated to common positions first, so that the slower branch, which has more samples, does not
get more weight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from beltid.errors import InputError
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
MIN_BRANCH_SAMPLES = 8  # minimum per branch within the range of the fit
MOST_NODES = 40  # per curve
TURN_SHARE = 0.3  # share of the travel that a reversal of the crosshead may affect


NAMES = ("loading", "unloading")


@dataclass(frozen=True, slots=True)
class BranchSamples:
    """Samples of one branch, one of `NAMES`: positions [m], line forces [N/m], (n,)."""

    name: str
    position_m: Array
    force_N_m: Array


@dataclass(frozen=True, slots=True, eq=False)
class PressCurve:
    """Branches of one cycle at common positions; forces per length of belt."""

    recorded: PressTest
    cycle: int
    position_m: Array  # common positions without machine compliance, shape (m,)
    middle_N_m: Array  # midway between the branches, shape (m,)
    turn_N_m: Array  # too much in it if the branches separate gradually at a reversal, (m,)
    branches: tuple[BranchSamples, ...]  # loading, and unloading if recorded; holds removed
    fitted: tuple[BranchSamples, ...]  # their samples within the range of the fit
    touch_m: float  # position where the loading branch begins to carry force
    top_position_m: float  # largest position in the cycle
    top_force_N_m: float
    dissipated_J_m: float  # work lost in the loop, nan if never unloaded
    stored_J_m: float  # work of the loading branch, nan if never unloaded
    zero_u_N_m: float  # standard uncertainty of the zero of the load cell

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

    `press` holds the columns ``test``, ``displacement_mm``, ``force_N`` and, if known,
    ``temperature_degC``, shape (n,) each, checked when they were read; nan where missing. Raises
    :class:`InputError`, with all problems, if no test can be used.
    """
    labels = np.asarray(press["test"]).astype(str)
    unknown = {"temperature_degC": np.full(labels.size, np.nan)}
    columns = {name: np.asarray({**unknown, **press}[name], dtype=float) for name in COLUMNS}
    curves: list[PressCurve] = []
    notes: list[str] = []
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
        notes += [f"test {label}: {text}" for text in (*test.notes, *cycle_notes)]
    if any(c.unloads for c in curves):
        loading_only = dict.fromkeys(c.test for c in curves if not c.unloads)
        set_aside += [(t, f"test {t}: never unloaded, while other tests are") for t in loading_only]
        curves = [c for c in curves if c.unloads]
    if not curves:
        raise InputError([reason for _, reason in set_aside] or "press recording: no samples")
    used = {c.test: c.recorded for c in curves}
    return PressRecording(
        curves=tuple(curves),
        set_aside=tuple(set_aside),
        n_missing=sum(test.n_missing for test in used.values()),
        n_spikes=sum(test.n_spikes for test in used.values()),
        notes=(*notes, *(f"set aside: {reason}" for _, reason in set_aside)),
    )


def press_curve(test: PressTest, cycle: PressCycle, segment_length_m: float) -> PressCurve:
    """Build the curve of one cycle of a cleaned test.

    Raises :class:`InputError` if a branch has too few samples in contact.
    """
    # stay five standard deviations off the ends, where noise decides which samples belong
    margin = 5.0 * test.position_noise_m
    whole, branches = (
        tuple(
            BranchSamples(name, test.position_m[part], test.force_N[part] / segment_length_m)
            for name, part in zip(NAMES[: 1 + cycle.complete], parts, strict=False)
        )
        for parts in ((cycle.loading, cycle.unloading), _without_hold(test, cycle, margin))
    )
    noise = test.force_noise_N / segment_length_m
    threshold = max(CONTACT_SHARE * cycle.peak_force_N / segment_length_m, 6.0 * noise)
    low = max(_contact_begin(b, threshold) for b in branches) + margin
    high = min(_steady_max(b.position_m) for b in branches) - margin
    inside = [(b.position_m >= low) & (b.position_m <= high) for b in branches]
    fitted = tuple(
        BranchSamples(b.name, b.position_m[k], b.force_N_m[k])
        for b, k in zip(branches, inside, strict=True)
    )
    fewest = min(b.position_m.size for b in fitted)
    if fewest < MIN_BRANCH_SAMPLES:
        counts = ", ".join(f"{b.position_m.size} {b.name}" for b in fitted)
        raise InputError(
            f"cycle {cycle.number}: {counts} samples in contact and beyond the noise of the travel "
            f"({test.position_noise_m * 1e6:.2g} µm), must be at least {MIN_BRANCH_SAMPLES} per "
            "branch"
        )
    edges = np.linspace(low, high, int(np.clip(fewest // 4, 6, MOST_NODES)) + 1)
    levels = [_branch_at_nodes(b.position_m, b.force_N_m, edges) for b in fitted]
    dissipated, stored = _loop_energies(whole)
    return PressCurve(
        recorded=test,
        cycle=cycle.number,
        position_m=0.5 * (edges[1:] + edges[:-1]),
        middle_N_m=np.mean(levels, axis=0),
        turn_N_m=_turns(levels, bool(np.min(branches[0].force_N_m) >= threshold)),
        branches=branches,
        fitted=fitted,
        touch_m=_contact_begin(branches[0], threshold),
        top_position_m=max(_steady_max(b.position_m) for b in whole),
        top_force_N_m=max(_steady_max(b.force_N_m) for b in whole),
        dissipated_J_m=dissipated,
        stored_J_m=stored,
        zero_u_N_m=test.zero_u_N / segment_length_m,
    )


def _without_hold(test: PressTest, cycle: PressCycle, margin: float) -> tuple[slice, slice]:
    """Return both branches without a hold at the top, where the force relaxes."""
    begin, stop = cycle.loading.start, cycle.unloading.stop
    travel = test.travel_m[begin:stop]
    # the crosshead creeps in a hold, but far less than it travels
    near = max(margin, 2e-3 * float(np.ptp(travel)))
    top = begin + np.flatnonzero(travel >= float(np.max(travel)) - near)
    first, last = int(top[0]), int(top[-1]) + 1
    usual = int(np.count_nonzero(travel[: first - begin] >= float(np.max(travel)) - 3.0 * near))
    if last - first < max(MIN_BRANCH_SAMPLES, 4 * usual):
        return cycle.loading, cycle.unloading
    return slice(begin, first + 1), slice(last - 1, stop)


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
    """Interpolate the force f of a branch to the centres of the bins [N/m], shape (m,)."""
    smooth = np.polynomial.Chebyshev.fit(x, f, 5 if x.size >= 24 else 3)
    nodes = 0.5 * (edges[1:] + edges[:-1])
    filled, bins, count = np.unique(
        np.digitize(x, edges[1:-1]), return_inverse=True, return_counts=True
    )
    rest = np.bincount(bins, weights=f - smooth(x)) / count
    return smooth(nodes) + np.interp(nodes, nodes[filled], rest)


def _turns(levels: Sequence[Array], in_contact: bool) -> Array:
    """Return what a reversal of the crosshead adds to the middle [N/m], shape (m,)."""
    if len(levels) == 1:
        return np.zeros(levels[0].size)
    s, half = np.linspace(0.0, 1.0, levels[0].size), 0.5 * (levels[0] - levels[1])
    low = (s < TURN_SHARE) & in_contact
    turns = (s > 1.0 - TURN_SHARE) | low
    for _ in range(2):
        missing = np.polynomial.Polynomial.fit(s[~turns], half[~turns], 2)(s) - half
        turns &= missing > 4.0 * np.std(missing[~turns])
    return np.where(turns, np.where(low, -missing, missing), 0.0)


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
