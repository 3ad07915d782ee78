"""What stands in the laws is what runs: the package calls every formula, not only the tests."""

from __future__ import annotations

import ast
from pathlib import Path

import beltid.laws

LAWS = Path(beltid.laws.__file__).parent


def names_used(path: Path) -> set[str]:
    """Names in the code of a file, none of one that does not import the laws."""
    text = path.read_text(encoding="utf-8")
    nodes = ast.walk(ast.parse(text)) if "laws" in text else ()
    return {
        node.id if isinstance(node, ast.Name) else node.attr
        for node in nodes
        if isinstance(node, (ast.Name, ast.Attribute))
    }


def test_the_package_calls_every_function_of_the_laws() -> None:
    files = list(LAWS.parent.rglob("*.py"))
    used = set().union(*map(names_used, files))
    formulas = {
        node.name
        for path in LAWS.glob("*.py")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef)
    }
    assert len(formulas) > 15
    assert sorted(formulas - used) == []
