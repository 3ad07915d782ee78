"""The steps of the method, in the order of the work: what each reads, uses and makes.

A step is the command of its name, the Python function, and the step of the chain; its docstring is
the help of the command. Its work stands in the module that it names, imported when it is called.

In Python, a recording or a table of runs is a DataFrame, a pyarrow Table or a mapping with the
columns of its file; reduced runs are also the `Outcome` of `fit_friction`. A surface is a
`FrictionSurface`, the `Outcome` of `build_surface` or `refine_surface`, or a constant coefficient;
a law a `NormalLaw` or the `Outcome` of `fit_stiffness`. A config is a Config, a dict, the path of a
YAML file, or None for the built-in 5PK rig. The heavy calls run on `workers`.
"""

from pathlib import Path
from typing import Any

from beltid import stages
from beltid.stage import STAGES as STAGES, Outcome, stage
from beltid.store.artifact import read_artifact

ConfigLike = Any
OF_RIG = ("belt", "rig", "press", "contact", "simulation", "uncertainty")
"""Sections of the config that matter for every use of the simulated rig."""


@stage(
    "fit-stiffness",
    makes="stiffness",
    reads={"frame": "press"},
    uses=("press", "rig", "uncertainty"),
)
def fit_stiffness(frame: Any, config: ConfigLike = None) -> Outcome[Any]:
    """Identify the normal contact law, Eq. (3), from the recording of a compression press.

    The normal force per metre of belt is k_linear * penetration + k_quadratic * penetration²; a
    statistical test shows whether temperature matters. The length of belt under the press
    (press.segment_length_cm, default 4) and the compliance of the press
    (press.machine_compliance_mm_N, default 0) scale the law: state your own in the config.

    Parameters
    ----------
    frame, config
        The columns of press.csv; segment length, machine compliance, choice of cycles.

    Returns
    -------
    Outcome
        A row per temperature and a pooled row; ``.result.pooled.law`` is the `NormalLaw`.

    Raises
    ------
    InputError, NumericsError
        If the recording cannot be used; if no law with coefficients >= 0 fits.

    Examples
    --------
    beltid fit-stiffness press.csv
    """
    return stages.friction.contact_law(frame, config)


@stage("fit-slip", makes="slip", reads={"frame": "speedloss"}, uses=("rig", "drive"))
def fit_slip(frame: Any, config: ConfigLike = None) -> Outcome[Any]:
    """Find the sliding speeds in service, Eq. (7), from the speed loss of a two-pulley drive.

    They show at which pulley speeds to run the friction rig. The sliding speed is the speed loss
    times the radius of the driver under drive: in the config, else rig.pulley_radius_m.

    Parameters
    ----------
    frame, config
        The columns of speedloss.csv; radius and speeds of the friction rig.

    Returns
    -------
    Outcome
        A row per run; ``.facts["rig_speeds_proposed_rad_s"]``: what the friction rig must cover.

    Examples
    --------
    beltid fit-slip speedloss.csv
    """
    return stages.friction.sliding_speeds(frame, config)


@stage(
    "fit-friction",
    makes="friction",
    reads={"frame": "rig"},
    uses=("friction", "rig", "belt", "conditions", "uncertainty"),
)
def fit_friction(frame: Any, config: ConfigLike = None) -> Outcome[Any]:
    """Find the friction coefficient of every run of the friction rig, Eqs. (5) to (8).

    Each run gives the sliding coefficient (Euler-Eytelwein, over the steady plateau) with its
    standard error, the sticking peak, the sliding speed and the normal force per length. They
    depend on the stated contact arc and on the radius of the belt's centreline on the pulley, 0.05
    m unless the config states rig.pulley_radius_m. A run that cannot be used is set aside.

    The channels tell what the rig measures: two cells, a weight and a cell, a torque and a cell or
    weight, a torque and the hub force; with belt_speed_m_s the belt moves.

    A table without time_s has a row per plateau: arc_deg, the channels of the forces,
    pulley_speed_rad_s or slip_speed_m_s, and if known run, mu_se, temperature_degC,
    initial_tension_N, condition, side; or mu and normal_force_N_m themselves.

    Parameters
    ----------
    frame, config
        The columns of rig.csv with the channels of this rig; radius of the pulley, conditions.

    Returns
    -------
    Outcome
        A row per run; ``status`` gives the reason if a run cannot be used.

    Raises
    ------
    InputError
        If the recording cannot be used, or none of its runs.

    Examples
    --------
    beltid fit-friction rig.csv
    """
    return stages.friction.reduced(frame, config)


@stage(
    "build-surface",
    makes="surface",
    reads={"friction": "friction"},
    uses=("friction", "rig", "belt", "uncertainty"),
)
def build_surface(
    friction: Any,
    config: ConfigLike = None,
    *,
    condition: str | None = None,
    side: str | None = None,
) -> Outcome[Any]:
    """Build the friction surface: the coefficient over normal force and sliding speed.

    One surface per contact arc and their average, as bicubic splines through the measured values;
    outside the measured range the nearest measured value is used. Runs with different conditions of
    the surface or belt sides are never combined: select with --condition and --side.

    Parameters
    ----------
    friction, config
        Columns ``arc_deg``, ``normal_force_N_m``, ``slip_speed_m_s``, ``mu_sliding`` and, if
        present, ``mu_sliding_se`` and ``status`` (rows other than "ok" are left out); the rig.
    condition : {"dry", "wet", "dusty"}, optional
        Use only runs on this surface.
    side : {"rib", "back"}, optional
        Use only runs of this side of the belt.

    Returns
    -------
    Outcome
        A row per node; ``.result.surface`` is the averaged `FrictionSurface`.

    Examples
    --------
    beltid build-surface friction.parquet
    """
    return stages.surface.published(friction, config, {"condition": condition, "side": side})


@stage(
    "refine-surface",
    makes="surface",
    file="surface_refined.parquet",
    reads={"friction": "friction", "law": "stiffness"},
    uses=(*OF_RIG, "friction"),
)
def refine_surface(
    friction: Any,
    law: Any,
    config: ConfigLike = None,
    *,
    condition: str | None = None,
    side: str | None = None,
    workers: Any = None,
) -> Outcome[Any]:
    """Find the friction surface with which the simulated rig gives the measured tensions.

    The published procedure assigns each coefficient to the mean force on the arc and neglects that
    a stiff belt presses harder where it enters and leaves the pulley. Here the surface is the
    solution of an inverse problem over all arcs. Prints the remaining difference and an uncertainty
    budget; state the uncertainties of your benches under uncertainty: in the config.

    Parameters
    ----------
    friction, law, config
        The reduced runs; normal contact law, a result also provides its scatter; belt and rig.
    condition : {"dry", "wet", "dusty"}, optional
        Use only runs on this surface.
    side : {"rib", "back"}, optional
        Use only runs of this side of the belt.

    Returns
    -------
    Outcome
        A row per node; ``.result.surface`` is the refined `FrictionSurface`,
        ``.result.misfit_table()`` the misfit before and after.

    Raises
    ------
    ConvergenceError
        If a run cannot be simulated or the iteration does not converge.

    Examples
    --------
    beltid refine-surface friction.parquet stiffness.parquet
    """
    chosen = {"condition": condition, "side": side}
    return stages.surface.refined(friction, law, config, chosen, workers)


def _friction_beside(files: dict[str, Path]) -> dict[str, Path]:
    """Add the reduced runs to the inputs if they are next to the surface made from them."""
    if "friction" in files:  # as in the chain, where nothing heavy is imported
        return files
    friction = stages.inputs.friction_of(read_artifact(files["surface"], "surface"))
    return files if friction is None else {**files, "friction": friction.path}


@stage(
    "simulate-rig",
    makes="simulated",
    file=lambda arc, tension, speed, **_: (
        "simulated_part.parquet" if arc or tension or speed else "simulated.parquet"
    ),
    reads={"surface": "surface", "law": "stiffness", "friction": "friction"},
    uses=(*OF_RIG, "friction"),
    finds=_friction_beside,
)
def simulate_recording(
    surface: Any,
    law: Any,
    config: ConfigLike = None,
    *,
    friction: Any = None,
    method: str | None = None,
    arc: list[float] | None = None,
    tension: list[float] | None = None,
    speed: list[float] | None = None,
    jobs: int | None = None,
    workers: Any = None,
) -> Outcome[Any]:
    """Simulate the runs of the friction rig with the identified laws, Eqs. (9) to (12).

    A flexible belt (ANCF beam elements) is laid on the pulley and tightened, and the pulley turns.
    All measured runs are simulated, each setting once; lists under rig: of the config take
    precedence. The result has the columns of a bench recording; runs selected by --arc, --tension
    or --speed go to simulated_part.parquet.

    Parameters
    ----------
    surface, law, config
        Friction coefficient, normal contact law; belt, rig and contact.
    friction : Outcome of fit_friction, optional
        friction.parquet whose runs are repeated. Default: the one next to SURFACE that it was made
        from, else all combinations of the settings under rig: of the config.
    method : {"transient", "steady"}, optional
        transient: stick, build-up and sliding over time. steady: the sliding limit only, faster.
        Default: as the config says, else transient.
    arc : list of float, optional
        Only runs with this contact arc [deg], one of those measured; may be repeated.
    tension : list of float, optional
        Only runs with this initial tension [N], one of those measured; may be repeated.
    speed : list of float, optional
        Only runs with this pulley speed [rad/s], one of those measured; may be repeated.
    jobs : int, optional
        Runs simulated at the same time. Default: one per core.

    Examples
    --------
    beltid simulate-rig surface.parquet stiffness.parquet --arc 82
    """
    picked, pool = (arc or (), tension or (), speed or ()), workers or stages.workers.threads(jobs)
    return stages.rig.simulated(surface, law, friction, config, picked, method, pool)


@stage(
    "compare",
    makes="compare",
    reads={"friction": "friction", "simulated": ("simulated", "rig")},
    uses=("compare", "friction", "rig", "belt", "uncertainty"),
)
def compare(friction: Any, simulated: Any, config: ConfigLike = None) -> Outcome[Any]:
    """Compare simulated and measured friction coefficients, run by run; exit 0 or 4.

    The simulated recording goes through the same reduction as the measured one; runs are matched by
    arc, tension and speed. A recording in the place of simulated.parquet compares two benches, or a
    bench and another program. Default tolerances: RMS 6 %, mean magnitude 5 %, largest 20 %; change
    them under compare: in the config. Exit 4 also if fewer than half of the usable measured runs
    have a simulated partner.

    Parameters
    ----------
    friction, simulated, config
        The reduced runs of the bench; a simulated recording with the columns of rig.csv from
        perfect load cells, or reduced runs (of a second bench, by `fit_friction`), or the table of
        `simulate_campaign`; tolerances, and for a recording the settings of its reduction.

    Returns
    -------
    Outcome
        A row per matched point; ``.result`` has ``passed`` and the statistics.

    Raises
    ------
    InputError
        If a table lacks columns, or no run of one has a partner in the other.

    Examples
    --------
    beltid compare friction.parquet simulated.parquet
    """
    return stages.compare.compared(friction, simulated, config)


@stage(
    "cross-validate",
    makes="crossvalidation",
    reads={"friction": "friction", "law": "stiffness"},
    uses=("compare", "cross_validate", *OF_RIG, "friction"),
)
def cross_validate(
    friction: Any,
    law: Any,
    config: ConfigLike = None,
    *,
    by: str | None = None,
    jobs: int | None = None,
    workers: Any = None,
) -> Outcome[Any]:
    """Predict the runs of every arc or speed from the others, and compare; exit 0 or 4.

    Each arc (or inner speed) is left out once, the surface is refined from the other runs, and the
    runs left out are simulated with it. The tolerances are those of compare.

    Parameters
    ----------
    friction, law, config
        As for `refine_surface`; the config also has the tolerances.
    by : {"arc", "speed"}, optional
        Setting that is left out in turn; the lowest and the highest speed never are. Default: as
        the config says under cross_validate, else arc.
    jobs : int, optional
        Surfaces refined at the same time. Default: one per core.

    Returns
    -------
    Outcome
        Like that of `compare`, with a row per predicted run.

    Raises
    ------
    NotPossible, ConvergenceError
        If too few settings or runs would be left; if a surface or a run does not converge.

    Examples
    --------
    beltid cross-validate friction.parquet stiffness.parquet --by speed
    """
    by, pool = by or config.cross_validate.by, workers or stages.workers.threads(jobs)
    return stages.compare.predicted_runs(friction, law, config, by, pool)


@stage(
    "simulate-drive",
    makes="drive",
    reads={"surface": "surface", "law": "stiffness", "slip": "slip"},
    uses=("belt", "drive", "rig", "press", "uncertainty"),
)
def predict_drive(
    surface: Any, law: Any, config: ConfigLike = None, *, slip: Any = None
) -> Outcome[Any]:
    """Predict a belt drive: speed loss, belt tensions, hub forces, reserve against slip.

    The section drive: of the config describes the drive. The belt is an extensible string with mass
    on the elastic bed of its ribs, or a rod with bending stiffness. Every speed loss is split into
    creep, seating and slip and has an uncertainty. One row per operating point and pulley.

    Parameters
    ----------
    surface, law, config
        Friction coefficient and normal contact law of the ribs, the latter as a result also
        provides its scatter; belt, drive and its operating points.
    slip : Outcome of fit_slip, optional
        slip.parquet of fit-slip: predict the operating points of that recording instead of those of
        the config.

    Raises
    ------
    InputError, NumericsError
        If the stated drive is impossible; if no operating point has a steady state.

    Examples
    --------
    beltid simulate-drive surface_refined.parquet stiffness.parquet --from slip.parquet
    """
    return stages.drive.predicted(surface, law, slip, config)


def simulate_drive(config: ConfigLike, surface: Any, law: Any) -> Outcome[Any]:
    """Predict the operating points of a belt drive that a config states; see `predict_drive`."""
    return predict_drive(surface, law, config)


@stage(
    "compare-drive",
    makes="compare_drive",
    reads={"slip": "slip", "drive": "drive"},
    uses=("compare_drive",),
)
def compare_drive(slip: Any, drive: Any, config: ConfigLike = None) -> Outcome[Any]:
    """Compare predicted and measured speed losses of a drive; exit 0 or 4.

    Nothing is fitted to this recording: it is an independent test of the identified laws. Points
    below a fifth of the largest torque are not judged. Default tolerance: RMS 10 %; change it under
    compare_drive: in the config.

    Parameters
    ----------
    slip, drive, config
        The measured losses, the prediction of the same recording (an `Outcome`); tolerance.

    Examples
    --------
    beltid compare-drive slip.parquet drive.parquet
    """
    return stages.compare.compared_losses(slip, drive, config)


@stage(
    "plan",
    makes="plan",
    file="plan.csv",
    reads={"surface": "surface", "law": "stiffness", "friction": "friction"},
    uses=(*OF_RIG, "friction", "plan"),
)
def plan_runs(
    surface: Any = None,
    law: Any = None,
    config: ConfigLike = None,
    *,
    friction: Any = None,
    runs: int = 12,
    goal_u: float = 0.01,
) -> Outcome[Any]:
    """Plan the next runs of the friction rig, or report that no more are needed.

    Selects, from the settings under plan: in the config, the runs that minimise the uncertainty of
    the refined surface, averaged over all their forces and speeds; errors that all runs share are
    those under uncertainty: in the config. Prints stop if the goal is reached or further runs do
    not help, and the shared error whose reduction would help most. Without SURFACE and STIFFNESS it
    starts from values typical of such a belt. One row per run in the order of the session.

    Parameters
    ----------
    surface, law, config
        The known surface, an `Outcome`, if any; normal contact law, by default that of the paper's
        5PK belt; belt, rig, and under ``plan:`` the possible settings of the rig.
    friction : table of runs, optional
        friction.parquet of fit-friction: new runs are assumed as noisy as its runs.
    runs : int
        Runs to plan at most; fewer if they reach the goal, none if they do not help.
    goal_u : float
        Sufficient relative standard uncertainty of the friction coefficient.

    Returns
    -------
    Outcome
        A row per run; ``.result.plan`` has their gain and whether to stop.

    Raises
    ------
    InputError
        If an argument is out of range, or the surface has no covariance.

    Examples
    --------
    beltid plan surface_refined.parquet stiffness.parquet --from friction.parquet
    """
    return stages.plan.planned(surface, law, config, friction, runs, goal_u)


stage(
    "press-curves",
    makes="press_curves",
    reads={"frame": "press"},
    uses=("press",),
    is_command=False,
)(lambda frame, config: stages.friction.press_branches(frame, config))
stage(
    "rig-curves",
    makes="rig_curves",
    reads={"frame": "rig", "friction": "friction"},
    uses=("friction", "rig", "belt"),
    is_command=False,
)(lambda frame, friction, config: stages.friction.rig_runs(frame, friction, config))


def read_press(path: str | Path, config: ConfigLike = None) -> Any:
    """Read a recording of the press, in any format that ``beltid inspect`` knows.

    Parameters
    ----------
    path : path
        A file; or a folder, a pattern such as ``"press/*.csv"`` or a zip file with a file per test.
    config : Config, dict, path or None
        Names, units and dialect of the file, where they are not recognised automatically.

    Returns
    -------
    DataFrame
        The columns of press.csv, in their units; ``.attrs["notes"]`` says how it was read.

    Raises
    ------
    InputError
        With all problems, each with its line.
    """
    return _frame(path, "press", config)


def read_rig(path: str | Path, config: ConfigLike = None) -> Any:
    """Read a recording of the friction rig; see `read_press`. The columns are those of rig.csv."""
    return _frame(path, "rig", config)


def read_speedloss(path: str | Path, config: ConfigLike = None) -> Any:
    """Read a recording of the speed-loss bench; see `read_press`. Columns of speedloss.csv."""
    return _frame(path, "speedloss", config)


def _frame(path: str | Path, kind: str, config: ConfigLike) -> Any:
    from beltid.bench.recording import as_frame, read_recording
    from beltid.config import load_config

    recording = read_recording(path, kind, load_config(config))
    return as_frame(recording.columns, recording.notes)
