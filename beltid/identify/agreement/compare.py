"""Agreement of measured and simulated friction coefficients (paper, section 7, Figs. 16 and 17).

Both sides come from the same reduction. Runs are matched by their settings, compared per arc and
averaged over arcs, and split by normal force, as the paper finds its differences at low and high
force.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError
from beltid.identify.agreement.matching import MatchSettings, RunTable, match_runs, run_table
from beltid.identify.agreement.result import (
    AgreementResult,
    AgreementSettings,
    Statistics,
    statistics,
)
from beltid.identify.surface.curves import settings_of

__all__ = ["AgreementResult", "AgreementSettings", "MatchSettings", "Statistics", "compare_points"]

Array = NDArray[np.float64]

FORCE_BANDS = ("low", "middle", "high")


def compare_points(
    measured: Mapping[str, ArrayLike],
    simulated: Mapping[str, ArrayLike],
    settings: AgreementSettings | None = None,
) -> AgreementResult:
    """Compare the reduced runs of the bench with those of the simulated bench.

    Parameters
    ----------
    measured, simulated : mapping of str to array_like (n,)
        Columns of the reduction: run, arc_deg, nominal_tension_N, pulley_speed_rad_s,
        normal_force_N_m, mu_sliding and, if there, status (other than "ok": set aside).
    settings : AgreementSettings, optional
        Without tolerances nothing is judged.

    Returns
    -------
    AgreementResult

    Raises
    ------
    InputError
        If a column is missing, or no measured run has a simulated partner.
    """
    settings = settings or AgreementSettings()
    tables = run_table(measured, "measured"), run_table(simulated, "simulated")
    *rows, left_out = match_runs(*tables, settings.match)
    counts = dict(Counter(reason for _, reason in left_out).most_common())
    n_measured, n_simulated = (table.mu.size for table in tables)
    if rows[0].size == 0:
        raise InputError(
            [
                "compare: no measured run has a simulated partner, must be at least one "
                f"({n_measured} measured and {n_simulated} simulated runs)",
                *(f"{count} runs: {reason}" for reason, count in counts.items()),
            ]
        )
    real, virtual = (table.take(index) for table, index in zip(tables, rows, strict=True))
    relative = (virtual.mu - real.mu) / real.mu
    bands = _force_bands(real.force)
    arcs = settings_of(real.arc_deg, settings.match.arc)
    averaged = _averages_over_arcs(real, virtual.mu, arcs, settings.match)

    def group(name: str, here: NDArray[np.bool_]) -> Statistics:
        return statistics(name, relative[here], real.force[here])

    return AgreementResult(
        run=real.run,
        arc_deg=real.arc_deg,
        nominal_tension_N=real.tension,
        pulley_speed_rad_s=real.speed,
        normal_force_N_m=real.force,
        mu_measured=real.mu,
        mu_simulated=virtual.mu,
        force_band=bands,
        averaged=averaged,
        overall=group("all points", np.ones(relative.size, dtype=bool)),
        over_arc_averages=statistics(
            "means over arcs", averaged["relative_difference"], averaged["normal_force_N_m"]
        ),
        per_arc=tuple(
            group(f"arc {real.arc_deg[arcs == a].mean():g}°", arcs == a)
            for a in range(arcs.max() + 1)
        ),
        thirds=tuple(group(f"{word} third of the force", bands == word) for word in FORCE_BANDS),
        settings=settings,
        n_measured=n_measured,
        n_simulated=n_simulated,
        n_usable=int(np.count_nonzero(tables[0].reason == "")),
        not_compared=counts,
        not_compared_runs=left_out,
        rows=(rows[0], rows[1]),
    )


def _force_bands(force: Array) -> NDArray[np.object_]:
    """Third of the points by force (n,): groups of nearly equal size, empty below three points."""
    bands = np.empty(force.size, dtype=object)
    parts = np.array_split(np.argsort(force, kind="stable"), 3)
    for word, part in zip(FORCE_BANDS, parts, strict=True):
        bands[part] = word
    return bands


def _averages_over_arcs(
    real: RunTable, mu_simulated: Array, arcs: NDArray[np.intp], match: MatchSettings
) -> dict[str, NDArray[Any]]:
    """Means over the matched arcs of each tension and speed, repetitions of an arc first."""
    columns: dict[str, NDArray[Any]] = {
        "nominal_tension_N": real.tension,
        "pulley_speed_rad_s": real.speed,
        "normal_force_N_m": real.force,
        "mu_measured": real.mu,
        "mu_simulated": mu_simulated,
    }
    data = np.stack(list(columns.values()), axis=1)
    setting = np.stack(
        [settings_of(real.tension, match.tension), settings_of(real.speed, match.speed)], axis=1
    )
    means, counts = [], []
    for one in np.unique(setting, axis=0):
        here = np.all(setting == one, axis=1)
        per_arc = [data[here & (arcs == a)].mean(axis=0) for a in np.unique(arcs[here])]
        means.append(np.mean(per_arc, axis=0))
        counts.append(len(per_arc))
    columns = dict(zip(columns, np.array(means).T, strict=True))
    columns["n_arcs"] = np.array(counts, dtype=np.int64)
    columns["difference"] = columns["mu_simulated"] - columns["mu_measured"]
    columns["relative_difference"] = columns["difference"] / columns["mu_measured"]
    return columns
