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

TOGETHER = "all together"
EACH = "each run"
COMBINED = "combined"
QUANTITY = "surface"
LEAST_PERCENT = 1.0e-6


@dataclass(frozen=True, slots=True)
class Scatter:
    """Contribution that varies from run to run, or from sample to sample."""

    name: str  # name of the contribution
    relative: Array  # standard uncertainty over the result [-], (n,)
    degrees_of_freedom: float | None = None  # degrees of freedom of its estimate; None if not known


def budget(
    quantity: str, sources: Sequence[Source], changes: Array, *scatter: Scatter
) -> list[dict[str, Any]]:
    """Return the rows of a budget, with the combined standard uncertainty last.

    Parameters
    ----------
    quantity : str
        The result whose budget it is.
    sources : sequence of Source
        Errors that act on all values together; those of one name are one row.
    changes : ndarray, shape (n, K)
        Relative change of the n values by one standard uncertainty of each source [-].
    *scatter : Scatter
        Other contributions, independent of each other; at least one.

    Returns
    -------
    list of dict
        quantity, source, acts_on, basis (stated, assumed or fitted), standard_uncertainty, unit,
        contribution_percent, largest_percent, share_percent (of the combined variance),
        degrees_of_freedom.
    """
    total = np.square(combined(changes, np.zeros(scatter[0].relative.size)))
    total = total + sum(np.square(part.relative) for part in scatter)
    whole = float(np.mean(total))

    def row(source: str, acts_on: str, part: Array, **known: Any) -> dict[str, Any]:
        mean = float(np.mean(part))
        return {
            "quantity": quantity,
            "source": source,
            "acts_on": acts_on,
            "basis": "",
            "standard_uncertainty": None,
            "unit": "",
            "contribution_percent": 100.0 * math.sqrt(mean),
            "largest_percent": 100.0 * math.sqrt(float(np.max(part))),
            "share_percent": 100.0 * mean / whole if whole > 0.0 else 0.0,
            "degrees_of_freedom": None,
        } | known

    first = {source.name: source for source in reversed(sources)}
    shared = []
    for name in dict.fromkeys(source.name for source in sources):
        columns = [k for k, source in enumerate(sources) if source.name == name]
        known: dict[str, Any] = {"basis": first[name].basis}
        if first[name].basis != FITTED:
            known |= {"standard_uncertainty": first[name].shown, "unit": first[name].unit}
        part = np.sum(np.square(changes[:, columns]), axis=1)
        shared.append(row(name, TOGETHER, part, **known))
    shared = [entry for entry in shared if entry["largest_percent"] > LEAST_PERCENT]
    shared.sort(key=lambda entry: -entry["contribution_percent"])
    each = [
        row(part.name, EACH, np.square(part.relative), basis=FITTED, degrees_of_freedom=freedom)
        for part in scatter
        for freedom in [part.degrees_of_freedom]
        if np.any(part.relative)
    ]
    freedom = effective_freedom(whole, scatter)
    return [*shared, *each, row(COMBINED, "", total, degrees_of_freedom=freedom)]


def combined(changes: Array, scatter: Array) -> Array:
    """Combine shared errors (n, K) and scatter (n,) to relative standard uncertainties (n,)."""
    return np.asarray(np.sqrt(np.sum(np.square(changes), axis=-1) + np.square(scatter)))


def effective_freedom(whole: float, scatter: Sequence[Scatter]) -> float | None:
    """Compute the effective degrees of freedom by Welch and Satterthwaite; None if infinite.

    Only scatter has finite degrees of freedom: a stated standard uncertainty counts as exact.
    """
    reciprocal = sum(
        float(np.mean(np.square(part.relative))) ** 2 / part.degrees_of_freedom
        for part in scatter
        if part.degrees_of_freedom is not None
    )
    return whole**2 / reciprocal if reciprocal > 0.0 else None


def factor_of(covariance: Array) -> Array:
    """Factor a covariance (n, n) as S S' with S (n, r); omit directions without variance."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > 1e-10 * values[-1]
    factor = vectors[:, kept] * np.sqrt(values[kept])
    # the sign of an eigenvector is arbitrary: fix it, so that all machines agree
    largest = np.argmax(np.abs(factor), axis=0)
    signs = np.sign(factor[largest, np.arange(factor.shape[1])])
    return np.ascontiguousarray((factor * signs)[:, ::-1])


@dataclass(frozen=True, slots=True)
class SurfaceUncertainty:
    """Covariance of ln mu at the nodes of a surface by its causes."""

    surface: FrictionSurface  # the surface
    sources: Sequence[Source]  # errors that all nodes share
    changes: np.ndarray  # change of ln mu by one standard uncertainty of each source, (nf, nv, K)
    scatter: np.ndarray  # factor of the covariance by scatter from run to run, (nf, nv, r)
    arcs_deg: np.ndarray  # arc settings in the order in which the sources number them [deg]
    degrees_of_freedom: float | None = None  # degrees of freedom of the scatter

    @property
    def factor(self) -> np.ndarray:
        """Factor of the total covariance (nf, nv, K + r), shared sources first."""
        return np.concatenate([self.changes, self.scatter], axis=-1)

    def columns(self, n_rows: int) -> dict[str, Any]:
        """Return ``mu_u`` and ``mu_factor`` of a surface table of `n_rows` rows.

        The nodes come first, force by force; the other rows are empty.
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
        part = Scatter("scatter of the runs", scatter, self.degrees_of_freedom)
        return {
            "uncertainty": {
                "sources": [asdict(source) for source in self.sources],
                "arcs_deg": self.arcs_deg,
                "budget_force_N_m": [low, high],
            },
            "budget": budget(QUANTITY, self.sources, changes, part),
        }
