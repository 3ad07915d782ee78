"""Reduce plateaus that have no rest or build-up: rows of a table.

Each gives one friction coefficient by Eq. (6). It shows neither the tail of a sticking peak nor the
zero of a cell, so neither is corrected. The resolution r of the force replaces the scatter: a
uniform distribution of this width has the standard deviation ``r / sqrt(12)``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.identify.friction.kinds import Drag, RigKind, drag_of
from beltid.identify.friction.run import (
    CELLS,
    MAX_MU,
    NAN,
    NUMBERS,
    TEXTS,
    Conditions,
    RunReduction,
    arc_problem,
    drag_range,
)
from beltid.laws.capstan import friction_coefficient, sliding_speed

Array = NDArray[np.float64]
Columns = Mapping[str, NDArray[Any]]
Rows = dict[str, Array]

STATED = ("mu", "normal_force_N_m")
"""Columns of a table of plateaus that states coefficient and normal force directly."""
SPEEDS = ("pulley_speed_rad_s", "slip_speed_m_s")


def reduce_plateaus(
    columns: Columns,
    R: float,
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
    table = {
        name: np.asarray(columns.get(name, np.full(n, NAN)), float)
        for name in (*NUMBERS, *STATED, *SPEEDS, "mu_se")
    }
    given = {name for name, values in table.items() if np.isfinite(values).any()}
    if given.isdisjoint(SPEEDS):
        raise InputError("column pulley_speed_rad_s or slip_speed_m_s is missing")
    if not kind.running:
        speed, slip = (table[name] for name in SPEEDS)
        table["pulley_speed_rad_s"] = np.where(np.isfinite(speed), speed, slip / R)
    is_idle = np.array([str(x).lower() == "true" for x in columns.get("idle", np.full(n, None))])
    rows = {name: values[~is_idle] for name, values in table.items()}
    drag, by_tensions = None, not given.issuperset(STATED)
    if by_tensions:
        if "arc_deg" not in given:
            raise InputError("column arc_deg is missing")
        kind = kind.found_in(rows)
        idle = [{name: x[[i]] for name, x in table.items()} for i in np.flatnonzero(is_idle)]
        drag = drag_of(idle)
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
    texts = {name: columns[name][~is_idle] for name in TEXTS if name in columns}
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
            drag_N_m=drag_range(kind, drag),
        )
        if by_tensions:
            run.set_plateau(tight[k], slack[k], R)
            run.torque_with = kind.span_beside_torque
            if np.isnan(run.mu_sliding_se):
                run.mu_sliding_se = float(se[k])
            run.momentum_N = float(momentum[k])
        run.status = _problem(run, kind) or "ok"
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


def _problem(run: RunReduction, kind: RigKind) -> str:
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
        if tensions[0] < tensions[1] and (why := kind.reversed("points")):
            return why
        for name, tension in zip(("tight", "slack"), tensions, strict=True):
            if not tension > 0.0:
                return f"tension_{name}_N = {tension:g}, must be > 0"
    if not 0.0 < run.mu_sliding <= MAX_MU:
        return f"mu_sliding = {run.mu_sliding:.4g}, must be in (0, {MAX_MU:g}]"
    if not run.normal_force_N_m > 0.0:
        return f"normal_force_N_m = {run.normal_force_N_m:g}, must be > 0"
    if not run.slip_speed_m_s > 0.0:
        return f"slip_speed_m_s = {run.slip_speed_m_s:g}, must be > 0"
    return ""
