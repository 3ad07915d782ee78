"""What is not known of a surface as columns, metadata and a budget of its artifact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from beltid.laws.friction_surface import FrictionSurface
from beltid.uncertainty.budget import Scatter, budget
from beltid.uncertainty.sources import Source

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
        Factor of the covariance by what differs from run to run.
    arcs_deg : ndarray
        The arc settings, as the sources count them [deg].
    degrees_of_freedom : float or None
        Of the scatter.
    """

    surface: FrictionSurface
    sources: Sequence[Source]
    changes: np.ndarray
    scatter: np.ndarray
    arcs_deg: np.ndarray
    degrees_of_freedom: float | None = None

    @property
    def factor(self) -> np.ndarray:
        """Factor of the whole covariance (nf, nv, K + r), the shared sources first."""
        return np.concatenate([self.changes, self.scatter], axis=-1)

    def columns(self, n_rows: int) -> dict[str, Any]:
        """Columns of the surface table; the rows of the average come first, the others are empty.

        Parameters
        ----------
        n_rows : int
            Rows of the table.
        """
        mu = self.surface.mu_nodes
        rows = self.factor.reshape(mu.size, -1)
        u = np.full(n_rows, np.nan)
        u[: mu.size] = mu.ravel() * np.sqrt(np.sum(np.square(rows), axis=1))
        factor = np.full((n_rows, max(rows.shape[1], 1)), np.nan)
        factor[: mu.size] = rows if rows.shape[1] else 0.0
        return {"mu_u": u, "mu_factor": factor}

    def extra(self, force_range: tuple[float, float]) -> dict[str, Any]:
        """Names of the columns of the factor, and the budget over a range of forces [N/m]."""
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
        named = [asdict(source) for source in self.sources]
        return {
            "uncertainty": {
                "sources": named,
                "arcs_deg": self.arcs_deg,
                "budget_force_N_m": [low, high],
            },
            "budget": rows,
        }
