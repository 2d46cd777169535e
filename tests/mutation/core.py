# SPDX-License-Identifier: GPL-3.0-or-later

"""Tests the tests of the rules of authority, vehicle's and station's: `make mutants`, after those of the gate, or

    python tests/mutation/core.py [--part I/N] [--sample N] [--only TEXT] [--first] [MODULE ...]
                                                                            (default: all modules, every fault)

Each fault, in the code (`faults`) or in a transition table (`table_faults`), must be noticed by `tests/core`, or by a
small exploration (`tests/model`); one of a station (`station.MODULE`) by `tests/gcs`, by both sides together, or by
that exploration. One that is not is a survivor; survivors that are no faults are listed in `core_survivors.py` with
the reason, and any other ends this with exit code 1. So does one that is listed and does not survive any more, or that
no fault is called by any more, and a module of the core that no test here is named for. `--part 1/4` takes every fourth
fault, `--sample 100` a hundred of each module by chance, `--only TEXT` those that have that in their names; then what
is listed and not met says nothing. `--first` asks only the tests that come first (`FIRST`): a fault that they let
through has still to be tried with the others. `stories.py` looks for a story in which a fault shows.

Nothing is written: a mutant is compiled in memory, in a process of its own.
"""

from __future__ import annotations

import argparse
import ast
import io
import random
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, cast

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from tests.mutation import run  # noqa: E402
from tests.mutation.core_survivors import KNOWN_SURVIVORS  # noqa: E402
from tests.mutation.run import _Mutated, import_once, in_child  # noqa: E402

__all__ = ["Fault", "faults", "main", "misnamed", "table_faults"]

#: modules of a ground station's rules begin with this
STATION = "station."
#: module -> the tests that notice its faults soonest
FIRST = {
    "authority.transfer": (
        "test_transfer.py",
        "test_arbiter_transfer.py",
        "test_standard_stations.py",
        "test_forced.py",
    ),
    "arbiter": (
        "test_arbiter_authority.py",
        "test_arbiter_safety.py",
        "test_restart.py",
        "test_arbiter_transfer.py",
        "test_deaf_commander.py",
    ),
    "authority.authority": (
        "test_arbiter_authority.py",
        "test_restart.py",
        "test_control.py",
        "test_arbiter_transfer.py",
    ),
    "authority.transfer_manager": (
        "test_arbiter_transfer.py",
        "test_forced.py",
        "test_standard_stations.py",
        "test_control.py",
    ),
    "authority.candidates": ("test_arbiter_transfer.py", "test_forced.py", "test_control.py", "test_link_quality.py"),
    "authority.contacts": ("test_arbiter_authority.py", "test_presence.py"),
    "authority.requests": ("test_control.py", "test_standard_stations.py", "test_forced.py"),
    "authority.start": ("test_start.py", "test_arbiter_start.py", "test_control.py", "test_arbiter_safety.py"),
    "common.flight": ("test_arbiter_start.py", "test_arbiter_safety.py", "test_arbiter_authority.py"),
    "authority.hearing": ("test_hearing.py", "test_deaf_commander.py"),
    "authority.links": ("test_link_quality.py",),
    "authority.zones": ("test_zones.py", "test_arbiter_safety.py"),
    "authority.phases": ("test_phases.py",),
    "authority.rehearsal": ("test_rehearsal.py",),
    "common.authority_facts": ("safety/test_conditions.py", "test_link_quality.py"),
    "common.causes": ("safety/test_causes.py", "safety/test_strategy.py", "safety/test_emergency.py"),
    "safety.strategy": ("safety/test_strategy.py", "safety/test_emergency.py", "test_arbiter_safety.py"),
    "safety.emergency": (
        "safety/test_emergency.py",
        "test_arbiter_safety.py",
        "test_restart.py",
        "safety/test_held_restart.py",
    ),
    "safety.conditions": (
        "safety/test_conditions.py",
        "test_arbiter_safety.py",
        "test_link_quality.py",
        "test_rehearsal.py",
        "safety/test_held_restart.py",
        "safety/test_gap.py",
        "safety/test_overruled.py",
        "safety/test_wings.py",
        "safety/test_decision_executor.py",
    ),
    "authority.coverage": (
        "safety/test_conditions.py",
        "test_arbiter_safety.py",
        "test_link_quality.py",
        "test_rehearsal.py",
        "safety/test_held_restart.py",
        "safety/test_gap.py",
        "safety/test_overruled.py",
        "safety/test_wings.py",
        "safety/test_decision_executor.py",
    ),
    "safety.hold_timer": (
        "safety/test_held_restart.py",
        "safety/test_conditions.py",
        "safety/test_decision_executor.py",
    ),
    "safety.decision_facts": (
        "safety/test_conditions.py",
        "test_arbiter_safety.py",
        "test_link_quality.py",
        "test_rehearsal.py",
        "safety/test_held_restart.py",
        "safety/test_gap.py",
        "safety/test_overruled.py",
        "safety/test_wings.py",
        "safety/test_decision_executor.py",
    ),
    "safety.safety": (
        "safety/test_conditions.py",
        "test_arbiter_safety.py",
        "test_link_quality.py",
        "test_rehearsal.py",
        "safety/test_held_restart.py",
        "safety/test_gap.py",
        "safety/test_overruled.py",
        "safety/test_wings.py",
        "safety/test_decision_executor.py",
    ),
    "safety.return_site": ("safety/test_return_site.py",),
    "safety.mode_source": ("safety/test_mode_source.py", "safety/test_decision_executor.py"),
    "safety.command_verification": (
        "safety/test_command_verification.py",
        "safety/test_decision_executor.py",
        "safety/test_wings.py",
    ),
    "safety.decision_executor": (
        "safety/test_decision_executor.py",
        "safety/test_conditions.py",
        "safety/test_held_restart.py",
        "safety/test_overruled.py",
        "safety/test_wings.py",
        "test_rehearsal.py",
        "safety/test_gap.py",
        "safety/test_emergency.py",
        "test_arbiter_safety.py",
    ),
    "safety.gap": ("safety/test_gap.py",),
    "safety.commands": ("safety/test_commands.py",),
    "safety.sentence": ("safety/test_sentence.py", "safety/test_decision_executor.py"),
    "safety.explain": ("../cli/test_explain.py",),
    "safety.route": ("safety/test_route.py",),
    "safety.energy": ("safety/test_energy.py", "safety/test_energy_prior.py", "safety/test_learning.py"),
    "safety.energy_prior": ("safety/test_energy_prior.py", "safety/test_energy.py"),
    "safety.battery": ("safety/test_battery.py",),
    "safety.learning": ("safety/test_learning.py",),
    "authority.steps": ("test_steps.py",),
    "authority.control": ("test_control.py",),
    "authority.consent": ("test_standing_consent.py",),
    "authority.cures": ("test_candidates.py", "test_standing_consent.py", "test_standard_stations.py"),
    "authority.presence": ("test_presence.py", "test_arbiter_authority.py", "test_deaf_commander.py"),
    "authority.results": ("test_arbiter_transfer.py", "test_arbiter_deadline.py"),
    "common.messages": ("test_messages.py", "test_two_sides.py"),
    "common.limits": (
        "test_arbiter_transfer.py",
        "test_arbiter_safety.py",
        "test_link_quality.py",
        "test_arbiter_start.py",
    ),
    "common.events": ("test_arbiter_transfer.py", "test_control.py"),
    "common.model": (
        "test_arbiter_transfer.py",
        "test_presence.py",
        "test_standard_stations.py",
        "test_arbiter_safety.py",
        "test_control.py",
        "test_restart.py",
    ),
    "common.handling": ("safety/test_wings.py", "safety/test_command_verification.py"),
    "common.snapshot": ("test_restart.py",),
    "authority.foresight": ("test_foresight.py",),
    "station.core": ("test_core.py", "test_ahead.py", "test_core_hostile.py"),
    "station.ahead": ("test_ahead.py", "../core/test_foresight.py"),
    "station.events": ("test_core.py", "test_ahead.py"),
    "station.alarms": ("test_alarms.py",),
    "station.banner": ("test_banner.py",),
    "station.briefing": ("test_briefing.py",),
    "station.decisions": ("test_decisions.py", "../module/test_station_module.py"),
}
#: slow, so they come last, the slowest behind the others
LAST = (
    "test_arbiter_hostile.py",
    "test_arbiter_deadline.py",
    "test_foresight.py",
    "safety/test_whatever_comes.py",
    "test_power_loss.py",
    "safety/test_return_site.py",
    "test_two_sides.py",
)
STATION_LAST = ("../core/test_foresight.py", "../core/test_two_sides.py")
#: of the station these alone have a part in what is explored
EXPLORED_STATION = ("station.core", "station.ahead")
#: explored with what the tests have let through
EXPLORED = (
    "transfer",
    "liars",
    "commander's operator",
    "one request",
    "standard both",
    "whole flight",
    "three stations",
)

#: tables of a module: what stands there is changed, one entry at a time
TABLES = {
    "authority.transfer": ("MOVES",),
    "authority.phases": ("PHASES",),
    "common.causes": ("CAUSES",),
    "safety.strategy": ("FIRST", "POLICY_LADDERS", "MILDER_THAN"),
}
WORST = {"authority.transfer": "committed", "authority.phases": "ON_MISSION"}

_TURNED: dict[type[ast.cmpop], type[ast.cmpop]] = {
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


Change = tuple[str, ast.AST, Callable[[], None], Callable[[], None]]


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault: a module's source with it, or an entry of a table: the table, the key, and where it leads now."""

    name: str
    source: str | None = None
    entry: tuple[str, int, str] | None = None


# ---- faults in the code --------------------------------------------------------------------------------------------


def faults(source: str) -> Iterator[Fault]:
    """Every fault of the functions in a module's source and of its values, one at a time."""
    tree = ast.parse(source)
    seen: Counter[str] = Counter()
    for value, (operator, before, apply, undo) in _of_values(tree):
        apply()
        mutated = ast.unparse(ast.fix_missing_locations(tree))
        undo()
        yield Fault(f"{value}: {operator}: {_short(before)}", mutated)
    for function, around, node in _inside(tree, "", tree):
        # a number says nothing by itself
        place = f" in {_short(around)}" if isinstance(node, ast.Constant) else ""
        for operator, before, apply, undo in _changes(node):
            text = _short(before) + place
            apply()
            mutated = ast.unparse(ast.fix_missing_locations(tree))
            undo()
            name = f"{function}: {operator}: {text}"
            seen[name] += 1
            yield Fault(name if seen[name] == 1 else f"{name} (number {seen[name]})", mutated)


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
            turned = [*node.ops[:place], _TURNED[type(operator)](), *node.ops[place + 1 :]]
            yield _set("comparison turned", node, node, "ops", turned)
    if isinstance(node, (ast.BoolOp, ast.Return, ast.Assign, ast.keyword)):
        yield from _without_not(node)
    if isinstance(node, ast.BoolOp):
        yield _set("and/or swapped", node, node, "op", ast.And() if isinstance(node.op, ast.Or) else ast.Or())
        for place, value in enumerate(node.values):
            rest = [each for other, each in enumerate(node.values) if other != place]
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


def _plant(module: str, table: str, number: int, target: str) -> None:
    entries, keys, others = _table(module, table)
    value = others(keys[number])[target]
    if value is _NOTHING:
        del entries[keys[number]]
    else:
        entries[keys[number]] = value


# ---- whether they are noticed --------------------------------------------------------------------------------------


def unnoticed(module: str, fault: Fault | None, *, first: bool = False) -> bool:
    """Whether tests and exploration, or only the tests that come `first`, find nothing wrong. In a process of its own:
    it spoils the modules."""
    import importlib

    import pytest

    name = ".".join(_file(module).relative_to(ROOT).with_suffix("").parts)
    if fault is not None and fault.source is not None:
        path = _file(module)
        sys.meta_path.insert(0, _Mutated(name, fault.source, path))
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        try:
            importlib.import_module(name)
        except Exception:
            return False
        if fault is not None and fault.entry is not None:
            _plant(module, *fault.entry)
        station = module.startswith(STATION)
        tests = ROOT / "tests" / ("gcs" if station else "core")
        slow = STATION_LAST if station else LAST
        everything = sorted(path.relative_to(tests).as_posix() for path in tests.rglob("test_*.py"))
        middle = [each for each in everything if each not in (*FIRST[module], *slow, "test_purity.py")]
        last = [each for each in slow if each not in FIRST[module]]
        options = [*run.PYTEST, "--rootdir", str(ROOT), "--timeout=60"]
        # most faults die in the first files, and to read the others takes longer than that
        for files in (FIRST[module],) if first else (FIRST[module], middle, last):
            paths = [str(tests / each) for each in files]
            if paths and int(pytest.main([*options, *paths], plugins=[_EachInTime()])) != 0:
                return False
        if first:
            return True
        run.limit(run.TIMEOUT_S)  # the tests have had the clock for their own limits
        return (station and module not in EXPLORED_STATION) or not _found_by_exploring()


class _EachInTime:
    """Each test has so much time of this process; none comes near it."""

    SECONDS = 15.0

    def pytest_runtest_logstart(self) -> None:
        """Before each test."""
        run.limit(self.SECONDS)

    def pytest_runtest_logfinish(self) -> None:
        """Behind each test."""
        run.limit(run.TIMEOUT_S)


def _found_by_exploring() -> bool:
    from tests.model.explorer import explore
    from tests.model.plans import QUICK
    from tests.model.steps import Graph

    for setting in QUICK:
        if setting.name in EXPLORED:
            try:
                report = explore(Graph(setting))
            except Exception:  # whatever it stumbles over, it is noticed
                return True
            if report.found is not None:
                return True
    return False


def of_module(
    module: str, choose: Callable[[list[Fault]], list[Fault]], *, first: bool = False
) -> tuple[int, list[str]]:
    """How many faults were planted in a module, and which nobody noticed."""
    assert in_child(lambda: unnoticed(module, None, first=first)) is True, f"{module}: found without any fault"
    chosen = choose([*faults(_source(module)), *table_faults(module)])
    alive = []
    for number, fault in enumerate(chosen, 1):
        if in_child(lambda fault=fault: unnoticed(module, fault, first=first)) is True:  # type: ignore[misc]
            alive.append(fault.name)
            print(f"  survived: {module}: {fault.name}", flush=True)
        if number % 50 == 0:
            print(f"  {module}: {number} of {len(chosen)}, {len(alive)} survived", flush=True)
    return len(chosen), alive


def _file(module: str) -> Path:
    if module.startswith(STATION):
        return ROOT.joinpath("gcs_module", module.removeprefix(STATION)).with_suffix(".py")
    return ROOT.joinpath("mavproxy_handover", "core", *module.split(".")).with_suffix(".py")


def _source(module: str) -> str:
    return _file(module).read_text(encoding="utf-8")


def _modules() -> list[str]:
    core = ROOT / "mavproxy_handover" / "core"
    modules = sorted(".".join(path.relative_to(core).with_suffix("").parts) for path in core.rglob("*.py"))
    return modules + [module for module in FIRST if module.startswith(STATION) and _file(module).exists()]


def misnamed() -> list[str]:
    """Modules of the core that no test here is named for, and names that no module has."""
    modules = _modules()
    wrong = [
        f"no tests are named for {module}" for module in modules if module not in FIRST and any(faults(_source(module)))
    ]
    return wrong + [f"there is no module {module}" for module in {**FIRST, **KNOWN_SURVIVORS} if module not in modules]


def _out_of_date() -> list[str]:
    """What is said here of the core and does not hold any more."""
    wrong, modules = misnamed(), _modules()
    for module, known in KNOWN_SURVIVORS.items():
        if module in modules:
            there = {fault.name for fault in (*faults(_source(module)), *table_faults(module))}
            wrong += [f"listed, but there is no such fault: {module}: {name}" for name in known if name not in there]
    return wrong


def main(arguments: list[str] | None = None) -> int:
    """Plant the faults asked for; 1 if a survivor is not known, or a known one died."""
    parser = argparse.ArgumentParser(description="faults planted in the rules of authority")
    parser.add_argument("modules", nargs="*", metavar="MODULE", help=", ".join(FIRST))
    parser.add_argument("--part", default="1/1", metavar="I/N", help="every Nth fault, beginning with the Ith")
    parser.add_argument("--sample", type=int, metavar="N", help="N faults of each module, by chance")
    parser.add_argument("--only", metavar="TEXT", default="", help="those whose names have it in them")
    parser.add_argument("--first", action="store_true", help="ask only the tests that come first")
    parser.add_argument("--list", action="store_true", help="print the faults instead")
    options = parser.parse_args(arguments)
    part, parts = (int(each) for each in options.part.split("/"))

    def choose(all_of_them: list[Fault]) -> list[Fault]:
        chosen = [fault for fault in all_of_them[part - 1 :: parts] if options.only in fault.name]
        if options.sample is not None and options.sample < len(chosen):
            chosen = random.Random(0).sample(chosen, options.sample)
        return chosen

    whole = parts == 1 and options.sample is None and not options.only and not options.first
    unknown = [module for module in options.modules if module not in FIRST]
    if unknown:
        parser.error(f"unknown {', '.join(unknown)}; known are {', '.join(FIRST)}")
    import_once()
    run.TIMEOUT_S = 200
    out_of_date = _out_of_date()
    for what in out_of_date:
        print(f"  {what}", flush=True)
    wrong = len(out_of_date)
    for module in options.modules or FIRST:
        if options.list:
            for fault in choose([*faults(_source(module)), *table_faults(module)]):
                print(f"{module}: {fault.name}")
            continue
        begun = time.monotonic()
        total, alive = of_module(module, choose, first=options.first)
        known = KNOWN_SURVIVORS.get(module, {})
        surprising = [name for name in alive if name not in known]
        stale = [name for name in known if name not in alive] if whole else []
        for name in stale:
            print(f"  listed, but noticed: {module}: {name}")
        wrong += len(surprising) + len(stale)
        print(
            f"{module}: {total} faults, {total - len(alive)} noticed, {len(alive) - len(surprising)} known survivors, "
            f"{len(surprising)} unknown, {time.monotonic() - begun:.0f} s",
            flush=True,
        )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
