"""Write the whole law as C and Fortran functions.

The functions evaluate the same polynomials as the surface and agree with it to rounding; they need
only the mathematics library of their language.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib.resources import files
from string import Template
from typing import Final

from beltid.export.choices import Choices, Export
from beltid.export.law import ContactLaw
from beltid.export.preamble import commented, identifier, preamble

PER_LINE: Final = 4
EXACT: Final = "The functions are the law itself, to rounding; nothing is reduced."


def c(law: ContactLaw, choices: Choices) -> Export:
    """Write C99 functions: line force, friction coefficient, friction."""
    name = identifier(law.belt.name)
    own = [
        f"Holds: {name}_line_force, {name}_mu and {name}_friction, in SI units.",
        f"Use: compile {name}_law.c (C99, needs only the math library), include {name}_law.h.",
        EXACT,
    ]
    files = ("law.c", "law.h")
    return Export({f"{name}_{file}": _written(law, "C", own, file, "//") for file in files})


def fortran(law: ContactLaw, choices: Choices) -> Export:
    """Write the same functions in Fortran 2003, with the names of C."""
    name = identifier(law.belt.name)
    own = [
        f"Holds: module {name}_law with {name}_line_force, {name}_mu and {name}_friction, "
        "in SI units; they have the names and arguments of the C functions.",
        f"Use: compile {name}_law.f90 (Fortran 2003) and write: use {name}_law.",
        EXACT,
    ]
    return Export({f"{name}_law.f90": _written(law, "Fortran", own, "law.f90", "!")})


def _written(law: ContactLaw, target: str, own: Sequence[str], template: str, sign: str) -> bytes:
    """Compose a source file: the comment, and the template with the numbers of the law."""
    folder = files("beltid.export") / "templates"
    text = Template((folder / f"{template}.txt").read_text("utf-8"))
    values = _fortran_values(law) if template.endswith("f90") else _c_values(law)
    name = identifier(law.belt.name)
    source = text.substitute(values, name=name, guard=f"{name.upper()}_LAW_H")
    return (commented(sign, preamble(law, target, own)) + "\n" + source).encode("ascii")


def _values(law: ContactLaw) -> dict[str, str]:
    part, patches = law.friction, law.surface.tables().C
    mu = [cell for row in part.mu for cell in row]
    return {
        "n_forces": str(len(part.x_nodes)),
        "n_speeds": str(len(part.y_nodes)),
        "force_cells": str(patches.shape[0]),
        "speed_cells": str(patches.shape[1]),
        "k_linear": repr(law.normal.k_linear_N_m2),
        "k_quadratic": repr(law.normal.k_quadratic_N_m3),
        "mu_min": repr(min(mu)),
        "mu_max": repr(max(mu)),
        # an axis with a single node is never looked up
        "f_ref": repr(part.f_ref_N_m or 1.0),
        "v_ref": repr(part.v_ref_m_s or 1.0),
    }


def _c_values(law: ContactLaw) -> dict[str, str]:
    part = law.friction
    rows = []
    for of_force in law.surface.tables().C.tolist():
        cells = ("{" + ", ".join(_braced(row) for row in cell) + "}" for cell in of_force)
        rows.append("    {" + ",\n     ".join(cells) + "},")
    return {
        **_values(law),
        "x_nodes": ",\n    ".join(_lines(part.x_nodes, "")),
        "y_nodes": ",\n    ".join(_lines(part.y_nodes, "")),
        "patches": "\n".join(rows),
    }


def _braced(row: Iterable[float]) -> str:
    return "{" + ", ".join(map(repr, row)) + "}"


def _fortran_values(law: ContactLaw) -> dict[str, str]:
    part = law.friction
    statements = []
    for i, of_force in enumerate(law.surface.tables().C.tolist(), start=1):
        for j, cell in enumerate(of_force, start=1):
            numbers = ", &\n    ".join(line for row in cell for line in _lines(row, "_dp"))
            statements.append(f"  data patches(:, :, {j}, {i}) / &\n    {numbers}/")
    return {
        **_values(law),
        "x_nodes": ", &\n    ".join(_lines(part.x_nodes, "_dp")),
        "y_nodes": ", &\n    ".join(_lines(part.y_nodes, "_dp")),
        "patches": "\n".join(statements),
    }


def _lines(values: Sequence[float], kind: str) -> list[str]:
    """Format numbers with the suffix of their kind, `PER_LINE` to a line."""
    return [
        ", ".join(f"{value!r}{kind}" for value in values[first : first + PER_LINE])
        for first in range(0, len(values), PER_LINE)
    ]
