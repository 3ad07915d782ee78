"""Geometry of the belt path: tangent spans, wrap angles, and the arm of the tensioner.

A pulley turns anticlockwise (sense +1) or clockwise (-1); ribs and back turn opposite ways. With
the direction ``t`` of a span and its left normal ``n``, the belt touches a pulley of sense ``s`` at
``c - s R n``. So ``c_2 - c_1 = L t + (s_2 R_2 - s_1 R_1) n`` between two centres, which gives the
length L of the span and its direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltid.drive.model import Drive, Pulley
from beltid.errors import InputError

Array = NDArray[np.float64]


def preceding(values: NDArray[Any]) -> NDArray[Any]:
    """Shift a ring: each entry becomes its predecessor. Several times faster than `numpy.roll`."""
    return np.concatenate((values[-1:], values[:-1]))


def following(values: NDArray[Any]) -> NDArray[Any]:
    """Shift a ring: each entry becomes its successor."""
    return np.concatenate((values[1:], values[:1]))


@dataclass(frozen=True, slots=True)
class Layout:
    """Spans and arcs of a belt on its pulleys; span i runs from pulley i to the next one."""

    centres: Array  # of the pulleys (n, 2) [m]
    starts: Array  # tangent points where the spans begin and end (n, 2) [m]
    ends: Array
    spans: Array  # lengths (n,) [m]
    directions: Array  # unit vectors of the spans in the running direction (n, 2)
    wraps: Array  # angles of the arcs between tangent points (n,) [rad]
    senses: Array  # +1 where a pulley turns anticlockwise, -1 where it turns clockwise (n,)

    def hub_forces(self, P: Array) -> Array:
        """Return the force of the belt on each axis (n, 2) [N] at the effective span forces P."""
        leaving = P[:, None] * self.directions
        return leaving - preceding(leaving)


def layout(drive: Drive, arm_angle: float | None = None) -> Layout:
    """Lay the belt on the pulleys of a drive, with the tensioner's arm at an angle [rad].

    Without it the pulley on the arm keeps its stated centre. An InputError says that pulleys
    overlap or that no belt path fits them.
    """
    pulleys = list(drive.pulleys)
    if arm_angle is not None and drive.tensioner is not None:
        arm, moved = drive.tensioner, drive.tensioner.pulley
        x = arm.pivot[0] + arm.arm * math.cos(arm_angle)
        y = arm.pivot[1] + arm.arm * math.sin(arm_angle)
        pulleys[moved] = replace(pulleys[moved], x=x, y=y)
    overlaps = [
        f"pulleys {a.name} and {b.name} overlap: their centres are "
        f"{math.hypot(b.x - a.x, b.y - a.y):g} m apart, must be more than {a.R + b.R:g} m"
        for a, b in combinations(pulleys, 2)
        if math.hypot(b.x - a.x, b.y - a.y) <= a.R + b.R
    ]
    if overlaps:
        raise InputError(overlaps)
    # the rib pulleys usually turn in the sense of the pulley order
    neighbours = zip(pulleys[-1:] + pulleys[:-1], pulleys, strict=True)
    twice_area = sum(a.x * b.y - b.x * a.y for a, b in neighbours)
    for sense in (math.copysign(1.0, twice_area), -math.copysign(1.0, twice_area)):
        laid = _lay(pulleys, sense)
        turns = abs(np.sum(laid.senses * laid.wraps)) / (2.0 * np.pi)
        if abs(turns - 1.0) < 1e-7 and not _crosses_itself(laid):
            return laid
    raise InputError(
        "the belt crosses itself or does not reach a pulley: the pulleys must be listed in the "
        "order of the belt, each with its centre and the side of the belt that touches it"
    )


def arm_moment(drive: Drive, laid: Layout, angle: float, P: Array) -> float:
    """Return the moment of belt and spring on the tensioner's arm [N m], anticlockwise > 0."""
    tensioner = drive.tensioner
    assert tensioner is not None
    free, side = tensioner.free_angle, math.copysign(1.0, drive.mean_angle - tensioner.free_angle)
    arm = laid.centres[tensioner.pulley] - tensioner.pivot
    force = laid.hub_forces(P)[tensioner.pulley]
    spring = -side * tensioner.preload - tensioner.rate * (angle - free)
    return float(arm[0] * force[1] - arm[1] * force[0]) + spring


def _lay(pulleys: list[Pulley], sense: float) -> Layout:
    """Lay the belt on, with the rib pulleys turning in the given sense."""
    centres = np.array([(p.x, p.y) for p in pulleys])
    senses = np.array([sense if p.ribs else -sense for p in pulleys])
    offsets = senses * np.array([p.R for p in pulleys])
    to_next = following(centres) - centres
    across = following(offsets) - offsets
    spans = np.sqrt(np.sum(to_next**2, axis=1) - across**2)
    angles = np.arctan2(to_next[:, 1], to_next[:, 0]) - np.arctan2(across, spans)
    wraps = np.mod(senses * (angles - preceding(angles)), 2.0 * np.pi)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    normals = np.column_stack([-directions[:, 1], directions[:, 0]])
    starts = centres - offsets[:, None] * normals
    ends = starts + spans[:, None] * directions
    return Layout(centres, starts, ends, spans, directions, wraps, senses)


def _crosses_itself(laid: Layout) -> bool:
    """Return whether any two spans cross."""
    pairs = list(combinations(zip(laid.starts, laid.ends, strict=True), 2))
    return any(_separates(a, b, c, d) and _separates(c, d, a, b) for (a, b), (c, d) in pairs)


def _separates(a: Array, b: Array, c: Array, d: Array) -> bool:
    """Return whether points c and d lie on opposite sides of the line through a and b."""
    (x, y), (cx, cy), (dx, dy) = b - a, c - a, d - a
    return bool((x * cy - y * cx) * (x * dy - y * dx) < 0.0)
