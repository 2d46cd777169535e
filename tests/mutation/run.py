# SPDX-License-Identifier: GPL-3.0-or-later

"""Tests the gate's tests: `make mutants`, or

    python tests/mutation/run.py [tables] [judge] [policy.rows] ...        (default: all of them)

Each fault (`tables`, `mutants`) must be noticed by the tests of `tests/gate`. One that is not is a survivor; survivors
that are no faults are listed in `survivors.py` with the reason, and any other ends this with exit code 1. So does one
that is listed and does not survive any more.
"""

from __future__ import annotations

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
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from tests.mutation.mutants import mutants  # noqa: E402
from tests.mutation.survivors import KNOWN_SURVIVORS  # noqa: E402

TIMEOUT_S = 120
#: nobody reads why an assert fails, so none is rewritten to tell: that takes longer than most of the tests
PYTEST = (
    *("-x", "-q", "--no-header", "--tb=no", "-p", "no:cacheprovider", "--assert=plain"),
    *("--hypothesis-seed=0", "--hypothesis-profile=mutants"),
)
#: Module -> tests that are to notice its faults.
TESTED = {
    "gate": ("test_gate.py", "test_filters.py", "test_downlink.py", "test_questions.py", "test_stale_streams.py"),
    "filters": (
        "test_filters.py",
        "test_targets.py",
        "test_questions.py",
        "test_stale_streams.py",
        "test_list_file.py",
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
    "list_file": ("test_list_file.py",),
    "mission_server": ("test_mission_server.py",),
    "client_capabilities": ("test_client_capabilities.py", "test_refusal_text.py"),
    "refusal_text": ("test_refusal_text.py",),
    "intent": ("test_intent.py", "test_targets.py", "test_judge.py"),
    "judge": ("test_judge.py", "test_flight_log.py"),
    "policy.rows": ("test_judge.py", "test_policy.py"),
    "policy.parameters": ("test_judge.py", "test_policy.py"),
    "policy.files": ("test_judge.py", "test_flush.py"),
    "flush": ("test_flush.py",),
    "observers": ("test_observers.py",),
    "questions": ("test_questions.py",),
    "stale_streams": ("test_stale_streams.py",),
    "downlink": ("test_downlink.py",),
    "refusals": ("test_refusals.py",),
    "explain": ("test_explain.py",),
}


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


def tests_pass(module: str, source: str | None) -> bool:
    """Whether the tests of a module pass with this source in its place."""
    import pytest

    if source is not None:
        sys.meta_path.insert(0, _Mutated(f"mavproxy_handover.gate.{module}", source, source_file(module)))
    files = [str(ROOT / "tests" / "gate" / name) for name in TESTED[module]]
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        return int(pytest.main([*PYTEST, "--rootdir", str(ROOT), *files])) == 0


def of_module(module: str) -> tuple[int, list[str]]:
    """How many mutants a module has, and the survivors."""
    assert in_child(lambda: tests_pass(module, None)) is True, f"the tests of {module} fail without any mutant"
    source = source_file(module).read_text(encoding="utf-8")
    total, alive = 0, []
    for mutant in mutants(source):
        total += 1
        if in_child(lambda mutated=mutant.source: tests_pass(module, mutated)) is True:
            alive.append(mutant.name)
            print(f"  survived: {module}: {mutant.name}", flush=True)
    return total, alive


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


def main(wanted: Sequence[str]) -> int:
    """Run the mutants of the parts asked for; 1 if a survivor is not known, or a known one died."""
    parts = list(wanted) or ["tables", *TESTED]
    unknown = [part for part in parts if part not in ("tables", *TESTED)]
    if unknown:
        print(f"mutants: unknown {', '.join(unknown)}; known are tables, {', '.join(TESTED)}")
        return 2
    import_once()
    wrong = 0
    for part in parts:
        begun = time.monotonic()
        total, alive = of_tables() if part == "tables" else of_module(part)
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
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
