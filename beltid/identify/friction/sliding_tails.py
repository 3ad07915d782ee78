"""The level of a sliding plateau under a tail of unknown shape: an average over shapes.

One exponential is a description of the tail of a sticking peak, no law: the tail may have a slower
part, which noise hides and which a single exponential books as plateau. Two hypotheses on
y = ln(T_tight/T_slack) compete,

    single   y(t) = level + a exp(-t/tau)                          (or no tail at all)
    double   y(t) = level + a_1 exp(-t/tau_1) + a_2 exp(-t/tau_2),   tau_2 > tau_1,

and the level is averaged over them (Hoeting et al., "Bayesian model averaging: a tutorial",
Statistical Science 14, 1999). A tail that falls ever more slowly (stretched, power law) is a sum of
decaying exponentials with amplitudes of one sign. One noisy run hardly tells the two apart, all
runs of a bench together do: see :func:`share_of_double`. `sliding_tail_fit` weighs a record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

WORTH = 0.3
"""Log evidence that a double tail must be better by."""
THIRD = 1.5
"""Change of the level by more exponentials over what the second one clearly changed."""
SETTLED = 1.0e-12
"""Change of the share below which the maximisation ends."""
LARGEST_VOTE = 2.0
"""Largest log odds of one run among those of its bench."""


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """What a record says about the level if a hypothesis holds."""

    level: float
    """Mean of the level of ln(T_tight/T_slack) [-]."""
    se: float
    """Its standard deviation [-]."""
    log_evidence: float
    """Logarithm of the probability density of the record, up to a constant of the record."""


@dataclass(frozen=True, slots=True)
class Tails:
    """What one run says about the level under each hypothesis on its tail."""

    single: Hypothesis
    double: Hypothesis
    log_odds_of_fit: float
    """Logarithm of the odds of the fit itself against a double tail, as if it had as many
    parameters."""
    rival: Hypothesis | None = None
    """Another model beside both (a drift), with the log evidence of its odds against them."""

    @property
    def log_odds(self) -> float:
        """Logarithm of the odds that the record gives for a double tail against a single one.

        Where noise hides either, their evidence is nearly the same: the double one must be better
        by `WORTH`, as the single one leaves less in doubt.
        """
        return self.double.log_evidence - self.single.log_evidence - WORTH

    def beside(self, level: float, se: float, log_odds: float = 0.0) -> Tails:
        """Put the fit beside the tails that were weighed for it, as it has a drift.

        Parameters
        ----------
        level, se : float
            Its level of ln(T_tight/T_slack) and standard error [-].
        log_odds : float
            What else speaks for it.
        """
        return replace(self, rival=Hypothesis(level, se, self.log_odds_of_fit + log_odds))

    @property
    def probability_of_fit(self) -> float:
        """Probability of the fit with a drift against tails; 1 if there is no drift."""
        return 1.0 if self.rival is None else _probability(self.rival.log_evidence)

    def probability_of_double(self, prior: float) -> float:
        """Probability of a double tail against a single one, from that before the record."""
        return _probability(np.log(prior / (1.0 - prior)) + self.log_odds)

    def level(self, prior: float, fit: float) -> tuple[float, float]:
        """Mean and standard deviation of the level.

        Parameters
        ----------
        prior : float
            Probability of a double tail against a single one before the record was seen.
        fit : float
            Probability of the fit with a drift, if there is one.
        """
        p = self.probability_of_double(prior)
        # a tail that is clearly not single need not be double either: what the second exponential
        # changed is the scale of what a third one would
        change = (self.double.level - self.single.level) ** 2 - self.double.se**2
        se = float(np.sqrt(self.double.se**2 + THIRD**2 * max(change, 0.0)))
        mean, sd = mixture([1.0 - p, p], [self.single, replace(self.double, se=se)])
        if self.rival is None:
            return mean, sd
        return mixture([1.0 - fit, fit], [Hypothesis(mean, sd, 0.0), self.rival])


def _probability(log_odds: float) -> float:
    return float(1.0 / (1.0 + np.exp(-np.clip(log_odds, -700.0, 700.0))))


def mixture(weights: Sequence[float], parts: Sequence[Hypothesis]) -> tuple[float, float]:
    """Mean and standard deviation of the level over hypotheses whose weights add up to one."""
    w, levels, se = np.array([(w, h.level, h.se) for w, h in zip(weights, parts, strict=True)]).T
    mean = float(w @ levels)
    return mean, float(np.sqrt(w @ (se**2 + (levels - mean) ** 2)))


def share_of_double(runs: Sequence[Tails]) -> float:
    """Most likely share of the runs of a bench that have a double tail.

    Expectation maximisation, with a run of either kind as knowledge beforehand: what noise hides in
    single runs, the sum of their log odds shows. No run counts for more than `LARGEST_VOTE`.

    Parameters
    ----------
    runs : sequence of Tails
        Runs of a bench; without any the share is one half.
    """
    votes = np.clip([run.log_odds for run in runs], -LARGEST_VOTE, LARGEST_VOTE)
    share = 0.5
    odds = np.exp(votes)
    for _ in range(200):
        before, double = share, share * odds
        share = float(1.0 + np.sum(double / (double + 1.0 - share))) / (2.0 + len(runs))
        if abs(share - before) < SETTLED:
            break
    return share
