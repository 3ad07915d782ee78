"""Runs of two campaigns matched by their settings: arc, nominal tension, pulley speed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

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

    @property
    def size(self) -> int:
        """Number of runs."""
        return int(self.mu.size)

    def take(self, index: NDArray[np.intp]) -> RunTable:
        """Runs of an index."""
        return RunTable(
            self.run[index],
            self.arc_deg[index],
            self.tension[index],
            self.speed[index],
            self.force[index],
            self.mu[index],
            self.reason[index],
        )


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

    def arc_labels(self, runs: RunTable) -> NDArray[np.intp]:
        """Number of the arc setting of each run, ascending."""
        return _labels(runs.arc_deg, self.arc)

    def tension_labels(self, runs: RunTable) -> NDArray[np.intp]:
        """Number of the tension setting of each run, ascending."""
        return _labels(runs.tension, self.tension)

    def speed_labels(self, runs: RunTable) -> NDArray[np.intp]:
        """Number of the speed setting of each run, ascending."""
        return _labels(runs.speed, self.speed)


def _labels(values: Array, gap: float) -> NDArray[np.intp]:
    order = np.argsort(values, kind="stable")
    jump = np.diff(values[order]) > gap * values[order][:-1]
    labels = np.empty(values.size, dtype=np.intp)
    labels[order] = np.concatenate([[0], np.cumsum(jump)])
    return labels


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """Pairs of runs with equal settings.

    Attributes
    ----------
    measured, simulated : ndarray of int (m,)
        Rows of the pairs; a simulated run may answer several repetitions of a measured one.
    left_out : tuple of (str, str)
        Every run that is in no pair: side and label, reason.
    """

    measured: NDArray[np.intp]
    simulated: NDArray[np.intp]
    left_out: tuple[tuple[str, str], ...]

    @property
    def counts(self) -> dict[str, int]:
        """Number of runs for each reason to be left out, most frequent first."""
        return dict(Counter(reason for _, reason in self.left_out).most_common())


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
    reason = np.array(
        [
            _why_not(str(status[k]), {name: float(a[k]) for name, a in values.items()})
            for k in range(run.size)
        ],
        dtype=object,
    )
    arc, tension, speed, force, mu = values.values()
    return RunTable(run, arc, tension, speed, force, mu, reason)


def _why_not(status: str, values: Mapping[str, float]) -> str:
    """Why a run cannot be compared, empty if it can."""
    if status != OK:
        return status or "status is empty"
    wrong = [name for name, x in values.items() if not 0.0 < x < np.inf]
    return f"{' and '.join(wrong)} not a number > 0" if wrong else ""


def match_runs(measured: RunTable, simulated: RunTable, settings: MatchSettings) -> Matches:
    """Find for every measured run the simulated one of the same settings.

    Among several simulated runs within the tolerances the one with the same label wins, else the
    one with the nearest speed.
    """
    rows, partners = [], []
    left_out: list[tuple[str, str]] = []
    usable = simulated.reason == ""
    answered = np.zeros(simulated.size, dtype=bool)
    for k in range(measured.size):
        near, distance = _candidates(measured, k, simulated, settings)
        answered |= near  # by a run that was set aside, too: that one is counted
        partner = near & usable
        if measured.reason[k]:
            left_out.append((f"measured {measured.run[k]}", f"measured: {measured.reason[k]}"))
        elif partner.any():
            order = np.where(simulated.run == measured.run[k], -1.0, distance)
            rows.append(k)
            partners.append(int(np.argmin(np.where(partner, order, np.inf))))
        else:
            why = "no simulated run with these settings"
            if near.any():
                why = f"simulated: {simulated.reason[near][0]}"
            left_out.append((f"measured {measured.run[k]}", why))
    for run, reason in zip(simulated.run[~answered], simulated.reason[~answered], strict=True):
        why = f"simulated: {reason}" if reason else "no measured run with these settings"
        left_out.append((f"simulated {run}", why))
    index = np.array(rows, dtype=np.intp), np.array(partners, dtype=np.intp)
    return Matches(*index, tuple(left_out))


def _candidates(
    measured: RunTable, k: int, simulated: RunTable, settings: MatchSettings
) -> tuple[NDArray[np.bool_], Array]:
    """Simulated runs within the tolerances of a measured one, and their distance in speed."""
    distance = np.abs(simulated.speed - measured.speed[k])
    arc, tension = measured.arc_deg[k], measured.tension[k]
    near = (
        (np.abs(simulated.arc_deg - arc) <= settings.arc * arc)
        & (np.abs(simulated.tension - tension) <= settings.tension * tension)
        & (distance <= settings.speed * measured.speed[k])
    )
    return near, distance
