"""Write input for programs with an input language: MBDyn, Adams, Abaqus."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.export import compiled_text
from beltid.export.choices import Choices, Export
from beltid.export.law import ContactLaw, ribbed_width
from beltid.export.preamble import commented, identifier, preamble
from beltid.export.reduction import (
    between_nodes,
    between_penetrations,
    friction_table,
    penetration_nodes,
)

Array = NDArray[np.float64]

FORCE_SPLINE = 1001
FRICTION_SPLINE = 1002
FEWEST_POINTS = 4
"""Smallest number of spline points that Adams and RecurDyn accept."""


def mbdyn(law: ContactLaw, choices: Choices) -> Export:
    """Write line force as an MBDyn scalar function, and the whole law as a drive caller module."""
    name = identifier(law.belt.name)
    delta = penetration_nodes(law)
    lines = preamble(
        law,
        "MBDyn",
        [
            f'Holds: "{name}_line_force", line force [N/m] over penetration [m], 0 while open, '
            "extrapolated linearly beyond the table. "
            f"{between_penetrations(law)} Friction is in module-{name}.cc.",
            "Use: multiply the line force by the length of belt of a contact point, such as "
            f'scalar function: "F", mul, "length", "{name}_line_force"; with "length" a const '
            'function, in a constitutive law "scalar function elastic".',
        ],
    )
    text = commented("#", lines) + _mbdyn_function(
        f"{name}_line_force", np.r_[-1.0, delta], np.r_[0.0, _force(law, delta)]
    )
    return Export({f"{name}.mbd": text.encode("ascii"), **compiled_text.mbdyn(law)})


def adams(law: ContactLaw, choices: Choices) -> Export:
    """Write Adams splines, as solver statements (.adm) and as Adams View commands (.cmd)."""
    name, units = identifier(law.belt.name), choices.units
    table = friction_table(law.surface).with_nodes(FEWEST_POINTS)
    delta = penetration_nodes(law)
    x = delta * units.metre, _force(law, delta) * units.newton_per_metre
    f, v = table.normal_force_N_m * units.newton_per_metre, table.slip_speed_m_s * units.metre
    mu = table.mu
    lines = preamble(
        law,
        "Adams",
        [
            f"Holds: spline {FORCE_SPLINE}, line force [{units.line_force}] over penetration "
            f"[{units.length}]; spline {FRICTION_SPLINE}, mu over sliding speed x "
            f"[{units.speed}] and line force z [{units.line_force}].",
            f"Use: AKISPL(MAX(0,penetration),0,{FORCE_SPLINE}) times the length of belt of a "
            f"contact point; AKISPL(MAX({_g(v[0])},MIN({_g(v[-1])},ABS(v))),"
            f"MAX({_g(f[0])},MIN({_g(f[-1])},f_N)),{FRICTION_SPLINE}). Keep MAX and MIN: Adams "
            "extrapolates splines, and mu is unknown outside. Paste the .adm into a dataset before "
            "END, or read the .cmd into Adams View, with your model in place of .MODEL_1.",
            between_nodes(law, table),
        ],
        units,
    )
    adm = commented("!", lines) + "".join(
        (
            _adm_spline(FORCE_SPLINE, x[0], [x[1]]),
            _adm_spline(FRICTION_SPLINE, v, [np.r_[z, row] for z, row in zip(f, mu, strict=True)]),
        )
    )
    cmd = commented("!", lines) + "".join(
        (
            _cmd_spline(f"{name}_line_force", FORCE_SPLINE, {"x": x[0], "y": x[1]}),
            _cmd_spline(f"{name}_mu", FRICTION_SPLINE, {"x": v, "y": mu.ravel(), "z": f}),
        )
    )
    files = {f"{name}.adm": adm.encode("ascii"), f"{name}.cmd": cmd.encode("ascii")}
    return Export(files | compiled_text.cffsub(law), table.reductions)


def abaqus(law: ContactLaw, choices: Choices) -> Export:
    """Write an Abaqus surface interaction: friction by slip rate and pressure, overclosure table.

    Raises
    ------
    InputError
        If the width of the belt is unknown: pressure is line force over width.
    """
    name, units = identifier(law.belt.name), choices.units
    width = law.belt.width_m or ribbed_width(law.belt.type, law.belt.ribs)
    if width is None:
        raise InputError(
            f"{law.belt.name}: Abaqus needs the contact pressure, which is the line force over "
            "the width of the belt; give a config with --config that states belt.width_m, or "
            "belt.type with the profile (such as 5PK) and belt.ribs",
        )
    table = friction_table(law.surface)
    delta = penetration_nodes(law)
    pressure = table.normal_force_N_m / width * units.pascal
    lines = preamble(
        law,
        "Abaqus",
        [
            f"Width of the belt: {width * units.metre:.6g} {units.length}. Contact pressure "
            f"[{units.pressure}] is the line force over it.",
            "Holds: pressure over overclosure, and mu by slip rate and contact pressure. Abaqus "
            "interpolates linearly and takes the nearest value outside, as required.",
            f"Use: *INCLUDE this file, and name {name.upper()} in *CONTACT PAIR. Rate-dependent "
            "friction needs a step in time (dynamic, or steady-state transport).",
            between_nodes(law, table),
        ],
        units,
    )
    overclosure = zip(_force(law, delta) / width * units.pascal, delta * units.metre, strict=True)
    friction = (
        (mu, speed, p)
        for p, row in zip(pressure, table.mu, strict=True)
        for speed, mu in zip(table.slip_speed_m_s * units.metre, row, strict=True)
    )
    text = (
        commented("**", lines)
        + f"*SURFACE INTERACTION, NAME={name.upper()}\n"
        + "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=TABULAR\n"
        + _rows(overclosure)
        + "*FRICTION\n"
        + _rows(friction)
    )
    return Export({f"{name}_abaqus.inp": text.encode("ascii")}, table.reductions)


def _force(law: ContactLaw, delta: Array) -> Array:
    return law.normal_law.force(delta)


def _g(value: float) -> str:
    return f"{value:.9g}"


def _mbdyn_function(name: str, x: Array, y: Array) -> str:
    pairs = ",\n".join(f"\t{_g(a)}, {_g(b)}" for a, b in zip(x, y, strict=True))
    return f'scalar function: "{name}", multilinear,\n{pairs};\n'


def _adm_spline(number: int, x: Array, rows: Sequence[Array]) -> str:
    lines = [f"SPLINE/{number}", *_statement("X", x)]
    for row in rows:
        lines += _statement("Y", row)
    return "\n".join(lines) + "\n"


def _sixes(values: Array) -> list[Array]:
    return np.split(values, range(6, values.size, 6))


def _statement(key: str, values: Array) -> Iterator[str]:
    """Yield the lines of a ``, KEY=a,b,...`` statement in the solver's language."""
    for i, part in enumerate(_sixes(values)):
        start = f", {key}=" if i == 0 else ", "
        yield start + ",".join(_g(value) for value in part)


def _cmd_spline(name: str, number: int, axes: dict[str, Array]) -> str:
    lines = [f"spline_name = .MODEL_1.{name}", f"adams_id = {number}"]
    for key, values in axes.items():
        parts = [", ".join(_g(value) for value in part) for part in _sixes(values)]
        lines.append(f"{key} = " + ", &\n      ".join(parts))
    lines.append("linear_extrapolate = no")
    return "data_element create spline &\n   " + " &\n   ".join(lines) + "\n"


def _rows(rows: Iterable[tuple[float, ...]]) -> str:
    return "".join(", ".join(_g(float(value)) for value in row) + "\n" for row in rows)
