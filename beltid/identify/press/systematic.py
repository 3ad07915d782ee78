"""What the scatter of the nodes does not show: errors that all nodes of a recording share.

What the recording shows of them goes into the standard errors of the law, as changes of
(k_linear, k_quadratic) by one standard deviation:

- *lack of fit* (a toe, another law): the probability (by BIC, :data:`PRIOR`) of four more terms
  beside the quadratic law times the largest relative misfit that they find, as an error of scale;
  and the differences, at equal penetration, from the power law, the cubic law, and the quadratic
  law of the upper half of the force, which seating does not reach, by their probabilities;
- *seating*: the belt carries force before the contact point of the law, by a way that may or may
  not count as penetration: the difference from the law that begins there;
- *loading only*: the middle lies below by half the unknown loop, of three shapes with the sizes
  that rubber has (:data:`LOOPS`);
- *virgin rubber*: tests of one cycle beside tests of several, which show the difference;
- *loss by rate*: twice what the force loses in a hold below the middle of the branches, or its
  change with the speed of the tests, over a decade.

What no recording of its kind can show is `unseen`: it enters the combined uncertainty only. A zero
that could not be checked is an unknown of the fit itself (:mod:`beltid.identify.press.fit`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from beltid.errors import NumericsError
from beltid.identify.press.curves import PressCurve
from beltid.identify.press.dissipation import RATE_SPAN, approach
from beltid.identify.press.fit import ROUNDING, FittedLaw, LawName, Nodes, correlation_time, fit_law
from beltid.identify.press.recording import CycleChoice

Array = NDArray[np.float64]

LEAST_FORCE = 0.1  # misfit is relative to the force, from this share of the largest force on
LOOPS = (0.12, 0.24, 0.4)
"""Half the distance of the branches, one standard deviation: in proportion to the force; a parabola
over the penetration, s (1 - s), and one at low force, s (1 - s)³, in proportion to the largest."""
SLOW = 0.05
"""Standard uncertainty of the force from a relaxation that is slower than the test: it leaves no
loop. Filled rubber relaxes by some five percent in a decade of time."""
PRIOR = 0.05  # probability that another law than the quadratic one holds
WORTH_A_WARNING = 5.0e-3  # share of the force above which an effect is spoken of


@dataclass(slots=True)
class Systematic:
    """Systematic errors of a law, as they are found."""

    k: Array  # (k_linear, k_quadratic) of the law, SI
    covariance: Array = field(default_factory=lambda: np.zeros((2, 2)))
    """Of k, from what the recording shows."""
    unseen: float = 0.0  # standard uncertainty of the force from what it cannot show [-]
    warnings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def of_scale(self, share: float, text: str) -> None:
        """Add an error of the whole force."""
        self.covariance = self.covariance + share**2 * np.outer(self.k, self.k)
        if share >= WORTH_A_WARNING:
            self.warnings.append(f"{text.format(100.0 * share)}; it is in the standard errors")

    def not_seen(self, share: float, text: str) -> None:
        """Add what the recording cannot show."""
        self.unseen = math.hypot(self.unseen, share)
        if share >= WORTH_A_WARNING:
            self.notes.append(f"{text} (in the combined uncertainty, not in the standard errors)")


def systematic_errors(
    curves: Sequence[PressCurve], law: FittedLaw, data: Nodes, cycles: CycleChoice
) -> Systematic:
    """Systematic errors of the quadratic law of some curves."""
    scales = data.units(law.exponents)
    found = Systematic(law.K * scales)
    weight, misfit = _lack_of_fit(law, data)
    changes: list[Array] = []
    if weight > 1e-4:  # less would change no digit
        changes, weight = _other_laws(law, data, weight)
    text = "lack of fit: the law is off by {:.2g} % of the force"
    found.of_scale(math.sqrt(weight) * misfit, text)
    if not curves[0].unloads:
        y = data.x - law.contact[data.owner]
        s, top = np.clip(y / float(np.max(y)), 0.0, 1.0), float(np.max(data.f))
        shapes = (law.force(y), top * s * (1.0 - s), top * s * (1.0 - s) ** 3)
        by_force = law.sensitivity[:, : y.size]
        changes += [by_force @ (size * shape) for size, shape in zip(LOOPS, shapes, strict=True)]
        found.warnings.append(
            "never unloaded: the law is that of the loading branch alone, which lies above the "
            "middle of the branches by 5 to 30 % of the force; it is in the standard errors"
        )
    contact = dict(zip(dict.fromkeys(c.test for c in curves), law.contact, strict=True))
    seating = np.mean([max(contact[c.test] - c.touch_m / data.span_m, 0.0) for c in curves])
    if seating > 0.0:
        changes.append(_change_to(law, data, lambda y: law.force(y - seating)))
    for change in changes:
        found.covariance = found.covariance + np.outer(change * scales, change * scales)
    unchecked = dict.fromkeys(c.test for c in curves if not c.free_travel)
    if unchecked:
        found.warnings.append(
            f"begin in contact: {', '.join(unchecked)}: the zero of the load cell could not be "
            "checked and is an unknown of the fit; it is in the standard errors"
        )
    _virgin_rubber(found, curves, cycles)
    _loss_by_rate(found, curves, law, data, contact)
    return found


def _lack_of_fit(law: FittedLaw, data: Nodes) -> tuple[float, float]:
    """Probability of a misfit, and its largest relative size from a tenth of the force on [-]."""
    n = data.x.size
    y = data.x - law.contact[data.owner]
    middle, half = 0.5 * (y.max() + y.min()), 0.5 * np.ptp(y)
    extra = np.polynomial.chebyshev.chebvander((y - middle) / half, 6)[:, 3:]
    if n <= law.tangent.shape[1] + extra.shape[1] + 2:
        return 0.0, 0.0
    rows = law.tangent.shape[0] - n  # what is known of unchecked zeros
    design = np.column_stack([law.tangent, np.pad(extra, ((0, rows), (0, 0)))])
    length = np.linalg.norm(design, axis=0)
    observed = np.pad(law.residuals, (0, rows))
    misfit = (design @ (np.linalg.lstsq(design / length, observed, rcond=1e-12)[0] / length))[:n]
    left = law.residuals - misfit
    m = n / correlation_time(left, data)
    weight = _probability(law.sum_of_squares, float(left @ left), extra.shape[1], n, m)
    force = law.force(y)
    counted = force >= LEAST_FORCE * float(np.max(force))
    return weight, float(np.max(np.abs(misfit[counted]) / force[counted]))


def _probability(squares: float, others: float, more: int, n: int, m: float) -> float:
    """Posterior probability of a fit with `more` unknowns; of n nodes m count as independent."""
    floor = n * ROUNDING**2
    gain = m * math.log(max(squares, floor) / max(others, floor)) - more * math.log(max(m, 2.0))
    odds = 0.5 * gain + math.log(PRIOR / (1.0 - PRIOR))
    return 1.0 / (1.0 + math.exp(min(-odds, 700.0)))


def _other_laws(law: FittedLaw, data: Nodes, weight: float) -> tuple[list[Array], float]:
    """Changes of K to the other laws by the root of their probability; the largest of these."""
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
        changes.append(math.sqrt(share) * _change_to(law, data, other.force))
    return changes, weight


def _change_to(law: FittedLaw, data: Nodes, other: Callable[[Array], Array]) -> Array:
    """Change of K that takes the law nearest to another force over the penetration, relatively."""
    y = np.linspace(0.0, 1.0, 201)[1:] * float(np.max(data.x - law.contact[data.owner]))
    force = law.force(y)
    y, force = y[force >= LEAST_FORCE * force[-1]], force[force >= LEAST_FORCE * force[-1]]
    terms = y[:, None] ** law.exponents / force[:, None]
    return np.asarray(np.linalg.lstsq(terms, other(y) / force - 1.0, rcond=None)[0])


def _virgin_rubber(found: Systematic, curves: Sequence[PressCurve], cycles: CycleChoice) -> None:
    share = float(np.mean([c.n_cycles == 1 for c in curves]))
    known = [c.virgin_share for c in curves if math.isfinite(c.virgin_share)]
    if cycles == "first" or not share:
        return
    if known:
        found.of_scale(
            share * abs(float(np.mean(known))),
            "tests of a single cycle beside tests whose first cycle is stiffer than the one used: "
            "the single ones may be virgin, by {:.2g} % of the pooled force",
        )
    else:
        found.not_seen(
            share * 0.05,  # standard uncertainty: half of the 10 %
            "a single cycle: whether the belt was conditioned before cannot be seen, virgin rubber "
            "is some 10 % stiffer; press three cycles",
        )


def _loss_by_rate(
    found: Systematic,
    curves: Sequence[PressCurve],
    law: FittedLaw,
    data: Nodes,
    contact: Mapping[str, float],
) -> None:
    held = [c for c in curves if math.isfinite(c.hold_force_N_m)]
    if held:
        at = np.array([c.top_position_m / data.span_m - contact[c.test] for c in held])
        below = 1.0 - np.array([c.hold_force_N_m for c in held]) / (law.force(at) * data.F_N_m)
        found.of_scale(
            2.0 * max(float(np.mean(below)), 0.0),
            "loss by rate: in a hold the force falls below the law, the belt at rest is softer by "
            "{:.2g} % (what the hold shows and as much again)",
        )
    else:
        found.not_seen(
            SLOW,
            f"no hold: a relaxation slower than the test leaves no trace, {100 * SLOW:.2g} % of "
            "the force are allowed for; hold the crosshead at the top",
        )
    speeds = np.array([approach(c)[0] for c in curves])
    if np.all(speeds > 0.0) and speeds.max() >= RATE_SPAN * speeds.min():
        found.of_scale(
            abs(_per_speed(law, data, np.log(speeds))) * math.log(10.0),
            "loss by rate: the force changes by {:.2g} % with a tenfold speed of the press",
        )
        return
    work = np.sum([(c.dissipated_J_m, c.stored_J_m) for c in curves if c.unloads], axis=0)
    if np.ndim(work):
        # a loss h = (pi/2) tan(angle) goes with a stiffness that changes by (2/pi) tan(angle) ln 10
        # per decade (local Kramers-Kronig relation); half of it may be by rate
        share = 0.5 * math.log(10.0) * (2.0 / math.pi) ** 2 * max(float(work[0] / work[1]), 0.0)
        found.not_seen(
            share,
            "one speed: whether the loss is by rate cannot be seen; if half of it is, the force "
            f"falls by some {100 * share:.2g} % for a press ten times slower; press at two speeds",
        )


def _per_speed(law: FittedLaw, data: Nodes, log_speed: Array) -> float:
    """Relative change of the force per unit of the logarithm of the speed."""
    y = data.x - law.contact[data.owner]
    scale = []
    for c in range(log_speed.size):  # factor of each curve, its contact point free as well
        mine = data.part == c
        columns = np.column_stack([law.force(y[mine]), np.gradient(law.force(y[mine]), y[mine])])
        scale.append(np.linalg.lstsq(columns, law.residuals[mine], rcond=None)[0][0])
    return float(np.polyfit(log_speed, scale, 1)[0])
