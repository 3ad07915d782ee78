"""Write Python modules with the whole law as functions: for numpy alone, and for Exudyn."""

from __future__ import annotations

from importlib.resources import files
from string import Template

from beltid.export.choices import Choices, Export
from beltid.export.law import ContactLaw
from beltid.export.preamble import commented, identifier, preamble
from beltid.export.reduction import (
    constant_deviation,
    linear_normal_deviation,
    linear_stiffness,
)

LINEAR = "linear normal law"
CONSTANT = "constant mu"
CODING = "# -*- coding: utf-8 -*-\n"
"""First line of a module: no comment below it can name another encoding."""


def python(law: ContactLaw, choices: Choices) -> Export:
    """Write a module that needs numpy alone."""
    lines = preamble(
        law,
        "Python with numpy",
        [
            "Use: line_force(), penetration() and mu() are the whole law, of numbers or arrays; "
            "contact_force() is both at a contact point, for any program that takes forces.",
        ],
    )
    return Export({f"{identifier(law.belt.name)}_law.py": _module(law, lines, "python")})


def exudyn(law: ContactLaw, choices: Choices) -> Export:
    """Write a module that creates ObjectContactFrictionCircleCable2D and updates it to the law."""
    point = choices.point
    force, speed = point.normal_force_N_m, point.slip_speed_m_s
    reductions = {
        LINEAR: linear_normal_deviation(law, point),
        CONSTANT: constant_deviation(law.surface, point),
    }
    lines = preamble(
        law,
        "Exudyn (ObjectContactFrictionCircleCable2D)",
        [
            "Use: contact = add_contact(mbs, rim_marker, cable, length, radius, "
            "frictionVelocityPenalty=..., frictionStiffness=...) for every cable element that may "
            "touch the pulley.",
            "The object holds a linear normal law and a constant friction coefficient. Both are "
            f"exact at {point}: stiffness {linear_stiffness(law, point):.5g} N/m^2, mu "
            f"{float(law.surface.mu(force, speed)):.5g}. Over the range of mu the linear force "
            f"is off by {reductions[LINEAR]}, the constant mu by {reductions[CONSTANT]}.",
            "update_contacts(mbs, contacts, slip_speed) removes these reductions: called between "
            "solutions or before each step, it gives every element the stiffness and friction of "
            "the whole law at its state. What remains is one value per element.",
            "line_force(), penetration() and mu() are the whole law.",
        ],
    )
    source = _module(law, lines, "exudyn", normal_force=repr(force), slip_speed=repr(speed))
    return Export({f"{identifier(law.belt.name)}_exudyn.py": source}, reductions)


def _module(law: ContactLaw, lines: list[str], target: str, **values: str) -> bytes:
    """Compose the source of a module: comment, law with its numbers, functions for the target."""
    part, surface = law.friction, law.surface
    folder = files("beltid.export") / "templates"
    patches = surface.tables().C
    text = "".join((folder / f"{name}.txt").read_text("utf-8") for name in ("law", target))
    source = Template(text).substitute(
        values,
        synthetic=law.synthetic,
        k_linear=repr(law.normal.k_linear_N_m2),
        k_quadratic=repr(law.normal.k_quadratic_N_m3),
        force_range=repr(law.validity.measured_force_N_m),
        speed_range=repr(law.validity.slip_speed_m_s),
        f_ref='float("inf")' if part.f_ref_N_m is None else repr(part.f_ref_N_m),
        v_ref='float("inf")' if part.v_ref_m_s is None else repr(part.v_ref_m_s),
        x_nodes=_listed(part.x_nodes),
        y_nodes=_listed(part.y_nodes),
        patches=_rows(patches.reshape(-1, 4).tolist()),
        shape=repr(patches.shape),
    )
    return (CODING + commented("#", lines) + "\n" + source).encode("ascii")


def _listed(values: tuple[float, ...]) -> str:
    rows = [", ".join(map(repr, values[i : i + 4])) for i in range(0, len(values), 4)]
    return "[\n    " + ",\n    ".join(rows) + ",\n]"


def _rows(rows: list[list[float]]) -> str:
    return "\n".join(f"        [{', '.join(map(repr, row))}]," for row in rows)
