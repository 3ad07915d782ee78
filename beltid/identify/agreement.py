"""Agreement of measured and simulated friction coefficients (paper, section 4, Figs. 16 and 17).

Both sides come from the same reduction. Runs are matched by their settings, compared per arc and
averaged over arcs, and grouped by normal force. Only runs that a fitted surface has not seen test
it (:func:`folds`): all runs of one contact arc, or of one speed but the outermost, are left out.
"""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from beltid.arrays import Array, Columns
from beltid.errors import InputError, NotPossible, counted
from beltid.identify.estimators import settings_of

OK = "ok"
GOOD_RATIO = 0.6, 1.2  # RMS error over its standard uncertainty that neither side has to explain
UNEXPLAINED = 2.0  # the same ratio beyond which the uncertainty lacks something
SHARE_COMPARED = "min_share_compared"
FIGURES = {
    "max_rms_relative_error": "rms",
    "max_mean_relative_error": "mean_magnitude",
    "max_relative_error": "largest",
}
THIRDS = ("low", "middle", "high")
NUMBERS = (
    "arc_deg", "nominal_tension_N", "pulley_speed_rad_s", "normal_force_N_m", "mu_sliding",
)  # fmt: skip
"""Columns that must contain numbers > 0, measured and simulated."""
SAME_SETTING = {"arc_deg": 1e-3, "nominal_tension_N": 5e-3, "pulley_speed_rad_s": 3e-2}
"""Largest relative difference between settings of matched runs; motors miss their speed by 1 %."""


def statistics(group: str, relative: Array, force: Array) -> dict[str, Any]:
    """Return a row of relative differences in percent, at forces [N/m]; None without points."""
    n, nothing = relative.size, np.full(1, np.nan)
    relative, force = (x if n else nothing for x in (relative, force))
    size = np.abs(relative)
    numbers = {
        "rms_percent": 100.0 * np.sqrt(np.mean(size**2)),
        "mean_percent": 100.0 * np.mean(relative),
        "mean_magnitude_percent": 100.0 * np.mean(size),
        "largest_percent": 100.0 * np.max(size),
        "force_low_N_m": np.min(force),
        "force_high_N_m": np.max(force),
    }
    known = {name: float(x) if n else None for name, x in numbers.items()}
    return {"group": group, "n_points": n, **known}


@dataclass(frozen=True, slots=True, eq=False)
class AgreementResult:
    """Comparison of a measured and a simulated campaign; n matched points."""

    columns: Columns  # label, settings and force of the measured run, both coefficients, (n,)
    averaged: Columns  # means over the arcs at equal tension and speed, with ``n_arcs``
    groups: tuple[dict[str, Any], ...]
    """All points, each arc (Fig. 16), the means over arcs (Fig. 17), each third of the force."""
    judged: tuple[dict[str, Any], ...]
    """For each active tolerance, see :func:`compare_points`, what was found, and if it holds."""
    n_usable: int  # usable measured runs
    not_compared_runs: tuple[tuple[str, str], ...]
    """Runs that are unusable or have no partner: label with side, reason."""
    rows: tuple[NDArray[np.intp], NDArray[np.intp]]
    """Rows of the matched runs in the measured and in the simulated table."""
    rms_over_u: float = math.nan
    """Root mean square of the differences over their standard uncertainties; nan if unknown."""

    @property
    def not_compared(self) -> dict[str, int]:
        """Number of runs not compared, by reason without its figures; the most frequent first."""
        reasons = (": ".join(reason.split(": ")[:2]) for _, reason in self.not_compared_runs)
        return dict(Counter(reasons).most_common())

    @property
    def passed(self) -> bool:
        """True if all active tolerances hold."""
        return all(row["holds"] for row in self.judged)

    @property
    def verdict(self) -> str:
        """The outcome in plain words, each tolerance with what was found."""
        words = []
        for name, found, allowed, holds in (row.values() for row in self.judged):
            if name != SHARE_COMPARED:
                figure, sign = FIGURES[name].replace("_", " "), "<=" if holds else ">"
                words.append(f"{figure} {100.0 * found:.2f} % {sign} {100.0 * allowed:g} %")
            elif not holds:
                words.append(f"runs compared {100.0 * found:.0f} % < {100.0 * allowed:g} %")
        text = f"{'PASS' if self.passed else 'FAIL'}: {', '.join(words)}"
        if self.rms_over_u > UNEXPLAINED:
            times = f"{self.rms_over_u:.2g} times as large"
            text += f"; FAIL of the uncertainty: the differences are {times}"
        return text

    @property
    def against_uncertainty(self) -> str:
        """RMS error, its uncertainty and their ratio in plain words; empty if not known."""
        ratio, rms, (low, high) = self.rms_over_u, self.groups[0]["rms_percent"], GOOD_RATIO
        if not ratio > 0.0:
            return ""
        return (
            f"the error is {rms:.2g} % RMS, its uncertainty {rms / ratio:.2g} % (without errors "
            f"common to both sides); their ratio {ratio:.2g} should be {low:g} to {high:g}"
        )


def compare_points(
    measured: Mapping[str, ArrayLike],
    simulated: Mapping[str, ArrayLike],
    tolerances: Mapping[str, float] | None = None,
) -> AgreementResult:
    """Compare the reduced runs of the real bench with those of the simulated bench.

    Both sides have the columns of the reduction (n,): run, arc_deg, nominal_tension_N,
    pulley_speed_rad_s, normal_force_N_m, mu_sliding and, optionally, status; only "ok" runs are
    used. Tolerances are fractions: of the relative differences, their root mean square
    ``max_rms_relative_error``, mean magnitude ``max_mean_relative_error`` and largest magnitude
    ``max_relative_error``; ``min_share_compared`` of the usable measured runs. Raises `InputError`
    if no measured run has a simulated partner.
    """
    tables = _run_table(measured), _run_table(simulated)
    of_measured, of_simulated, left_out = _match(*tables)
    if of_measured.size == 0:
        counts = Counter(reason for _, reason in left_out).most_common()
        sizes = "{} measured and {} simulated runs".format(*(table["run"].size for table in tables))
        none = f"compare: no measured run has a simulated partner, must be at least one ({sizes})"
        raise InputError([none, *(f"{counted(count, 'run')}: {why}" for why, count in counts)])
    real = {name: column[of_measured] for name, column in tables[0].items()}
    virtual, tolerances = tables[1]["mu_sliding"][of_simulated], tolerances or {}
    settings = {name: real[name] for name in ("run", *NUMBERS[:-1])}
    columns = settings | _differences(real["mu_sliding"], virtual)
    force, relative = real["normal_force_N_m"], columns["relative_difference"]
    columns["within_tolerance"] = np.abs(relative) <= tolerances.get("max_relative_error", np.inf)
    parts = np.array_split(np.argsort(force, kind="stable"), len(THIRDS))
    arcs = settings_of(real["arc_deg"], SAME_SETTING["arc_deg"])
    averaged = _averages_over_arcs(real, virtual, arcs)
    of_arcs = [arcs == a for a in range(arcs.max() + 1)]
    named = [(f"arc {real['arc_deg'][mask].mean():g}°", mask) for mask in of_arcs]
    thirds = [(f"{word} third of the force", g) for word, g in zip(THIRDS, parts, strict=True)]
    means = (averaged[name] for name in ("relative_difference", "normal_force_N_m"))
    overall = statistics("all points", relative, force)
    n_usable = int(np.sum(tables[0]["reason"] == ""))
    found = {name: 0.01 * overall[f"{figure}_percent"] for name, figure in FIGURES.items()}
    found[SHARE_COMPARED] = relative.size / n_usable
    return AgreementResult(
        columns=columns,
        averaged=averaged,
        groups=(
            overall,
            *(statistics(name, relative[g], force[g]) for name, g in named),
            statistics("means over arcs", *means),
            *(statistics(name, relative[g], force[g]) for name, g in thirds),
        ),
        judged=tuple(_judged(name, found[name], of) for name, of in tolerances.items()),
        n_usable=n_usable,
        not_compared_runs=left_out,
        rows=(of_measured, of_simulated),
    )


def _judged(tolerance: str, found: float, allowed: float) -> dict[str, Any]:
    """Return a row with whether a tolerance holds."""
    holds = found >= allowed if tolerance == SHARE_COMPARED else found <= allowed
    return {"tolerance": tolerance, "found": found, "allowed": allowed, "holds": bool(holds)}


def _differences(measured: Array, simulated: Array) -> Columns:
    """Return the columns of both coefficients and of their difference."""
    difference = simulated - measured
    return {
        "mu_measured": measured,
        "mu_simulated": simulated,
        "difference": difference,
        "relative_difference": difference / measured,
    }


def _run_table(columns: Mapping[str, ArrayLike]) -> Columns:
    """Return the columns, speeds without sign, and the ``reason`` against each run."""
    run = np.array([str(label) for label in np.ravel(columns["run"])], dtype=object)
    values = {name: np.asarray(columns[name], dtype=float) for name in NUMBERS}
    values["pulley_speed_rad_s"] = np.abs(values["pulley_speed_rad_s"])
    reason = np.array(columns.get("status", np.full(run.size, OK)), dtype=object)
    for k, status in enumerate(reason):
        invalid = " and ".join(name for name, x in values.items() if not 0.0 < x[k] < np.inf)
        against = f"{invalid} not a number > 0" if invalid else ""
        reason[k] = against if status == OK else str(status) or "status is empty"
    return {"run": run, **values, "reason": reason}


def _match(
    measured: Columns, simulated: Columns
) -> tuple[NDArray[np.intp], NDArray[np.intp], tuple[tuple[str, str], ...]]:
    """Match the runs: within the tolerances, the same label wins, else the nearest speed."""
    off = {n: np.abs(np.subtract.outer(measured[n], simulated[n])) for n in SAME_SETTING}
    same = [off[n] <= share * measured[n][:, None] for n, share in SAME_SETTING.items()]
    near = np.all(same, axis=0)
    fits = near & (measured["reason"] == "")[:, None] & (simulated["reason"] == "")
    named_alike = np.equal.outer(measured["run"], simulated["run"])
    order = np.where(fits, np.where(named_alike, -1.0, off["pulley_speed_rad_s"]), np.inf)
    left_out = list[tuple[str, str]]()
    for k in np.flatnonzero(~fits.any(axis=1)):
        of_measured = [f"measured: {why}" for why in measured["reason"][[k]] if why]
        of_simulated = [f"simulated: {why}" for why in simulated["reason"][near[k]]]
        why, *_ = *of_measured, *of_simulated, "no simulated run with these settings"
        left_out.append((f"measured {measured['run'][k]}", why))
    # a simulated run whose measured one is unusable is not listed: that run is
    alone = ~near.any(axis=0)
    left_out += [
        (f"simulated {run}", f"simulated: {why}" if why else "no measured run with these settings")
        for run, why in zip(simulated["run"][alone], simulated["reason"][alone], strict=True)
    ]
    rows = np.flatnonzero(fits.any(axis=1))
    partners = np.array([np.argmin(order[k]) for k in rows], dtype=np.intp)
    return rows, partners, tuple(left_out)


def _averages_over_arcs(real: Columns, mu_simulated: Array, arcs: NDArray[np.intp]) -> Columns:
    """Average the repetitions of each arc, then the arcs of each tension and speed."""
    data = np.stack([*(real[name] for name in NUMBERS[1:]), mu_simulated])
    names = ("nominal_tension_N", "pulley_speed_rad_s")
    settings = [settings_of(real[name], SAME_SETTING[name]) for name in names]
    cells, of_run = np.unique([*settings, arcs], axis=1, return_inverse=True)
    _, of_cell = np.unique(cells[:2], axis=1, return_inverse=True)
    for label in (of_run, of_cell):
        data = np.array([np.bincount(label, x) for x in data]) / np.bincount(label)
    means = dict(zip((*NUMBERS[1:-1], "measured", "simulated"), data, strict=True))
    found = _differences(means.pop("measured"), means.pop("simulated"))
    return {**means, **found, "n_arcs": np.bincount(of_cell)}


SETTING = {"arc": ("arc_deg", "°", 2), "speed": ("pulley_speed_rad_s", " rad/s", 3)}
"""Column of each setting, its unit as printed, and the fewest of which one can be left out."""
FEWEST_RUNS = 4  # minimum number of runs to refine a surface from


@dataclass(frozen=True, slots=True)
class Fold:
    """A setting that is left out."""

    by: str
    name: str  # such as "arc 40°"
    left_out: NDArray[np.intp]  # rows of the runs to predict
    rest: NDArray[np.intp]  # rows of the runs to refine the surface from


def folds(columns: Mapping[str, np.ndarray], usable: NDArray[np.intp], by: str) -> tuple[Fold, ...]:
    """List the settings, "arc" or "speed", that can be left out, in ascending order.

    From columns (n,) of reduced runs and the rows of the usable ones. Raises
    :class:`NotPossible` if too few settings or runs would remain.
    """
    if by not in SETTING:
        raise InputError(f"by = {by}, must be {' or '.join(SETTING)}")
    column, unit, fewest = SETTING[by]
    values = np.abs(np.asarray(columns[column], dtype=float)[usable])
    label = settings_of(values, SAME_SETTING[column])
    count = int(label.max()) + 1 if label.size else 0
    if count < fewest:
        raise NotPossible(
            f"cross_validate.by = {by}: {counted(count, by)} measured, must be at least {fewest} "
            "to leave one out"
        )
    names = [f"{by} {np.median(values[label == k]):.4g}{unit}" for k in range(count)]
    every = [Fold(by, n, usable[label == k], usable[label != k]) for k, n in enumerate(names)]
    found = every if by == "arc" else every[1:-1]
    short = [
        f"cross_validate.by = {by}: {fold.rest.size} runs are left without {fold.name}, must be at "
        f"least {FEWEST_RUNS}"
        for fold in found
        if fold.rest.size < FEWEST_RUNS
    ]
    if short:
        raise NotPossible(short)
    return tuple(found)


def between_speeds(log_speed: Array, log_mu: Array, at: Array, known: float) -> Array:
    """Compute the standard uncertainty of ln mu between speeds from the interpolation alone.

    If the second derivative of ln mu over ln v is white noise of intensity q, the natural cubic
    spline through the given values is the most probable curve, and its variance between them is

        u² = q (w' G w - 2 w' g) / 12,    G = |x_i - x_k|³, g = |x_i - x|³,

    with the weights w of the values in the spline: q h³/48 in the middle between two values at a
    distance h. The n >= 2 values ln mu at increasing ln v contain n - 2 observations of q; its
    usual value `known` counts as two more. The result has the shape (m,) of `at`, ln v in between.
    """
    values = np.column_stack([log_mu, np.eye(log_speed.size)])
    spline = CubicSpline(log_speed, values, bc_type="natural")
    bent = spline(log_speed, 2)[:, 0]
    # the second derivative is straight between two speeds
    squares = (bent[1:] ** 2 + bent[1:] * bent[:-1] + bent[:-1] ** 2) / 3.0
    q = (2.0 * known + squares @ np.diff(log_speed)) / log_speed.size
    w = spline(at)[:, 1:]
    G, g = (np.abs(np.subtract.outer(x, log_speed)) ** 3 for x in (log_speed, at))
    variance = q * (np.sum((w @ G) * w, axis=1) - 2.0 * np.sum(w * g, axis=1)) / 12.0
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))
