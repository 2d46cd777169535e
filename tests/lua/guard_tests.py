# SPDX-License-Identifier: GPL-3.0-or-later

"""Runs the guard's tests against faulty scripts: one process has all tests in memory and forks for each script.

Of each test the lines of the script that it reaches are recorded first, by a debug hook of Lua. A test that does not
reach a fault's lines cannot notice it, and is left out. Tests that read the script as text are always asked.
"""

from __future__ import annotations

import gc
import hashlib
import json
import os
import resource
import time
from collections import Counter
from collections.abc import Callable, Sequence
from itertools import groupby, zip_longest
from pathlib import Path
from typing import Any

import pytest

from sitl.vehicles import lua_bindings
from tests.mutation import run
from tests.mutation.run import in_child

__all__ = ["SCRIPT", "SURVIVED", "GuardTests", "Record"]

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "ardupilot_lua" / "handover_guard.lua"
TESTS = ROOT / "tests" / "lua"
SURVIVED = "survived"
#: random flights, of which the same fault is noticed once and not another time, and tests that ask luacheck
LEFT_OUT = (
    "test_guard_budget",
    "test_whatever_came_before",
    "test_while_authority_is_there",
    "test_no_global_is_written",
    "luacheck",
)
#: its tests read the script as text
READS_TEXT = "test_guard_files"
#: so many tests that noticed faults of a function are asked first about its next fault
REMEMBERED = 10

_ARM = 'if counting then debug.sethook(count, "", 1) else debug.sethook(bounded, "", limit) end'
#: sets a hook that notes each line as well. A tail call, because `count` asks who called it. The approximate limit is
#: raised, because the instructions of the hook itself count.
_ARM_AND_NOTE = """
    local hook = counting and count or bounded
    debug.sethook(function(event, line)
        if event == "line" then reached[line] = true else return hook() end
    end, "l", counting and 1 or 20 * limit)
"""
#: moves the lines of the bindings beyond those of the script
_BEYOND = 10_000


class Record:
    """Results so far, in a file if there is one: another run goes on from there.

    If a file of tests has changed, its tests are recorded again. A fault that one of them noticed is tried again, and a
    survivor is shown to the tests of this file only. After a change of the script every fault is tried again.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        common = [SCRIPT, TESTS / "stub.py", TESTS / "numbers.py"]
        common += sorted((ROOT / "sitl" / "vehicles").glob("lua_*.py"))
        self._common = _hash(*common)
        self._files = {file.name: _hash(file) for file in sorted(TESTS.glob("test_guard_*.py"))}
        #: of each test: processor time (s), and the lines that it reaches, as bits
        self.tests: dict[str, tuple[float, int]] = {}
        #: of each fault that has been tried: the test that noticed it, or SURVIVED
        self.tried: dict[str, str] = {}
        #: the same with an earlier script, or with earlier tests
        self.before: dict[str, str] = {}
        #: of each fault that survived: the files with the tests that did not notice it
        self.survived: dict[str, set[str]] = {}
        if path is not None and path.exists():
            self._read(json.loads(path.read_text(encoding="utf-8")))

    def _read(self, found: dict[str, Any]) -> None:
        self.before = found["before"] | found["tried"]
        if found["common"] != self._common:
            return
        same = {name for name, content in self._files.items() if found["files"].get(name) == content}
        self.tests = {
            name: (took_s, int(lines, 16)) for name, (took_s, lines) in found["tests"].items() if _file_of(name) in same
        }
        self.survived = {fault: same.intersection(files) for fault, files in found["survived"].items()}
        self.tried = {
            fault: by for fault, by in found["tried"].items() if _file_of(by) in same or found["files"] == self._files
        }

    def add(self, fault: str, by: str) -> None:
        """Note the result of a fault, and write the file."""
        self.tried[fault] = by
        if by == SURVIVED:
            self.survived[fault] = set(self._files)
        self.write()

    def write(self) -> None:
        """Write the file, if there is one."""
        if self._path is None:
            return
        text = json.dumps(
            {
                "common": self._common,
                "files": self._files,
                "tests": {name: (round(took_s, 3), f"{lines:x}") for name, (took_s, lines) in self.tests.items()},
                "tried": self.tried,
                "before": self.before,
                "survived": {fault: sorted(files) for fault, files in self.survived.items()},
            }
        )
        new = self._path.with_suffix(".new")
        new.write_text(text, encoding="utf-8")
        new.replace(self._path)


def _hash(*files: Path) -> str:
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def _file_of(test: str) -> str:
    """The name of the file that has the test."""
    return test.partition("::")[0].rpartition("/")[2]


class GuardTests:
    """The tests, collected once: a plug-in of pytest."""

    def __init__(self, record: Record, folder: Path) -> None:
        """`folder`: for the files of the tests; each fork empties it."""
        self._record, self._folder = record, folder
        self._items: list[pytest.Item] = []
        #: tests that noticed faults of a function, the last one first
        self._noticed: dict[str, list[pytest.Item]] = {}
        self._work: Callable[[GuardTests], None] = lambda _tests: None
        self._wrong = "the tests cannot be collected"

    def collected(self, work: Callable[[GuardTests], None]) -> str:
        """Collect the tests, try them without any fault, and do the work with them; what is wrong, or ""."""
        self._work = work
        run.import_once()
        options = [*run.PYTEST, "-s", "--no-summary", "--timeout=0", f"--rootdir={ROOT}", f"--basetemp={self._folder}"]
        pytest.main([*options, *map(str, sorted(TESTS.glob("test_guard_*.py")))], plugins=[self])
        return self._wrong

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Do the work instead of running the tests."""
        if session.testsfailed:
            return True
        self._items = [item for item in session.items if not any(part in item.nodeid for part in LEFT_OUT)]
        gc.collect()
        gc.freeze()
        self._wrong = self._try()
        if not self._wrong:
            self._work(self)
        return True

    def _try(self) -> str:
        """Try the tests of which nothing is recorded; what is wrong, or ""."""
        missing = [item for item in self._items if item.nodeid not in self._record.tests]
        for path, items in groupby(missing, key=lambda item: item.path):
            of_file = list(items)
            found = in_child(lambda of_file=of_file: _recorded(of_file))
            if not isinstance(found, dict):
                return f"{path.name} does not run: {found}"
            failed = [name for name, row in found.items() if row is None]
            if failed:
                return f"these fail: {', '.join(failed)}"
            self._record.tests.update(found)
            self._record.write()
            print(f"recorded: {path.name}, {len(of_file)} tests", flush=True)
        return ""

    def notice(self, name: str, function: str, lines: range) -> tuple[str, float]:
        """Which test notices the fault in the script, or SURVIVED, and the processor time that this took (s)."""
        tests = self._tests(name, function, lines)
        used_s = _used_by_children_s()
        answer = in_child(lambda: self._first_that_fails(tests))
        used_s = _used_by_children_s() - used_s
        if isinstance(answer, BaseException):
            raise answer
        if answer is None:
            return "a test that takes too long", used_s
        if answer == len(tests):
            return SURVIVED, used_s
        row = self._noticed.setdefault(function, [])
        if tests[answer] in row:
            row.remove(tests[answer])
        row.insert(0, tests[answer])
        return tests[answer].nodeid, used_s

    def _tests(self, name: str, function: str, lines: range) -> list[pytest.Item]:
        """The tests that may notice a fault in these lines, those that will do so soonest first."""
        record = self._record
        wanted = sum(1 << line for line in lines)
        nowhere = not any(reached & wanted for _took_s, reached in record.tests.values())
        did_not_notice = record.survived.get(name, ())
        last = self._noticed.get(function, [])[:REMEMBERED]

        def may_notice(item: pytest.Item) -> bool:
            reached = record.tests[item.nodeid][1]
            reads_all = nowhere or not reached or item.path.stem == READS_TEXT
            return item.path.name not in did_not_notice and (reads_all or bool(reached & wanted))

        fastest_first = sorted(filter(may_notice, self._items), key=lambda item: record.tests[item.nodeid][0])
        # a test notices mostly the same faults with other parameters, so each is asked once before any is asked again
        rounds: Counter[str] = Counter()
        ranks: dict[pytest.Item, tuple[bool, int, int]] = {}
        for item in fastest_first:
            known = last.index(item) if item in last else len(last)
            test = item.nodeid.partition("[")[0]
            ranks[item] = item.nodeid != record.before.get(name), known, rounds[test]
            rounds[test] += 1
        return sorted(fastest_first, key=lambda item: ranks[item])

    def _first_that_fails(self, tests: Sequence[pytest.Item]) -> int:
        """In a fork: the number of the first test that fails, or how many there are."""
        _say_nothing()
        for number, (item, following) in enumerate(zip_longest(tests, tests[1:])):
            run.limit(2.0 + 10.0 * self._record.tests[item.nodeid][0])
            if not _passes(item, following):
                return number
        return len(tests)


def _passes(item: pytest.Item, following: pytest.Item | None) -> bool:
    failed = item.session.testsfailed
    item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
    return item.session.testsfailed == failed


def _recorded(items: Sequence[pytest.Item]) -> dict[str, tuple[float, int] | None]:
    """In a fork: what each test takes (s), and the lines that it reaches; None if it fails."""
    _say_nothing()
    run.limit(0)
    engines: list[Any] = []
    start = lua_bindings.LuaScripting._start

    def noted_start(scripting: lua_bindings.LuaScripting) -> None:
        start(scripting)
        engines.append(scripting._lua)

    assert _ARM in lua_bindings.LUA_PRELUDE
    noting = lua_bindings.LUA_PRELUDE.replace(_ARM, _ARM_AND_NOTE).replace("...", "...; reached = {}", 1)
    lua_bindings.LUA_PRELUDE = "\n" * _BEYOND + noting
    lua_bindings.LuaScripting._start = noted_start  # type: ignore[method-assign]
    found: dict[str, tuple[float, int] | None] = {}
    for item, following in zip_longest(items, items[1:]):
        engines.clear()
        begun = time.process_time()
        passed = _passes(item, following)
        took_s = time.process_time() - begun
        reached = {int(line) for engine in engines for line in engine.globals().reached if line < _BEYOND}
        found[item.nodeid] = (took_s, sum(1 << line for line in reached)) if passed else None
    return found


def _used_by_children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _say_nothing() -> None:
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, 1)
    os.dup2(sink, 2)
