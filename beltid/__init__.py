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
"""

from typing import TYPE_CHECKING, Any

from beltid._version import __version__ as __version__

if TYPE_CHECKING:
    from beltid.config import Config as Config, load_config as load_config
    from beltid.errors import (
        ArtifactError as ArtifactError,
        BeltidError as BeltidError,
        BeltidWarning as BeltidWarning,
        ConfigError as ConfigError,
        InputError as InputError,
        NumericsError as NumericsError,
    )
    from beltid.export.law import ContactLaw as ContactLaw
    from beltid.laws.friction_surface import FrictionSurface as FrictionSurface
    from beltid.laws.penalty import NormalLaw as NormalLaw
    from beltid.stage import Outcome as Outcome
    from beltid.stages.inputs import (
        load_law as load_law,
        load_stiffness as load_stiffness,
        load_surface as load_surface,
    )
    from beltid.stages.rig import (
        simulate_campaign as simulate_campaign,
        simulate_rig as simulate_rig,
    )
    from beltid.stages.steps import (
        build_surface as build_surface,
        compare as compare,
        compare_drive as compare_drive,
        cross_validate as cross_validate,
        fit_friction as fit_friction,
        fit_slip as fit_slip,
        fit_stiffness as fit_stiffness,
        plan_runs as plan_runs,
        read_press as read_press,
        read_rig as read_rig,
        read_speedloss as read_speedloss,
        refine_surface as refine_surface,
        simulate_drive as simulate_drive,
    )

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
__all__ = sorted(["__version__", *_HOMES])


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
