"""What the scatter of the nodes does not show: errors that all nodes of a recording share.

Each is a change of the middle curve by one standard deviation, carried to the coefficients by the
derivatives of the fit. What the recording shows goes into the standard errors of the law:

- *lack of fit*: four more terms (Chebyshev, third to sixth order) beside the quadratic law; their
  Akaike weight times the largest relative misfit that they find counts as an error of scale;
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
from beltid.identify.press.fit import FittedLaw, Nodes, correlation_time
from beltid.identify.press.laws import aicc
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
    of_scale(
        lack_of_fit(law, data),
        "lack of fit: the law is off by up to {:.2g} % of the force, which is in the standard "
        "errors",
    )
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


def lack_of_fit(law: FittedLaw, data: Nodes) -> float:
    """Largest relative misfit between a tenth of the largest force and all of it, weighted [-]."""
    n = data.x.size
    y = data.x - law.contact[data.owner]
    middle, half = 0.5 * (y.max() + y.min()), 0.5 * np.ptp(y)
    orders = np.polynomial.chebyshev.chebvander((y - middle) / half, EXTRA_ORDERS[1])
    extra = orders[:, EXTRA_ORDERS[0] :]
    if n <= law.tangent.shape[1] + extra.shape[1] + 2:
        return 0.0
    rows = np.zeros((law.tangent.shape[0] - n, extra.shape[1]))
    design = np.column_stack([law.tangent, np.vstack([extra, rows])])
    length = np.linalg.norm(design, axis=0)
    observed = np.append(law.residuals, np.zeros(rows.shape[0]))
    found = np.linalg.lstsq(design / length, observed, rcond=1e-12)[0] / length
    misfit = design[:n] @ found
    left = law.residuals - misfit
    m = n / correlation_time(left, data)
    unknowns = law.n_unknowns
    gain = aicc(law.sum_of_squares, data, unknowns, m) - aicc(
        float(left @ left), data, unknowns + extra.shape[1], m
    )
    weight = 1.0 / (1.0 + math.exp(min(-0.5 * gain, 700.0))) if math.isfinite(gain) else 1.0
    force = law.force(y)
    counted = force >= LEAST_FORCE * float(np.max(force))
    return math.sqrt(weight) * float(np.max(np.abs(misfit[counted]) / force[counted]))


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
    numbers = {label: i for i, label in enumerate(dict.fromkeys(c.test for c in curves))}
    if held:
        tops = np.array(
            [c.fit_range_m[1] / data.span_m - law.contact[numbers[c.test]] for c in held]
        )
        at = np.array(
            [c.top_position_m / data.span_m - law.contact[numbers[c.test]] for c in held]
        )
        del tops
        middle = law.force(at) * data.F_N_m
        below = 1.0 - np.array([c.hold_force_N_m for c in held]) / middle
        of_scale(
            max(float(np.mean(below)), 0.0),
            "in a hold the force falls {:.2g} % below the law: part of the loss is by rate, and "
            "the belt at rest is softer by as much, which is in the standard errors",
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
    if held or not work.size:
        return 0.0
    share = 0.5 * max(float(work[:, 0].sum() / work[:, 1].sum()), 0.0)
    if share >= WORTH_A_WARNING:
        notes.append(
            f"one speed and no hold: whether the loss is by rate cannot be seen; if it is, the "
            f"belt at rest is softer than the law by some {100 * share:.2g} % of the force (in the "
            "combined uncertainty, not in the standard errors); hold the crosshead at the top"
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
