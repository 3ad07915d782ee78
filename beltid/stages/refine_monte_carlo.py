"""The Monte Carlo check of a refined surface: replicates spread over workers, and what they say."""

from __future__ import annotations

import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from beltid.errors import ConvergenceError, InputError
from beltid.identify.surface.surface import SurfaceSettings
from beltid.refine.inverse import RefinedSurface
from beltid.stages.reporter import Reporter
from beltid.stages.surface_doubt import SurfaceUncertainty
from beltid.stages.workers import Workers
from beltid.uncertainty.campaign import Campaign
from beltid.uncertainty.linear_check import LinearCheck, linear_check
from beltid.uncertainty.monte_carlo import Nominal, Replicates, gathered, prepare, replicates
from beltid.uncertainty.published import published_changes, published_curves, scatter_factor

PER_CALL: Final = 5
FEWEST: Final = 50
MOST_FAILED: Final = 0.5
SHOWN: Final = 3
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


@dataclass(frozen=True, slots=True)
class MonteCarlo:
    """Replicates of a refined surface with what they say about the linear uncertainties.

    Attributes
    ----------
    nominal : Nominal
        What they started from.
    found : Replicates
        The replicates.
    refined, published : LinearCheck
        Comparison at the nodes of both surfaces.
    """

    nominal: Nominal
    found: Replicates
    refined: LinearCheck
    published: LinearCheck

    def members(self) -> np.ndarray:
        """Mu at the nodes of the refined surface of each replicate, shape (nodes, n)."""
        mu = self.nominal.refined.surface.mu_nodes
        return np.asarray((mu * np.exp(self.found.refined)).reshape(-1, mu.size).T)

    def table(self) -> list[dict[str, Any]]:
        """Rows for printing: where the linear uncertainty holds and where it does not."""
        force = self.nominal.campaign.measured.normal_force
        surface, grid = self.nominal.refined.surface, self.nominal.published
        f = np.repeat(surface.normal_force_N_m, surface.slip_speed_m_s.size)
        inside = (f >= force.min()) & (f <= force.max())
        everywhere = np.ones(grid.mu.size, dtype=bool)
        return [
            self.refined.row("refined surface, forces of the runs", inside),
            self.refined.row("refined surface, beyond them", ~inside),
            self.published.row("published surface", everywhere),
        ]

    def extra(self, draws: Draws) -> dict[str, Any]:
        """What the artifact keeps beside the members."""
        return {
            "monte_carlo": {
                "replicates": self.found.refined.shape[0],
                "seed": draws.seed,
                "failed": list(self.found.failed),
                "table": self.table(),
                "linear_fails_at": self._places(),
            }
        }

    def _places(self) -> list[dict[str, float]]:
        """Nodes of the refined surface where the linear uncertainty is not good enough."""
        surface, check = self.nominal.refined.surface, self.refined
        n = surface.slip_speed_m_s.size
        return [
            {
                "normal_force_N_m": float(surface.normal_force_N_m[i // n]),
                "slip_speed_m_s": float(surface.slip_speed_m_s[i % n]),
                "linear_percent": 100.0 * float(check.linear[i]),
                "monte_carlo_percent": 100.0 * float(check.found[i]),
                "asymmetry": float(check.asymmetry[i]),
            }
            for i in np.flatnonzero(check.fails).tolist()
        ]

    def note(self) -> str:
        """The verdict in a sentence."""
        n, fails = self.found.refined.shape[0], int(np.count_nonzero(self.refined.fails))
        if not fails:
            return (
                f"Monte Carlo with {n} draws: the linear uncertainty of the refined surface is "
                "right within a fifth, and its distribution symmetric, at every node"
            )
        force = sorted({place["normal_force_N_m"] for place in self._places()})
        where = ", ".join(f"{f:.0f}" for f in force[:8]) + (" ..." if len(force) > 8 else "")
        return (
            f"Monte Carlo with {n} draws: the linear uncertainty of the refined surface is not "
            f"good enough at {fails} of {self.refined.linear.size} nodes (forces {where} N/m); use "
            "the ensemble there"
        )

    def warnings(self) -> tuple[str, ...]:
        """Replicates that failed."""
        failed = self.found.failed
        if not failed:
            return ()
        more = f" and {len(failed) - SHOWN} more" if len(failed) > SHOWN else ""
        return (f"{len(failed)} draws failed: {'; '.join(failed[:SHOWN])}{more}",)


def monte_carlo(
    campaign: Campaign,
    refined: RefinedSurface,
    uncertainty: SurfaceUncertainty,
    slopes: np.ndarray,
    settings: SurfaceSettings,
    draws: Draws,
) -> MonteCarlo:
    """Draw the replicates and compare them with the linear uncertainties of both surfaces.

    Raises
    ------
    ConvergenceError
        If half of the replicates fail.
    """
    speeds, sources = refined.surface.slip_speed_m_s, uncertainty.sources
    nominal = prepare(campaign, refined, speeds, settings, (sources, slopes))
    found = _spread_out(nominal, draws)
    count = found.refined.shape[0]
    if count <= MOST_FAILED * draws.count:
        raise ConvergenceError(
            [
                f"Monte Carlo: {len(found.failed)} of {draws.count} draws failed, more than half "
                "must succeed: the uncertainties are too large for the rig",
                *found.failed[:SHOWN],
            ]
        )
    measured, grid = campaign.measured, nominal.published
    of_published = np.concatenate(
        [
            published_changes(measured, grid, sources, settings),
            scatter_factor(published_curves(measured, settings), grid, arcs=False),
        ],
        axis=-1,
    )
    return MonteCarlo(
        nominal=nominal,
        found=found,
        refined=linear_check(found.refined.reshape(count, -1), _size(uncertainty.factor)),
        published=linear_check(found.published.reshape(count, -1), _size(of_published)),
    )


def _size(factor: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.sum(np.square(factor), axis=-1)).ravel())


def _spread_out(nominal: Nominal, draws: Draws) -> Replicates:
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
