"""A virtual friction rig with a known surface and known errors of its sensors, for tests only.

The rig is the simulator's sliding limit on its finer mesh; the surface is a formula that is no
power law. What the bench reads differs from what is true by errors drawn once for all runs, and by
noise drawn for each run.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from beltid.identify.friction.run import SPANS, TWO_CELLS, RigKind
from beltid.identify.surface.surface import build_surface
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.plan.candidates import settings_of_rig
from beltid.refine.inverse import refine_surface
from beltid.rig.model import Bench
from beltid.rig.runs import SimulationSettings, simulate
from beltid.uncertainty.measured import Measured, PressLaw
from beltid.uncertainty.simulated import Campaign, simulated_runs
from beltid.uncertainty.sources import ASSUMED, SURFACE, StandardUncertainties, stated_sources

BELT, RIG, LAW = Belt(1.0e5, 0.02, 0.10), Rig(0.05, 0.10), NormalLaw(6.5e7, 3.0256e11)
FINER = 1.5


def assumed(sizes: Mapping[str, float]) -> StandardUncertainties:
    """Standard uncertainties that nobody stated."""
    return {error: (size, ASSUMED) for error, size in sizes.items()}


GIVEN = assumed(
    {
        "tension_gain": 0.002,
        "cell_gain": 0.002,
        "cell_offset": 0.1,
        "arc": math.radians(0.2),
        "arc_setting": math.radians(0.3),
        "pulley_radius": 0.004,
        "span_length": 1.0e-3,
        "pulley_speed": 0.003,
        "bending_stiffness": 0.08,
        "axial_stiffness": 0.05,
        "press_force": 0.01,
        "press_displacement": 0.005,
        "segment_length": 0.01,
    }
)
"""Standard uncertainties of the virtual bench."""


def true_mu(f: np.ndarray, v: np.ndarray | float) -> np.ndarray:
    """The true surface: it falls with the force in a bent curve, and rises with the speed."""
    return (0.62 + 0.55 / (1.0 + (f / 2500.0) ** 0.8)) * (1.0 + 0.08 * np.log(v / 0.01))


FORCE, SPEED = np.geomspace(80.0, 40000.0, 60), np.geomspace(1e-3, 0.1, 25)
TRUE_SURFACE = FrictionSurface(FORCE, SPEED, true_mu(FORCE[:, None], SPEED[None, :]))


@dataclass(frozen=True)
class Design:
    """A rig with its true surface, its settings, how well it is known, and noise."""

    settings: tuple[tuple[float, ...], ...] = (
        (40.0, 82.0),
        (60.0, 130.0, 220.0, 320.0),
        (0.1, 0.42),
    )
    """Arcs [deg], initial tensions [N], speeds [rad/s]."""
    noise: float = 0.003
    given: StandardUncertainties = field(default_factory=lambda: GIVEN)
    mu: Callable[[np.ndarray, np.ndarray], np.ndarray] = true_mu
    arc_effect: float = 0.0  # standard deviation of ln mu of an arc
    belt: Belt = BELT
    rig: Rig = RIG
    law: NormalLaw = LAW
    kind: RigKind = TWO_CELLS

    @property
    def speeds(self) -> np.ndarray:
        """Sliding speeds by the nominal radius [m/s]."""
        return self.rig.R * np.array(self.settings[2])

    @property
    def press(self) -> PressLaw:
        """The contact law as it is known."""
        return PressLaw(self.law, np.zeros((2, 2)), 1.2e-4, 0.04)

    def campaign(self, measured: Measured) -> Campaign:
        """Runs with the bench as it is known, and the published surface to begin with."""
        mu, se = measured.mu, measured.mu_se
        of_runs = np.degrees(measured.beta), measured.normal_force, measured.slip_speed
        start = build_surface(*of_runs, mu, se).surface
        bench = Bench(self.belt, self.rig, Contact(), self.law, start)
        return Campaign(measured, bench, self.press)


SMALL = Design()


def read(design: Design, rng: np.random.Generator) -> Measured:
    """All settings as the bench reads them, with errors drawn for it, without noise."""
    u = defaultdict(float, {error: size for error, (size, _) in design.given.items()})
    belt, rig, kind = design.belt, design.rig, design.kind
    arcs_deg = design.settings[0]

    def draw(size: float) -> float:
        return size * float(rng.standard_normal())

    gain, gains = draw(u["tension_gain"]), [draw(u["cell_gain"]) for _ in range(2)]
    zeros, arc = [draw(u["cell_offset"]) for _ in range(2)], draw(u["arc"])
    of_setting = [draw(u["arc_setting"]) for _ in arcs_deg]
    EI, EA = (draw(u[name]) for name in ("bending_stiffness", "axial_stiffness"))
    belt = belt._replace(EI=belt.EI * (1.0 + EI), EA=belt.EA * (1.0 + EA))
    R, span = rig.R * (1.0 + draw(u["pulley_radius"])), rig.span + draw(u["span_length"])
    turning, press = 1.0 + draw(u["pulley_speed"]), 1.0 + draw(u["press_force"])
    press, travel = press / (1.0 + draw(u["segment_length"])), 1.0 + draw(u["press_displacement"])
    k = design.law.k_linear_N_m2 * press / travel, design.law.k_quadratic_N_m3 * press / travel**2
    of_torque, drag = 1.0 + draw(u["torque_gain"]), draw(u["bearing_drag"])
    f, v = np.geomspace(40.0, 60000.0, 80), np.geomspace(5e-4, 0.2, 40)
    level = design.mu(f[:, None], v[None, :])
    effects = [math.exp(draw(design.arc_effect)) for _ in arcs_deg]
    points = settings_of_rig(*design.settings)
    number = [int(np.argmin(np.abs(np.radians(arcs_deg) - point.beta))) for point in points]
    cells = [1.0 + gain + own for own in gains]
    tensions = []
    for point, j in zip(points, number, strict=True):
        T_0 = point.T_0
        if kind.measures == "two_cells":
            T_0 = T_0 * 0.5 * sum(cells) + 0.5 * sum(zeros)
        elif kind.measures == "torque":  # the cell of the slack span
            T_0 = T_0 * cells[1] + zeros[1]
        surface = FrictionSurface(f, v, level * effects[j])
        true = Bench(belt, replace(rig, R=R, span=span), Contact(), NormalLaw(*k), surface)
        at = OperatingPoint(point.beta + arc + of_setting[j], T_0, point.omega * turning)
        elements = 2 * round(0.5 * FINER * (true.model(at).nodes.size - 1))
        run = simulate(true, at, SimulationSettings("steady", elements=elements))
        exact = run.tension_tight_N, run.tension_slack_N
        shown = [(T - zero) / cell for T, zero, cell in zip(exact, zeros, cells, strict=True)]
        if kind.measures == "torque":
            shown[0] = shown[1] + ((exact[0] - exact[1]) * R + drag) / of_torque / rig.R
        elif kind.weight is not None:
            shown[SPANS.index(kind.weight)] = exact[SPANS.index(kind.weight)]
        tensions.append(shown)
    known = Bench(design.belt, rig, Contact(), design.law, FrictionSurface.constant(1.0))
    return simulated_runs(known, points, np.array(number), kind, np.array(tensions).T)


def read_campaign(design: Design, rng: np.random.Generator) -> Campaign:
    """What the bench reads of a campaign, with noise, and errors drawn for it."""
    exact = read(design, rng)
    measured = exact.scattered(design.noise * rng.standard_normal(exact.mu.size))
    return design.campaign(replace(measured, mu_se=design.noise * measured.mu))


def repetition(design: Design, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Refine a campaign; errors of ln mu within the forces of its runs, and their uncertainty."""
    campaign = read_campaign(design, np.random.default_rng(seed))
    sources = stated_sources(design.given, SURFACE, len(design.settings[0]))
    found = refine_surface(campaign, design.speeds, sources).uncertainty
    f, force = found.surface.normal_force_N_m, campaign.measured.normal_force
    inside = (f >= force.min()) & (f <= force.max())
    truth = design.mu(f[inside][:, None], design.speeds[None, :])
    error = np.log(found.surface.mu_nodes[inside] / truth)
    return error.ravel(), np.linalg.norm(found.factor[inside], axis=-1).ravel()
