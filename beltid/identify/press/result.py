"""What the evaluation of a press recording is told and what it answers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import get_args

from beltid.errors import InputError
from beltid.identify.press.curves import Branch
from beltid.identify.press.cycles import CycleChoice
from beltid.identify.press.temperature import TemperatureEffect
from beltid.laws.penalty import NormalLaw


@dataclass(frozen=True, slots=True)
class StiffnessSettings:
    """How a press recording is evaluated.

    Parameters
    ----------
    segment_length_m : float
        Length of the belt segment under the press, 1 mm to 1 m [m].
    reference_temperature_degC : float
        Temperature of the pooled law if temperature matters [°C].
    machine_compliance_m_N : float
        Yield of the press itself per force, contained in the crosshead travel [m/N].
    force_gain, displacement_gain : float
        True force over reading, and true travel over reading [-]; the zero of the force is found
        in the travel before contact.
    cycles : {"last", "first", "all"}
        Which cycles of a test to use; the first is that of virgin rubber.
    """

    segment_length_m: float
    reference_temperature_degC: float = 22.0
    machine_compliance_m_N: float = 0.0
    force_gain: float = 1.0
    displacement_gain: float = 1.0
    cycles: CycleChoice = "last"

    def __post_init__(self) -> None:
        checks = (
            ("segment_length_m", 1e-3 <= self.segment_length_m <= 1.0, "in [0.001, 1] m"),
            ("reference_temperature_degC", self.reference_temperature_degC > -273.15, "> -273 °C"),
            (
                "machine_compliance_m_N",
                0.0 <= self.machine_compliance_m_N <= 1e-5,
                "in [0, 1e-05] m/N",
            ),
            ("force_gain", 0.1 <= self.force_gain <= 10.0, "in [0.1, 10]"),
            ("displacement_gain", 0.1 <= self.displacement_gain <= 10.0, "in [0.1, 10]"),
        )
        problems = [
            f"press.{name} = {getattr(self, name)!r}, must be {allowed}"
            for name, ok, allowed in checks
            if not (ok and math.isfinite(getattr(self, name)))
        ]
        if self.cycles not in get_args(CycleChoice):
            problems.append(f"press.cycles = {self.cycles!r}, must be last, first or all")
        if problems:
            raise InputError(problems)


@dataclass(frozen=True, slots=True)
class LawEstimate:
    """A normal law with its doubt: one row of the stiffness table.

    Attributes
    ----------
    temperature_degC : float or None
        Mean temperature of the tests [°C], None for the pooled law.
    k_linear_N_m2, k_quadratic_N_m3 : float
        Coefficients of Eq. (3) per metre of belt [N/m²], [N/m³].
    k_linear_se_N_m2, k_quadratic_se_N_m3 : float
        Their standard errors.
    covariance : tuple of float
        Covariance matrix of the two, row by row.
    contact_offset_mm : float
        Crosshead travel at the contact point, mean over the tests [mm].
    rms_residual_N_m : float
        Root mean square of measured force less law, both branches alike [N/m]; mostly hysteresis.
    hysteresis_ratio : float
        Work lost in the loop over the work of the loading branch [-]; nan if never unloaded.
    max_penetration_m, max_force_N_m : float
        Largest penetration [m] and line force [N/m] reached: the range of validity.
    n_samples : int
        Samples within the range of the fit.
    n_effective : float
        Independent nodes that the standard errors rest on.
    n_cycles : int
        Cycles used.
    tests : tuple of str
        Labels of the tests used.
    notes : tuple of str
        What there is to say about this law.
    """

    temperature_degC: float | None
    k_linear_N_m2: float
    k_quadratic_N_m3: float
    k_linear_se_N_m2: float
    k_quadratic_se_N_m3: float
    covariance: tuple[float, float, float, float]
    contact_offset_mm: float
    rms_residual_N_m: float
    hysteresis_ratio: float
    max_penetration_m: float
    max_force_N_m: float
    n_samples: int
    n_effective: float
    n_cycles: int
    tests: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def law(self) -> NormalLaw:
        """The law itself."""
        return NormalLaw(self.k_linear_N_m2, self.k_quadratic_N_m3)


@dataclass(frozen=True, slots=True)
class StiffnessResult:
    """Everything that a press recording tells.

    Attributes
    ----------
    laws : tuple of LawEstimate
        One law per known temperature, rising; empty if no temperature is known.
    pooled : LawEstimate
        The law at the reference temperature: of all tests if temperature does not matter, else
        of the tests nearest to the reference.
    temperature : TemperatureEffect
        F test of one law against one per temperature.
    branches : tuple of Branch
        Branches over the penetration, thinned for figures.
    set_aside : tuple of (str, str)
        Tests that were not used, with the reason.
    n_missing, n_spikes : int
        Samples left out of the tests used.
    notes : tuple of str
        What the user should know.
    """

    laws: tuple[LawEstimate, ...]
    pooled: LawEstimate
    temperature: TemperatureEffect
    branches: tuple[Branch, ...]
    set_aside: tuple[tuple[str, str], ...]
    n_missing: int
    n_spikes: int
    notes: tuple[str, ...]
