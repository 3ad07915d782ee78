"""From the recording of the press to the normal contact law, Eqs. (1) to (4)."""

from __future__ import annotations

from typing import Final

import numpy as np

from beltid.bench.recording import Recording
from beltid.config import Config
from beltid.identify.press.recording import StiffnessSettings
from beltid.identify.press.stiffness import StiffnessResult, fit_stiffness
from beltid.stage import Outcome
from beltid.stages.inputs import standard_uncertainties
from beltid.uncertainty.measured import stiffness_uncertainty

COLUMNS: Final = (
    *("k_linear_N_m2", "k_quadratic_N_m3", "k_linear_se_N_m2", "k_quadratic_se_N_m3"),
    *("covariance", "contact_offset_mm", "rms_residual_N_m", "hysteresis_ratio"),
    *("max_penetration_m", "max_force_N_m", "n_samples", "n_cycles"),
)
COEFFICIENTS: Final = (
    *("k_linear_N_m2", "k_linear_se_N_m2", "k_linear_u_N_m2"),
    *("k_quadratic_N_m3", "k_quadratic_se_N_m3", "k_quadratic_u_N_m3"),
)


def fitted(press: Recording, config: Config) -> Outcome[StiffnessResult]:
    """Fit the law at every temperature and the pooled one."""
    settings = StiffnessSettings(**config.press.si())
    result = fit_stiffness(press.columns, settings)
    pooled, laws, recording = result.pooled, (*result.laws, result.pooled), result.recording
    combined, budget = stiffness_uncertainty(
        laws, standard_uncertainties(config), settings.segment_length_m
    )
    temperatures = [np.nan if w.temperature_degC is None else w.temperature_degC for w in laws]
    notes = ["; ".join((*law.notes, *law.warnings)) or None for law in laws]
    columns = {
        "temperature_degC": np.array(temperatures, dtype=float),
        **{name: np.array([getattr(law, name) for law in laws]) for name in COLUMNS},
        "notes": np.array(notes, dtype=object),
        **combined,
    }
    return Outcome(
        columns,
        result,
        facts={
            **{name: float(columns[name][-1]) for name in COEFFICIENTS},
            "temperature_matters": result.temperature_matters,
            "quadratic_law_supported": result.quadratic_supported,
            "n_effective": pooled.n_effective,
            "n_missing": recording.n_missing,
            "n_spikes": recording.n_spikes,
        },
        tables={"budget": budget},
        validity={
            "penetration_m": (0.0, pooled.max_penetration_m),
            "force_N_m": (0.0, pooled.max_force_N_m),
        },
        set_aside=[{"test": test, "why": why} for test, why in recording.set_aside],
        notes=result.notes,
        warnings=(
            *(f"test {test} set aside: {why}" for test, why in recording.set_aside),
            *pooled.warnings,
        ),
    )
