"""What the scatter of the nodes does not show: errors that all nodes of a recording share.

Each is a change of the middle curve by one standard deviation, carried to the coefficients by the
derivatives of the fit. What the recording shows goes into the standard errors of the law:

- *lack of fit*: four more terms (Chebyshev, third to sixth order) beside the quadratic law; their
  weight times the largest relative misfit that they find counts as an error of scale;
- *loading only*: the middle lies below by half the unknown loop. Three shapes of it, with the size
  that rubber has (:data:`LOOPS`);
- *virgin rubber*: tests with one cycle beside tests with several, which show the difference;
- *loss by rate*: what the force loses in a hold below the middle of the branches, or its change
  with the speed of the tests, over a decade.

What no recording of its kind can show is `unseen`: it enters the combined uncertainty only. A zero
that could not be checked is an unknown of the fit itself (:mod:`beltid.identify.press.fit`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.identify.press.curves import PressCurve
from beltid.identify.press.dissipation import RATE_SPAN, approach
from beltid.errors import NumericsError
from beltid.identify.press.fit import ROUNDING, FittedLaw, LawName, Nodes, correlation_time, fit_law
from beltid.identify.press.recording import CycleChoice

Array = NDArray[np.float64]

EXTRA_ORDERS = (3, 6)
"""Orders of the terms that look for a lack of fit."""
LEAST_FORCE = 0.1
"""Misfit is relative to the force, from this share of the largest force on."""
LOOPS = (0.12, 0.24, 0.4)
"""Half the distance of the branches, one standard deviation: in proportion to the force; a parabola
over the penetration, s (1 - s), and one at low force, s (1 - s)³, in proportion to the largest."""
VIRGIN_SHARE = 0.05
"""Standard uncertainty of a sole cycle that may be the first: virgin rubber is some 10 % stiffer."""
PRIOR = 0.05
"""Prior probability that another law than the quadratic one holds."""
NO_WEIGHT = 1.0e-4
"""A misfit of less weight changes no digit: the other laws are not fitted."""
WORTH_A_WARNING = 5.0e-3
"""Share of the force above which an effect is a warning, below it is not spoken of."""


@dataclass(frozen=True, slots=True)
class Systematic:
    """Systematic errors of a law.

    Attributes
    ----------
    covariance : ndarray
        Of (k_linear, k_quadratic), from what the recording shows, SI, shape (2, 2).
    unseen : float
        Standard uncertainty of the force from what it cannot show [-].
    warnings, notes : tuple of str
        What they are.
    """

    covariance: Array
    unseen: float
    warnings: tuple[str, ...]
    notes: tuple[str, ...]


def systematic_errors(
    curves: Sequence[PressCurve], law: FittedLaw, data: Nodes, cycles: CycleChoice
) -> Systematic:
    """Systematic errors of the quadratic law of some curves."""
    scales = data.F_N_m / data.span_m**law.exponents
    k = law.K * scales
    covariance = np.zeros((2, 2))
    warnings: list[str] = []
    notes: list[str] = []

    def of_scale(share: float, text: str) -> None:
        nonlocal covariance
        covariance = covariance + share**2 * np.outer(k, k)
        if share >= WORTH_A_WARNING:
            warnings.append(text.format(100.0 * share))

    y = data.x - law.contact[data.owner]
    weight, misfit = lack_of_fit(law, data)
    of_scale(
        math.sqrt(weight) * misfit,
        "lack of fit: the law is off by {:.2g} % of the force; this and its distance from other "
        "laws are in the standard errors",
    )
    if weight > NO_WEIGHT:
        for change in _other_laws(law, data, weight):
            covariance = covariance + np.outer(change * scales, change * scales)
    if not curves[0].unloads:
        s = np.clip(y / float(np.max(y)), 0.0, 1.0)
        top = float(np.max(data.f))
        shapes = (law.force(y), top * s * (1.0 - s), top * s * (1.0 - s) ** 3)
        moved = np.array([a * shape for a, shape in zip(LOOPS, shapes, strict=True)])
        change = (law.sensitivity[:, : data.x.size] @ moved.T) * scales[:, None]
        covariance = covariance + change @ change.T
        warnings.append(
            "never unloaded: the law is that of the loading branch alone, which lies above the "
            "middle of the branches by 5 to 30 % of the force; the standard errors allow for it"
        )
    unseen = [_cycle_effect(curves, law, data, cycles, of_scale, notes)]
    unseen.append(_rate_effect(curves, law, data, of_scale, notes))
    unchecked = [c.test for c in curves if not c.free_travel]
    if unchecked:
        warnings.append(
            f"tests that begin in contact ({', '.join(dict.fromkeys(unchecked))}): the zero of the "
            "load cell could not be checked; it is an unknown of the fit, and its uncertainty is "
            "in the standard errors"
        )
    return Systematic(covariance, math.hypot(*unseen), tuple(warnings), tuple(notes))


def lack_of_fit(law: FittedLaw, data: Nodes) -> tuple[float, float]:
    """weight of a misfit, and its largest relative size from a tenth of the force on [-]."""
    n = data.x.size
    y = data.x - law.contact[data.owner]
    middle, half = 0.5 * (y.max() + y.min()), 0.5 * np.ptp(y)
    orders = np.polynomial.chebyshev.chebvander((y - middle) / half, EXTRA_ORDERS[1])
    extra = orders[:, EXTRA_ORDERS[0] :]
    if n <= law.tangent.shape[1] + extra.shape[1] + 2:
        return 0.0, 0.0
    rows = np.zeros((law.tangent.shape[0] - n, extra.shape[1]))
    design = np.column_stack([law.tangent, np.vstack([extra, rows])])
    length = np.linalg.norm(design, axis=0)
    observed = np.append(law.residuals, np.zeros(rows.shape[0]))
    found = np.linalg.lstsq(design / length, observed, rcond=1e-12)[0] / length
    misfit = design[:n] @ found
    left = law.residuals - misfit
    m = n / correlation_time(left, data)
    weight = _weight(law.sum_of_squares, float(left @ left), extra.shape[1], n, m)
    force = law.force(y)
    counted = force >= LEAST_FORCE * float(np.max(force))
    return weight, float(np.max(np.abs(misfit[counted]) / force[counted]))


def _other_laws(law: FittedLaw, data: Nodes, weight: float) -> list[Array]:
    """Changes of K that bring the law closest to others at equal penetration, weighted.

    The others: the power and the cubic law by their weights beside the quadratic one, and
    the quadratic law of the nodes above half the largest force, which seating does not reach, by
    the weight of the misfit.
    """
    others = []
    n = data.x.size
    upper = data.f >= 0.5 * float(np.max(data.f))
    names: tuple[LawName, ...] = ("power", "cubic", "quadratic")
    for name in names:
        try:
            other = fit_law(name, data.only(upper) if name == "quadratic" else data)
        except NumericsError:
            continue
        more = other.n_unknowns - law.n_unknowns
        if name == "quadratic":
            share = weight
        else:
            share = _weight(law.sum_of_squares, other.sum_of_squares, more, n, n / other.tau)
            weight = max(weight, share)
        y = np.linspace(0.0, 1.0, 201)[1:] * float(np.max(data.x - law.contact[data.owner]))
        force = law.force(y)
        counted = force >= LEAST_FORCE * force[-1]
        terms = y[counted, None] ** law.exponents / force[counted, None]
        apart = (other.force(y) / force - 1.0)[counted]
        others.append(math.sqrt(share) * np.linalg.lstsq(terms, apart, rcond=None)[0])
    return others


def _weight(squares: float, others: float, more: int, n: int, m: float) -> float:
    """Posterior probability (by BIC) of a fit with `more` unknowns against the quadratic law.

    Of n nodes m count as independent.
    """
    floor = (n * ROUNDING) ** 2
    gain = m * math.log(max(squares, floor) / max(others, floor)) - more * math.log(max(m, 2.0))
    gain += 2.0 * math.log(PRIOR / (1.0 - PRIOR))
    return 1.0 / (1.0 + math.exp(min(-0.5 * gain, 700.0)))


def _cycle_effect(curves, law, data, cycles, of_scale, notes) -> float:  # type: ignore[no-untyped-def]
    """Virgin rubber: shown by other tests, or not to be seen; its unseen share."""
    sole = [c.n_cycles == 1 for c in curves]
    known = [c.virgin_share for c in curves if math.isfinite(c.virgin_share)]
    if cycles == "first" or not any(sole):
        return 0.0
    share = sum(sole) / len(sole)
    if known:
        of_scale(
            share * abs(float(np.mean(known))),
            "tests of a single cycle beside tests of several, whose first cycle is stiffer than "
            "the one used: that of the single ones may be virgin, by {:.2g} % of the pooled force, "
            "which is in the standard errors",
        )
        return 0.0
    notes.append(
        "a single cycle: whether the belt was conditioned before cannot be seen; virgin rubber is "
        "some 10 % stiffer (in the combined uncertainty, not in the standard errors); press three "
        "cycles"
    )
    return share * VIRGIN_SHARE


def _rate_effect(curves, law, data, of_scale, notes) -> float:  # type: ignore[no-untyped-def]
    """Loss by rate: shown by a hold or by speeds that differ, or not to be seen; unseen share."""
    held = [c for c in curves if math.isfinite(c.hold_force_N_m)]
    if held:
        contact = dict(zip(dict.fromkeys(c.test for c in curves), law.contact, strict=True))
        at = np.array([c.top_position_m / data.span_m - contact[c.test] for c in held])
        below = 1.0 - np.array([c.hold_force_N_m for c in held]) / (law.force(at) * data.F_N_m)
        of_scale(
            2.0 * max(float(np.mean(below)), 0.0),
            "in a hold the force falls below the law: part of the loss is by rate, and the belt at "
            "rest is softer by {:.2g} % (what the hold shows and as much again), which is in the "
            "standard errors",
        )
    speeds = np.array([approach(c)[0] for c in curves])
    if np.all(speeds > 0.0) and speeds.max() >= RATE_SPAN * speeds.min():
        of_scale(
            abs(_per_speed(law, data, np.log(speeds))) * math.log(10.0),
            "the force changes by {:.2g} % with a tenfold speed of the press: part of the loss is "
            "by rate; a decade of speed is in the standard errors",
        )
        return 0.0
    work = np.array([(c.dissipated_J_m, c.stored_J_m) for c in curves if c.unloads])
    if not work.size:
        return 0.0
    # a loss angle of (2/pi) h goes with a stiffness that changes by (2/pi) tan(angle) ln 10 per
    # decade (local Kramers-Kronig relation): 0.94 h
    share = 0.94 * max(float(work[:, 0].sum() / work[:, 1].sum()), 0.0)
    if share >= WORTH_A_WARNING:
        notes.append(
            f"one speed: whether the loss is by rate cannot be seen; if it is, the force falls by "
            f"some {100 * share:.2g} % for a press ten times slower (in the combined uncertainty, "
            "not in the standard errors); press at two speeds"
        )
    return share


def _per_speed(law: FittedLaw, data: Nodes, log_speed: Array) -> float:
    """Relative change of the force per unit of the logarithm of the speed."""
    y = data.x - law.contact[data.owner]
    # the factor of each curve, its contact point free as well
    scale = np.empty(log_speed.size)
    for c in range(scale.size):
        mine = data.part == c
        slope = np.gradient(law.force(y[mine]), y[mine])
        columns = np.column_stack([law.force(y[mine]), slope])
        scale[c] = np.linalg.lstsq(columns, law.residuals[mine], rcond=None)[0][0]
    return float(np.polyfit(log_speed, scale, 1)[0])
