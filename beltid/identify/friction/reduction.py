"""Reduce the runs of the friction rig: tensions over time to one friction coefficient per run.

The same function serves the bench and the simulated rig; nothing in it depends on which one wrote
the recording. A run that cannot be reduced is set aside with its reason, never dropped.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from beltid.errors import InputError
from beltid.identify.friction.rig_table import check_columns, run_records
from beltid.identify.friction.run import FrictionSettings, RunRecord, RunReduction, arc_problem
from beltid.identify.friction.stream import reduce_stream

__all__ = ["FrictionSettings", "RunRecord", "RunReduction", "reduce_run", "reduce_runs"]


def reduce_run(
    time_s: ArrayLike,
    tension_tight_N: ArrayLike,
    tension_slack_N: ArrayLike,
    pulley_speed_rad_s: ArrayLike,
    *,
    arc_deg: float,
    pulley_radius_m: float,
    settings: FrictionSettings | None = None,
) -> RunReduction:
    """Reduce one recording of the friction rig.

    Parameters
    ----------
    time_s : array_like
        Times [s], shape (n,).
    tension_tight_N, tension_slack_N : array_like
        Tensions of the two spans [N], > 0; nan where a sample is missing, shape (n,).
    pulley_speed_rad_s : array_like
        Speed of the pulley [rad/s], of either sign, zero at the beginning, shape (n,).
    arc_deg : float
        Contact arc [deg].
    pulley_radius_m : float
        Radius of the belt's centreline on the pulley [m].
    settings : FrictionSettings, optional
        Settings of the reduction.

    Returns
    -------
    RunReduction
        With ``status == "ok"``, or with the reason why the run was set aside.

    Raises
    ------
    InputError
        If the columns differ in length, or the radius is not positive.
    """
    columns = {
        "time_s": time_s,
        "tension_tight_N": tension_tight_N,
        "tension_slack_N": tension_slack_N,
        "pulley_speed_rad_s": pulley_speed_rad_s,
    }
    arrays = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
    check_columns(arrays)
    _check_radius(pulley_radius_m)
    record = RunRecord(
        time_s=arrays["time_s"],
        tension_tight_N=arrays["tension_tight_N"],
        tension_slack_N=arrays["tension_slack_N"],
        pulley_speed_rad_s=arrays["pulley_speed_rad_s"],
        arc_deg=float(arc_deg),
        defect=arc_problem(float(arc_deg)),
    )
    return reduce_stream([record], pulley_radius_m, settings or FrictionSettings())[0]


def reduce_runs(
    columns: Mapping[str, ArrayLike],
    pulley_radius_m: float,
    settings: FrictionSettings | None = None,
) -> tuple[RunReduction, ...]:
    """Reduce all runs of a recording of the friction rig.

    Parameters
    ----------
    columns : mapping of str to array_like
        The columns of rig.csv: run, time_s [s], tension_tight_N, tension_slack_N [N],
        pulley_speed_rad_s [rad/s], arc_deg [deg], and optionally temperature_degC [°C] and
        initial_tension_N (nominal) [N], shape (n,) each. Rows of a run need not be together.
    pulley_radius_m : float
        Radius of the belt's centreline on the pulley [m].
    settings : FrictionSettings, optional
        Settings of the reduction.

    Returns
    -------
    tuple of RunReduction
        One for every run, in the order in which they first appear.

    Raises
    ------
    InputError
        If a column is missing, has another length or is not numeric, if there are no samples, or
        if the radius is not positive.
    """
    _check_radius(pulley_radius_m)
    return reduce_stream(run_records(columns), pulley_radius_m, settings or FrictionSettings())


def _check_radius(pulley_radius_m: float) -> None:
    if not (np.isfinite(pulley_radius_m) and pulley_radius_m > 0.0):
        raise InputError(f"pulley_radius_m = {pulley_radius_m!r}, must be > 0")
