"""What a comparison of measured and simulated friction coefficients found, and its verdict."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.identify.agreement.matching import MatchSettings

Array = NDArray[np.float64]

COLUMNS = (
    "run", "arc_deg", "nominal_tension_N", "pulley_speed_rad_s", "normal_force_N_m", "mu_measured",
    "mu_simulated", "difference", "relative_difference", "within_tolerance", "force_band",
)  # fmt: skip
"""Columns of the comparison table."""


@dataclass(frozen=True, slots=True)
class AgreementSettings:
    """Tolerances of the comparison; None is not judged.

    Parameters
    ----------
    max_rms_relative_error : float or None
        Largest admissible root mean square of the relative differences [-].
    max_mean_relative_error : float or None
        Largest admissible mean of their magnitudes [-]: differences do not cancel.
    max_relative_error : float or None
        Largest admissible magnitude of a single one [-].
    min_share_compared : float or None
        Smallest admissible share of the usable measured runs that were compared [-].
    max_rms_error_over_uncertainty : float or None
        Largest admissible root mean square of the differences over their standard uncertainties;
        nan, which is never admitted, where these are not known.
    match : MatchSettings
        How far settings of matched runs may be apart.
    """

    max_rms_relative_error: float | None = None
    max_mean_relative_error: float | None = None
    max_relative_error: float | None = None
    min_share_compared: float | None = None
    max_rms_error_over_uncertainty: float | None = None
    match: MatchSettings = field(default_factory=MatchSettings)

    def __post_init__(self) -> None:
        problems = [
            f"compare.{name} = {value}, must be > 0"
            for name, value in self.tolerances.items()
            if value is not None and not value > 0.0
        ]
        if problems:
            raise InputError(problems)

    @property
    def tolerances(self) -> dict[str, float | None]:
        """Tolerances by name."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name != "match"}


@dataclass(frozen=True, slots=True)
class Statistics:
    """Relative differences (simulated - measured)/measured of a group of points.

    Attributes
    ----------
    group : str
        What the points have in common.
    n_points : int
        Number of points; without points all figures are nan.
    rms, mean, mean_magnitude, largest : float
        Root mean square, mean with sign, mean of magnitudes and largest magnitude [-].
    force_low_N_m, force_high_N_m : float
        Lowest and highest measured normal force of the group [N/m].
    """

    group: str
    n_points: int
    rms: float
    mean: float
    mean_magnitude: float
    largest: float
    force_low_N_m: float
    force_high_N_m: float

    def as_row(self) -> dict[str, object]:
        """Row for printing, in percent; None in place of nan."""
        shares = ("rms", "mean", "mean_magnitude", "largest")
        figures = {f"{name}_percent": 100.0 * getattr(self, name) for name in shares}
        figures |= {name: getattr(self, name) for name in ("force_low_N_m", "force_high_N_m")}
        known = {k: (v if np.isfinite(v) else None) for k, v in figures.items()}
        return {"group": self.group, "n_points": self.n_points, **known}


def statistics(group: str, relative: Array, force: Array) -> Statistics:
    """Statistics of relative differences [-] at measured normal forces [N/m], each (n,)."""
    if relative.size == 0:
        return Statistics(group, 0, *([float("nan")] * 6))
    magnitude = np.abs(relative)
    return Statistics(
        group=group,
        n_points=relative.size,
        rms=float(np.sqrt(np.mean(relative**2))),
        mean=float(relative.mean()),
        mean_magnitude=float(magnitude.mean()),
        largest=float(magnitude.max()),
        force_low_N_m=float(force.min()),
        force_high_N_m=float(force.max()),
    )


@dataclass(frozen=True, slots=True, eq=False)
class AgreementResult:
    """Comparison of a measured and a simulated campaign.

    Attributes
    ----------
    run : ndarray of object (n,)
        Label of the measured run of each matched point; the measured settings follow.
    arc_deg, nominal_tension_N, pulley_speed_rad_s, normal_force_N_m : ndarray (n,)
        Settings and measured normal force per length.
    mu_measured, mu_simulated : ndarray (n,)
        Friction coefficients [-].
    force_band : ndarray of object (n,)
        "low", "middle" or "high": third of the points by measured normal force.
    averaged : dict of str to ndarray (m,)
        The same for the means over arcs at equal tension and speed, with ``n_arcs``.
    overall, over_arc_averages : Statistics
        All points; the means over arcs (Fig. 17).
    per_arc : tuple of Statistics
        Points of each arc (Fig. 16).
    thirds : tuple of Statistics
        Low, middle and high third of the points by measured normal force.
    settings : AgreementSettings
        Tolerances.
    n_measured, n_simulated : int
        Runs on either side.
    n_usable : int
        Measured runs that were not set aside.
    not_compared : dict of str to int
        Runs without a partner or set aside: reason and number.
    not_compared_runs : tuple of (str, str)
        The same run by run: label with side, reason.
    rows : tuple of ndarray of int (n,)
        Rows of the matched runs in the measured and in the simulated table.
    u_validation : ndarray (n,), optional
        Standard uncertainty of the relative differences [-]; nan where it is not known.
    """

    run: NDArray[np.object_]
    arc_deg: Array
    nominal_tension_N: Array
    pulley_speed_rad_s: Array
    normal_force_N_m: Array
    mu_measured: Array
    mu_simulated: Array
    force_band: NDArray[np.object_]
    averaged: dict[str, NDArray[Any]]
    overall: Statistics
    over_arc_averages: Statistics
    per_arc: tuple[Statistics, ...]
    thirds: tuple[Statistics, ...]
    settings: AgreementSettings
    n_measured: int
    n_simulated: int
    n_usable: int
    not_compared: dict[str, int]
    not_compared_runs: tuple[tuple[str, str], ...]
    rows: tuple[NDArray[np.intp], NDArray[np.intp]]
    u_validation: Array | None = None

    @property
    def difference(self) -> Array:
        """Simulated less measured friction coefficient [-], (n,)."""
        return self.mu_simulated - self.mu_measured

    @property
    def relative_difference(self) -> Array:
        """Difference over the measured value [-], (n,)."""
        return self.difference / self.mu_measured

    @property
    def judged(self) -> dict[str, tuple[float, float, bool]]:
        """Of each tolerance that is set: found, allowed, whether it holds (nan never does)."""
        found = {
            "max_rms_relative_error": self.overall.rms,
            "max_mean_relative_error": self.overall.mean_magnitude,
            "max_relative_error": self.overall.largest,
            "min_share_compared": self.share_compared,
            "max_rms_error_over_uncertainty": self.rms_error_over_uncertainty,
        }
        return {
            name: (
                found[name],
                allowed,
                bool(found[name] >= allowed if name.startswith("min") else found[name] <= allowed),
            )
            for name, allowed in self.settings.tolerances.items()
            if allowed is not None
        }

    @property
    def share_compared(self) -> float:
        """Share of the usable measured runs that found a simulated partner [-]."""
        return self.mu_measured.size / self.n_usable

    @property
    def error_over_uncertainty(self) -> Array:
        """Relative difference over its standard uncertainty (n,); nan where it is not known."""
        if self.u_validation is None:
            return np.full(self.mu_measured.size, np.nan)
        safe = np.where(self.u_validation > 0.0, self.u_validation, np.nan)
        return self.relative_difference / safe

    @property
    def rms_error_over_uncertainty(self) -> float:
        """Root mean square of the differences in units of their standard uncertainties."""
        return float(np.sqrt(np.mean(np.square(self.error_over_uncertainty))))

    @property
    def passed(self) -> bool:
        """Whether every tolerance that is set holds."""
        return all(holds for _, _, holds in self.judged.values())

    @property
    def within_tolerance(self) -> NDArray[np.bool_]:
        """Points within ``max_relative_error`` (n,); all of them if it is not judged."""
        allowed = self.settings.max_relative_error
        bound = np.inf if allowed is None else allowed
        return np.abs(self.relative_difference) <= bound

    def to_columns(self) -> dict[str, NDArray[Any]]:
        """Columns of the comparison table, a row per matched point."""
        return {name: getattr(self, name) for name in COLUMNS}

    def statistics_table(self) -> list[dict[str, object]]:
        """Rows for printing: all points, each arc, the means over arcs, thirds of the force."""
        groups = (self.overall, *self.per_arc, self.over_arc_averages, *self.thirds)
        return [group.as_row() for group in groups]

    def verdict_table(self) -> list[dict[str, object]]:
        """Rows for printing: a judged tolerance each."""
        return [
            {"tolerance": name, "found": found, "allowed": allowed, "holds": holds}
            for name, (found, allowed, holds) in self.judged.items()
        ]

    def averaged_table(self) -> list[dict[str, object]]:
        """Rows for printing: the means over arcs at each tension and speed (Fig. 17)."""
        rows = zip(*(column.tolist() for column in self.averaged.values()), strict=True)
        return [dict(zip(self.averaged, row, strict=True)) for row in rows]
