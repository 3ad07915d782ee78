"""What a surface is refined from, its uncertainty, and the draws of its Monte Carlo check."""

from __future__ import annotations

import math
import pickle
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from beltid.config import Config
from beltid.errors import InputError, counted
from beltid.identify.estimators.statistics import settings_of
from beltid.identify.surface.surface import SurfaceSettings
from beltid.identify.surface.surface import build_surface as publish
from beltid.params import Rig
from beltid.rigsim.model import Bench
from beltid.stages.identification.conditions import rows_of_one
from beltid.stages.identification.reduction import rig_kind
from beltid.stages.reporter import Reporter
from beltid.stages.uncertainties import SECTION, standard_uncertainties
from beltid.stages.workers import Workers
from beltid.uncertainty.budget import SurfaceUncertainty
from beltid.uncertainty.campaign import Campaign
from beltid.uncertainty.measured import measured_runs, own_errors
from beltid.uncertainty.monte_carlo import Nominal, Replicates, gathered, replicates
from beltid.uncertainty.press_law import PressLaw
from beltid.uncertainty.refined import Refined, changes_and_scatter
from beltid.uncertainty.sources import Source, all_sources, reduction_sources

KEYS: Final = (
    "belt.axial_stiffness_N",
    "belt.bending_stiffness_N_m2",
    "rig.kind",
    "rig.weight_on",
    "rig.torque_with",
    "rig.slide",
    "rig.running_measures",
    "rig.pulley_radius_m",
    "rig.span_length_m",
    "rig.supports",
    "contact.points_per_element",
    "surface",
    "press.segment_length_cm",
    "friction.correct_temperature",
    "friction.reference_temperature_degC",
    SECTION,
)
PER_CALL: Final = 5
FEWEST: Final = 50
CHECKED: Final = "linear standard uncertainty against Monte Carlo, in percent of mu"
COLUMNS: Final = (
    "group",
    "values",
    "linear_percent",
    "monte_carlo_percent",
    "largest_deviation_percent",
    "largest_asymmetry",
    "linear_fails",
)
NEEDED: Final = (
    "run",
    "arc_deg",
    "initial_tension_N",
    "pulley_speed_rad_s",
    "slip_speed_m_s",
    "normal_force_N_m",
    "mu_sliding",
    "mu_sliding_se",
)
PUBLISHED: Final = ("arc_deg", "normal_force_N_m", "slip_speed_m_s", "mu_sliding")
REASONS: Final = 3  # why runs cannot be used that are told, the most frequent ones
SPEED_GAP: Final = 0.1  # in ln v: a run further than this from every speed has one of its own
SETTING_GAP: Final = 0.03  # relative gap that parts two settings of the speed


@dataclass(frozen=True, slots=True)
class Draws:
    """How many replicates, and who carries them out.

    Attributes
    ----------
    count : int
        Number of replicates; 0 leaves the check out.
    seed : int
        Of the draws.
    reporter : Reporter
        Hears what is going on.
    workers : Workers
        Who carries them out; the result does not depend on it.
    """

    count: int = 0
    seed: int = 0
    reporter: Reporter = field(default_factory=Reporter)
    workers: Workers = field(default_factory=Workers)

    def __post_init__(self) -> None:
        problems = []
        if self.count != 0 and self.count < FEWEST:
            problems.append(
                f"--bootstrap = {self.count}, must be at least {FEWEST} draws: fewer say nothing "
                "about a standard uncertainty"
            )
        if self.seed < 0:
            problems.append(f"--seed = {self.seed}, must be >= 0")
        if problems:
            raise InputError(problems)

    @property
    def choices(self) -> dict[str, int]:
        """What of it a result was made from."""
        return {"bootstrap": self.count, "seed": self.seed} if self.count else {}


def drawn(nominal: Nominal, draws: Draws) -> Replicates:
    """Replicates in their order, however many workers there are."""
    # as a worker gets it: sums over an array round otherwise where it lies otherwise in memory
    nominal = pickle.loads(pickle.dumps(nominal))
    groups: Sequence[range] = [
        range(first, min(first + PER_CALL, draws.count))
        for first in range(0, draws.count, PER_CALL)
    ]
    parts: dict[int, Replicates] = {}
    calls = [(nominal, draws.seed, group) for group in groups]
    with draws.reporter.progress("Monte Carlo", len(groups)) as advance:
        for index, part in draws.workers.as_ended(replicates, calls):
            parts[index] = part
            advance()
    return gathered([parts[i] for i in range(len(groups))])


def check_table(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows of the check as they are shown."""
    return [{name: row.get(name) for name in COLUMNS} for row in rows]


def prepared_campaign(
    columns: Mapping[str, np.ndarray],
    press: PressLaw,
    config: Config,
    name: str,
    chosen: Mapping[str, str | None] | None = None,
) -> tuple[Campaign, np.ndarray, np.ndarray, list[dict[str, Any]]]:
    """Campaign with the surface to start from, its speeds, its rows, and what was set aside.

    `chosen` are condition and side of the belt, where the runs were made under several.
    """
    rig = rig_of_runs(columns, config)
    good, set_aside = usable_runs(columns, rig)
    good = rows_of_one(columns, good, chosen or {}, name)
    if good.size < 4:
        reasons = Counter(one["why"] for one in set_aside)
        why = "".join(f"; {counted(n, 'run')}: {text}" for text, n in reasons.most_common(REASONS))
        text = f"{name}: {counted(good.size, 'run')} can be used, at least 4 are needed{why}"
        raise InputError(text, code="no-run")
    arc_deg, f, v, mu = (columns[key][good] for key in PUBLISHED)
    own = own_errors(columns)
    mu_se = None if own is None else own[good]
    settings = SurfaceSettings(force_nodes=config.surface.force_nodes)
    start = publish(arc_deg, f, v, mu, mu_se, settings).surface
    speeds = _speeds(start.slip_speed_m_s, np.abs(v))
    measured = measured_runs(columns, good, rig.R, rig_kind(config), rig.given_force)
    bench = Bench(config.belt_params(), rig, config.contact_params(), press.law, start)
    return Campaign(measured, bench, press), speeds, good, set_aside


def rig_of_runs(columns: Mapping[str, np.ndarray], config: Config) -> Rig:
    """The rig that the runs are simulated on.

    The kind is that of the runs: a table that says it was made with a torque is refused otherwise.
    While the whole arc slides one tension settles the other, however they came about. Where nobody
    wrote down the tension at rest the sum of both while sliding takes its place, as under a hub
    force.
    """
    if "torque_with" in columns and config.rig.measures != "torque":
        raise InputError(
            f"rig.kind: {config.rig.kind}, but the tensions of the friction table were measured "
            "beside a torque; must be rig.kind: torque"
        )
    rig = config.rig_params()
    initial = np.asarray(columns["initial_tension_N"], dtype=float)
    if rig.given_force == "none" and not np.isfinite(initial).any():
        return replace(rig, given_force="hub")
    return rig


def usable_runs(
    columns: Mapping[str, np.ndarray], rig: Rig
) -> tuple[np.ndarray, list[dict[str, Any]]]:
    """Rows that can be used, and those that cannot, with the reason.

    The tension at rest is needed where no force is given that stays while the pulley turns.
    """
    needed = ("initial_tension_N",) if rig.given_force == "none" else ()
    n = len(columns["mu_sliding"])
    status = columns.get("status", np.full(n, "ok", dtype=object))
    good, set_aside = [], []
    for i in range(n):
        why = "" if status[i] == "ok" else str(status[i])
        for key in (*PUBLISHED, *needed):
            value = float(columns[key][i])
            if not why and math.isnan(value):
                why = f"{key} is not known"
            if not why and not 0.0 < value < math.inf:
                why = f"{key} = {value:g}, must be > 0"
        if why:
            set_aside.append({"run": str(columns["run"][i]), "why": why})
        else:
            good.append(i)
    return np.array(good, dtype=int), set_aside


def _speeds(published: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Speeds of the refined surface [m/s]: of the published one, and settings that it left out.

    A speed of few runs has no range of forces in common with the others, which the published
    surface asks for; here it has its level by its runs and its shape by its neighbours.
    """
    far = v[np.abs(np.log(v[:, None] / published)).min(axis=1) > SPEED_GAP]
    if far.size == 0:
        return published
    label = settings_of(far, SETTING_GAP)
    return np.union1d(published, [far[label == k].mean() for k in np.unique(label)])


def speed_labels(
    columns: Mapping[str, np.ndarray], used: np.ndarray, speeds: np.ndarray
) -> np.ndarray:
    """Index of the speed setting of each used run."""
    v = columns["slip_speed_m_s"][used]
    return np.asarray(np.argmin(np.abs(np.log(v[:, None] / speeds)), axis=1))


def reference_temperature(config: Config, campaign: Campaign) -> float | None:
    """Temperature to which the surface is corrected [°C]; None if that was not asked for."""
    if not config.friction.correct_temperature:
        return None
    warm = campaign.measured.temperature_degC
    if warm is None or not np.isfinite(warm).any():
        raise InputError(
            "friction.correct_temperature: true, but no run has a temperature; found no values in "
            "the column temperature_degC"
        )
    stated = config.friction.reference_temperature_degC
    return float(np.nanmean(warm)) if stated is None else stated


def shared_sources(campaign: Campaign, config: Config) -> tuple[Source, ...]:
    """Errors that runs share, as they are stated."""
    n_arcs = int(campaign.measured.arc.max()) + 1
    stated = all_sources(standard_uncertainties(config), n_arcs, campaign.press.has_scatter)
    return (*stated, *reduction_sources(campaign.measured.columns))


def refined_uncertainty(found: Refined) -> SurfaceUncertainty:
    """What the causes of error do to the refined surface."""
    changes, scatter = changes_and_scatter(found)
    measured = found.campaign.measured
    return SurfaceUncertainty(
        surface=found.refined.surface,
        sources=found.sources,
        changes=changes,
        scatter=scatter,
        arcs_deg=measured.arcs_deg,
        degrees_of_freedom=max(measured.mu.size - found.refined.effective_parameters, 1.0),
    )
