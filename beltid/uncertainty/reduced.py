"""Combined uncertainties of reduced recordings: press law, runs of the rig, published surface.

The procedure of the published surface is a chain of formulas and splines without iteration, so it
is repeated with each error corrected. Its nodes lie where the runs are and move with them; a change
is taken at the moved node and shifted back to the force and speed of the nominal node along the
slope of the surface.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from beltid.identify.friction.kinds import TWO_CELLS, RigKind
from beltid.identify.press.stiffness import LawEstimate
from beltid.identify.surface.curves import Points, SurfaceGrid
from beltid.identify.surface.surface import grid_through
from beltid.laws.penalty import NormalLaw
from beltid.uncertainty.budget import Scatter, budget, combined
from beltid.uncertainty.measured import Measured, PressLaw, measured_runs, valid_rows
from beltid.uncertainty.sources import (
    Errors,
    Source,
    StandardUncertainties,
    changes_by,
    press_sources,
    reduction_sources,
    rig_sources,
)

Array = NDArray[np.float64]


def published_grid(measured: Measured) -> SurfaceGrid:
    """Build the averaged surface of a campaign by the published procedure."""
    points = Points(
        arc_deg=np.degrees(measured.beta),
        f=measured.normal_force,
        v=measured.slip_speed,
        mu=measured.mu,
        se=measured.mu_se,
    )
    return grid_through(points)[0]


def changes_at_nodes(nominal: SurfaceGrid, other: SurfaceGrid) -> Array:
    """Return the change of ln mu at the nominal nodes (nf, nv), other minus nominal."""
    surface = nominal.to_surface()
    f, v = nominal.normal_force_N_m[:, None], nominal.slip_speed_m_s[None, :]
    if other.mu.shape != nominal.mu.shape:  # nodes were added or removed
        return np.asarray(np.log(other.to_surface().mu(f, v) / nominal.mu))
    by_f, by_v = surface.gradient(f, v)
    f_step = np.log(other.normal_force_N_m / nominal.normal_force_N_m)[:, None]
    v_step = np.log(other.slip_speed_m_s / nominal.slip_speed_m_s)[None, :]
    along = (by_f * f * f_step + by_v * v * v_step) / nominal.mu
    return np.asarray(np.log(other.mu / nominal.mu) - along)


def published_changes(measured: Measured, nominal: SurfaceGrid, sources: Sequence[Source]) -> Array:
    """Compute the change of ln mu at the nodes by one u of each source, (nf, nv, K)."""

    def repeated(errors: Errors) -> Array:
        return changes_at_nodes(nominal, published_grid(measured.corrected(errors)))

    return changes_by(sources, repeated)


COEFFICIENTS: Final = ("k_linear_N_m2", "k_quadratic_N_m3")
Found = tuple[dict[str, np.ndarray], list[dict[str, Any]]]


def friction_uncertainty(
    columns: Mapping[str, np.ndarray],
    given: StandardUncertainties,
    R: float,
    kind: RigKind = TWO_CELLS,
) -> Found:
    """Compute the combined uncertainties of the runs of a friction rig, and their budget.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Columns of the friction table.
    given : StandardUncertainties
        Standard uncertainties of the bench.
    R : float
        Radius of the belt's centreline on the pulley [m].
    kind : RigKind
        What the rig measures.

    Returns
    -------
    columns, budget
        ``mu_sliding_u`` [-] and ``normal_force_u_N_m``, nan for runs that cannot be used; one row
        per quantity and source.
    """
    rows = valid_rows(columns, np.flatnonzero(columns["status"] == "ok"))
    found = {key: np.full(len(columns["status"]), np.nan) for key in ("mu", "force")}
    lines: list[dict[str, Any]] = []
    if rows.size:  # a table may state coefficients without an arc
        measured = measured_runs(columns, rows, R, kind)
        bench = rig_sources(given, int(measured.arc.max()) + 1, bent=kind.spans.EI > 0.0)
        sources = (*bench, *reduction_sources(measured.columns))
        mu, force = (
            changes_by(sources, lambda e: measured.corrected(e).mu) / measured.mu[:, None],
            changes_by(sources, lambda e: measured.corrected(e).normal_force)
            / measured.normal_force[:, None],
        )
        scatter, none = measured.mu_se / measured.mu, np.zeros(rows.size)
        found["mu"][rows] = measured.mu * combined(mu, scatter)
        found["force"][rows] = measured.normal_force * combined(force, none)
        words = "scatter of the samples"
        lines = budget("mu_sliding", sources, mu, Scatter(words, scatter))
        lines += budget("normal_force_N_m", sources, force, Scatter(words, none))
    return {"mu_sliding_u": found["mu"], "normal_force_u_N_m": found["force"]}, lines


def stiffness_uncertainty(
    laws: Sequence[LawEstimate], given: StandardUncertainties, segment_length_m: float
) -> Found:
    """Compute the uncertainties of normal contact laws, and the budget of the last (pooled) one.

    Parameters
    ----------
    laws : sequence of LawEstimate
        The laws.
    given : StandardUncertainties
        Standard uncertainties of the press.
    segment_length_m : float
        Length of belt under the press [m].

    Returns
    -------
    columns, budget
        ``k_linear_u_N_m2`` and ``k_quadratic_u_N_m3``; one row per coefficient and source.
    """
    sources = press_sources(given)
    u = np.zeros((len(laws), 2))
    rows: list[dict[str, Any]] = []
    for i, law in enumerate(laws):
        k = np.array([law.k_linear_N_m2, law.k_quadratic_N_m3])
        size = np.where(k > 0.0, k, 1.0)
        normal_law = NormalLaw(*k.tolist())
        press = PressLaw(normal_law, np.zeros((2, 2)), law.max_penetration_m, segment_length_m)
        changes = changes_by(sources, press.coefficients) / size[:, None]
        scatter = np.array([law.k_linear_se_N_m2, law.k_quadratic_se_N_m3]) / size
        u[i] = size * combined(changes, scatter)
        freedom = max(law.n_effective - 2.0 - len(law.contact_m), 1.0)
        if law is laws[-1]:
            for j, name in enumerate(COEFFICIENTS):
                part = Scatter("scatter of the press curves", scatter[j : j + 1], freedom)
                rows += budget(name, sources, changes[j : j + 1], part)
    return {"k_linear_u_N_m2": u[:, 0], "k_quadratic_u_N_m3": u[:, 1]}, rows
