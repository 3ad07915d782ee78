"""Friction surface: nodes exact, band kept, nearest value outside, honest about what it is."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from beltid.errors import InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.surface_tables import SurfaceTables, evaluate_cell, locate

F = np.array([900.0, 1650, 2600, 3550, 4300, 5050, 5850, 6600])
V = np.array([0.0025, 0.005, 0.0105, 0.021, 0.042])


def noisy(seed: int = 0, se: bool = True) -> FrictionSurface:
    rng = np.random.default_rng(seed)
    mu = (F[:, None] / 4000) ** -0.2 * (V / 0.01) ** 0.2 * (1 + 0.02 * rng.standard_normal((8, 5)))
    return FrictionSurface(F, V, mu, 0.01 * mu if se else None)


def smooth() -> FrictionSurface:
    return FrictionSurface(F, V, (F[:, None] / 4000) ** -0.2 * (V / 0.01) ** 0.2)


def looked_up(T: SurfaceTables, f: float, v: float) -> tuple[float, float, float]:
    """mu and its derivatives at one point, as the simulated rig looks them up."""
    i, s, ds_df = locate(T.x_nodes, T.f_ref, f)
    j, t, dt_dv = locate(T.y_nodes, T.v_ref, abs(v))
    mu, mu_s, mu_t = evaluate_cell(T.C, i, j, s, t)
    return mu, mu_s * ds_df, mu_t * dt_dv * (-1.0 if v < 0.0 else 1.0)


@st.composite
def surfaces(draw: st.DrawFn) -> FrictionSurface:
    nf, nv = draw(st.integers(1, 7)), draw(st.integers(1, 6))
    steps = st.floats(1e-3, 10)
    f = 100 * np.cumsum(draw(hnp.arrays(float, nf, elements=steps)))
    v = 1e-3 * np.cumsum(draw(hnp.arrays(float, nv, elements=steps)))
    f[0], v[0] = draw(st.sampled_from([0.0, f[0]])), draw(st.sampled_from([0.0, v[0]]))
    return FrictionSurface(f, v, draw(hnp.arrays(float, (nf, nv), elements=st.floats(0.1, 3))))


@given(surfaces())
def test_nodes_are_reproduced_to_the_last_bit(surface: FrictionSurface) -> None:
    at_nodes = surface.mu(surface.normal_force_N_m[:, None], surface.slip_speed_m_s)
    assert np.array_equal(at_nodes, surface.mu_nodes)


@given(surfaces(), st.integers(0, 2**32 - 1))
def test_no_value_leaves_the_measured_band(surface: FrictionSurface, seed: int) -> None:
    rng = np.random.default_rng(seed)
    top_f, top_v = surface.normal_force_N_m[-1], surface.slip_speed_m_s[-1]
    f = rng.uniform(-0.2, 1.2, 400) * (top_f + 1)
    v = rng.uniform(-1.2, 1.2, 400) * (top_v + 1e-3)
    mu = surface.mu(f, v)
    assert mu.min() >= surface.mu_nodes.min()
    assert mu.max() <= surface.mu_nodes.max()


@given(surfaces(), st.integers(0, 2**32 - 1))
def test_scalar_law_of_the_tables_agrees_with_the_surface(
    surface: FrictionSurface, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    T = surface.tables()
    for f, v in zip(
        rng.uniform(-0.2, 1.2, 30) * (surface.normal_force_N_m[-1] + 1),
        rng.uniform(-1.2, 1.2, 30) * (surface.slip_speed_m_s[-1] + 1e-3),
        strict=True,
    ):
        mu, dmu_df, dmu_dv = looked_up(T, f, v)
        assert mu == pytest.approx(float(surface.mu(f, v)), rel=1e-12)
        slope_f, slope_v = surface.gradient(f, v)
        # slopes carry the rounding of ln(1 + .) at nodes that are very close
        assert dmu_df == pytest.approx(float(slope_f), rel=1e-6, abs=1e-12)
        assert dmu_dv == pytest.approx(float(slope_v), rel=1e-6, abs=1e-9)


def test_tables_are_plain_contiguous_double_arrays() -> None:
    T = noisy().tables()
    for array, shape in ((T.x_nodes, (8,)), (T.y_nodes, (5,)), (T.C, (7, 4, 4, 4))):
        assert array.dtype == np.float64
        assert array.shape == shape
        assert array.flags.c_contiguous
        assert not array.flags.writeable
    assert (T.f_ref, T.v_ref) == (900.0, 0.0025)


def test_nan_in_gives_nan_out_and_nothing_else() -> None:
    surface = noisy()
    f = np.array([np.nan, 3000.0, 3000.0])
    v = np.array([0.01, np.nan, 0.01])
    for values in (surface.mu(f, v), *surface.gradient(f, v), surface.mu_se_at(f, v)):
        assert np.array_equal(np.isnan(values), [True, True, False])
    assert np.array_equal(surface.covers(f, v), [False, False, True])


def test_shapes_broadcast_and_scalars_stay_scalars() -> None:
    surface = smooth()
    assert surface.mu(F[:, None], V).shape == (8, 5)
    assert surface.mu(np.empty((0, 3)), 0.01).shape == (0, 3)
    assert np.ndim(surface.mu(3000.0, 0.01)) == 0
    assert surface.gradient(F, 0.01)[0].shape == (8,)
    assert surface.degree == (3, 3)
    assert surface.covers(F[:, None], V).all()


def test_constant_surface_holds_everywhere() -> None:
    surface = FrictionSurface.constant(0.5)
    assert np.array_equal(surface.mu([0.0, 1e7, -3.0], [0.0, -9.0, 1.0]), [0.5] * 3)
    assert surface.gradient(100.0, 0.1) == (0.0, 0.0)
    assert surface.covers(1e9, -5.0)
    assert surface.notes == ()
    assert repr(surface) == "FrictionSurface.constant(0.5)"
    T = surface.tables()
    assert looked_up(T, 1e7, -0.3) == (0.5, 0.0, 0.0)


def test_single_measured_node_is_valid_only_there() -> None:
    surface = FrictionSurface([5000.0], [0.01], [[0.9]])
    assert surface.covers(5000.0, 0.01)
    assert not surface.covers(5001.0, 0.01)
    assert surface.mu(1.0, 1.0) == 0.9
    assert len(surface.notes) == 2


@pytest.mark.parametrize(("n", "word"), [(1, "constant"), (2, "linear"), (3, "quadratic")])
def test_fewer_than_four_nodes_are_reported(n: int, word: str) -> None:
    surface = FrictionSurface(F, V[:n], smooth().mu_nodes[:, :n])
    assert surface.degree == (3, n - 1)
    plural = "s" if n > 1 else ""
    expected = f"{n} node{plural} of sliding speed: {word} along it, cubic needs 4"
    assert surface.notes == (expected,)


def test_limited_slopes_are_reported_and_smooth_data_has_none() -> None:
    assert smooth().notes == ()
    bumpy = FrictionSurface(F, V, 1 + 0.1 * (-1.0) ** np.add.outer(np.arange(8), np.arange(5)))
    assert bumpy.limited.sum() > 20
    assert "slopes limited" in bumpy.notes[0]


def test_standard_error_is_that_of_the_node_and_bilinear_between() -> None:
    se = np.array([[0.01, 0.03], [0.02, 0.08]])
    surface = FrictionSurface([1000.0, 3000.0], [0.01, 0.03], np.ones((2, 2)), se)
    assert surface.mu_se_at([[1000.0], [3000.0]], [0.01, 0.03]) == pytest.approx(se, rel=1e-15)
    middle_f = 1000 * (np.sqrt(2 * 4) - 1)  # half way in ln(1 + f/1000)
    middle_v = 0.01 * (np.sqrt(2 * 4) - 1)
    assert surface.mu_se_at(middle_f, middle_v) == pytest.approx(0.035, rel=1e-13)
    assert surface.mu_se_at(9e9, -9.0) == pytest.approx(0.08)
    assert np.isnan(smooth().mu_se_at(3000.0, 0.01))
    sure = FrictionSurface([1000.0], [0.01], [[1.0]], [[0.0]])
    assert sure.mu_se_at(1000.0, 0.01) == 0.0  # a statement too


def test_unknown_standard_error_stays_where_it_is() -> None:
    se = np.array([[0.01, np.nan], [0.02, 0.08]])
    surface = FrictionSurface([1000.0, 3000.0], [0.01, 0.03], np.ones((2, 2)), se)
    assert surface.mu_se_at(1500.0, 0.01) < 0.02
    assert np.isnan(surface.mu_se_at(1500.0, 0.02))


def test_surface_cannot_be_changed_from_inside_or_outside() -> None:
    f = F.copy()
    surface = FrictionSurface(f, V, smooth().mu_nodes)
    f[0] = 1.0
    assert surface.normal_force_N_m[0] == 900.0
    with pytest.raises(ValueError, match="read-only"):
        surface.mu_nodes[0, 0] = 9.0
    with pytest.raises(AttributeError):
        surface.mu_nodes = np.ones((8, 5))  # type: ignore[misc]


def test_equality_hash_copy_and_pickle() -> None:
    assert noisy(1) == noisy(1)
    assert hash(noisy(1)) == hash(noisy(1))
    assert noisy(1) != noisy(2)
    assert noisy(1) != noisy(1, se=False)
    assert noisy(1) != "surface"
    for surface in (noisy(), with_covariance()):
        for twin in (pickle.loads(pickle.dumps(surface)), copy.deepcopy(surface)):
            assert twin == surface
            assert twin.sources == surface.sources
            assert not twin.mu_nodes.flags.writeable
    assert "8 x 5 nodes" in repr(noisy())
    assert "with mu_se" in repr(noisy())


def test_all_problems_of_a_grid_come_at_once() -> None:
    with pytest.raises(InputError) as error:
        FrictionSurface([1.0, 1.0, -2.0], [0.0, np.nan], [[1.0, 2.0], [0.0, np.nan]], [[-1.0]])
    text = "\n".join(error.value.problems)
    for part in (
        "normal_force_N_m[2] = -2, must be >= 0",
        "slip_speed_m_s[1] = nan",
        "mu: shape (2, 2), must be (3, 2)",
        "mu[1, 0] = 0, must be > 0",
        "mu[1, 1] = nan",
        "mu_se: shape (1, 1)",
        "mu_se[0, 0] = -1, must be >= 0",
    ):
        assert part in text


@pytest.mark.parametrize(
    ("f", "v", "mu", "message"),
    [
        ([2000.0, 1000.0], [0.01], [[1.0], [1.0]], "must be strictly increasing"),
        ([1000.0, 1000.0 + 1e-10], [0.01], [[1.0], [1.0]], "must be strictly increasing"),
        ([0.0, 0.0], [0.01], [[1.0], [1.0]], "must be strictly increasing"),
        ([], [0.01], np.empty((0, 1)), "at least one node"),
        ([[1.0]], [0.01], [[1.0]], "one-dimensional"),
        (["a"], [0.01], [[1.0]], "normal_force_N_m: must be an array of numbers"),
        ([1000.0], [0.01], None, "mu: "),
    ],
)
def test_wrong_grid_is_refused(f: object, v: object, mu: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        FrictionSurface(f, v, mu)  # type: ignore[arg-type]


def test_slope_at_rest_is_the_one_from_above() -> None:
    surface = FrictionSurface([2000.0], [0.0, 0.01, 0.03], [[0.5, 0.6, 0.8]])
    _, (at_rest, above, below) = surface.gradient(2000.0, [0.0, 1e-9, -1e-9])
    assert at_rest == pytest.approx(above, rel=1e-6)
    assert at_rest > 0.0
    T = surface.tables()
    found = looked_up(T, 2000.0, 0.0)
    assert found[2] == pytest.approx(at_rest, rel=1e-12)
    assert below == pytest.approx(-above, rel=1e-12)


def test_negative_zero_is_zero() -> None:
    plus, minus = (FrictionSurface([z, 1000.0], [0.01], [[1.0], [0.9]]) for z in (0.0, -0.0))
    assert plus == minus
    assert hash(plus) == hash(minus)


def test_a_surface_that_is_not_constant_does_not_say_so() -> None:
    single = FrictionSurface([5000.0], [0.01], [[0.9]])
    by_speed_alone = FrictionSurface([0.0], [0.01, 0.02], [[0.9, 1.0]])
    assert "1 x 1 nodes, normal_force_N_m 5000..5000" in repr(single)
    assert "1 x 2 nodes, normal_force_N_m 0..inf" in repr(by_speed_alone)


FACTOR = np.zeros((3, 2, 3))
FACTOR[..., 0] = 0.004  # one error that moves all nodes
FACTOR[0, 0, 1] = FACTOR[2, 1, 2] = 0.003


def with_covariance() -> FrictionSurface:
    mu = np.array([[1.0, 1.1], [0.9, 1.0], [0.8, 0.9]])
    f, v = [1000.0, 2000.0, 4000.0], [0.01, 0.02]
    return FrictionSurface(f, v, mu, 0.003 * mu).with_covariance(FACTOR, ["gain"])


def test_combined_uncertainty_at_nodes_and_beyond() -> None:
    surface = with_covariance()
    assert surface.mu_u(1000.0, 0.01) == pytest.approx(0.005)
    assert surface.mu_u(2000.0, 0.02) == pytest.approx(0.004)
    assert surface.mu_u(90.0, 0.001) == pytest.approx(0.005)  # that of the nearest node
    assert surface.mu_se_at(2000.0, 0.02) == pytest.approx(0.003)
    assert np.isnan(surface.mu_u(np.nan, 0.01))
    one_force = FrictionSurface([1000.0], [0.01, 0.02], [[1.0, 1.1]], None, FACTOR[:1])
    assert one_force.mu_u(9000.0, 0.02) == pytest.approx(1.1 * 0.004)
    plain = FrictionSurface([1000.0], [0.01], [[1.0]], [[0.01]])
    assert plain.mu_u(1000.0, 0.01) == pytest.approx(0.01)
    with pytest.raises(InputError, match="no covariance"):
        plain.factor_at(1000.0, 0.01)


def test_bands_hold_their_level() -> None:
    low, high = with_covariance().band(2000.0, 0.01)  # mu = 0.9, u(ln mu) = 0.4 %
    assert (low, high) == pytest.approx(0.9 * np.exp(1.959964 * np.array([-0.004, 0.004])))
    for level in (1.5, 1.0, 0.0, -0.1):
        with pytest.raises(InputError, match=f"level = {level}"):
            with_covariance().band(1000.0, 0.01, level=level)


def test_the_factor_is_bilinear_between_nodes_in_the_coordinates_of_the_surface() -> None:
    # ln(1 + f / 1000 N/m) of the nodes: ln 2, ln 3, ln 5; a middle is a geometric mean
    middle_v = 0.01 * (np.sqrt(2 * 3) - 1)
    low, high = 1000 * (np.sqrt(2 * 3) - 1), 1000 * (np.sqrt(3 * 5) - 1)
    found = with_covariance().factor_at([low, high, np.nan], middle_v)
    np.testing.assert_allclose(found[0], [0.004, 0.003 / 4, 0.0], rtol=1e-12, atol=1e-18)
    np.testing.assert_allclose(found[1], [0.004, 0.0, 0.003 / 4], rtol=1e-12, atol=1e-18)
    assert np.isnan(found[2]).all()


@pytest.mark.parametrize(
    ("factor", "sources"),
    [(np.zeros((2, 2, 1)), ()), (FACTOR[..., :1], ("gain", "zero")), (FACTOR[..., 0], ())],
)
def test_a_covariance_of_another_shape_is_refused(factor: np.ndarray, sources: object) -> None:
    with pytest.raises(InputError, match="factor: shape"):
        with_covariance().with_covariance(factor, sources)  # type: ignore[arg-type]
