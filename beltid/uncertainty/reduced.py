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
    StandardUncertainties,
    changes_by,
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
