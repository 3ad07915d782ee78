"""Compile the kernels of a drive ahead: ``python -m`` this module calls them once."""

from __future__ import annotations

from beltid.drive.model import Drive, DrivePoint, Pulley
from beltid.drive.results import Simulator
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt
from beltid.rigsim.kernel_cache import compile_for_caller


def first_call() -> None:
    """Solve a drive of two pulleys at string and rod level."""
    pulleys = (Pulley("driver", 0.0, 0.0, 0.05), Pulley("driven", 0.25, 0.0, 0.05))
    friction = FrictionSurface.constant(0.5)
    drive = Drive(Belt(1e5, 0.02, 0.1), NormalLaw(1e8), friction, pulleys)
    Simulator(drive, "rod").solve(DrivePoint(60.0, 300.0, (0.0, 4.0)))


if __name__ == "__main__":
    compile_for_caller("drive", first_call)
