"""Agreement of measured and simulated friction coefficients (paper, section 7, Figs. 16 and 17).

Both sides come from the same reduction. Runs are matched by their settings, compared per arc and
averaged over arcs, and split by normal force, as the paper finds its differences at low and high
force.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError, counted
from beltid.identify.estimators.statistics import settings_of

Array = NDArray[np.float64]
Columns = dict[str, NDArray[Any]]

OK = "ok"
FORCE_BANDS = ("low", "middle", "high")
NUMBERS = (
    "arc_deg", "nominal_tension_N", "pulley_speed_rad_s", "normal_force_N_m", "mu_sliding",
)  # fmt: skip
"""Columns of either side that must be numbers > 0."""
COLUMNS = (
    "run", "arc_deg", "nominal_tension_N", "pulley_speed_rad_s", "normal_force_N_m", "mu_measured",
    "mu_simulated", "difference", "relative_difference", "within_tolerance", "force_band",
)  # fmt: skip
"""Columns of the comparison table."""
SAME_SETTING = {"arc_deg": 1e-3, "nominal_tension_N": 5e-3, "pulley_speed_rad_s": 3e-2}
"""How far apart a setting may be on two sides, relative to its value: motors miss their speed by
about a percent."""


@dataclass(frozen=True, slots=True)
class AgreementSettings:
    """Tolerances of the comparison, as shares; None is not judged."""

    max_rms_relative_error: float | None = None  # root mean square of the relative differences
    max_mean_relative_error: float | None = None  # mean of their magnitudes: they do not cancel
    max_relative_error: float | None = None  # magnitude of a single one
    min_share_compared: float | None = None  # of the usable measured runs
    max_rms_error_over_uncertainty: float | None = None
    """Root mean square of the differences over their standard uncertainties; nan, which is never
    admitted, where these are not known."""

    def __post_init__(self) -> None:
        problems = [
            f"compare.{name} = {value}, must be > 0"
            for name, value in self.tolerances.items()
            if not value > 0.0
        ]
        if problems:
            raise InputError(problems)

    @property
    def tolerances(self) -> dict[str, float]:
        """Tolerances that are judged, by name."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: value for name, value in values.items() if value is not None}


@dataclass(frozen=True, slots=True)
class Statistics:
    """Relative differences (simulated - measured)/measured of a group of points [-]."""

    group: str  # what the points have in common
    n_points: int  # without points all figures are nan
    rms: float
    mean: float
    mean_magnitude: float
    largest: float  # magnitude
    force_low_N_m: float  # lowest and highest measured normal force of the group
    force_high_N_m: float

    @classmethod
    def of(cls, group: str, relative: Array, force: Array) -> Statistics:
        """Statistics of relative differences [-] at measured normal forces [N/m], each (n,)."""
        if relative.size == 0:
            return cls(group, 0, *([float("nan")] * 6))
        size = np.abs(relative)
        figures = np.sqrt(np.mean(relative**2)), relative.mean(), size.mean(), size.max()
        return cls(group, relative.size, *map(float, (*figures, force.min(), force.max())))

    def as_row(self) -> dict[str, object]:
        """Row for printing, in percent; None in place of nan."""
        shares = ("rms", "mean", "mean_magnitude", "largest")
        figures = {f"{name}_percent": 100.0 * getattr(self, name) for name in shares}
        figures |= {name: getattr(self, name) for name in ("force_low_N_m", "force_high_N_m")}
        known = {k: (v if np.isfinite(v) else None) for k, v in figures.items()}
        return {"group": self.group, "n_points": self.n_points, **known}


@dataclass(frozen=True, slots=True, eq=False)
class AgreementResult:
    """Comparison of a measured and a simulated campaign; n matched points, shape (n,) each."""

    run: NDArray[np.object_]  # label of the measured run, whose settings and force follow
    arc_deg: Array
    nominal_tension_N: Array
    pulley_speed_rad_s: Array
    normal_force_N_m: Array
    mu_measured: Array
    mu_simulated: Array
    force_band: NDArray[np.object_]  # third of the points by force: low, middle or high
    averaged: Columns  # means over the arcs at equal tension and speed, with ``n_arcs``
    groups: tuple[Statistics, ...]
    """All points, each arc (Fig. 16), the means over arcs (Fig. 17), thirds by `force_band`."""
    settings: AgreementSettings
    n_measured: int  # runs on either side
    n_simulated: int
    n_usable: int  # measured runs that were not set aside
    not_compared_runs: tuple[tuple[str, str], ...]
    """Runs without a partner or set aside: label with side, reason."""
    rows: tuple[NDArray[np.intp], NDArray[np.intp]]
    """Rows of the matched runs in the measured and in the simulated table."""
    u_validation: Array | None = None
    """Standard uncertainty of the relative differences [-]; nan where it is not known."""

    @property
    def overall(self) -> Statistics:
        """Statistics of all points."""
        return self.groups[0]

    @property
    def not_compared(self) -> dict[str, int]:
        """Reasons why runs were not compared, and how often; the most frequent first.

        Without the figures of each run: "measured: never settles".
        """
        reasons = (": ".join(why.split(": ")[:2]) for _, why in self.not_compared_runs)
        return dict(Counter(reasons).most_common())

    @property
    def difference(self) -> Array:
        """Simulated less measured friction coefficient [-], (n,)."""
        return self.mu_simulated - self.mu_measured

    @property
    def relative_difference(self) -> Array:
        """Difference over the measured value [-], (n,)."""
        return self.difference / self.mu_measured

    @property
    def share_compared(self) -> float:
        """Share of the usable measured runs that found a simulated partner [-]."""
        return self.mu_measured.size / self.n_usable

    @property
    def error_over_uncertainty(self) -> Array:
        """Relative difference over its standard uncertainty (n,); nan where it is not known."""
        if self.u_validation is None:
            return np.full(self.mu_measured.size, np.nan)
        safe = np.where(self.u_validation > 0.0, self.u_validation, np.nan)
        return self.relative_difference / safe

    @property
    def rms_error_over_uncertainty(self) -> float:
        """Root mean square of the differences in units of their standard uncertainties."""
        return float(np.sqrt(np.mean(np.square(self.error_over_uncertainty))))

    @property
    def passed(self) -> bool:
        """Whether every tolerance that is set holds."""
        return all(row["holds"] for row in self.verdict_table())

    @property
    def within_tolerance(self) -> NDArray[np.bool_]:
        """Points within ``max_relative_error`` (n,); all of them if it is not judged."""
        allowed = self.settings.max_relative_error
        return np.abs(self.relative_difference) <= (np.inf if allowed is None else allowed)

    def to_columns(self) -> Columns:
        """Columns of the comparison table, a row per matched point."""
        return {name: getattr(self, name) for name in COLUMNS}

    def verdict_table(self) -> list[dict[str, object]]:
        """Rows for printing: a judged tolerance each; a figure that is nan never holds."""
        found = {
            "max_rms_relative_error": self.overall.rms,
            "max_mean_relative_error": self.overall.mean_magnitude,
            "max_relative_error": self.overall.largest,
            "min_share_compared": self.share_compared,
            "max_rms_error_over_uncertainty": self.rms_error_over_uncertainty,
        }
        rows: list[dict[str, object]] = []
        for name, allowed in self.settings.tolerances.items():
            x = found[name]
            holds = bool(x >= allowed if name.startswith("min") else x <= allowed)
            rows.append({"tolerance": name, "found": x, "allowed": allowed, "holds": holds})
        return rows


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

    Raises
    ------
    InputError
        If a column is missing, or no measured run has a simulated partner.
    """
    settings = settings or AgreementSettings()
    tables = _run_table(measured, "measured"), _run_table(simulated, "simulated")
    of_measured, of_simulated, left_out = _match(*tables)
    n_measured, n_simulated = (table["run"].size for table in tables)
    if of_measured.size == 0:
        raise _without_partners(n_measured, n_simulated, left_out)
    real = {name: column[of_measured] for name, column in tables[0].items()}
    mu, virtual = real["mu_sliding"], tables[1]["mu_sliding"][of_simulated]
    arc_deg, force, relative = real["arc_deg"], real["normal_force_N_m"], (virtual - mu) / mu
    bands = np.empty(mu.size, dtype=object)  # groups of nearly equal size
    parts = np.array_split(np.argsort(force, kind="stable"), 3)
    for word, part in zip(FORCE_BANDS, parts, strict=True):
        bands[part] = word
    arcs = settings_of(arc_deg, SAME_SETTING["arc_deg"])
    averaged = _averages_over_arcs(real, virtual, arcs)
    masks = [(f"arc {arc_deg[arcs == a].mean():g}°", arcs == a) for a in range(arcs.max() + 1)]
    thirds = [(f"{word} third of the force", bands == word) for word in FORCE_BANDS]
    return AgreementResult(
        **{name: real[name] for name in ("run", *NUMBERS[:-1])},
        mu_measured=mu,
        mu_simulated=virtual,
        force_band=bands,
        averaged=averaged,
        groups=(
            Statistics.of("all points", relative, force),
            *(Statistics.of(name, relative[g], force[g]) for name, g in masks),
            Statistics.of(
                "means over arcs", averaged["relative_difference"], averaged["normal_force_N_m"]
            ),
            *(Statistics.of(name, relative[g], force[g]) for name, g in thirds),
        ),
        settings=settings,
        n_measured=n_measured,
        n_simulated=n_simulated,
        n_usable=int(np.count_nonzero(tables[0]["reason"] == "")),
        not_compared_runs=left_out,
        rows=(of_measured, of_simulated),
    )


def _without_partners(
    n_measured: int, n_simulated: int, left_out: tuple[tuple[str, str], ...]
) -> InputError:
    counts = Counter(reason for _, reason in left_out).most_common()
    return InputError(
        [
            "compare: no measured run has a simulated partner, must be at least one "
            f"({n_measured} measured and {n_simulated} simulated runs)",
            *(f"{counted(count, 'run')}: {reason}" for reason, count in counts),
        ]
    )


def _run_table(columns: Mapping[str, ArrayLike], side: str) -> Columns:
    """Checked columns, speeds without sign, with the ``reason`` why a run cannot be compared."""
    needed = ("run", *NUMBERS)
    problems = [f"{side}: column {name} is missing" for name in needed if name not in columns]
    if problems:
        raise InputError(problems)
    run = np.array([str(label) for label in np.asarray(columns["run"]).ravel()], dtype=object)
    values = {name: np.asarray(columns[name], dtype=float) for name in NUMBERS}
    status = np.asarray(columns.get("status", np.full(run.size, OK)), dtype=object)
    problems = [
        f"{side}: column {name} has shape {a.shape}, must be ({run.size},) as that of run"
        for name, a in {**values, "status": status}.items()
        if a.shape != (run.size,)
    ]
    if problems:
        raise InputError(problems)
    values["pulley_speed_rad_s"] = np.abs(values["pulley_speed_rad_s"])
    reason = np.empty(run.size, dtype=object)
    for k in range(run.size):
        wrong = [name for name, a in values.items() if not 0.0 < a[k] < np.inf]
        reason[k] = f"{' and '.join(wrong)} not a number > 0" if wrong else ""
        if status[k] != OK:
            reason[k] = str(status[k]) or "status is empty"
    return {"run": run, **values, "reason": reason}


def _match(
    measured: Columns, simulated: Columns
) -> tuple[NDArray[np.intp], NDArray[np.intp], tuple[tuple[str, str], ...]]:
    """Rows of the pairs on both sides, and every run in no pair: side with label, reason.

    Among several simulated runs within the tolerances the one with the same label wins, else the
    one with the nearest speed; a simulated run may answer several repetitions of a measured one.
    """
    pairs: list[tuple[int, int]] = []
    left_out: list[tuple[str, str]] = []
    usable = simulated["reason"] == ""
    answered = np.zeros(usable.size, dtype=bool)
    for k, (label, reason) in enumerate(zip(measured["run"], measured["reason"], strict=True)):
        off = {name: np.abs(simulated[name] - measured[name][k]) for name in SAME_SETTING}
        near = np.all(
            [off[n] <= share * measured[n][k] for n, share in SAME_SETTING.items()], axis=0
        )
        answered |= near  # by a run that was set aside, too: that one is counted
        if reason:
            left_out.append((f"measured {label}", f"measured: {reason}"))
        elif np.any(near & usable):
            order = np.where(simulated["run"] == label, -1.0, off["pulley_speed_rad_s"])
            pairs.append((k, int(np.argmin(np.where(near & usable, order, np.inf)))))
        elif near.any():
            left_out.append((f"measured {label}", f"simulated: {simulated['reason'][near][0]}"))
        else:
            left_out.append((f"measured {label}", "no simulated run with these settings"))
    for j in np.flatnonzero(~answered):
        reason = simulated["reason"][j]
        why = f"simulated: {reason}" if reason else "no measured run with these settings"
        left_out.append((f"simulated {simulated['run'][j]}", why))
    rows = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    return rows[:, 0], rows[:, 1], tuple(left_out)


def _averages_over_arcs(real: Columns, mu_simulated: Array, arcs: NDArray[np.intp]) -> Columns:
    """Means over the matched arcs of each tension and speed, repetitions of an arc first."""
    data = np.stack([*(real[name] for name in NUMBERS[1:]), mu_simulated], axis=1)
    names = ("nominal_tension_N", "pulley_speed_rad_s")
    setting = np.stack([settings_of(real[n], SAME_SETTING[n]) for n in names], axis=1)
    means, counts = [], []
    for one in np.unique(setting, axis=0):
        here = np.all(setting == one, axis=1)
        per_arc = [data[here & (arcs == a)].mean(axis=0) for a in np.unique(arcs[here])]
        means.append(np.mean(per_arc, axis=0))
        counts.append(len(per_arc))
    columns: Columns = dict(
        zip((*NUMBERS[1:-1], "mu_measured", "mu_simulated"), np.array(means).T, strict=True)
    )
    columns["n_arcs"] = np.array(counts, dtype=np.int64)
    columns["difference"] = columns["mu_simulated"] - columns["mu_measured"]
    columns["relative_difference"] = columns["difference"] / columns["mu_measured"]
    return columns
