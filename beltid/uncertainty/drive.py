"""What the inputs of a drive leave open of its speed losses.

Every shared error moves the inputs by one standard uncertainty, and the drive is solved again; the
friction surface counts by the scatter of the losses over its ensemble. An error of the inputs acts
on all points together, with its sign. The string serves for it at rod level as well, but for points
in full slip: how they slip the rod alone knows.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from beltid.drive.model import Drive, DrivePoint
from beltid.drive.results import Method, Simulator
from beltid.errors import ConvergenceError
from beltid.laws.friction_surface import FrictionSurface
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.sources import Errors, Source

Array = NDArray[np.float64]

MEMBERS_WITH_RODS: Final = 16
"""Members of an ensemble that are solved with rods: their scatter is known to a fifth."""


@dataclass(frozen=True, slots=True)
class DriveUncertainty:
    """Changes of the speed losses [rad/s] by one standard uncertainty of each input.

    Attributes
    ----------
    shared : ndarray (n_points, n_pulleys, K)
        By each of the K sources, with their signs.
    surface : ndarray (n_points, n_pulleys)
        Standard deviation over the ensemble of the friction surface; 0 without one.
    """

    shared: Array
    surface: Array

    @property
    def combined(self) -> Array:
        """Combined standard uncertainty of the losses [rad/s], shape (n_points, n_pulleys)."""
        return np.asarray(np.sqrt(np.sum(self.shared**2, axis=-1) + self.surface**2))


def drive_uncertainty(
    drive: Drive,
    points: Sequence[DrivePoint],
    press: PressLaw,
    sources: Sequence[Source],
    ensemble: Sequence[FrictionSurface] = (),
    method: Method = "string",
) -> DriveUncertainty:
    """Move the inputs of a drive one by one.

    Parameters
    ----------
    drive : Drive
        The drive with the best values of its inputs.
    points : sequence of DrivePoint
        Operating points.
    press : PressLaw
        The contact law of the drive and its making.
    sources : sequence of Source
        Errors of :func:`beltid.uncertainty.sources.drive_sources`.
    ensemble : sequence of FrictionSurface
        Surfaces that might be the true one; none if that is not known.
    method : {"string", "rod"}
        How the drive is solved; with rods a part of the ensemble has to do.

    Returns
    -------
    DriveUncertainty
        nan where a point has no steady state.
    """
    best = speed_losses(drive, points, method)
    shared = np.zeros((*best.shape, len(sources)))
    for k, source in enumerate(sources):
        errors = Errors.single(source)
        shared[..., k] = speed_losses(*with_errors(drive, points, press, errors), method) - best
    if not ensemble:
        return DriveUncertainty(shared, np.zeros(best.shape))
    if method == "rod":
        ensemble = ensemble[:: max(len(ensemble) // MEMBERS_WITH_RODS, 1)]
    members = [
        speed_losses(replace(drive, surface=surface), points, method) for surface in ensemble
    ]
    with warnings.catch_warnings():  # a point without a steady state in any member stays nan
        warnings.simplefilter("ignore", RuntimeWarning)
        return DriveUncertainty(shared, np.nanstd(members, axis=0, ddof=1))


def speed_losses(drive: Drive, points: Sequence[DrivePoint], method: Method = "string") -> Array:
    """Speed losses of all pulleys [rad/s], (n_points, n_pulleys); nan without a steady state."""
    simulator, rows = Simulator(drive, method), []
    for point in points:
        try:
            result = simulator.solve(point)
            rows.append(result.in_order(result.loss.total))
        except ConvergenceError:
            rows.append(np.full(len(drive.pulleys), np.nan))
    return np.array(rows)


def with_errors(
    drive: Drive, points: Sequence[DrivePoint], press: PressLaw, errors: Errors
) -> tuple[Drive, list[DrivePoint]]:
    """A drive and its points with errors put right."""
    n = len(drive.pulleys)
    pulleys = tuple(
        replace(
            pulley,
            R=pulley.R * (1.0 + errors.at("drive_radius", i)),
            x=pulley.x + errors.at("drive_centres", i),
            y=pulley.y + errors.at("drive_centres", n + i),
        )
        for i, pulley in enumerate(drive.pulleys)
    )
    belt = replace(drive.belt, EA=drive.belt.EA * (1.0 + errors.at("axial_stiffness")))
    law = None if drive.law is None else press.corrected(errors)
    tension, torque = 1.0 + errors.at("initial_tension"), 1.0 + errors.at("torque")
    moved = [replace(point.scaled(torque), T_0=point.T_0 * tension) for point in points]
    return replace(drive, belt=belt, law=law, pulleys=pulleys), moved
