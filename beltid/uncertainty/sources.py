"""Sources of error with their standard uncertainties.

A source is one number that is wrong by an unknown amount *for all runs that share it*: the
calibration of the cells for all runs, the setting of an arc for the runs at that arc, the law of
the press for the whole surface. Many runs do not average such an error out. Noise of the samples,
which differs from run to run, is not a source here; it is in the standard error of each run. The
sensitivity to an error may still differ from run to run; it belongs to the run, not to the source
(:class:`beltid.uncertainty.measured.Measured`).

Sign: an error is the true value minus the value used, relative to it or in its unit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.refine.effects import ARC, COURSE, ORDER, TEMPERATURE

Array = NDArray[np.float64]

STATED = "stated"
ASSUMED = "assumed"
FITTED = "fitted"


@dataclass(frozen=True, slots=True)
class StandardUncertainties:
    """Standard uncertainties (k = 1) of the calibrations and settings of the benches.

    Attributes
    ----------
    tension_gain : float
        Gain of both load cells together, as a share.
    cell_gain : float
        Gain of each load cell separately, as a share. Rest does not show it: the belt may hold as
        much friction.
    cell_offset : float
        Zero point of each load cell [N].
    torque_gain : float
        Gain of the torque of the friction rig, as a share.
    bearing_drag : float
        Drag of its bearings, and zero of its sensor, that remain in that torque [N m].
    mass_per_length : float
        Mass per length of a running belt, as a share: m v² is subtracted from its tensions.
    arc : float
        Contact arc, common to all settings [rad].
    arc_setting : float
        Contact arc of each setting separately [rad].
    pulley_radius : float
        Radius of the belt's centreline on the pulley, as a share.
    span_length : float
        Length of the free spans [m].
    pulley_speed : float
        Gain of the speed of the pulley, as a share.
    bending_stiffness, axial_stiffness : float
        EI and EA of the belt, as a share.
    press_force, press_displacement : float
        Gains of the press, as a share.
    segment_length : float
        Length of belt under the press, as a share.
    machine_compliance : float
        Compliance of the press [m/N].
    drive_radius : float
        Radius of each pulley of a drive, as a share.
    drive_centres : float
        Coordinates of the centre of each pulley of a drive [m].
    initial_tension : float
        Belt tension of a drive at rest, as a share.
    torque : float
        Gain of the torque of a drive, as a share.
    stated : frozenset of str
        Names of those that the user stated; the others are assumed.
    """

    tension_gain: float = 0.0
    cell_gain: float = 0.0
    cell_offset: float = 0.0
    torque_gain: float = 0.0
    bearing_drag: float = 0.0
    mass_per_length: float = 0.0
    arc: float = 0.0
    arc_setting: float = 0.0
    pulley_radius: float = 0.0
    span_length: float = 0.0
    pulley_speed: float = 0.0
    bending_stiffness: float = 0.0
    axial_stiffness: float = 0.0
    press_force: float = 0.0
    press_displacement: float = 0.0
    segment_length: float = 0.0
    machine_compliance: float = 0.0
    drive_radius: float = 0.0
    drive_centres: float = 0.0
    initial_tension: float = 0.0
    torque: float = 0.0
    stated: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        problems = [
            f"uncertainty.{f.name} = {getattr(self, f.name)!r}, must be >= 0 and finite"
            for f in fields(self)
            if f.name != "stated" and not 0.0 <= getattr(self, f.name) < math.inf
        ]
        if problems:
            raise InputError(problems)

    def basis(self, name: str) -> str:
        """Return whether a standard uncertainty was stated or assumed."""
        return STATED if name in self.stated else ASSUMED


@dataclass(frozen=True, slots=True)
class Source:
    """One unknown error.

    Attributes
    ----------
    name : str
        Name in words; sources of the same name are of the same kind (both cells, all arcs).
    error : str
        Its key in :class:`Errors`.
    place : int
        Its index there: which arc, which cell, which direction.
    size : float
        Standard uncertainty, as a share or in SI units.
    unit : str
        Unit for display.
    per_unit : float
        Size of that unit in SI.
    basis : str
        "stated" in the config, "assumed" (default of the config), or "fitted" to the data.
    """

    name: str
    error: str
    place: int
    size: float
    unit: str
    per_unit: float
    basis: str

    @property
    def shown(self) -> float:
        """Standard uncertainty in the unit for display."""
        return self.size / self.per_unit


@dataclass(frozen=True, slots=True)
class Errors:
    """One realisation of all errors: arrays by the key of the source."""

    values: Mapping[str, Array] = field(default_factory=dict)

    def at(self, error: str, place: int = 0) -> float:
        """Return the error of one source; zero if it has none."""
        values = self.values.get(error)
        return 0.0 if values is None or place >= values.size else float(values[place])

    @classmethod
    def single(cls, source: Source) -> Errors:
        """Return errors with one source wrong by its standard uncertainty and no others."""
        return cls({source.error: source.size * np.eye(source.place + 1)[source.place]})


PERCENT = ("%", 0.01)
DEGREE = ("deg", math.pi / 180.0)

RIG_SOURCES: tuple[tuple[str, str, tuple[str, float], int], ...] = (
    ("tension_gain", "gain common to both load cells", PERCENT, 1),
    ("cell_gain", "gain of each load cell", PERCENT, 2),
    ("cell_offset", "zero point of each load cell", ("N", 1.0), 2),
    ("torque_gain", "gain of the torque", PERCENT, 1),
    ("bearing_drag", "drag of the bearings in the torque", ("N m", 1.0), 1),
    ("mass_per_length", "mass per length of the belt", PERCENT, 1),
    ("arc", "contact arc, all settings together", DEGREE, 1),
    ("arc_setting", "contact arc, each setting", DEGREE, 0),
    ("pulley_radius", "radius of the belt's centreline", PERCENT, 1),
    ("pulley_speed", "speed of the pulley", PERCENT, 1),
)
"""Key, name, unit, number of places (0: one per arc), for sources that the formulas need."""
MODEL_SOURCES = (
    ("span_length", "length of the spans", ("mm", 1.0e-3), 1),
    ("bending_stiffness", "bending stiffness of the belt", PERCENT, 1),
    ("axial_stiffness", "axial stiffness of the belt", PERCENT, 1),
)
"""Sources that only the simulated rig needs."""
BENT_SPANS = ("span_length", "bending_stiffness")
"""Those of them that change the direction of the spans of a bent belt."""
PRESS_SOURCES = (
    ("press_force", "force of the press", PERCENT, 1),
    ("press_displacement", "travel of the press", PERCENT, 1),
    ("segment_length", "length of the pressed segment", PERCENT, 1),
    ("machine_compliance", "compliance of the press", ("mm/N", 1.0e-3), 1),
)
DRIVE_SOURCES = (
    ("axial_stiffness", "axial stiffness of the belt", PERCENT, 1),
    ("initial_tension", "belt tension at rest", PERCENT, 1),
    ("torque", "torque", PERCENT, 1),
)
PULLEY_SOURCES = (("drive_radius", "radius of each pulley", PERCENT, 0),)
CENTRE_SOURCES = (("drive_centres", "place of each pulley", ("mm", 1.0e-3), 0),)

REDUCTION_SOURCES = (
    ("shared_tail", "shape of the tail"),
    ("shared_drift", "common drift"),
    ("shared_cells", "cells as seen at rest"),
)
"""Key and name of errors that the reduction of all runs shares; their sizes are in the runs."""
EFFECT_SOURCES = {
    ARC: "differences between arcs",
    ORDER: "change over the campaign",
    COURSE: "change over the campaign",
    TEMPERATURE: "temperature of the runs",
}
"""Key and name of effects that shift the friction in addition to the surface."""


def rig_sources(u: StandardUncertainties, n_arcs: int, *, bent: bool = False) -> tuple[Source, ...]:
    """Return the sources of the friction rig in Eqs. (6) to (8), without those of zero size.

    `bent` states whether the measured force depends on bending of the spans, as a hub force does.
    """
    of_spans = [row for row in MODEL_SOURCES if bent and row[0] in BENT_SPANS]
    return _sources(u, (*RIG_SOURCES, *of_spans), n_arcs)


def press_sources(u: StandardUncertainties) -> tuple[Source, ...]:
    """Return the sources of the press."""
    return _sources(u, PRESS_SOURCES, 1)


def all_sources(
    u: StandardUncertainties, n_arcs: int, law_scatter: bool = True
) -> tuple[Source, ...]:
    """Return the sources of a surface that was built with the simulated rig.

    `law_scatter` states whether the covariance of the contact law is known. All runs use the same
    law, so its scatter is an error that they share.
    """
    rig = (*rig_sources(u, n_arcs), *_sources(u, MODEL_SOURCES, 1))
    return (*rig, *law_scatter_sources(law_scatter), *press_sources(u))


def drive_sources(
    u: StandardUncertainties, n_pulleys: int, law_scatter: bool
) -> tuple[Source, ...]:
    """Return the sources of a predicted drive, without the scatter of its friction surface.

    The places of ``drive_centres`` are the abscissae of all pulleys, then their ordinates.
    """
    geometry = (
        *_sources(u, PULLEY_SOURCES, n_pulleys),
        *_sources(u, CENTRE_SOURCES, 2 * n_pulleys),
    )
    law = (*law_scatter_sources(law_scatter), *press_sources(u))
    return (*_sources(u, DRIVE_SOURCES, 1), *geometry, *law)


def bending_source() -> Source:
    """Return the source for the bending stiffness that a string has not, of unit size."""
    words = "string without bending stiffness"
    return Source(words, "without_bending", 0, 1.0, "1", 1.0, FITTED)


def slower_source() -> Source:
    """Return the source for friction at sliding speeds below those measured, of unit size."""
    words = "friction slower than the slowest measured sliding"
    return Source(words, "slower_friction", 0, 1.0, "1", 1.0, ASSUMED)


def between_speeds_source(place: int) -> Source:
    """Return the source for friction interpolated to a speed that was left out, of unit size."""
    words = "interpolation between the speeds"
    return Source(words, "between_speeds", place, 1.0, "1", 1.0, FITTED)


def law_scatter_sources(known: bool) -> tuple[Source, ...]:
    """Return the scatter of both contact law coefficients, if their covariance is known."""
    words = "contact law, scatter of the press"
    return tuple(Source(words, "law", k, 1.0, "1", 1.0, FITTED) for k in range(2 * known))


def reduction_sources(columns: Mapping[str, Array]) -> tuple[Source, ...]:
    """Return the sources of the reduction that runs have columns for; each of unit size."""
    return tuple(
        Source(words, key, 0, 1.0, "1", 1.0, FITTED)
        for key, words in REDUCTION_SOURCES
        if key in columns and np.any(columns[key])
    )


def effect_sources(key: str, size: float, count: int) -> tuple[Source, ...]:
    """Return the sources of an effect; `size` is the standard deviation that the runs show."""
    return tuple(
        Source(EFFECT_SOURCES[key], key, k, size, *PERCENT, FITTED)
        for k in range(count)
        if size > 0.0
    )


def _sources(
    u: StandardUncertainties,
    table: Sequence[tuple[str, str, tuple[str, float], int]],
    n_arcs: int,
) -> tuple[Source, ...]:
    return tuple(
        Source(words, key, place, size, *unit, u.basis(key))
        for key, words, unit, count in table
        for size in (getattr(u, key),)
        for place in range(count or n_arcs)
        if size > 0.0
    )
