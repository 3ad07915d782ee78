"""The C and Fortran functions, compiled and called: the law itself, to rounding."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from beltid.export.choices import Choices
from beltid.export.law import BeltFacts, ContactLaw, friction_part
from beltid.export.reduction import ReferencePoint
from beltid.export.targets import TARGETS
from beltid.laws.friction_surface import FrictionSurface

POINT = ReferencePoint(3000.0, 0.01)
DOUBLE = ctypes.c_double
FLAGS = {
    "gcc": ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror"),
    "gfortran": ("-std=f2003", "-pedantic", "-Wall", "-Werror"),
}
TRUE = st.floats(-1e3, 1e5) | st.sampled_from([400.0, 12000.0, 0.0])
SPEED = st.floats(-0.1, 0.1) | st.sampled_from([0.0025, 0.04, 0.0])


def compiled(folder: Path, law: ContactLaw, target: str, compiler: str) -> ctypes.CDLL:
    """A library of the source file of a target."""
    path = shutil.which(compiler)
    if path is None:
        pytest.skip(f"{compiler} is not installed: what it would compile is not tested")
    ending = {"gcc": ".c", "gfortran": ".f90"}[compiler]
    sources = []
    for name, data in TARGETS[target].write(law, Choices(POINT)).files.items():
        (folder / name).write_bytes(data)
        if name.endswith(ending):
            sources.append(name)
    library = f"{target}.so"
    command = [path, *FLAGS[compiler], "-O2", "-shared", "-fPIC", *sources, "-o", library, "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return ctypes.CDLL(str(folder / library))


def function(library: ctypes.CDLL, name: str, arguments: int) -> Callable[..., float]:
    found = library[name]
    found.restype, found.argtypes = DOUBLE, [DOUBLE] * arguments
    return found


@pytest.fixture(scope="module", params=[("c", "gcc"), ("fortran", "gfortran")], ids=lambda p: p[0])
def library(request: Any, law: ContactLaw, tmp_path_factory: pytest.TempPathFactory) -> Any:
    return compiled(tmp_path_factory.mktemp("law"), law, *request.param)


@settings(max_examples=100, deadline=None)
@given(force=TRUE, speed=SPEED)
def test_mu_is_that_of_the_surface_inside_and_outside(
    library: Any, law: ContactLaw, force: float, speed: float
) -> None:
    mu = function(library, "belt_5pk_mu", 2)(force, speed)
    assert mu == pytest.approx(float(law.surface.mu(force, speed)), rel=1e-12)
    friction = function(library, "belt_5pk_friction", 2)(force, speed)
    assert friction == pytest.approx(-np.sign(speed) * max(force, 0.0) * mu, rel=1e-12)


def test_line_force_is_equation_3(library: Any) -> None:
    line_force = function(library, "belt_5pk_line_force", 1)
    assert line_force(-1e-6) == line_force(0.0) == 0.0
    # 3025.6e6 L g² + 6.5e5 L g with L = 100 cm
    assert line_force(1e-4) == pytest.approx(100 * (3025.6e6 * 1e-8 + 6.5e5 * 1e-4), rel=1e-12)


@pytest.mark.parametrize(("target", "compiler"), [("c", "gcc"), ("fortran", "gfortran")])
def test_a_noisy_surface_stays_bounded_and_one_node_is_no_axis(
    law: ContactLaw, tmp_path: Path, target: str, compiler: str
) -> None:
    rng = np.random.default_rng(3)
    f, v = np.geomspace(300.0, 2e4, 14), np.geomspace(1e-3, 0.1, 9)
    noisy = FrictionSurface(f, v, rng.uniform(0.5, 1.5, (f.size, v.size)))
    constant = FrictionSurface.constant(0.7)
    by_force = FrictionSurface([500.0, 2000.0, 9000.0], [0.01], [[1.3], [1.0], [0.8]])
    from_zero = FrictionSurface([0.0, 2000.0], [0.0, 0.02], [[1.3, 1.2], [1.0, 0.8]])
    for number, surface in enumerate((noisy, constant, by_force, from_zero)):
        facts = BeltFacts(name=f"{'x' * 39}{number}")
        changed = law.model_copy(
            update={"friction": friction_part(surface, "refined"), "belt": facts}
        )
        folder = tmp_path / f"{number}"
        folder.mkdir()
        mu = function(compiled(folder, changed, target, compiler), f"belt_{facts.name}_mu", 2)
        for force in rng.uniform(0.0, 2.5e4, 200):
            speed = float(rng.uniform(-0.12, 0.12))
            expected = float(surface.mu(force, speed))
            assert mu(force, speed) == pytest.approx(expected, rel=1e-12)
