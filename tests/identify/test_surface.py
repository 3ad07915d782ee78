"""Friction surfaces: known laws back, honest errors, averages over arcs by hand."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.special import ndtr, stdtrit

from beltid.arrays import Array, Mask
from beltid.errors import InputError
from beltid.identify.surface.surface import (
    Curve,
    SurfaceResult,
    average,
    build_surface,
    surface_from_columns,
)

SPEEDS = np.array([0.0025, 0.005, 0.0105, 0.021, 0.042])
TENSIONS = np.array([50.0, 100, 150, 210, 270, 330, 390, 450])
ARCS = np.array([40.0, 68, 82])


def law(f: Array, v: Array) -> Array:
    """A power law: straight in the logarithms, and every arc measures the same."""
    return 0.9 * (f / 5000) ** -0.18 * (v / 0.01) ** 0.2


def runs(arc_factor: dict[float, float] | None = None) -> dict[str, Array]:
    """Campaign of 120 runs as the benches give it: the force of a run depends on arc and speed."""
    arc, tension, v = (a.ravel() for a in np.meshgrid(ARCS, TENSIONS, SPEEDS, indexing="ij"))
    mu = 0.9 * (v / 0.01) ** 0.2
    f = tension / 0.05 * (1 + 0.3 * (mu * np.radians(arc) / 2) ** 2 * (150 / tension - 0.5))
    factor = np.array([(arc_factor or {}).get(float(a), 1.0) for a in arc])
    return {"arc_deg": arc, "f": f, "v": v, "mu": law(f, v) * factor, "se": np.full(f.size, 1e-9)}


def build(data: dict[str, Array], keep: Mask | None = None, **how: float) -> SurfaceResult:
    keep = np.ones(data["f"].size, dtype=bool) if keep is None else keep
    columns = (data[k][keep] for k in ("arc_deg", "f", "v", "mu", "se"))
    return build_surface(*columns, **how)  # type: ignore[arg-type]


def bench(belt: str) -> dict[str, Array]:
    """Noise-free runs of a virtual bench."""
    path = Path(__file__).parents[1] / "truth" / belt / "truth.csv"
    table = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")
    names = {"arc_deg": "arc_deg", "f": "f_ref", "v": "v", "mu": "mu_app"}
    data = {k: table[name].astype(float) for k, name in names.items()}
    return {**data, "se": 0.0025 * data["mu"]}


def test_known_law_comes_back_between_the_scattered_points() -> None:
    result = build(runs())
    surface = result.surface
    assert surface.degree == (3, 3)
    grid = result.average
    # a power law is straight where the curves are interpolated; between nodes: test_bicubic
    expected = law(grid.normal_force_N_m[:, None], grid.slip_speed_m_s)
    assert grid.mu == pytest.approx(expected, rel=1e-9)
    assert result.n_points == 120
    assert result.set_aside == ()
    assert len(result.arcs) == 3
    assert result.rms_arc_spread < 1e-9


def test_speed_scatter_of_the_motor_is_taken_off() -> None:
    data = runs()
    v = data["v"] * (1 + 0.008 * np.random.default_rng(3).uniform(-1, 1, 120))
    scattered = {**data, "v": v, "mu": law(data["f"], v)}
    grid = build(scattered).average
    assert grid.slip_speed_m_s == pytest.approx(SPEEDS, rel=3e-3)
    expected = law(grid.normal_force_N_m[:, None], grid.slip_speed_m_s)
    bands = [scattered["mu"][data["v"] == speed] for speed in SPEEDS]
    low, high = (np.array([edge(band) for band in bands]) for edge in (np.min, np.max))
    free = (grid.mu > low) & (grid.mu < high)  # others are held at the edge of what was measured
    assert free.sum() >= 30
    # uncorrected the scatter would leave 0.2 * 0.8 % / sqrt(3) = 0.1 % on every node
    assert np.sqrt(np.mean((grid.mu / expected - 1)[free] ** 2)) < 5e-5


def test_points_that_cannot_be_used_are_set_aside_and_errors_that_lack_are_usual() -> None:
    data = bench("5pk")
    data["mu"][3], data["mu"][50], data["f"][7] = np.nan, -1.0, 0.0
    data["se"] = np.where(np.arange(120) % 60 == 17, np.nan, 0.004)
    result = build(data)
    same = build({**data, "se": np.full(120, 0.004)})
    assert np.array_equal(result.average.mu_se, same.average.mu_se)
    assert result.n_points == 117
    assert [text.split(":")[0] for text in result.set_aside] == ["point 3", "point 7", "point 50"]
    # without any errors the spread between arcs is what is known; of a single arc nothing
    data = bench("4pk")
    unknown = [data[k] for k in ("arc_deg", "f", "v", "mu")]
    assert np.isfinite(build_surface(*unknown).average.mu_se).all()
    single = build_surface(*(a[data["arc_deg"] == 40] for a in unknown))
    assert np.isnan(single.average.mu_se).all()


def test_a_campaign_that_lacks_settings_costs_no_range() -> None:
    data = bench("5pk")
    complete = build(data)
    # an arc without its lowest speed, and two runs elsewhere
    kept = ~((data["arc_deg"] == 68) & (data["v"] < 0.003))
    kept[[3, 50]] = False
    found = build(data, kept)
    assert found.n_points == kept.sum()
    validity = [x.surface.validity["normal_force_N_m"] for x in (found, complete)]
    assert validity[0][0] < validity[1][0]
    assert validity[0][1] > validity[1][1]
    f = np.geomspace(2000.0, 7000.0, 6)[:, None]
    assert found.surface.mu(f, SPEEDS) == pytest.approx(complete.surface.mu(f, SPEEDS), rel=0.01)


def test_columns_are_a_row_per_node_and_give_the_surface_back() -> None:
    result = build(bench("6pk"))
    columns = result.to_columns()
    assert {a.size for a in columns.values()} == {4 * 40}
    names = "arc_deg normal_force_N_m slip_speed_m_s mu mu_se n_arcs mu_spread"
    assert " ".join(columns) == names
    assert np.isnan(columns["arc_deg"][:40]).all()
    assert np.array_equal(columns["arc_deg"][40:], np.repeat(ARCS, 40))
    order = np.random.default_rng(0).permutation(160)
    again = surface_from_columns({k: a[order] for k, a in columns.items()})
    assert again == result.surface
    without_errors = surface_from_columns({k: a for k, a in columns.items() if k != "mu_se"})
    np.testing.assert_array_equal(without_errors.mu_nodes, result.surface.mu_nodes)
    assert without_errors.mu_se_nodes is None
    data = bench("6pk")  # a single arc is marked as the average, too
    single = build(data, data["arc_deg"] == 68)
    arcs = single.to_columns()["arc_deg"]
    assert (np.isnan(arcs).sum(), (arcs == 68).sum()) == (40, 40)
    assert np.isnan(single.rms_arc_spread)


def test_tables_and_points_without_a_surface_are_refused() -> None:
    columns = build(bench("6pk")).to_columns()
    for damaged in (
        {k: a for k, a in columns.items() if k != "mu"},
        {k: a[1:] for k, a in columns.items()},
        {k: a[40:] for k, a in columns.items()},
    ):
        with pytest.raises(InputError):
            surface_from_columns(damaged)
    for points in (
        ([], [], [], [], []),
        ([40, 40], [1e3, 2e3], [0.01, 0.01], [np.nan, -1]),
        ([40, 40], [1e3, 9e3], [0.01, 0.02], [1.0, 0.9]),
    ):
        with pytest.raises(InputError):
            build_surface(*points)


def scattered(n: int, noise: float, seed: int, rise: float = 0.0) -> dict[str, Array]:
    """Every run at a tension and a speed of its own; `rise` bends the law in ln v."""
    rng = np.random.default_rng(seed)
    arc = np.resize(ARCS, n)
    f = np.exp(rng.uniform(np.log(900.0), np.log(9000.0), n))
    v = np.exp(rng.uniform(np.log(0.0025), np.log(0.042), n))
    mu = bent(f, v, rise) * (1.0 + noise * rng.standard_normal(n))
    return {"arc_deg": arc, "f": f, "v": v, "mu": mu, "se": max(noise, 1e-9) * mu}


def bent(f: Array, v: Array, rise: float) -> Array:
    return law(f, v) * np.exp(rise * np.log(v / 0.01) ** 2 + 0.1 * rise * np.log(f / 3e3) ** 2)


@pytest.mark.parametrize("own_arcs", [False, True])
def test_runs_at_speeds_and_arcs_of_their_own_are_all_used(own_arcs: bool) -> None:
    for seed in range(2):
        data = scattered(120, 0.0, seed)
        if own_arcs:
            data["arc_deg"] = np.random.default_rng(seed).uniform(35.0, 120.0, 120)
        result = build(data)
        grid = result.average
        assert result.n_points == 120
        assert not result.arcs
        # each run is near to a speed, each speed near to a run
        away = np.abs(np.log(data["v"][:, None] / grid.slip_speed_m_s))
        assert max(away.min(axis=1).max(), away.min(axis=0).max()) < 0.1
        assert grid.normal_force_N_m[0] < 1.05 * data["f"].min()
        assert grid.normal_force_N_m[-1] > data["f"].max() / 1.05
        # a power law is a plane in the logarithms: exact, but at the edge of what was measured
        f, v = grid.normal_force_N_m[:, None], grid.slip_speed_m_s
        free = (grid.mu > data["mu"].min()) & (grid.mu < data["mu"].max())
        assert np.mean(free) > 0.9
        error = np.abs(grid.mu / law(f, v) - 1.0)[free]
        assert np.median(error) < 1e-6
        assert error.max() < 0.01  # beside corners that are held


def test_standard_errors_without_settings_cover_noise_and_curvature() -> None:
    pulls = []
    for seed in range(4):
        result = build(scattered(120, 0.003, seed, rise=0.02))
        grid = result.average
        true = bent(grid.normal_force_N_m[:, None], grid.slip_speed_m_s, 0.02)
        pulls.append(((grid.mu - true) / grid.mu_se).ravel())
        inner = (grid.mu / true - 1.0)[1:-1, 2:-2]
        # some forty runs an arc at 0.3 %, three arcs: a tenth of a percent
        assert np.sqrt(np.mean(inner**2)) < 2e-3
    assert 0.7 < np.sqrt(np.mean(np.concatenate(pulls) ** 2)) < 1.3
    assert np.mean(np.abs(np.concatenate(pulls)) < 2.0) > 0.9


ROUNDING = 1e-12


def beyond(result: SurfaceResult, data: dict[str, Array]) -> float:
    """How far any node lies beyond what was measured, relative to it."""
    worst = 0.0
    for grid in (result.average, *result.arcs):
        mine = np.isnan(grid.arc_deg) | np.isclose(data["arc_deg"], grid.arc_deg)
        if result.average.arc_deg == grid.arc_deg:  # of one arc alone
            mine = np.ones(data["mu"].size, dtype=bool)
        for k, speed in enumerate(grid.slip_speed_m_s):
            here = data["mu"][mine & (np.abs(data["v"] / speed - 1.0) < 0.02)]
            worst = max(worst, *(grid.mu[:, k] / here.max() - 1), *(1 - grid.mu[:, k] / here.min()))
    return worst


@settings(max_examples=10, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    exponent=st.floats(-0.6, 0.3),
    arc_effect=st.floats(-0.2, 0.2),
    noise=st.floats(0.0, 0.05),
    kept=st.floats(0.4, 1.0),
)
def test_no_campaign_leaves_its_measurements(
    seed: int, exponent: float, arc_effect: float, noise: float, kept: float
) -> None:
    rng = np.random.default_rng(seed)
    arc, tension, v = (a.ravel() for a in np.meshgrid(ARCS, TENSIONS, SPEEDS, indexing="ij"))
    v = v * (1.0 + 0.008 * rng.uniform(-1, 1, v.size))
    f = tension / 0.05 * (1.0 + 0.15 * (arc / 82.0) ** 2 * rng.uniform(-1, 1, v.size))
    mu = 0.9 * (f / 5000) ** exponent * (v / 0.01) ** 0.2 * (1 + arc_effect * (arc - 60) / 40)
    mu *= 1.0 + noise * rng.standard_normal(v.size)
    keep = rng.random(v.size) < kept
    data = {"arc_deg": arc[keep], "f": f[keep], "v": v[keep], "mu": mu[keep]}
    try:
        result = build_surface(*data.values())
    except InputError:  # too little was kept
        return
    assert beyond(result, data) < ROUNDING


# --- curves and their average over arcs by hand ---

STEPS = np.array([0.01, 0.02, 0.04])


def curve(arc, speed, f, mu, se=0.01, band=(0.1, 3.0)):
    f, mu = np.array(f, float), np.array(mu, float)
    return Curve(arc, STEPS[speed], f, mu, np.full(f.size, se), band)


def average_of(*rows):
    return average(rows, (1000.0, 4000.0))


# Student's t with one, two and three degrees of freedom; as probable as one standard deviation
T_1, T_2, T_3 = (stdtrit(n, ndtr(1.0)) for n in (1, 2, 3))
LONG, SHORT = (1000.0, 2000.0, 4000.0), (1000.0, 2000.0)


def test_nodes_that_all_arcs_cover():
    curves = (
        (curve(40.0, 0, LONG, (1.0, 0.9, 0.8), 0.01), curve(80.0, 0, LONG, (0.9, 0.8, 0.7), 0.02)),
        (curve(40.0, 1, LONG, (1.2, 1.1, 1.0), 0.01), curve(80.0, 1, LONG, (1.1, 1.0, 0.86), 0.02)),
    )
    grid, notes = average_of(*curves)
    assert notes == []
    assert grid.normal_force_N_m == pytest.approx(LONG, rel=1e-12)
    assert math.isnan(grid.arc_deg)
    assert grid.mu == pytest.approx(np.array([[0.95, 1.15], [0.85, 1.05], [0.75, 0.93]]), rel=1e-9)
    assert np.all(grid.n_arcs == 2)
    apart = np.array([[0.1, 0.1], [0.1, 0.1], [0.1, 0.14]])
    assert grid.mu_spread == pytest.approx(apart / math.sqrt(2.0), rel=1e-9)
    runs = 0.01**2 + 0.02**2
    excess = (apart**2 / 2 - runs / 2) / grid.mu**2
    tau2 = T_1**2 * excess.mean(axis=1)[:, None]  # over both speeds at the same force
    assert grid.mu_se == pytest.approx(np.sqrt(runs / 4 + tau2 * grid.mu**2 / 2), rel=5e-3)
    assert np.linalg.norm(grid.scatter, axis=-1) == pytest.approx(grid.mu_se / grid.mu, rel=1e-9)


def test_an_arc_that_ends_is_carried_on_in_parallel():
    row = (
        curve(40.0, 0, LONG, (1.0, 0.9, 0.72)),
        curve(60.0, 0, LONG, (1.1, 1.0, 0.8)),
        curve(80.0, 0, SHORT, (0.7, 0.6)),
    )
    grid, notes = average_of(row)
    assert notes == []
    growth = (0.72 + 0.8) / (0.9 + 1.0)
    assert grid.mu[:, 0] == pytest.approx([2.8 / 3, 2.5 / 3, (0.72 + 0.8 + 0.6 * growth) / 3])
    assert grid.n_arcs[:, 0].tolist() == [3, 3, 2]
    assert grid.mu_spread[2, 0] == pytest.approx(0.08 / math.sqrt(2.0))
    # the last force has half as much freedom as the others, and tells its spread itself
    runs = 2 * 0.01**2
    excess = T_2**2 * (0.08**2 / 2 - runs / 2) / grid.mu[2, 0] ** 2
    expected = math.sqrt(runs / 4 + excess * grid.mu[2, 0] ** 2 / 2)
    assert grid.mu_se[2, 0] == pytest.approx(expected, rel=0.02)  # errors are those of ln mu


def test_a_force_where_most_arcs_have_ended_takes_the_spread_of_its_neighbour():
    ends = [curve(a, 0, SHORT, (1.0 + 0.001 * a, 0.9 + 0.001 * a)) for a in (40.0, 50.0)]
    others = curve(70.0, 0, LONG, (1.0, 0.9, 0.8)), curve(80.0, 0, LONG, (1.2, 1.1, 1.0))
    grid, _ = average_of((*ends, *others))
    assert grid.n_arcs[:, 0].tolist() == [4, 4, 2]
    spread = np.std([0.94, 0.95, 0.9, 1.1], ddof=1)
    tau2 = T_3**2 * (spread**2 - 4 * 0.01**2 / 4) / grid.mu[1, 0] ** 2
    expected = math.sqrt(2 * 0.01**2 / 4 + tau2 * grid.mu[2, 0] ** 2 / 2)
    assert grid.mu_se[2, 0] == pytest.approx(expected, rel=0.02)


def test_one_tension_gives_a_surface_over_the_speed_alone():
    """Its force differs between arcs and speeds: the node is their geometric mean."""
    force, speed = [1000.0, 1000.0, 1600.0, 1600.0], [0.01, 0.02, 0.01, 0.02]
    grid = build_surface([40, 40, 80, 80], force, speed, [1.0, 1.2, 0.9, 1.1], [0.01] * 4).average
    assert grid.normal_force_N_m == pytest.approx([math.sqrt(1000.0 * 1600.0)])
    assert grid.mu == pytest.approx(np.array([[0.95, 1.15]]))
    assert np.all(grid.n_arcs == 2)


# --- curves of one arc and speed ---

F = np.array([900.0, 1650, 2600, 3550, 4300, 5050, 5850, 6600])


def curve_of(mu: np.ndarray, se: np.ndarray) -> Curve:
    return Curve(68.0, 0.01, F[: mu.size], mu, se, band=(float(mu.min()), float(mu.max())))


def test_curve_passes_through_its_points_and_ends_there() -> None:
    mu = 1 + 0.1 * np.sin(F)
    one = curve_of(mu, np.full(8, 0.01))
    assert one.at(F) == pytest.approx(mu, rel=1e-14)
    assert np.diag(one.covariance(F)) == pytest.approx((0.01 / mu) ** 2, rel=1e-12)
    assert np.isnan(one.at(np.array([899.0, 6601.0]))).all()


def test_half_way_between_two_runs_the_error_falls_by_root_two() -> None:
    pair = curve_of(np.array([1.0, 0.9]), np.array([0.01, 0.009]))  # 1 % each
    middle = np.array([np.sqrt(900.0 * 1650.0)])
    assert pair.at(middle) == pytest.approx([np.sqrt(0.9)])
    assert pair.covariance(middle)[0, 0] == pytest.approx(0.01**2 / 2, rel=1e-12)


def test_precise_repetitions_count_more_than_rough_ones() -> None:
    mu, se = [1.0, 1.3, 0.9], [0.01, 0.02, 0.01]
    grid = build_surface([40.0] * 3, [1000.0, 1000.0, 2000.0], [0.01] * 3, mu, se).average
    assert grid.normal_force_N_m == pytest.approx([1000.0, 2000.0])
    assert grid.mu[:, 0] == pytest.approx([1.06, 0.9])  # weights 4 : 1
    assert grid.mu_se[:, 0] == pytest.approx([0.02 / np.sqrt(5), 0.01])
