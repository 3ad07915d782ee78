"""Every reader against changed files, guided by coverage: it must return or refuse with status 2.

    python -m benchmarks.fuzz [--seconds 300] [--inputs 15000] [--only csv yaml ...]

Files start from tests/hostile/corpus and are changed there where their structure allows
(tests/hostile/mutation.py); atheris keeps what reaches new code. A finding is an exception that is
no `BeltidError`, an input that takes more than 10 s, a crash of the process, or more than 4 GB of
memory. Findings are written to build/fuzz/<reader>/, and the exit status is 1.
"""

import argparse
import hashlib
import json
import os
import random
import subprocess
import sys
import time
import traceback
from pathlib import Path

from benchmarks import table

ROOT = Path(__file__).parents[1]
HOSTILE = ROOT / "tests" / "hostile"
BUILD = ROOT / "build" / "fuzz"
RESTARTS = 200
COUNTED = ("inputs", "refused", "taken", "findings")

sys.path.insert(0, str(HOSTILE))


def one_reader(reader: str, inputs: int, seconds: float, seed: int) -> None:
    """Fuzz one reader in this process; atheris ends it."""
    import atheris

    with atheris.instrument_imports(include=["beltid.config", "beltid.bench", "beltid.store"]):
        import mutation
        import readers
    folder = BUILD / reader
    (folder / "grown").mkdir(parents=True, exist_ok=True)
    seeds = readers.seeds(reader)
    change = mutation.MUTATORS[reader]
    told: set[str] = set()
    count = dict.fromkeys(COUNTED, 0)
    state = folder / "state.json"
    end = time.monotonic() + seconds

    def test(data: bytes) -> None:
        if time.monotonic() > end:
            state.write_text(json.dumps(count))
            readers.clean()
            os._exit(0)  # anything else is a crash to atheris
        (folder / "last.input").write_bytes(data)
        count["inputs"] += 1
        try:
            refused = readers.read(reader, data)
            count["refused" if refused else "taken"] += 1
        except Exception as error:
            frames = traceback.extract_tb(error.__traceback__)
            kind = f"{type(error).__name__} {frames[-1].filename}:{frames[-1].lineno}"
            if kind not in told:
                told.add(kind)
                count["findings"] += 1
                name = hashlib.sha256(data).hexdigest()[:12]
                (folder / f"{name}.input").write_bytes(data)
                (folder / f"{name}.txt").write_text(traceback.format_exc())
        if count["inputs"] % 100 == 0 or count["inputs"] >= inputs:
            state.write_text(json.dumps(count))

    def changed(data: bytes, max_size: int, seed: int) -> bytes:
        dice = random.Random(seed)
        base = dice.choice(seeds) if dice.random() < 0.3 or not data else data
        return change(base, dice, seeds)[:max_size]

    corpus = [str(folder / "grown"), str(readers.CORPUS / reader)]
    limits = [f"-runs={inputs}", "-timeout=10", "-rss_limit_mb=4096", "-max_len=300000"]
    rest = [f"-artifact_prefix={folder}/", f"-seed={seed}", "-verbosity=0", "-print_final_stats=0"]
    atheris.Setup([sys.argv[0], *corpus, *limits, *rest], test, custom_mutator=changed)
    atheris.Fuzz()


def fuzz(reader: str, inputs: int, seconds: float) -> dict[str, int]:
    """Fuzz one reader in processes of its own, until its inputs or its time are spent."""
    folder, end = BUILD / reader, time.monotonic() + seconds
    folder.mkdir(parents=True, exist_ok=True)
    whole = dict.fromkeys(COUNTED, 0)
    for seed in range(1, RESTARTS):
        left, rest_s = inputs - whole["inputs"], end - time.monotonic()
        if left <= 0 or rest_s <= 1.0:
            break
        (folder / "state.json").write_text("{}")
        command = [sys.executable, "-m", "benchmarks.fuzz", "--reader", reader]
        command += ["--inputs", str(left), "--seconds", str(rest_s), "--seed", str(seed)]
        with (folder / "log.txt").open("w") as log:
            subprocess.run(command, cwd=ROOT, stdout=log, stderr=log, check=False)
        state = json.loads((folder / "state.json").read_text())
        whole = {name: so_far + state.get(name, 0) for name, so_far in whole.items()}
        ended = [p for p in folder.iterdir() if p.name.startswith(("crash", "timeout", "oom"))]
        for path in ended:
            whole["inputs"] += 1
            whole["findings"] += 1
            path.rename(folder / f"finding-{path.name}")
        if not ended:
            break
    return whole


def main() -> int:
    """Fuzz the readers one after the other, and tell what came of it."""
    from mutation import MUTATORS

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=15_000, help="of each reader, at most")
    parser.add_argument("--seconds", type=float, default=3600.0, help="in all")
    parser.add_argument("--only", nargs="*", default=list(MUTATORS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--reader", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.reader:
        one_reader(asked.reader, asked.inputs, asked.seconds, asked.seed)
        return 0
    rows, findings, end = [], 0, time.monotonic() + asked.seconds
    for number, reader in enumerate(asked.only):
        # what a quick reader leaves of its time is for those after it
        seconds = (end - time.monotonic()) / (len(asked.only) - number)
        count = fuzz(reader, asked.inputs, seconds)
        findings += count["findings"]
        rows.append((reader, *(f"{count[name]:,}" for name in COUNTED)))
        print(*rows[-1], flush=True)
    print(table(("reader", *COUNTED), rows))
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
