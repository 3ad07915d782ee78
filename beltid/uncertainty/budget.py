"""Uncertainty budget: every contribution named, compared and combined (JCGM 100).

A result may have several values (the runs of a campaign, the nodes of a surface). A contribution is
stated by its root mean square over them and by its largest value, relative to the result. The
combined uncertainty is the root of the sum of squares at each value.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltid.laws.friction_surface import FrictionSurface
from beltid.uncertainty.sources import FITTED, Source

Array = NDArray[np.float64]

LEVEL = 0.95
TOGETHER = "all together"
EACH = "each run"
COMBINED = "combined"
LEAST_PERCENT = 1.0e-6


@dataclass(frozen=True, slots=True)
class Scatter:
    """Contribution that varies from run to run, or from sample to sample.

    Attributes
    ----------
    name : str
        Name of the contribution.
    relative : ndarray, shape (n,)
        Standard uncertainty over the result [-].
    degrees_of_freedom : float or None
        Degrees of freedom of its estimate; None if not known.
    """

    name: str
    relative: Array
    degrees_of_freedom: float | None = None


def budget(
    quantity: str, sources: Sequence[Source], changes: Array, *scatter: Scatter
) -> list[dict[str, Any]]:
    """Return the rows of a budget, with the combined standard uncertainty last.

    Parameters
    ----------
    quantity : str
        The result whose budget it is.
    sources : sequence of Source
        Errors that act on all values together.
    changes : ndarray, shape (n, K)
        Relative change of the n values by one standard uncertainty of each source [-].
    *scatter : Scatter
        Other contributions, independent of each other; at least one.

    Returns
    -------
    list of dict
        quantity, source, acts_on, basis, standard_uncertainty, unit, contribution_percent,
        largest_percent, share_percent (of the combined variance), degrees_of_freedom.
    """
    n = scatter[0].relative.size
    variance = {source.name: np.zeros(n) for source in sources}
    for source, change in zip(sources, changes.T, strict=True):
        variance[source.name] += change**2
    total = sum((np.square(s.relative) for s in scatter), start=sum(variance.values(), np.zeros(n)))
    whole = float(np.mean(total))

    def row(name: str, acts_on: str, part: Array, **stated: Any) -> dict[str, Any]:
        labels = {"quantity": quantity, "source": name, "acts_on": acts_on}
        unknown = {"basis": "", "standard_uncertainty": None, "unit": ""}
        figures = {**_figures(part, whole), "degrees_of_freedom": None}
        return labels | unknown | figures | stated

    first = {source.name: source for source in reversed(sources)}
    shared = [row(name, TOGETHER, part, **_stated(first[name])) for name, part in variance.items()]
    shared = [entry for entry in shared if entry["largest_percent"] > LEAST_PERCENT]
    shared.sort(key=lambda entry: -entry["contribution_percent"])
    each = [
        row(
            s.name,
            EACH,
            np.square(s.relative),
            basis=FITTED,
            degrees_of_freedom=s.degrees_of_freedom,
        )
        for s in scatter
        if np.any(s.relative)
    ]
    freedom = effective_freedom(whole, scatter)
    known_freedom = None if math.isinf(freedom) else freedom
    return [*shared, *each, row(COMBINED, "", total, degrees_of_freedom=known_freedom)]


def _stated(source: Source) -> dict[str, Any]:
    """Return basis and size of a source; a fitted source has no size to state."""
    if source.basis == FITTED:
        return {"basis": FITTED}
    return {"basis": source.basis, "standard_uncertainty": source.shown, "unit": source.unit}


def combined(changes: Array, scatter: Array) -> Array:
    """Combine shared errors (n, K) and scatter (n,) to relative standard uncertainties (n,)."""
    return np.asarray(np.sqrt(np.sum(np.square(changes), axis=-1) + np.square(scatter)))


def effective_freedom(whole: float, scatter: Sequence[Scatter]) -> float:
    """Compute the effective degrees of freedom by Welch and Satterthwaite; may be infinite.

    Only scatter has finite degrees of freedom: a stated standard uncertainty counts as exact.
    """
    reciprocal_sum = sum(
        float(np.mean(np.square(part.relative))) ** 2 / part.degrees_of_freedom
        for part in scatter
        if part.degrees_of_freedom is not None
    )
    return whole**2 / reciprocal_sum if reciprocal_sum > 0.0 else math.inf


def _figures(square: Array, whole: float) -> dict[str, float]:
    mean = float(np.mean(square))
    return {
        "contribution_percent": 100.0 * math.sqrt(mean),
        "largest_percent": 100.0 * math.sqrt(float(np.max(square))),
        "share_percent": 100.0 * mean / whole if whole > 0.0 else 0.0,
    }


QUANTITY = "surface"


@dataclass(frozen=True, slots=True)
class SurfaceUncertainty:
    """Covariance of ln mu at the nodes of a surface by its causes.

    Attributes
    ----------
    surface : FrictionSurface
        The surface.
    sources : sequence of Source
        Errors that all nodes share.
    changes : ndarray, shape (nf, nv, K)
        Change of ln mu by one standard uncertainty of each source.
    scatter : ndarray, shape (nf, nv, r)
        Factor of the covariance by scatter from run to run.
    arcs_deg : ndarray
        Arc settings in the order in which the sources number them [deg].
    degrees_of_freedom : float or None
        Degrees of freedom of the scatter.
    """

    surface: FrictionSurface
    sources: Sequence[Source]
    changes: np.ndarray
    scatter: np.ndarray
    arcs_deg: np.ndarray
    degrees_of_freedom: float | None = None

    @property
    def factor(self) -> np.ndarray:
        """Factor of the total covariance (nf, nv, K + r), shared sources first."""
        return np.concatenate([self.changes, self.scatter], axis=-1)

    def columns(self, n_rows: int) -> dict[str, Any]:
        """Return columns of the surface table: rows of the average first, all others empty.

        Parameters
        ----------
        n_rows : int
            Number of rows of the table.
        """
        mu = self.surface.mu_nodes
        rows = self.factor.reshape(mu.size, -1)
        u = np.full(n_rows, np.nan)
        u[: mu.size] = mu.ravel() * np.sqrt(np.sum(np.square(rows), axis=1))
        factor = np.full((n_rows, max(rows.shape[1], 1)), np.nan)
        factor[: mu.size] = rows if rows.shape[1] else 0.0
        return {"mu_u": u, "mu_factor": factor}

    def extra(self, force_range: tuple[float, float]) -> dict[str, Any]:
        """Return the sources of the factor's columns, and the budget over a force range [N/m]."""
        low, high = force_range
        f = self.surface.normal_force_N_m
        inside = (f >= low * (1.0 - 1e-9)) & (f <= high * (1.0 + 1e-9))
        inside = inside if inside.any() else np.ones(f.size, dtype=bool)
        scatter = np.sqrt(np.sum(np.square(self.scatter[inside]), axis=-1)).ravel()
        changes = self.changes[inside].reshape(scatter.size, len(self.sources))
        rows = budget(
            QUANTITY,
            self.sources,
            changes,
            Scatter("scatter of the runs", scatter, self.degrees_of_freedom),
        )
        sources = [asdict(source) for source in self.sources]
        return {
            "uncertainty": {
                "sources": sources,
                "arcs_deg": self.arcs_deg,
                "budget_force_N_m": [low, high],
            },
            "budget": rows,
        }
