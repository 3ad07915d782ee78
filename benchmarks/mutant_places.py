"""Every small fault that can be put into a module: one comparison, sign, operator, number, test.

Annotations, messages and docstrings have none.
"""

import ast
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

_COMPARED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
_OPERATED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
}
_Change = Callable[[], None]


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change: where, what it turns into what, and the lines of the statement it is in."""

    path: Path
    line: int
    before: str
    after: str
    text: str
    lines: range

    @property
    def name(self) -> str:
        """What a person looks up."""
        return f"{self.path}:{self.line}: {self.before[:90]}  ->  {self.after[:90]}"


def number_of_places(path: Path) -> int:
    """How many mutants of a module there are."""
    return len(list(_places(ast.parse(path.read_text("utf-8")))))


def mutant(path: Path, number: int) -> Mutant:
    """One of the mutants of a module."""
    tree = ast.parse(path.read_text("utf-8"))
    node, change = list(_places(tree))[number]
    before, lines = ast.unparse(node), _statement(tree, node)
    change()
    return Mutant(path, node.lineno, before, ast.unparse(node), ast.unparse(tree), lines)


def _statement(tree: ast.Module, node: ast.expr | ast.stmt) -> range:
    """Lines of the smallest statement around a node; of a compound one, those of its head."""
    smallest = range(node.lineno, (node.end_lineno or node.lineno) + 1)
    found = [
        range(s.lineno, (s.body[0].lineno - 1 if hasattr(s, "body") else s.end_lineno or 0) + 1)
        for s in ast.walk(tree)
        if isinstance(s, ast.stmt)
    ]
    around = [f for f in found if node.lineno in f]
    return min(around, key=len, default=smallest)


def _places(tree: ast.Module) -> Iterator[tuple[ast.expr | ast.stmt, _Change]]:
    skipped = _skipped(tree)
    for node in ast.walk(tree):
        if isinstance(node, (ast.expr, ast.stmt)) and id(node) not in skipped:
            change = _change(node)
            if change is not None:
                yield node, change


def _skipped(tree: ast.Module) -> set[int]:
    """Nodes of annotations, of messages, and of what only a type checker reads."""
    skipped: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, (ast.Raise, ast.JoinedStr)) or (
            isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        ):
            skipped |= {id(n) for n in ast.walk(node)}
        notes = [getattr(node, "annotation", None), getattr(node, "returns", None)]
        for note in notes:
            if note is not None:
                skipped |= {id(n) for n in ast.walk(note)}
    return skipped


def _change(node: ast.expr | ast.stmt) -> _Change | None:
    """How a node is changed in its place; None where it has no change."""
    match node:
        case ast.Compare(ops=[first, *_]) if type(first) in _COMPARED:
            return lambda: node.ops.__setitem__(0, _COMPARED[type(first)]())
        case ast.BinOp(op=operator) if type(operator) in _OPERATED:
            return lambda: setattr(node, "op", _OPERATED[type(operator)]())
        case ast.BoolOp(op=joined):
            return lambda: setattr(
                node, "op", ast.Or() if isinstance(joined, ast.And) else ast.And()
            )
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            return lambda: setattr(node, "value", value * 1.1 if value % 1 else value + 1)
        case ast.UnaryOp(op=ast.USub()):
            return lambda: setattr(node, "op", ast.UAdd())
        case ast.If() | ast.IfExp():
            return lambda: setattr(node, "test", ast.UnaryOp(ast.Not(), node.test))
    return None
