# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults of the rules and of the gate, one at a time: in the code of a module, in its values, and in its tables."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, TypeVar, cast

from tests.mutation.run import GATE, in_child

__all__ = ["ROOT", "STATION", "Edit", "Fault", "faults", "file_of", "plant", "source_of", "table_faults"]

ROOT = Path(__file__).parents[2]
#: modules of a ground station's rules begin with this
STATION = "station."
#: tables of a module: what stands there is changed, one entry at a time
TABLES = {
    "authority.transfer": ("MOVES",),
    "authority.phases": ("PHASES",),
    "common.causes": ("CAUSES",),
    "safety.strategy": ("FIRST", "POLICY_LADDERS", "MILDER_THAN"),
}
WORST = {"authority.transfer": "committed", "authority.phases": "ON_MISSION"}

#: a comparison -> the one that a fault puts in its place
_COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
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
_SIGNS: dict[type[ast.operator], type[ast.operator]] = {ast.Add: ast.Sub, ast.Sub: ast.Add}
_SWAPS = {"min": "max", "max": "min", "any": "all", "all": "any"}


Made = TypeVar("Made")
Change = tuple[str, ast.AST, Callable[[], None], Callable[[], None]]


@dataclass(frozen=True, slots=True)
class Edit:
    """A change of a module's tree that is undone after use. `lines`: without one of these it is not reached."""

    tree: ast.Module
    apply: Callable[[], None]
    undo: Callable[[], None]
    lines: range

    def made(self, use: Callable[[ast.Module], Made]) -> Made:
        """What `use` makes of the changed tree."""
        self.apply()
        try:
            return use(ast.fix_missing_locations(self.tree))
        finally:
            self.undo()


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault: a change of a module, or an entry of a table: the table, the key, and where it leads now."""

    name: str
    edit: Edit | None = None
    entry: tuple[str, int, str] | None = None

    @property
    def source(self) -> str | None:
        """The module's source with the fault; None for an entry of a table."""
        return None if self.edit is None else self.edit.made(ast.unparse)


# ---- faults in the code --------------------------------------------------------------------------------------------


def faults(source: str) -> Iterator[Fault]:
    """Every fault of the functions in a module's source and of its values, one at a time."""
    tree = ast.parse(source)
    seen: Counter[str] = Counter()
    for value, (operator, before, apply, undo) in _of_values(tree):
        yield Fault(f"{value}: {operator}: {_short(before)}", Edit(tree, apply, undo, range(0)))
    for function, around, node in _inside(tree, "", tree):
        # a number says nothing by itself
        place = f" in {_short(around)}" if isinstance(node, ast.Constant) else ""
        for operator, before, apply, undo in _changes(node):
            name = f"{function}: {operator}: {_short(before)}{place}"
            seen[name] += 1
            edit = Edit(tree, apply, undo, _lines(before if isinstance(before, ast.stmt) else around))
            yield Fault(name if seen[name] == 1 else f"{name} (number {seen[name]})", edit)


def _lines(node: ast.AST) -> range:
    """The lines of a statement or condition; of a statement that holds others its head."""
    body = getattr(node, "body", None)
    if isinstance(body, list) and isinstance(node, (ast.stmt, ast.ExceptHandler)):
        return range(node.lineno, max(node.lineno + 1, body[0].lineno))
    placed = [each for each in ast.walk(node) if isinstance(each, (ast.stmt, ast.expr))]
    return range(min(each.lineno for each in placed), max(each.end_lineno or each.lineno for each in placed) + 1)


def _inside(node: ast.AST, function: str, around: ast.AST) -> Iterator[tuple[str, ast.AST, ast.AST]]:
    """Every node of a function, with the function's name and the statement or condition around it.

    Annotations and docstrings are left out.
    """
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST):
                continue
            inner = child.name if isinstance(child, ast.FunctionDef) else function
            # of a statement that holds others only its own expression
            holds_others = isinstance(node, ast.stmt) and hasattr(node, "body")
            nearest = child if isinstance(child, ast.stmt) or holds_others else around
            if inner:
                yield inner, nearest, child
            yield from _inside(child, inner, nearest)


def _of_values(tree: ast.Module) -> Iterator[tuple[str, Change]]:
    """A number or truth that a module or a dataclass begins with is another, a collection lacks one; tables apart."""
    for statement in tree.body:
        if isinstance(statement, (ast.Assign, ast.AnnAssign)) and statement.value is not None:
            target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
            name, value = ast.unparse(target), statement.value
            if isinstance(value, ast.Tuple) and name.startswith("_"):
                for place, element in enumerate(value.elts):
                    if not isinstance(element, ast.Constant):
                        rest = [*value.elts[:place], *value.elts[place + 1 :]]
                        yield name, _set("dropped", element, value, "elts", rest)
            for constant in value.elts if isinstance(value, ast.Tuple) else [value]:
                for change in _changes(constant):
                    yield name, change
        elif isinstance(statement, ast.ClassDef):
            for field in statement.body:
                if isinstance(field, ast.AnnAssign) and isinstance(field.value, ast.Constant):
                    for change in _changes(field.value):
                        yield f"{statement.name}.{ast.unparse(field.target)}", change


def _short(node: ast.AST) -> str:
    return " ".join(ast.unparse(node).split())[:90]


def _changes(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, (ast.If, ast.IfExp, ast.While)) and not _turnable(node.test):
        yield _set("condition negated", node.test, node, "test", ast.UnaryOp(ast.Not(), node.test))
    if isinstance(node, ast.Compare):
        for place, operator in enumerate(node.ops):
            turned = [*node.ops[:place], _COMPARISONS[type(operator)](), *node.ops[place + 1 :]]
            yield _set("comparison turned", node, node, "ops", turned)
    if isinstance(node, (ast.BoolOp, ast.Return, ast.Assign, ast.keyword)):
        yield from _without_not(node)
    if isinstance(node, ast.BoolOp):
        yield _set("and/or swapped", node, node, "op", ast.And() if isinstance(node.op, ast.Or) else ast.Or())
        for place, value in enumerate(node.values):
            rest = [each for other, each in enumerate(node.values) if other != place]
            if len(rest) == 1:  # one value alone is no and/or
                rest.insert(0, ast.Constant(isinstance(node.op, ast.And)))
            yield _set(f"dropped from and/or: {ast.unparse(value)[:50]}", node, node, "values", rest)
    if isinstance(node, ast.Constant) and type(node.value) is bool:
        yield _set("truth turned", node, node, "value", not node.value)
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        yield _set("number one more", node, node, "value", node.value + 1)
    if isinstance(node, (ast.BinOp, ast.AugAssign)) and type(node.op) in _SIGNS:
        yield _set("sign turned", node, node, "op", _SIGNS[type(node.op)]())
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _SWAPS:
        yield _set(f"{node.func.id} turned", node, node.func, "id", _SWAPS[node.func.id])
    for block in ("body", "orelse"):
        statements = getattr(node, block, None)
        if isinstance(statements, list):
            for place, statement in enumerate(statements):
                last = isinstance(node, ast.FunctionDef) and place == len(statements) - 1
                # without an attribute nothing works at all
                starting = isinstance(node, ast.FunctionDef) and node.name == "__init__"
                if _droppable(statement, last=last, starting=starting):
                    without = [*statements[:place], ast.Pass(), *statements[place + 1 :]]
                    yield _set("dropped", statement, node, block, without)


def _without_not(node: ast.AST) -> Iterator[Change]:
    """In a condition to drop `not` is to negate it."""
    if isinstance(node, ast.BoolOp):
        for place, value in enumerate(node.values):
            if isinstance(value, ast.UnaryOp) and isinstance(value.op, ast.Not):
                without = [*node.values[:place], value.operand, *node.values[place + 1 :]]
                yield _set("not dropped", value, node, "values", without)
    elif isinstance(node, (ast.Return, ast.Assign, ast.keyword)):
        value = node.value
        if isinstance(value, ast.UnaryOp) and isinstance(value.op, ast.Not):
            yield _set("not dropped", value, node, "value", value.operand)


def _turnable(test: ast.expr) -> bool:
    """Whether to turn the comparison is to negate the condition."""
    plain = (ast.Eq, ast.NotEq, ast.In, ast.NotIn, ast.Is, ast.IsNot)
    return isinstance(test, ast.Compare) and len(test.ops) == 1 and isinstance(test.ops[0], plain)


def _droppable(statement: ast.stmt, *, last: bool, starting: bool) -> bool:
    if isinstance(statement, ast.Expr):
        # where the type checker holds that nobody gets, nothing is missed
        return isinstance(statement.value, ast.Call) and ast.unparse(statement.value.func) != "assert_never"
    if isinstance(statement, ast.Return):
        return not last
    if isinstance(statement, (ast.Assign, ast.AugAssign)) and not starting:
        targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
        parts = [part for target in targets for part in (target.elts if isinstance(target, ast.Tuple) else [target])]
        return all(isinstance(part, (ast.Attribute, ast.Subscript)) for part in parts)
    return isinstance(statement, ast.Delete)


def _set(operator: str, before: ast.AST, node: ast.AST, field: str, value: Any) -> Change:
    old = getattr(node, field)
    return operator, before, lambda: setattr(node, field, value), lambda: setattr(node, field, old)


# ---- faults in the tables ------------------------------------------------------------------------------------------


def table_faults(module: str) -> Iterator[Fault]:
    """An entry is missing, leads elsewhere, or is there that should not be."""
    # worked out elsewhere: this process must not import what it will plant faults in
    for table, number, target, name in in_child(lambda: list(_table_faults(module))):
        yield Fault(name, entry=(table, number, target))


def _table_faults(module: str) -> Iterator[tuple[str, int, str, str]]:
    for table in TABLES.get(module, ()):
        entries, keys, others = _table(module, table)
        for number, key in enumerate(keys):
            present = entries.get(key)
            for target, value in others(key).items():
                if value != present:
                    yield table, number, target, f"{table}: {_named(key)} -> {target}"


def _named(key: Any) -> str:
    """A key of a table, for people."""
    if isinstance(key, tuple):
        return " + ".join(each.name for each in key)
    return key if isinstance(key, str) else str(key.name)


#: what a table's entry is changed to when it is to be missing
_NOTHING: Any = None


def _table(module: str, table: str) -> tuple[dict[Any, Any], list[Any], Callable[[Any], dict[str, Any]]]:
    """A table, all keys it could have entries for, and what could stand there instead, by name."""
    if not module.startswith("authority."):
        return _safety_table(table)
    targets: dict[str, Any]
    if module == "authority.phases":
        from mavproxy_handover.core.authority.phases import PHASES, PhaseCause
        from mavproxy_handover.core.common.model import Phase

        entries, keys = cast("dict[Any, Any]", PHASES), list[Any](product(Phase, PhaseCause))
        targets = {phase.name: phase for phase in Phase}
    else:
        from mavproxy_handover.core.authority.transfer import MOVES, Cause, End, Step
        from mavproxy_handover.core.common.model import Outcome, Reason

        ends = {"committed": End(Outcome.COMMITTED, Reason.NONE), "aborted": End(Outcome.ABORTED, Reason.CANCELLED)}
        entries, keys = cast("dict[Any, Any]", MOVES), list[Any](product(Step, Cause))
        targets = {step.name: step for step in Step} | ends

    def others(key: Any) -> dict[str, Any]:
        # where nothing should be, the worst that could be there is enough
        return {**targets, "nothing": _NOTHING} if key in entries else {WORST[module]: targets[WORST[module]]}

    return entries, keys, others


def _safety_table(table: str) -> tuple[dict[Any, Any], list[Any], Callable[[Any], dict[str, Any]]]:
    from mavproxy_handover.core.common import causes
    from mavproxy_handover.core.safety import strategy

    entries = cast("dict[Any, Any]", getattr(causes if table == "CAUSES" else strategy, table))
    others = {"CAUSES": _other_rows, "MILDER_THAN": _other_actions}.get(table, _other_ladders)
    return entries, list(entries), lambda key: others(entries[key])


def _other_rows(row: Any) -> dict[str, Any]:
    """Of a cause: other times, another end, other policies."""
    from mavproxy_handover.core.common.causes import Ends

    ends = next(each for each in Ends if each is not row.ends)
    return {
        "a longer hold-off": replace(row, hold_off_s=row.hold_off_s + 0.5),
        "a longer clearing time": replace(row, clear_s=row.clear_s + 0.5),
        f"ends {ends.value}": replace(row, ends=ends),
        "another policy first": replace(row, policies=(*row.policies[1:], row.policies[0])),
        "the last policy missing": replace(row, policies=row.policies[:-1]),
    }


def _other_actions(action: Any) -> dict[str, Any]:
    from mavproxy_handover.core.common.model import FlightAction

    return {**{each.name: each for each in FlightAction if each is not action}, "nothing": _NOTHING}


def _other_ladders(ladder: Any) -> dict[str, Any]:
    """A rung is missing, asks for something else, or needs nothing."""
    from mavproxy_handover.core.common.model import FlightAction

    found: dict[str, Any] = {}
    for place, rung in enumerate(ladder):
        before, behind = ladder[:place], ladder[place + 1 :]
        found[f"no {rung.action.name}"] = (*before, *behind)
        for action in FlightAction:
            found[f"{action.name} for {rung.action.name}"] = (*before, replace(rung, action=action), *behind)
        found[f"{rung.action.name} always"] = (*before, replace(rung, needs=None), *behind)
    return found


def plant(module: str, table: str, number: int, target: str) -> None:
    """Change an entry of a table in this process."""
    entries, keys, others = _table(module, table)
    value = others(keys[number])[target]
    if value is _NOTHING:
        del entries[keys[number]]
    else:
        entries[keys[number]] = value


# ---- where they are ----


def file_of(module: str) -> Path:
    """Where a module's source lies."""
    if module.startswith(STATION):
        return ROOT.joinpath("gcs_module", module.removeprefix(STATION)).with_suffix(".py")
    if module.startswith(GATE):
        return ROOT.joinpath("mavproxy_handover", *module.split(".")).with_suffix(".py")
    return ROOT.joinpath("mavproxy_handover", "core", *module.split(".")).with_suffix(".py")


def source_of(module: str) -> str:
    """A module's source."""
    return file_of(module).read_text(encoding="utf-8")
