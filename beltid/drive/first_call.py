"""Compile the kernels of a drive by a first call, ahead of use or when they are needed."""

from __future__ import annotations

import functools

import numpy as np

from beltid.drive.model import Drive, Pulley
from beltid.drive.string import StringLevel
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt
from beltid.rig.compiler import compiled_by


@functools.cache
def compiled() -> None:
    """Make sure that the kernels are compiled; wait for a process that is compiling them."""
    compiled_by("drive", _first_call)


def _first_call() -> None:
    pulleys = (Pulley("driver", 0.0, 0.0, 0.05), Pulley("driven", 0.25, 0.0, 0.05))
    surface = FrictionSurface.constant(0.5)
    level = StringLevel(Drive(Belt(1e5, 0.02, 0.1), NormalLaw(1e8), surface, pulleys))
    forces, wraps = np.array([300.0, 200.0]), np.full(2, np.pi)
    level.arcs(forces, forces[::-1], 1.0, wraps)
