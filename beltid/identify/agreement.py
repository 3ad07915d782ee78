"""Agreement of measured and simulated friction coefficients (paper, section 4, Figs. 16 and 17).

Both sides come from the same reduction. Runs are matched by their settings, compared per arc and
averaged over arcs, and grouped by normal force, because the paper finds its differences at low and
high force.

Only runs that a fitted surface has not seen test it (:func:`folds`): all runs of one contact arc,
or of one speed, are left out together. Beyond the lowest and highest speed the law uses the nearest
measured value without any claim, so only the speeds in between are left out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from beltid.errors import InputError, TooFewSettings, counted
from beltid.identify.estimators import settings_of

Array = NDArray[np.float64]

Columns = dict[str, NDArray[Any]]

OK = "ok"
GOOD_RATIO = 0.6, 1.2  # RMS error over its standard uncertainty that neither side has to explain
UNEXPLAINED = 2.0  # the same ratio beyond which the uncertainty lacks something
SHARE_COMPARED = "min_share_compared"
WORDS = {
    "max_rms_relative_error": "rms",
    "max_mean_relative_error": "mean magnitude",
    "max_relative_error": "largest",
}
THIRDS = ("low", "middle", "high")
NUMBERS = (
    "arc_deg", "nominal_tension_N", "pulley_speed_rad_s", "normal_force_N_m", "mu_sliding",
)  # fmt: skip
"""Columns that must contain numbers > 0, measured and simulated."""
COLUMNS = (
    "run", "arc_deg", "nominal_tension_N", "pulley_speed_rad_s", "normal_force_N_m", "mu_measured",
    "mu_simulated", "difference", "relative_difference", "within_tolerance",
)  # fmt: skip
"""Columns of the comparison table."""
SAME_SETTING = {"arc_deg": 1e-3, "nominal_tension_N": 5e-3, "pulley_speed_rad_s": 3e-2}
"""Largest relative difference between settings of matched runs; motors miss their speed by 1 %."""


@dataclass(frozen=True, slots=True)
class Statistics:
    """Relative differences (simulated - measured)/measured of a group of points [-]."""

    group: str  # name of the group
    n_points: int  # if 0, all figures are nan
    rms: float
    mean: float
    mean_magnitude: float
    largest: float  # largest magnitude
    force_low_N_m: float  # lowest and highest measured normal force of the group
    force_high_N_m: float

    @classmethod
    def of(cls, group: str, relative: Array, force: Array) -> Statistics:
        """Evaluate relative differences [-] at measured normal forces [N/m], each (n,)."""
        if relative.size == 0:
            return cls(group, 0, *([float("nan")] * 6))
        size = np.abs(relative)
        figures = np.sqrt(np.mean(relative**2)), relative.mean(), size.mean(), size.max()
        return cls(group, relative.size, *map(float, (*figures, force.min(), force.max())))

    def as_row(self) -> dict[str, object]:
        """Return a row for printing, in percent, with None instead of nan."""
        row: dict[str, object] = {"group": self.group, "n_points": self.n_points}
        for name in ("rms", "mean", "mean_magnitude", "largest", "force_low_N_m", "force_high_N_m"):
            value, is_force = getattr(self, name), name.startswith("force")
            value = value if is_force else 100.0 * value
            row[name if is_force else f"{name}_percent"] = value if np.isfinite(value) else None
        return row


@dataclass(frozen=True, slots=True, eq=False)
class AgreementResult:
    """Comparison of a measured and a simulated campaign; arrays of n matched points, shape (n,)."""

    run: NDArray[np.object_]  # label, settings and force of the measured run
    arc_deg: Array
    nominal_tension_N: Array
    pulley_speed_rad_s: Array
    normal_force_N_m: Array
    mu_measured: Array
    mu_simulated: Array
    averaged: Columns  # means over the arcs at equal tension and speed, with ``n_arcs``
    groups: tuple[Statistics, ...]
    """All points, each arc (Fig. 16), the means over arcs (Fig. 17), each third of the force."""
    tolerances: Mapping[str, float]  # active tolerances, see :func:`compare_points`
    n_measured: int  # number of runs per side
    n_simulated: int
    n_usable: int  # usable measured runs
    not_compared_runs: tuple[tuple[str, str], ...]
    """Runs that are unusable or have no partner: label with side, reason."""
    rows: tuple[NDArray[np.intp], NDArray[np.intp]]
    """Rows of the matched runs in the measured and in the simulated table."""
    u_validation: Array | None = None
    """Standard uncertainty of the relative differences [-]; nan where unknown."""

    @property
    def overall(self) -> Statistics:
        """Statistics of all points."""
        return self.groups[0]

    @property
    def not_compared(self) -> dict[str, int]:
        """Number of runs not compared, by reason; the most frequent reason first.

        The reasons omit the figures of each run, as in "measured: never settles".
        """
        reasons = (": ".join(reason.split(": ")[:2]) for _, reason in self.not_compared_runs)
        return dict(Counter(reasons).most_common())

    @property
    def difference(self) -> Array:
        """Simulated minus measured friction coefficient [-], (n,)."""
        return self.mu_simulated - self.mu_measured

    @property
    def relative_difference(self) -> Array:
        """Difference over the measured value [-], (n,)."""
        return self.difference / self.mu_measured

    @property
    def share_compared(self) -> float:
        """Share of the usable measured runs with a simulated partner [-]."""
        return self.mu_measured.size / self.n_usable

    @property
    def error_over_uncertainty(self) -> Array:
        """Relative difference over its standard uncertainty (n,); nan where unknown."""
        if self.u_validation is None:
            return np.full(self.mu_measured.size, np.nan)
        safe = np.where(self.u_validation > 0.0, self.u_validation, np.nan)
        return self.relative_difference / safe

    @property
    def rms_error_over_uncertainty(self) -> float:
        """Root mean square of the differences over their standard uncertainties [-]."""
        return float(np.sqrt(np.mean(np.square(self.error_over_uncertainty))))

    @property
    def passed(self) -> bool:
        """True if all active tolerances hold."""
        return all(row["holds"] for row in self.verdict_table())

    @property
    def verdict(self) -> str:
        """The outcome in plain words, each tolerance with what was found."""
        words = []
        for row in self.verdict_table():
            name, holds, found = row["tolerance"], row["holds"], 100.0 * row["found"]
            allowed = f"{100.0 * row['allowed']:g} %"
            if name in WORDS:
                words.append(f"{WORDS[name]} {found:.2f} % {'<=' if holds else '>'} {allowed}")
            elif not holds:
                words.append(f"runs compared {found:.0f} % < {allowed}")
        text = f"{'PASS' if self.passed else 'FAIL'}: {', '.join(words)}"
        if (ratio := self.rms_error_over_uncertainty) > UNEXPLAINED:
            text += f"; FAIL of the uncertainty: the differences are {ratio:.2g} times as large"
        return text

    @property
    def against_uncertainty(self) -> str:
        """RMS error, its uncertainty and their ratio in plain words; empty if not known."""
        ratio, rms = self.rms_error_over_uncertainty, 100.0 * self.overall.rms
        if not ratio > 0.0:
            return ""
        low, high = GOOD_RATIO
        return (
            f"the error is {rms:.2g} % RMS, its uncertainty {rms / ratio:.2g} % (without errors "
            f"common to both sides); their ratio {ratio:.2g} should be {low:g} to {high:g}"
        )

    @property
    def within_tolerance(self) -> NDArray[np.bool_]:
        """Points within ``max_relative_error`` (n,); all points without this tolerance."""
        return np.abs(self.relative_difference) <= self.tolerances.get("max_relative_error", np.inf)

    def to_columns(self) -> Columns:
        """Return the columns of the comparison table, one row per matched point."""
        return {name: getattr(self, name) for name in COLUMNS}

    def verdict_table(self) -> list[dict[str, Any]]:
        """Return one row per active tolerance, for printing; a nan figure never holds."""
        figures = {
            "max_rms_relative_error": self.overall.rms,
            "max_mean_relative_error": self.overall.mean_magnitude,
            "max_relative_error": self.overall.largest,
            SHARE_COMPARED: self.share_compared,
        }
        rows: list[dict[str, Any]] = []
        for name, allowed in self.tolerances.items():
            found = figures[name]
            holds = bool(found >= allowed if name == SHARE_COMPARED else found <= allowed)
            rows.append({"tolerance": name, "found": found, "allowed": allowed, "holds": holds})
        return rows


def compare_points(
    measured: Mapping[str, ArrayLike],
    simulated: Mapping[str, ArrayLike],
    tolerances: Mapping[str, float] | None = None,
) -> AgreementResult:
    """Compare the reduced runs of the real bench with those of the simulated bench.

    Parameters
    ----------
    measured, simulated : mapping of str to array_like (n,)
        Columns of the reduction: run, arc_deg, nominal_tension_N, pulley_speed_rad_s,
        normal_force_N_m, mu_sliding and, optionally, status; only "ok" runs are used.
    tolerances : mapping of str to float, optional
        Tolerances as fractions, by default none: of the relative differences, their root mean
        square ``max_rms_relative_error``, mean magnitude ``max_mean_relative_error`` and largest
        magnitude ``max_relative_error``; ``min_share_compared`` of the usable measured runs.

    Raises
    ------
    InputError
        If no measured run has a simulated partner.
    """
    tables = _run_table(measured), _run_table(simulated)
    of_measured, of_simulated, left_out = _match(*tables)
    n_measured, n_simulated = (table["run"].size for table in tables)
    if of_measured.size == 0:
        counts = Counter(reason for _, reason in left_out).most_common()
        none = (
            "compare: no measured run has a simulated partner, must be at least one "
            f"({n_measured} measured and {n_simulated} simulated runs)"
        )
        raise InputError([none, *(f"{counted(count, 'run')}: {why}" for why, count in counts)])
    real = {name: column[of_measured] for name, column in tables[0].items()}
    mu, virtual = real["mu_sliding"], tables[1]["mu_sliding"][of_simulated]
    arc_deg, force, relative = real["arc_deg"], real["normal_force_N_m"], (virtual - mu) / mu
    parts = np.array_split(np.argsort(force, kind="stable"), len(THIRDS))
    arcs = settings_of(arc_deg, SAME_SETTING["arc_deg"])
    averaged = _averages_over_arcs(real, virtual, arcs)
    masks = [(f"arc {arc_deg[arcs == a].mean():g}°", arcs == a) for a in range(arcs.max() + 1)]
    thirds = [(f"{word} third of the force", g) for word, g in zip(THIRDS, parts, strict=True)]
    return AgreementResult(
        **{name: real[name] for name in ("run", *NUMBERS[:-1])},
        mu_measured=mu,
        mu_simulated=virtual,
        averaged=averaged,
        groups=(
            Statistics.of("all points", relative, force),
            *(Statistics.of(name, relative[g], force[g]) for name, g in masks),
            Statistics.of(
                "means over arcs", averaged["relative_difference"], averaged["normal_force_N_m"]
            ),
            *(Statistics.of(name, relative[g], force[g]) for name, g in thirds),
        ),
        tolerances=tolerances or {},
        n_measured=n_measured,
        n_simulated=n_simulated,
        n_usable=int(np.count_nonzero(tables[0]["reason"] == "")),
        not_compared_runs=left_out,
        rows=(of_measured, of_simulated),
    )


def _run_table(columns: Mapping[str, ArrayLike]) -> Columns:
    """Return the columns, speeds without sign, and the ``reason`` against each run."""
    run = np.array([str(label) for label in np.ravel(columns["run"])], dtype=object)
    values = {name: np.asarray(columns[name], dtype=float) for name in NUMBERS}
    values["pulley_speed_rad_s"] = np.abs(values["pulley_speed_rad_s"])
    reason = np.asarray(columns.get("status", np.full(run.size, OK)), dtype=object).copy()
    for k, status in enumerate(reason):
        invalid = [name for name, a in values.items() if not 0.0 < a[k] < np.inf]
        against = f"{' and '.join(invalid)} not a number > 0" if invalid else ""
        reason[k] = against if status == OK else str(status) or "status is empty"
    return {"run": run, **values, "reason": reason}


def _match(
    measured: Columns, simulated: Columns
) -> tuple[NDArray[np.intp], NDArray[np.intp], tuple[tuple[str, str], ...]]:
    """Match the runs; return measured rows, simulated rows, and runs without a pair with reasons.

    If several simulated runs are within the tolerances, the one with the same label is chosen,
    otherwise the one with the nearest speed. Repeated measured runs may share a simulated run.
    """
    pairs: list[tuple[int, int]] = []
    left_out: list[tuple[str, str]] = []
    usable = simulated["reason"] == ""
    has_partner = np.zeros(usable.size, dtype=bool)
    for k, (label, reason) in enumerate(zip(measured["run"], measured["reason"], strict=True)):
        off = {name: np.abs(simulated[name] - measured[name][k]) for name in SAME_SETTING}
        near = np.all(
            [off[n] <= share * measured[n][k] for n, share in SAME_SETTING.items()], axis=0
        )
        has_partner |= near  # even if the measured run is unusable: that run is listed
        if reason:
            left_out.append((f"measured {label}", f"measured: {reason}"))
        elif np.any(near & usable):
            order = np.where(simulated["run"] == label, -1.0, off["pulley_speed_rad_s"])
            pairs.append((k, int(np.argmin(np.where(near & usable, order, np.inf)))))
        elif near.any():
            left_out.append((f"measured {label}", f"simulated: {simulated['reason'][near][0]}"))
        else:
            left_out.append((f"measured {label}", "no simulated run with these settings"))
    for j in np.flatnonzero(~has_partner):
        reason = simulated["reason"][j]
        text = f"simulated: {reason}" if reason else "no measured run with these settings"
        left_out.append((f"simulated {simulated['run'][j]}", text))
    rows = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    return rows[:, 0], rows[:, 1], tuple(left_out)


def _averages_over_arcs(real: Columns, mu_simulated: Array, arcs: NDArray[np.intp]) -> Columns:
    """Average the repetitions of each arc, then the arcs of each tension and speed."""
    data = np.stack([*(real[name] for name in NUMBERS[1:]), mu_simulated])
    names = ("nominal_tension_N", "pulley_speed_rad_s")
    settings = [settings_of(real[name], SAME_SETTING[name]) for name in names]
    cells, of_run = np.unique([*settings, arcs], axis=1, return_inverse=True)
    _, of_cell = np.unique(cells[:2], axis=1, return_inverse=True)
    for label in (of_run, of_cell):
        data = np.array([np.bincount(label, x) for x in data]) / np.bincount(label)
    columns: Columns = dict(zip((*NUMBERS[1:-1], "mu_measured", "mu_simulated"), data, strict=True))
    columns["n_arcs"] = np.bincount(of_cell)
    columns["difference"] = columns["mu_simulated"] - columns["mu_measured"]
    columns["relative_difference"] = columns["difference"] / columns["mu_measured"]
    return columns


SETTING: Final[dict[str, tuple[str, str]]] = {
    "arc": ("arc_deg", "°"),
    "speed": ("pulley_speed_rad_s", " rad/s"),
}
"""Column of each setting, and its unit as printed."""
FEWEST: Final[dict[str, int]] = {"arc": 2, "speed": 3}
FEWEST_RUNS: Final = 4  # minimum number of runs to refine a surface from


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
    :class:`TooFewSettings` if too few settings or runs would remain.
    """
    if by not in SETTING:
        raise InputError(f"by = {by}, must be {' or '.join(SETTING)}")
    column, unit = SETTING[by]
    values = np.abs(np.asarray(columns[column], dtype=float)[usable])
    label = settings_of(values, SAME_SETTING[column])
    count = int(label.max()) + 1 if label.size else 0
    if count < FEWEST[by]:
        raise TooFewSettings(
            f"cross_validate.by = {by}: {count} {by}{'' if count == 1 else 's'} measured, must be "
            f"at least {FEWEST[by]} to leave one out"
        )
    result = []
    for k in range(count) if by == "arc" else range(1, count - 1):
        name = f"{by} {np.median(values[label == k]):.4g}{unit}"
        result.append(Fold(by, name, usable[label == k], usable[label != k]))
    short = [
        f"cross_validate.by = {by}: {fold.rest.size} runs are left without {fold.name}, must be at "
        f"least {FEWEST_RUNS}"
        for fold in result
        if fold.rest.size < FEWEST_RUNS
    ]
    if short:
        raise TooFewSettings(short)
    return tuple(result)


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
