"""Drive of a config, with operating points from the config or from a speed-loss recording."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from beltid.config import Config
from beltid.config.model import DriveSection
from beltid.drive.geometry import layout
from beltid.drive.model import Drive, DrivePoint, Pulley, Tensioner
from beltid.drive.rods import short_spans
from beltid.errors import InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw

ALIKE_RADII: Final = (0.7, 1.5)
"""Pulley radius over rig radius for which the laws may hold: wedging changes with curvature."""


@dataclass(frozen=True, slots=True)
class LabelledPoint:
    """An operating point with its label in tables."""

    run: str
    point: DrivePoint


def drive_of(config: Config, surface: FrictionSurface, law: NormalLaw) -> Drive:
    """Build the drive of a config with identified laws; refuse names that are not of a pulley."""
    section = config.drive
    names = [pulley.name for pulley in section.pulleys]
    _check_names(section, names)
    driven = {*section.operating_points.torque_N_m, *section.operating_points.power_W}
    pulleys = tuple(
        Pulley(
            pulley.name,
            pulley.x_m,
            pulley.y_m,
            pulley.radius_m,
            pulley.side == "rib",
            0.0 if pulley.name in {*driven, section.driving} else section.idler_torque_N_m,
        )
        for pulley in section.pulleys
    )
    return Drive(
        config.belt_params(),
        law,
        surface,
        pulleys,
        names.index(section.driving),
        section.installation,
        _tensioner(section, names),
        section.back_friction,
        belt_length=math.nan if section.belt_length_m is None else section.belt_length_m,
    )


def points_of_config(config: Config) -> list[LabelledPoint]:
    """Return the operating points of a config: every initial tension with every listed point."""
    section = config.drive
    points, names = section.operating_points, [pulley.name for pulley in section.pulleys]
    lists = {"driver_speed_rad_s": points.driver_speed_rad_s}
    for key in ("torque_N_m", "power_W"):
        lists |= {f"{key}.{name}": values for name, values in getattr(points, key).items()}
    n = max(len(values) for values in lists.values())
    problems = [
        f"drive.operating_points.{key}: {len(values)} values, must be 1 or {n} (the longest list)"
        for key, values in lists.items()
        if len(values) not in (1, n)
    ]
    length, tensions = section.belt_length_m, section.initial_tension_N
    if length is not None and (tensions is not None or section.installation == "slack_force"):
        problems.append("drive.belt_length_m: must not be stated with initial_tension_N")
    if section.installation != "tensioner" and tensions is None and length is None:
        problems.append(f"drive.initial_tension_N: must be stated with {section.installation}")
    if problems:
        raise InputError(problems)
    full = {key: values * n if len(values) == 1 else values for key, values in lists.items()}
    nothing = (0.0,) * n

    def point(i: int, tension: float) -> DrivePoint:
        loads = (
            tuple(full.get(f"{key}.{name}", nothing)[i] for name in names)
            for key in ("torque_N_m", "power_W")
        )
        return DrivePoint(full["driver_speed_rad_s"][i], tension, *loads)

    return [
        LabelledPoint(str(t * n + i + 1), point(i, tension))
        for t, tension in enumerate(tensions or (math.nan,))
        for i in range(n)
    ]


def points_of_slip(config: Config, columns: Mapping[str, np.ndarray]) -> list[LabelledPoint]:
    """Return the operating points of a speed-loss recording, with the torque on the load pulley.

    A braking torque is positive. If the pulley falls behind under torques that drive, on balance,
    the recording uses the other sign, and all signs are reversed.
    """
    section, loaded = config.drive, load_pulley(config.drive)
    speed, tension, torque, loss = (
        np.asarray(columns[name], dtype=float)
        for name in ("driver_speed_rad_s", "initial_tension_N", "torque_N_m", "speed_loss_rad_s")
    )
    braking = torque * np.sign(speed)
    if np.nansum(braking * loss) < 0.0:
        braking = -braking
    is_complete = np.isfinite(speed) & np.isfinite(tension) & np.isfinite(torque) & (speed != 0.0)
    if not is_complete.any():
        raise InputError("no run of the recording has a driver speed, a torque and a tension")
    return [
        LabelledPoint(
            str(columns["run"][i]),
            DrivePoint(
                float(speed[i]),
                float(tension[i]),
                tuple(float(braking[i]) if p.name == loaded else 0.0 for p in section.pulleys),
            ),
        )
        for i in np.flatnonzero(is_complete)
    ]


def load_pulley(section: DriveSection) -> str:
    """Return the only pulley that takes torque, which a speed-loss recording contains."""
    others = [pulley.name for pulley in section.pulleys if pulley.name != section.driving]
    stated = {*section.operating_points.torque_N_m, *section.operating_points.power_W}
    candidates = [name for name in others if name in stated] or others
    if len(candidates) != 1:
        raise InputError(
            f"drive.operating_points: {', '.join(candidates)} could be the pulley of the recorded "
            "torque; state a torque_N_m for that one only"
        )
    return candidates[0]


def drive_warnings(config: Config, drive: Drive, tensions: list[float]) -> list[str]:
    """Warn where a drive is outside the range of its laws; refuse spans too short for rods."""
    spans = layout(drive).spans
    problems = short_spans(drive, spans, np.full(spans.size, min(tensions)))
    if problems and config.drive.method == "rod":
        raise InputError(problems)
    rig, (low, high) = config.rig.pulley_radius_m, ALIKE_RADII
    return [
        f"pulley {pulley.name}: radius {pulley.R:g} m is outside {low * rig:g} to "
        f"{high * rig:g} m, where the contact identified on the rig can be expected to hold"
        for pulley in drive.pulleys
        if pulley.ribs and not low <= pulley.R / rig <= high
    ]


def _check_names(section: DriveSection, names: list[str]) -> None:
    points = section.operating_points
    stated = {
        "drive.driver": [section.driving],
        "drive.operating_points.torque_N_m": points.torque_N_m,
        "drive.operating_points.power_W": points.power_W,
        "drive.tensioner.pulley": [] if section.tensioner is None else [section.tensioner.pulley],
    }
    problems = [
        f"{key}: {name} is not the name of a pulley, must be one of {', '.join(names)}"
        for key, references in stated.items()
        for name in references
        if name not in names
    ]
    twice = dict.fromkeys(name for name in names if names.count(name) > 1)
    problems += [f"drive.pulleys: {name} is named twice" for name in twice]
    if (section.tensioner is not None) != (section.installation == "tensioner"):
        problems.append(
            "drive.tensioner: must be stated with installation: tensioner, and only then"
        )
    if problems:
        raise InputError(problems)


def _tensioner(section: DriveSection, names: list[str]) -> Tensioner | None:
    if section.tensioner is None:
        return None
    arm = section.tensioner.si()
    free, stops = arm["free_angle_rad"], (-math.inf, math.inf)
    if section.tensioner.stops_deg is not None:
        angles = (math.radians(stop) - free for stop in section.tensioner.stops_deg)
        low, high = sorted(free + math.remainder(angle, 2.0 * math.pi) for angle in angles)
        stops = low, high
    return Tensioner(
        names.index(arm["pulley"]),
        arm["pivot_m"],
        arm["arm_m"],
        free,
        arm["preload_N_m"],
        arm["rate_N_m_rad"],
        stops,
    )
