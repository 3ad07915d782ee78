"""Where the linear uncertainty is not good enough: replicates against the law of propagation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltid.errors import ConvergenceError
from beltid.uncertainty.monte_carlo import Nominal, Replicates
from beltid.uncertainty.published import published_changes, published_curves, scatter_factor
from beltid.uncertainty.sources import Source

Array = NDArray[np.float64]

LARGEST_DEVIATION = 0.20
"""Relative difference of standard uncertainties that is too large."""
LARGEST_ASYMMETRY = 1.25
"""Upper over lower half-width of the 95 % interval, or its inverse, that is too large."""
CHANCE = 3.0
"""Standard errors of a figure from replicates within which it is chance."""
MOST_FAILED = 0.5
SHOWN = 3
"""Draws that failed and are shown."""
QUANTILES = (0.025, 0.5, 0.975)
# standard errors of figures from n normal replicates, times sqrt(n)
OF_DEVIATION = math.sqrt(0.5)
OF_LOG_ASYMMETRY = 1.9


@dataclass(frozen=True, slots=True)
class LinearCheck:
    """Comparison of replicates with the linear standard uncertainties of some values.

    Attributes
    ----------
    replicates : int
        Number of replicates.
    linear, found : ndarray, shape (n,)
        Standard uncertainties of ln mu: linear, and standard deviation of the replicates.
    deviation : ndarray, shape (n,)
        ``found / linear - 1``.
    asymmetry : ndarray, shape (n,)
        Upper over lower half-width of the interval that holds 95 % of the replicates.
    """

    replicates: int
    linear: Array
    found: Array
    deviation: Array
    asymmetry: Array

    @property
    def too_far(self) -> NDArray[np.bool_]:
        """Values whose standard uncertainty differs by more than a fifth, beyond chance (n,)."""
        chance = CHANCE * OF_DEVIATION / math.sqrt(self.replicates)
        return np.asarray(np.abs(self.deviation) > max(LARGEST_DEVIATION, chance))

    @property
    def lopsided(self) -> NDArray[np.bool_]:
        """Values with an asymmetric distribution, beyond chance (n,)."""
        chance = CHANCE * OF_LOG_ASYMMETRY / math.sqrt(self.replicates)
        return np.asarray(np.abs(np.log(self.asymmetry)) > max(math.log(LARGEST_ASYMMETRY), chance))

    @property
    def fails(self) -> NDArray[np.bool_]:
        """Values for which the linear uncertainty is not good enough (n,)."""
        return self.too_far | self.lopsided

    def row(self, group: str, chosen: NDArray[np.bool_]) -> dict[str, object]:
        """A row that sums up the values chosen by a mask (n,)."""
        if not chosen.any():
            return {"group": group, "values": 0, "linear_fails": 0}
        deviation, asymmetry = self.deviation[chosen], np.log(self.asymmetry[chosen])
        return {
            "group": group,
            "values": int(np.count_nonzero(chosen)),
            "linear_percent": _rms_percent(self.linear[chosen]),
            "monte_carlo_percent": _rms_percent(self.found[chosen]),
            "largest_deviation_percent": 100.0 * float(deviation[np.argmax(np.abs(deviation))]),
            "largest_asymmetry": float(np.exp(asymmetry[np.argmax(np.abs(asymmetry))])),
            "linear_fails": int(np.count_nonzero(self.fails[chosen])),
        }


def linear_check(replicates: Array, linear: Array) -> LinearCheck:
    """Compare replicates (N, n) of ln mu with linear standard uncertainties (n,).

    A value without uncertainty on both sides agrees.
    """
    low, middle, high = np.quantile(replicates, QUANTILES, axis=0)
    found = np.std(replicates, axis=0, ddof=1)
    none = (linear <= 0.0) | (found <= 0.0)
    safe = np.where(none, 1.0, linear)
    lower, upper = np.where(none, 1.0, middle - low), np.where(none, 1.0, high - middle)
    return LinearCheck(
        replicates=replicates.shape[0],
        linear=linear,
        found=found,
        deviation=np.where(none, 0.0, found / safe - 1.0),
        asymmetry=upper / lower,
    )


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

    def extra(self, seed: int) -> dict[str, Any]:
        """What the artifact keeps beside the members."""
        return {
            "monte_carlo": {
                "replicates": self.found.refined.shape[0],
                "seed": seed,
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


def check_of(
    nominal: Nominal, found: Replicates, factor: Array, sources: Sequence[Source]
) -> MonteCarlo:
    """Compare replicates with the linear uncertainties of both surfaces.

    Parameters
    ----------
    nominal : Nominal
        What they started from.
    found : Replicates
        The replicates.
    factor : ndarray, shape (nf, nv, K + r)
        Factor of the covariance of ln mu at the nodes of the refined surface.
    sources : sequence of Source
        Errors that runs share.

    Raises
    ------
    ConvergenceError
        If half of the replicates failed.
    """
    count, asked = found.refined.shape[0], found.refined.shape[0] + len(found.failed)
    if count <= MOST_FAILED * asked:
        raise ConvergenceError(
            [
                f"Monte Carlo: {len(found.failed)} of {asked} draws failed, more than half "
                "must succeed: the uncertainties are too large for the rig",
                *found.failed[:SHOWN],
            ]
        )
    measured, grid, settings = nominal.campaign.measured, nominal.published, nominal.settings
    of_published = np.concatenate(
        [
            published_changes(measured, grid, sources, settings),
            scatter_factor(published_curves(measured), grid, arcs=False),
        ],
        axis=-1,
    )
    return MonteCarlo(
        nominal=nominal,
        found=found,
        refined=linear_check(found.refined.reshape(count, -1), _size(factor)),
        published=linear_check(found.published.reshape(count, -1), _size(of_published)),
    )


def _size(factor: Array) -> Array:
    return np.asarray(np.sqrt(np.sum(np.square(factor), axis=-1)).ravel())


def _rms_percent(values: Array) -> float:
    return 100.0 * float(np.sqrt(np.mean(np.square(values))))
