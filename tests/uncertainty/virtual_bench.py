"""A virtual friction rig with a known surface and known errors of its sensors, for tests only.

The rig is the simulator's sliding limit on its finer mesh; the surface is a formula that is no
power law. What the bench reads differs from what is true by errors drawn once for all runs, and by
noise drawn for each run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from beltid.identify.surface.surface import build_surface
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.refine.inverse import refine_surface
from beltid.rig.model import Bench
from beltid.rig.runs import SimulationSettings, simulate
from beltid.uncertainty.measured import Measured, PressLaw
from beltid.uncertainty.simulated import Campaign
from beltid.uncertainty.sources import (
    SURFACE,
    StandardUncertainties,
    reduction_sources,
    stated_sources,
)

BELT, RIG, LAW = Belt(1.0e5, 0.02, 0.10), Rig(0.05, 0.10), NormalLaw(6.5e7, 3.0256e11)
FORCE = np.geomspace(80.0, 40000.0, 60)
SPEED = np.geomspace(1e-3, 0.1, 25)
FINER = 1.5

USUAL_CLASS = StandardUncertainties(
    {
        "tension_gain": 0.002,
        "cell_gain": 0.001,
        "cell_offset": 0.05,
        "arc": math.radians(0.1),
        "arc_setting": math.radians(0.2),
        "pulley_radius": 0.002,
        "span_length": 5.0e-4,
        "pulley_speed": 0.002,
        "bending_stiffness": 0.05,
        "axial_stiffness": 0.05,
        "press_force": 0.005,
        "press_displacement": 0.002,
        "segment_length": 0.005,
    }
)
"""Those of a usual bench, with the compliance of the press known."""
GIVEN = StandardUncertainties(
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
NO_ERRORS = StandardUncertainties()


def true_mu(f: np.ndarray, v: np.ndarray | float) -> np.ndarray:
    """The true surface: it falls with the force in a bent curve, and rises with the speed."""
    return (0.62 + 0.55 / (1.0 + (f / 2500.0) ** 0.8)) * (1.0 + 0.08 * np.log(v / 0.01))


TRUE_SURFACE = FrictionSurface(FORCE, SPEED, true_mu(FORCE[:, None], SPEED[None, :]))


@dataclass(frozen=True)
class Design:
    """Settings and noise of a campaign."""

    arcs_deg: tuple[float, ...] = (40.0, 68.0, 82.0)
    tensions_N: tuple[float, ...] = (50.0, 100.0, 160.0, 220.0, 270.0, 310.0, 360.0, 411.0)
    speeds_rad_s: tuple[float, ...] = (0.05, 0.10, 0.21, 0.42, 0.84)
    noise: float = 0.003
    given: StandardUncertainties = field(default=GIVEN)
    shared: float = (
        0.0  # standard deviation of an error of ln mu in all runs, larger at low tension
    )

    @property
    def speeds(self) -> np.ndarray:
        """Sliding speeds by the nominal radius [m/s]."""
        return RIG.R * np.array(self.speeds_rad_s)


SMALL = Design((40.0, 82.0), (60.0, 130.0, 220.0, 320.0), (0.1, 0.42))


def read_campaign(design: Design, rng: np.random.Generator) -> Campaign:
    """What the bench reads of a campaign, with errors drawn for it."""
    u = design.given

    def draw(size: float) -> float:
        return size * float(rng.standard_normal())

    gain, gains = draw(u["tension_gain"]), [draw(u["cell_gain"]) for _ in range(2)]
    zeros, arc = [draw(u["cell_offset"]) for _ in range(2)], draw(u["arc"])
    settings = [draw(u["arc_setting"]) for _ in design.arcs_deg]
    belt = replace(
        BELT,
        EI=BELT.EI * (1 + draw(u["bending_stiffness"])),
        EA=BELT.EA * (1 + draw(u["axial_stiffness"])),
    )
    rig = Rig(RIG.R * (1 + draw(u["pulley_radius"])), RIG.span + draw(u["span_length"]))
    turning, press = 1 + draw(u["pulley_speed"]), 1 + draw(u["press_force"])
    press /= 1 + draw(u["segment_length"])
    travel = 1 + draw(u["press_displacement"])
    law = NormalLaw(LAW.k_linear_N_m2 * press / travel, LAW.k_quadratic_N_m3 * press / travel**2)
    bench = Bench(belt, rig, Contact(), law, TRUE_SURFACE)
    rows = []
    for k, arc_deg in enumerate(design.arcs_deg):
        for T_0 in design.tensions_N:
            true_T_0 = T_0 * (1 + gain + 0.5 * sum(gains)) + 0.5 * sum(zeros)
            for omega in design.speeds_rad_s:
                beta = math.radians(arc_deg) + arc + settings[k]
                point = OperatingPoint(beta, true_T_0, omega * turning)
                n = 2 * round(0.5 * FINER * (bench.model(point).nodes.size - 1))
                run = simulate(bench, point, SimulationSettings("steady", elements=n))
                tight = (run.tension_tight_N - zeros[0]) / (1 + gain + gains[0])
                slack = (run.tension_slack_N - zeros[1]) / (1 + gain + gains[1])
                rows.append((k, math.radians(arc_deg), T_0, omega, tight, slack))
    number, beta, T_0, omega, tight, slack = np.array(rows).T
    noise = design.noise * rng.standard_normal(beta.size)
    log_ratio = np.log(tight / slack) * (1.0 + noise)
    columns = {}
    if design.shared:
        columns["shared_tail"] = design.shared * np.sqrt(100.0 / T_0)[:, None]
        log_ratio *= np.exp(columns["shared_tail"][:, 0] * rng.standard_normal())
    mean = np.sqrt(tight * slack)
    mu = log_ratio / beta
    measured = Measured(
        R=RIG.R,
        arc=number.astype(np.intp),
        beta=beta,
        T_0=T_0,
        omega=omega,
        tight=mean * np.exp(0.5 * log_ratio),
        slack=mean * np.exp(-0.5 * log_ratio),
        mu=mu,
        mu_se=design.noise * mu,
        columns=columns,
    )
    start = build_surface(
        np.degrees(beta), measured.normal_force, measured.slip_speed, mu, measured.mu_se
    ).surface
    press_law = PressLaw(LAW, np.zeros((2, 2)), 1.2e-4, 0.04)
    return Campaign(measured, Bench(BELT, RIG, Contact(), LAW, start), press_law)


@dataclass(frozen=True)
class Repetition:
    """Errors of ln mu at the nodes within the forces of the runs, and their uncertainties."""

    error: np.ndarray
    scatter: np.ndarray
    combined: np.ndarray


def repetition(design: Design, seed: int) -> Repetition:
    """A campaign read, refined and compared with the truth."""
    campaign = read_campaign(design, np.random.default_rng(seed))
    stated = stated_sources(design.given, SURFACE, len(design.arcs_deg))
    sources = (*stated, *reduction_sources(campaign.measured.columns))
    found = refine_surface(campaign, design.speeds, sources).uncertainty
    f, force = found.surface.normal_force_N_m, campaign.measured.normal_force
    inside = (f >= force.min()) & (f <= force.max())
    truth = true_mu(f[inside][:, None], design.speeds[None, :])
    return Repetition(
        error=np.log(found.surface.mu_nodes[inside] / truth),
        scatter=np.linalg.norm(found.scatter[inside], axis=-1),
        combined=np.linalg.norm(found.factor[inside], axis=-1),
    )
