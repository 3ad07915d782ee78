"""Uncertainty of the speed losses of a drive that its inputs cause.

Each shared error moves the inputs of all points by one standard uncertainty, and the drive is
solved again. The friction surface contributes by the columns of the factor of its covariance. The
string model gives these changes for rods as well, except at points where either slips fully.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from beltid.arrays import Array, Mask
from beltid.drive.model import Drive, DrivePoint
from beltid.drive.results import ADHESION, DriveResult
from beltid.drive.simulator import Method, Simulator
from beltid.errors import ConvergenceError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.uncertainty.measured import PressLaw
from beltid.uncertainty.sources import BENDING, SLOWER, Errors, Source, factor_of

Results = Sequence[DriveResult | None]
Input = tuple[Drive, Sequence[DrivePoint]]

SURFACE_VARIANCE = 0.999
"""Share of the variance of ln mu, over all nodes, of the changes of a surface that are solved."""


@dataclass(frozen=True, slots=True)
class DriveUncertainty:
    """Changes of the speed losses [rad/s] by one standard uncertainty of each input."""

    sources: tuple[Source, ...]  # what is not known of the inputs, and of the model
    shared: Array  # change by each of them, with its sign, (n_points, n_pulleys, K)
    surface: Array  # by the friction surface; 0 if it has no covariance, (n_points, n_pulleys)
    by_string: Mask
    """Points in full slip whose rods have no steady state with one of the errors; their changes
    come from the string model, (n_points,)."""

    @property
    def combined(self) -> Array:
        """Combined standard uncertainty of the losses [rad/s], shape (n_points, n_pulleys)."""
        return np.asarray(np.sqrt(np.sum(self.shared**2, axis=-1) + self.surface**2))


def drive_uncertainty(
    drive: Drive,
    points: Sequence[DrivePoint],
    results: Sequence[DriveResult],
    press: PressLaw,
    sources: Sequence[Source],
) -> DriveUncertainty:
    """Compute the change of the speed losses by each input of a drive; nan without a steady state.

    `results` are those of the points by string or rod, `press` the contact law of the drive and its
    fit to the press, `sources` what can be stated of a drive. A surface with a covariance adds its
    part, a string what it does not bend. Friction below the measured speeds stays as at the slowest
    one, or continues with its whole trend: the limits of a uniform distribution, (D14), with the
    sign of the change from the first to the second.
    """
    strings = _solved(drive, points, "string", [None] * len(points))
    rods = [i for i, result in enumerate(results) if result.state.rods]
    stick = [r is not None and set(r.status) == {ADHESION} for r in strings]
    slipping = [i for i in rods if not (stick[i] and set(results[i].status) == {ADHESION})]
    inputs = [with_errors(drive, points, press, Errors({s.key: s.size})) for s in sources]
    inputs += [(replace(drive, surface=other), list(points)) for other in _moved(drive.surface)]
    changes, by_string = _changes(drive, inputs, results, strings, slipping)
    shared, by_surface = np.split(changes, [len(sources)], axis=-1)
    of_model = {} if rods else {BENDING: without_bending(results)}
    limits = [replace(drive, slow_trend=share) for share in (0.0, 1.0)]
    if limits[0].friction is not limits[1].friction:
        ends, _ = _changes(drive, [(limit, points) for limit in limits], results, strings, rods)
        of_model[SLOWER] = (ends[..., 1] - ends[..., 0]) / math.sqrt(12.0)
    return DriveUncertainty(
        (*sources, *of_model),
        np.concatenate([shared, *(change[..., None] for change in of_model.values())], axis=-1),
        np.linalg.norm(by_surface, axis=-1),
        by_string,
    )


def _changes(
    drive: Drive,
    inputs: Sequence[Input],
    results: Sequence[DriveResult],
    strings: Results,
    by_rod: Sequence[int],
) -> tuple[Array, Mask]:
    """Compute changes by strings, or `by_rod` at some points; and where a rod is not steady."""
    changes = np.zeros((len(strings), len(drive.pulleys), len(inputs)))
    fails, near = np.zeros(len(strings), dtype=bool), [results[i] for i in by_rod]
    for k, (other, moved) in enumerate(inputs):
        change = _losses(_solved(other, moved, "string", strings), drive) - _losses(strings, drive)
        if near:
            rods = _solved(other, [moved[i] for i in by_rod], "rod", near)
            of_rods = _losses(rods, drive) - _losses(near, drive)
            change[by_rod] = np.where(np.isfinite(of_rods), of_rods, change[by_rod])
            fails[by_rod] |= ~np.isfinite(of_rods).all(axis=1)
        changes[..., k] = change
    return changes, fails


def _moved(surface: FrictionSurface) -> list[FrictionSurface]:
    """Return the surface moved by one standard uncertainty along each principal change of ln mu."""
    if surface.factor is None:
        return []
    nodes = surface.factor.reshape(surface.mu_nodes.size, -1)
    changes = factor_of(nodes @ nodes.T)
    variance = np.cumsum(np.sum(changes**2, axis=0))
    kept = changes[:, : 1 + int(np.searchsorted(variance, SURFACE_VARIANCE * variance[-1]))]
    f, v, mu = surface.normal_force_N_m, surface.slip_speed_m_s, surface.mu_nodes
    return [FrictionSurface(f, v, mu * np.exp(change.reshape(mu.shape))) for change in kept.T]


def without_bending(results: Sequence[DriveResult]) -> Array:
    """Compute the uncertainty of the losses of strings, which have no bending stiffness [rad/s].

    The ribs of a string seat at once, those of a rod over some length, on which they slip: the
    error grows with the seating part S of the loss L, and in full slip with its slip part X. It is
    ``u = hypot(0.14 sqrt(|S L|), X)``, relative to the speed and for the pulley where it is
    largest; 0 for the driver, (n_points, n_pulleys). Random drives of two pulleys at fixed centres:
    short of full slip (1044) rods lose 22 % less to 18 % more than strings, 0.97 u RMS and at most
    1.96 u; in full slip (178) nine tenths are within 2 u.
    """
    rows = []
    for result in results:
        speed, loss, _, seating, slip = result.speeds.values()
        relative = np.hypot(0.14 * np.sqrt(np.abs(seating * loss)), slip) / np.abs(speed)
        is_driver = result.in_order(np.arange(speed.size) == result.drive.driver)
        rows.append(np.where(is_driver, 0.0, np.abs(speed) * np.max(relative)))
    return np.array(rows)


def _solved(
    drive: Drive, points: Sequence[DrivePoint], method: Method, near: Results
) -> list[DriveResult | None]:
    """Solve points, each from a nearby result; None without a steady state."""
    simulator, solved = Simulator(drive, method), list[DriveResult | None]()
    for point, start in zip(points, near, strict=True):
        try:
            solved.append(simulator.solve(point, start))
        except ConvergenceError:
            solved.append(None)
    return solved


def _losses(results: Results, drive: Drive) -> Array:
    """Return the speed losses [rad/s], (n_points, n_pulleys); nan without a steady state."""
    unknown = np.full(len(drive.pulleys), np.nan)
    return np.array([unknown if r is None else r.speeds["speed_loss_rad_s"] for r in results])


def with_errors(
    drive: Drive, points: Sequence[DrivePoint], press: PressLaw, errors: Errors
) -> tuple[Drive, list[DrivePoint]]:
    """Return a drive and its points with errors corrected."""
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
    belt = drive.belt._replace(EA=drive.belt.EA * (1.0 + errors.at("axial_stiffness")))
    law = None if drive.law is None else NormalLaw(*press.coefficients(errors).tolist())
    tension, torque = 1.0 + errors.at("initial_tension"), 1.0 + errors.at("torque")
    moved = [replace(point.scaled(torque), T_0=point.T_0 * tension) for point in points]
    return replace(drive, belt=belt, law=law, pulleys=pulleys), moved
