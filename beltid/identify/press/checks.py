"""What a press recording shows beside its scatter, and what it cannot show: one table of checks.

Every check looks at a fitted law and gives its findings: what was found, in words; its number; and
what it adds to the uncertainty. That is either changes of (k_linear, k_quadratic) by one standard
deviation, which enter the standard errors, or, where no recording of this kind can show more, the
number itself, which enters the combined uncertainty only.

====================  ================================================  ==========================
Check                 What it looks for                                 Size of the error
====================  ================================================  ==========================
size                  travel and force of no ribbed belt                none: a unit is wrong
coefficient at zero   a coefficient that would be negative              that of the free one
lack of fit           a toe, another law                                probability times misfit
loading only          the loop that was not recorded                    :data:`LOOPS`
seating               force carried before the law's contact point      law that begins there
starts in contact     no travel to take the zero of the cell from       an unknown of the fit
drift                 a force that does not return to its zero          what the drift does
turn                  branches that part gradually at a turn    another width of the loop
sole virgin cycle     virgin rubber is stiffer                          measured, or 5 %
hold                  what relaxes slower than the test                 twice the loss, or 5 %
speeds                loss by rate                                      a decade of speed
scatter of the tests  tests that differ by more than their noise        inflated covariance
sole tests            temperature or another segment of the belt?       half the difference
====================  ================================================  ==========================
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from beltid.errors import FitError, NumericsError
from beltid.identify.press.curves import RATE_SPAN, PressCurve
from beltid.identify.press.dissipation import approach, loss_ratio
from beltid.identify.press.fit import (
    ROUNDING,
    ZERO_SHARE,
    FittedLaw,
    LawName,
    Nodes,
    correlation_time,
    fit_law,
)
from beltid.identify.press.recording import FEWEST_FREE, CycleChoice
from beltid.identify.press.temperature import Scatter

Array = NDArray[np.float64]

LARGEST_MISFIT: Final = 0.1
"""A law with a coefficient held at zero may be off by this share of the largest force."""
LEAST_FORCE: Final = 0.1
"""Misfit is relative to the force, from this share of the largest force on."""
PRIOR: Final = 0.05  # probability that another law than the quadratic one holds
LOOPS: Final = (0.12, 0.24, 0.4)
"""Half the distance of the branches, one standard deviation: in proportion to the force; a parabola
over the penetration, s (1 - s), and one at low force, s (1 - s)³, in proportion to the largest."""
SEATING_SHARE: Final = 0.02
"""Travel that is carried before the law's contact point and worth a note, of the penetration."""
VIRGIN: Final = 0.05
"""Standard uncertainty of the force of a cycle that may be the first: half of some 10 %."""
SLOW: Final = 0.05
"""Standard uncertainty of the force from a relaxation that is slower than the test: it leaves no
loop. Filled rubber relaxes by some five percent in a decade of time."""
DEPTH_M: Final = (2.0e-6, 5.0e-3)  # least and most that the ribs of a belt give way
LINE_FORCE_N_M: Final = (1.0e2, 1.0e6)
WORTH_SAYING: Final = 5.0e-3  # share of the force above which an effect is spoken of


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A quadratic law and the curves that it was fitted to."""

    curves: Sequence[PressCurve]
    law: FittedLaw
    scatter: Scatter
    cycles: CycleChoice
    loading_only: bool = False

    @property
    def k(self) -> Array:
        """(k_linear, k_quadratic) in SI."""
        return self.law.K * self.law.units

    @property
    def contact_m(self) -> Array:
        """Position of the contact point of every curve [m]."""
        tests = dict.fromkeys(c.test for c in self.curves)
        of_test = dict(zip(tests, (self.law.contact * self.law.data.span_m).tolist(), strict=True))
        return np.array([of_test[c.test] for c in self.curves])


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """What a check found."""

    check: str  # as in the table of this module
    size: float  # share: of the force; of the penetration (seating); of the noise (scatter)
    text: str = ""  # for the user; empty if it is too small to be spoken of
    changes: tuple[Array, ...] = ()
    """Changes of (k_linear, k_quadratic) by one standard deviation each, SI."""
    unseen: bool = False  # its size is a standard uncertainty that no such recording shows
    alarming: bool = False  # a warning, not a note


def _of_scale(case: Case, check: str, share: float, text: str) -> Finding:
    """An error of the whole force, with its percentage in the text."""
    said = f"{text.format(100.0 * share)}; it is in the standard errors"
    said = said if share >= WORTH_SAYING else ""
    return Finding(check, share, said, (share * case.k,), alarming=True)


def _not_seen(check: str, share: float, text: str) -> Finding:
    """What the recording cannot show."""
    said = f"{text} (in the combined uncertainty, not in the standard errors)"
    return Finding(check, share, said if share >= WORTH_SAYING else "", unseen=True)


def _size(case: Case) -> list[Finding]:
    """Travel or force of no ribbed belt: the recording is in another unit."""
    found = (
        ("displacement_mm", "penetrates", case.law.y * case.law.data.span_m, DEPTH_M, "m"),
        ("force_N", "is pressed", case.law.data.f * case.law.data.F_N_m, LINE_FORCE_N_M, "N/m"),
    )
    return [
        Finding(
            "size",
            top,
            f"the belt {does} by {top:.2g} {unit}, expected are {low:g} to {high:g} {unit}: is "
            f"{name} in another unit, or press.segment_length_cm wrong?",
            alarming=True,
        )
        for name, does, values, (low, high), unit in found
        if not low <= (top := float(np.max(values))) <= high
    ]


def _coefficient_at_zero(case: Case) -> list[Finding]:
    """A coefficient at its bound of zero, and what it would be.

    To first order that is the coefficient of one more column beside those of the fit: y² for
    k_quadratic; for k_linear a constant c, since a linear term shifts the contact point of a pure
    square only, while k_linear² = -4 c k_quadratic. :class:`FitError` if the curves are no law of
    Eq. (3) with that coefficient at zero.
    """
    law, data = case.law, case.law.data
    if not np.any(law.active_bound):
        return []
    n = data.x.size
    k1, k2 = law.units
    if law.active_bound[1]:
        column, form, name, unit, size = law.y**2, "linear", "k_quadratic", "N/m³", k2
    else:
        column, form, name, unit = np.ones(n), "purely quadratic", "k_linear²", "N²/m⁴"
        size = -4.0 * float(law.K[1]) * k1**2
    tangent = law.tangent[:n]
    own = column - tangent @ np.linalg.lstsq(tangent, column, rcond=1e-12)[0]
    value = float(own @ law.residuals) / float(own @ own)
    left = law.residuals - value * own
    dof = max(n / correlation_time(left, data) - tangent.shape[1] - 1, 1.0)
    se = math.sqrt(float(left @ left) / dof / float(own @ own))
    top = float(np.max(data.f))
    share = abs(value) * float(np.max(np.abs(column))) / top
    off = float(np.max(np.abs(law.residuals))) / top
    came = f"{name} came out as {value * size:.3g} ± {se * abs(size):.2g} {unit}"
    # more than three standard errors, and a change of the force that is not negligible
    if abs(value) <= stdtrit(dof, 0.99865) * se or share <= 2e-3:
        text = f"{came}, not different from zero: a {form} law was fitted"
        return [Finding("coefficient at zero", share, text)]
    if off > LARGEST_MISFIT:
        raise FitError(
            f"{came} (changes the force by {100 * share:.2g} % of its largest value), must "
            f"be >= 0, and with zero the law is off by up to {100 * off:.2g} % of the largest "
            f"force, allowed is {100 * LARGEST_MISFIT:g} %: the curve is not a law "
            "k_linear delta + k_quadratic delta² that stiffens from a contact point"
        )
    text = (
        f"{came}, clearly negative: it is held at zero, and the {form} law is off by up to "
        f"{100 * off:.2g} % of the largest force"
    )
    return [Finding("coefficient at zero", off, text, alarming=True)]


def _lack_of_fit(case: Case) -> list[Finding]:
    """A toe or another law, by what four more terms find in the residuals.

    Their probability times their largest relative misfit, from a tenth of the force on, is an error
    of scale; the differences, at equal penetration, from the power law, the cubic law, and the
    quadratic law of the upper half of the force, which seating does not reach, count by their
    probabilities.
    """
    law, data, y = case.law, case.law.data, case.law.y
    n = data.x.size
    changes: list[Array] = []
    middle, half = 0.5 * (y.max() + y.min()), 0.5 * np.ptp(y)
    extra = np.polynomial.chebyshev.chebvander((y - middle) / half, 6)[:, 3:]
    if n <= law.tangent.shape[1] + extra.shape[1] + 2:
        return []
    rows = law.tangent.shape[0] - n  # what is known of unchecked zeros
    design = np.column_stack([law.tangent, np.pad(extra, ((0, rows), (0, 0)))])
    length = np.linalg.norm(design, axis=0)
    observed = np.pad(law.residuals, (0, rows))
    misfit = (design @ (np.linalg.lstsq(design / length, observed, rcond=1e-12)[0] / length))[:n]
    left = law.residuals - misfit
    squares, tau = float(left @ left), correlation_time(left, data)
    weight = _probability(law.sum_of_squares, squares, extra.shape[1], n, n / tau)
    force = law.force(y)
    counted = force >= LEAST_FORCE * float(np.max(force))
    largest = float(np.max(np.abs(misfit[counted]) / force[counted]))
    if weight > 1e-4:  # less would change no digit
        changes, weight = _other_laws(case, weight)
    text = "lack of fit: the law is off by {:.2g} % of the force"
    found = _of_scale(case, "lack of fit", math.sqrt(weight) * largest, text)
    return [replace(found, changes=(*found.changes, *changes))]


def _probability(squares: float, others: float, more: int, n: int, m: float) -> float:
    """Posterior probability of a fit with `more` unknowns; of n nodes m count as independent."""
    floor = n * ROUNDING**2
    gain = m * math.log(max(squares, floor) / max(others, floor)) - more * math.log(max(m, 2.0))
    odds = 0.5 * gain + math.log(PRIOR / (1.0 - PRIOR))
    return 1.0 / (1.0 + math.exp(min(-odds, 700.0)))


def _other_laws(case: Case, weight: float) -> tuple[list[Array], float]:
    """Changes of k to the other laws by the root of their probability; the largest of these."""
    law, data = case.law, case.law.data
    n, upper = data.x.size, data.f >= 0.5 * float(np.max(data.f))
    trials: tuple[tuple[LawName, Nodes], ...]
    trials = ("power", data), ("cubic", data), ("quadratic", data.only(upper))
    changes = []
    for name, nodes in trials:
        try:
            other = fit_law(name, nodes)
        except NumericsError:
            continue
        share = weight
        if name != "quadratic":
            more = other.n_unknowns - law.n_unknowns
            share = _probability(law.sum_of_squares, other.sum_of_squares, more, n, n / other.tau)
            weight = max(weight, share)
        changes.append(math.sqrt(share) * _change_to(case, other.force))
    return changes, weight


def _change_to(case: Case, other: Callable[[Array], Array]) -> Array:
    """Change of k that takes the law nearest to another force over the penetration, relatively."""
    y = np.linspace(0.0, 1.0, 201)[1:] * float(np.max(case.law.y))
    force = case.law.force(y)
    y, force = y[force >= LEAST_FORCE * force[-1]], force[force >= LEAST_FORCE * force[-1]]
    terms = y[:, None] ** case.law.exponents / force[:, None]
    found = np.linalg.lstsq(terms, other(y) / force - 1.0, rcond=None)[0]
    return np.asarray(found * case.law.units)


def _loading_only(case: Case) -> list[Finding]:
    """The middle of the branches lies below the loading one by half a loop that is not known."""
    if case.curves[0].unloads:
        return []
    law, y = case.law, case.law.y
    s, top = np.clip(y / float(np.max(y)), 0.0, 1.0), float(np.max(law.data.f))
    shapes = law.force(y), top * s * (1.0 - s), top * s * (1.0 - s) ** 3
    by_force = law.sensitivity[:, : y.size]
    loops = tuple(
        by_force @ (z * shape) * law.units for z, shape in zip(LOOPS, shapes, strict=True)
    )
    text = (
        "never unloaded: the law is that of the loading branch alone, which lies above the "
        "middle of the branches by 5 to 30 % of the force; it is in the standard errors"
    )
    if not case.loading_only:
        text += "; press.loading_only: true says that this is meant"
    return [Finding("loading only", LOOPS[0], text, loops, alarming=not case.loading_only)]


def _seating(case: Case) -> list[Finding]:
    """The belt carries force before the law's contact point, or touches beyond the recording."""
    law = case.law
    before = case.contact_m - [c.touch_m for c in case.curves]
    found = []
    for curve, offset, way in zip(case.curves, case.contact_m, before, strict=True):
        noted = SEATING_SHARE * (curve.top_position_m - offset)
        beyond = min(float(np.min(b.position_m)) for b in curve.branches) - offset
        if beyond > noted:
            text = f"extrapolated by {beyond * 1e6:.2g} µm beyond the recorded travel"
            found.append(f"test {curve.test}: contact point {text}")
        elif way > noted:
            text = f"{way * 1e6:.2g} µm before the contact point of the law"
            found.append(
                f"test {curve.test}: force is carried from {text}: the belt seats gradually; "
                "it is in the standard errors"
            )
    findings = [Finding("seating", SEATING_SHARE, text) for text in found]
    shift = float(np.mean(np.maximum(before / law.data.span_m, 0.0)))
    if shift > 0.0:  # that way may or may not count as penetration
        changes = (_change_to(case, lambda y: law.force(y - shift)),)
        findings.append(Finding("seating", shift / float(np.max(law.y)), changes=changes))
    return findings


def _starts_in_contact(case: Case) -> list[Finding]:
    """A test without free travel: the zero of its load cell is an unknown of the fit."""
    unchecked = dict.fromkeys(c.test for c in case.curves if not c.free_travel)
    if not unchecked:
        return []
    text = (
        f"begin in contact: {', '.join(unchecked)} (fewer than {FEWEST_FREE} samples before it): "
        "the zero of the load cell could not be checked and is an unknown of the fit; it is in the "
        "standard errors"
    )
    return [Finding("starts in contact", ZERO_SHARE, text, alarming=True)]


def _drift(case: Case) -> list[Finding]:
    """The force after the release is not that before contact: the zero has moved meanwhile.

    In proportion to the time, which is one guess among others, so that the law is not corrected.
    """
    drift = np.array([curve.drift_N_m for curve in case.curves])
    if not drift.any():
        return []
    law, data = case.law, case.law.data
    n = data.x.size
    change = law.sensitivity[:, :n] @ (drift[data.part] / data.F_N_m) * law.units
    worst = int(np.argmax(np.abs(drift)))
    share = abs(float(drift[worst])) / (LEAST_FORCE * case.curves[worst].top_force_N_m)
    tests = dict.fromkeys(c.test for c in case.curves if c.drift_N_m)
    text = (
        f"the force does not return to its zero: {', '.join(tests)}: the load cell drifts, or the "
        f"belt sticks, by up to {100.0 * share:.2g} % of a tenth of the largest force half-way "
        "through the cycle; it is in the standard errors"
    )
    return [Finding("drift", share, text if share >= WORTH_SAYING else "", (change,))]


def _turn(case: Case) -> list[Finding]:
    """Near a turn of the crosshead the middle of the branches rests on the width of their loop."""
    turn = np.concatenate([curve.turn_N_m for curve in case.curves])
    if not turn.any():
        return []
    law, data = case.law, case.law.data
    change = law.sensitivity[:, : turn.size] @ (turn / data.F_N_m) * law.units
    reach = max(
        np.count_nonzero(c.turn_N_m) * float(c.position_m[1] - c.position_m[0]) for c in case.curves
    )
    text = (
        f"the branches part gradually where the crosshead turns: over {reach * 1e6:.2g} µm their "
        "middle rests on the width of the loop farther away; it is in the standard errors"
    )
    return [
        Finding(
            "turn",
            float(np.max(np.abs(turn))) / float(np.max(data.f)) / data.F_N_m,
            text,
            (change,),
        )
    ]


def _sole_virgin_cycle(case: Case) -> list[Finding]:
    """A sole cycle may be that of virgin rubber; tests of several cycles show what that does."""
    share = float(np.mean([c.n_cycles == 1 for c in case.curves]))
    known = [c.virgin_share for c in case.curves if math.isfinite(c.virgin_share)]
    if case.cycles == "first" or not share:
        return []
    if not known:
        text = (
            "a single cycle: whether the belt was conditioned before cannot be seen, virgin rubber "
            "is some 10 % stiffer; press three cycles"
        )
        return [_not_seen("sole virgin cycle", share * VIRGIN, text)]
    text = (
        "tests of a single cycle beside tests whose first cycle is stiffer than the one used: "
        "the single ones may be virgin, by {:.2g} % of the pooled force"
    )
    stiffer = abs(float(np.mean(known)))
    return [_of_scale(case, "sole virgin cycle", share * stiffer, text)]


def _hold(case: Case) -> list[Finding]:
    """A hold at the top shows what relaxes slower than the test; without one nothing does."""
    held = np.array([math.isfinite(c.hold_force_N_m) for c in case.curves])
    if not held.any():
        text = (
            f"no hold: a relaxation slower than the test leaves no trace, {100 * SLOW:.2g} % of "
            "the force are allowed for; hold the crosshead at the top"
        )
        return [_not_seen("hold", SLOW, text)]
    top, force = np.array([(c.top_position_m, c.hold_force_N_m) for c in case.curves])[held].T
    data = case.law.data
    law = case.law.force((top - case.contact_m[held]) / data.span_m) * data.F_N_m
    text = (
        "loss by rate: in a hold the force falls below the law, the belt at rest is softer by "
        "{:.2g} % (what the hold shows and as much again)"
    )
    softer = 2.0 * max(float(np.mean(1.0 - force / law)), 0.0)
    return [_of_scale(case, "hold", softer, text)]


def _speeds(case: Case) -> list[Finding]:
    """Tests at several speeds show whether the loss is by rate; one speed does not."""
    speeds = np.array([approach(c)[0] for c in case.curves])
    if np.all(speeds > 0.0) and speeds.max() >= RATE_SPAN * speeds.min():
        text = "loss by rate: the force changes by {:.2g} % with a tenfold speed of the press"
        decade = abs(_per_speed(case, np.log(speeds))) * math.log(10.0)
        return [_of_scale(case, "speeds", decade, text)]
    loss = loss_ratio(case.curves)
    if math.isnan(loss):
        return []
    # a loss h = (pi/2) tan(angle) goes with a stiffness that changes by (2/pi) tan(angle) ln 10
    # per decade (local Kramers-Kronig relation); half of it may be by rate
    share = 0.5 * math.log(10.0) * (2.0 / math.pi) ** 2 * max(loss, 0.0)
    text = (
        "one speed: whether the loss is by rate cannot be seen; if half of it is, the force "
        f"falls by some {100 * share:.2g} % for a press ten times slower; press tests at two speeds"
    )
    return [_not_seen("speeds", share, text)]


def _per_speed(case: Case, log_speed: Array) -> float:
    """Relative change of the force per unit of the logarithm of the speed."""
    scale = []
    for curve in range(log_speed.size):  # factor of each, its contact point free as well
        mine = case.law.data.part == curve
        y = case.law.y[mine]
        force = case.law.force(y)
        columns = np.column_stack([force, np.gradient(force, y)])
        scale.append(np.linalg.lstsq(columns, case.law.residuals[mine], rcond=None)[0][0])
    return float(np.polyfit(log_speed, scale, 1)[0])


def _scatter_of_the_tests(case: Case) -> list[Finding]:
    """Tests that differ by more than their noise widen the covariance of the fit."""
    if not case.scatter.curves_differ:
        return []
    times = math.sqrt(case.scatter.inflation)
    text = f"the tests differ by {times:.2g} times their noise; the standard errors are widened"
    return [Finding("scatter of the tests", times, f"{text} accordingly")]


def sole_tests(largest_difference: float) -> Finding:
    """Laws at several temperatures of one test each, whose forces differ by this share."""
    text = (
        "one test at each temperature: segments of the belt that differ look the same as a "
        "temperature that matters; press two at one temperature"
    )
    return _not_seen("sole tests", 0.5 * largest_difference, text)


CHECKS: Final[tuple[Callable[[Case], list[Finding]], ...]] = (
    _size,
    _coefficient_at_zero,
    _lack_of_fit,
    _loading_only,
    _seating,
    _starts_in_contact,
    _drift,
    _turn,
    _sole_virgin_cycle,
    _hold,
    _speeds,
    _scatter_of_the_tests,
)
