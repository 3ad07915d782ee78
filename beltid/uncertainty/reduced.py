"""Combined uncertainties of reduced recordings: coefficients of the press law, runs of the rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from beltid.identify.friction.kinds import TWO_CELLS, RigKind
from beltid.identify.press.stiffness import LawEstimate
from beltid.laws.penalty import NormalLaw
from beltid.uncertainty.budget import Scatter, budget, combined
from beltid.uncertainty.measured import measured_runs, valid_rows
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.sources import (
    Errors,
    StandardUncertainties,
    press_sources,
    reduction_sources,
    rig_sources,
)

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
    if not rows.size:  # a table may state coefficients without an arc
        none = np.full(len(columns["status"]), np.nan)
        return {"mu_sliding_u": none, "normal_force_u_N_m": none}, []
    measured = measured_runs(columns, rows, R, kind)
    bench_sources = rig_sources(given, int(measured.arc.max()) + 1, bent=kind.spans.EI > 0.0)
    sources = (*bench_sources, *reduction_sources(measured.columns))
    mu_changes, force_changes = np.zeros((2, rows.size, len(sources)))
    for k, source in enumerate(sources):
        corrected = measured.corrected(Errors.single(source))
        mu_changes[:, k] = corrected.mu / measured.mu - 1.0
        force_changes[:, k] = corrected.normal_force / measured.normal_force - 1.0
    scatter = measured.mu_se / measured.mu
    none = np.zeros(rows.size)
    mu_u, force_u = (np.full(len(columns["status"]), np.nan) for _ in range(2))
    mu_u[rows] = measured.mu * combined(mu_changes, scatter)
    force_u[rows] = measured.normal_force * combined(force_changes, none)
    mu_scatter = Scatter("scatter of the samples", scatter)
    return (
        {"mu_sliding_u": mu_u, "normal_force_u_N_m": force_u},
        [
            *budget("mu_sliding", sources, mu_changes, mu_scatter),
            *budget("normal_force_N_m", sources, force_changes, Scatter(mu_scatter.name, none)),
        ],
    )


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
        press = PressLaw(
            NormalLaw(*k.tolist()),
            np.zeros((2, 2)),
            law.max_penetration_m,
            segment_length_m,
        )
        size = np.where(k > 0.0, k, 1.0)
        changes = np.array([press.coefficients(Errors.single(s)) - k for s in sources])
        changes = changes.reshape(-1, 2) / size
        scatter = np.array([law.k_linear_se_N_m2, law.k_quadratic_se_N_m3]) / size
        unseen = np.full(2, law.unseen_share)
        u[i] = size * combined(changes.T, np.hypot(scatter, unseen))
        freedom = max(law.n_effective - 2.0 - len(law.tests), 1.0)
        if law is laws[-1]:
            for j, name in enumerate(COEFFICIENTS):
                curve_scatter = Scatter("scatter of the press curves", scatter[j : j + 1], freedom)
                unseen_scatter = Scatter("virgin rubber, loss by rate: not seen", unseen[j : j + 1])
                rows += budget(name, sources, changes[:, j][None, :], curve_scatter, unseen_scatter)
    return {"k_linear_u_N_m2": u[:, 0], "k_quadratic_u_N_m3": u[:, 1]}, rows
