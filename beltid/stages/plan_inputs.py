"""Inputs of a plan: possible settings of the rig, the known surface, noise of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from beltid.config import Config
from beltid.errors import ArgumentTypeError, InputError
from beltid.laws.penalty import NormalLaw
from beltid.plan.candidates import NoiseLaw, Settings, noise_law
from beltid.plan.knowledge import KnownSurface, sources_of_plan
from beltid.stage import Outcome
from beltid.stages.columns import ok_rows
from beltid.stages.inputs import press_law, shown, surface_of
from beltid.stages.planned_runs import KEYS, measured_settings, setting_lists
from beltid.stages.reduction import rig_kind
from beltid.stages.uncertainties import standard_uncertainties
from beltid.store.artifact import Artifact
from beltid.uncertainty.measured import measured_runs, valid_rows
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.sources import Source, sources_of

USUAL_LAW: Final = NormalLaw(6.5e7, 3.0256e11)
"""Contact law of the paper's 5PK belt, Eq. (3), for a plan before any measurement."""
MOST_SETTINGS: Final = 12  # arcs, tensions or speeds of the candidates of a plan


def rig_settings(
    config: Config, friction: Mapping[str, np.ndarray] | None
) -> tuple[Settings, tuple[str, ...]]:
    """Return the possible settings of the rig, and a note on those that are assumed.

    Each list is that of the section plan, else that stated under rig, else that of the runs, else
    the built-in one.
    """
    plan = config.plan
    measured = None
    if friction is not None and all(name in friction for name in KEYS):
        run_settings = measured_settings(friction, config)
        measured = run_settings if run_settings.size else None
    stated = plan.arcs_deg, plan.tension_N, plan.speed_rad_s
    fallbacks = [_thinned(values) for values in setting_lists(config, measured)]
    assumed = [
        f"{key}: {', '.join(f'{value:g}' for value in values)}"
        for (key, _), planned, values in zip(KEYS.values(), stated, fallbacks, strict=True)
        if not planned and measured is None and key not in config.rig.model_fields_set
    ]
    notes = (f"the possible settings of the rig are not stated, assumed: {'; '.join(assumed)}",)
    arcs, tensions, speeds = (
        tuple(planned or values) for planned, values in zip(stated, fallbacks, strict=True)
    )
    return Settings(arcs, tensions, speeds), notes if assumed else ()


def _thinned(values: Sequence[float]) -> list[float]:
    """Thin a long list of settings, as when each run has its own value; keep both ends."""
    ordered = sorted(values)
    indices = np.linspace(0, len(ordered) - 1, min(len(ordered), MOST_SETTINGS)).round().astype(int)
    return [ordered[k] for k in indices]


@dataclass(frozen=True, slots=True)
class Present:
    """Knowledge before the next runs.

    Attributes
    ----------
    surface : KnownSurface or None
        The surface; None before any run.
    arcs_deg : tuple of float
        Its arc settings [deg].
    sources : tuple of Source
        The shared errors of its changes.
    press : PressLaw
        The contact law.
    noise : NoiseLaw
        Noise of a run.
    columns : dict of str to float
        Change of ln mu of a run by each error of the reduction.
    notes : tuple of str
        Assumptions.
    """

    surface: KnownSurface | None
    arcs_deg: tuple[float, ...]
    sources: tuple[Source, ...]
    press: PressLaw
    noise: NoiseLaw
    columns: dict[str, float]
    notes: tuple[str, ...]


def present_knowledge(
    known: KnownSurface | None,
    press: PressLaw | None,
    friction: Mapping[str, np.ndarray] | None,
    settings: Settings,
    config: Config,
) -> Present:
    """Combine what is known, None before any measurement, with usual values for the rest."""
    notes: list[str] = []
    if press is None:
        press = press_law(USUAL_LAW, config)
        notes.append("no data: contact law of the paper's 5PK belt")
    stated = standard_uncertainties(config)
    sources = sources_of_plan(known, stated, settings.arcs_deg, press.has_scatter)
    if known is None:
        notes.append("no data: mu from 0.7 to 1.5 with usual slopes over force and speed")
    elif other := known.stated_otherwise(stated, press.has_scatter):
        notes.append(
            f"stated differently when the surface was made: {', '.join(other)}; the earlier values "
            "are used"
        )
    scale = 1.0 if known is None else known.noise_scale
    noise, columns = NoiseLaw(scale=scale), {}
    if friction is not None:
        ok = valid_rows(friction, np.flatnonzero(ok_rows(friction)))
        rig = config.rig_params()
        runs = measured_runs(friction, ok, rig.R, rig_kind(config), rig.given_force)
        noise = noise_law(runs, scale)
        columns = {key: float(np.mean(change)) for key, change in runs.columns.items()}
    else:
        notes.append(
            f"noise of a run: {100.0 * noise.friction:g} % of mu and {noise.tension:g} N of the "
            "tensions; --from friction.parquet uses that of its runs"
        )
    arcs = () if known is None else tuple(known.arcs_deg)
    return Present(known, arcs, sources, press, noise, columns, tuple(notes))


def known_surface(surface: Any) -> KnownSurface:
    """Return the known surface of an artifact or a result."""
    if not isinstance(surface, (Artifact, Outcome)) or surface.kind != "surface":
        raise ArgumentTypeError(
            f"surface = {shown(surface)}, must be the result of refine_surface or build_surface: "
            "the plan needs its covariance by source"
        )
    found, stored = surface_of(surface), surface.facts.get("uncertainty")
    if found.factor is None or stored is None:
        name = getattr(surface, "path", "surface")
        raise InputError(f"{name}: has no covariance; build it again")
    sources = sources_of(stored["sources"])
    return KnownSurface(
        surface=found,
        sources=sources,
        changes=found.factor[..., : len(sources)],
        scatter=found.factor[..., len(sources) :],
        arcs_deg=np.asarray(stored["arcs_deg"], dtype=float),
        noise_scale=surface.facts.get("noise_over_stated_errors") or 1.0,
    )
