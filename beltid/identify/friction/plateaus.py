"""Reduce plateaus that have no rest or build-up: rows of a table, bins of a changing speed.

Each gives one friction coefficient by Eq. (6). It shows neither the tail of a sticking peak nor the
zero of a cell, so neither is corrected. For a single reading, the resolution r of the force
replaces the scatter: a uniform distribution of this width has the standard deviation
``r / sqrt(12)``.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.identify.estimators.signal import running_median
from beltid.identify.estimators.statistics import integrated_autocorrelation_time, median
from beltid.identify.friction.kinds import UNTREATED, Course, Drag, RigKind, drag_of
from beltid.identify.friction.run import (
    CELLS,
    NAN,
    TEXT_COLUMNS,
    FrictionSettings,
    RunColumns,
    RunRecord,
    RunReduction,
    arc_problem,
    conditions_of,
)
from beltid.laws.capstan import friction_coefficient, mean_normal_force, sliding_speed

Array = NDArray[np.float64]
Columns = Mapping[str, NDArray[Any]]

BY_BINS = "a run whose speed falls or rises throughout is cut into bins by rig.speed_bins_rad_s"
"""Hint for a run that cannot be used because its speed changes."""
FALLS, RISES = 0.8, 1.25
"""Ratios of the final to the initial speed of a run below and above which it falls or rises."""


def reduce_plateaus(
    columns: Columns,
    R: float,
    settings: FrictionSettings,
    kind: RigKind,
    resolution_N: float = NAN,
) -> tuple[RunReduction, ...]:
    """Reduce a table with one row per plateau.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Columns of the table of points, shape (n,) each, nan or None where a value is missing. They
        hold mu and normal_force_N_m, or arc_deg and the channels of the kind; and
        pulley_speed_rad_s or slip_speed_m_s. The torque of idle rows is subtracted from the others.
    R : float
        Radius of the belt's centreline on the pulley [m].
    settings : FrictionSettings
        Largest credible mu.
    kind : RigKind
        What the rig measures.
    resolution_N : float
        Resolution of the forces [N]; nan if not stated.

    Returns
    -------
    tuple of RunReduction
        One for every row, except those of the idle pulley.

    Raises
    ------
    InputError
        With the columns that are missing.
    """
    if not (_has_values(columns, "pulley_speed_rad_s") or _has_values(columns, "slip_speed_m_s")):
        raise InputError("column pulley_speed_rad_s or slip_speed_m_s is missing")
    n = len(columns["run"])
    is_idle = np.array([str(x).lower() == "true" for x in columns.get("idle", np.full(n, None))])
    rows = {name: values[~is_idle] for name, values in columns.items()}
    treatment, span = UNTREATED, None
    if all(_has_values(columns, name) for name in STATED):
        values = _stated(rows)
    else:
        if not _has_values(columns, "arc_deg"):
            raise InputError("column arc_deg is missing")
        kind.check(rows)
        idle = [{k: columns[k][[i]] for k in DRAG if k in columns} for i in np.flatnonzero(is_idle)]
        drag = drag_of(idle)
        treatment = kind.treatment(rows, drag)
        kind = kind.with_span_of(rows)
        span = kind.span_beside_torque
        values = _by_tensions(rows, kind, R, drag, resolution_N)
    values |= _settings(rows, kind, R)
    stated_se = _column(rows, "mu_se")
    values["mu_sliding_se"] = np.where(np.isfinite(stated_se), stated_se, values["mu_sliding_se"])
    runs = []
    for k, label in enumerate(_unique([str(label) for label in rows["run"]])):
        texts = {name: rows[name][k] for name in TEXT_COLUMNS if name in rows and rows[name][k]}
        row = RunColumns(label, {name: x[[k]] for name, x in rows.items()}, texts)
        numbers: dict[str, Any] = {name: float(x[k]) for name, x in values.items()}
        run = RunReduction(
            run=label,
            n_samples=1,
            mu_sticking_reason="",
            conditions=conditions_of(row),
            treatment=treatment,
            torque_with=span,
            **numbers,
        )
        runs.append(replace(run, status=_problem(run, settings, kind, "points") or "ok"))
    return tuple(runs)


STATED = ("mu", "normal_force_N_m")
"""Columns of a table of plateaus that states coefficient and normal force directly."""
DRAG = ("pulley_speed_rad_s", "torque_N_m")


def _has_values(columns: Columns, name: str) -> bool:
    return name in columns and bool(np.isfinite(np.asarray(columns[name], dtype=float)).any())


def _column(rows: Columns, name: str) -> Array:
    """Return a column of the table; nan throughout if it is missing."""
    missing = np.full(len(rows["run"]), NAN)
    return np.asarray(rows.get(name, missing), dtype=float)


def _stated(rows: Columns) -> dict[str, Array]:
    """Return coefficient and normal force as the table states them."""
    return {
        "mu_sliding": _column(rows, "mu"),
        "normal_force_N_m": _column(rows, "normal_force_N_m"),
        "mu_sliding_se": np.full(len(rows["run"]), NAN),
    }


def _by_tensions(
    rows: Columns, kind: RigKind, R: float, drag: Drag | None, resolution_N: float
) -> dict[str, Array]:
    """Compute the coefficient by Eq. (6) and the force by Eq. (8) from the measured channels."""
    tight, slack = kind.tensions(rows, rows["arc_deg"], R, drag)
    beta = np.radians(rows["arc_deg"])
    values = {
        "tension_tight_N": tight,
        "tension_slack_N": slack,
        "mu_sliding": friction_coefficient(tight, slack, beta),
        "normal_force_N_m": _force(tight, slack, R),
        "mu_sliding_se": _by_resolution(rows, kind, R, drag, resolution_N) / beta,
    }
    if kind.running:
        values["momentum_N"] = kind.momentum_N(kind.belt_speed(rows)) + np.zeros(beta.size)
    return values


def _settings(rows: Columns, kind: RigKind, R: float) -> dict[str, Array]:
    """Return arc, initial tension (or dead weight), speeds and temperature of the plateaus."""
    pulley_speed, slip_speed = _speeds(rows, kind, R)
    initial = _column(rows, "initial_tension_N")
    if kind.weight:
        initial = np.where(np.isfinite(initial), initial, _column(rows, "weight_N"))
    return {
        "arc_deg": _column(rows, "arc_deg"),
        "nominal_tension_N": initial,
        "initial_tension_N": initial,
        "pulley_speed_rad_s": pulley_speed,
        "slip_speed_m_s": slip_speed,
        "temperature_degC": _column(rows, "temperature_degC"),
    }


def _force(tight: Array, slack: Array, R: float) -> Array:
    good = (tight > 0.0) & (slack > 0.0)
    force = np.full(tight.shape, NAN)
    force[good] = mean_normal_force(tight[good], slack[good], R)
    return force


def _by_resolution(
    columns: Columns, kind: RigKind, R: float, drag: Drag | None, resolution_N: float
) -> Array:
    """Return the standard error of ln(T_tight/T_slack) from the resolution of the forces (n,)."""
    u = resolution_N / np.sqrt(12.0)
    variance = np.zeros(len(columns["arc_deg"]))
    if not np.isfinite(u):
        return np.full(variance.size, NAN)
    for name in CELLS:  # the stated resolution applies to forces only
        if not _has_values(columns, name):
            continue
        z = []
        for sign in (-1.0, 1.0):
            shifted = {**columns, name: columns[name] + 0.5 * sign * u}
            tight, slack = kind.tensions(shifted, columns["arc_deg"], R, drag)
            z.append(friction_coefficient(tight, slack, 1.0))
        variance += np.square(z[1] - z[0])
    return np.asarray(np.sqrt(variance))


def _speeds(columns: Columns, kind: RigKind, R: float) -> tuple[Array, Array]:
    """Return the magnitudes of the pulley speed [rad/s] and the sliding speed [m/s]."""
    pulley_speed = np.abs(_column(columns, "pulley_speed_rad_s"))
    slip_speed = np.abs(_column(columns, "slip_speed_m_s"))
    if np.isfinite(pulley_speed).any():
        relative = kind.relative_speed({**columns, "pulley_speed_rad_s": pulley_speed}, R)
        from_pulley = np.abs(sliding_speed(relative, R))
        slip_speed = np.where(np.isfinite(slip_speed), slip_speed, from_pulley)
    if not kind.running:
        pulley_speed = np.where(np.isfinite(pulley_speed), pulley_speed, slip_speed / R)
    return pulley_speed, slip_speed


def _unique(labels: list[str]) -> list[str]:
    """Return unique labels; rows with the same label are numbered."""
    seen: dict[str, int] = {}
    unique = []
    for label in labels:
        seen[label] = seen.get(label, 0) + 1
        unique.append(f"{label}-{seen[label]}" if labels.count(label) > 1 else label)
    return unique


def _problem(run: RunReduction, settings: FrictionSettings, kind: RigKind, table: str) -> str:
    """Return why a plateau cannot be used; empty if it can."""
    tensions = (run.tension_tight_N, run.tension_slack_N)
    if np.isfinite(tensions).any() or not np.isfinite(run.mu_sliding):
        bad_arc = arc_problem(run.arc_deg)
        if bad_arc:
            return bad_arc
        if kind.measures == "torque_hub" and np.isnan(tensions).any():
            return (
                f"torque_N_m and hub_force_N give no tensions at {run.arc_deg:g} deg: the force "
                "on the axis must be larger than |torque/R cos(arc/2)|, and at a whole turn it "
                "does not depend on the sum of the tensions"
            )
        if tensions[0] < tensions[1] and (why := kind.reversed(table)):
            return why
        for name, tension in zip(("tight", "slack"), tensions, strict=True):
            if not tension > 0.0:
                return f"tension_{name}_N = {tension:g}, must be > 0"
    if not 0.0 < run.mu_sliding <= settings.max_mu:
        return f"mu_sliding = {run.mu_sliding:.4g}, must be in (0, {settings.max_mu:g}]"
    if not run.normal_force_N_m > 0.0:
        return f"normal_force_N_m = {run.normal_force_N_m:g}, must be > 0"
    if not run.slip_speed_m_s > 0.0:
        return f"slip_speed_m_s = {run.slip_speed_m_s:g}, must be > 0"
    return ""


def course(record: RunRecord) -> Course:
    """Classify the speed of a run: "falls", "rises", or "" if it is steady."""
    speed = np.abs(record.pulley_speed_rad_s[np.isfinite(record.pulley_speed_rad_s)])
    turning = speed[speed > 0.02 * float(np.max(speed, initial=0.0))]
    if turning.size < 16:
        return ""
    quarter = turning.size // 4
    change = median(turning[-quarter:]) / median(turning[:quarter])
    return "falls" if change < FALLS else "rises" if change > RISES else ""


def binned_plateaus(
    record: RunRecord, R: float, settings: FrictionSettings
) -> tuple[RunReduction, ...]:
    """Cut a run whose speed falls or rises into plateaus, one per speed bin.

    Eq. (6) uses the mean of each tension over a bin; the standard error follows from the scatter
    about a straight line over the speed and its autocorrelation.

    Parameters
    ----------
    record : RunRecord
        The samples.
    R : float
        Radius of the belt's centreline on the pulley [m].
    settings : FrictionSettings
        Settings with the edges of the bins.
    """
    trend = course(record)
    speed = np.abs(record.pulley_speed_rad_s)
    cells = record.kind.cells
    tensions = [record.tension_tight_N, record.tension_slack_N]
    if not record.kind.is_derived:
        pairs = zip((cells.tight, cells.slack), tensions, strict=True)
        tensions = [cell.tension(values) for cell, values in pairs]
    usable = np.isfinite(speed) & (tensions[0] > 0.0) & (tensions[1] > 0.0)
    smooth = running_median(np.where(usable, speed, 0.0), 5)
    fastest = int(np.argmax(smooth))
    usable[: fastest if trend == "falls" else 0] = False
    usable[fastest + 1 if trend == "rises" else speed.size :] = False
    edges = np.sort(np.array(settings.speed_bins_rad_s))
    treatment = replace(record.treatment, course=trend)
    plateaus = []
    for low, high in itertools.pairwise(edges):
        in_bin = usable & (speed >= low) & (speed < high)
        run = RunReduction(
            run=f"{record.run}:{low:g}-{high:g}",
            arc_deg=record.arc_deg,
            nominal_tension_N=record.nominal_tension_N,
            initial_tension_N=record.nominal_tension_N if record.kind.weight else NAN,
            conditions=record.conditions,
            momentum_N=record.momentum_N,
            torque_with=record.kind.span_beside_torque,
            mu_sticking_reason="",
            treatment=treatment,
        )
        if record.defect:
            plateaus.append(replace(run, status=record.defect))
        elif np.count_nonzero(in_bin) < settings.min_plateau_samples:
            reason = (
                f"too short: {np.count_nonzero(in_bin)} usable samples between {low:g} and "
                f"{high:g} rad/s, must be >= {settings.min_plateau_samples}"
            )
            plateaus.append(replace(run, status=reason))
        else:
            in_bin_N = [x[in_bin] for x in tensions]
            plateaus.append(_reduce_bin(run, record, in_bin_N, in_bin, R, settings))
    return tuple(plateaus)


def _reduce_bin(
    run: RunReduction,
    record: RunRecord,
    tensions: Sequence[Array],
    in_bin: NDArray[np.bool_],
    R: float,
    settings: FrictionSettings,
) -> RunReduction:
    """Reduce the samples of one speed bin."""
    speed = np.abs(record.pulley_speed_rad_s[in_bin])
    tight, slack = (float(np.mean(x)) for x in tensions)
    z = tensions[0] / tight - tensions[1] / slack
    line = np.column_stack([np.ones(speed.size), speed])
    residual = z - line @ np.linalg.lstsq(line, z, rcond=None)[0]
    correlation_time = max(integrated_autocorrelation_time(residual), 1.0)
    se = float(np.std(residual, ddof=2)) * np.sqrt(correlation_time / residual.size)
    beta, omega = float(np.radians(run.arc_deg)), float(np.mean(speed))
    temperature = NAN
    if record.temperature_degC is not None and np.isfinite(record.temperature_degC[in_bin]).any():
        temperature = float(np.nanmean(record.temperature_degC[in_bin]))
    run = replace(
        run,
        pulley_speed_rad_s=omega + record.belt_speed_m_s / R,
        slip_speed_m_s=float(sliding_speed(omega, R)),
        tension_tight_N=tight,
        tension_slack_N=slack,
        mu_sliding=float(friction_coefficient(tight, slack, beta)),
        mu_sliding_se=se / beta,
        normal_force_N_m=float(mean_normal_force(tight, slack, R)),
        temperature_degC=temperature,
        n_samples=int(residual.size),
        plateau_start_s=float(record.time_s[in_bin][0]),
        plateau_end_s=float(record.time_s[in_bin][-1]),
    )
    return replace(run, status=_problem(run, settings, record.kind, "rig") or "ok")
