"""Path, graded mesh and supports."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from rig_bench import LAW_5PK, LINEAR_LAW, at, bench, dense
from scipy.integrate import quad

from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, OperatingPoint, Rig
from beltid.rigsim.banded import HALF, WIDTH
from beltid.rigsim.beam.path import Path, bed_length, bending_length, graded_nodes, touchdown
from beltid.rigsim.beam.supports import (
    force_change,
    held_row,
    hold,
    new_reactions,
    release,
    support_arrays,
)
from beltid.rigsim.rig import SimulationSettings, simulate
from beltid.rigsim.steady import lay_on, slide

FIXED = settings(derandomize=True)
radius, span, arc = st.floats(0.02, 0.2), st.floats(0.03, 0.5), st.floats(5, 340)


@FIXED
@given(radius, span, arc)
def test_path_is_the_integral_of_its_unit_tangent(R: float, L: float, arc_deg: float) -> None:
    path = Path(R, L, math.radians(arc_deg))
    assert path.length == pytest.approx(2 * L + R * math.radians(arc_deg), rel=1e-14)
    ends = path.position(np.array([0.0, path.length]))
    for k in range(2):
        way, _ = quad(
            lambda s, k=k: path.tangent(np.array([s]))[0, k],
            0,
            path.length,
            points=[path.entry, path.exit],
        )
        assert ends[1, k] - ends[0, k] == pytest.approx(way, abs=1e-10)
    # the arc lies on the pulley, the spans touch it and stand off by Pythagoras
    s = np.linspace(path.entry, path.exit, 7)
    np.testing.assert_allclose(np.hypot(*path.position(s).T), R, rtol=1e-13)
    np.testing.assert_allclose(np.hypot(*ends.T), math.hypot(R, L), rtol=1e-13)
    np.testing.assert_allclose(ends[0] * [-1, 1], ends[1], atol=1e-12)


@FIXED
@given(
    st.floats(0.002, 0.05),
    radius,
    span,
    arc,
    st.floats(30, 600),
    st.sampled_from(["pinned", "clamped"]),
    st.one_of(st.none(), st.integers(5, 80)),
)
@example(0.002, 0.125, 0.125, 5.0, 370.0, "clamped", 32)  # finer at the clamp than on the arc
def test_mesh_is_increasing_symmetric_and_resolves_the_bed(
    EI: float, R: float, L: float, arc_deg: float, T_0: float, supports: str, half: int | None
) -> None:
    belt, rig = Belt(1e5, EI, 0.1), Rig(R, L, supports)  # type: ignore[arg-type]
    point = OperatingPoint(math.radians(arc_deg), T_0, 0.2)
    n = None if half is None else 2 * half
    nodes, _ = graded_nodes(belt, rig, LAW_5PK, point, n)
    path = Path(R, L, point.beta)
    h = np.diff(nodes)
    assert np.all(h > 0)
    assert nodes[0] == 0.0
    assert nodes[-1] == pytest.approx(path.length, rel=1e-14)
    np.testing.assert_allclose(h, h[::-1], rtol=1e-8)
    assert h.size % 2 == 0
    if n is not None:
        assert h.size == n
    if n is None and h.size < 1000:
        # nowhere on the arc longer than 1.5 layers, and shorter than the layer where it begins
        layer = touchdown(belt, rig, LAW_5PK, T_0).layer
        on_arc = (nodes[:-1] >= path.entry) & (nodes[1:] <= path.exit)
        assert np.all(h[on_arc] <= 1.5 * layer)
        assert h.min() <= layer
    # one finest place in each half, beside the clamp; no jumps
    half_h = h[: h.size // 2]
    if supports == "clamped":
        half_h = half_h[int(np.argmax(np.diff(half_h) < 0.0)) :]  # it grows away from the clamp
    finest = int(np.argmin(half_h))
    assert np.all(np.diff(half_h[finest:]) >= -1e-9)
    if supports == "pinned":
        assert np.all(np.diff(half_h[: finest + 1]) <= 1e-9)


@pytest.mark.parametrize("EI", [1e-7, 1e-5, 1e-3, 0.02])
@pytest.mark.parametrize("T_0", [50.0, 450.0])
def test_the_belt_touches_down_where_the_closed_form_says(EI: float, T_0: float) -> None:
    """Linear law, nearly rigid axially: first contact of the belt laid on, and its layer."""
    rig = bench(EI, EA=1e7)
    end = touchdown(rig.belt, rig.rig, LINEAR_LAW, T_0)
    model = rig.model(at(82, T_0), 400)
    points = lay_on(model).points
    touches = np.flatnonzero(points.F_N.ravel() > 0)
    starts = np.interp(touches[0] / 5.0, np.arange(model.nodes.size), model.nodes)
    part = model.system.belt.w_c.ravel()[touches[0]]
    assert starts - model.path.entry == pytest.approx(end.offset, abs=0.06 * end.layer + part)
    # without bending the pressure grows as 1 - exp(-x/layer), with it there is an overshoot
    if EI < 1e-6:
        assert end.layer == pytest.approx(math.sqrt(T_0 / 1e8), rel=1e-2)


def test_lengths_of_bending_and_of_the_bed() -> None:
    """Values for the 5PK belt: 9 mm in the span, 5 mm on the bed."""
    assert bending_length(0.02, 270) == pytest.approx(8.61e-3, abs=5e-6)
    assert bed_length(0.02, 1e8) == pytest.approx(5.32e-3, abs=5e-6)


def random_system(seed: int, n: int = 24) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    A = np.zeros((n, WIDTH))
    for i in range(n):
        for j in range(max(0, i - HALF), min(n, i + HALF + 1)):
            if abs(i // 4 - j // 4) <= 1:  # a node couples with its neighbours
                A[i, HALF + j - i] = rng.normal() + (8.0 if i == j else 0.0)
    return A, rng.normal(size=(2, n))


@pytest.mark.parametrize("clamped", [False, True])
def test_held_system_is_the_one_with_lagrange_multipliers(clamped: bool) -> None:
    """Eq. (10): the same steps and reactions as the full system with constraint rows."""
    A, vectors = random_system(4)
    n = A.shape[0]
    angle = 0.6
    directions = np.array([[math.cos(angle), math.sin(angle)], [math.cos(angle), -math.sin(angle)]])
    K, residual = dense(A), vectors[0].copy()
    rows = []
    for i in range(4):
        row = np.zeros(n)
        row[held_row(i, n)] = 1.0
        rows.append(row)
    if clamped:
        for end, first in enumerate((2, n - 2)):
            across = np.zeros(n)  # r' may change its length, not its direction
            across[first : first + 2] = [-directions[end, 1], directions[end, 0]]
            rows.append(across)
    C = np.array(rows)
    full = np.block([[K, C.T], [C, np.zeros((len(C), len(C)))]])
    exact = np.linalg.solve(full, np.concatenate([-residual, np.zeros(len(C))]))
    reactions = new_reactions()
    rig = Rig(0.05, 0.10, "clamped" if clamped else "pinned")
    supports = support_arrays(rig, 2.0 * angle)
    np.testing.assert_allclose(supports.directions, directions)
    hold(supports, A, vectors, reactions)
    step = np.linalg.solve(dense(A), -vectors[0])
    changes = [force_change(reactions, i, step) for i in range(4)]
    release(supports, step)
    np.testing.assert_allclose(step, exact[:n], atol=1e-12)
    # multipliers: minus the row of the residual after the step
    for i in range(4):
        assert reactions.force[i] + changes[i] == pytest.approx(-exact[n + i], abs=1e-11)


@pytest.mark.parametrize("supports", ["pinned", "clamped"])
def test_supports_hold_the_ends_and_clamps_their_direction(supports: str) -> None:
    model = bench(law=LAW_5PK, supports=supports).model(at(100, 150))
    laid = lay_on(model)
    for state in (laid, slide(model, laid)):
        nodes = state.q.reshape(-1, 4)
        ends = model.path.position(np.array([0.0, model.path.length]))
        np.testing.assert_allclose(nodes[[0, -1], :2], ends, atol=1e-15)
        tangent = model.path.tangent(np.array([0.0, model.path.length]))
        held = nodes[[0, -1], 2:]
        turn = held[:, 0] * tangent[:, 1] - held[:, 1] * tangent[:, 0]
        if supports == "clamped":
            np.testing.assert_allclose(turn, 0.0, atol=1e-14)
        else:  # the stiff belt bulges: its free ends turn, if by little
            assert np.all(np.abs(turn) > 1e-12)


def test_clamps_stiffen_a_short_span() -> None:
    """A long span does not feel its ends: the difference falls with exp(-L sqrt(T/EI))."""
    differences = []
    for L in (0.02, 0.04, 0.08):
        mu = [
            simulate(
                bench(span=L, law=NormalLaw(1e9), supports=supports),
                at(82, 150),
                SimulationSettings("steady", 200),
            ).mu
            for supports in ("pinned", "clamped")
        ]
        differences.append(abs(mu[1] - mu[0]))
    assert differences[0] > differences[1] > differences[2]
