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

from beltid.identify.agreement import AgreementResult
from beltid.uncertainty.budget import Scatter, budget
from beltid.uncertainty.measured import own_errors, shared_columns
from beltid.uncertainty.simulated import RunsUncertainty
from beltid.uncertainty.sources import Source, reduction_sources

Array = NDArray[np.float64]

WITHIN: Final = 2.0
"""Standard uncertainties within which a difference says nothing about the model [-]."""
SHOWN: Final = 3  # contributions that are named


@dataclass(frozen=True, slots=True)
class Validation:
    """Relative standard uncertainties of compared runs, arrays (n,)."""

    measured: Array  # of the measured coefficient: shared errors and scatter
    measured_scatter: Array  # of the measured coefficient: scatter only
    simulated_scatter: Array  # of the simulated coefficient by scatter
    numerical: Array  # of the simulated coefficient by mesh and time steps
    settings: Array  # change of the coefficient by the settings that the bench missed
    simulated: Array  # changes of the simulated coefficient by each shared source, (n, K)
    difference: Array  # changes of the difference by each shared source, (n, K)
    sources: tuple[Source, ...] = ()  # shared errors
    inputs_known: bool = False  # whether the uncertainty of the simulated runs is known

    @property
    def u_input(self) -> Array:
        """Standard uncertainty of the simulated coefficient by its inputs (n,)."""
        own = np.column_stack([self.simulated, self.simulated_scatter, self.settings])
        return np.asarray(np.linalg.norm(own, axis=1))

    @property
    def u_validation(self) -> Array:
        """Standard uncertainty of the difference (n,)."""
        own = (self.measured_scatter, self.simulated_scatter, self.numerical, self.settings)
        return np.asarray(np.linalg.norm(np.column_stack([self.difference, *own]), axis=1))

    def columns(self, result: AgreementResult) -> dict[str, Array]:
        """Return columns of the comparison table: absolute uncertainties of mu [-]."""
        mu = result.mu_measured
        known = mu * (1.0 if self.inputs_known else np.nan)
        return {
            "u_measured": self.measured * mu,
            "u_input": self.u_input * known,
            "u_numerical": self.numerical * known,
            "u_validation": self.u_validation * mu,
            "e_over_u": result.error_over_uncertainty,
        }

    def budget(self) -> list[dict[str, Any]]:
        """Return the rows of the budget of the difference."""
        return budget(
            "difference",
            self.sources,
            self.difference,
            Scatter("scatter of the measured runs", self.measured_scatter),
            Scatter("scatter behind the simulated runs", self.simulated_scatter),
            Scatter("mesh and time steps of the simulation", self.numerical),
            Scatter("settings that the bench missed", self.settings),
        )

    def facts(self, result: AgreementResult) -> dict[str, Any]:
        """Return how many differences are within their uncertainty, and their ratio."""
        ratio = np.abs(result.error_over_uncertainty)
        rms = result.rms_error_over_uncertainty
        return {
            "n": int(ratio.size),
            "within_2u": int(np.count_nonzero(ratio <= WITHIN)),
            "rms_e_over_u": rms if np.isfinite(rms) else None,
            "inputs_known": self.inputs_known,
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
) -> tuple[AgreementResult, Validation]:
    """Compute the uncertainties of the differences of a comparison.

    Parameters
    ----------
    result : AgreementResult
        The comparison.
    measured, simulated : mapping of str to ndarray
        Tables of reduced runs, measured and simulated.
    uncertainty : RunsUncertainty or None
        Uncertainty of the simulated runs; None if unknown.

    Returns
    -------
    result, validation
        The comparison with ``u_validation``, and its parts.
    """
    of_measured, of_simulated = result.rows
    mu = result.mu_measured

    def column(table: Mapping[str, np.ndarray], name: str, rows: np.ndarray) -> Array:
        """Return the values of a column; zero where they are missing."""
        return np.nan_to_num(np.asarray(table[name], float)[rows]) if name in table else 0.0 * mu

    scatter = column(measured, "mu_sliding_se", of_measured) / mu
    combined = column(measured, "mu_sliding_u", of_measured) / mu
    whole, none = np.where(combined > 0.0, combined, scatter), np.zeros(mu.size)
    labels = [str(simulated["run"][i]) for i in of_simulated]
    if uncertainty is None or not set(labels) <= set(uncertainty.runs):
        of_simulation = column(simulated, "mu_sliding_se", of_simulated) / mu
        empty = np.zeros((mu.size, 0))
        parts = Validation(whole, whole, of_simulation, none, none, empty, empty)
        return replace(result, u_validation=parts.u_validation), parts

    def missed(name: str, stated: str) -> Array:
        """Return ln of the actual over the simulated setting; zero if one is unknown."""
        actual = np.abs(column(measured, name, of_measured))
        nominal = np.abs(column(simulated, stated, of_simulated))
        known = (actual > 0.0) & (nominal > 0.0)
        return np.log(np.where(known, actual, 1.0) / np.where(known, nominal, 1.0))

    rows = [uncertainty.runs.index(label) for label in labels]
    settings = [
        missed("initial_tension_N", "nominal_tension_N"),
        missed("pulley_speed_rad_s", "pulley_speed_rad_s"),
    ]
    by_setting = np.sum(uncertainty.by_setting[rows] * np.column_stack(settings), axis=1)
    # if the surface was built from these runs, an error of their reduction changes both
    shared = {key: values[of_measured] for key, values in shared_columns(measured).items()}
    present = {source.error for source in uncertainty.sources}
    added = tuple(source for source in reduction_sources(shared) if source.error not in present)
    sources, more = (*uncertainty.sources, *added), np.zeros((mu.size, len(added)))
    of_runs = np.zeros((mu.size, len(sources)))
    for k, source in enumerate(sources):
        of_runs[:, k] = shared.get(source.error, 0.0)
    own = own_errors(measured)
    parts = Validation(
        measured=whole,
        measured_scatter=scatter if own is None else np.nan_to_num(own[of_measured]) / mu,
        simulated_scatter=uncertainty.scatter[rows],
        numerical=uncertainty.numerical[rows],
        settings=np.abs(by_setting),
        simulated=np.hstack([uncertainty.simulated[rows], more]),
        difference=np.hstack([uncertainty.difference[rows], more]) - of_runs,
        sources=sources,
        inputs_known=True,
    )
    return replace(result, u_validation=parts.u_validation), parts


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
