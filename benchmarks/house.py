"""The size of the house, room by room: it may only fall.

    python -m benchmarks.house             # 1 if anything is above [tool.house] of pyproject.toml
    python -m benchmarks.house --lower     # states there what stands, where that is less

A room is a folder of `beltid` (`top`: the modules beside them). Its lines are those of all its text
files, templates and data included; its statements those of its Python files. Of `tests` and
`benchmarks` the Python files count, of the pages (README and docs) the words.
"""

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PYPROJECT = ROOT / "pyproject.toml"


def committed(*patterns: str) -> list[Path]:
    """Files of the project below some folders, as git lists them."""
    command = ["git", "ls-files", "-co", "--exclude-standard", *patterns]
    said = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return [path for name in said.stdout.splitlines() if (path := ROOT / name).is_file()]


def lines(paths: list[Path]) -> int:
    """Lines of text."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def statements(paths: list[Path]) -> int:
    """Statements of the Python files."""
    trees = [ast.parse(path.read_text()) for path in paths if path.suffix == ".py"]
    return sum(isinstance(node, ast.stmt) for tree in trees for node in ast.walk(tree))


def measured() -> dict[str, int]:
    """Every number of the house, by the key that states its limit."""
    package = committed("beltid")
    sizes = {
        "package.lines": lines(package),
        "package.statements": statements(package),
        "package.files": sum(path.suffix == ".py" for path in package),
    }
    rooms: dict[str, list[Path]] = {}
    for path in package:
        place = path.relative_to(ROOT / "beltid").parts
        rooms.setdefault(place[0] if len(place) > 1 else "top", []).append(path)
    for room, paths in sorted(rooms.items()):
        sizes |= {f"{room}.lines": lines(paths), f"{room}.statements": statements(paths)}
    for folder in ("tests", "benchmarks"):
        paths = committed(f"{folder}/*.py")
        sizes |= {f"{folder}.lines": lines(paths), f"{folder}.statements": statements(paths)}
    pages = committed("README.md", "docs/*.md")
    sizes |= {"pages.lines": lines(pages)}
    sizes |= {"pages.words": sum(len(path.read_text().split()) for path in pages)}
    return sizes


def main() -> int:
    """Compare what stands with what is stated."""
    text = PYPROJECT.read_text()
    stated = tomllib.loads(text)["tool"]["house"]
    limits = {f"{room}.{what}": n for room, of in stated.items() for what, n in of.items()}
    sizes = measured()
    above = [name for name, size in sizes.items() if size > limits.get(name, 0)]
    for name in above:
        print(f"{name}: {sizes[name]}, at most {limits.get(name, 0)}")
    if "--lower" in sys.argv[1:] and not above:
        rows = {room: [] for room in dict.fromkeys(name.split(".")[0] for name in sizes)}
        for name, size in sizes.items():
            room, what = name.split(".")
            rows[room].append(f"{what} = {size}")
        table = "".join(f"{room} = {{ {', '.join(of)} }}\n" for room, of in rows.items())
        PYPROJECT.write_text(
            re.sub(r"(?m)(^\[tool\.house\]\n(?:#.*\n)*)[^\[]*", rf"\1{table}\n", text)
        )
    print(f"house: {sizes['package.lines']} lines, {sizes['package.statements']} statements")
    return 1 if above else 0


if __name__ == "__main__":
    sys.exit(main())
