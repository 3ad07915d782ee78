"""Sources of error with their standard uncertainties, and the propagation of each to a result.

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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError

Array = NDArray[np.float64]

STATED: Final = "stated"
ASSUMED: Final = "assumed"
FITTED: Final = "fitted"

PERCENT: Final = ("%", 0.01)
DEGREE: Final = ("deg", math.pi / 180.0)
NEWTON: Final = ("N", 1.0)
MILLIMETRE: Final = ("mm", 1.0e-3)

RIG, SPANS, MODEL, PRESS, DRIVE = "rig", "spans", "model", "press", "drive"
ARCS, PULLEYS, COORDINATES = "arcs", "pulleys", "coordinates"


class Kind(NamedTuple):
    """A kind of error that a user can state.

    `error` is its key in the section ``uncertainty`` of a config without the unit; `unit` the unit
    for display and its size in SI; `places` how many such errors there are, a number or what they
    are counted by; `results` what they change: the runs by Eqs. (6) to (8), the direction of bent
    spans, the simulated rig, the contact law, a drive.
    """

    error: str
    name: str
    unit: tuple[str, float]
    places: int | str
    results: tuple[str, ...]


KINDS: Final = (
    Kind("tension_gain", "gain common to both load cells", PERCENT, 1, (RIG,)),
    Kind("cell_gain", "gain of each load cell", PERCENT, 2, (RIG,)),
    Kind("cell_hysteresis", "hysteresis of the load cells", PERCENT, 1, (RIG,)),
    Kind("cell_offset", "zero point of each load cell", NEWTON, 2, (RIG,)),
    Kind("torque_gain", "gain of the torque", PERCENT, 1, (RIG,)),
    Kind("bearing_drag", "drag of the bearings in the torque", ("N m", 1.0), 1, (RIG,)),
    Kind("mass_per_length", "mass per length of the belt", PERCENT, 1, (RIG,)),
    Kind("arc", "contact arc, all settings together", DEGREE, 1, (RIG,)),
    Kind("arc_setting", "contact arc, each setting", DEGREE, ARCS, (RIG,)),
    Kind("pulley_radius", "radius of the belt's centreline", PERCENT, 1, (RIG,)),
    Kind("pulley_speed", "speed of the pulley", PERCENT, 1, (RIG,)),
    Kind("span_length", "length of the spans", MILLIMETRE, 1, (MODEL, SPANS)),
    Kind("bending_stiffness", "bending stiffness of the belt", PERCENT, 1, (MODEL, SPANS)),
    Kind("axial_stiffness", "axial stiffness of the belt", PERCENT, 1, (MODEL, DRIVE)),
    Kind("initial_tension", "belt tension at rest", PERCENT, 1, (DRIVE,)),
    Kind("torque", "torque", PERCENT, 1, (DRIVE,)),
    Kind("drive_radius", "radius of each pulley", PERCENT, PULLEYS, (DRIVE,)),
    Kind("drive_centres", "place of each pulley", MILLIMETRE, COORDINATES, (DRIVE,)),
    Kind("press_force", "force of the press", PERCENT, 1, (PRESS,)),
    Kind("press_displacement", "travel of the press", PERCENT, 1, (PRESS,)),
    Kind("press_law", "contact law in service against the press", PERCENT, 1, (PRESS,)),
    Kind("segment_length", "length of the pressed segment", PERCENT, 1, (PRESS,)),
    Kind("machine_compliance", "compliance of the press", ("mm/N", 1.0e-3), 1, (PRESS,)),
)
"""All errors that can be stated."""

REDUCTION_SOURCES: Final = (
    ("shared_tail", "shape of the tail"),
    ("shared_drift", "common drift"),
    ("shared_cells", "cells as seen at rest"),
)
"""Key and name of errors that the reduction of all runs shares; their sizes are in the runs."""
ARC, ORDER, COURSE = "arc_effect", "order_effect", "course_effect"
TEMPERATURE = "temperature_effect"
EFFECT_SOURCES: Final = {
    ARC: "differences between arcs",
    ORDER: "change over the campaign",
    COURSE: "change over the campaign",
    TEMPERATURE: "temperature of the runs",
}
"""Key and name of effects that shift the friction in addition to the surface."""
BETWEEN_SPEEDS: Final = "between_speeds"


@dataclass(frozen=True, slots=True)
class StandardUncertainties:
    """Standard uncertainties (k = 1) of the calibrations and settings of the benches.

    Parameters
    ----------
    sizes : mapping of str to float
        Size by the key of a kind, as a share or in SI units, >= 0; zero for those left out.
    stated : frozenset of str
        Keys that the user stated; the others are assumed.

    Raises
    ------
    InputError
        If a key is unknown or a size negative or not finite.
    """

    sizes: Mapping[str, float] = field(default_factory=dict)
    stated: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        known = {kind.error for kind in KINDS}
        problems = [
            f"uncertainty.{key} = {size!r}, must be >= 0 and finite"
            for key, size in self.sizes.items()
            if not 0.0 <= size < math.inf
        ]
        problems += [f"uncertainty.{key}: no such error" for key in self.sizes if key not in known]
        if problems:
            raise InputError(problems)

    def __getitem__(self, error: str) -> float:
        return self.sizes.get(error, 0.0)


@dataclass(frozen=True, slots=True)
class Source:
    """One unknown error."""

    name: str  # name in words; sources of the same name are of the same kind (both cells, all arcs)
    error: str  # its key in :class:`Errors`
    place: int = 0  # its index there: which arc, which cell, which direction
    size: float = 1.0  # standard uncertainty, as a share or in SI units
    unit: str = "1"  # unit for display
    per_unit: float = 1.0  # size of that unit in SI
    basis: str = FITTED
    """"stated" in the config, "assumed" (default of the config), or "fitted" to the data."""

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


def changes_by(sources: Sequence[Source], result: Callable[[Errors], Array]) -> Array:
    """Compute the change of a result by one standard uncertainty of each source.

    Parameters
    ----------
    sources : sequence of Source
        The K errors.
    result : callable
        The result (...) with errors corrected.

    Returns
    -------
    ndarray, shape (..., K)
        With its sign: correlations follow from products of the columns.
    """
    nominal = np.asarray(result(Errors()))
    columns = [result(Errors.single(source)) - nominal for source in sources]
    return np.stack([*columns, nominal], axis=-1)[..., :-1]


def rig_sources(u: StandardUncertainties, n_arcs: int, *, bent: bool = False) -> tuple[Source, ...]:
    """Return the sources of the friction rig in Eqs. (6) to (8), without those of zero size.

    `bent` states whether the measured force depends on bending of the spans, as a hub force does.
    """
    return (*_stated(u, RIG, {ARCS: n_arcs}), *(_stated(u, SPANS, {}) if bent else ()))


def press_sources(u: StandardUncertainties, law_scatter: bool = False) -> tuple[Source, ...]:
    """Return the sources of the contact law.

    `law_scatter` states whether the covariance of its two coefficients is known. All runs use the
    same law, so its scatter is an error that they share.
    """
    words = "contact law, scatter of the press"
    return (*(Source(words, "law", k) for k in range(2 * law_scatter)), *_stated(u, PRESS, {}))


def all_sources(
    u: StandardUncertainties, n_arcs: int, law_scatter: bool = True
) -> tuple[Source, ...]:
    """Return the sources of a surface that was built with the simulated rig."""
    return (*rig_sources(u, n_arcs), *_stated(u, MODEL, {}), *press_sources(u, law_scatter))


def drive_sources(
    u: StandardUncertainties, n_pulleys: int, law_scatter: bool
) -> tuple[Source, ...]:
    """Return the sources of a predicted drive, without the scatter of its friction surface.

    The places of ``drive_centres`` are the abscissae of all pulleys, then their ordinates.
    """
    counts = {PULLEYS: n_pulleys, COORDINATES: 2 * n_pulleys}
    return (*_stated(u, DRIVE, counts), *press_sources(u, law_scatter))


def bending_source() -> Source:
    """Return the source for the bending stiffness that a string has not, of unit size."""
    return Source("string without bending stiffness", "without_bending")


def slower_source() -> Source:
    """Return the source for friction at sliding speeds below those measured, of unit size."""
    words = "friction slower than the slowest measured sliding"
    return Source(words, "slower_friction", basis=ASSUMED)


def between_speeds_source(place: int) -> Source:
    """Return the source for friction interpolated to a speed that was left out, of unit size."""
    return Source("interpolation between the speeds", BETWEEN_SPEEDS, place)


def reduction_sources(columns: Mapping[str, Array]) -> tuple[Source, ...]:
    """Return the sources of the reduction that runs have columns for; each of unit size."""
    return tuple(
        Source(words, key)
        for key, words in REDUCTION_SOURCES
        if key in columns and np.any(columns[key])
    )


def effect_sources(key: str, size: float, count: int) -> tuple[Source, ...]:
    """Return the sources of an effect; `size` is the standard deviation that the runs show."""
    places = range(count if size > 0.0 else 0)
    return tuple(Source(EFFECT_SOURCES[key], key, k, size, *PERCENT) for k in places)


def sources_of(stored: Sequence[Mapping[str, Any]]) -> tuple[Source, ...]:
    """Read sources of error from metadata."""
    return tuple(Source(**{name: row[name] for name in Source.__slots__}) for row in stored)


def with_rig_sources(stored: Sequence[Source], given: Sequence[Source]) -> tuple[Source, ...]:
    """Return the sources stored with a surface, then the given ones that it lacks."""
    there = {(source.error, source.place) for source in stored}
    return (*stored, *(s for s in given if (s.error, s.place) not in there))


def _stated(u: StandardUncertainties, result: str, counts: Mapping[str, int]) -> tuple[Source, ...]:
    """List the errors that change a result, by the number of arcs, pulleys, coordinates."""
    return tuple(
        Source(kind.name, kind.error, k, size, *kind.unit, STATED if is_stated else ASSUMED)
        for kind in KINDS
        if result in kind.results and (size := u[kind.error]) > 0.0
        for is_stated in [kind.error in u.stated]
        for k in range(kind.places if isinstance(kind.places, int) else counts[kind.places])
    )
