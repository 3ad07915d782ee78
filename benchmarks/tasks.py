"""The work that is timed, through the doors that users have: ``python benchmarks/tasks.py NAME``.

Every task prints one JSON object: ``seconds`` of processor time after warm-up, and what else its
target needs. A task imports nothing of beltid but its public names, so that it runs with any
version: ``benchmarks.bench --beside PYTHON`` has another one do the same work in turns. All data
are synthetic.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # one core, before numpy is imported

import numpy as np  # noqa: E402

Array = np.ndarray[Any, np.dtype[np.float64]]
ROOT = Path(__file__).resolve().parents[1]
SCRIPT = str(Path(sys.executable).with_name("beltid"))
ARCS_DEG = (40.0, 68.0, 82.0)
TENSIONS_N = tuple(np.linspace(100.0, 450.0, 8).tolist())
SPEEDS_RAD_S = (0.1, 0.2, 0.5, 1.0, 2.0)
MU, K_LINEAR = 0.5, 1.0e8
"""Constant friction and linear normal law [N/m²] of the comparison with Exudyn."""
SAMPLES = 3000  # of a run that is reduced
CSV_MB = 300.0
FINE = 200  # elements of the reference


def config(**sections: Any) -> dict[str, Any]:
    """A belt of EA 1e5 N, EI 0.02 N m², 0.10 kg/m on 120 settings of a rig."""
    belt = {
        "axial_stiffness_N": 1.0e5,
        "bending_stiffness_N_m2": 0.02,
        "mass_per_length_kg_m": 0.10,
    }
    rig = {
        "pulley_radius_m": 0.05,
        "span_length_m": 0.10,
        "arcs_deg": list(ARCS_DEG),
        "initial_tensions_N": list(TENSIONS_N),
        "pulley_speeds_rad_s": list(SPEEDS_RAD_S),
    }
    return {"belt": belt, "rig": rig, **sections}


def few() -> dict[str, Any]:
    """The same with a single run, to warm up."""
    one = config()
    one["rig"] |= {"arcs_deg": [60], "initial_tensions_N": [200], "pulley_speeds_rad_s": [0.3]}
    return one


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Processor time of some work [s], and what it returns."""
    start = time.process_time()
    result = work()
    return time.process_time() - start, result


def campaign(method: str) -> dict[str, float]:
    """120 runs of the simulated rig: the limit of full sliding, or in time."""
    import beltid

    law = beltid.NormalLaw(k_linear_N_m2=K_LINEAR, k_quadratic_N_m3=0.0)
    beltid.simulate_campaign(few(), MU, law, method=method)
    seconds, table = timed(lambda: beltid.simulate_campaign(config(), MU, law, method=method))
    found = {"seconds": seconds}
    if method == "steady":
        fine = beltid.simulate_campaign(config(), MU, law, method=method, elements=FINE)
        error = table["tension_tight_N"] / fine["tension_tight_N"] - 1.0
        found["worst_percent"] = 100.0 * float(np.max(np.abs(error)))
    return found


def exudyn() -> dict[str, float]:
    """The same limit by Exudyn's static solver: each run by itself, and lay-ons shared."""
    from exudyn_rig import PeerRig  # type: ignore[import-not-found]

    def work(shared: bool) -> Array:
        found = []
        for arc in ARCS_DEG:
            rig = PeerRig(np.radians(arc))
            for T_0 in TENSIONS_N:
                for k, omega in enumerate(SPEEDS_RAD_S):
                    if not shared:
                        rig = PeerRig(np.radians(arc))
                    if not shared or k == 0:
                        rig.lay_on(T_0)
                    found.append(rig.slide(omega))
        return np.array(found)

    work(shared=True)
    return {
        "seconds": timed(lambda: work(shared=False))[0],
        "shared": timed(lambda: work(shared=True))[0],
    }


def laws_of_5pk() -> tuple[Any, Any, Any]:
    """Friction runs, normal law and published surface of the synthetic 5PK belt."""
    import beltid

    recorded = ROOT / "rigdata" / "5pk"
    friction = beltid.fit_friction(beltid.read_rig(recorded / "rig.csv"), CONFIG_5PK)
    law = beltid.fit_stiffness(beltid.read_press(recorded / "press.csv"), CONFIG_5PK)
    return friction, law, beltid.build_surface(friction, CONFIG_5PK)


CONFIG_5PK = ROOT / "configs" / "5pk.yaml"


def inverse() -> dict[str, float]:
    """The refined surface of 120 runs, with its uncertainty."""
    import beltid

    friction, law, _ = laws_of_5pk()
    beltid.simulate_campaign(few(), MU, beltid.NormalLaw(K_LINEAR, 0.0), method="steady")
    work = lambda: beltid.refine_surface(friction, law, CONFIG_5PK)  # noqa: E731
    work()
    return {"seconds": timed(work)[0]}


def drive() -> dict[str, float]:
    """51 points of a drive of two pulleys, by rods."""
    import beltid

    _, law, surface = laws_of_5pk()
    pulleys = [
        {"name": "driver", "x_m": 0.0, "y_m": 0.0, "radius_m": 0.05},
        {"name": "driven", "x_m": 0.25, "y_m": 0.0, "radius_m": 0.05},
    ]
    torques = np.linspace(0.0, 14.0, 51).tolist()
    points = {"driver_speed_rad_s": [62.8] * 51, "torque_N_m": {"driven": torques}}
    given = config(drive={"method": "rod", "pulleys": pulleys, "operating_points": points})
    given["drive"]["initial_tension_N"] = [310.0]
    work = lambda: beltid.simulate_drive(given, surface, law)  # noqa: E731
    work()
    return {"seconds": timed(work)[0]}


def reduction() -> dict[str, float]:
    """From 120 runs of 3,000 samples to 120 friction coefficients."""
    import beltid

    work = lambda: beltid.fit_friction(runs(120, SAMPLES), config())  # noqa: E731
    work()
    frame = runs(120, SAMPLES)
    return {"seconds": timed(lambda: beltid.fit_friction(frame, config()))[0]}


def runs(count: int, samples: int, seed: int = 0) -> Any:
    """Synthetic runs of the friction rig: rest, sticking peak, sliding, noise; a frame."""
    import pandas as pd

    rng = np.random.default_rng(seed)
    clock = np.linspace(0.0, 12.0, samples)
    since = np.clip(clock - 1.0, 0.0, None)
    frames = []
    for run in range(count):
        arc, T_0 = ARCS_DEG[run % 3], TENSIONS_N[run // 3 % 8]
        speed = SPEEDS_RAD_S[run // 24 % 5]
        travel = 0.05 * speed * since
        build_up = -np.expm1(-travel / 1e-4) * (1.0 + 0.1 * np.exp(-travel / 4e-3))
        half = T_0 * np.tanh(0.25 * (T_0 / 200.0) ** -0.1 * np.radians(arc) * build_up)
        noise = 0.5 * rng.standard_normal((2, samples))
        columns = {
            "run": f"r{run:05d}",
            "time_s": np.round(clock, 6),
            "tension_tight_N": np.round(T_0 + half + noise[0], 3),
            "tension_slack_N": np.round(T_0 - half + noise[1], 3),
            "pulley_speed_rad_s": np.round(speed * (since > 0.0), 5),
            "arc_deg": arc,
            "initial_tension_N": T_0,
        }
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def spent(*command: str, status: int = 0, extra: dict[str, str] | None = None) -> float:
    """Processor time of a program and of all that it starts [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, env=os.environ | (extra or {}), capture_output=True, text=True)
    if done.returncode != status:
        raise RuntimeError(f"{' '.join(command)}: status {done.returncode}\n{done.stderr}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


FIRST_RUN = (
    "import beltid; law = beltid.NormalLaw(1e8, 0.0); point = dict(arc_deg=82, "
    "initial_tension_N=270, pulley_speed_rad_s=0.21); [beltid.simulate_rig(None, 0.5, law, "
    "method=m, **point) for m in ('steady', 'transient')]"
)


def compiling() -> dict[str, float]:
    """All kernels of the rig, with an empty cache, beyond a call with a full one."""
    with tempfile.TemporaryDirectory() as empty:
        call = (sys.executable, "-c", FIRST_RUN)
        cold, warm = (spent(*call, extra={"NUMBA_CACHE_DIR": empty}) for _ in range(2))
    return {"seconds": cold - warm}


def help_page() -> dict[str, float]:
    """`beltid --help`, and the import of the library that it is made with."""
    page = min(spent(SCRIPT, "--help") for _ in range(5))
    library = min(spent(sys.executable, "-c", "import typer") for _ in range(5))
    return {"seconds": page, "ratio": page / library}


def chain() -> dict[str, float]:
    """`beltid run` of the 5PK belt with compiled kernels, and once more with nothing to do."""
    with tempfile.TemporaryDirectory() as folder:
        here = Path.cwd()
        os.chdir(folder)
        command = (SCRIPT, "run", str(CONFIG_5PK), "--jobs", "1", "-q")
        try:
            first, second = spent(*command), min(spent(*command) for _ in range(2))
        finally:
            os.chdir(here)
    return {"seconds": first, "again": second}


READ = {
    "ours": "import time, beltid; t = time.perf_counter(); beltid.read_rig(sys.argv[1])",
    "theirs": "import time, pyarrow.csv as c; t = time.perf_counter(); c.read_csv(sys.argv[1])",
}
TELL = "\nimport resource; print(time.perf_counter() - t, resource.getrusage(0).ru_maxrss)"


def csv() -> dict[str, float]:
    """Reading 300 MB of CSV, all cores, against pyarrow alone (wall), and the memory it takes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rig.csv"
        block = runs(24, 20_000).to_csv(index=False)
        head, _, rows = block.partition("\n")
        with path.open("w") as file:
            file.write(f"{head}\n")
            while file.tell() < 1e6 * CSV_MB:
                file.write(rows.replace("r0", f"r{file.tell()}x"))
        numbers_MB = 8e-6 * 6 * sum(1 for _ in path.open())
        took = {}
        for who, program in READ.items():
            command = [sys.executable, "-c", "import sys; " + program + TELL, str(path)]
            told = [subprocess.check_output(command, text=True).split() for _ in range(2)]
            took[who] = min((float(s), float(kB)) for s, kB in told)
    return {
        "seconds": took["ours"][0],
        "ratio": took["ours"][0] / took["theirs"][0],
        "memory": 1.024e-3 * took["ours"][1] / numbers_MB,
    }


def columns() -> dict[str, float]:
    """A CSV of a million columns is refused."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "wide.csv"
        path.write_text(",".join(f"c{i}" for i in range(1_000_000)) + "\n")
        return {"seconds": spent(SCRIPT, "fit-friction", str(path), status=2)}


TASKS: dict[str, Callable[[], dict[str, float]]] = {
    "steady": partial(campaign, "steady"),
    "transient": partial(campaign, "transient"),
    **{of.__name__: of for of in (exudyn, inverse, drive, reduction, compiling)},
    **{of.__name__: of for of in (help_page, chain, csv, columns)},
}

if __name__ == "__main__":
    print(json.dumps(TASKS[sys.argv[1]]()))
