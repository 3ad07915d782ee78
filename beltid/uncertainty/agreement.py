"""Simulated minus measured coefficients over their standard uncertainty (ASME V&V 20).

The comparison error E = S - D of simulation and experiment contains the errors of the model, of its
inputs, of its numerics and of the data. It says something about the model only beyond

    u_val² = u_num² + u_input² + u_D²

(ASME V&V 20-2009, Eq. 1-5-9). If inputs and data share errors, their squares must not be added
separately; each shared error enters with its total change of E (section 5-3 there), as done here.
The scatter behind the surface is added as if it were independent of the scatter of the run. If the
surface was built from the same runs, this is conservative by the few percent that one run weighs in
it. If the bench missed a setting and the simulation used the nominal one, that is a known error
without correction: it counts in full.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from beltid.identify.agreement.compare import AgreementResult
from beltid.uncertainty.budget import Scatter, budget
from beltid.uncertainty.measured import own_errors, shared_columns
from beltid.uncertainty.simulated import RunsUncertainty
from beltid.uncertainty.sources import Source, reduction_sources

Array = NDArray[np.float64]

WITHIN = 2.0
"""Standard uncertainties within which a difference says nothing about the model [-]."""


@dataclass(frozen=True, slots=True)
class Validation:
    """Relative standard uncertainties of compared runs, arrays (n,).

    Attributes
    ----------
    measured : ndarray
        Of the measured coefficient: shared errors and scatter.
    measured_scatter : ndarray
        Of the measured coefficient: scatter only.
    simulated_scatter : ndarray
        Of the simulated coefficient by scatter.
    numerical : ndarray
        Of the simulated coefficient by mesh and time steps.
    settings : ndarray
        Change of the coefficient by the settings that the bench missed.
    simulated : ndarray, shape (n, K)
        Changes of the simulated coefficient by each shared source.
    difference : ndarray, shape (n, K)
        Changes of the difference by each shared source.
    """

    measured: Array
    measured_scatter: Array
    simulated_scatter: Array
    numerical: Array
    settings: Array
    simulated: Array
    difference: Array

    @property
    def u_input(self) -> Array:
        """Standard uncertainty of the simulated coefficient by its inputs (n,)."""
        shared = np.sum(np.square(self.simulated), axis=1)
        own = np.square(self.simulated_scatter) + np.square(self.settings)
        return np.asarray(np.sqrt(shared + own))

    @property
    def u_validation(self) -> Array:
        """Standard uncertainty of the difference (n,)."""
        parts = (self.measured_scatter, self.simulated_scatter, self.numerical, self.settings)
        total = np.sum(np.square(self.difference), axis=1)
        return np.asarray(np.sqrt(total + sum(np.square(part) for part in parts)))


QUANTITY: Final = "difference"
SHOWN: Final = 3


@dataclass(frozen=True, slots=True)
class Validated:
    """A comparison with the uncertainty of its differences.

    Attributes
    ----------
    result : AgreementResult
        The comparison, with ``u_validation``.
    validation : Validation
        The parts of ``u_validation``.
    sources : tuple of Source
        Shared errors.
    inputs_known : bool
        Whether the uncertainty of the simulated runs is known.
    """

    result: AgreementResult
    validation: Validation
    sources: tuple[Source, ...]
    inputs_known: bool

    def columns(self) -> dict[str, np.ndarray]:
        """Return columns of the comparison table: absolute uncertainties of mu [-]."""
        mu = self.result.mu_measured
        parts = self.validation
        one_or_nan = np.where(self.inputs_known, 1.0, np.nan)
        return {
            "u_measured": parts.measured * mu,
            "u_input": parts.u_input * mu * one_or_nan,
            "u_numerical": parts.numerical * mu * one_or_nan,
            "u_validation": parts.u_validation * mu,
            "e_over_u": self.result.error_over_uncertainty,
        }

    def extra(self) -> dict[str, Any]:
        """Return budget and summary for the metadata of the artifact."""
        parts = self.validation
        rows = budget(
            QUANTITY,
            self.sources,
            parts.difference,
            Scatter("scatter of the measured runs", parts.measured_scatter),
            Scatter("scatter behind the simulated runs", parts.simulated_scatter),
            Scatter("mesh and time steps of the simulation", parts.numerical),
            Scatter("settings that the bench missed", parts.settings),
        )
        ratio = np.abs(self.result.error_over_uncertainty)
        rms = self.result.rms_error_over_uncertainty
        return {
            "budget": rows,
            "validation": {
                "n": int(ratio.size),
                "within_2u": int(np.count_nonzero(ratio <= WITHIN)),
                "rms_e_over_u": rms if np.isfinite(rms) else None,
                "inputs_known": self.inputs_known,
            },
        }

    def notes(self) -> tuple[str, ...]:
        """Return notes for the reader."""
        if self.inputs_known:
            return ()
        return (
            "the uncertainty of the simulated runs is not known (no artifact of simulate-rig that "
            "contains it): u_validation holds only that of the measured runs, and the scatter",
        )


def validated(
    result: AgreementResult,
    measured: Mapping[str, np.ndarray],
    simulated: Mapping[str, np.ndarray],
    uncertainty: RunsUncertainty | None,
) -> Validated:
    """Compute the uncertainties of the differences of a comparison.

    Parameters
    ----------
    result : AgreementResult
        The comparison.
    measured, simulated : mapping of str to ndarray
        Tables of reduced runs, measured and simulated.
    uncertainty : RunsUncertainty or None
        Uncertainty of the simulated runs; None if unknown.
    """
    of_measured, of_simulated = result.rows
    mu = result.mu_measured
    scatter = _column(measured, "mu_sliding_se", of_measured) / mu
    combined = _column(measured, "mu_sliding_u", of_measured) / mu
    whole, none = np.where(combined > 0.0, combined, scatter), np.zeros(mu.size)
    sources: tuple[Source, ...] = ()
    parts = Validation(
        measured=whole,
        measured_scatter=whole,
        simulated_scatter=_column(simulated, "mu_sliding_se", of_simulated) / mu,
        numerical=none,
        settings=none,
        simulated=np.zeros((mu.size, 0)),
        difference=np.zeros((mu.size, 0)),
    )
    rows = _rows_of(uncertainty, simulated, of_simulated)
    if uncertainty is not None and rows is not None:
        own = own_errors(measured)
        missed = _missed_settings(result, measured, simulated)
        parts = Validation(
            measured=whole,
            measured_scatter=scatter if own is None else _finite_or_zero(own[of_measured]) / mu,
            simulated_scatter=uncertainty.scatter[rows],
            numerical=uncertainty.numerical[rows],
            settings=np.abs(np.sum(uncertainty.by_setting[rows] * missed, axis=1)),
            simulated=uncertainty.simulated[rows],
            difference=uncertainty.difference[rows],
        )
        shared = {key: values[of_measured] for key, values in shared_columns(measured).items()}
        sources, parts = _with_reduction(uncertainty.sources, parts, shared)
    result = replace(result, u_validation=parts.u_validation)
    return Validated(result, parts, sources, inputs_known=rows is not None)


def _missed_settings(
    result: AgreementResult, measured: Mapping[str, np.ndarray], simulated: Mapping[str, np.ndarray]
) -> Array:
    """Return ln of initial tension and speed, measured over simulated (n, 2)."""
    of_measured, of_simulated = result.rows
    tensions = (
        _column(measured, "initial_tension_N", of_measured),
        _column(simulated, "nominal_tension_N", of_simulated),
    )
    simulated_speed = np.abs(_column(simulated, "pulley_speed_rad_s", of_simulated))
    speeds = np.abs(result.pulley_speed_rad_s), simulated_speed
    return np.column_stack([_log_ratio(*tensions), _log_ratio(*speeds)])


def _with_reduction(
    sources: tuple[Source, ...], parts: Validation, shared: Mapping[str, np.ndarray]
) -> tuple[tuple[Source, ...], Validation]:
    """Add the errors that the reduction of the measured runs shares to sources and differences.

    If the surface was built from these runs, the change of both by one error is subtracted.
    """
    present = {source.error for source in sources}
    added = tuple(source for source in reduction_sources(shared) if source.error not in present)
    sources, none = (*sources, *added), np.zeros((len(parts.measured), len(added)))
    difference = np.hstack([parts.difference, none])
    for k, source in enumerate(sources):
        if source.error in shared:
            difference[:, k] -= shared[source.error]
    simulated = np.hstack([parts.simulated, none])
    return sources, replace(parts, simulated=simulated, difference=difference)


def _rows_of(
    uncertainty: RunsUncertainty | None,
    simulated: Mapping[str, np.ndarray],
    of_simulated: np.ndarray,
) -> list[int] | None:
    """Return the row of each matched run in `uncertainty`; None if a run is missing there."""
    if uncertainty is None:
        return None
    places = {label: k for k, label in enumerate(uncertainty.runs)}
    rows = [places.get(str(simulated["run"][i])) for i in of_simulated]
    return None if None in rows else [row for row in rows if row is not None]


def _column(columns: Mapping[str, np.ndarray], name: str, rows: np.ndarray) -> np.ndarray:
    """Return the values of a column; zero where they are missing."""
    if name not in columns:
        return np.zeros(rows.size)
    return _finite_or_zero(np.asarray(columns[name], dtype=float)[rows])


def _finite_or_zero(values: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(values), values, 0.0)


def _log_ratio(actual: np.ndarray, nominal: np.ndarray) -> np.ndarray:
    """Return the logarithm of actual over nominal settings (n,); zero if one is unknown."""
    known = (actual > 0.0) & (nominal > 0.0)
    return np.log(np.where(known, actual, 1.0) / np.where(known, nominal, 1.0))


def within_words(validation: Mapping[str, Any]) -> str:
    """Return the number of runs whose difference is within its uncertainty, in words."""
    return f"{validation['within_2u']} of {validation['n']} runs"


def dominant(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the largest contributions, in words."""
    parts = [
        row
        for row in rows
        if row["source"] != "combined" and (row["contribution_percent"] or 0.0) > 0.0
    ]
    parts.sort(key=lambda row: -row["contribution_percent"])
    return ", ".join(
        f"{row['source']} {row['contribution_percent']:.2g} %" for row in parts[:SHOWN]
    )
