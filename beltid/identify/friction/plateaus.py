"""Reduce plateaus that have no rest or build-up: rows of a table, bins of a changing speed.

Each gives one friction coefficient by Eq. (6). It shows neither the tail of a sticking peak nor the
zero of a cell, so neither is corrected. For a single reading, the resolution r of the force
replaces the scatter: a uniform distribution of this width has the standard deviation
``r / sqrt(12)``.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.identify.estimators.signal import running_median
from beltid.identify.estimators.statistics import integrated_autocorrelation_time, median
from beltid.identify.friction.kinds import (
    SPANS,
    UNTREATED,
    Course,
    Drag,
    RigKind,
    Treatment,
    drag_of,
)
from beltid.identify.friction.run import (
    CELLS,
    NAN,
    OPTIONAL,
    TEXT_COLUMNS,
    Conditions,
    FrictionSettings,
    RunRecord,
    RunReduction,
    arc_problem,
)
from beltid.laws.capstan import friction_coefficient, sliding_speed

Array = NDArray[np.float64]
Columns = Mapping[str, NDArray[Any]]
Rows = dict[str, Array]

BY_BINS = "a run whose speed falls or rises throughout is cut into bins by rig.speed_bins_rad_s"
"""Hint for a run that cannot be used because its speed changes."""
FALLS, RISES = 0.8, 1.25
"""Ratios of the final to the initial speed of a run below and above which it falls or rises."""
STATED = ("mu", "normal_force_N_m")
"""Columns of a table of plateaus that states coefficient and normal force directly."""
SPEEDS = ("pulley_speed_rad_s", "slip_speed_m_s")
NUMBERS = (*STATED, *SPEEDS, *OPTIONAL, "mu_se", "arc_deg")


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
    n = len(columns["run"])
    table = {name: np.asarray(columns.get(name, np.full(n, NAN)), float) for name in NUMBERS}
    given = {name for name, values in table.items() if np.isfinite(values).any()}
    if given.isdisjoint(SPEEDS):
        raise InputError("column pulley_speed_rad_s or slip_speed_m_s is missing")
    if not kind.running:
        speed, slip = (table[name] for name in SPEEDS)
        table["pulley_speed_rad_s"] = np.where(np.isfinite(speed), speed, slip / R)
    is_idle = np.array([str(x).lower() == "true" for x in columns.get("idle", np.full(n, None))])
    rows = {name: values[~is_idle] for name, values in table.items()}
    treatment, by_tensions = UNTREATED, not given.issuperset(STATED)
    if by_tensions:
        if "arc_deg" not in given:
            raise InputError("column arc_deg is missing")
        stated, kind = kind, kind.found_in(rows)
        idle = [{name: x[[i]] for name, x in table.items()} for i in np.flatnonzero(is_idle)]
        drag = drag_of(idle)
        treatment = Treatment.of(stated, kind, drag)
        tight, slack = kind.tensions(rows, rows["arc_deg"], R, drag)
        se = _by_resolution(rows, kind, R, drag, resolution_N) / np.radians(rows["arc_deg"])
        momentum = np.full(se.size, NAN)
        if kind.running:
            momentum[:] = kind.momentum_N(kind.belt_speed(rows))
    pulley_speed = np.abs(rows["pulley_speed_rad_s"])
    slip_speed = np.abs(rows["slip_speed_m_s"])
    if "pulley_speed_rad_s" in given:
        relative = kind.relative_speed({**rows, "pulley_speed_rad_s": pulley_speed}, R)
        from_pulley = np.abs(sliding_speed(relative, R))
        slip_speed = np.where(np.isfinite(slip_speed), slip_speed, from_pulley)
    initial = rows["initial_tension_N"]
    if kind.weight:
        initial = np.where(np.isfinite(initial), initial, rows["weight_N"])
    texts = {name: columns[name][~is_idle] for name in TEXT_COLUMNS if name in columns}
    runs = []
    for k, label in enumerate(_unique([str(label) for label in columns["run"][~is_idle]])):
        described = {name: x[k] for name, x in texts.items() if x[k]}
        run = RunReduction(
            run=label,
            arc_deg=float(rows["arc_deg"][k]),
            nominal_tension_N=float(initial[k]),
            initial_tension_N=float(initial[k]),
            pulley_speed_rad_s=float(pulley_speed[k]),
            slip_speed_m_s=float(slip_speed[k]),
            mu_sliding=float(rows["mu"][k]),
            mu_sliding_se=float(rows["mu_se"][k]),
            normal_force_N_m=float(rows["normal_force_N_m"][k]),
            temperature_degC=float(rows["temperature_degC"][k]),
            n_samples=1,
            mu_sticking_reason="",
            conditions=Conditions.of(described),
            treatment=treatment,
        )
        if by_tensions:
            run.set_plateau(tight[k], slack[k], R)
            run.torque_with = kind.span_beside_torque
            if np.isnan(run.mu_sliding_se):
                run.mu_sliding_se = float(se[k])
            run.momentum_N = float(momentum[k])
        run.status = _problem(run, settings, kind, "points") or "ok"
        runs.append(run)
    return tuple(runs)


def _by_resolution(
    rows: Rows, kind: RigKind, R: float, drag: Drag | None, resolution_N: float
) -> Array:
    """Return the standard error of ln(T_tight/T_slack) from the resolution of the forces (n,)."""
    u = resolution_N / np.sqrt(12.0)
    variance = np.full(rows["arc_deg"].size, 0.0 if np.isfinite(u) else NAN)
    for name in CELLS:  # the stated resolution applies to forces only
        if not np.isfinite(u * rows[name]).any():
            continue
        z = []
        for sign in (-1.0, 1.0):
            shifted = {**rows, name: rows[name] + 0.5 * sign * u}
            tight, slack = kind.tensions(shifted, rows["arc_deg"], R, drag)
            z.append(friction_coefficient(tight, slack, 1.0))
        variance += np.square(z[1] - z[0])
    return np.sqrt(variance)


def _unique(labels: list[str]) -> list[str]:
    """Return unique labels; rows with the same label are numbered."""
    total, seen = Counter(labels), Counter[str]()
    unique = []
    for label in labels:
        seen[label] += 1
        unique.append(f"{label}-{seen[label]}" if total[label] > 1 else label)
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
    readings = zip(SPANS, (record.tension_tight_N, record.tension_slack_N), strict=True)
    tensions = np.array([record.kind.cell(span).tension(values) for span, values in readings])
    usable = np.isfinite(speed) & np.all(tensions > 0.0, axis=0)
    smooth = running_median(np.where(usable, speed, 0.0), 5)
    fastest = int(np.argmax(smooth))
    usable[: fastest if trend == "falls" else 0] = False
    usable[fastest + 1 if trend == "rises" else speed.size :] = False
    edges = np.sort(np.array(settings.speed_bins_rad_s))
    runs = []
    for low, high in itertools.pairwise(edges):
        in_bin = usable & (speed >= low) & (speed < high)
        n = np.count_nonzero(in_bin)
        run = RunReduction.of(record)
        run.run = f"{record.run}:{low:g}-{high:g}"
        run.treatment = replace(record.treatment, course=trend)
        run.mu_sticking_reason = ""
        if record.kind.weight:
            run.initial_tension_N = record.nominal_tension_N
        if record.defect:
            run.status = record.defect
        elif n < settings.min_plateau_samples:
            run.status = (
                f"too short: {n} usable samples between {low:g} and {high:g} rad/s, "
                f"must be >= {settings.min_plateau_samples}"
            )
        else:
            _reduce_bin(run, record, tensions[:, in_bin], in_bin, R)
            run.status = _problem(run, settings, record.kind, "rig") or "ok"
        runs.append(run)
    return tuple(runs)


def _reduce_bin(
    run: RunReduction, record: RunRecord, tensions: Array, in_bin: NDArray[np.bool_], R: float
) -> None:
    """Reduce the samples of one speed bin, with tensions of shape (2, n)."""
    speed = np.abs(record.pulley_speed_rad_s[in_bin])
    tight, slack = tensions.mean(axis=1)
    run.set_plateau(tight, slack, R)
    z = tensions[0] / tight - tensions[1] / slack
    line = np.column_stack([np.ones(speed.size), speed])
    residual = z - line @ np.linalg.lstsq(line, z, rcond=None)[0]
    correlation_time = max(integrated_autocorrelation_time(residual), 1.0)
    se = float(np.std(residual, ddof=2)) * np.sqrt(correlation_time / residual.size)
    run.mu_sliding_se = se / float(np.radians(run.arc_deg))
    omega = float(np.mean(speed))
    run.pulley_speed_rad_s = omega + record.belt_speed_m_s / R
    run.slip_speed_m_s = float(sliding_speed(omega, R))
    if record.temperature_degC is not None and np.isfinite(record.temperature_degC[in_bin]).any():
        run.temperature_degC = float(np.nanmean(record.temperature_degC[in_bin]))
    run.n_samples = residual.size
    run.plateau_start_s, run.plateau_end_s = record.time_s[in_bin][[0, -1]].tolist()
