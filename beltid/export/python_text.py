"""Write Python modules for Exudyn and Project Chrono, with the whole law as functions."""

from __future__ import annotations

from importlib.resources import files
from string import Template

from beltid.export.choices import Choices, Export
from beltid.export.law import ContactLaw
from beltid.export.preamble import commented, identifier, preamble
from beltid.export.reduction import (
    Deviation,
    constant_deviation,
    linear_normal_deviation,
    linear_stiffness,
)

LINEAR = "linear normal law"
CONSTANT = "constant mu"


def exudyn(law: ContactLaw, choices: Choices) -> Export:
    """Write a module that creates ObjectContactFrictionCircleCable2D and updates it to the law."""
    reductions = _reductions(law, choices)
    lines = preamble(
        law,
        "Exudyn (ObjectContactFrictionCircleCable2D)",
        [
            "Use: contact = add_contact(mbs, rim_marker, cable, length, radius, "
            "frictionVelocityPenalty=..., frictionStiffness=...) for every cable element that may "
            "touch the pulley.",
            "The object holds a linear normal law and a constant friction coefficient. "
            + _stated(law, choices, reductions),
            "update_contacts(mbs, contacts, slip_speed) removes these reductions: called between "
            "solutions or before each step, it gives every element the stiffness and friction of "
            "the whole law at its state. What remains is one value per element.",
            "line_force(), penetration() and mu() are the whole law.",
        ],
    )
    name = f"{identifier(law.belt.name)}_exudyn.py"
    return Export({name: _module(law, choices, lines, "exudyn")}, reductions)


def chrono(law: ContactLaw, choices: Choices) -> Export:
    """Write a module with a contact material of Chrono, and the force of the whole law."""
    reductions = _reductions(law, choices)
    lines = preamble(
        law,
        "Project Chrono (PyChrono)",
        [
            "Use: contact_material(chrono, contact_length) for the contact of Chrono itself, which "
            "holds a linear normal law and a constant friction coefficient. "
            + _stated(law, choices, reductions),
            "contact_force() is the whole law at a contact point, for a custom load. "
            "line_force(), penetration() and mu() are its parts.",
        ],
    )
    name = f"{identifier(law.belt.name)}_chrono.py"
    return Export({name: _module(law, choices, lines, "chrono")}, reductions)


def _reductions(law: ContactLaw, choices: Choices) -> dict[str, Deviation]:
    return {
        LINEAR: linear_normal_deviation(law, choices.point),
        CONSTANT: constant_deviation(law.surface, choices.point),
    }


def _stated(law: ContactLaw, choices: Choices, reductions: dict[str, Deviation]) -> str:
    return (
        f"Both are exact at {choices.point}: stiffness "
        f"{linear_stiffness(law, choices.point):.5g} N/m^2, mu "
        f"{float(law.surface.mu(choices.point.normal_force_N_m, choices.point.slip_speed_m_s)):.5g}"
        f". Over the measured range the linear force is off by {reductions[LINEAR]}, the "
        f"constant mu by {reductions[CONSTANT]}."
    )


def _module(law: ContactLaw, choices: Choices, lines: list[str], target: str) -> bytes:
    """Compose the source of a module: comment, law with its numbers, functions for the target."""
    part, surface = law.friction, law.surface
    folder = files("beltid.export") / "templates"
    patches = surface.tables().C
    text = Template((folder / "law.txt").read_text("utf-8")).substitute(
        synthetic=law.synthetic,
        k_linear=repr(law.normal.k_linear_N_m2),
        k_quadratic=repr(law.normal.k_quadratic_N_m3),
        normal_force=repr(choices.point.normal_force_N_m),
        slip_speed=repr(choices.point.slip_speed_m_s),
        force_range=_range(part.normal_force_N_m),
        speed_range=_range(part.slip_speed_m_s),
        f_ref='float("inf")' if part.f_ref_N_m is None else repr(part.f_ref_N_m),
        v_ref='float("inf")' if part.v_ref_m_s is None else repr(part.v_ref_m_s),
        x_nodes=_listed(part.x_nodes),
        y_nodes=_listed(part.y_nodes),
        patches=_rows(patches.reshape(-1, 4).tolist()),
        shape=repr(patches.shape),
    )
    own = (folder / f"{target}.txt").read_text("utf-8")
    return (commented("#", lines) + "\n" + text + own).encode("ascii")


def _range(nodes: tuple[float, ...]) -> str:
    if nodes == (0.0,):
        return '(0.0, float("inf"))'
    return f"({nodes[0]!r}, {nodes[-1]!r})"


def _listed(values: tuple[float, ...]) -> str:
    rows = [", ".join(map(repr, values[i : i + 4])) for i in range(0, len(values), 4)]
    return "[\n    " + ",\n    ".join(rows) + ",\n]"


def _rows(rows: list[list[float]]) -> str:
    return "\n".join(f"        [{', '.join(map(repr, row))}]," for row in rows)
