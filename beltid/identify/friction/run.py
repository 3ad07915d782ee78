"""What goes into the reduction of a run of the friction rig, and what comes out."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.identify.friction.condense import Raw
from beltid.identify.friction.kinds import TWO_CELLS, RigKind
from beltid.identify.friction.load_cells import KnownCell, KnownCells

Array = NDArray[np.float64]

NAN = float("nan")


@dataclass(frozen=True, slots=True)
class FrictionSettings:
    """Settings of the reduction. The defaults suit bench and simulated recordings alike.

    Raises
    ------
    InputError
        If a value is outside its range; all of them at once.
    """

    steady_tolerance: float = 0.005
    """Change of the tail, relative to mu, with which the plateau has begun [-]."""
    max_error: float = 0.05
    """Largest standard error of mu_sliding, relative to it, that a run may have [-]."""
    max_drift: float = 0.1
    """Largest drift of mu over the sliding phase, relative to it [-]."""
    max_noise_ratio: float = 2.5
    """Largest noise while sliding over that at rest; beyond it the belt sticks and slips [-]."""
    max_misfit: float = 4.0
    """Largest noise about the model of the bench over that of the other runs [-]."""
    min_plateau_samples: int = 12
    """Fewest usable samples of sliding."""
    min_rest_samples: int = 3
    """Fewest samples before the pulley turns."""
    spike_threshold: float = 6.0
    """Distance from the neighbours above which a sample is a spike, in standard deviations."""
    max_missing_fraction: float = 0.3
    """Largest part of the samples that may be missing or not positive [-]."""
    max_imbalance: float = 0.2
    """Largest difference of the two cells at rest over their mean [-]."""
    correct_imbalance: Literal["auto"] | bool = "auto"
    """Whether the difference of the cells at rest is taken off. ``True``: in every run, half from
    each cell, with the noise of the rest phase. ``False``: never; the standard error allows for a
    clear one. ``"auto"``: where it is clear, as what all runs of the bench together show it
    to be: a difference of the zero points, or of the gains; otherwise as with ``False``."""
    check_initial_tension: bool = True
    """Whether tensions at rest that do not fit the stated ones are an error."""
    tension_tight_tare_N: float = 0.0
    """Reading of the cell of the column tension_tight_N without a load [N]."""
    tension_slack_tare_N: float = 0.0
    """The same of the other cell [N]."""
    tension_tight_gain: float = 1.0
    """True force over reading, less tare, of the cell of the column tension_tight_N [-]."""
    tension_slack_gain: float = 1.0
    """The same of the other cell [-]."""
    tension_tight_tilt_deg: float = 0.0
    """Angle between the span at that cell and its axis [deg]."""
    tension_slack_tilt_deg: float = 0.0
    """The same of the other cell [deg]."""
    max_mu: float = 3.0
    """Largest credible friction coefficient [-]."""
    speed_bins_rad_s: tuple[float, ...] = ()
    """Edges of the bins that a run is cut into whose speed is not steady [rad/s]."""
    max_peak_error: float = 0.015
    """Largest standard error of mu_sticking, relative to it, with which a peak is resolved [-]."""

    def __post_init__(self) -> None:
        ranges: dict[str, tuple[float, float]] = {
            "steady_tolerance": (1e-6, 0.2),
            "max_error": (1e-4, 1.0),
            "max_drift": (0.0, 1.0),
            "max_noise_ratio": (1.0, 1e6),
            "max_misfit": (1.0, 1e6),
            "min_plateau_samples": (8, 1_000_000),
            "min_rest_samples": (1, 1_000_000),
            "spike_threshold": (3.0, 100.0),
            "max_missing_fraction": (0.0, 0.95),
            "max_imbalance": (0.0, 2.0),
            "tension_tight_tare_N": (-1.0e4, 1.0e4),
            "tension_slack_tare_N": (-1.0e4, 1.0e4),
            "tension_tight_gain": (0.1, 10.0),
            "tension_slack_gain": (0.1, 10.0),
            "tension_tight_tilt_deg": (-60.0, 60.0),
            "tension_slack_tilt_deg": (-60.0, 60.0),
            "max_mu": (0.01, 100.0),
            "max_peak_error": (0.0, 1.0),
        }
        problems = [
            f"friction.{name} = {getattr(self, name)!r}, must be in [{low:g}, {high:g}]"
            for name, (low, high) in ranges.items()
            if not low <= getattr(self, name) <= high
        ]
        if self.correct_imbalance not in ("auto", True, False):
            problems.append(
                f"friction.correct_imbalance = {self.correct_imbalance!r}, "
                "must be auto, true or false"
            )
        if problems:
            raise InputError(problems)

    @property
    def cells(self) -> KnownCells:
        """What is known to be wrong with the load cells."""
        return KnownCells(
            tight=KnownCell(
                self.tension_tight_tare_N, self.tension_tight_gain, self.tension_tight_tilt_deg
            ),
            slack=KnownCell(
                self.tension_slack_tare_N, self.tension_slack_gain, self.tension_slack_tilt_deg
            ),
        )


@dataclass(frozen=True, slots=True)
class Conditions:
    """Under which conditions a run was made; what nobody stated is missing."""

    condition: str | None = None
    """Surface: dry, wet or dusty."""
    side: str | None = None
    """Side of the belt on the pulley: rib or back."""
    humidity_percent: float = NAN
    hours_run: float = NAN
    pulley_material: str | None = None
    roughness_Ra_um: float = NAN

    def completed(self, default: Conditions) -> Conditions:
        """These, with those of a default where nothing is stated."""
        values: dict[str, Any] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            stated = value is not None and value == value
            values[field.name] = value if stated else getattr(default, field.name)
        return Conditions(**values)


@dataclass(frozen=True, slots=True)
class RunRecord:
    """One recording of the friction rig, shape (n,) for each column, in their order of time."""

    time_s: Array
    tension_tight_N: Array
    tension_slack_N: Array
    pulley_speed_rad_s: Array
    temperature_degC: Array | None = None
    run: str = ""
    arc_deg: float = NAN
    nominal_tension_N: float = NAN
    defect: str = ""
    """Why the record cannot be one run (its nominal settings change, ...); empty if it can."""
    raw: Raw | None = None
    """What the samples showed, if these are means over blocks of them."""
    kind: RigKind = TWO_CELLS
    """What the bench measured; the tensions follow from it."""
    belt_speed_m_s: float = 0.0
    """Speed of the belt; that of the pulley is the one relative to it [m/s]."""
    conditions: Conditions = Conditions()
    note: str = ""
    """What was done to the channels before, for the user."""


@dataclass(frozen=True, slots=True)
class RunReduction:
    """One run of the friction rig, reduced. What could not be determined is nan.

    A run that was set aside keeps what had been found before the reason showed.
    """

    run: str = ""
    arc_deg: float = NAN
    """Contact arc, nominal [deg]."""
    initial_tension_N: float = NAN
    """Mean of both cells at the start of the rotation [N]."""
    nominal_tension_N: float = NAN
    pulley_speed_rad_s: float = NAN
    """Magnitude of the pulley's speed [rad/s]."""
    slip_speed_m_s: float = NAN
    """Sliding speed |omega| R, Eq. (7) [m/s]."""
    tension_tight_N: float = NAN
    """Tight tension of the plateau, without ripple and tail of the peak [N]."""
    tension_slack_N: float = NAN
    mu_sliding: float = NAN
    """Eq. (6) of the two plateau tensions [-]."""
    mu_sliding_se: float = NAN
    """Standard error from the noise of the record and its memory, the shape of the tail, drift and
    the cells: all of it, what the runs share included [-]."""
    mu_sticking: float = NAN
    """Peak of mu at the end of the build-up [-]; nan where the record does not resolve it."""
    mu_sticking_se: float = NAN
    normal_force_N_m: float = NAN
    """Closed mean of Eq. (8) over the arc [N/m]."""
    temperature_degC: float = NAN
    """Mean over the plateau [°C]."""
    n_samples: int = 0
    """Samples of the plateau."""
    status: str = ""
    """"ok", or why the run was set aside."""
    mu_sticking_reason: str = "the run was set aside"
    """Why mu_sticking is missing; empty if it is there."""
    imbalance_N: float = NAN
    """Tight minus slack cell at rest, as recorded [N]."""
    imbalance_se_N: float = NAN
    start_time_s: float = NAN
    """First sample at which the pulley turns [s]."""
    peak_time_s: float = NAN
    """Moment of the sticking peak [s]."""
    plateau_start_s: float = NAN
    plateau_end_s: float = NAN
    n_spikes: int = 0
    """Samples of either channel left out as spikes."""
    n_missing: int = 0
    """Samples without a usable tension, and samples missing from an even time base."""
    ripple_amplitude_N: float = NAN
    """Amplitude of the strongest ripple of the tight tension [N]; zero without ripple."""
    ripple_period_s: float = NAN
    """Period of that ripple [s]; nan without ripple."""
    tail_time_s: float = NAN
    """Time in which the tail falls to 1/e of its height [s]; nan without one."""
    drift: float = NAN
    """Relative change of mu by drift over the sliding phase [-], as far as the noise tells it."""
    shared_tail: float = NAN
    """Change of ln mu by one standard deviation of what the shape of the tail leaves open, which
    all runs share [-]."""
    shared_drift: float = NAN
    """The same of a drift of the cells that all runs share [-]."""
    shared_cells: float = NAN
    """The same of the zeros and gains of the cells [-]."""
    conditions: Conditions = Conditions()
    swapped: bool = False
    """Whether the columns of the tight and the slack cell were swapped."""
    notes: tuple[str, ...] = ()
    """What a user should know about the run."""

    @property
    def ok(self) -> bool:
        """Whether the run may be used."""
        return self.status == "ok"


def arc_problem(arc_deg: float) -> str:
    """Why a contact arc cannot be used; empty if it can."""
    if math.isfinite(arc_deg) and 0.0 < arc_deg <= 3600.0:
        return ""
    return f"arc_deg = {arc_deg:g}, must be in (0, 3600]"
