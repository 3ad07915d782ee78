"""Runs of two campaigns matched by their settings: arc, nominal tension, pulley speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from beltid.errors import InputError

Array = NDArray[np.float64]

OK = "ok"


@dataclass(frozen=True, slots=True, eq=False)
class RunTable:
    """Reduced runs of one campaign, arrays (n,).

    Attributes
    ----------
    run : ndarray of object
        Label.
    arc_deg, tension, speed : ndarray
        Settings: contact arc [deg], nominal tension [N], magnitude of the pulley speed [rad/s].
    force : ndarray
        Mean normal force per length [N/m].
    mu : ndarray
        Sliding friction coefficient [-].
    reason : ndarray of object
        Why the run cannot be compared; empty if it can.
    """

    run: NDArray[np.object_]
    arc_deg: Array
    tension: Array
    speed: Array
    force: Array
    mu: Array
    reason: NDArray[np.object_]

    def take(self, index: NDArray[np.intp]) -> RunTable:
        """Runs of an index."""
        return RunTable(*(getattr(self, field.name)[index] for field in fields(self)))


@dataclass(frozen=True, slots=True)
class MatchSettings:
    """How far apart the same setting may be on two sides, relative to its value.

    Parameters
    ----------
    arc : float
        Contact arc [-].
    tension : float
        Nominal tension [-].
    speed : float
        Pulley speed [-]: the measured one is met by the motor to about a percent.
    """

    arc: float = 1e-3
    tension: float = 5e-3
    speed: float = 3e-2

    def __post_init__(self) -> None:
        problems = [
            f"compare.match.{name} = {value}, must be in (0, 1)"
            for name, value in (("arc", self.arc), ("tension", self.tension), ("speed", self.speed))
            if not 0.0 < value < 1.0
        ]
        if problems:
            raise InputError(problems)


def run_table(columns: Mapping[str, ArrayLike], side: str) -> RunTable:
    """Table of runs from the columns of the reduction.

    Raises
    ------
    InputError
        If columns are missing or differ in length.
    """
    numbers = ("arc_deg", "nominal_tension_N", "pulley_speed_rad_s", "normal_force_N_m")
    needed = ("run", *numbers, "mu_sliding")
    problems = [f"{side}: column {name} is missing" for name in needed if name not in columns]
    if problems:
        raise InputError(problems)
    run = np.array([str(label) for label in np.asarray(columns["run"]).ravel()], dtype=object)
    values = {name: np.asarray(columns[name], dtype=float) for name in needed[1:]}
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
    arc, tension, speed, force, mu = values.values()
    return RunTable(run, arc, tension, speed, force, mu, reason)


def match_runs(
    measured: RunTable, simulated: RunTable, settings: MatchSettings
) -> tuple[NDArray[np.intp], NDArray[np.intp], tuple[tuple[str, str], ...]]:
    """Find for every measured run the simulated one of the same settings.

    Among several simulated runs within the tolerances the one with the same label wins, else the
    one with the nearest speed; a simulated run may answer several repetitions of a measured one.

    Returns
    -------
    measured, simulated : ndarray of int (m,)
        Rows of the pairs.
    left_out : tuple of (str, str)
        Every run that is in no pair: side and label, reason.
    """
    pairs: list[tuple[int, int]] = []
    left_out: list[tuple[str, str]] = []
    usable = simulated.reason == ""
    answered = np.zeros(usable.size, dtype=bool)
    for k, (label, reason) in enumerate(zip(measured.run, measured.reason, strict=True)):
        distance = np.abs(simulated.speed - measured.speed[k])
        near = distance <= settings.speed * measured.speed[k]
        for theirs, mine, share in (
            (simulated.arc_deg, measured.arc_deg[k], settings.arc),
            (simulated.tension, measured.tension[k], settings.tension),
        ):
            near &= np.abs(theirs - mine) <= share * mine
        answered |= near  # by a run that was set aside, too: that one is counted
        if reason:
            left_out.append((f"measured {label}", f"measured: {reason}"))
        elif np.any(near & usable):
            order = np.where(simulated.run == label, -1.0, distance)
            pairs.append((k, int(np.argmin(np.where(near & usable, order, np.inf)))))
        elif near.any():
            left_out.append((f"measured {label}", f"simulated: {simulated.reason[near][0]}"))
        else:
            left_out.append((f"measured {label}", "no simulated run with these settings"))
    for label, reason in zip(simulated.run[~answered], simulated.reason[~answered], strict=True):
        why = f"simulated: {reason}" if reason else "no measured run with these settings"
        left_out.append((f"simulated {label}", why))
    rows = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    return rows[:, 0], rows[:, 1], tuple(left_out)
