# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults in the policy's tables and in the judge's outcomes, each checked by the exhaustive test of the judge.

Every row of every table gets every other class; every parameter and file pattern is taken away; every outcome of a
class becomes every other outcome. A fault in one row is checked with the frames of that row alone: what fails there
fails in the whole test, which compares those frames as well. Frames whose class the fault changes come first, and for a
fault in an outcome those of its class.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import Any

__all__ = ["survivors"]


#: what a mapping has under a key that it does not have
_NOTHING = object()


def _name(case: Any) -> str:
    """The parameter of a case."""
    return bytes(dict(case.fields)["param_id"]).decode("latin-1")


def survivors() -> tuple[int, list[str]]:
    """How many mutants there were, and those that no check noticed."""
    # Imported here: the runner mutates these modules in processes of their own.
    from mavproxy_handover.gate import judge
    from mavproxy_handover.gate.policy import files, parameters, rows, switches
    from mavproxy_handover.gate.policy.access import Access
    from mavproxy_handover.wire.message_ids import MESSAGE_NAMES
    from tests.gate.frames import make_frame
    from tests.gate.ledger import (
        CASES,
        MAINTENANCE,
        MAINTENANCE_SWITCHES,
        SAFEGUARD,
        SAFEGUARD_SWITCHES,
        SENDERS,
        TOLD,
        TOLD_SWITCHES,
        Case,
    )
    from tests.gate.test_every_sender import check
    from tests.gate.test_firmware_parameters import NAMES as FIRMWARE

    @cache
    def made(name: str, sysid: int, version: int, fields: str) -> Any:
        return make_frame(name, sysid=sysid, version=version, **frames[fields])

    frames: dict[str, dict[str, Any]] = {}

    def make(name: str, sysid: int, version: int, **fields: Any) -> Any:
        key = repr(sorted(fields.items()))
        frames[key] = fields
        return made(name, sysid, version, key)

    def killed(cases: list[Case]) -> bool:
        try:
            for case in cases:
                for sender in SENDERS:
                    check(case, *sender, make)
        except (AssertionError, KeyError):
            return True
        return False

    def row_of(case: Case) -> rows.Row:
        frame = make(case.name, 251, 2, **dict(case.fields))
        return rows.classify(frame)

    by_message: dict[str, list[Case]] = {}
    by_row: dict[str, list[Case]] = {}
    by_access: dict[Access | None, list[Case]] = {}
    for case in CASES:
        row = row_of(case)
        by_message.setdefault(case.name, []).append(case)
        by_row.setdefault(row.what, []).append(case)
        by_access.setdefault(row.access, []).append(case)
    assert not killed(CASES), "the checks fail without any mutant"

    @contextmanager
    def patched(target: Any, key: Any, value: Any) -> Iterator[None]:
        mapping = target if isinstance(target, dict) else vars(target)
        before = mapping.get(key, _NOTHING)
        mapping[key] = value
        vars(judge)["_USUAL"] = judge._usual_by_id()
        try:
            yield
        finally:
            if before is _NOTHING:
                del mapping[key]
            else:
                mapping[key] = before
            vars(judge)["_USUAL"] = judge._usual_by_id()

    total, alive = 0, []

    def judge_mutant(name: str, target: Any, key: Any, value: Any, cases: list[Case]) -> None:
        nonlocal total
        total += 1
        if total % 1000 == 0:
            print(f"  tables: {total} so far, {len(alive)} survived", flush=True)
        before = [row_of(case).access for case in cases]
        with patched(target, key, value):
            changed = [row_of(case).access is not access for case, access in zip(cases, before, strict=True)]
            first = sorted(range(len(cases)), key=lambda number: not changed[number])
            if not killed([cases[number] for number in first]):
                alive.append(name)

    others: Callable[[Any], list[Access]] = lambda access: [a for a in Access if a is not access]  # noqa: E731
    for msgid, row in rows.MESSAGE_ROWS.items():
        for access in others(row.access):
            mutant = replace(row, access=access)
            judge_mutant(f"{row.what} as {access.value}", rows.MESSAGE_ROWS, msgid, mutant, by_row[row.what])
    for by_part in rows._PART_ROWS.values():
        for part, row in by_part.items():
            for access in others(row.access):
                judge_mutant(
                    f"{row.what} as {access.value}", by_part, part, replace(row, access=access), by_row[row.what]
                )
    for msgid, default in rows._PART_DEFAULTS.items():
        message = MESSAGE_NAMES[msgid]
        for access in others(default):
            judge_mutant(f"{message}/* as {access.value}", rows._PART_DEFAULTS, msgid, access, by_message[message])

    named = [case for name in parameters.PARAMETER_MESSAGES for case in by_message[name]]
    kinds = {"locked": SAFEGUARD, "no row": SAFEGUARD, "open": TOLD, "maintenance": MAINTENANCE}
    firmware = {name: kind for section, kind in kinds.items() for name in FIRMWARE[section]}

    def cases_of(rule: Any) -> list[Case]:
        """The firmware's own parameters that a row is about."""
        mine = [name for name in firmware if parameters.parameter_rule(name) is rule]
        return [Case("PARAM_SET", firmware[name], (("param_id", name.encode()),)) for name in mine]

    rules = parameters.PARAMETER_RULES
    for number, rule in enumerate(rules):
        about = cases_of(rule)
        for access in others(rule.access):
            changed = (*rules[:number], replace(rule, access=access), *rules[number + 1 :])
            judge_mutant(f"{rule.names} as {access.value}", parameters, "PARAMETER_RULES", changed, about)
        for pattern in rule.names:
            kept = tuple(name for name in rule.names if name != pattern) or ("no such parameter",)
            without = (*rules[:number], replace(rule, names=kept), *rules[number + 1 :])
            matcher = parameters._matcher(without)
            with patched(parameters, "_MATCHER", matcher):
                classes = {parameters.parameter_rule(_name(case)).access for case in about}
            if classes == {rule.access}:  # what another row, or none, says of these names is the same
                continue
            judge_mutant(f"without {pattern}", parameters, "_MATCHER", matcher, about)
    switched = [case for name in ("COMMAND_LONG", "COMMAND_INT") for case in by_message[name]]
    switched = [case for case in switched if dict(case.fields).get("command") == 218]
    for number in (*SAFEGUARD_SWITCHES, *MAINTENANCE_SWITCHES, *TOLD_SWITCHES):
        rule = switches.switch_rule(number)
        for access in others(rule.access):
            mutant_rule = replace(rule, access=access)
            judge_mutant(f"switch {number} as {access.value}", switches._RULES, number, mutant_rule, switched)
    for access in others(parameters.OTHER_PARAMETERS.access):
        changed_rule = replace(parameters.OTHER_PARAMETERS, access=access)
        judge_mutant(f"other parameters as {access.value}", parameters, "OTHER_PARAMETERS", changed_rule, named)

    transfers = by_message["FILE_TRANSFER_PROTOCOL"]
    for number, file in enumerate(files.FILE_RULES):
        changes = {f"{file.name} as {access.value}": replace(file, access=access) for access in others(file.access)}
        changes[f"{file.name} with reads turned"] = replace(file, reads=not file.reads)
        for pattern in file.patterns:
            kept = tuple(other for other in file.patterns if other != pattern)
            changes[f"{file.name} without {pattern}"] = replace(file, patterns=kept)
        for name, mutant_file in changes.items():
            changed_files = (*files.FILE_RULES[:number], mutant_file, *files.FILE_RULES[number + 1 :])
            judge_mutant(name, files, "FILE_RULES", changed_files, transfers)
    for name in ("_WRITES", "_READS"):
        for opcode in getattr(files, name):
            judge_mutant(f"{name} without {opcode}", files, name, getattr(files, name) - {opcode}, transfers)

    tables = {
        "commander": judge._FOR_COMMANDER,
        "commander, armed": judge._FOR_COMMANDER_ARMED,
        "others": judge._FOR_OTHERS,
        "others, armed": judge._FOR_OTHERS_ARMED,
    }
    outcomes = sorted({outcome for table in tables.values() for outcome in table.values()}, key=repr)
    for who, table in tables.items():
        for access, outcome in table.items():
            elsewhere = [case for kind, cases in by_access.items() if kind is not access for case in cases]
            for other in outcomes:
                if other != outcome:
                    name = f"{access.value} of {who}: {other[0].value}, {other[1].value}"
                    judge_mutant(name, table, access, other, [*by_access.get(access, []), *elsewhere])
    return total, alive
