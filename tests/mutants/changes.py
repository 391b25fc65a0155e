"""Single changes to the numbers, inequalities and terms of a function's source, found by walking its syntax tree."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

FACTORS = (0.5, 0.9, 1.1, 2.0)
_ZERO = ("0", "0.0")
_AT_ZERO: dict[type[ast.cmpop], tuple[str, type[ast.cmpop]]] = {
    ast.Gt: ("0 let in", ast.GtE),
    ast.Lt: ("0 let in", ast.LtE),
    ast.GtE: ("0 left out", ast.Gt),
    ast.LtE: ("0 left out", ast.Lt),
}
_WEAKER = 0.5  # what is compared is halved before it is compared
_OTHERS = {"min": "max", "minimum": "maximum", "any": "all"}
_OTHERS |= {other: one for one, other in _OTHERS.items()}


class Change(NamedTuple):
    """One mutant of a module.

    Attributes:
        place: The function (``Class.method``) or the module's constant that is changed.
        line: Where, in the module as it is.
        text: The source line there.
        what: What is changed, in words.
        number: Which of the place's nodes.
        made: What stands in its place.
    """

    place: str
    line: int
    text: str
    what: str
    number: int
    made: ast.AST

    def tree(self, source: str) -> ast.Module:
        """The module's changed syntax tree."""
        tree = ast.parse(source)
        _put(places_of(tree)[self.place], self.number, self.made)
        return ast.fix_missing_locations(tree)


def places_of(tree: ast.Module) -> dict[str, ast.AST]:
    """Functions, methods and constants of a module by name."""
    found: dict[str, ast.AST] = {}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            found[node.name] = node
        elif isinstance(node, ast.ClassDef):
            found |= {f"{node.name}.{f.name}": f for f in node.body if isinstance(f, ast.FunctionDef)}
        elif isinstance(node, ast.Assign):
            names = [n.id for target in node.targets for n in ast.walk(target) if isinstance(n, ast.Name)]
            found |= dict.fromkeys(names, node)
    return found


@cache
def parsed(source: str) -> ast.Module:
    """A source's syntax tree, which is only read: many places of one module are asked for one by one."""
    return ast.parse(source)


def changes_of(source: str, places: tuple[str, ...]) -> Iterator[Change]:
    """Every change to the places told of a module's source.

    Raises:
        KeyError: A place that the module does not have.
    """
    tree, lines = parsed(source), source.splitlines()
    known = places_of(tree)
    for place in places:
        if place not in known:
            raise KeyError(place)
        for number, node in enumerate(_within(known[place])):
            for what, made in _variants(node):
                yield Change(place, node.lineno, lines[node.lineno - 1].strip(), what, number, made)


def _within(root: ast.AST) -> list[ast.AST]:
    """The expressions and statements of a function's body (neither its defaults nor any annotations)."""
    found: list[ast.AST] = list(root.body) if isinstance(root, ast.FunctionDef) else [root]
    for node in found:
        fields = ast.iter_fields(node)
        inner = [value for name, value in fields if name not in ("annotation", "returns")]
        found += [n for v in inner for n in (v if isinstance(v, list) else [v]) if isinstance(n, ast.AST)]
    return found


_CHANGED = (ast.Constant, ast.BinOp, ast.BoolOp, ast.Name, ast.Attribute, ast.Assign, ast.AugAssign, ast.Compare)


def _variants(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """What may stand instead of a node."""
    if not isinstance(node, _CHANGED):  # as most nodes are not
        return
    if isinstance(node, ast.Constant) and isinstance(node.value, float) and node.value:
        for factor in FACTORS:
            yield f"{node.value:g} × {factor:g}", ast.Constant(node.value * factor)
    elif (
        isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div) and (number := _whole(node)) is not None
    ):
        without = node.left if number is node.right else node.right
        yield f"1 instead of {number.value}", without if isinstance(node.op, ast.Mult) else node.left
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow) and isinstance(node.right, ast.Constant):
        if node.right.value == 2:
            yield "no square", node.left
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        yield f"without {ast.unparse(node.right)}", node.left
        yield f"without {ast.unparse(node.left)}", node.right
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Sub):
        yield f"without {ast.unparse(node.right)}", node.left
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitAnd | ast.BitOr):
        yield f"not asked: {ast.unparse(node.right)}", node.left
        yield f"not asked: {ast.unparse(node.left)}", node.right
    elif isinstance(node, ast.BoolOp):
        for value in node.values:
            rest = [other for other in node.values if other is not value]
            made = rest[0] if len(rest) == 1 else ast.BoolOp(node.op, rest)
            yield f"not asked: {ast.unparse(value)}", made
    elif isinstance(node, ast.Name | ast.Attribute) and (name := _name(node)) in _OTHERS:
        other = _OTHERS[name]
        made = ast.Name(other, node.ctx) if isinstance(node, ast.Name) else ast.Attribute(node.value, other, node.ctx)
        yield f"{other} instead of {name}", made
    elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Subscript):
        yield f"left out: {ast.unparse(node)}", ast.Pass()
    elif isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Add):
        yield f"without {ast.unparse(node.value)}", ast.Pass()
    elif (
        isinstance(node, ast.Compare)
        and type(node.ops[0]) in _AT_ZERO
        and ast.unparse(node.comparators[0]) in _ZERO
        and len(node.ops) == 1
    ):
        what, other = _AT_ZERO[type(node.ops[0])]
        yield what, ast.Compare(node.left, [other()], node.comparators)
    elif isinstance(node, ast.Compare) and len(node.ops) == 1:
        factor = {ast.Lt: _WEAKER, ast.LtE: _WEAKER, ast.Gt: 1.0 / _WEAKER, ast.GtE: 1.0 / _WEAKER}.get(
            type(node.ops[0])
        )
        if factor is not None:
            left = ast.BinOp(node.left, ast.Mult(), ast.Constant(factor))
            yield f"{ast.unparse(node)}: left × {factor:g}", ast.Compare(left, node.ops, node.comparators)


def _whole(node: ast.BinOp) -> ast.Constant | None:
    """The whole number above one by which something is multiplied or divided."""
    sides = [node.right] if isinstance(node.op, ast.Div) else [node.left, node.right]
    found = [s for s in sides if isinstance(s, ast.Constant) and type(s.value) is int and s.value > 1]
    return found[0] if found else None


def _name(node: ast.Name | ast.Attribute) -> str:
    return node.id if isinstance(node, ast.Name) else node.attr


def _put(root: ast.AST, number: int, made: ast.AST) -> None:
    """Put a node in the place of the one with a number."""
    old = _within(root)[number]
    for parent in [root, *ast.walk(root)]:
        for name, value in ast.iter_fields(parent):
            if value is old:
                setattr(parent, name, made)
                return
            if isinstance(value, list) and any(item is old for item in value):
                setattr(parent, name, [made if item is old else item for item in value])
                return
