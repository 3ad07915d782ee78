"""Compile the rig ahead of use by a call with its argument types; run with ``python -m``."""

from __future__ import annotations

from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.rigsim.kernel_cache import compile_for_caller
from beltid.rigsim.model import Bench
from beltid.rigsim.steady import lay_on


def first_call() -> None:
    """Lay a belt on a pulley, which compiles the kernel of the rig."""
    friction = FrictionSurface.constant(0.5)
    bench = Bench(Belt(1e5, 0.02, 0.1), Rig(0.05, 0.1), Contact(), NormalLaw(1e8), friction)
    lay_on(bench.model(OperatingPoint(1.4, 270.0, 0.2)))


if __name__ == "__main__":
    compile_for_caller("rigsim", first_call)
