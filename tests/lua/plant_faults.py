# SPDX-License-Identifier: GPL-3.0-or-later

"""Tests the guard's tests: python -m tests.lua.plant_faults [--share 1/2] [--new] [--record FILE] [part of a name] ...

Small faults are planted in a copy of the shipped script, one at a time, and tests/lua is run against each copy. A
comparison is turned around or moved by its edge. A condition is always or never true. `and` stands for `or`, plus for
minus. A `not` is dropped, a switch is turned, a number is one more or doubled. A mask of 32 bits is dropped. A
statement is left out. Faults are planted in every function and in the tables of modes, reasons, times and transitions.
Texts are not changed, and luacheck is not asked: a test must see that the guard flies wrongly.

A fault that no test notices is a survivor. `plant_faults_survivors` lists the survivors that are no faults, with the
reason. The exit code is 1 if another fault survives, or if a listed one does not survive any more.

One process has the tests in memory and tries each fault in a fork (`guard_tests`). Only tests that reach the line of
the fault are asked: first those that noticed the last faults of the same function, then the fastest.

`--record FILE` is read and written: what each test reaches, and which faults have been tried. A run that was ended goes
on from there. After a change of the tests, faults that a changed file noticed are tried again, and survivors are shown
to changed files. After a change of the script every fault is tried again, and the test that noticed it before is asked
first. `--new` leaves out the listed survivors, each of which costs every test that reaches it.
`--share 1/2` and `--share 2/2` share the faults between two.

A fault is named by function, operator and source line, so that its name survives an edit elsewhere in the file.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.lua.guard_tests import SCRIPT, SURVIVED, GuardTests, Record
from tests.lua.plant_faults_survivors import KNOWN_SURVIVORS

#: what is looked at outside of functions
TABLES = (
    "MS",
    "WORK",
    "VEHICLES",
    "OTHERS",
    "REASON",
    "PATIENCE",
    "TRANSITIONS",
)

_OPERATORS: tuple[tuple[str, str, str], ...] = (
    ("turned", r"==", "~="),
    ("turned", r"~=", "=="),
    ("turned", r"(?<![<>])<(?![<=])", ">="),
    ("turned", r"(?<![<>])<=", ">"),
    ("turned", r"(?<![<>])>(?![>=])", "<="),
    ("turned", r"(?<![<>])>=", "<"),
    ("edge", r"(?<![<>])<(?![<=])", "<="),
    ("edge", r"(?<![<>])<=", "<"),
    ("edge", r"(?<![<>])>(?![>=])", ">="),
    ("edge", r"(?<![<>])>=", ">"),
    ("or", r"\band\b", "or"),
    ("and", r"\bor\b", "and"),
    ("not dropped", r"\bnot ", ""),
    ("false", r"\btrue\b", "false"),
    ("true", r"\bfalse\b", "true"),
    ("minus", r" \+ ", " - "),
    ("plus", r"(?<=[\w)]) - ", " + "),
    ("shift turned", r"<<", ">>"),
    ("shift turned", r">>", "<<"),
    ("mask dropped", r" & (?:0xFFFFFFFF|0xFFFF|0xFF|mask)\b", ""),
)
_STATEMENT = re.compile(
    r"(?!local |return |if |elseif |for |function |end|else|do$|until |\w+ *= *function)[\w.:\[\]#, +]+(?:\(.*\)|=.*)$"
)
_NUMBER = re.compile(r"(?<![\w.\"%])(\d+)(?![\w.x])")


@dataclass(frozen=True)
class Fault:
    """One fault, and the script with it."""

    name: str
    source: str
    lines: range
    """Of the statement that has the fault."""

    @property
    def function(self) -> str:
        """The function or table that has the fault."""
        return self.name.partition(":")[0]


def faults(source: str) -> Iterator[Fault]:
    """Every fault that can be planted in the script."""
    lines = source.splitlines()
    seen: Counter[str] = Counter()
    function, in_comment = "", False
    for number, line in enumerate(lines):
        if line.startswith("--[["):
            in_comment = True
        if in_comment or line.startswith(("--", "local MAV_SEVERITY")):
            in_comment = in_comment and not line.startswith("--]]")
            continue
        opened = re.match(r"(?:local )?function ([\w.]+)|local (\w+) = ", line)
        if opened:
            function = opened[1] or (opened[2] if opened[2] in TABLES else "")
        if not function:
            continue
        code = re.sub(r"\s*--.*", "", line)
        for operator, changed in _of_line(code):
            name = f"{function}: {operator}: {code.strip()}"
            seen[name] += 1
            if seen[name] > 1:
                name += f" (number {seen[name]})"
            faulty = "\n".join([*lines[:number], changed, *lines[number + 1 :]]) + "\n"
            yield Fault(name, faulty, _statement(lines, number))


def _statement(lines: Sequence[str], number: int) -> range:
    """The lines of the statement around a line, counted from 1 as Lua does; `number` counts from 0.

    Lua may name any of them as the line that is reached.
    """
    first = last = number
    while first and _goes_on(lines[first - 1], lines[first]):
        first -= 1
    while last + 1 < len(lines) and _goes_on(lines[last], lines[last + 1]):
        last += 1
    return range(first + 1, last + 2)


def _goes_on(line: str, following: str) -> bool:
    ends = re.search(r"(?:\b(?:and|or|not)|[-+*/%~&|<>=,({\[.])\s*(?:--.*)?$", line)
    return bool(ends or re.match(r"\s*(?:(?:and|or)\b|[)}\]+*/%~&|<>=.]|-(?!-))", following))


def _of_line(code: str) -> Iterator[tuple[str, str]]:
    for operator, pattern, instead in _OPERATORS:
        for place in re.finditer(pattern, code):
            if not _quoted(code, place.start()):
                yield operator, code[: place.start()] + instead + code[place.end() :]
    for place in _NUMBER.finditer(code):
        if not _quoted(code, place.start()) and "say(" not in code:
            value = int(place[1])
            operator, other = ("one more", value + 1) if value < 100 else ("doubled", value * 2)
            yield operator, code[: place.start()] + str(other) + code[place.end() :]
    if code.lstrip().startswith("TRANSITIONS["):
        for place in re.finditer(r"\b[a-z]+(?=[,}])", code):
            instead = "call" if place[0] == "stay" else "stay"
            yield f"cell {place[0]}", code[: place.start()] + instead + code[place.end() :]
    condition = re.fullmatch(r"(\s*(?:else)?if )(.*)( then.*)", code)
    if condition:
        for always in ("true", "false"):
            yield f"always {always}", condition[1] + always + condition[3]
    text = code.strip()
    if (
        not text.endswith(",")
        and _STATEMENT.fullmatch(text)
        and text.count("(") == text.count(")")
        and text.count("{") == text.count("}")
    ):
        indent = code[: len(code) - len(code.lstrip())]
        if indent:
            yield "left out", indent + "local _ = nil"


def _quoted(code: str, place: int) -> bool:
    return code[:place].count('"') % 2 == 1


def chosen_faults(everything: Sequence[Fault], options: argparse.Namespace) -> list[Fault]:
    """The faults to plant; listed survivors, which take longest, come last."""
    share = re.fullmatch(r"([1-9]\d*)/([1-9]\d*)", options.share)
    if share is None or int(share[1]) > int(share[2]):
        raise SystemExit(f"plant_faults: --share {options.share}: 1/2 is the first of two")
    wanted = [
        fault
        for fault in everything
        if (not options.parts or any(part in fault.name for part in options.parts))
        and not (options.new and fault.name in KNOWN_SURVIVORS)
    ]
    mine = wanted[int(share[1]) - 1 :: int(share[2])]
    return sorted(mine, key=lambda fault: fault.name in KNOWN_SURVIVORS)


def plant(chosen: Sequence[Fault], script: Path, tests: GuardTests, record: Record) -> None:
    """Try each of these faults that has not been tried yet."""
    for number, fault in enumerate(chosen, 1):
        if fault.name in record.tried:
            continue
        begun = time.monotonic()
        script.write_text(fault.source, encoding="utf-8")
        by, used_s = tests.notice(fault.name, fault.function, fault.lines)
        record.add(fault.name, by)
        print(
            f"{number}/{len(chosen)} {by}: {fault.name} "
            f"({used_s:.1f} s of processor time, {time.monotonic() - begun:.0f} s)",
            flush=True,
        )


def report(chosen: Sequence[Fault], record: Record, gone: set[str]) -> bool:
    """Print the results by function; returns whether the survivors are those that are listed."""
    alive = [fault for fault in chosen if record.tried[fault.name] == SURVIVED]
    unknown = [fault for fault in alive if fault.name not in KNOWN_SURVIVORS]
    stale = [fault.name for fault in chosen if fault.name in KNOWN_SURVIVORS and fault not in alive]
    total, survived, new = (Counter(fault.function for fault in group) for group in (chosen, alive, unknown))
    print(f"{'function or table':28} faults noticed listed unknown")
    for name, count in total.items():
        print(f"{name:28} {count:6} {count - survived[name]:7} {survived[name] - new[name]:6} {new[name]:7}")
    for fault in unknown:
        print(f"  survived: {fault.name}")
    for name in sorted({*gone, *stale}):
        print(f"  listed, but noticed or no fault any more: {name}")
    print(
        f"{len(chosen)} faults, {len(chosen) - len(alive)} noticed, {len(alive) - len(unknown)} known survivors, "
        f"{len(unknown)} unknown",
        flush=True,
    )
    return bool(chosen) and not (unknown or stale or gone)


def main(arguments: Sequence[str]) -> int:
    """Plant the faults that the arguments choose.

    Returns 1 if one survives that is not known, or a known one does not; 2 if the tests fail without any fault.
    """
    parser = argparse.ArgumentParser(prog="plant_faults", description="faults planted in the guard")
    parser.add_argument("--share", default="1/1", metavar="N/OF", help="every OF-th fault, from the N-th on")
    parser.add_argument("--new", action="store_true", help="leave out the survivors that are listed")
    parser.add_argument("--record", type=Path, metavar="FILE", help="what has been found out: read and written")
    parser.add_argument("parts", nargs="*", metavar="PART", help="only faults with one of these in their name")
    options = parser.parse_args(arguments)
    source = SCRIPT.read_text(encoding="utf-8")
    everything = list(faults(source))
    chosen = chosen_faults(everything, options)
    record = Record(options.record)
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "scripts" / SCRIPT.name
        script.parent.mkdir()
        for extra in ("handover_guard.md", "handover.parm", "handover_plane.parm", ".luacheckrc"):
            (script.parent / extra).write_bytes((SCRIPT.parent / extra).read_bytes())
        script.write_text(source, encoding="utf-8")
        os.environ["PLANTED_GUARD"] = str(script)
        wrong = GuardTests(record, Path(folder) / "tests").collected(lambda tests: plant(chosen, script, tests, record))
    if wrong:
        print(f"without any fault: {wrong}")
        return 2
    return 0 if report(chosen, record, set(KNOWN_SURVIVORS) - {fault.name for fault in everything}) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
