"""Which runs the simulated rig makes, and what they are for a belt that runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from beltid.errors import InputError
from beltid.params import OperatingPoint

if TYPE_CHECKING:
    from beltid.config import Config


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """One run of the simulated rig.

    Attributes
    ----------
    label : str
        Its label, that of its place in the whole campaign: the same however runs are picked.
    arc_deg, initial_tension_N, pulley_speed_rad_s : float
        Settings.
    """

    label: str
    arc_deg: float
    initial_tension_N: float
    pulley_speed_rad_s: float

    @property
    def point(self) -> OperatingPoint:
        """The settings for the science."""
        return OperatingPoint(
            beta=math.radians(self.arc_deg),
            T_0=self.initial_tension_N,
            omega=self.pulley_speed_rad_s,
        )


@dataclass(frozen=True, slots=True)
class Picked:
    """Runs that the user picked; an empty tuple leaves a setting open."""

    arcs_deg: tuple[float, ...] = ()
    tensions_N: tuple[float, ...] = ()
    speeds_rad_s: tuple[float, ...] = ()


def planned_runs(config: Config, picked: Picked) -> tuple[PlannedRun, ...]:
    """Runs of the config, those that were picked.

    Raises
    ------
    InputError
        If a value was picked that the config does not have; with the allowed ones.
    """
    rig = config.rig
    problems: list[str] = []
    arcs = _chosen(picked.arcs_deg, rig.arcs_deg, "--arc", problems)
    tensions = _chosen(picked.tensions_N, rig.initial_tensions_N, "--tension", problems)
    speeds = _chosen(picked.speeds_rad_s, rig.pulley_speeds_rad_s, "--speed", problems)
    if problems:
        raise InputError(problems)
    runs = []
    number = 0
    for arc in rig.arcs_deg:
        for tension in rig.initial_tensions_N:
            for speed in rig.pulley_speeds_rad_s:
                number += 1
                if arc in arcs and tension in tensions and speed in speeds:
                    runs.append(PlannedRun(f"S{number:03d}", arc, tension, speed))
    return tuple(runs)


def as_resting(config: Config, runs: Sequence[PlannedRun]) -> tuple[PlannedRun, ...]:
    """The runs of a running rig as those of a belt at rest; of another rig the runs themselves.

    A belt of the mass m per length that runs with v_b through its shape needs the force m v_b² of
    its tensions to be turned: what presses, rubs and bends is left to the effective tensions
    T - m v_b², and friction acts at the sliding speed abs(omega R - v_b). With these the balance of
    the running belt is that of the belt at rest, but for its strain: it runs faster where it is
    longer, so that the sliding speed differs by v_b (T_tight - T_slack)/EA between the ends of the
    arc. The coefficient is taken at one speed (docs/theory.md gives the size of the error).

    Raises
    ------
    InputError
        If the belt speed is not known, or a run has no tension or no sliding left.
    """
    rig = config.rig
    if rig.kind != "running":
        return tuple(runs)
    v_b, momentum = belt_speed(config), momentum_N(config)
    problems, resting = [], []
    for run in runs:
        T_0 = run.initial_tension_N - momentum
        omega = abs(run.pulley_speed_rad_s - v_b / rig.pulley_radius_m)
        if T_0 <= 0.0:
            problems.append(
                f"run {run.label}: initial tension {run.initial_tension_N:g} N, must be above "
                f"{momentum:.4g} N, which turn the running belt"
            )
        if omega == 0.0:
            problems.append(
                f"run {run.label}: pulley speed {run.pulley_speed_rad_s:g} rad/s, must differ from "
                "that of the belt"
            )
        resting.append(replace(run, initial_tension_N=T_0, pulley_speed_rad_s=omega))
    if problems:
        raise InputError(problems)
    return tuple(resting)


def belt_speed(config: Config) -> float:
    """Speed of the belt of a running rig [m/s]."""
    if config.rig.belt_speed_m_s is None:
        text = "rig.belt_speed_m_s is not set, must be the speed of the belt to simulate"
        raise InputError(f"{text} a running rig [m/s]")
    return config.rig.belt_speed_m_s


def momentum_N(config: Config) -> float:
    """Part of the tensions of a running belt that turns it [N]."""
    return config.belt.mass_per_length_kg_m * belt_speed(config) ** 2


def _chosen(
    picked: Sequence[float], allowed: Sequence[float], option: str, problems: list[str]
) -> set[float]:
    if not picked:
        return set(allowed)
    found = set()
    for value in picked:
        near = [a for a in allowed if math.isclose(a, value, rel_tol=1e-6)]
        if not near:
            known = ", ".join(f"{a:g}" for a in allowed)
            problems.append(f"{option} = {value:g}, must be one of those of the config: {known}")
        found.update(near)
    return found


def checked_run(arc_deg: Any, initial_tension_N: Any, pulley_speed_rad_s: Any) -> PlannedRun:
    """A run with the settings of a call, or an error with all that is wrong with them."""
    settings = (
        ("arc_deg", arc_deg, 360.0, "> 0 and < 360 °"),
        ("initial_tension_N", initial_tension_N, math.inf, "> 0 N and finite"),
        ("pulley_speed_rad_s", pulley_speed_rad_s, math.inf, "> 0 rad/s and finite"),
    )
    problems = []
    for name, value, limit, allowed in settings:
        if not is_number(value):
            problems.append(f"{name} = {value!r}, must be a number {allowed}")
        elif not 0.0 < value < limit:
            problems.append(f"{name} = {float(value):g}, must be {allowed}")
    if problems:
        raise InputError(problems)
    return PlannedRun("S001", *(float(value) for _, value, _, _ in settings))


def is_number(value: Any) -> bool:
    """Whether a value is a single real number; true and false are none."""
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
