# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads sentences from sources: literals of functions and constants, with each value by its name.

An error is written where it is raised, with file, place, value and what is allowed. A second copy of it would say
nothing more, so the page about messages reads it there.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

__all__ = ["literals", "named", "template"]

#: a text with fewer words is a value, or a part of a sentence; in an error that is raised
WORDS, RAISED_WORDS = 3, 2
#: names in the expression of a value that are no name for it
_FUNCTIONS = {
    *("abs", "get", "getattr", "join", "len", "map", "max", "min", "partition", "removeprefix", "repr", "round"),
    *("set", "shown", "sorted", "split", "str", "sum", "tuple", "values"),
}
_RAISES = ("error", "Flaw", "MissionError", "MissionCheckError")


def literals(source: str) -> Iterator[str]:
    """The literals of at least `WORDS` words in functions, methods and constants of the module, without docstrings."""
    tree, seen = ast.parse(source), set[str]()
    for node in tree.body:  # a sentence that is a constant of its module
        value = node.value if isinstance(node, (ast.Assign, ast.AnnAssign)) else None
        text = None if value is None else template(value)
        if text is not None and _is_sentence(text, WORDS) and text not in seen:
            seen.add(text)
            yield text
    for function in _functions(tree):
        inner: set[int] = set()
        for node in ast.walk(function):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
                inner.update(id(each.value) for each in node.body if isinstance(each, ast.Expr))
            if isinstance(node, ast.JoinedStr):
                inner.update(id(part) for part in ast.walk(node) if part is not node)
        raised = {id(each) for node in ast.walk(function) if _raises(node) for each in ast.walk(node)}
        for node in ast.walk(function):
            text = None if id(node) in inner else template(node)
            least = RAISED_WORDS if id(node) in raised else WORDS
            if text is not None and _is_sentence(text, least) and text not in seen:
                seen.add(text)
                yield text


def template(node: ast.AST) -> str | None:
    """A literal with its values in braces; None for any other node."""
    if isinstance(node, ast.JoinedStr):
        return "".join(
            str(part.value) if isinstance(part, ast.Constant) else f"{{{named(part)}}}" for part in node.values
        )
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    return None


def _functions(tree: ast.Module) -> Iterator[ast.AST]:
    """The outermost functions and methods."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            yield from (each for each in node.body if isinstance(each, (ast.FunctionDef, ast.AsyncFunctionDef)))
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield node


def _raises(node: ast.AST) -> bool:
    if isinstance(node, ast.Raise):
        return True
    if not isinstance(node, ast.Call):
        return False
    return (node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")) in _RAISES


def _is_sentence(text: str, least: int) -> bool:
    words = re.sub(r"\{\w+\}", " ", text).split()
    end = r"[.,:;?!)'\"\]]*"
    kinds = (r"[A-Za-z][a-z'-]*", r"[A-Z]{2,}") if least == RAISED_WORDS else (r"[A-Za-z][a-z'-]*",)
    plain = [word for word in words if any(re.fullmatch(rf"[('\"\[]*{kind}{end}", word) for kind in kinds)]
    return len(plain) >= least and "\n" not in text


def named(part: ast.AST) -> str:
    """The name of a value: the last name in its expression."""
    names = [each.attr if isinstance(each, ast.Attribute) else each.id for each in ast.walk(part)
             if isinstance(each, (ast.Attribute, ast.Name))]  # fmt: skip
    known = [name.strip("_").lower() for name in names if name.strip("_") not in _FUNCTIONS]
    return known[0] if known else "value"
