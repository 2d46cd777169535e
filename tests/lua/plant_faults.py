# SPDX-License-Identifier: GPL-3.0-or-later

"""Tests the guard's tests: python -m tests.lua.plant_faults [--share 1/2] [part of a name] ...

Small faults are planted in a copy of the shipped script, one at a time, and tests/lua is run against each copy: a
comparison turned around or moved by its edge, a condition that is always or never true, `and` for `or`, plus for minus,
a `not` dropped, a switch turned, a number one more or doubled, a mask of 32 bits dropped, a statement left out; in
every function and in the tables of modes, reasons, times and transitions. Every fault must be noticed. One that is not
is a survivor: those that are no faults are listed in `plant_faults_survivors` with the reason, any other ends this with
exit code 1, and so does one that is listed and is noticed. Texts are not changed, and luacheck is not asked: what flies
wrongly has to be seen to fly wrongly. Takes more than half an hour of one core; `--share 1/2` and `--share 2/2` share
the faults between two.

A fault is named by function, operator and source line, so that its name survives an edit elsewhere in the file.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from tests.lua.plant_faults_survivors import KNOWN_SURVIVORS

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / "ardupilot_lua" / "handover_guard.lua"
TESTS = ROOT / "tests" / "lua"
#: the likeliest to notice first; the random flights of test_guard_budget see nothing that the others do not
FILES = (
    "test_guard_enforcement",
    "test_guard_flight",
    "test_guard_pilot",
    "test_guard_wings",
    "test_guard_channels",
    "test_guard_vehicles",
    "test_guard_rows",
    "test_guard_firmware",
    "test_guard_lease",
    "test_guard_nonce",
    "test_guard_alone",
    "test_guard_arming",
    "test_guard_standing",
    "test_guard_tag",
    "test_guard_files",
    "test_guard_product",
)
#: whose tests are asked first about the functions of these names
LIKELY = {
    "test_guard_tag": ("key", "half_siphash"),
    "test_guard_nonce": ("this_guard",),
    "test_guard_lease": ("lease", "x25", "crc_fits", "read_lease", "read_frame", "refuse", "serial_ahead", "elapsed"),
    "test_guard_pilot": (
        "attribute_mode",
        "may_be_pilots",
        "undone_text",
        "read_command",
        "run_aux_function",
    ),
    "test_guard_rows": ("VEHICLES",),
    "test_guard_wings": ("is_hovering", "is_climbing_out", "follow_sequence"),
    "test_guard_arming": ("arming_objection", "permit_arming"),
    "test_guard_standing": (
        "rx",
        "gcs_id",
        "status",
        "say",
        "every_second",
        "housekeeping",
        "announce_commander",
        "WORK",
    ),
}
#: of processor time: no more than so many times what the tests take without a fault, for a fault that loops for ever
PATIENCE = 3
#: faults between two words of progress
EVERY = 50
#: asked only when all the others have noticed nothing
SLOW = re.compile(
    "Budget|Resources|every_mode_every_reason|wraps_at_16|station_gets_nowhere|while_authority_is_there|ten_minutes|shorter_of_both_limits"
)
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


def faults(source: str) -> Iterator[tuple[str, str]]:
    """Name and source of every copy of the script with one fault in it."""
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
            yield name, "\n".join([*lines[:number], changed, *lines[number + 1 :]]) + "\n"


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


class Tests:
    """A plug-in of pytest: the tests are collected once, and run once for each fault, in a process of its own."""

    def __init__(self, work: Callable[[Tests], None]) -> None:
        self._work = work
        self._items: list[pytest.Item] = []
        #: how long the tests may take (s of processor time); 0: as long as they like
        self._limit_s = 0.0

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        assert not session.testsfailed, "the tests cannot be collected"
        self._items = [item for item in session.items if "test_no_global_is_written" not in item.name]
        self._work(self)
        return True

    def hold(self) -> bool:
        """Whether all of them pass with the script as it comes; the time that takes is the measure for the faults."""
        failed, took_s = self._fail(self._items)
        self._limit_s = PATIENCE * took_s
        return not failed

    def notice(self, function: str) -> bool:
        """Whether one of them fails with the script as it is now, whose fault is in `function`."""
        first = [name for name, functions in LIKELY.items() if function.split(".", maxsplit=1)[0] in functions]
        order = [*first, *FILES]

        def rank(item: pytest.Item) -> tuple[bool, int]:
            return SLOW.search(item.nodeid) is not None, order.index(item.path.stem)

        return self._fail(sorted(self._items, key=rank))[0]

    def _fail(self, items: Sequence[pytest.Item]) -> tuple[bool, float]:
        """Whether one fails, and the time it took (s), in a process of its own: it may never end."""
        child = os.fork()
        if child == 0:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 1)
            os.dup2(nowhere, 2)
            signal.setitimer(signal.ITIMER_PROF, self._limit_s)
            for item, following in zip(items, [*items[1:], None], strict=True):
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
                if item.session.testsfailed:
                    os._exit(1)
            os._exit(0)
        _, status, used = os.wait4(child, 0)
        return status != 0, used.ru_utime + used.ru_stime


def chosen_faults(source: str, arguments: Sequence[str]) -> tuple[dict[str, str], set[str]]:
    """The faults to plant, and the names in the list of survivors that none of all faults has."""
    options = argparse.ArgumentParser(prog="plant_faults", description=__doc__)
    options.add_argument("--share", default="1/1", metavar="N/OF", help="every OF-th fault, from the N-th on")
    options.add_argument("parts", nargs="*", metavar="PART", help="only faults with one of these in their name")
    chosen = options.parse_args(arguments)
    share = re.fullmatch(r"([1-9]\d*)/([1-9]\d*)", chosen.share)
    if share is None or int(share[1]) > int(share[2]):
        options.error(f"--share {chosen.share}: 1/2 is the first of two")
    everything = dict(faults(source))
    wanted = [name for name in everything if not chosen.parts or any(part in name for part in chosen.parts)]
    mine = wanted[int(share[1]) - 1 :: int(share[2])]
    return {name: everything[name] for name in mine}, set(KNOWN_SURVIVORS) - set(everything)


def main(arguments: Sequence[str]) -> int:
    """Plant the faults that the arguments choose.

    Returns 1 if one survives that is not known, or a known one does not.
    """
    source = SCRIPT.read_text(encoding="utf-8")
    mine, gone = chosen_faults(source, arguments)
    known = set(KNOWN_SURVIVORS) & set(mine)
    alive: list[str] = []
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / "scripts" / SCRIPT.name
        script.parent.mkdir()
        for extra in ("handover_guard.md", "handover.parm", "handover_plane.parm", ".luacheckrc"):
            (script.parent / extra).write_bytes((SCRIPT.parent / extra).read_bytes())
        script.write_text(source, encoding="utf-8")
        sound: list[bool] = []

        def work(tests: Tests) -> None:
            sound.append(tests.hold())
            for number, (name, faulty) in enumerate(mine.items() if sound[0] else ()):
                if number and number % EVERY == 0:
                    print(f"  {number} of {len(mine)} faults, {time.monotonic() - begun:.0f} s", flush=True)
                script.write_text(faulty, encoding="utf-8")
                if tests.notice(name.partition(":")[0]):
                    continue
                alive.append(name)
                if name not in known:
                    print(f"  survived: {name}", flush=True)

        os.environ["PLANTED_GUARD"] = str(script)
        options = ["-q", "-s", "--no-header", "--tb=no", "--assert=plain", "-p", "no:cacheprovider", "-p", "no:xdist"]
        options += ["--rootdir", str(ROOT), "-o", "addopts=", "--hypothesis-seed=0", "--no-summary"]
        options += ["-o", "timeout=0"]  # of the wall clock: on a busy computer it would count as noticed
        options += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]
        pytest.main([*options, *(str(TESTS / f"{name}.py") for name in FILES)], plugins=[Tests(work)])
        if sound != [True]:
            print("the tests fail without any fault, or cannot be collected")
            return 2
    total = len(mine)
    stale = sorted(gone | (known - set(alive)))
    for name in stale:
        print(f"  listed, but noticed or no fault any more: {name}")
    unknown = [name for name in alive if name not in known]
    print(
        f"{total} faults, {total - len(alive)} noticed, {len(alive) - len(unknown)} known survivors, {len(unknown)} "
        f"unknown, {time.monotonic() - begun:.0f} s"
    )
    return 1 if unknown or stale or not total else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
