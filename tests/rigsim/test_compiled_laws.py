"""The compiled laws are the laws: the same numbers, to the last bit but for libm."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest

from beltid.laws import capstan, kelvin_voigt, penalty, surface_tables
from beltid.laws.friction_surface import FrictionSurface
from beltid.rigsim import compiled_laws
from beltid.rigsim.compiled import kernel

T = FrictionSurface(
    [900.0, 2600.0, 4300.0, 6600.0], [0.0025, 0.01, 0.04], np.linspace(0.8, 1.2, 12).reshape(4, 3)
).tables()


@pytest.mark.parametrize(
    ("module", "name", "arguments"),
    [
        (penalty, "elastic_force", (64e-6, 6.5e7, 3.0256e11)),
        (penalty, "elastic_stiffness", (64e-6, 6.5e7, 3.0256e11)),
        (penalty, "elastic_energy", (64e-6, 6.5e7, 3.0256e11)),
        (penalty, "integral_of_energy", (64e-6, 6.5e7, 3.0256e11)),
        (penalty, "dissipative_force", (-2e-3, 300.0)),
        (penalty, "dissipative_force", (2e-3, 300.0)),
        (capstan, "sliding_speed", (0.21, 0.05)),
        (kelvin_voigt, "section_force", (1.0e5, 2.7e-3, -3.0, 1.0e-4)),
        (surface_tables, "locate", (T.x_nodes, T.f_ref, 3100.0)),
        (surface_tables, "locate", (T.y_nodes, T.v_ref, 0.3)),
        (surface_tables, "evaluate_cell", (T.C, 1, 0, 0.3, 0.7)),
    ],
)
def test_a_compiled_law_is_the_law(
    module: ModuleType, name: str, arguments: tuple[object, ...]
) -> None:
    law = getattr(module, name)
    assert getattr(compiled_laws, name) is law
    assert kernel(law)(*arguments) == pytest.approx(law(*arguments), rel=1e-14, abs=0.0)


def test_every_compiled_law_is_compared() -> None:
    (mark,) = (m for m in test_a_compiled_law_is_the_law.pytestmark if m.name == "parametrize")
    compared = {name for _, name, _ in mark.args[1]}
    compiled = {
        name
        for name, value in vars(compiled_laws).items()
        if getattr(value, "__module__", "").startswith("beltid.laws.")
    }
    assert compiled <= compared
