"""Sources of error with their standard uncertainties, and the propagation of each to a result.

A source is one number that is wrong by an unknown amount *for all runs that share it*: the
calibration of the cells for all runs, the setting of an arc for the runs at that arc, the law of
the press for the whole surface. Many runs do not average it out. Noise of the samples is no source;
it is in the standard error of each run. Sign: an error is the true value minus the value used,
relative to it or in its unit. A budget adds all contributions in squares (JCGM 100).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from beltid.arrays import Array
from beltid.laws.friction_surface import FrictionSurface

STATED, ASSUMED, FITTED = "stated", "assumed", "fitted"
PERCENT, DEGREE = ("%", 0.01), ("deg", math.pi / 180.0)
NEWTON, MILLIMETRE = ("N", 1.0), ("mm", 1.0e-3)
LEAST_PERCENT = 1.0e-6  # of a contribution that is listed

RIG, BENT, MODEL, PRESS, DRIVE = "rig", "bent spans", "model", "press", "drive"
SURFACE = (RIG, MODEL, PRESS)  # what changes a surface that is built with the simulated rig
LAW = "law"
ARCS, PULLEYS, COORDINATES = "arcs", "pulleys", "coordinates"


class Kind(NamedTuple):
    """A kind of error that a user can state."""

    error: str  # its key in the section ``uncertainty`` of a config, without the unit
    name: str
    unit: tuple[str, float]  # for display, and its size in SI
    places: int | str  # how many such errors there are, a number or what they are counted by
    results: tuple[str, ...]
    """What they change: the runs by Eqs. (6) to (8), the direction of bent spans, the simulated
    rig, the contact law, a drive."""


KINDS = (
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
    Kind("span_length", "length of the spans", MILLIMETRE, 1, (MODEL, BENT)),
    Kind("bending_stiffness", "bending stiffness of the belt", PERCENT, 1, (MODEL, BENT)),
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

REDUCTION_SOURCES = {
    "shared_tail": "shape of the tail",
    "shared_drift": "common drift",
    "shared_cells": "cells as seen at rest",
}
"""Key and name of errors that the reduction of all runs shares; their sizes are in the runs."""
ARC, ORDER, COURSE = "arc_effect", "order_effect", "course_effect"
TEMPERATURE = "temperature_effect"
EFFECT_SOURCES = {
    ARC: "differences between arcs",
    ORDER: "change over the campaign",
    COURSE: "change over the campaign",
    TEMPERATURE: "temperature of the runs",
}
"""Key and name of effects that shift the friction in addition to the surface."""


StandardUncertainties = Mapping[str, tuple[float, str]]
"""Standard uncertainty (k = 1) by the key of a kind, as a share or in SI units, zero for those left
out; and whether it is stated or assumed."""


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
    def key(self) -> tuple[str, int]:
        """Which error it is, in :class:`Errors`."""
        return self.error, self.place

    @property
    def shown(self) -> float:
        """Standard uncertainty in the unit for display."""
        return self.size / self.per_unit


class Errors(dict[tuple[str, int], float]):
    """One realisation of all errors, by key and place of the source; the others are zero."""

    def at(self, error: str, place: int = 0) -> float:
        """Return the error of one source."""
        return self.get((error, place), 0.0)


def changes_by(sources: Sequence[Source], result: Callable[[Errors], Array]) -> Array:
    """Compute the change of a result (...) by one standard uncertainty of each source (..., K).

    `result` returns it with errors corrected. With their signs: correlations follow from products
    of the columns.
    """
    nominal = np.asarray(result(Errors()))
    columns = [result(Errors({source.key: source.size})) - nominal for source in sources]
    return np.stack([*columns, nominal], axis=-1)[..., :-1]


def stated_sources(
    u: StandardUncertainties,
    results: Sequence[str],
    n_arcs: int = 0,
    n_pulleys: int = 0,
) -> tuple[Source, ...]:
    """List the errors that change some results, in the order of the results.

    All runs use the same contact law, so that its scatter is an error that they share. The places
    of ``drive_centres`` are the abscissae of all pulleys, then their ordinates.
    """
    counts = {ARCS: n_arcs, PULLEYS: n_pulleys, COORDINATES: 2 * n_pulleys}
    sources = []
    for result in results:
        if result == PRESS:
            sources += [Source("contact law, scatter of the press", LAW, k) for k in (0, 1)]
        for kind in (kind for kind in KINDS if result in kind.results):
            size, basis = u.get(kind.error, (0.0, ASSUMED))
            n = kind.places if isinstance(kind.places, int) else counts[kind.places]
            shown = size, *kind.unit, basis
            sources += [Source(kind.name, kind.error, k, *shown) for k in range(n) if size > 0.0]
    return tuple(sources)


BETWEEN_SPEEDS = Source("interpolation between the speeds", "between_speeds")
BENDING = Source("string without bending stiffness", "without_bending")
SLOWER = Source(
    "friction slower than the slowest measured sliding", "slower_friction", basis=ASSUMED
)


def reduction_sources(columns: Mapping[str, Array]) -> tuple[Source, ...]:
    """Return the sources of the reduction that runs have columns for; each of unit size."""
    named = REDUCTION_SOURCES.items()
    return tuple(Source(name, key) for key, name in named if np.any(columns.get(key, 0.0)))


def effect_sources(key: str, size: float, count: int) -> tuple[Source, ...]:
    """Return the sources of an effect; `size` is the standard deviation that the runs show."""
    return tuple(Source(EFFECT_SOURCES[key], key, k, size, *PERCENT) for k in range(count))


def with_sources(stored: Sequence[Source], given: Sequence[Source]) -> tuple[Source, ...]:
    """Return the sources stored with a surface, then the given ones that it lacks."""
    there = {source.key for source in stored}
    return (*stored, *(source for source in given if source.key not in there))


def budget(
    quantity: str, sources: Sequence[Source], changes: Array, scatter: Mapping[str, Array]
) -> list[dict[str, Any]]:
    """Return the rows of the budget of a quantity, with the combined standard uncertainty last.

    The sources act on all values together; those of one name are one row. `changes` (n, K) are the
    relative changes of the n values by one standard uncertainty of each, `scatter` the relative
    standard uncertainties (n,) that vary from run to run or sample to sample; at least one.
    """
    total = np.sum(np.square([*changes.T, *scatter.values()]), axis=0)
    whole = float(np.mean(total))

    def row(source: str, acts_on: str, squares: Array, basis: str) -> dict[str, Any]:
        """Return a row from the squares (n,) of a contribution."""
        mean = float(np.mean(squares))
        return {
            "quantity": quantity,
            "source": source,
            "acts_on": acts_on,
            "basis": basis,
            "standard_uncertainty": None,
            "unit": "",
            "contribution_percent": 100.0 * math.sqrt(mean),
            "largest_percent": 100.0 * math.sqrt(float(np.max(squares))),
            "share_percent": 100.0 * mean / whole if whole > 0.0 else 0.0,
        }

    shared = []
    for name in dict.fromkeys(source.name for source in sources):
        of_name = [k for k, source in enumerate(sources) if source.name == name]
        source, squares = sources[of_name[0]], np.sum(np.square(changes[:, of_name]), axis=1)
        line = row(name, "all together", squares, source.basis)
        if source.basis != FITTED:
            line |= {"standard_uncertainty": source.shown, "unit": source.unit}
        shared.append(line)
    shared.sort(key=lambda line: -line["contribution_percent"])
    each = [row(name, "each run", np.square(u), FITTED) for name, u in scatter.items()]
    return [
        *(line for line in shared if line["largest_percent"] > LEAST_PERCENT),
        *(line for line in each if line["largest_percent"] > 0.0),
        row("combined", "", total, ""),
    ]


def factor_of(covariance: Array) -> Array:
    """Factor a covariance (n, n) as S S' with S (n, r); omit directions without variance."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > 1e-10 * values[-1]
    factor = vectors[:, kept] * np.sqrt(values[kept])
    # the sign of an eigenvector is arbitrary: fix it, so that all machines agree
    largest = np.take_along_axis(factor, np.argmax(np.abs(factor), axis=0)[None], axis=0)
    return np.ascontiguousarray((factor * np.sign(largest))[:, ::-1])


@dataclass(frozen=True, slots=True)
class SurfaceUncertainty:
    """Covariance of ln mu at the nodes of a surface by its causes."""

    surface: FrictionSurface  # with the factor of its covariance
    sources: Sequence[Source]  # errors that all nodes share
    arcs_deg: Array  # arc settings in the order in which the sources number them [deg]

    def stated_otherwise(self, stated: StandardUncertainties) -> list[str]:
        """List the sources whose size was different when the surface was fitted."""
        now = {s.key: s.size for s in stated_sources(stated, SURFACE, len(self.arcs_deg))}
        then = (source for source in self.sources if source.basis != FITTED)
        return list(dict.fromkeys(s.name for s in then if now.get(s.key, s.size) != s.size))

    @property
    def factor(self) -> Array:
        """Factor of the covariance of ln mu: a column per source, then scatter, (nf, nv, K + r)."""
        assert self.surface.factor is not None
        return self.surface.factor

    def columns(self, n_rows: int) -> dict[str, Array]:
        """Return ``mu_u`` and ``mu_factor`` of a table; the nodes are its first rows."""
        mu = self.surface.mu_nodes.ravel()
        rows = self.factor.reshape(mu.size, -1) if self.factor.size else np.zeros((mu.size, 1))
        table = np.column_stack([mu * np.sqrt(np.sum(np.square(rows), axis=1)), rows])
        table = np.pad(table, ((0, n_rows - mu.size), (0, 0)), constant_values=np.nan)
        return {"mu_u": table[:, 0], "mu_factor": table[:, 1:]}

    def extra(self, force_range: tuple[float, float]) -> dict[str, Any]:
        """Return the sources of the factor's columns, and the budget over a force range [N/m]."""
        f, (low, high) = self.surface.normal_force_N_m, force_range
        inside = (f >= low * (1.0 - 1e-9)) & (f <= high * (1.0 + 1e-9))
        inside |= not inside.any()
        rows = self.factor[inside].reshape(-1, self.factor.shape[-1])
        changes, scatter = np.split(rows, [len(self.sources)], axis=1)
        stored = {
            "sources": [asdict(source) for source in self.sources],
            "arcs_deg": self.arcs_deg,
            "budget_force_N_m": [low, high],
        }
        of_runs = {"scatter of the runs": np.linalg.norm(scatter, axis=1)}
        lines = budget("surface", self.sources, changes, of_runs)
        return {"uncertainty": stored, "budget": lines}
