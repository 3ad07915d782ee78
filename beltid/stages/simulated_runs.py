"""Simulate one run or a campaign of the friction rig from Python."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beltid.config import Config, load_config
from beltid.errors import BeltidError, InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.rig.runs import RunResult
from beltid.stage import Outcome
from beltid.stages.inputs import friction_columns, is_number
from beltid.stages.planned_runs import KEYS, PlannedRun, measured_settings, planned_runs
from beltid.stages.rig import STATE, bench_of, recording_columns, simulate, simulation_settings
from beltid.stages.workers import Workers, threads

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedRun:
    """One run of the simulated rig."""

    settings: PlannedRun
    """Arc, initial tension, pulley speed."""
    result: RunResult
    """All results of the simulation as plain arrays."""
    config: Config

    @property
    def tension_tight_N(self) -> float:
        """Support force of the tight span while sliding [N]."""
        return float(self.result.tension_tight_N)

    @property
    def tension_slack_N(self) -> float:
        """Support force of the slack span while sliding [N]."""
        return float(self.result.tension_slack_N)

    @property
    def mu(self) -> float:
        """Friction coefficient by Eq. (6) from these tensions [-]."""
        return self.result.mu

    @property
    def normal_force_N_m(self) -> float:
        """Mean normal force per length by Eq. (8) [N/m]."""
        return self.result.normal_force_N_m

    @property
    def recording(self) -> pd.DataFrame | None:
        """The run over time with the columns of rig.csv; None for the steady method."""
        from beltid.bench.recording import as_frame

        if self.result.recording is None:
            return None
        return as_frame(recording_columns([(self.settings, self.result)], self.config))

    @property
    def profile(self) -> pd.DataFrame:
        """The sliding state along the arc."""
        import pandas as pd

        return pd.DataFrame(self.result.profile)

    def __repr__(self) -> str:
        run = self.settings
        head = (
            f"run of the simulated rig: {run.arc_deg:g}°, {run.initial_tension_N:g} N, "
            f"{run.pulley_speed_rad_s:g} rad/s"
        )
        state = [f"  {name} = {getattr(self, name):.6g}" for name in STATE]
        return "\n".join([head, *state, "  .recording over time, .profile along the arc"])


def simulate_rig(
    config: Config | Mapping[str, Any] | str | Path | None,
    surface: FrictionSurface | Outcome[Any] | float,
    law: NormalLaw | Outcome[Any],
    *,
    arc_deg: float,
    initial_tension_N: float,
    pulley_speed_rad_s: float,
    method: str | None = None,
    elements: int | None = None,
) -> SimulatedRun:
    """Simulate one run of the friction rig.

    Parameters
    ----------
    config : Config, dict, path or None
        Belt, rig and contact; None is the built-in 5PK rig.
    surface : FrictionSurface, Outcome of build_surface or refine_surface, or float
        Friction coefficient; a number is a constant coefficient.
    law : NormalLaw or Outcome of fit_stiffness
        Normal contact law.
    arc_deg : float
        Contact arc [°], in (0, 360); it need not be in the config.
    initial_tension_N : float
        Tension before the pulley turns [N].
    pulley_speed_rad_s : float
        Speed of the pulley [rad/s].
    method : {"transient", "steady"}, optional
        By default that of the config.
    elements : int, optional
        Beam elements of the belt; by default those of the config.

    Returns
    -------
    SimulatedRun
        ``tension_tight_N``, ``tension_slack_N``, ``mu``, ``normal_force_N_m``, ``recording``,
        ``profile``.

    Raises
    ------
    InputError
        If an argument is out of its range.
    ConvergenceError
        If the simulation does not converge.
    """
    model = load_config(config)
    run = _checked_run(arc_deg, initial_tension_N, pulley_speed_rad_s)
    if elements is not None and not is_number(elements):
        raise InputError(f"elements = {elements!r}, must be a whole number, even and >= 4")
    settings = simulation_settings(model, method, elements)
    (result,) = simulate(bench_of(model, surface, law), [run], settings, Workers()).results
    if isinstance(result, BeltidError):
        raise result
    return SimulatedRun(run, result, model)


def _checked_run(arc_deg: Any, initial_tension_N: Any, pulley_speed_rad_s: Any) -> PlannedRun:
    """Return a run with the settings of a call; raise an error that lists all wrong settings."""
    problems = []
    for name, value, limit, allowed in (
        ("arc_deg", arc_deg, 360.0, "> 0 and < 360 °"),
        ("initial_tension_N", initial_tension_N, math.inf, "> 0 N and finite"),
        ("pulley_speed_rad_s", pulley_speed_rad_s, math.inf, "> 0 rad/s and finite"),
    ):
        if not is_number(value):
            problems.append(f"{name} = {value!r}, must be a number {allowed}")
        elif not 0.0 < value < limit:
            problems.append(f"{name} = {float(value):g}, must be {allowed}")
    if problems:
        raise InputError(problems)
    return PlannedRun("S001", float(arc_deg), float(initial_tension_N), float(pulley_speed_rad_s))


def simulate_campaign(
    config: Config | Mapping[str, Any] | str | Path | None,
    surface: FrictionSurface | Outcome[Any] | float,
    law: NormalLaw | Outcome[Any],
    *,
    method: str | None = None,
    jobs: int | None = 1,
    elements: int | None = None,
    friction: Any = None,
) -> pd.DataFrame:
    """Simulate every run of a campaign.

    Parameters
    ----------
    config, surface, law, method, elements
        As for `simulate_rig`.
    jobs : int or None
        Number of parallel runs; None is one per core. The result does not depend on it.
    friction : Outcome of fit_friction, DataFrame, pyarrow Table or mapping, optional
        The reduced runs of the bench, which are simulated unless the config states the settings of
        the rig; without them all combinations of the config are simulated.

    Returns
    -------
    DataFrame
        A row per run: run, arc_deg, initial_tension_N, pulley_speed_rad_s, tension_tight_N,
        tension_slack_N, mu, normal_force_N_m, status ("ok", or why it failed).
    """
    import pandas as pd

    model, measured = load_config(config), None
    if friction is not None:
        measured = measured_settings(friction_columns(friction, tuple(KEYS)), model)
    runs = planned_runs(model, measured)
    settings = simulation_settings(model, method, elements)
    campaign = simulate(bench_of(model, surface, law), runs, settings, threads(jobs))
    return pd.DataFrame(campaign.rows()).astype(dict.fromkeys(STATE, float))
