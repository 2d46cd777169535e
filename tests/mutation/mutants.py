# SPDX-License-Identifier: GPL-3.0-or-later

"""Small faults in a module's source, one at a time.

Operators: a condition is negated, a comparison is turned around or loses its edge, `and` becomes `or`, an early
`return` is dropped, a statement that only calls something is dropped, a whole number is one more. A mutant is named
by function, operator and source text, so that its name survives an edit elsewhere in the file.
"""

from __future__ import annotations

import ast
import copy
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

__all__ = ["COMPARISONS", "Mutant", "mutants"]

#: a comparison -> the one that a fault puts in its place
COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
}


#: what `_mutate` may change
_CHANGED = (ast.If, ast.IfExp, ast.While, ast.Compare, ast.BoolOp, ast.Constant, ast.Expr, ast.Return)


@dataclass(frozen=True, slots=True)
class Mutant:
    """A module's source with one fault in it."""

    name: str
    source: str


def mutants(source: str) -> Iterator[Mutant]:
    """Every mutant of the functions in a module's source."""
    seen: Counter[str] = Counter()
    whole = ast.parse(source)
    owners = _owners(whole)
    for index, found in enumerate(ast.walk(whole)):
        function = owners.get(found, "")
        if not function or not isinstance(found, _CHANGED):
            continue
        before = " ".join(ast.unparse(found).split())
        tree = ast.parse(source)
        operator = _mutate(tree, next(islice(ast.walk(tree), index, None)))
        if not operator:
            continue
        name = f"{function}: {operator}: {before[:90]}"
        seen[name] += 1
        if seen[name] > 1:
            name += f" (number {seen[name]})"
        yield Mutant(name, ast.unparse(ast.fix_missing_locations(tree)))


def _owners(tree: ast.AST) -> dict[ast.AST, str]:
    """The innermost function around each node; nothing outside of functions is mutated."""
    found: dict[ast.AST, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            found.update(dict.fromkeys(ast.walk(node), node.name))
    return found


def _mutate(tree: ast.AST, node: ast.AST) -> str:
    """Change the tree at a node; the operator's name, or "" if this node has no such fault."""
    if isinstance(node, (ast.If, ast.IfExp, ast.While)):
        node.test = ast.UnaryOp(ast.Not(), node.test)
        return "condition negated"
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in COMPARISONS:
        node.ops = [COMPARISONS[type(node.ops[0])]()]
        return "comparison turned"
    if isinstance(node, ast.BoolOp):
        node.op = ast.And() if isinstance(node.op, ast.Or) else ast.Or()
        return "and/or swapped"
    if isinstance(node, ast.Constant) and type(node.value) is int and not _annotation(tree, node):
        node.value += 1
        return "number one more"
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        return _replace(tree, node, "call dropped")
    if isinstance(node, ast.Return) and not _last(tree, node):
        return _replace(tree, node, "return dropped")
    return ""


def _annotation(tree: ast.AST, node: ast.AST) -> bool:
    """Whether a number stands in an annotation or as a default that a docstring-like place holds."""
    for parent in ast.walk(tree):
        annotation = getattr(parent, "annotation", None) or getattr(parent, "returns", None)
        if annotation is not None and any(child is node for child in ast.walk(annotation)):
            return True
    return False


def _last(tree: ast.AST, node: ast.Return) -> bool:
    """Whether a return is the last statement of its function: to drop it is another fault than to fall through."""
    return any(isinstance(parent, ast.FunctionDef) and parent.body[-1] is node for parent in ast.walk(tree))


def _replace(tree: ast.AST, node: ast.stmt, operator: str) -> str:
    for parent in ast.walk(tree):
        for field in ("body", "orelse", "finalbody"):
            block = getattr(parent, field, None)
            if isinstance(block, list) and any(statement is node for statement in block):
                place = next(number for number, statement in enumerate(block) if statement is node)
                block[place] = copy.copy(ast.Pass())
                return operator
    return ""
