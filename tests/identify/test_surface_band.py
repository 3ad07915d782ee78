"""The surface stays within the band of what was measured, at every speed and between the nodes."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from beltid.errors import InputError
from beltid.identify.surface.surface import SurfaceResult, SurfaceSettings, build_surface

Array = NDArray[np.float64]
SPEEDS = np.array([0.0025, 0.005, 0.0105, 0.021, 0.042])
TENSIONS = np.array([50.0, 100, 150, 210, 270, 330, 390, 450])
ARCS = np.array([40.0, 68, 82])
ROUNDING = 1e-12


def beyond(result: SurfaceResult, data: dict[str, Array]) -> float:
    """How far any node, or value between nodes, lies beyond what was measured, relative to it."""
    worst = 0.0
    for grid in (result.average, *result.arcs):
        mine = np.isnan(grid.arc_deg) | np.isclose(data["arc_deg"], grid.arc_deg)
        if result.average.arc_deg == grid.arc_deg:  # of one arc alone
            mine = np.ones(data["mu"].size, dtype=bool)
        for k, speed in enumerate(grid.slip_speed_m_s):
            here = data["mu"][mine & (np.abs(data["v"] / speed - 1.0) < 0.02)]
            worst = max(worst, *(grid.mu[:, k] / here.max() - 1), *(1 - grid.mu[:, k] / here.min()))
        surface = grid.to_surface()
        f = np.geomspace(0.5 * data["f"].min(), 2.0 * data["f"].max(), 41)[:, None]
        v = np.geomspace(0.5 * data["v"].min(), 2.0 * data["v"].max(), 37)
        mu = surface.mu(f, v)
        measured = data["mu"][mine]
        worst = max(worst, mu.max() / measured.max() - 1.0, 1.0 - mu.min() / measured.min())
    return worst


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    exponent=st.floats(-0.6, 0.3),
    arc_effect=st.floats(-0.2, 0.2),
    noise=st.floats(0.0, 0.05),
    kept=st.floats(0.4, 1.0),
    force_nodes=st.none() | st.integers(2, 30),
)
def test_no_campaign_leaves_its_measurements(
    seed: int, exponent: float, arc_effect: float, noise: float, kept: float, force_nodes: int
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
        result = build_surface(*data.values(), settings=SurfaceSettings(force_nodes=force_nodes))
    except InputError:  # too little was kept
        return
    assert beyond(result, data) < ROUNDING
