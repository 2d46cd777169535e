# SPDX-License-Identifier: GPL-3.0-or-later

"""Findings of `handover doctor`, read from its sources: level, what is found, and what to do."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from reference import ROOT
from reference.sources import named, template

__all__ = ["Found", "findings"]

#: line, name and text
_Assigned = tuple[int, str, str]
#: function of `doctor/finding.py` -> level, and the places of its texts: found, what to do
_MADE: Final[Mapping[str, tuple[str, int, int | None]]] = {
    "error": ("error", 1, 2),
    "warning": ("warning", 1, 2),
    "unseen": ("warning", 1, 2),
    "ok": ("ok", 1, None),
}


@dataclass(frozen=True, slots=True)
class Found:
    """One finding, as a template. `do`: what to do; "" if all is well."""

    file: str
    level: str
    what: str
    found: str
    do: str


def findings() -> Iterator[Found]:
    """All findings that have their texts where they are made, in the order of the files."""
    for path in sorted((ROOT / "mavproxy_handover" / "doctor").glob("*.py")):
        tree = ast.parse(path.read_text("utf-8"))
        constants = _assigned(tree.body)
        for function in (node for node in ast.walk(tree) if _is_function(node)):
            texts = constants + _assigned(ast.walk(function))
            for call in _calls(function):
                yield _found(path.name, call, texts)


def _found(file: str, call: ast.Call, texts: Sequence[_Assigned]) -> Found:
    made = call.func.id  # type: ignore[attr-defined]
    level, at, do_at = _MADE[made]
    found = _text(call, at, texts)
    if made == "unseen":
        found = f"not looked at: {found}"
    return Found(file, level, _text(call, 0, texts), found, "" if do_at is None else _text(call, do_at, texts))


def _is_function(node: ast.AST) -> bool:
    return isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))


def _calls(function: ast.AST) -> Iterator[ast.Call]:
    for node in ast.walk(function):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _MADE:
            yield node


def _assigned(nodes: Iterable[ast.AST]) -> list[_Assigned]:
    """The texts that names get: line, name, text."""
    found = []
    for node in nodes:
        target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
        value = getattr(node, "value", None)
        text = template(value) if isinstance(value, ast.AST) else None
        if isinstance(node, (ast.Assign, ast.AnnAssign)) and isinstance(target, ast.Name) and text is not None:
            found.append((node.lineno, target.id, text))
    return found


def _text(call: ast.Call, at: int, texts: Sequence[_Assigned]) -> str:
    """A text of a finding, by the last value that its name got before; a value that is computed by its name."""
    if at >= len(call.args):
        return ""
    node = call.args[at]
    text = template(node)
    if text is not None:
        return text
    name = getattr(node, "id", "")
    before = [text for line, known, text in sorted(texts) if known == name and line < call.lineno]
    return before[-1] if before else f"{{{named(node)}}}"
