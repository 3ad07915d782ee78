"""Table of the export targets by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from beltid.export import compiled_text, python_text, table_text
from beltid.export.choices import Choices, Export
from beltid.export.law import ContactLaw
from beltid.export.law_file import SUFFIX, law_text

EVERYTHING: Final = "everything"
"""Value of `Target.holds` for the whole law."""


@dataclass(frozen=True, slots=True)
class Target:
    """A program or format.

    Attributes
    ----------
    name : str
        Name on the command line.
    title : str
        Description for the user.
    holds : str
        Part of the law that it represents.
    write : callable
        Function from law and choices to files.
    in_units : bool
        Whether its files can be in millimetres.
    """

    name: str
    title: str
    holds: str
    write: Callable[[ContactLaw, Choices], Export]
    in_units: bool = False


def _json(law: ContactLaw, choices: Choices) -> Export:
    return Export({f"{law.belt.name}{SUFFIX}": law_text(law).encode()})


TARGETS: Final = {
    target.name: target
    for target in (
        Target("json", "contact law of beltid, an open text file", EVERYTHING, _json),
        Target(
            "exudyn",
            "Exudyn: Python module for ObjectContactFrictionCircleCable2D",
            "linear stiffness, constant mu; all of it by update_contacts()",
            python_text.exudyn,
        ),
        Target("python", "Python: functions, needs numpy", EVERYTHING, python_text.python),
        Target("c", "C: functions, no library needed", EVERYTHING, compiled_text.c),
        Target("fortran", "Fortran 2003: the same", EVERYTHING, compiled_text.fortran),
        Target(
            "adams",
            "Adams: splines, .adm and .cmd",
            EVERYTHING,
            table_text.adams,
            True,
        ),
        Target("modelica", "Modelica: CombiTable1D and 2D", EVERYTHING, table_text.modelica),
        Target("matlab", "MATLAB: MAT-file", EVERYTHING, table_text.matlab),
        Target("csv", "CSV: plain grids", EVERYTHING, table_text.csv),
    )
}
