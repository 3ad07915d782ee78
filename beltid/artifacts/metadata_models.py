"""What artifacts hold beside their columns, as far as anything relies on it.

A seal tells that an artifact is whole, not that beltid wrote it: whoever writes one by hand can
seal it. So what is read from its metadata is looked at here, when it is opened, and nowhere else.

A shape is a `Leaf`, a list of one shape (any number of such), a tuple (one shape each), a dict
(keys that must be there), or `Maybe` one of these (missing, or null).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from beltid.artifacts.arrow_columns import LARGEST

SHOWN: Final = 5
MOST_PLACES: Final = 10_000


@dataclass(frozen=True, slots=True)
class Leaf:
    """A plain value, with what it must be in words."""

    words: str
    fits: Callable[[Any], bool]


@dataclass(frozen=True, slots=True)
class Maybe:
    """Something that may be missing."""

    shape: Any


def _is_number(value: Any) -> bool:
    plain = isinstance(value, (int, float)) and not isinstance(value, bool)
    return plain and -LARGEST <= value <= LARGEST


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= 2**53


def _numbers(dimensions: int) -> Leaf:
    """Lists of numbers or nulls, nested so deep and of equal lengths."""

    def fits(value: Any) -> bool:
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError, OverflowError):
            return False
        return array.ndim == dimensions and not np.any(np.abs(array) > LARGEST)

    return Leaf(f"numbers in {dimensions} dimensions", fits)


TEXT: Final = Leaf("a text", lambda value: isinstance(value, str))
FLAG: Final = Leaf("true or false", lambda value: isinstance(value, bool))
NUMBER: Final = Leaf("a number", _is_number)
POSITIVE: Final = Leaf("a number > 0", lambda value: _is_number(value) and value > 0)
COUNT: Final = Leaf("a whole number >= 0", _is_count)
PLACE: Final = Leaf("a place", lambda value: _is_count(value) and value < MOST_PLACES)
MAYBE: Final = Maybe(NUMBER)
SPAN: Final = Maybe((MAYBE, MAYBE))

BUDGET: Final = [
    {
        "quantity": TEXT,
        "source": TEXT,
        "basis": TEXT,
        "unit": TEXT,
        "standard_uncertainty": MAYBE,
        "contribution_percent": MAYBE,
        "largest_percent": MAYBE,
    }
]
SOURCES: Final = [
    {
        "name": TEXT,
        "error": TEXT,
        "place": PLACE,
        "size": NUMBER,
        "unit": TEXT,
        "per_unit": NUMBER,
        "basis": TEXT,
    }
]
PARAMETERS: Final = [{"name": TEXT, "value": NUMBER, "se": MAYBE, "unit": TEXT}]
NORMAL_LAW: Final = {
    "law": TEXT,
    "parameters": PARAMETERS,
    "rms_residual_N_m": MAYBE,
    "criterion": MAYBE,
    "cv_error_N_m": MAYBE,
    "cv_ratio": MAYBE,
    "largest_difference": MAYBE,
    "note": Maybe(TEXT),
}
FRICTION_LAW: Final = {
    "law": TEXT,
    "parameters": PARAMETERS,
    "rms_misfit": MAYBE,
    "worst_misfit": MAYBE,
    "criterion": MAYBE,
    "formula": TEXT,
}
SHOWN_OF_SOLVER: Final = (
    "elements",
    "steps",
    "newton_iterations",
    "status_changes",
    "halvings",
    "residual",
    "slip_m",
    "cone",
)
SOLVER: Final = dict.fromkeys(SHOWN_OF_SOLVER, MAYBE) | {
    "clamped_lookups": NUMBER,
    "lookups": NUMBER,
}
RUN: Final = {
    "status": TEXT,
    "arc_deg": NUMBER,
    "pulley_speed_rad_s": NUMBER,
    "mu": MAYBE,
    "normal_force_N_m": MAYBE,
    "run": Maybe(TEXT),
    "initial_tension_N": MAYBE,
    "solver": Maybe(SOLVER),
}
MISFIT: Final = {
    "group": TEXT,
    "runs": COUNT,
    "rms_before_percent": MAYBE,
    "mean_before_percent": MAYBE,
    "rms_after_percent": MAYBE,
    "mean_after_percent": MAYBE,
}
STATISTICS: Final = {
    "group": TEXT,
    "n_points": COUNT,
    "rms_percent": MAYBE,
    "mean_percent": MAYBE,
    "largest_percent": MAYBE,
    "force_low_N_m": MAYBE,
    "force_high_N_m": MAYBE,
}
AVERAGED: Final = dict.fromkeys(
    (
        "normal_force_N_m",
        "mu_measured",
        "mu_simulated",
        "nominal_tension_N",
        "pulley_speed_rad_s",
    ),
    MAYBE,
)
COMMON: Final = {
    "config": Maybe(TEXT),
    "origin": Maybe(TEXT),
    "method": TEXT,
    "notes": [TEXT],
    "warnings": [TEXT],
    "budget": BUDGET,
}
EXTRA: Final[dict[str, dict[str, Any]]] = {
    "stiffness": {
        "law_choice": Maybe({"laws": [NORMAL_LAW]}),
        "dissipation": Maybe({"C_P_N_s_m": MAYBE}),
        "temperature": {"matters": Maybe(FLAG)},
    },
    "slip": {"rig_speeds": Maybe({"statement": Maybe(TEXT)})},
    "surface": {
        "friction_laws": Maybe({"laws": [FRICTION_LAW]}),
        "uncertainty": Maybe({"sources": SOURCES, "arcs_deg": [POSITIVE]}),
        "rms_arc_spread": MAYBE,
        "arc_spread_before": MAYBE,
        "misfit": [MISFIT],
        "monte_carlo": Maybe(
            {"replicates": COUNT, "seed": COUNT, "table": [{}], "linear_fails_at": [{}]}
        ),
    },
    "simulated": {
        "runs": [RUN],
        "uncertainty": Maybe(
            {
                "sources": SOURCES,
                "runs": [TEXT],
                "simulated": _numbers(2),
                "difference": _numbers(2),
                "scatter": _numbers(1),
                "numerical": _numbers(1),
                "by_setting": _numbers(2),
            }
        ),
    },
    "drive": {
        "n_failed": COUNT,
        "loaded_pulley": Maybe(TEXT),
        "slip_limits": [
            {
                "driver_speed_rad_s": NUMBER,
                "initial_tension_N": NUMBER,
                "largest_torque_N_m": NUMBER,
                "adhesion_ends_N_m": MAYBE,
                "slip_limit_N_m": MAYBE,
            }
        ],
    },
    "compare_drive": {
        "passed": FLAG,
        "rms_relative_error": MAYBE,
        "rms_over_uncertainty": MAYBE,
        "max_rms_relative_error": NUMBER,
        "n_judged": COUNT,
        "n_asked": COUNT,
    },
    "compare": {
        "passed": FLAG,
        "statistics": [STATISTICS],
        "averaged": [AVERAGED],
        "judged": [{"tolerance": TEXT, "found": MAYBE, "allowed": NUMBER, "holds": FLAG}],
        "validation": {"n": COUNT, "within_2u": COUNT, "rms_e_over_u": MAYBE, "inputs_known": FLAG},
    },
}
"""Kind -> shapes of figures of their own; any of them may be missing in an older artifact."""
SETTINGS: Final = {
    "rig.pulley_radius_m": Maybe(POSITIVE),
    "rig.pulley_speeds_rad_s": Maybe([NUMBER]),
    "friction": {},
}


def wrong_contents(kind: str, record: Mapping[str, Any]) -> list[str]:
    """What is wrong with the contents of an artifact: place, found, allowed; the first few.

    Parameters
    ----------
    kind : str
        Its kind.
    record : mapping
        Its metadata.
    """
    found = itertools.chain(
        _wrong_sections(record["extra"], COMMON | EXTRA.get(kind, {}), "extra"),
        _wrong_sections(record["settings"], SETTINGS, "settings"),
        _wrong_sections(record["validity"], dict.fromkeys(record["validity"], SPAN), "validity"),
        _wrong_sizes(kind, record["extra"]),
    )
    return list(itertools.islice(found, SHOWN))


def _wrong_sections(
    found: Mapping[str, Any], shapes: Mapping[str, Any], name: str
) -> Iterator[str]:
    for key, shape in shapes.items():
        if key in found:
            yield from _wrong(found[key], shape, f"{name}.{key}")


def _wrong(value: Any, shape: Any, place: str) -> Iterator[str]:
    if isinstance(shape, Maybe):
        if value is not None:
            yield from _wrong(value, shape.shape, place)
    elif isinstance(shape, Leaf):
        if not shape.fits(value):
            yield f"{place} = {_shown(value)}, must be {shape.words}"
    elif isinstance(shape, dict):
        if not isinstance(value, dict):
            yield f"{place} = {_shown(value)}, must be a section"
            return
        for key, inner in shape.items():
            if key in value:
                yield from _wrong(value[key], inner, f"{place}.{key}")
            elif not isinstance(inner, Maybe):
                yield f"{place}.{key} is missing"
    elif not isinstance(value, list):
        yield f"{place} = {_shown(value)}, must be a list"
    elif isinstance(shape, tuple) and len(value) != len(shape):
        yield f"{place} holds {len(value)} values, must hold {len(shape)}"
    else:
        inner = shape if isinstance(shape, tuple) else itertools.repeat(shape[0])
        for i, (item, one) in enumerate(zip(value, inner, strict=False)):
            yield from _wrong(item, one, f"{place}[{i}]")


def _shown(value: Any) -> str:
    return repr(value)[:60]


def _wrong_sizes(kind: str, extra: Mapping[str, Any]) -> Iterator[str]:
    """Figures that do not go together; their shapes may be wrong, which was told before."""
    if kind != "simulated":
        return
    try:
        runs, doubt = extra.get("runs"), extra.get("uncertainty")
        for i, run in enumerate(runs or ()):
            known = [run[name] for name in ("mu", "normal_force_N_m")]
            if run["status"] == "ok" and not all(_is_number(v) and v > 0.0 for v in known):
                yield f"extra.runs[{i}] is ok, but without mu and normal_force_N_m > 0"
        if runs is not None and not any(run["status"] == "ok" for run in runs):
            yield "extra.runs: none is ok"
        if not doubt:
            return
        n, k = len(doubt["runs"]), len(doubt["sources"])
        for name, shape in (
            ("simulated", (n, k)),
            ("difference", (n, k)),
            ("scatter", (n,)),
            ("numerical", (n,)),
            ("by_setting", (n, 2)),
        ):
            found = np.array(doubt[name], dtype=float).shape
            if found != shape:
                yield f"extra.uncertainty.{name} has the shape {found}, must have {shape}"
    except (TypeError, ValueError, KeyError, AttributeError, OverflowError):
        return
