"""The contact along the arc of simulated runs, at chosen times, as a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from beltid.rigsim.rig import RunResult
from beltid.stages.campaign import PlannedRun
from beltid.stages.outcome import Outcome
from beltid.stages.simulated_runs import Campaign
from beltid.tables import schemas

KIND: Final = "profiles"


def path_beside(recording: Path) -> Path:
    """Where the profiles of a simulated recording stand."""
    return recording.parent / f"{recording.stem}_{KIND}.parquet"


def profiles_outcome(done: Campaign, times_s: Sequence[float]) -> Outcome[Campaign]:
    """Table of the profiles of a campaign.

    Parameters
    ----------
    done : Campaign
        Transient runs that kept their contact at these times.
    times_s : sequence of float
        Times after the start of rotation that were asked for [s].
    """
    parts = [part for run, result in done.finished for part in _profiles(run, result)]
    columns = {
        name: np.concatenate([part[name] for part in parts]) for name in schemas.table(KIND).names
    }
    return Outcome(
        kind=KIND,
        columns=columns,
        result=done,
        validity={"arc_position_m": (0.0, float(np.max(columns["arc_position_m"])))},
        set_aside=[{"run": run.label, "why": "; ".join(e.problems)} for run, e in done.failures],
        extra={"profile_times_s": list(times_s)},
        notes=_too_late(done, times_s),
    )


def _profiles(run: PlannedRun, result: RunResult) -> list[dict[str, np.ndarray]]:
    """Profiles of a run, one per step: two times may lie in one step."""
    states = dict(result.snapshots)
    parts = []
    for time, state in states.items():
        profile = state.profile()
        n = len(profile["arc_position_m"])
        parts.append(
            {"run": np.full(n, run.label, dtype=object), "time_s": np.full(n, time), **profile}
        )
    return parts


def _too_late(done: Campaign, times_s: Sequence[float]) -> tuple[str, ...]:
    notes = []
    for time in times_s:
        short = [run.label for run, result in done.finished if time > _turned(result)]
        if short:
            which = short[0] if len(short) == 1 else f"{len(short)} runs"
            notes.append(
                f"profile at {time:g} s: {which} had ended before, the state at the end was taken"
            )
    return tuple(notes)


def _turned(result: RunResult) -> float:
    """How long the pulley turned in a transient run [s]."""
    assert result.recording is not None
    time, omega = result.recording["time_s"], result.recording["pulley_speed_rad_s"]
    return float(time[-1] - time[np.flatnonzero(omega > 0.0)[0] - 1]) * (1.0 + 1e-12)
