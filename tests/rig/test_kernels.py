"""Forces and tangents of the kernels: derivatives of each other, inertia and damping by hand."""

import numpy as np
import pytest
from rig_bench import LAW_5PK, at, bench, dense, slid, surface_5pk

from beltid.params import Contact
from beltid.rig.banded import HALF, WIDTH, factorize, kernel, solve
from beltid.rig.forces import POINT, Motion, State, revise_status
from beltid.rig.model import RigModel
from beltid.rig.newton import assemble
from beltid.rig.runs import at_rest

OMEGA = 0.3
SURFACE = surface_5pk()
RIG = bench(law=LAW_5PK, mu=SURFACE, contact=Contact(sticking_ratio=1.2), supports="clamped")


def disturbed(rate: float, seed: int = 0) -> tuple[RigModel, Motion, State]:
    """A state in motion near a laid-on belt: some points stick, some slide either way."""
    rng = np.random.default_rng(seed)
    model, laid, _ = slid(RIG, at(82, 270, OMEGA), 20)
    s = at_rest(model, laid)
    n_e, n_c = s.now.shape
    s.q_old[:] = s.q
    s.q[1::4] -= 2e-5  # some points are at the edge of the contact
    s.q[:] += 2e-6 * rng.normal(size=s.q.size) * np.tile([1, 1, 50, 50], s.q.size // 4)
    s.q_dot[:] = 1e-4 * rng.normal(size=s.q.size)
    s.last["F_T"] = 0.1 * rng.normal(size=(n_e, n_c))
    s.last["sticks"] = rng.random((n_e, n_c)) < 0.5
    s.now["sticks"] = rng.random((n_e, n_c)) < 0.5
    s.now["sign"] = rng.choice([-1.0, 1.0], (n_e, n_c)) if rate else 1.0
    return model, Motion(rate, OMEGA, 0.9, 0.0, 0.0), s


@pytest.mark.parametrize(("rate", "v0"), [(0.0, 0.0), (300.0, 0.0), (0.0, 30.0)])
def test_the_tangent_is_the_derivative_of_the_forces(rate: float, v0: float) -> None:
    """Central differences in random directions: at rest, in a step, of a flowing belt."""
    model, motion, s = disturbed(rate)
    motion = motion._replace(v0=v0, scale=1e-2 * v0)
    s.u[1] = v0 / 0.0499 if v0 else 0.0
    status, q, u = s.now.copy(), s.q.copy(), s.u.copy()

    def residual(dq: np.ndarray, du: np.ndarray) -> np.ndarray:
        s.now[:], s.q[:], s.u[:] = status, q + dq, u + du
        assemble(model.system, motion, s, -1.0)
        return s.r.copy()

    residual(0 * q, 0 * u)
    if v0:  # the share of friction that Newton's method keeps, as in a solution
        status["sign"] = s.now["slip"] / np.hypot(s.now["slip"], motion.scale)
        residual(0 * q, 0 * u)
    tangent, columns = dense(s.A), s.columns.copy()
    rng, units = np.random.default_rng(1), np.tile([1, 1, 100, 100], q.size // 4)
    for _ in range(4):
        dq = 1e-9 * rng.normal(size=q.size) * units
        found = 0.5 * (residual(dq, 0 * u) - residual(-dq, 0 * u))
        expected = tangent @ dq
        np.testing.assert_allclose(found, expected, atol=3e-5 * np.abs(expected).max())
    for k, step in enumerate((1e-8, 1e-6)):
        du = np.zeros(2)
        du[k] = step
        found = 0.5 * (residual(0 * q, du) - residual(0 * q, -du)) / step
        if (k == 0 and not rate) or v0:
            np.testing.assert_allclose(found, columns[k], atol=1e-5 * np.abs(columns[k]).max())


@pytest.mark.parametrize("power", [0, 1])
def test_the_inertia_is_that_of_the_mass_of_the_belt(power: int) -> None:
    """Of a constant and a linear field: the mass, and its second moment over the length."""
    model, motion, s = disturbed(300.0)
    status, place = s.now.copy(), np.cumsum([0.0, *model.system.mesh.h])
    field = np.zeros(s.q.size)
    field[0::4], field[2::4] = place**power, power
    assemble(model.system, motion, s, -1.0)
    before, s.now[:] = s.r.copy(), status
    s.q_dot[:] -= motion.rate * field
    assemble(model.system, motion, s, -1.0)
    n = 2 * power + 1
    mass = RIG.belt.rhoA * float(s.u[0]) * place[-1] ** n / n
    assert field @ (s.r - before) == pytest.approx(mass * motion.rate**2, rel=1e-9)


def test_what_touches_dissipates_only_while_approaching() -> None:
    """Eqs. (1), (2), (4): C_P times the rate of approach of the share of a part that touches."""
    model, motion, s = disturbed(300.0)
    assemble(model.system, motion, s, -1.0)
    s.last["rho"] = s.now["rho"] + np.where(np.arange(s.last.shape[1]) % 2, 1e-6, -1e-6) - 2e-7
    assemble(model.system, motion, s, -1.0)
    part, R, edge = model.system.mesh.w_c * s.u[0], model.path.R, model.system.pulley.edge
    share = np.clip(0.5 + (R - s.now["rho"]) / (edge * model.system.mesh.w_c), 0.0, 1.0)
    approach = (s.last["rho"] - s.now["rho"]) * motion.rate
    more = s.now["F_N"] - s.now["f_N"] * part
    touching = s.now["F_N"] > 0.0
    expected = model.system.pulley.C_P * share * part * np.maximum(approach, 0.0)
    np.testing.assert_allclose(more[touching], expected[touching], atol=1e-9)
    assert np.any((share > 0.0) & (share < 1.0) & (approach > 0.0))


@pytest.mark.parametrize("seed", range(3))
def test_a_banded_system_is_solved_with_exchanges(seed: int) -> None:
    """Backward error of an elimination with partial pivoting; a zero diagonal needs exchanges."""
    rng, n = np.random.default_rng(seed), 40
    A = np.zeros((n, WIDTH))
    A[:, : 2 * HALF + 1] = rng.integers(-3, 4, size=(n, 2 * HALF + 1))  # equal pivots, too
    A[:, HALF] = 0.0
    full, b = dense(A), rng.normal(size=(3, n))
    x, pivots = b.copy(), np.zeros(n, dtype=np.int64)
    column = np.add.outer(np.arange(n), np.arange(WIDTH)) - HALF
    A *= (column >= 0) & (column < n)  # nothing is stored outside the matrix
    assert factorize(A, pivots)
    solve(A, pivots, *x)
    error = np.abs(full @ x.T - b.T).max()
    assert error < 1e-13 * np.abs(full).sum(axis=1).max() * np.abs(x).max()


def test_a_singular_matrix_is_not_factorized() -> None:
    assert not factorize(np.zeros((9, WIDTH)), np.zeros(9, dtype=np.int64))


def test_a_kernel_without_a_place_for_its_cache_is_compiled_all_the_same() -> None:
    """As in a container with files that cannot be written and without a home."""
    source: dict = {}
    exec(compile("def twice(x):\n    return 2 * x\n", "/nowhere/kernels.py", "exec"), source)
    assert kernel(source["twice"])(2.0) == 4.0


@pytest.mark.parametrize(("back", "sticks"), [(1e-13, True), (1e-9, False)])
def test_a_sliding_point_may_slip_back_a_little_where_iterations_circle(back, sticks) -> None:
    point = np.zeros(1, dtype=POINT)
    point["sign"] = 1.0
    assert revise_status(point[0], 0.0, 1.0, -5e-10, back) == sticks
    assert point["sticks"][0] == sticks
