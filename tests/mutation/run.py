# SPDX-License-Identifier: GPL-3.0-or-later

"""Tests the gate's tests: `make mutants`, or

    python tests/mutation/run.py [--lines FILE] [tables] [judge] [policy.rows] ...        (default: all of them)

Each fault (`tables.py`, `faults.py`) must be noticed by the tests that are named for its module. One that is not is a
survivor; survivors that are no faults are listed in `survivors.py` with the reason, and any other ends this with exit
code 1. So does one that is listed and does not survive any more, or is in the code no more.

No source file is written: `server.py` plants the faults in memory, in a process for each. `--lines FILE` is a file with
the lines that each test reaches: it is read and written, and makes the next run fast.
"""

from __future__ import annotations

import argparse
import gc
import importlib.abc
import importlib.machinery
import importlib.util
import io
import os
import pickle
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from tests.mutation.survivors import KNOWN_SURVIVORS  # noqa: E402

if TYPE_CHECKING:
    from tests.mutation.server import Server, Stage

#: modules of the gate begin with this
GATE = "gate."
TIMEOUT_S = 120
#: Nobody reads why an assert fails, so none is rewritten to tell: that takes longer than most of the tests
PYTEST = (
    *("-x", "-q", "--no-header", "--tb=no", "-p", "no:cacheprovider", "--assert=plain"),
    *("--hypothesis-seed=0", "--hypothesis-profile=mutants"),
)
#: Module -> tests that are to notice its faults.
TESTED = {
    "gate": (
        "test_gate.py",
        "test_filters.py",
        "test_downlink.py",
        "test_questions.py",
        "test_stale_streams.py",
        "test_log_download.py",
    ),
    "filters": (
        "test_filters.py",
        "test_targets.py",
        "test_questions.py",
        "test_stale_streams.py",
        "test_gate.py",
    ),
    "passed": ("test_gate.py", "test_own_reads.py", "test_stale_streams.py", "test_flush.py"),
    "in_force": ("test_gate.py",),
    "replies": ("test_refusal_text.py", "test_observers.py", "test_stale_streams.py", "test_gate.py"),
    "downloads": ("test_log_download.py", "test_gate.py"),
    "log_download": ("test_log_download.py",),
    "own_reads": ("test_own_reads.py",),
    "targets": ("test_targets.py",),
    "naming": ("test_naming.py",),
    "list_changes": ("test_list_changes.py",),
    "mission_server": ("test_mission_server.py",),
    "client_capabilities": ("test_client_capabilities.py", "test_refusal_text.py"),
    "refusal_text": ("test_refusal_text.py",),
    "intent": ("test_intent.py", "test_targets.py"),
    "judge": ("test_judge.py", "test_flight_log.py"),
    "policy.rows": ("test_policy.py",),
    "policy.parameters": ("test_policy.py",),
    "policy.files": ("test_flush.py", "test_list_changes.py", "test_judge.py", "test_every_sender.py"),
    "flush": ("test_flush.py",),
    "observers": ("test_observers.py",),
    "questions": ("test_questions.py",),
    "stale_streams": ("test_stale_streams.py",),
    "feeds": ("test_feeds.py",),
    "operators": ("test_feeds.py",),
    "downlink": ("test_downlink.py",),
    "refusals": ("test_refusals.py",),
    "explain": ("test_explain.py",),
}
PARTS = ("tables", *TESTED)


class _Mutated(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports one module from another source than its file."""

    def __init__(self, name: str, source: str, path: Path) -> None:
        self._name, self._source, self._path = name, source, path

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> Any:
        if name != self._name:
            return None
        return importlib.util.spec_from_loader(name, self, origin=str(self._path))

    def exec_module(self, module: ModuleType) -> None:
        exec(compile(self._source, str(self._path), "exec"), vars(module))


def limit(seconds: float) -> None:
    """End this process after so much of its own time (0: never): an endless loop is noticed, a busy machine is none."""
    signal.setitimer(signal.ITIMER_PROF, seconds)


def in_child(task: Callable[[], Any]) -> Any:
    """The task's result, worked out in a process of its own; None if it took too long."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        limit(TIMEOUT_S)
        try:
            result = task()
        except BaseException as error:
            result = error
        with os.fdopen(writer, "wb") as pipe:
            pickle.dump(result, pipe)
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as pipe:
        data = pipe.read()
    os.waitpid(child, 0)
    return pickle.loads(data) if data else None


def import_once() -> None:
    """What all children need, and no fault is planted in."""
    import _hypothesis_pytestplugin  # noqa: F401
    import hypothesis
    import pytest  # noqa: F401
    import pytest_timeout  # noqa: F401
    import xdist.plugin  # noqa: F401
    from pymavlink.dialects.v20 import handover  # noqa: F401

    # what was found with one fault must not help to find the next: on another machine nobody remembers it
    slow = [hypothesis.HealthCheck.too_slow]  # a busy machine is no fault
    hypothesis.settings.register_profile("mutants", database=None, deadline=None, suppress_health_check=slow)
    hypothesis.settings.load_profile("mutants")
    gc.collect()
    gc.freeze()  # pytest looks through everything for garbage at its end, in every child


def source_file(module: str) -> Path:
    """Where the source of a module of the gate lies."""
    return ROOT.joinpath("mavproxy_handover", "gate", *module.split(".")).with_suffix(".py")


def tests_pass(module: str, source: str, *, slow: bool) -> bool:
    """Whether the tests of a module pass with this source in its place. `slow`: also those with the mark `slow`."""
    import pytest

    sys.meta_path.insert(0, _Mutated(f"mavproxy_handover.gate.{module}", source, source_file(module)))
    files = [str(ROOT / "tests" / "gate" / name) for name in TESTED[module]]
    options = [*PYTEST, "--rootdir", str(ROOT), *(() if slow else ("-m", "not slow"))]
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        return int(pytest.main([*options, *files])) == 0


def stage_of(module: str, file: str) -> Stage | None:
    """When the tests in this file are asked for a module's faults: those that are named for it, and no others."""
    from tests.mutation.server import Stage

    return Stage.FIRST if Path(file).name in TESTED[module.removeprefix(GATE)] else None


def of_module(module: str, server: Server) -> tuple[int, list[str]]:
    """How many faults a module has, and the survivors."""
    from tests.mutation.faults import faults, source_of
    from tests.mutation.server import ELSEWHERE, SURVIVED, Stage

    left = every = [*enumerate(faults(source_of(GATE + module)))]
    for stage in (Stage.FIRST, Stage.SLOW):
        asked, left = left, []
        for number, fault in asked:
            by = server.ask(GATE + module, number, stage)
            if by == ELSEWHERE:
                slow = stage is Stage.SLOW
                passed = in_child(lambda source=fault.source, slow=slow: tests_pass(module, source, slow=slow))
                by = SURVIVED if passed is True else by
            if by == SURVIVED:
                left.append((number, fault))
    alive = [fault.name for _number, fault in left]
    for name in alive:
        print(f"  survived: {module}: {name}", flush=True)
    return len(every), alive


def of_tables() -> tuple[int, list[str]]:
    """The same for the tables."""

    def task() -> tuple[int, list[str]]:
        from tests.mutation.tables import survivors

        return survivors()

    global TIMEOUT_S  # noqa: PLW0603
    TIMEOUT_S *= 10  # all of them in one process
    result = in_child(task)
    TIMEOUT_S //= 10
    if isinstance(result, BaseException):
        raise result
    assert result is not None, "the tables took too long"
    total, alive = result
    for name in alive:
        print(f"  survived: tables: {name}", flush=True)
    return total, alive


def main(arguments: list[str] | None = None) -> int:
    """Plant the faults of the parts asked for; 1 if a survivor is not known, or a known one is noticed."""
    parser = argparse.ArgumentParser(description="faults planted in the gate")
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--lines", type=Path, metavar="FILE", help="which lines each test reaches: read and written")
    options = parser.parse_args(arguments)
    unknown = [part for part in options.parts if part not in PARTS]
    if unknown:
        parser.error(f"unknown {', '.join(unknown)}; known are {', '.join(PARTS)}")
    import_once()
    from tests.mutation.faults import file_of
    from tests.mutation.server import Server

    server = Server(
        ("tests/gate",),
        [str(file_of(GATE + module)) for module in TESTED],
        stage_of,
        lambda _module: False,
        options.lines,
        opening="test_every_mission_type_of_the_dialect_is_classified",
    )
    wrong = 0
    for part in options.parts or PARTS:
        begun = time.monotonic()
        total, alive = of_tables() if part == "tables" else of_module(part, server)
        known = KNOWN_SURVIVORS.get(part, {})
        surprising = [name for name in alive if name not in known]
        stale = [name for name in known if name not in alive]
        for name in stale:
            print(f"  listed, but killed: {part}: {name}")
        wrong += len(surprising) + len(stale)
        spent_s = time.monotonic() - begun
        print(
            f"{part}: {total} mutants, {total - len(alive)} killed, {len(alive) - len(surprising)} known survivors, "
            f"{len(surprising)} unknown, {spent_s:.0f} s",
            flush=True,
        )
    server.close()
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
