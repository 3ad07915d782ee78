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
``stages``             the steps of the method, and what the other commands do
``stage``              what a step is: function, command, freshness, origin
``report``             figures, pages, summaries for the terminal
``export``             the contact law for other programs
``bench``              bench recordings: any format to validated columns
``store``              results: self-describing Parquet files, written atomically
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
``rig``                the simulated rig: ANCF belt, contact, stick-slip      Eqs. (9) to (12)
``mixed``              estimation: linear mixed model, sizes by likelihood
``laws``               constitutive formulas, one function per equation       Eqs. (1) to (9)
``params``             frozen parameter values with their bounds
``notes``              notes and progress, by the logger of the standard library
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
    from beltid.stage import Outcome
    from beltid.stages.inputs import load_law, load_stiffness, load_surface
    from beltid.stages.rig import simulate_campaign, simulate_rig
    from beltid.stages.steps import (
        build_surface,
        compare,
        compare_drive,
        cross_validate,
        fit_friction,
        fit_slip,
        fit_stiffness,
        plan_runs,
        read_press,
        read_rig,
        read_speedloss,
        refine_surface,
        simulate_drive,
    )

# fmt: off
__all__ = [
    "ArtifactError", "BeltidError", "BeltidWarning", "Config", "ConfigError", "ContactLaw",
    "FrictionSurface", "InputError", "NormalLaw", "NumericsError", "Outcome", "__version__",
    "build_surface", "compare", "compare_drive", "cross_validate", "fit_friction", "fit_slip",
    "fit_stiffness", "load_config", "load_law", "load_stiffness", "load_surface", "plan_runs",
    "read_press", "read_rig", "read_speedloss", "refine_surface", "simulate_campaign",
    "simulate_drive", "simulate_rig",
]
# fmt: on

# module -> its public names, imported when first used: `import beltid` stays cheap, numpy and the
# like are imported only when something is computed
_PUBLIC = {
    "config": "Config load_config",
    "errors": "ArtifactError BeltidError BeltidWarning ConfigError InputError NumericsError",
    "export.law": "ContactLaw",
    "laws.friction_surface": "FrictionSurface",
    "laws.penalty": "NormalLaw",
    "stage": "Outcome",
    "stages.inputs": "load_law load_stiffness load_surface",
    "stages.rig": "simulate_campaign simulate_rig",
    "stages.steps": "build_surface compare compare_drive cross_validate fit_friction fit_slip "
    "fit_stiffness plan_runs read_press read_rig read_speedloss refine_surface simulate_drive",
}
_HOMES = {name: module for module, names in _PUBLIC.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
