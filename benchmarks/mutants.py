"""Mutation testing of the science: small faults are put in, and the tests must see them.

    python -m benchmarks.mutants [--seconds 480] [--seed 1] [--rooms laws identify]

A sample of all single changes to comparisons, signs, operators, constants and conditions of a room
is tried one by one in a copy of the project, against the tests of that room (the first failure
ends a trial). mutmut does the same for whole packages, but it runs modules from rewritten copies
whose functions the compiler of the kernels cannot compile; so this is its small stand-in.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
COPIED: Final = ("beltid", "tests", "rigdata", "pyproject.toml")
LIMIT_S: Final = 120.0

_COMPARED: Final = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
_OPERATED: Final = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
}


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change: where, and what it turns into what."""

    path: Path
    line: int
    before: str
    after: str
    text: str


def mutants_of(path: Path) -> Iterator[Mutant]:
    """Every single change to a module that is not in an annotation, a message or a docstring."""
    source = path.read_text("utf-8")
    count = len(list(_places(ast.parse(source))))
    for number in range(count):
        tree = ast.parse(source)
        node, change = list(_places(tree))[number]
        before = ast.unparse(node)
        change()
        yield Mutant(path, node.lineno, before, ast.unparse(node), ast.unparse(tree))


def _places(tree: ast.Module) -> Iterator[tuple[ast.expr | ast.stmt, object]]:
    skipped: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, (ast.Raise, ast.JoinedStr, ast.AnnAssign)) or (
            isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        ):
            inside = node.value if isinstance(node, ast.AnnAssign) else None
            skipped |= {id(n) for n in ast.walk(node)}
            if inside is not None:
                skipped -= {id(n) for n in ast.walk(inside)}
        if isinstance(node, (ast.FunctionDef, ast.arg)):
            note = node.returns if isinstance(node, ast.FunctionDef) else node.annotation
            if note is not None:
                skipped |= {id(n) for n in ast.walk(note)}
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Compare) and type(node.ops[0]) in _COMPARED:
            yield node, lambda n=node: n.ops.__setitem__(0, _COMPARED[type(n.ops[0])]())
        elif isinstance(node, ast.BinOp) and type(node.op) in _OPERATED:
            yield node, lambda n=node: setattr(n, "op", _OPERATED[type(n.op)]())
        elif isinstance(node, ast.BoolOp):
            yield (
                node,
                lambda n=node: setattr(
                    n, "op", ast.Or() if isinstance(n.op, ast.And) else ast.And()
                ),
            )
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            yield (
                node,
                lambda n=node: setattr(n, "value", n.value * 1.1 if n.value % 1 else n.value + 1),
            )
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            yield node, lambda n=node: setattr(n, "op", ast.UAdd())
        elif isinstance(node, (ast.If, ast.IfExp)):
            yield node, lambda n=node: setattr(n, "test", ast.UnaryOp(ast.Not(), n.test))


def killed(mutant: Mutant, copy: Path, room: str) -> bool:
    """Whether the tests of a room see a mutant."""
    place = copy / mutant.path.relative_to(ROOT)
    original = place.read_text("utf-8")
    place.write_text(mutant.text, "utf-8")
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
    environment = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            [*command, f"tests/{room}"],
            cwd=copy,
            env=environment,
            timeout=LIMIT_S,
            capture_output=True,
            check=False,
        )
    except subprocess.TimeoutExpired:  # an endless loop is seen, too
        return True
    finally:
        place.write_text(original, "utf-8")
    return done.returncode != 0


def main() -> None:
    """Try a sample and tell the score and what survived."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=480.0, help="for each room")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rooms", nargs="*", default=["laws", "identify"])
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="beltid-mutants-") as folder:
        for name in COPIED:
            source = ROOT / name
            if source.is_dir():
                shutil.copytree(source, Path(folder, name))
            else:
                shutil.copy(source, folder)
        for room in asked.rooms:
            found = [
                m for p in sorted((ROOT / "beltid" / room).glob("*.py")) for m in mutants_of(p)
            ]
            random.Random(asked.seed).shuffle(found)
            end, tried, seen = time.monotonic() + asked.seconds, 0, 0
            for mutant in found:
                if time.monotonic() > end:
                    break
                tried += 1
                if killed(mutant, Path(folder), room):
                    seen += 1
                else:
                    where = f"{mutant.path.relative_to(ROOT)}:{mutant.line}"
                    print(
                        f"survived {where}: {mutant.before[:90]}  ->  {mutant.after[:90]}",
                        flush=True,
                    )
            print(f"{room}: {seen} of {tried} tried seen, {len(found)} possible", flush=True)


if __name__ == "__main__":
    main()
