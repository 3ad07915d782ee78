"""Alternatives to the laws of an artifact: other normal laws, and friction as a formula."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from beltid.config import Config
from beltid.errors import BeltidError
from beltid.identify.press.dissipation import estimate_dissipation
from beltid.identify.press.stiffness import StiffnessResult
from beltid.identify.surface.curves import SPEED_GAP
from beltid.identify.surface.laws import FrictionLaws, fit_friction_laws
from beltid.identify.surface.plateau_laws import fit_plateau_laws
from beltid.laws.friction_surface import FrictionSurface
from beltid.stages.outcome import in_percent
from beltid.uncertainty.measured import Measured


@dataclass(frozen=True, slots=True)
class Alternatives:
    """Comparison with other laws.

    Attributes
    ----------
    extra : dict
        Figures for the artifact.
    notes, warnings : tuple of str
        The verdict, and anything that contradicts it, for the user.
    """

    extra: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def normal_laws(result: StiffnessResult) -> Alternatives:
    """Tell whether the quadratic law is supported, and estimate the dissipation.

    A failure does not stop the stage but becomes a note.
    """
    extra: dict[str, Any] = {"law_choice": {"quadratic_supported": result.quadratic_supported}}
    notes: list[str] = []
    try:
        loss = estimate_dissipation(result.recording.curves)
        extra["dissipation"] = asdict(loss)
        notes.append(loss.statement)
    except BeltidError as error:
        notes.append(f"No estimate of the dissipation: {error}")
    return Alternatives(extra, tuple(notes))


def friction_formulas(surface: FrictionSurface, factor: np.ndarray) -> Alternatives:
    """Fit the parametric friction laws to the nodes of a surface; a failure becomes a note.

    Parameters
    ----------
    surface : FrictionSurface
        The surface.
    factor : ndarray, shape (nf, nv, r)
        Factor of the covariance of ln mu at the nodes (``mu_factor``).
    """
    force, speed = np.meshgrid(surface.normal_force_N_m, surface.slip_speed_m_s, indexing="ij")
    try:
        laws = fit_friction_laws(
            force.ravel(),
            speed.ravel(),
            surface.mu_nodes.ravel(),
            factor.reshape(force.size, -1),
        )
    except BeltidError as error:
        return Alternatives(notes=(f"No friction formula for the surface: {error}",))
    best = [note for note in laws.fit(laws.best).notes if note]
    return Alternatives({"friction_laws": _record(laws)}, (laws.verdict, *best, *laws.notes))


def forces_of_plateaus(measured: Measured, config: Config) -> Alternatives:
    """Fit friction laws to the single readings of a dead-weight rig; otherwise return nothing.

    A recording over time shows its scatter, with which the surface is built. A stated resolution
    means that there are single readings only. The laws apply to a single sliding speed.

    Parameters
    ----------
    measured : Measured
        The reduced runs.
    config : Config
        Kind of the rig, the span with the weight, the resolution of the cell.
    """
    rig = config.rig
    speed = measured.slip_speed
    one_speed = float(speed.max()) <= (1.0 + SPEED_GAP) * float(speed.min())
    if rig.kind != "dead_weight" or rig.force_resolution_N is None or not one_speed:
        return Alternatives()
    try:
        laws = fit_plateau_laws(
            np.degrees(measured.beta),
            measured.tight,
            measured.slack,
            measured.R,
            weight_on=rig.weight_on,
            resolution_N=rig.force_resolution_N,
        )
    except BeltidError as error:
        return Alternatives(notes=(f"No friction law through the forces: {error}",))
    return Alternatives(notes=(laws.verdict,), warnings=laws.warnings)


def _record(laws: FrictionLaws) -> dict[str, Any]:
    """Return the fits as plain values."""
    shown = "law", "rms_misfit", "worst_misfit", "criterion"
    rows = [
        {name: getattr(fit, name) for name in shown}
        | {"parameters": [asdict(p) for p in fit.parameters], "formula": fit.formula.text}
        for fit in laws.fits
    ]
    return {"laws": rows, "best": laws.best, "verdict": laws.verdict}


def friction_law_rows(extra: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the formulas of an artifact with a row per law; empty for an older artifact."""
    stored = extra.get("friction_laws") or {"laws": ()}
    return [
        {
            "law": law["law"],
            "parameters": _coefficients(law["parameters"]),
            "rms_misfit_percent": in_percent(law["rms_misfit"]),
            "worst_misfit_percent": in_percent(law["worst_misfit"]),
            "criterion": law["criterion"],
            "formula": law["formula"],
        }
        for law in stored["laws"]
    ]


def _coefficients(parameters: list[dict[str, Any]]) -> str:
    """Format coefficients with their errors for one cell; an unknown error is "?"."""
    texts = []
    for p in parameters:
        unit = f" {p['unit']}" if p["unit"] not in ("", "-") else ""
        se = p["se"]
        error = f"{se:.2g}" if se is not None and np.isfinite(se) else "?"
        texts.append(f"{p['name']} = {p['value']:.5g} ± {error}{unit}")
    return ", ".join(texts)
