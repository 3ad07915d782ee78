"""Draws of the Monte Carlo check of a refined surface, spread over workers, and its table."""

from __future__ import annotations

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from beltid.errors import InputError
from beltid.stages.reporter import Reporter
from beltid.stages.workers import Workers
from beltid.uncertainty.monte_carlo import Nominal, Replicates, gathered, replicates

PER_CALL: Final = 5
FEWEST: Final = 50
CHECKED: Final = "linear standard uncertainty against Monte Carlo, in percent of mu"
COLUMNS: Final = (
    "group",
    "values",
    "linear_percent",
    "monte_carlo_percent",
    "largest_deviation_percent",
    "largest_asymmetry",
    "linear_fails",
)


@dataclass(frozen=True, slots=True)
class Draws:
    """How many replicates, and who carries them out.

    Attributes
    ----------
    count : int
        Number of replicates; 0 leaves the check out.
    seed : int
        Of the draws.
    reporter : Reporter
        Hears what is going on.
    workers : Workers
        Who carries them out; the result does not depend on it.
    """

    count: int = 0
    seed: int = 0
    reporter: Reporter = field(default_factory=Reporter)
    workers: Workers = field(default_factory=Workers)

    def __post_init__(self) -> None:
        problems = []
        if self.count != 0 and self.count < FEWEST:
            problems.append(
                f"--bootstrap = {self.count}, must be at least {FEWEST} draws: fewer say nothing "
                "about a standard uncertainty"
            )
        if self.seed < 0:
            problems.append(f"--seed = {self.seed}, must be >= 0")
        if problems:
            raise InputError(problems)

    @property
    def choices(self) -> dict[str, int]:
        """What of it a result was made from."""
        return {"bootstrap": self.count, "seed": self.seed} if self.count else {}


def drawn(nominal: Nominal, draws: Draws) -> Replicates:
    """Replicates in their order, however many workers there are."""
    # as a worker gets it: sums over an array round otherwise where it lies otherwise in memory
    nominal = pickle.loads(pickle.dumps(nominal))
    groups: Sequence[range] = [
        range(first, min(first + PER_CALL, draws.count))
        for first in range(0, draws.count, PER_CALL)
    ]
    parts: dict[int, Replicates] = {}
    calls = [(nominal, draws.seed, group) for group in groups]
    with draws.reporter.progress("Monte Carlo", len(groups)) as advance:
        for index, part in draws.workers.as_ended(replicates, calls):
            parts[index] = part
            advance()
    return gathered([parts[i] for i in range(len(groups))])


def check_table(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows of the check as they are shown."""
    return [{name: row.get(name) for name in COLUMNS} for row in rows]
