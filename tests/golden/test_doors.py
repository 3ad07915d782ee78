"""The goldens come in through the doors only: no inner name of the program is used in them."""

import ast
from pathlib import Path

import pytest

HERE = Path(__file__).parent


@pytest.mark.parametrize("path", sorted(HERE.glob("*.py")), ids=lambda path: path.stem)
def test_only_the_package_itself_is_imported(path: Path) -> None:
    inner = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            inner += [a.name for a in node.names if a.name.startswith("beltid.")]
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("beltid."):
            inner.append(node.module or "")
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Attribute):
            root = node.value.value
            if isinstance(root, ast.Name) and root.id == "beltid" and node.value.attr.islower():
                inner.append(ast.unparse(node))
    assert not inner
