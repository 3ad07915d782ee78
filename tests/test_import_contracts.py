"""The science rooms stay free of files, frames and terminals, whatever the way of an import."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
SCIENCE = ("plan", "uncertainty", "refine", "drive", "identify", "rig", "laws", "params", "errors")
NOT_FOR_SCIENCE = ("pandas", "pyarrow", "ruamel", "typer", "rich", "matplotlib", "pydantic")


def test_science_loads_nothing_that_it_must_not_know() -> None:
    # what is really loaded, also by ways that the contracts do not see
    modules = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for room in SCIENCE
        for path in (*ROOT.glob(f"beltid/{room}.py"), *ROOT.glob(f"beltid/{room}/*.py"))
        if path.stem != "__init__"
    ]
    assert len(modules) > 20
    code = (
        f"import sys, importlib\nfor m in {modules!r}: importlib.import_module(m)\n"
        f"print([m for m in {NOT_FOR_SCIENCE!r} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_recording_is_reduced_without_loading_a_compiler() -> None:
    code = "import sys; from beltid.stages import friction; print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_only_the_command_line_prints_or_exits() -> None:
    offenders = [
        str(path.relative_to(ROOT))
        for path in sorted((ROOT / "beltid").rglob("*.py"))
        if "cli" not in path.parts
        for word in ("print(", "sys.exit(", "sys.stdout", "sys.stderr")
        if any(
            line.lstrip().startswith(word) or f" {word}" in line
            for line in path.read_text(encoding="utf-8").splitlines()
            if not line.lstrip().startswith("#")
        )
    ]
    assert offenders == []


def test_no_code_of_the_package_knows_the_truth() -> None:
    for path in (ROOT / "beltid").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert "truth.csv" not in text, path
        assert "speedloss_truth" not in text, path
