"""Agreement of measured and simulated friction coefficients (paper, section 7, Figs. 16 and 17).

Both sides come from the same reduction. Runs are matched by their settings, compared per arc and
averaged over arcs, and split by normal force, as the paper finds its differences at low and high
force.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError
from beltid.identify.agreement.matching import (
    Matches,
    MatchSettings,
    RunTable,
    match_runs,
    run_table,
)
from beltid.identify.agreement.result import (
    AgreementResult,
    AgreementSettings,
    Statistics,
    statistics,
)

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
    matches = match_runs(*tables, settings.match)
    _refuse_nothing(matches, *tables)
    real, virtual = tables[0].take(matches.measured), tables[1].take(matches.simulated)
    relative = (virtual.mu - real.mu) / real.mu
    bands = _force_bands(real.force)
    averaged = _averages_over_arcs(real, virtual.mu, settings.match)
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
        overall=statistics("all points", relative, real.force),
        over_arc_averages=statistics(
            "means over arcs", averaged["relative_difference"], averaged["normal_force_N_m"]
        ),
        per_arc=_per_arc(real, relative, settings.match),
        thirds=tuple(
            statistics(
                f"{word} third of the force", relative[bands == word], real.force[bands == word]
            )
            for word in FORCE_BANDS
        ),
        settings=settings,
        n_measured=tables[0].size,
        n_simulated=tables[1].size,
        n_usable=int(np.count_nonzero(tables[0].reason == "")),
        not_compared=matches.counts,
        not_compared_runs=matches.left_out,
        rows=(matches.measured, matches.simulated),
    )


def _refuse_nothing(matches: Matches, measured: RunTable, simulated: RunTable) -> None:
    if matches.measured.size == 0:
        raise InputError(
            [
                "compare: no measured run has a simulated partner, must be at least one "
                f"({measured.size} measured and {simulated.size} simulated runs)",
                *(f"{count} runs: {reason}" for reason, count in matches.counts.items()),
            ]
        )


def _per_arc(real: RunTable, relative: Array, match: MatchSettings) -> tuple[Statistics, ...]:
    labels = match.arc_labels(real)
    return tuple(
        statistics(f"arc {real.arc_deg[labels == a].mean():g}°", relative[here], real.force[here])
        for a in range(labels.max() + 1)
        for here in (labels == a,)
    )


def _force_bands(force: Array) -> NDArray[np.object_]:
    """Third of the points by force (n,): groups of nearly equal size, empty below three points."""
    bands = np.empty(force.size, dtype=object)
    parts = np.array_split(np.argsort(force, kind="stable"), 3)
    for word, part in zip(FORCE_BANDS, parts, strict=True):
        bands[part] = word
    return bands


def _averages_over_arcs(
    real: RunTable, mu_simulated: Array, match: MatchSettings
) -> dict[str, NDArray[Any]]:
    """Means over the matched arcs of each tension and speed, repetitions of an arc first."""
    arcs = match.arc_labels(real)
    settings = np.stack([match.tension_labels(real), match.speed_labels(real)], axis=1)
    rows = []
    for setting in np.unique(settings, axis=0):
        here = np.all(settings == setting, axis=1)
        data = np.stack([real.tension, real.speed, real.force, real.mu, mu_simulated], axis=1)
        per_arc = [data[here & (arcs == a)].mean(axis=0) for a in np.unique(arcs[here])]
        rows.append([*np.mean(per_arc, axis=0), float(len(per_arc))])
    names = (
        "nominal_tension_N",
        "pulley_speed_rad_s",
        "normal_force_N_m",
        "mu_measured",
        "mu_simulated",
        "n_arcs",
    )
    columns: dict[str, NDArray[Any]] = dict(zip(names, np.array(rows).T, strict=True))
    columns["n_arcs"] = columns["n_arcs"].astype(np.int64)
    columns["difference"] = columns["mu_simulated"] - columns["mu_measured"]
    columns["relative_difference"] = columns["difference"] / columns["mu_measured"]
    return columns
