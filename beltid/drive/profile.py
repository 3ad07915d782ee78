"""Compute line force and sliding speed along the arc of each pulley of a solved point."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from beltid.drive.results import DriveResult
from beltid.drive.string import StringLevel
from beltid.rig.flow import FlowState

Array = NDArray[np.float64]

PLACES: Final = 60
"""Number of points along the sliding arc of the string."""


@dataclass(frozen=True, slots=True)
class ArcProfile:
    """Contact along the arc of a pulley, starting at the entry; arrays of equal length.

    Attributes
    ----------
    angle : ndarray
        Angle from the tangent point of the entering span [rad].
    normal_force : ndarray
        Line force [N/m].
    slip_speed : ndarray
        Speed of the pulley's surface against the belt [m/s], > 0 where the pulley is ahead.
    """

    angle: Array
    normal_force: Array
    slip_speed: Array


def arc_profiles(result: DriveResult) -> list[ArcProfile | None]:
    """Compute the contact of each pulley of ``result.drive``; None without a steady state."""
    state, n = result.state, len(result.drive.pulleys)
    profiles: list[ArcProfile | None] = []
    for i, rod in enumerate(state.rods or (None,) * n):
        if state.slack or math.isnan(state.arcs.slip[i]):
            profiles.append(None)
        else:
            wrap = float(result.rest.laid.wraps[i])
            profiles.append(_of_string(result, i) if rod is None else _of_rod(rod, wrap))
    return profiles


def _of_rod(rod: FlowState, wrap: float) -> ArcProfile:
    """Read the profile from the contact points of a rod."""
    touches = rod.line_force > 0.0
    angle = rod.angle[touches] + 0.5 * wrap
    return ArcProfile(angle, rod.line_force[touches], rod.slip_speed[touches])


def _of_string(result: DriveResult, i: int) -> ArcProfile:
    """Join the adhesion arc and the sliding arc, with (D4) summed over steps of ln P."""
    state, drive = result.state, result.drive
    P_in, P_out = float(state.P_in[i]), float(state.P[i])
    P = np.geomspace(P_in, P_out, PLACES)
    x = float(state.arcs.slip[i])
    force, slip, mu = StringLevel(drive).along_arc(i, P, state.v0, x)
    per_angle = 1.0 / mu
    steps = 0.5 * (per_angle[1:] + per_angle[:-1]) * np.abs(np.diff(np.log(P)))
    from_exit = np.concatenate([np.cumsum(steps[::-1])[::-1], [0.0]])
    angle = np.maximum(state.laid.wraps[i] - from_exit, 0.0)
    ahead = math.copysign(1.0, P_in - P_out)
    return ArcProfile(
        np.concatenate([[0.0], angle]),
        np.concatenate([force[:1], force]),
        ahead * np.concatenate([slip[:1], slip]),
    )
