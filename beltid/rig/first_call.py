"""Compile the kernels of the rig by a first call, ahead of use or when they are needed."""

from __future__ import annotations

import functools

import numpy as np

from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.rig.compiler import compiled_by
from beltid.rig.model import FIXED, Bench
from beltid.rig.newton import MOST_ITERATIONS, STEP, Motion, equilibrium, march


@functools.cache
def compiled() -> None:
    """Make sure that the kernels are compiled; wait for a process that is compiling them."""
    compiled_by("rig", _first_call)


def _first_call() -> None:
    friction = FrictionSurface.constant(0.5)
    bench = Bench(Belt(1e5, 0.02, 0.1), Rig(0.05, 0.1), Contact(), NormalLaw(1e8), friction)
    model = bench.model(OperatingPoint(1.4, 270.0, 0.2))
    s = model.state()
    s.q_old[:] = model.path_coordinates()
    equilibrium(model.system, Motion(0.0, 0.0, 0.0, 0.0, 0.0), FIXED, s, MOST_ITERATIONS)
    march(model.system, FIXED, s, np.zeros(0, dtype=STEP), 0, 0)
