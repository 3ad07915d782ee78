"""The comparison of normal contact laws in plain words."""

from __future__ import annotations

import math
from collections.abc import Sequence

PROVEN = 6.0
"""A law whose criterion is lower by more than this is better beyond reasonable doubt: the odds
``exp(-6/2)`` of the other are 1 to 20."""
AS_GOOD = 2.0
"""A law whose criterion is higher by less than this does as well."""
RELEVANT_DIFFERENCE = 5.0e-3
"""Laws that differ by less than this share of the largest force are one for the purpose."""

Row = tuple[str, float, float, float]
"""Law, criterion and error of prediction against the quadratic law, largest difference from it."""


def verdict_of(rows: Sequence[Row], exponent: float | None, n_effective: float) -> tuple[bool, str]:
    """Judge the quadratic law against the others.

    Parameters
    ----------
    rows : sequence of tuple
        Law, criterion less that of the quadratic law, ratio of the errors of prediction to that of
        the quadratic law, largest difference from it over the largest force; nan where unknown.
    exponent : float or None
        Exponent of the power law.
    n_effective : float
        Independent nodes.

    Returns
    -------
    supported : bool
        Whether the quadratic law is the one to use.
    verdict : str
        Why, and what else to look at.
    """
    others = {row[0]: row[1:] for row in rows if row[0] != "quadratic" and math.isfinite(row[1])}
    if not others:
        return True, (
            f"No choice of law: {n_effective:.0f} independent nodes are too few to compare laws; "
            "the quadratic law is the default."
        )
    better = {n: r for n, r in others.items() if r[0] < -PROVEN and r[1] < 1.0}
    noticed = {n: r for n, r in better.items() if r[2] >= RELEVANT_DIFFERENCE}
    linear = others.get("linear")
    if not noticed and linear and (linear[0] < AS_GOOD or linear[2] < RELEVANT_DIFFERENCE):
        return False, (
            f"A linear law does as well: it differs from the quadratic one by at most "
            f"{100 * linear[2]:.2g} % of the largest force{_criterion(linear[0])}. "
            "The quadratic law stays the default."
        )
    if noticed:
        name = min(noticed, key=lambda n: noticed[n][0])
        criterion, ratio, apart = noticed[name]
        kind = _named(name, exponent)
        return False, (
            f"A {kind} law predicts better by {100 * (1 - ratio):.2g} %{_criterion(criterion)}; "
            f"it differs from the quadratic one by up to {100 * apart:.2g} % of the largest "
            "force: look at the curves. The quadratic law stays the default."
        )
    return True, f"The quadratic law is supported: {_runners(others, better, exponent)}."


def _named(name: str, exponent: float | None) -> str:
    return f"power (exponent {exponent:.3g})" if name == "power" and exponent else name


def _criterion(difference: float) -> str:
    word = "lower" if difference < 0.0 else "higher"
    return f" (AICc {word} by {abs(difference):.{0 if abs(difference) >= 10 else 1}f})"


def _runners(
    others: dict[str, tuple[float, float, float]],
    better: dict[str, tuple[float, float, float]],
    exponent: float | None,
) -> str:
    """What keeps each of the other laws from being preferred."""
    said = []
    for name, (criterion, _, apart) in others.items():
        kind = _named(name, exponent)
        if name in better:
            said.append(
                f"a {kind} law is provably better but differs by {100 * apart:.2g} % of the "
                "largest force only"
            )
        elif criterion > AS_GOOD:
            said.append(f"a {kind} law is no better{_criterion(criterion)}")
        elif name == "cubic":
            said.append(f"a cubic law adds nothing{_criterion(criterion)}")
        else:
            said.append(f"a {kind} law does as well{_criterion(criterion)}")
    return "; ".join(said)
