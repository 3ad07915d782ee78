"""Friction surface: bounded patches, nodes exact, nearest value outside, covariance, half trend."""

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as hnp
from scipy.interpolate import CubicSpline

from beltid.errors import InputError
from beltid.laws.bicubic import SurfaceTables, bounded_cubic, bounded_patches
from beltid.laws.friction_surface import FrictionSurface, continued
from beltid.rig.forces import friction

F = np.array([900.0, 1650, 2600, 3550, 4300, 5050, 5850, 6600])
V = np.array([0.0025, 0.005, 0.0105, 0.021, 0.042])
# power basis 1, s, s², s³ -> Bernstein basis
TO_BEZIER = np.array(
    [[1, 0, 0, 0], [1, 1 / 3, 0, 0], [1, 2 / 3, 1 / 3, 0], [1, 1, 1, 1]], dtype=float
)
# mu0, a, c, v0 of the virtual benches, and the largest error between the nodes
KNOWN = [
    ((1.05, 0.20, 0.50, 0.0020), 7e-4),
    ((0.95, 0.18, 0.45, 0.0015), 7e-4),
    ((0.88, 0.14, 0.38, 0.0012), 5e-4),
]


def smooth() -> FrictionSurface:
    return FrictionSurface(F, V, (F[:, None] / 4000) ** -0.2 * (V / 0.01) ** 0.2)


def looked_up(T: SurfaceTables, f: float, v: float) -> tuple[float, float, float]:
    """mu and its derivatives at one point, as kernels look them up."""
    mu, mu_f, mu_v = friction(T, f, abs(v))
    return mu, mu_f, mu_v * (-1.0 if v < 0.0 else 1.0)


@st.composite
def surfaces(draw: st.DrawFn) -> FrictionSurface:
    nf, nv = draw(st.integers(1, 7)), draw(st.integers(1, 6))
    steps = st.floats(1e-3, 10)
    f = 100 * np.cumsum(draw(hnp.arrays(float, nf, elements=steps)))
    v = 1e-3 * np.cumsum(draw(hnp.arrays(float, nv, elements=steps)))
    f[0], v[0] = draw(st.sampled_from([0.0, f[0]])), draw(st.sampled_from([0.0, v[0]]))
    return FrictionSurface(f, v, draw(hnp.arrays(float, (nf, nv), elements=st.floats(0.1, 3))))


@given(st.integers(0, 2**32 - 1), st.integers(2, 6), st.integers(2, 6))
def test_every_control_point_lies_between_the_corners_of_its_cell(
    seed: int, nx: int, ny: int
) -> None:
    rng = np.random.default_rng(seed)
    x, y = np.cumsum(rng.lognormal(0, 1, nx)), np.cumsum(rng.lognormal(0, 1, ny))
    z = rng.choice([rng.uniform(0.5, 1.5, (nx, ny)), rng.integers(1, 4, (nx, ny)) * 0.5])
    control = TO_BEZIER @ bounded_patches(x, y, z) @ TO_BEZIER.T
    corners = np.stack([z[:-1, :-1], z[1:, :-1], z[:-1, 1:], z[1:, 1:]])
    low, high = corners.min(axis=0)[..., None, None], corners.max(axis=0)[..., None, None]
    assert np.all(control >= low - 1e-13)
    assert np.all(control <= high + 1e-13)


def test_control_points_of_a_saddle_where_no_twist_helps_stay_in_the_band() -> None:
    z = np.array([[1.0, 1, 9, 1], [1, 8, 1, 1], [9, 1, 1, 8], [1, 1, 9, 1]])
    control = TO_BEZIER @ bounded_patches(np.arange(4.0), np.arange(4.0), z) @ TO_BEZIER.T
    assert control.min() >= 1.0 - 1e-13
    assert control.max() <= 9.0 + 1e-13


def test_patches_of_smooth_values_are_the_tensor_cubic_spline() -> None:
    x, y = np.array([0.0, 0.7, 1.2, 2.0, 2.4, 3.1]), np.array([0.0, 0.5, 1.5, 2.0, 3.0])
    z = np.exp(-0.3 * x[:, None]) * (1 + 0.4 * y + 0.05 * y**2)
    C = bounded_patches(x, y, z)
    at_x, at_y = np.linspace(0, 3.1, 41), np.linspace(0, 3.0, 37)
    spline = CubicSpline(y, CubicSpline(x, z)(at_x), axis=1)(at_y)
    i = np.clip(np.searchsorted(x, at_x, side="right") - 1, 0, x.size - 2)
    j = np.clip(np.searchsorted(y, at_y, side="right") - 1, 0, y.size - 2)
    s = ((at_x - x[i]) / np.diff(x)[i])[:, None] ** np.arange(4)
    t = ((at_y - y[j]) / np.diff(y)[j])[:, None] ** np.arange(4)
    values = np.einsum("ma,mnab,nb->mn", s, C[i[:, None], j[None, :]], t)
    assert values == pytest.approx(spline, rel=1e-13)


def test_bounded_cubic_is_the_natural_spline_where_no_bound_acts() -> None:
    x = np.array([0.0, 0.7, 1.5, 2.1, 3.0])
    z = 1.0 + 2.0 * x + 0.1 * np.sin(x)  # steep enough for the spline to stay between its points
    at = np.linspace(0.0, 3.0, 61)
    expected = CubicSpline(x, z, bc_type="natural")(at)
    np.testing.assert_allclose(bounded_cubic(x, z, at), expected, rtol=1e-12)
    np.testing.assert_allclose(bounded_cubic(x[:2], z[:2], at[:9]), np.interp(at[:9], x, z))


@pytest.mark.parametrize("nodes", [1, 2, 3])
def test_few_nodes_reproduce_the_polynomial_they_determine(nodes: int) -> None:
    # in the coordinate of the surface: constant, line, parabola; monotone, so nothing is limited
    f = np.array([1000.0, 2500, 6000])[:nodes]
    polynomial = np.polynomial.Polynomial([1.2, -0.2, 0.01][:nodes])
    surface = FrictionSurface(f, [0.01], polynomial(np.log1p(f / 1000.0))[:, None])
    assert surface.degree == (nodes - 1, 0)
    at = np.linspace(f[0], f[-1], 31)
    assert surface.mu(at, 0.01) == pytest.approx(polynomial(np.log1p(at / 1000.0)), rel=1e-14)


@pytest.mark.parametrize("rise", [0.01, -0.01])
def test_four_nodes_are_cubic_and_a_fall_with_speed_is_known(rise: float) -> None:
    x = np.arange(1.0, 5.0)
    surface = FrictionSurface(x, x, np.tile(1.0 + rise * x, (4, 1)))
    assert (surface.degree, surface.falls_with_speed) == ((3, 3), rise < 0.0)


@pytest.mark.parametrize(("law", "documented"), KNOWN)
def test_known_laws_are_met_between_the_nodes_as_documented(
    law: tuple[float, float, float, float], documented: float
) -> None:
    mu0, a, c, v0 = law

    def mu(f: np.ndarray, v: np.ndarray) -> np.ndarray:
        speed = 1 + c * (np.log1p(v / v0) / np.log1p(0.01 / v0) - 1)
        return mu0 * (f / 5400) ** -a * speed

    surface = FrictionSurface(F, V, mu(F[:, None], V))
    f, v = np.geomspace(900, 6600, 150)[:, None], np.geomspace(0.0025, 0.042, 120)
    assert np.abs(surface.mu(f, v) / mu(f, v) - 1).max() < documented


@given(surfaces(), st.integers(0, 2**32 - 1))
def test_nodes_band_and_lookup_of_any_surface(surface: FrictionSurface, seed: int) -> None:
    at_nodes = surface.mu(surface.normal_force_N_m[:, None], surface.slip_speed_m_s)
    assert np.array_equal(at_nodes, surface.mu_nodes)
    rng = np.random.default_rng(seed)
    f = rng.uniform(-0.2, 1.2, 30) * (surface.normal_force_N_m[-1] + 1)
    v = rng.uniform(-1.2, 1.2, 30) * (surface.slip_speed_m_s[-1] + 1e-3)
    mu, slopes = surface.mu(f, v), surface.gradient(f, v)
    assert mu.min() >= surface.mu_nodes.min()
    assert mu.max() <= surface.mu_nodes.max()
    for k in range(f.size):
        found = looked_up(surface.tables(), f[k], v[k])
        assert found[0] == pytest.approx(mu[k], rel=1e-12)
        # slopes carry the rounding of ln(1 + .) at nodes that are very close
        assert found[1] == pytest.approx(slopes[0][k], rel=1e-6, abs=1e-12)
        assert found[2] == pytest.approx(slopes[1][k], rel=1e-6, abs=1e-9)


def test_slopes_are_those_of_differences() -> None:
    surface, f, v = smooth(), 3000.0, 0.013
    by_f, by_v = surface.gradient(f, v)
    assert by_f == pytest.approx((surface.mu(f + 1, v) - surface.mu(f - 1, v)) / 2, rel=1e-5)
    step = 1e-5
    difference = (surface.mu(f, v + step) - surface.mu(f, v - step)) / (2 * step)
    assert by_v == pytest.approx(difference, rel=1e-5)
    assert surface.gradient(f, -v)[1] == -by_v
    from_rest = FrictionSurface([2000.0], [0.0, 0.01, 0.03], [[0.5, 0.6, 0.8]])
    at_rest, above = from_rest.gradient(2000.0, [0.0, 1e-9])[1]
    assert at_rest == pytest.approx(above, rel=1e-6)
    assert looked_up(from_rest.tables(), 2000.0, 0.0)[2] == pytest.approx(at_rest, rel=1e-12)


def test_nan_in_gives_nan_out_and_nothing_else() -> None:
    f = np.array([np.nan, 3000.0, 3000.0])
    v = np.array([0.01, np.nan, 0.01])
    for values in (smooth().mu(f, v), *smooth().gradient(f, v), with_covariance().mu_se_at(f, v)):
        assert np.array_equal(np.isnan(values), [True, True, False])
    assert np.array_equal(smooth().covers(f, v), [False, False, True])


def test_constant_and_single_node() -> None:
    surface = FrictionSurface.constant(0.5)
    assert np.array_equal(surface.mu([0.0, 1e7, -3.0], [0.0, -9.0, 1.0]), [0.5] * 3)
    assert surface.gradient(100.0, 0.1) == (0.0, 0.0)
    assert surface.covers(1e9, -5.0)
    assert looked_up(surface.tables(), 1e7, -0.3) == (0.5, 0.0, 0.0)
    single = FrictionSurface([5000.0], [0.01], [[0.9]])
    assert single.covers([5000.0, 5001.0], 0.01).tolist() == [True, False]
    assert single.mu(1.0, 1.0) == 0.9


def test_equality_copy_and_pickle_of_what_cannot_be_changed() -> None:
    nodes = smooth().mu_nodes.copy()
    assert smooth() == FrictionSurface(F, V, nodes)
    assert smooth() != FrictionSurface(F, V, 1.1 * nodes)
    assert smooth() != FrictionSurface(F, V, nodes, 0.01 * nodes)
    assert FrictionSurface([0.0, 1e3], [1], nodes[:2, :1]) == FrictionSurface(
        [-0.0, 1e3], [1], nodes[:2, :1]
    )
    for twin in (pickle.loads(pickle.dumps(with_covariance())), copy.deepcopy(with_covariance())):
        assert twin == with_covariance()
        assert twin.sources == ("gain",)
        with pytest.raises(ValueError, match="read-only"):
            twin.mu_nodes[0, 0] = 9.0


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
        ([], [0.01], np.empty((0, 1)), "at least one node"),
        (["a"], [0.01], [[1.0]], "normal_force_N_m: must be an array of numbers"),
    ],
)
def test_wrong_grid_is_refused(f: object, v: object, mu: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        FrictionSurface(f, v, mu)  # type: ignore[arg-type]


FACTOR = np.zeros((3, 2, 3))
FACTOR[..., 0] = 0.004  # one error that moves all nodes
FACTOR[0, 0, 1] = FACTOR[2, 1, 2] = 0.003


def with_covariance() -> FrictionSurface:
    mu = np.array([[1.0, 1.1], [0.9, 1.0], [0.8, 0.9]])
    f, v = [1000.0, 2000.0, 4000.0], [0.01, 0.02]
    return FrictionSurface(f, v, mu, 0.003 * mu).with_covariance(FACTOR, ["gain"])


def test_uncertainty_at_nodes_between_and_beyond() -> None:
    surface = with_covariance()
    assert surface.mu_u(1000.0, 0.01) == pytest.approx(0.005)
    assert surface.mu_u(90.0, 0.001) == pytest.approx(0.005)  # that of the nearest node
    assert surface.mu_se_at(2000.0, 0.02) == pytest.approx(0.003)
    # ln(1 + f / 1000 N/m) of the nodes: ln 2, ln 3, ln 5; a middle is a geometric mean
    middle_v = 0.01 * (np.sqrt(2 * 3) - 1)
    low, high = 1000 * (np.sqrt(2 * 3) - 1), 1000 * (np.sqrt(3 * 5) - 1)
    found = surface.factor_at([low, high, np.nan], middle_v)
    np.testing.assert_allclose(found[0], [0.004, 0.003 / 4, 0.0], rtol=1e-12, atol=1e-18)
    np.testing.assert_allclose(found[1], [0.004, 0.0, 0.003 / 4], rtol=1e-12, atol=1e-18)
    assert np.isnan(found[2]).all()
    plain = FrictionSurface([1000.0, 3000.0], [0.01], [[1.0], [1.0]], [[0.01], [np.nan]])
    assert plain.mu_u(1000.0, 0.01) == pytest.approx(0.01)
    assert np.isnan(plain.mu_u(3000.0, 0.01))  # unknown stays where it is
    even = FrictionSurface([1000.0, 3000.0], [0.01], np.ones((2, 1)), np.full((2, 1), 0.01))
    assert even.with_covariance(0.01 * np.eye(2)[:, None]).mu_u(1800.0, 0.01) == pytest.approx(0.01)
    with pytest.raises(InputError, match="no covariance"):
        plain.factor_at(1000.0, 0.01)


def test_bands_hold_their_level() -> None:
    low, high = with_covariance().band(2000.0, 0.01)  # mu = 0.9, u(ln mu) = 0.4 %
    assert (low, high) == pytest.approx(0.9 * np.exp(1.959964 * np.array([-0.004, 0.004])))
    for level in (1.5, 1.0, 0.0, -0.1):
        with pytest.raises(InputError, match=f"level = {level}"):
            with_covariance().band(1000.0, 0.01, level=level)


@pytest.mark.parametrize(
    ("factor", "sources"),
    [(np.zeros((2, 2, 1)), ()), (FACTOR[..., :1], ("gain", "zero")), (FACTOR[..., 0], ())],
)
def test_a_covariance_of_another_shape_is_refused(factor: np.ndarray, sources: object) -> None:
    with pytest.raises(InputError, match="factor: shape"):
        with_covariance().with_covariance(factor, sources)  # type: ignore[arg-type]


@pytest.mark.parametrize("exponent", [0.2, -0.15])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_a_power_law_goes_on_with_its_share_and_fades_at_rest(
    exponent: float, share: float
) -> None:
    f_axis, v_axis = np.geomspace(100.0, 10000.0, 25), np.geomspace(0.002, 0.05, 30)
    mu = 0.8 * (f_axis[:, None] / 1000.0) ** -0.2 * (v_axis / 0.002) ** exponent
    surface = FrictionSurface(f_axis, v_axis, mu)
    tables = continued(surface, share)
    for f in (150.0, 1234.0, 9000.0):
        for over in (0.9, 0.4, 0.1, 0.02, 0.0):
            expected = 0.8 * (f / 1000.0) ** -0.2 * ((over + 0.01) / 1.01) ** (share * exponent)
            assert looked_up(tables, f, over * 0.002)[0] == pytest.approx(expected, rel=2e-3)
        for v in (0.002, 0.0031, 0.2):  # what was measured stays
            assert looked_up(tables, f, v)[0] == pytest.approx(float(surface.mu(f, v)), rel=1e-14)


def test_a_trend_that_is_scatter_of_the_nodes_is_bounded() -> None:
    tables = continued(FrictionSurface([1000.0], [0.002, 0.0021, 0.05], [[0.2, 0.5, 0.6]]), 1.0)
    at_rest = looked_up(tables, 1000.0, 0.0)[0]
    assert at_rest == pytest.approx(0.2 * (0.01 / 1.01) ** 0.5, rel=1e-6)
    from_rest = FrictionSurface([1000.0], [0.0, 0.01], [[0.5, 0.6]])
    assert continued(from_rest, 1.0) is from_rest.tables()
