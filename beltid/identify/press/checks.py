"""Checks of a press recording for errors that its scatter does not show.

Each check examines a fitted law and returns findings: a text, a size, and a contribution to the
uncertainty. The contribution is either a set of changes of (k_linear, k_quadratic) by one standard
deviation, which enter the standard errors, or, if no such recording can reveal the error, the size
itself, which enters the combined uncertainty only.

====================  ================================================  ==========================
Check                 Looks for                                         Size of the error
====================  ================================================  ==========================
size                  travel or force impossible for a ribbed belt      none: a unit is wrong
coefficient at zero   a coefficient that would be negative              its unconstrained value
lack of fit           a toe, another law                                probability times misfit
loading only          a test without unloading                          :data:`LOOPS`
seating               force before the law's contact point              law that begins there
starts in contact     no free travel to zero the load cell              an unknown of the fit
drift                 a force that does not return to zero              effect of the drift
turn                  branches that separate gradually at a reversal    another loop width
sole virgin cycle     a single cycle, perhaps of virgin rubber          measured, or 5 %
hold                  relaxation slower than the test                   twice the loss, or 5 %
speeds                rate dependence of the force                      a decade of speed
scatter of the tests  tests that differ by more than their noise        inflated covariance
sole tests            effect of temperature or of the belt segment?     half the difference
====================  ================================================  ==========================
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
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
from beltid.identify.press.recording import FEWEST_FREE, StiffnessSettings
from beltid.identify.press.temperature import Scatter

Array = NDArray[np.float64]

LARGEST_MISFIT: Final = 0.1
"""Largest permitted misfit of a law with a coefficient at zero, over the largest force."""
LEAST_FORCE: Final = 0.1
"""Share of the largest force above which the relative misfit is evaluated."""
PRIOR: Final = 0.05  # prior probability that a law other than the quadratic one is true
LOOPS: Final = (0.12, 0.24, 0.4)
"""Standard deviations of half the distance between the branches, for three shapes: proportional to
the force; a parabola s (1 - s) over the penetration s, and s (1 - s)³ at low force, both times the
largest force."""
SEATING_SHARE: Final = 0.02
"""Loaded travel before the law's contact point, over the penetration, that is worth a note."""
VIRGIN: Final = 0.05
"""Standard uncertainty of the force of a possibly virgin cycle: half of about 10 %."""
SLOW: Final = 0.05
"""Standard uncertainty of the force from relaxation slower than the test, which leaves no loop.
Filled rubber relaxes by about five percent per decade of time."""
DEPTH_M: Final = (2.0e-6, 5.0e-3)  # smallest and largest penetration of belt ribs
LINE_FORCE_N_M: Final = (1.0e2, 1.0e6)
REPORTED_SHARE: Final = 5.0e-3  # share of the force above which an effect is reported


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """Fitted quadratic law and its curves."""

    curves: Sequence[PressCurve]
    law: FittedLaw
    scatter: Scatter
    settings: StiffnessSettings


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """Result of a check."""

    check: str  # name as in the table of this module
    size: float  # relative to the force, the penetration (seating) or the noise (scatter)
    text: str = ""  # for the user; empty if too small to report
    changes: tuple[Array, ...] = ()
    """Changes of (k_linear, k_quadratic), one standard deviation each, SI."""
    unseen: bool = False  # the size is a standard uncertainty that no such recording reveals
    alarming: bool = False  # a warning, not a note


def _scale_finding(case: Case, check: str, share: float, text: str) -> Finding:
    """Report a relative error of the whole force; its percentage is put into the text."""
    message = f"{text.format(100.0 * share)}; included in the standard errors"
    message = message if share >= REPORTED_SHARE else ""
    return Finding(check, share, message, (share * case.law.values,), alarming=True)


def _unseen_finding(check: str, share: float, text: str) -> Finding:
    """Report an error that the recording cannot reveal."""
    message = f"{text} (included in the combined uncertainty, not in the standard errors)"
    return Finding(check, share, message if share >= REPORTED_SHARE else "", unseen=True)


def _size(case: Case) -> Iterator[Finding]:
    """Check travel and force against the range of ribbed belts, to catch wrong units."""
    law, data = case.law, case.law.data
    for name, verb, top, (low, high), unit in (
        ("displacement_mm", "penetrates", float(law.y.max()) * data.span_m, DEPTH_M, "m"),
        ("force_N", "is pressed", float(data.f.max()) * data.F_N_m, LINE_FORCE_N_M, "N/m"),
    ):
        if not low <= top <= high:
            text = (
                f"the belt {verb} by {top:.2g} {unit}, expected range {low:g} to {high:g} {unit}: "
                f"is {name} in another unit, or press.segment_length_cm wrong?"
            )
            yield Finding("size", top, text, alarming=True)


def _coefficient_at_zero(case: Case) -> Iterator[Finding]:
    """Check a coefficient at its bound of zero; estimate its unconstrained value.

    To first order, this value is the coefficient of an extra column in the fit: y² for k_quadratic;
    for k_linear a constant c with k_linear² = -4 c k_quadratic, because a linear term merely shifts
    the contact point of a pure square. Raises :class:`FitError` if Eq. (3) with that coefficient at
    zero does not describe the curves.
    """
    law, data = case.law, case.law.data
    if not np.any(law.active_bound):
        return
    n = data.x.size
    k1, k2 = law.units
    column, form, name, unit, size = law.y**2, "linear", "k_quadratic", "N/m³", k2
    if law.active_bound[0]:
        column, form, name, unit = np.ones(n), "purely quadratic", "k_linear²", "N²/m⁴"
        size = -4.0 * float(law.K[1]) * k1**2
    tangent = law.tangent[:n]
    # part of the column that the fit cannot represent
    extra = column - tangent @ np.linalg.lstsq(tangent, column, rcond=1e-12)[0]
    value = float(extra @ law.residuals) / float(extra @ extra)
    rest = law.residuals - value * extra
    dof = max(n / correlation_time(rest, data) - tangent.shape[1] - 1, 1.0)
    se = math.sqrt(float(rest @ rest) / dof / float(extra @ extra))
    top = float(np.max(data.f))
    share = abs(value) * float(np.max(np.abs(column))) / top
    misfit = float(np.max(np.abs(law.residuals))) / top
    result = f"{name} came out as {value * size:.3g} ± {se * abs(size):.2g} {unit}"
    # insignificant (three standard errors), or with a negligible effect on the force
    if abs(value) <= stdtrit(dof, 0.99865) * se or share <= 2e-3:
        text = f"{result}, not different from zero: a {form} law was fitted"
        yield Finding("coefficient at zero", share, text)
        return
    if misfit > LARGEST_MISFIT:
        raise FitError(
            f"{result} (changes the force by {100 * share:.2g} % of its largest value), must "
            f"be >= 0, and with zero the law is off by up to {100 * misfit:.2g} % of the largest "
            f"force, must be <= {100 * LARGEST_MISFIT:g} %: the curve does not follow a law "
            "k_linear delta + k_quadratic delta² that stiffens from a contact point"
        )
    text = (
        f"{result}, clearly negative: it is held at zero, and the {form} law is off by up to "
        f"{100 * misfit:.2g} % of the largest force"
    )
    yield Finding("coefficient at zero", misfit, text, alarming=True)


def _lack_of_fit(case: Case) -> Iterator[Finding]:
    """Check for a toe or another law by fitting four more terms to the residuals.

    The largest relative misfit, above a tenth of the force, weighted by the probability of these
    terms, is an error of scale. Further errors are the differences, at equal penetration, to the
    power law, the cubic law, and the quadratic law of the upper half of the force (unaffected by
    seating), weighted by their probabilities.
    """
    law, data, y = case.law, case.law.data, case.law.y
    n = data.x.size
    middle, half = 0.5 * (y.max() + y.min()), 0.5 * np.ptp(y)
    extra = np.polynomial.chebyshev.chebvander((y - middle) / half, 6)[:, 3:]
    if n <= law.tangent.shape[1] + extra.shape[1] + 2:
        return
    for_zeros = (0, law.misfit.size - n)  # rows of the prior of unchecked zeros
    design = np.column_stack([law.tangent, np.pad(extra, (for_zeros, (0, 0)))])
    scaled = design / np.linalg.norm(design, axis=0)
    terms = np.linalg.lstsq(scaled, np.pad(law.residuals, for_zeros), rcond=1e-12)[0]
    misfit = (scaled @ terms)[:n]
    rest = law.residuals - misfit
    weight = _probability(
        law.sum_of_squares, float(rest @ rest), extra.shape[1], n, n / correlation_time(rest, data)
    )
    force = law.force(y)
    high = force >= LEAST_FORCE * float(np.max(force))
    largest = float(np.max(np.abs(misfit[high]) / force[high]))
    changes: list[Array] = []
    if weight > 1e-4:  # a smaller weight has no effect
        changes, weight = _other_laws(case, weight)
    text = "lack of fit: the law is off by {:.2g} % of the force"
    finding = _scale_finding(case, "lack of fit", math.sqrt(weight) * largest, text)
    yield replace(finding, changes=(*finding.changes, *changes))


def _probability(squares: float, squares_extra: float, n_extra: int, n: int, m: float) -> float:
    """Return the posterior probability of a fit with `n_extra` more unknowns.

    `squares` and `squares_extra` are the sums of squares without and with them; m of the n nodes
    count as independent.
    """
    floor = n * ROUNDING**2
    gain = m * math.log(max(squares, floor) / max(squares_extra, floor))
    gain -= n_extra * math.log(max(m, 2.0))
    log_odds = 0.5 * gain + math.log(PRIOR / (1.0 - PRIOR))
    return 1.0 / (1.0 + math.exp(min(-log_odds, 700.0)))


def _other_laws(case: Case, weight: float) -> tuple[list[Array], float]:
    """Return the changes of k to other laws, weighted, and the largest of the probabilities."""
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
        probability = weight
        if name != "quadratic":
            n_extra = other.n_unknowns - law.n_unknowns
            probability = _probability(
                law.sum_of_squares, other.sum_of_squares, n_extra, n, n / other.tau
            )
            weight = max(weight, probability)
        changes.append(math.sqrt(probability) * _change_to(case, other.force))
    return changes, weight


def _change_to(case: Case, other: Callable[[Array], Array]) -> Array:
    """Return the change of k that best matches another force law, in relative terms."""
    y = np.linspace(0.0, 1.0, 201)[1:] * float(np.max(case.law.y))
    force = case.law.force(y)
    y, force = y[force >= LEAST_FORCE * force[-1]], force[force >= LEAST_FORCE * force[-1]]
    terms = y[:, None] ** case.law.exponents / force[:, None]
    change = np.linalg.lstsq(terms, other(y) / force - 1.0, rcond=None)[0]
    return np.asarray(change * case.law.units)


def _loading_only(case: Case) -> Iterator[Finding]:
    """Allow for the unknown loop if only loading was recorded: the middle lies below it."""
    if case.curves[0].unloads:
        return
    law, y = case.law, case.law.y
    s, top = np.clip(y / float(np.max(y)), 0.0, 1.0), float(np.max(law.data.f))
    shapes = law.force(y), top * s * (1.0 - s), top * s * (1.0 - s) ** 3
    loops = tuple(case.law.change_by(z * shape) for z, shape in zip(LOOPS, shapes, strict=True))
    text = (
        "never unloaded: the law is that of the loading branch alone, which lies above the "
        "middle of the branches by 5 to 30 % of the force; included in the standard errors"
    )
    yield Finding("loading only", LOOPS[0], text, loops, alarming=True)


def _seating(case: Case) -> Iterator[Finding]:
    """Check for force before the law's contact point, or contact outside the recorded travel."""
    law, contact = case.law, case.law.contact_m
    before = contact - [c.touch_m for c in case.curves]
    for curve, offset, early in zip(case.curves, contact, before, strict=True):
        limit = SEATING_SHARE * (curve.top_position_m - offset)
        beyond = min(float(np.min(b.position_m)) for b in curve.branches) - offset
        text = f"test {curve.test}: "
        if beyond > limit:
            text += (
                f"contact point extrapolated by {beyond * 1e6:.2g} µm beyond the recorded travel"
            )
        elif early > limit:
            text += (
                f"the force begins {early * 1e6:.2g} µm before the contact point of the law: the "
                "belt seats gradually; included in the standard errors"
            )
        else:
            continue
        yield Finding("seating", SEATING_SHARE, text)
    shift = float(np.mean(np.maximum(before / law.data.span_m, 0.0)))
    if shift > 0.0:  # this travel may or may not count as penetration
        change = _change_to(case, lambda y: law.force(y - shift))
        yield Finding("seating", shift / float(np.max(law.y)), changes=(change,))


def _starts_in_contact(case: Case) -> Iterator[Finding]:
    """Report tests without free travel: the zero of their load cell is an unknown of the fit."""
    unchecked = dict.fromkeys(c.test for c in case.curves if not c.recorded.free_travel)
    if not unchecked:
        return
    text = (
        f"begin in contact: {', '.join(unchecked)} (fewer than {FEWEST_FREE} samples before it): "
        "the zero of the load cell could not be checked and is an unknown of the fit; included in "
        "the standard errors"
    )
    yield Finding("starts in contact", ZERO_SHARE, text, alarming=True)


def _drift(case: Case) -> Iterator[Finding]:
    """Check whether the zero moved between contact and release.

    The drift is assumed proportional to time. This is only a guess, so the law is not corrected.
    """
    drift = np.array([curve.drift_N_m for curve in case.curves])
    if not drift.any():
        return
    data = case.law.data
    change = case.law.change_by(drift[data.part] / data.F_N_m)
    worst = int(np.argmax(np.abs(drift)))
    share = abs(float(drift[worst])) / (LEAST_FORCE * case.curves[worst].top_force_N_m)
    tests = dict.fromkeys(c.test for c in case.curves if c.drift_N_m)
    text = (
        f"the force does not return to its zero: {', '.join(tests)}: the load cell drifts, or the "
        f"belt sticks, by up to {100.0 * share:.2g} % of a tenth of the largest force halfway "
        "through the cycle; included in the standard errors"
    )
    yield Finding("drift", share, text if share >= REPORTED_SHARE else "", (change,))


def _turn(case: Case) -> Iterator[Finding]:
    """Allow for the assumed loop width near reversals of the crosshead."""
    turn = np.concatenate([curve.turn_N_m for curve in case.curves])
    if not turn.any():
        return
    turn = turn / case.law.data.F_N_m
    reach = max(
        np.count_nonzero(c.turn_N_m) * float(c.position_m[1] - c.position_m[0]) for c in case.curves
    )
    text = (
        f"the branches separate gradually where the crosshead reverses: over {reach * 1e6:.2g} µm "
        "their middle relies on the loop width farther away; included in the standard errors"
    )
    share = float(np.max(np.abs(turn))) / float(np.max(case.law.data.f))
    yield Finding("turn", share, text, (case.law.change_by(turn),))


def _sole_virgin_cycle(case: Case) -> Iterator[Finding]:
    """Allow for virgin rubber in tests of a single cycle; other tests may show its effect."""
    share = float(np.mean([len(c.recorded.cycles) == 1 for c in case.curves]))
    virgin_shares = [c.virgin_share for c in case.curves if math.isfinite(c.virgin_share)]
    if case.settings.cycles == "first" or not share:
        return
    if not virgin_shares:
        text = (
            "a single cycle: it is unknown whether the belt was conditioned before; virgin rubber "
            "is about 10 % stiffer; press three cycles"
        )
        yield _unseen_finding("sole virgin cycle", share * VIRGIN, text)
        return
    text = (
        "some tests have a single cycle; in others the first cycle is stiffer than the one used: "
        "the single cycles may be virgin, an effect of {:.2g} % of the pooled force"
    )
    stiffer = abs(float(np.mean(virgin_shares)))
    yield _scale_finding(case, "sole virgin cycle", share * stiffer, text)


def _hold(case: Case) -> Iterator[Finding]:
    """Check for relaxation slower than the test, which only a hold at the top shows."""
    has_hold = np.array([math.isfinite(c.hold_force_N_m) for c in case.curves])
    if not has_hold.any():
        text = (
            "no hold: relaxation slower than the test leaves no trace; the allowance is "
            f"{100 * SLOW:.2g} % of the force; hold the crosshead at the top"
        )
        yield _unseen_finding("hold", SLOW, text)
        return
    top, force = np.array([(c.top_position_m, c.hold_force_N_m) for c in case.curves])[has_hold].T
    data = case.law.data
    law = case.law.force((top - case.law.contact_m[has_hold]) / data.span_m) * data.F_N_m
    text = (
        "rate dependence: in a hold the force falls below the law; the belt at rest is softer by "
        "{:.2g} % (twice the loss in the hold)"
    )
    softer = 2.0 * max(float(np.mean(1.0 - force / law)), 0.0)
    yield _scale_finding(case, "hold", softer, text)


def _speeds(case: Case) -> Iterator[Finding]:
    """Check the rate dependence of the force, which only tests at several speeds show."""
    speeds = np.array([approach(c)[0] for c in case.curves])
    if np.all(speeds > 0.0) and speeds.max() >= RATE_SPAN * speeds.min():
        text = "rate dependence: the force changes by {:.2g} % if the press is ten times faster"
        decade = abs(_per_speed(case, np.log(speeds))) * math.log(10.0)
        yield _scale_finding(case, "speeds", decade, text)
        return
    loss = loss_ratio(case.curves)
    if math.isnan(loss):
        return
    # a loss h = (pi/2) tan(angle) implies a stiffness change of (2/pi) tan(angle) ln 10 per decade
    # (local Kramers-Kronig relation); half of the loss may depend on the rate
    share = 0.5 * math.log(10.0) * (2.0 / math.pi) ** 2 * max(loss, 0.0)
    text = (
        "one speed: the rate dependence of the loss is unknown; if half of it depends on the rate, "
        f"the force falls by about {100 * share:.2g} % for a press ten times slower; press at two "
        "speeds"
    )
    yield _unseen_finding("speeds", share, text)


def _per_speed(case: Case, log_speed: Array) -> float:
    """Return the relative change of the force per unit of the logarithm of the speed."""
    scale = []
    for curve in range(log_speed.size):  # scale each curve, with a free contact point
        nodes = case.law.data.part == curve
        y = case.law.y[nodes]
        force = case.law.force(y)
        columns = np.column_stack([force, np.gradient(force, y)])
        scale.append(np.linalg.lstsq(columns, case.law.residuals[nodes], rcond=None)[0][0])
    return float(np.polyfit(log_speed, scale, 1)[0])


def _scatter_of_the_tests(case: Case) -> Iterator[Finding]:
    """Report tests that differ by more than their noise; they inflate the covariance."""
    if not case.scatter.curves_differ:
        return
    factor = math.sqrt(case.scatter.inflation)
    text = f"the tests differ by {factor:.2g} times their noise; the standard errors are enlarged"
    yield Finding("scatter of the tests", factor, f"{text} accordingly")


def sole_tests(largest_difference: float) -> Finding:
    """Report laws from a single test per temperature, whose forces differ by this share."""
    text = (
        "one test at each temperature: an effect of temperature cannot be separated from a "
        "difference between belt segments; press two at one temperature"
    )
    return _unseen_finding("sole tests", 0.5 * largest_difference, text)


CHECKS: Final[tuple[Callable[[Case], Iterator[Finding]], ...]] = (
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
