# SPDX-License-Identifier: GPL-3.0-or-later

"""A process that has all tests of the rules in memory, and plants one fault after the other in copies of itself.

To import the tests takes longer than most faults live. So the tests are collected once, and a fault is planted in a
fork: the functions that differ get the mutant's code. Of each test the lines of the rules that it reaches are recorded
first; a test that does not reach a fault's lines cannot notice it, and is left out. The fastest tests come first, and
before them the one that noticed the fault in an earlier run.

What cannot be planted in a running process says so (`ELSEWHERE`): a value or a default that a module begins with, and a
function that has been called while the tests were imported. Such a fault needs a process that imports it.
"""

from __future__ import annotations

import ast
import gc
import os
import sys
import threading
import time
from collections.abc import Callable, Sequence
from inspect import CO_NEWLOCALS
from itertools import zip_longest
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from types import CodeType, FrameType, FunctionType
from typing import Any

import pytest

from tests.mutation import run
from tests.mutation.faults import ROOT, Fault, faults, file_of, plant, source_of, table_faults
from tests.mutation.run import in_child

__all__ = ["ELSEWHERE", "SURVIVED", "Server"]

#: answers besides the name of the test that noticed a fault
SURVIVED, ELSEWHERE, EXPLORATION = "survived", "elsewhere", "exploration"
#: so often a function's lines are followed in one test; a test that calls it more often counts as reaching all of them
_FOLLOWED = 25
#: tests of the core and of the stations, and single ones that `core.FIRST` names besides
_FOLDERS = ("tests/core", "tests/gcs", "tests/cli/test_explain.py", "tests/module/test_station_module.py")

Asks = Callable[[str, str], bool]
#: a function: file, name, first line
Key = tuple[str, str, int]


def _key(code: CodeType) -> Key:
    return code.co_filename, code.co_qualname, code.co_firstlineno


class Server:
    """The process, as the one that asks it sees it."""

    def __init__(self, files: Sequence[str], asks: Asks, explores: Callable[[str], bool]) -> None:
        """`files`: of the modules that faults are planted in. `asks`: whether the tests in a file have to notice the
        faults of a module. `explores`: whether the exploration finds something wrong."""
        self._pipe, other = Pipe()
        self._process = os.fork()
        if self._process == 0:
            self._pipe.close()
            status = 1
            try:
                os.dup2(2, 1)
                options = [*run.PYTEST, "-s", "--timeout=0", "--rootdir", str(ROOT)]
                pytest.main(
                    [*options, *(str(ROOT / each) for each in _FOLDERS)],
                    plugins=[_Served(other, files, asks, explores)],
                )
                status = 0
            finally:
                os._exit(status)
        other.close()

    def ask(self, module: str, number: int, *, slow: bool, before: str | None = None) -> str:
        """The test that notices a fault of a module; `before`: the one that noticed it in an earlier run.

        `slow`: whether the slow tests and the exploration are asked, or else the fast tests. The first question of each
        kind takes as long as all these tests do.
        """
        self._pipe.send((module, number, slow, before))
        answer = self._pipe.recv()
        if isinstance(answer, AssertionError):
            raise answer
        return str(answer)

    def close(self) -> None:
        """End the process."""
        self._pipe.send(None)
        os.waitpid(self._process, 0)


class _Served:
    """In the process: what pytest calls."""

    def __init__(self, pipe: Connection, files: Sequence[str], asks: Asks, explores: Callable[[str], bool]) -> None:
        self._files, self._asks, self._explores = set(files), asks, explores
        self._pipe = pipe
        self._items: list[pytest.Item] = []
        #: functions of the rules that were called while the tests were imported
        self._called: set[Key] = set()
        self._functions: dict[Key, list[FunctionType]] = {}
        #: of each test that has been tried without a fault: time (s), and the lines that it reaches, as bits, by file
        self._took_s: dict[int, float] = {}
        self._reached: dict[int, dict[str, int]] = {}
        #: the fast tests and the slow ones
        self._kinds: dict[bool, list[int]] = {}
        self._faults: dict[str, list[Fault]] = {}
        self._codes: dict[str, CodeType] = {}
        #: tests that noticed faults of a function, the last one first
        self._noticed: dict[str, list[int]] = {}
        sys.settrace(self._on_import)

    def _on_import(self, frame: FrameType, _event: str, _arg: object) -> None:
        if frame.f_code.co_filename in self._files:
            self._called.add(_key(frame.f_code))

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Answer questions instead of running the tests."""
        import tests.model.explorer
        import tests.model.plans
        import tests.model.steps  # noqa: F401

        sys.settrace(None)
        self._items = session.items
        # what lasts as long as the session begins here, and not in each fork
        purity = [number for number, item in enumerate(self._items) if "test_purity.py" in item.nodeid]
        self._run(purity[0], purity[-1])
        for found in gc.get_objects():
            if isinstance(found, FunctionType) and found.__code__.co_filename in self._files:
                self._functions.setdefault(_key(found.__code__), []).append(found)
        gc.collect()
        gc.freeze()
        while (question := self._pipe.recv()) is not None:
            try:
                answer: str | AssertionError = self._answer(*question)
            except AssertionError as error:
                answer = error
            self._pipe.send(answer)
        return True

    def _run(self, number: int, following: int | None) -> bool:
        """Run a test; whether it passes. `following`: the one that is run after it."""
        item = self._items[number]
        failed = item.session.testsfailed
        nextitem = None if following is None else self._items[following]
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=nextitem)
        return item.session.testsfailed == failed

    # ---- what each test reaches -----------------------------------------------------------------------------------

    def _try(self, *, slow: bool) -> None:
        """Try the tests without any fault."""
        wanted = [
            number
            for number, item in enumerate(self._items)
            if (item.get_closest_marker("slow") is not None) == slow and item.get_closest_marker("long") is None
        ]
        recorded = in_child(lambda: self._record(wanted))
        assert isinstance(recorded, dict), f"the tests do not run: {recorded}"
        failed = [self._items[number].nodeid for number, row in recorded.items() if row is None]
        assert not failed, f"without any fault these fail: {', '.join(failed)}"
        for number, (took_s, reached) in recorded.items():
            self._took_s[number], self._reached[number] = took_s, reached
        if slow:
            assert in_child(lambda: self._explores("arbiter")) is False, "exploring finds something without any fault"
        self._kinds[slow] = wanted

    def _record(self, wanted: list[int]) -> dict[int, tuple[float, dict[str, int]] | None]:
        """In a fork: what each test takes and reaches; None if it fails."""
        _say_nothing()
        run.limit(0)
        found: dict[int, tuple[float, dict[str, int]] | None] = {}
        for number, following in zip_longest(wanted, wanted[1:]):
            begun = time.process_time()
            with _Lines(self._files) as lines:
                passed = self._run(number, following)
            found[number] = (time.process_time() - begun, lines.reached) if passed else None
        return found

    # ---- faults ---------------------------------------------------------------------------------------------------

    def _answer(self, module: str, number: int, slow: bool, before: str | None) -> str:
        if slow not in self._kinds:
            self._try(slow=slow)
        if module not in self._faults:
            source = source_of(module)
            self._faults[module] = [*faults(source), *table_faults(module)]
            self._codes[module] = compile(ast.parse(source), str(file_of(module)), "exec")
        fault, path = self._faults[module][number], str(file_of(module))
        planted: dict[Key, CodeType] = {}
        if fault.edit is not None:
            code = fault.edit.made(lambda tree: compile(tree, path, "exec"))
            only_functions = _changed(self._codes[module], code, planted)
            if not only_functions or not planted or not all(map(self._plantable, planted)):
                return ELSEWHERE
        elif fault.entry is not None and fault.entry[0] == "CAUSES":  # tests read it while they are imported
            return ELSEWHERE
        function = f"{module} {fault.name.partition(':')[0]}"
        tests = self._tests(module, fault, function, self._kinds[slow], before)
        answer = in_child(lambda: self._notice(module, fault, planted, tests, explores=slow))
        if answer is None:
            return "it takes too long"
        if isinstance(answer, BaseException):
            return f"{type(answer).__name__}: {answer}"
        if isinstance(answer, int):
            row = self._noticed.setdefault(function, [])
            if answer in row:
                row.remove(answer)
            row.insert(0, answer)
            return self._items[answer].nodeid
        return str(answer)

    def _plantable(self, key: Key) -> bool:
        """Whether the function is there, by this name alone, and has left nothing behind yet."""
        return key not in self._called and len({each.__code__ for each in self._functions.get(key, ())}) == 1

    def _tests(self, module: str, fault: Fault, function: str, kind: list[int], before: str | None) -> list[int]:
        """The tests that may notice a fault, those that will do so soonest first."""
        path = str(file_of(module))
        lines = 0 if fault.edit is None else sum(1 << line for line in fault.edit.lines)
        found = [
            number
            for number in kind
            if (fault.edit is None or self._reached[number].get(path, 0) & lines)
            and self._asks(module, self._items[number].nodeid.partition("::")[0])
        ]
        last = self._noticed.get(function, [])[:5]

        def rank(number: int) -> tuple[bool, int, float]:
            known = last.index(number) if number in last else len(last)
            return self._items[number].nodeid != before, known, self._took_s[number]

        return sorted(found, key=rank)

    def _notice(
        self, module: str, fault: Fault, planted: dict[Key, CodeType], tests: Sequence[int], *, explores: bool
    ) -> int | str:
        """In a fork: plant the fault, and run tests until one notices it."""
        _say_nothing()
        for key, code in planted.items():
            for function in self._functions[key]:
                function.__code__ = code
        if fault.entry is not None:
            plant(module, *fault.entry)
        for number, following in zip_longest(tests, tests[1:]):
            run.limit(2.0 + 10.0 * self._took_s[number])
            if not self._run(number, following):
                return number
        run.limit(run.TIMEOUT_S)
        return EXPLORATION if explores and self._explores(module) else SURVIVED


class _Lines:
    """The lines of some files that are reached meanwhile, as bits, by file."""

    def __init__(self, files: set[str]) -> None:
        self._files = files
        self._calls: dict[CodeType, int] = {}
        self.reached: dict[str, int] = {}

    def __enter__(self) -> _Lines:
        threading.settrace(self._on_call)
        sys.settrace(self._on_call)
        return self

    def __exit__(self, *_error: object) -> None:
        sys.settrace(None)
        threading.settrace(None)  # type: ignore[arg-type]

    def _on_call(self, frame: FrameType, _event: str, _arg: object) -> Any:
        code = frame.f_code
        if code.co_filename not in self._files:
            return None
        calls = self._calls[code] = self._calls.get(code, 0) + 1
        if calls > _FOLLOWED:
            if calls == _FOLLOWED + 1:
                for _start, _end, line in code.co_lines():
                    self._reach(code.co_filename, line or 0)
            return None
        self._reach(code.co_filename, frame.f_lineno)
        return self._on_line

    def _on_line(self, frame: FrameType, event: str, _arg: object) -> Any:
        if event == "line":
            self._reach(frame.f_code.co_filename, frame.f_lineno)
        return self._on_line

    def _reach(self, path: str, line: int) -> None:
        self.reached[path] = self.reached.get(path, 0) | 1 << line


def _changed(before: CodeType, after: CodeType, found: dict[Key, CodeType]) -> bool:
    """Find the functions of a module that differ; False if the module, or a class, differs itself."""
    if before == after:
        return True
    if before.co_flags & CO_NEWLOCALS:  # a function; what is made inside of it is made anew when it is called
        found[_key(before)] = after
        return True
    plain = [[repr(each) for each in code.co_consts if not isinstance(each, CodeType)] for code in (before, after)]
    inner = [[each for each in code.co_consts if isinstance(each, CodeType)] for code in (before, after)]
    if before.co_code != after.co_code or before.co_names != after.co_names or plain[0] != plain[1]:
        return False
    return len(inner[0]) == len(inner[1]) and all(_changed(*pair, found) for pair in zip(*inner, strict=True))


def _say_nothing() -> None:
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, 1)
    os.dup2(sink, 2)
