"""The steps of the method and the other commands: read, compute, write, summarise.

``steps`` says what each step reads, uses and makes; the work stands in

``friction``  recordings to the normal contact law, Eqs. (1) to (4), the sliding speeds in service,
              (7), and mu per run of the rig, measured or simulated, (5) to (8)
``surface``   coefficients to mu(f_N, v): published (section 2.2), and refined (beyond)
``rig``       the runs of the rig, simulated, (9) to (12)
``compare``   measured against simulated (section 4), runs left out, losses of a drive
``drive``     a belt drive from the identified laws (section 2.2)
``plan``      the next runs of the rig

Other commands: ``inspect_file`` (and a config for a new belt), ``about`` (versions, values of a
config, any artifact), ``report_belt``, ``export_law``.
``inputs`` are laws, surfaces and runs from files or memory; ``workers`` do the heavy calls.
"""

from importlib import import_module
from types import ModuleType


def __getattr__(name: str) -> ModuleType:
    """Import a module of the room when it is first used: a help text needs none of them."""
    if name.startswith("_"):
        raise AttributeError(name)
    return import_module(f"{__name__}.{name}")
