# SPDX-License-Identifier: GPL-3.0-or-later

"""A process that has all tests of the rules, or of the gate, in memory, and plants one fault after the other in forks.

To import the tests takes longer than most faults live. So the tests are collected once, and a fault is planted in a
fork: the functions that differ get the mutant's code. Of each test the lines of the rules that it reaches are recorded
first; a test that does not reach a fault's lines cannot notice it, and is left out. The test that noticed the fault in
an earlier run comes first, then those that noticed other faults of the function, then the others: the more faults a
test notices in a second, the sooner.

The tests are asked in stages (`Stage`), and recorded when they are asked for the first time. What is recorded is kept
in a file, and holds until the test's file, a file that tests share, or the rules change.

What cannot be planted in a running process says so (`ELSEWHERE`): a value or a default that a module begins with, and a
function that has been called while the tests were imported. Such a fault needs a process that imports it.
"""

from __future__ import annotations

import ast
import gc
import hashlib
import os
import pickle
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from enum import IntEnum
from functools import cache
from inspect import CO_NEWLOCALS
from itertools import accumulate, groupby, zip_longest
from math import inf
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from types import CodeType, FrameType, FunctionType
from typing import Any

import pytest

from tests.mutation import run
from tests.mutation.faults import ROOT, Fault, faults, file_of, plant, source_of, table_faults
from tests.mutation.run import in_child

__all__ = ["ELSEWHERE", "EXPLORATION", "FOLDERS", "SURVIVED", "Server", "Stage"]

#: answers besides the name of the test that noticed a fault
SURVIVED, ELSEWHERE, EXPLORATION = "survived", "elsewhere", "exploration"
#: so often a function's lines are followed in one test; a test that calls it more often counts as reaching all of them
_FOLLOWED = 25
#: tests of the core and of the stations, and single ones that `core.FIRST` names besides
FOLDERS = ("tests/core", "tests/gcs", "tests/cli/test_explain.py", "tests/module/test_station_module.py")

#: what tests share besides the files in their folders
_SHARED = ("tests/conftest.py", "tests/model")


class Stage(IntEnum):
    """Which tests are asked; those of the stages before have let the fault through."""

    #: the fast tests in the file that is named first for a module: most of them ask this module alone
    OWN = 0
    #: the fast tests in the files that are named for a module, and others that are recorded by now: the best of them
    FIRST = 1
    #: the tests without the mark `slow`
    FAST = 2
    #: all tests and the exploration
    SLOW = 3


#: so long the tests of a stage may take, with their lines recorded (s): a fault that lives on waits for the next stage
_BUDGETS_S = {Stage.OWN: 10.0, Stage.FIRST: 2.0, Stage.FAST: 20.0, Stage.SLOW: inf}

Stages = Callable[[str, str], Stage | None]
#: of a test: time (s), and the lines that it reaches, as bits, by file
Recorded = tuple[float, dict[str, int]]
#: a function: file, name, first line
Key = tuple[str, str, int]


def _key(code: CodeType) -> Key:
    return code.co_filename, code.co_qualname, code.co_firstlineno


class Server:
    """The process, as the one that asks it sees it."""

    def __init__(
        self,
        folders: Sequence[str],
        files: Sequence[str],
        stages: Stages,
        explores: Callable[[str], bool],
        kept: Path | None = None,
        *,
        opening: str,
    ) -> None:
        """`folders`: of the tests, or single files. `files`: of the modules that faults are planted in. `stages`: when
        the fast tests in a file are asked for a module; None if they need not notice its faults. `explores`: whether
        the exploration finds something wrong. `kept`: a file for what is recorded. `opening`: a test that calls none of
        the modules; it is run before all others, and begins what lasts as long as the session."""
        self._pipe, other = Pipe()
        self._process = os.fork()
        if self._process == 0:
            self._pipe.close()
            status = 1
            try:
                os.dup2(2, 1)
                options = [*run.PYTEST, "-s", "--timeout=0", "--rootdir", str(ROOT)]
                pytest.main(
                    [*options, *(str(ROOT / each) for each in folders)],
                    plugins=[_Served(other, _Book(kept, files, folders), files, stages, explores, opening)],
                )
                status = 0
            finally:
                os._exit(status)
        other.close()

    def ask(self, module: str, number: int, stage: Stage, *, before: str | None = None) -> str:
        """The test of a stage that notices a fault of a module; `before`: the one that noticed it in an earlier run.

        The first question of each stage takes as long as all these tests do, unless they are recorded.
        """
        self._pipe.send((module, number, stage, before))
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

    def __init__(
        self,
        pipe: Connection,
        book: _Book,
        files: Sequence[str],
        stages: Stages,
        explores: Callable[[str], bool],
        opening: str,
    ) -> None:
        self._files, self._stages, self._explores = set(files), stages, explores
        self._pipe, self._book, self._opening = pipe, book, opening
        self._items: list[pytest.Item] = []
        #: functions of the rules that were called while the tests were imported
        self._called: set[Key] = set()
        self._functions: dict[Key, list[FunctionType]] = {}
        #: the tests that have been tried without a fault
        self._tried: dict[int, Recorded] = {}
        self._explored = False
        #: the tests of a module's stage
        self._asked: dict[tuple[str, Stage], list[int]] = {}
        self._faults: dict[str, list[Fault]] = {}
        self._codes: dict[str, CodeType] = {}
        #: tests that noticed faults of a function, the last one first
        self._noticed: dict[str, list[int]] = {}
        #: how many faults each test has noticed, and how many it has let through
        self._hits: Counter[int] = Counter()
        #: the tests that have let a fault through, by module and number
        self._passed: dict[tuple[str, int], set[int]] = {}
        self._misses: Counter[int] = Counter()
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

        self._items = session.items
        # what lasts as long as the session begins here, and not in each fork
        self._run(next(number for number, item in enumerate(self._items) if self._opening in item.nodeid), None)
        sys.settrace(None)
        gc.unfreeze()  # the collected tests are frozen, and those are not told of
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
        """Run a test; whether it passes. `following`: the one that is run after it, None at the end of a process."""
        item = self._items[number]
        failed = item.session.testsfailed
        # the fixtures of the session stay: other processes need them
        nextitem = item.session if following is None else self._items[following]
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=nextitem)
        return item.session.testsfailed == failed

    # ---- what each test reaches -----------------------------------------------------------------------------------

    def _of_stage(self, module: str, stage: Stage) -> list[int]:
        """The tests of a stage, tried without any fault."""
        if (module, stage) not in self._asked:
            self._asked[module, stage] = wanted = [
                number for number, item in enumerate(self._items) if self._stage(module, item) is stage
            ]
            self._try(number for number in wanted if number not in self._tried)
            if stage is Stage.SLOW and not self._explored:
                assert in_child(lambda: self._explores("arbiter")) is False, "without any fault exploring finds one"
                self._explored = True
        return self._asked[module, stage]

    @cache  # noqa: B019
    def _stage(self, module: str, item: pytest.Item) -> Stage | None:
        if item.get_closest_marker("long") is not None:
            return None
        stage = self._stages(module, item.nodeid.partition("::")[0])
        return stage if stage is None or item.get_closest_marker("slow") is None else Stage.SLOW

    def _try(self, wanted: Iterable[int]) -> None:
        """Try tests without any fault, a file at a time."""
        for path, of_file in groupby(wanted, lambda number: self._items[number].path):
            numbers = list(of_file)
            known = self._book.of_file(path)
            new = [number for number in numbers if self._items[number].nodeid not in known]
            if new:
                recorded = in_child(lambda new=new: self._record(new))  # type: ignore[misc]
                assert isinstance(recorded, dict), f"the tests do not run: {recorded}"
                failed = [self._items[number].nodeid for number, row in recorded.items() if row is None]
                assert not failed, f"without any fault these fail: {', '.join(failed)}"
                known.update((self._items[number].nodeid, row) for number, row in recorded.items())
                self._book.keep()
            for number in numbers:
                self._tried[number] = known[self._items[number].nodeid]

    def _record(self, wanted: list[int]) -> dict[int, Recorded | None]:
        """In a fork: what each test takes and reaches; None if it fails."""
        _say_nothing()
        run.limit(0)
        found: dict[int, Recorded | None] = {}
        for number, following in zip_longest(wanted, wanted[1:]):
            begun = time.process_time()
            with _Lines(self._files) as lines:
                passed = self._run(number, following)
            found[number] = (time.process_time() - begun, lines.reached) if passed else None
        return found

    # ---- faults ---------------------------------------------------------------------------------------------------

    def _answer(self, module: str, number: int, stage: Stage, before: str | None) -> str:
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
        passed = self._passed.setdefault((module, number), set())
        tests = self._tests(module, fault, function, stage, before, passed)
        explorations = [before == EXPLORATION, stage is Stage.SLOW and before != EXPLORATION]
        answer = in_child(lambda: self._notice(module, fault, planted, tests, explorations))
        if answer is None:
            return "it takes too long"
        if isinstance(answer, BaseException):
            return f"{type(answer).__name__}: {answer}"
        if isinstance(answer, int):
            row = self._noticed.setdefault(function, [])
            if answer in row:
                row.remove(answer)
            row.insert(0, answer)
            self._hits[answer] += 1
            self._misses.update(tests[: tests.index(answer)])
            return self._items[answer].nodeid
        self._misses.update(tests)
        passed.update(tests)
        return str(answer)

    def _plantable(self, key: Key) -> bool:
        """Whether the function is there, by this name alone, and has left nothing behind yet."""
        return key not in self._called and len({each.__code__ for each in self._functions.get(key, ())}) == 1

    def _tests(
        self, module: str, fault: Fault, function: str, stage: Stage, before: str | None, passed: set[int]
    ) -> list[int]:
        """The tests that may notice a fault, those that will do so soonest first; without those that it has passed."""
        path = str(file_of(module))
        lines = 0 if fault.edit is None else sum(1 << line for line in fault.edit.lines)
        asked = [number for each in Stage if each <= stage for number in self._of_stage(module, each)]
        if stage is Stage.FIRST:
            asked += [number for number in self._tried if self._stage(module, self._items[number]) is Stage.FAST]
        found = [
            number
            for number in asked
            if number not in passed
            if fault.edit is None or self._tried[number][1].get(path, 0) & lines
        ]
        noticing = next((number for number, item in enumerate(self._items) if item.nodeid == before), None)
        if noticing is not None and noticing not in found:
            if noticing not in self._tried:
                self._try([noticing])
            found.append(noticing)
        last = self._noticed.get(function, [])[:5]

        def rank(number: int) -> tuple[bool, int, float]:
            known = last.index(number) if number in last else len(last)
            share = (self._hits[number] + 0.2) / (self._hits[number] + self._misses[number] + 1)
            return number != noticing, known, -share / (self._tried[number][0] + 0.002)

        found.sort(key=rank)
        spent_s = accumulate(self._tried[number][0] for number in found)
        return [
            number
            for number, so_far_s in zip(found, spent_s, strict=True)
            if number == noticing or so_far_s < _BUDGETS_S[stage]
        ]

    def _notice(
        self,
        module: str,
        fault: Fault,
        planted: dict[Key, CodeType],
        tests: Sequence[int],
        explorations: Sequence[bool],
    ) -> int | str:
        """In a fork: plant the fault, and run tests until one notices it. `explorations`: whether to explore before the
        tests, and after them."""
        _say_nothing()
        for key, code in planted.items():
            for function in self._functions[key]:
                function.__code__ = code
        if fault.entry is not None:
            plant(module, *fault.entry)
        for explores, asked in zip(explorations, (tests, ()), strict=True):
            run.limit(run.TIMEOUT_S)
            if explores and self._explores(module):
                return EXPLORATION
            for number, following in zip_longest(asked, asked[1:]):
                run.limit(2.0 + 10.0 * self._tried[number][0])
                if not self._run(number, following):
                    return number
        return SURVIVED


class _Book:
    """What tests were recorded with, kept in a file. It holds for the same rules and the same tests alone."""

    def __init__(self, file: Path | None, files: Iterable[str], folders: Iterable[str] = ()) -> None:
        self._file = file
        shared = [ROOT / each for each in (*_SHARED, *folders)]
        helpers = sorted(each for folder in shared for each in [folder, *folder.rglob("*.py")] if each.is_file())
        rules = [Path(each) for each in files]
        self._common = _digest(*rules, *(each for each in helpers if not each.name.startswith("test_")))
        #: of each file of tests: its digest, and the tests in it by name
        self._rows: dict[str, tuple[str, dict[str, Recorded]]] = {}
        if file is not None and file.exists():
            self._rows = pickle.loads(file.read_bytes())

    def of_file(self, path: Path) -> dict[str, Recorded]:
        """What is known of the tests in a file, to be added to."""
        key, digest = str(path), self._common + _digest(path)
        if self._rows.get(key, ("", {}))[0] != digest:
            self._rows[key] = digest, {}
        return self._rows[key][1]

    def keep(self) -> None:
        """Write the file."""
        if self._file is not None:
            self._file.write_bytes(pickle.dumps(self._rows))


def _digest(*files: Path) -> str:
    found = hashlib.sha256()
    for each in files:
        found.update(each.read_bytes())
    return found.hexdigest()


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
