# SPDX-License-Identifier: GPL-3.0-or-later

"""Tests the tests of the rules of authority, vehicle's and station's: `make mutants`, after those of the gate, or

    python tests/mutation/core.py [--part I/N] [--sample N] [--only TEXT] [--new] [--left] [--first | --fast]
                                  [--record FILE] [MODULE ...]              (default: all modules, every fault)

Each fault (`faults.py`), in the code or in a transition table, must be noticed by `tests/core`, or by a small
exploration (`tests/model`); one of a station (`station.MODULE`) by `tests/gcs`, by both sides together, or by that
exploration. A fault that none of them notices is a survivor. `core_survivors.py` lists the survivors that are no
faults, with the reason. The exit code is 1 if

* another fault survives,
* a listed one does not survive any more, or no fault has its name,
* a module of the core has no tests that are named for it here.

The faults that are not listed are planted one at a time. The listed ones are planted many at once, at most one in a
statement: if no test notices any of them, each of them survives. Else the faults that a test notices are looked for by
this test, and the others are planted again.

`--part 1/4` takes every fourth fault, `--sample 100` a random hundred of each module, `--only TEXT` those with TEXT in
their names, `--new` those that are not listed, `--left` those that no test noticed by the record. `--first` asks only
tests named for a module below, `--fast` only the tests without the mark `slow`: a fault that they let through has still
to be tried with the others. Then nothing is said of listed faults. `--record FILE` is a file with the test that noticed
each fault; beside it, with the ending `.lines`, one with the lines that each test reaches. Both are read and written,
and make the next run fast. `stories.py` looks for a story in which a fault shows.

No source file is written: `server.py` plants the faults in memory, in a process for each.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import io
import json
import os
import random
import resource
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from tests.mutation import run  # noqa: E402
from tests.mutation.core_survivors import KNOWN_SURVIVORS  # noqa: E402
from tests.mutation.faults import STATION, Fault, faults, file_of, plant, source_of, table_faults  # noqa: E402
from tests.mutation.run import _Mutated, import_once, in_child  # noqa: E402
from tests.mutation.server import ELSEWHERE, EXPLORATION, FOLDERS, SURVIVED, Server, Stage  # noqa: E402

__all__ = ["main", "misnamed", "out_of_date", "stage_of"]

#: module -> the tests that notice its faults soonest, those of the module alone first
FIRST = {
    "authority.transfer": (
        "test_transfer.py",
        "test_arbiter_transfer.py",
        "test_standard_stations.py",
        "test_forced.py",
    ),
    "arbiter": (
        "test_arbiter_view.py",
        "test_arbiter_start.py",
        "test_rehearsal.py",
        "test_control.py",
        "test_arbiter_authority.py",
        "test_arbiter_safety.py",
        "test_restart.py",
        "test_arbiter_transfer.py",
        "test_deaf_commander.py",
    ),
    "authority.authority": (
        "test_authority.py",
        "test_arbiter_authority.py",
        "test_restart.py",
        "test_control.py",
        "test_arbiter_transfer.py",
    ),
    "authority.transfer_manager": (
        "test_transfer_manager.py",
        "test_arbiter_transfer.py",
        "test_forced.py",
        "test_standard_stations.py",
        "test_control.py",
    ),
    "authority.candidates": (
        "test_candidates.py",
        "test_ranks.py",
        "test_reasons.py",
        "test_arbiter_transfer.py",
        "test_forced.py",
        "test_control.py",
        "test_link_quality.py",
    ),
    "feeds": ("test_feeds.py",),
    "remote_id": ("test_remote_id.py",),
    "authority.contacts": ("test_contacts.py", "test_arbiter_authority.py", "test_presence.py"),
    "authority.requests": ("test_control.py", "test_standard_stations.py", "test_forced.py"),
    "authority.start": ("test_start.py", "test_arbiter_start.py", "test_control.py", "test_arbiter_safety.py"),
    "common.flight": ("test_flight.py", "test_arbiter_start.py", "test_arbiter_safety.py", "test_arbiter_authority.py"),
    "authority.hearing": ("test_hearing_share.py", "test_hearing.py", "test_deaf_commander.py"),
    "authority.links": (
        "test_links.py",
        "test_link_quality.py",
    ),
    "authority.zones": ("test_zones.py", "test_arbiter_safety.py"),
    "authority.phases": ("test_phases.py",),
    "authority.rehearsal": ("test_rehearsal.py",),
    "common.authority_facts": ("test_defaults.py", "test_coverage.py"),
    "common.causes": ("safety/test_causes.py", "safety/test_strategy.py", "safety/test_emergency.py"),
    "safety.strategy": ("safety/test_strategy.py", "safety/test_emergency.py", "test_arbiter_safety.py"),
    "safety.emergency": (
        "safety/test_emergency.py",
        "test_arbiter_safety.py",
        "test_restart.py",
        "safety/test_held_restart.py",
    ),
    "safety.conditions": (
        "safety/test_conditions_alone.py",
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
        "test_coverage.py",
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
        "safety/test_hold_timer.py",
        "safety/test_held_restart.py",
        "safety/test_conditions.py",
        "safety/test_decision_executor.py",
    ),
    "safety.decision_facts": (
        "safety/test_hold_timer.py",
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
        "safety/test_safety.py",
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
        "safety/test_unshown_order.py",
        "safety/test_retransmission.py",
        "safety/test_decision_executor.py",
        "safety/test_wings.py",
    ),
    "safety.decision_executor": (
        "safety/test_executor_alone.py",
        "safety/test_safety.py",
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
    "safety.explain": ("safety/test_explain_tables.py", "../cli/test_explain.py"),
    "safety.route": ("safety/test_route.py",),
    "safety.energy": (
        "safety/test_energy.py",
        "safety/test_energy_wings.py",
        "safety/test_energy_prior.py",
        "safety/test_learning.py",
    ),
    "safety.energy_prior": ("safety/test_energy_prior.py", "safety/test_energy.py"),
    "safety.battery": ("safety/test_battery_pack.py", "safety/test_battery.py"),
    "safety.learning": ("safety/test_learning_samples.py", "safety/test_learning.py"),
    "authority.steps": ("test_steps.py",),
    "authority.control": ("test_control.py",),
    "authority.delegation": ("test_delegation.py",),
    "authority.payload": ("test_payload.py",),
    "authority.consent_lines": (
        "test_consent_lines.py",
        "test_standing_consent.py",
    ),
    "authority.cures": ("test_candidates.py", "test_standing_consent.py", "test_standard_stations.py"),
    "authority.presence": ("test_presence.py", "test_arbiter_authority.py", "test_deaf_commander.py"),
    "authority.results": ("test_results.py", "test_arbiter_transfer.py", "test_arbiter_deadline.py"),
    "common.messages": ("test_defaults.py", "test_messages.py", "test_two_sides.py"),
    "common.limits": (
        "test_defaults.py",
        "test_arbiter_transfer.py",
        "test_arbiter_safety.py",
        "test_link_quality.py",
        "test_arbiter_start.py",
    ),
    "common.events": ("test_defaults.py", "test_arbiter_transfer.py", "test_control.py"),
    "common.model": (
        "test_model.py",
        "test_defaults.py",
        "test_arbiter_transfer.py",
        "test_presence.py",
        "test_standard_stations.py",
        "test_arbiter_safety.py",
        "test_control.py",
        "test_restart.py",
    ),
    "common.handling": ("test_defaults.py", "safety/test_wings.py", "safety/test_command_verification.py"),
    "common.snapshot": (
        "test_defaults.py",
        "test_restart.py",
    ),
    "authority.foresight": ("test_borders_ahead.py", "test_foresight.py"),
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


def _modules() -> list[str]:
    core = ROOT / "mavproxy_handover" / "core"
    modules = sorted(".".join(path.relative_to(core).with_suffix("").parts) for path in core.rglob("*.py"))
    return modules + [module for module in FIRST if module.startswith(STATION) and file_of(module).exists()]


def _name_of(module: str) -> str:
    """By which name Python imports a module."""
    return ".".join(file_of(module).relative_to(ROOT).with_suffix("").parts)


# ---- whether they are noticed --------------------------------------------------------------------------------------


def unnoticed(module: str, fault: Fault, *, first: bool = False) -> bool:
    """Whether tests and exploration, or only the fast tests that come `first`, find nothing wrong. In a process of its
    own: it spoils the modules."""
    import pytest

    if fault.source is not None:
        sys.meta_path.insert(0, _Mutated(_name_of(module), fault.source, file_of(module)))
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        try:
            importlib.import_module(_name_of(module))
        except Exception:
            return False
        if fault.entry is not None:
            plant(module, *fault.entry)
        station = module.startswith(STATION)
        tests = ROOT / "tests" / ("gcs" if station else "core")
        slow = STATION_LAST if station else LAST
        everything = sorted(path.relative_to(tests).as_posix() for path in tests.rglob("test_*.py"))
        middle = [each for each in everything if each not in (*FIRST[module], *slow, "test_purity.py")]
        last = [each for each in slow if each not in FIRST[module]]
        options = [*run.PYTEST, "--rootdir", str(ROOT), "--timeout=0", *(("-m", "not slow") if first else ())]
        # most faults die in the first files, and to read the others takes longer than that
        soonest = [FIRST[module][:1], FIRST[module][1:]]
        for files in soonest if first else (*soonest, middle, last):
            paths = [str(tests / each) for each in files]
            if paths and int(pytest.main([*options, *paths], plugins=[_EachInTime()])) != 0:
                return False
        if first:
            return True
        run.limit(run.TIMEOUT_S)  # the tests have had the clock for their own limits
        return not explored(module) or not _found_by_exploring()


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


def stage_of(module: str, file: str) -> Stage | None:
    """When the fast tests in this file, named from the root, are asked for a module's faults; None: never."""
    folder, slow = ("tests/gcs", STATION_LAST) if module.startswith(STATION) else ("tests/core", ())
    named = [os.path.normpath(f"{folder}/{each}") for each in FIRST[module]]
    if file in named:
        return Stage.OWN if file == named[0] else Stage.FIRST
    also = [os.path.normpath(f"{folder}/{each}") for each in slow]
    return Stage.FAST if file in also or (file.startswith(f"{folder}/") and "test_purity" not in file) else None


def explored(module: str) -> bool:
    """Whether a module has a part in what is explored."""
    return not module.startswith(STATION) or module in EXPLORED_STATION


def of_module(
    module: str,
    chosen: list[tuple[int, Fault]],
    server: Server,
    noticed: dict[str, str],
    stage: Stage,
    keep: Callable[[], None],
) -> list[tuple[int, Fault]]:
    """Plant these faults of a module; returns the survivors of the stage's tests.

    `noticed`: by which test each was noticed last. `keep` writes it into its file.
    """
    alive, elsewhere = [], 0
    for place, (number, fault) in enumerate(chosen, 1):
        by = server.ask(module, number, stage, before=noticed.get(fault.name))
        if by == ELSEWHERE:
            if not elsewhere:
                without = in_child(lambda: importlib.import_module(_name_of(module)).__name__)
                assert without == _name_of(module), f"{module}: not imported without any fault: {without}"
            elsewhere += 1
            first = stage is Stage.OWN
            # such a process asks the named tests at once, and all others at the end
            survived = (
                stage in (Stage.FIRST, Stage.FAST)
                or in_child(lambda fault=fault, first=first: unnoticed(module, fault, first=first)) is True  # type: ignore[misc]
            )
            by = SURVIVED if survived else "a process that imports it"
        noticed[fault.name] = by
        if by == SURVIVED:
            alive.append((number, fault))
            print(f"  survived the {stage.name.lower()} tests: {module}: {fault.name}", flush=True)
        if place % 50 == 0:
            print(f"  {module}: {place} of {len(chosen)}, {len(alive)} survived, {elsewhere} elsewhere", flush=True)
            keep()
    keep()
    return alive


# ---- the listed ones, many at once ---------------------------------------------------------------------------------

Listed = tuple[str, Fault]
#: takes faults that are planted together, and the tests to ask (None: all, and the exploration); returns those that
#: notice something
Noticing = Callable[[list[Listed], list[str] | None], list[str]]
#: in the place of a test: what took too long, or broke the process
_BROKEN = "the process broke"


def rounds(listed: list[Listed]) -> list[list[Listed]]:
    """The faults in groups, in which no two are in the same statement of a module, or in the same table."""
    found: list[list[Listed]] = []
    seen: Counter[tuple[str, str | int]] = Counter()
    for module, fault in listed:
        place = module, fault.edit.lines.start if fault.edit is not None else fault.name.partition(":")[0]
        if seen[place] == len(found):
            found.append([])
        found[seen[place]].append((module, fault))
        seen[place] += 1
    return found


def stale_of(group: list[Listed], noticing: Noticing) -> tuple[list[Listed], list[Listed]]:
    """Of faults that are planted together: those that are noticed alone; and those that are noticed only together with
    others of the group, so that they have to be planted in another round."""
    stale: list[Listed] = []
    apart: list[Listed] = []
    rest = group
    tests = noticing(rest, None)
    while tests:
        together = smallest(rest, lambda some, test=tests[0]: bool(noticing(some, [test])))  # type: ignore[misc]
        (stale if len(together) == 1 else apart).append(together[0])
        rest = [row for row in rest if row is not together[0]]
        tests = noticing(rest, tests) if rest else []
    return stale, apart


def smallest(group: list[Listed], noticed: Callable[[list[Listed]], bool]) -> list[Listed]:
    """A part of a group that is noticed, without one that is not needed for that. The whole group is noticed."""
    needed: list[Listed] = []
    while group and not (needed and noticed(needed)):
        low, high = 0, len(group)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if noticed([*group[:middle], *needed]) else (middle, high)
        needed.append(group[high - 1])
        group = group[: high - 1]
    return needed


def noticed_by(listed: list[Listed], only: list[str] | None) -> list[str]:
    """`Noticing`, in a process of its own."""
    found = in_child(lambda: _noticed_by(listed, None if only == [_BROKEN] else only))
    return found if isinstance(found, list) else [_BROKEN]


def _noticed_by(listed: list[Listed], only: list[str] | None) -> list[str]:
    """It spoils the modules."""
    import pytest

    trees: dict[str, list[Fault]] = {}
    for module, fault in listed:
        trees.setdefault(module, []).append(fault)
    for module, planted in trees.items():
        edits = [fault.edit for fault in planted if fault.edit is not None]
        for edit in edits:
            edit.apply()
        if edits:
            source = ast.unparse(ast.fix_missing_locations(edits[0].tree))
            sys.meta_path.insert(0, _Mutated(_name_of(module), source, file_of(module)))
    failed = _Failed()
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        for module, fault in listed:
            if fault.entry is not None:
                importlib.import_module(_name_of(module))
                plant(module, *fault.entry)
        options = [*(each for each in run.PYTEST if each != "-x"), "--rootdir", str(ROOT), "--timeout=0"]
        tests = FOLDERS if only is None else [each for each in only if each != EXPLORATION]
        if tests:
            pytest.main(
                [*options, *(str(ROOT / each) for each in tests)], plugins=[_EachInTime(), _NotForThese(), failed]
            )
        run.limit(run.TIMEOUT_S)
        if (only is None or EXPLORATION in only) and _found_by_exploring():
            failed.names.append(EXPLORATION)
    return failed.names


class _Failed:
    """Notes the tests that fail, and the files that cannot be imported."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed and report.nodeid not in self.names:
            self.names.append(report.nodeid)

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed:
            self.names.append(report.nodeid)


class _NotForThese:
    """Leaves out what reads the source files, where nothing is planted."""

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        items[:] = [item for item in items if "test_purity.py" not in item.nodeid]


def misnamed() -> list[str]:
    """Modules of the core that no test here is named for, and names that no module has."""
    modules = _modules()
    wrong = [
        f"no tests are named for {module}"
        for module in modules
        if module not in FIRST and any(faults(source_of(module)))
    ]
    return wrong + [f"there is no module {module}" for module in {**FIRST, **KNOWN_SURVIVORS} if module not in modules]


def out_of_date() -> list[str]:
    """What is said here of the core and does not hold any more."""
    wrong, modules = misnamed(), _modules()
    for module, known in KNOWN_SURVIVORS.items():
        if module in modules:
            there = {fault.name for fault in (*faults(source_of(module)), *table_faults(module))}
            wrong += [f"listed, but there is no such fault: {module}: {name}" for name in known if name not in there]
    return wrong


def main(arguments: list[str] | None = None) -> int:
    """Plant the faults asked for; 1 if a survivor is not known, or a known one died."""
    parser = argparse.ArgumentParser(description="faults planted in the rules of authority")
    parser.add_argument("modules", nargs="*", metavar="MODULE", help=", ".join(FIRST))
    parser.add_argument("--part", default="1/1", metavar="I/N", help="every Nth fault, beginning with the Ith")
    parser.add_argument("--sample", type=int, metavar="N", help="N faults of each module, by chance")
    parser.add_argument("--only", metavar="TEXT", default="", help="those whose names have it in them")
    parser.add_argument("--new", action="store_true", help="leave out the survivors that are listed")
    parser.add_argument("--left", action="store_true", help="leave out those that a test noticed, by the record")
    stages = parser.add_mutually_exclusive_group()
    stages.add_argument("--first", action="store_true", help="ask only the fast tests that are named for a module")
    stages.add_argument(
        "--fast", action="store_true", help="ask only the fast tests: neither slow ones nor exploration"
    )
    parser.add_argument("--record", type=Path, metavar="FILE", help="which test noticed which fault: read and written")
    parser.add_argument("--list", action="store_true", help="print the faults instead")
    options = parser.parse_args(arguments)
    part, parts = (int(each) for each in options.part.split("/"))

    record: dict[str, dict[str, str]] = {}
    if options.record is not None and options.record.exists():
        record = json.loads(options.record.read_text(encoding="utf-8"))
    last = Stage.FIRST if options.first else Stage.FAST if options.fast else Stage.SLOW
    leaves_out = options.new or last is not Stage.SLOW

    def choose(module: str, all_of_them: list[Fault]) -> list[tuple[int, Fault]]:
        left_out = {*KNOWN_SURVIVORS.get(module, {})} if leaves_out else set()
        if options.left:
            left_out.update(name for name, by in record.get(module, {}).items() if by != SURVIVED)
        numbered = [*enumerate(all_of_them)][part - 1 :: parts]
        chosen = [row for row in numbered if options.only in row[1].name and row[1].name not in left_out]
        if options.sample is not None and options.sample < len(chosen):
            chosen = random.Random(0).sample(chosen, options.sample)
        return chosen

    unknown = [module for module in options.modules if module not in FIRST]
    if unknown:
        parser.error(f"unknown {', '.join(unknown)}; known are {', '.join(FIRST)}")
    import_once()
    run.TIMEOUT_S = 200
    not_there = out_of_date()
    for what in not_there:
        print(f"  {what}", flush=True)
    wrong = len(not_there)
    chosen = {
        module: choose(module, [*faults(source_of(module)), *table_faults(module)])
        for module in options.modules or FIRST
    }
    if options.list:
        for module, rows in chosen.items():
            for _number, fault in rows:
                print(f"{module}: {fault.name}")
        return 1 if wrong else 0
    listed = [
        (module, fault)
        for module, rows in chosen.items()
        for _number, fault in rows
        if fault.name in KNOWN_SURVIVORS.get(module, {})
    ]
    left = {
        module: [row for row in rows if row[1].name not in KNOWN_SURVIVORS.get(module, {})]
        for module, rows in chosen.items()
    }
    server = Server(
        FOLDERS,
        [str(file_of(module)) for module in _modules()],
        stage_of,
        lambda module: explored(module) and _found_by_exploring(),
        None if options.record is None else options.record.with_suffix(".lines"),
        opening="test_purity.py",
    )

    def keep() -> None:
        if options.record is not None:
            options.record.write_text(json.dumps(record, indent=1), encoding="utf-8")

    for stage in (each for each in Stage if each <= last):
        asked_now, left = left, {}
        for module, rows in asked_now.items():
            begun = time.monotonic()
            left[module] = alive = of_module(module, rows, server, record.setdefault(module, {}), stage, keep)
            print(
                f"{module}, {stage.name.lower()} tests: {len(rows)} faults, {len(rows) - len(alive)} noticed, "
                f"{time.monotonic() - begun:.0f} s",
                flush=True,
            )
    server.close()
    stale: list[Listed] = []
    waiting = rounds(listed)
    while waiting:
        begun, group = time.monotonic(), waiting.pop(0)
        found, apart = stale_of(group, noticed_by)
        for module, fault in found:
            print(f"  listed, but noticed: {module}: {fault.name}", flush=True)
        stale += found
        waiting += [apart] if apart else []
        print(
            f"listed, {len(group)} together: {len(found)} noticed, {len(apart)} to be tried apart, "
            f"{time.monotonic() - begun:.0f} s",
            flush=True,
        )
    for module, rows in chosen.items():
        total, known = len(rows), sum(each == module for each, _fault in listed)
        known -= sum(each == module for each, _fault in stale)
        unknown_here = len(left[module])
        print(
            f"{module}: {total} faults, {total - known - unknown_here} noticed, {known} known survivors, "
            f"{unknown_here} unknown",
            flush=True,
        )
    total, alive_now = sum(map(len, chosen.values())), sum(map(len, left.values()))
    known = len(listed) - len(stale)
    spent = sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    print(
        f"all: {total} faults, {total - known - alive_now} noticed, {known} known survivors, {alive_now} unknown, "
        f"{spent:.0f} s of processor time",
        flush=True,
    )
    return 1 if wrong or stale or alive_now else 0


if __name__ == "__main__":
    sys.exit(main())
