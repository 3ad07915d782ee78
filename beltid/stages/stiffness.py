"""From the recording of the press to the normal contact law, Eqs. (1) to (4)."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from beltid.bench.recording import Recording
from beltid.config import Config
from beltid.errors import BeltidError
from beltid.identify.press.dissipation import estimate_dissipation
from beltid.identify.press.recording import StiffnessSettings
from beltid.identify.press.stiffness import LawEstimate, StiffnessResult, fit_stiffness
from beltid.stage import Outcome
from beltid.stages.uncertainties import standard_uncertainties
from beltid.uncertainty.reduced import stiffness_uncertainty

COLUMNS: Final = (
    *("k_linear_N_m2", "k_quadratic_N_m3", "k_linear_se_N_m2", "k_quadratic_se_N_m3"),
    *("covariance", "contact_offset_mm", "rms_residual_N_m", "hysteresis_ratio"),
    *("max_penetration_m", "max_force_N_m", "n_samples", "n_cycles"),
)


def fitted(press: Recording, config: Config) -> Outcome[StiffnessResult]:
    """Fit the law at every temperature and the pooled one."""
    settings = StiffnessSettings(**config.press.si())
    result = fit_stiffness(press.columns, settings)
    pooled, laws = result.pooled, (*result.laws, result.pooled)
    combined, budget = stiffness_uncertainty(
        laws, standard_uncertainties(config), settings.segment_length_m
    )
    damping, notes = _damping(result)
    columns = {**_columns(laws), **combined}
    coefficients = [f"k_{name}" for name in ("linear{}_N_m2", "quadratic{}_N_m3")]
    return Outcome(
        columns,
        result,
        facts={
            **{
                name: float(columns[name][-1])
                for of in coefficients
                for name in (of.format(""), of.format("_se"), of.format("_u"))
            },
            "temperature_matters": result.temperature.matters,
            "quadratic_law_supported": result.quadratic_supported,
            "damping_at_press_speed_N_s_m": damping,
            "n_effective": pooled.n_effective,
            "n_missing": result.recording.n_missing,
            "n_spikes": result.recording.n_spikes,
        },
        tables={"budget": budget},
        validity={
            "penetration_m": (0.0, pooled.max_penetration_m),
            "force_N_m": (0.0, pooled.max_force_N_m),
        },
        set_aside=[{"test": test, "why": why} for test, why in result.recording.set_aside],
        notes=(*result.notes, *notes),
        warnings=(
            *(f"test {test} set aside: {why}" for test, why in result.recording.set_aside),
            *pooled.warnings,
        ),
    )


def _columns(laws: tuple[LawEstimate, ...]) -> dict[str, np.ndarray]:
    temperatures = [np.nan if w.temperature_degC is None else w.temperature_degC for w in laws]
    notes = ["; ".join((*law.notes, *law.warnings)) or None for law in laws]
    return {
        "temperature_degC": np.array(temperatures, dtype=float),
        **{name: np.array([getattr(law, name) for law in laws]) for name in COLUMNS},
        "notes": np.array(notes, dtype=object),
    }


def _damping(result: StiffnessResult) -> tuple[float | None, list[str]]:
    """Return the damping at the speed of the press [N s/m], None if not known, and a note."""
    try:
        loss = estimate_dissipation(result.recording.curves)
    except BeltidError as error:
        return None, [f"No estimate of the dissipation: {error}"]
    return loss.C_P_N_s_m, [loss.statement]


def coefficients(parameters: Any) -> str:
    """Format coefficients with their errors for one cell; an unknown error is "?"."""
    texts = []
    for p in parameters:
        unit = f" {p.unit}" if p.unit not in ("", "-") else ""
        error = f"{p.se:.2g}" if p.se is not None and np.isfinite(p.se) else "?"
        texts.append(f"{p.name} = {p.value:.5g} ± {error}{unit}")
    return ", ".join(texts)
