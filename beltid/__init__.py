"""Contact parameters between a V-ribbed belt and a pulley, from bench recordings.

After G. Čepon, L. Manin, M. Boltežar, "Experimental identification of the contact parameters
between a V-ribbed belt and a pulley", Mechanism and Machine Theory 45 (2010) 1424-1433.

    import beltid

    config = beltid.load_config("configs/5pk.yaml")
    surface = beltid.load_surface("runs/5pk/surface.parquet")
    law = beltid.load_stiffness("runs/5pk/stiffness.parquet")
    run = beltid.simulate_rig(config, surface, law, arc_deg=82, initial_tension_N=270,
                              pulley_speed_rad_s=0.21, method="steady")

Errors that a user can correct raise a subclass of `BeltidError`.

Map of the packages; a package imports only from those below it:

====================== ====================================================== =================
Module                 Responsibility                                         Paper eq.
====================== ====================================================== =================
``cli``                the commands; the only package that prints or exits
``batch``              the whole chain for one or several belts
``stages``             one file per command: read, compute, write, summarize
``report``             figures, pages, summaries for the terminal
``export``             the contact law for other programs
``bench``              bench recordings: any format to validated columns
``artifacts``          results: self-describing Parquet files, written atomically
``config``             YAML to a frozen model; errors with line and column
``tables``             column definitions: name, type, unit, range, meaning
``plan``               which rig runs to measure next, and when to stop
``uncertainty``        budgets, normalized differences                        JCGM 100
``refine``             inverse problem: the surface that gives the tensions   beyond section 4
``identify.press``     press recording to normal contact law                  Eqs. (1) to (4)
``identify.slip``      speed loss to sliding speed                            Eq. (7)
``identify.friction``  rig run to friction coefficient                        Eqs. (5) to (8)
``identify.surface``   rig runs to friction surface                           section 2.2
``identify.agreement`` measured against simulated                             section 4
``drive``              belt drive from the identified laws: speed loss, forces section 2.2
``rigsim``             the simulated rig: ANCF belt, contact, stick-slip      Eqs. (9) to (12)
``mixed``              estimation: linear mixed model, sizes by likelihood
``laws``               constitutive formulas, one function per equation       Eqs. (1) to (9)
``params``             frozen parameter values with their bounds
``child_processes``    imports and signals of the processes that beltid starts
``errors``             the errors, with their exit statuses
====================== ====================================================== =================
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from beltid._version import __version__

if TYPE_CHECKING:
    from beltid.config import Config, load_config
    from beltid.errors import (
        ArtifactError,
        BeltidError,
        BeltidWarning,
        ConfigError,
        InputError,
        NumericsError,
    )
    from beltid.export.law import ContactLaw
    from beltid.laws.friction_surface import FrictionSurface
    from beltid.laws.penalty import NormalLaw
    from beltid.stages.drive.simulate_drive import simulate_drive
    from beltid.stages.identification.build_surface import build_surface
    from beltid.stages.identification.fit_friction import fit_friction
    from beltid.stages.identification.fit_slip import fit_slip
    from beltid.stages.identification.fit_stiffness import fit_stiffness
    from beltid.stages.identification.recordings import read_press, read_rig, read_speedloss
    from beltid.stages.simulation.compare import compare, predict_held_out
    from beltid.stages.simulation.plan import plan_runs
    from beltid.stages.simulation.refine_surface import refine_surface
    from beltid.stages.simulation.simulated_runs import simulate_campaign, simulate_rig
    from beltid.stages.tables import load_law, load_stiffness, load_surface

__all__ = [
    "ArtifactError",
    "BeltidError",
    "BeltidWarning",
    "Config",
    "ConfigError",
    "ContactLaw",
    "FrictionSurface",
    "InputError",
    "NormalLaw",
    "NumericsError",
    "__version__",
    "build_surface",
    "compare",
    "fit_friction",
    "fit_slip",
    "fit_stiffness",
    "load_config",
    "load_law",
    "load_stiffness",
    "load_surface",
    "plan_runs",
    "predict_held_out",
    "read_press",
    "read_rig",
    "read_speedloss",
    "refine_surface",
    "simulate_campaign",
    "simulate_drive",
    "simulate_rig",
]

# public name -> its module, imported when the name is first used: `import beltid` stays cheap,
# numpy and the like are imported only when something is computed
_HOMES = {
    "Config": "config",
    "load_config": "config",
    **dict.fromkeys(
        (
            "ArtifactError",
            "BeltidError",
            "BeltidWarning",
            "ConfigError",
            "InputError",
            "NumericsError",
        ),
        "errors",
    ),
    "ContactLaw": "export.law",
    "FrictionSurface": "laws.friction_surface",
    "NormalLaw": "laws.penalty",
    "build_surface": "stages.identification.build_surface",
    "refine_surface": "stages.simulation.refine_surface",
    "compare": "stages.simulation.compare",
    "fit_friction": "stages.identification.fit_friction",
    "fit_slip": "stages.identification.fit_slip",
    "fit_stiffness": "stages.identification.fit_stiffness",
    "predict_held_out": "stages.simulation.compare",
    "plan_runs": "stages.simulation.plan",
    **dict.fromkeys(
        ("read_press", "read_rig", "read_speedloss"), "stages.identification.recordings"
    ),
    "load_law": "stages.tables",
    "load_stiffness": "stages.tables",
    "load_surface": "stages.tables",
    "simulate_campaign": "stages.simulation.simulated_runs",
    "simulate_drive": "stages.drive.simulate_drive",
    "simulate_rig": "stages.simulation.simulated_runs",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
