# SPDX-License-Identifier: GPL-3.0-or-later

"""The table "Flown" of the guard's page: what came of each case on each version, in words and figures.

A test that flies says so in its properties (`FLYING`, then `FLOWN`), which reach the process that reports even where
several fly at once. With `--flown PAGE` the run writes the table: rows in the order of `guard_suite`, one column for
each version, and below it the digests of the scripts and parameters that each was flown with. A run that flies only
some of a version keeps the rest of its column if that was flown with the very same script and parameters, and nothing
of it otherwise; the columns of versions that it does not fly stay, with the digest of theirs.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.sitl.firmware import Firmware

BEGIN, END = "<!-- flown:begin -->", "<!-- flown:end -->"
#: properties of a test: [case, version], and [case, version, outcome]
FLYING, FLOWN = "flying", "flown"
FAILED, NOT_FLOWN, NOT_ASKED = "**FAILED**", "not flown", "-"

_DIGEST = re.compile(r"^Flown with script and parameters ([0-9a-f]{16}): (.+)\.$", re.MULTILINE)

#: (case, version) -> outcome
Outcomes = Mapping[tuple[str, str], str]


class Recorder:
    """Gathers what the flights of a run came to; a plugin of pytest."""

    def __init__(self, page: Path, *flown: Path) -> None:
        """`flown`: the files whose digest goes below the table, read now, before anything flies."""
        self._page = page
        self._digest = digest(*flown)
        #: what the table is to tell, and what each version was flown with
        self.told, self.flown_with = outcomes(page), flown_with(page)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when != "call":
            return
        told = dict(report.user_properties)
        if FLOWN in told and report.passed:
            case, version, outcome = told[FLOWN]
        elif FLYING in told and report.failed:
            case, version = told[FLYING]
            outcome = f"{FAILED}: {_first_line(report)}"
        else:
            return
        if self.flown_with.get(version) != self._digest:
            self.flown_with[version] = self._digest
            for key in [key for key in self.told if key[1] == version]:
                del self.told[key]
        self.told[case, version] = outcome

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        from tests.sitl.guard_suite import case_names

        write(self._page, table(case_names(), self.told), self.flown_with)


def recorded(request: pytest.FixtureRequest, case: str, firmware: Firmware, outcome: str | None = None) -> None:
    """Says which case this test flies on which version, and, once it is known, what came of it."""
    told: list[Any] = [case, firmware.version]
    request.node.user_properties.append((FLYING, told) if outcome is None else (FLOWN, [*told, outcome]))


def table(cases: Sequence[str], outcomes: Outcomes) -> list[str]:
    """Lines of the table. A case that no program of the run was asked to fly has `-` in that column."""
    versions = sorted({version for _, version in outcomes}, key=_by_number)
    lines = [" | ".join(["| case", *versions]) + " |", "|---" * (len(versions) + 1) + "|"]
    for case in cases:
        asked = any((case, version) in outcomes for version in versions)
        missing = NOT_ASKED if asked else NOT_FLOWN
        cells = [outcomes.get((case, version), missing).replace("|", "/") for version in versions]
        lines.append(" | ".join([f"| {case}", *cells]) + " |")
    return lines


def digest(*files: Path) -> str:
    """Tells whether a table was flown with these files. Comments and layout are not flown."""
    return hashlib.sha256(b"".join(_flown_of(path) for path in files)).hexdigest()[:16]


def _flown_of(path: Path) -> bytes:
    lines = path.read_text(encoding="utf-8").splitlines()
    if path.suffix == ".parm":
        values = (line.partition("#")[0].split() for line in lines)
        return "\n".join(" ".join(value) for value in values if value).encode()
    code = (line for line in lines if not line.lstrip().startswith("--"))
    return " ".join(" ".join(code).split()).encode()


def write(page: Path, lines: Sequence[str], digests: Mapping[str, str]) -> None:
    """Puts the lines between the marks of the page, and below them what each version was flown with.

    Raises:
        ValueError: the page has no marks.
    """
    head, begin, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{page}: the lines {BEGIN} and {END} are missing")
    below: dict[str, list[str]] = {}
    for version in sorted(digests, key=_by_number, reverse=True):
        below.setdefault(digests[version], []).append(version)
    told = [f"Flown with script and parameters {each}: {', '.join(versions)}." for each, versions in below.items()]
    page.write_text("\n".join([head + BEGIN, *lines, "", *told, END + tail]), encoding="utf-8")


def rows(page: Path) -> dict[str, list[str]]:
    """Case -> outcomes, one for each version, as the page has them."""
    return {case: outcomes for case, *outcomes in _cells(page)[2:]}


def flown_with(page: Path) -> dict[str, str]:
    """Version -> digest of the script and the parameters that it was flown with, by the page."""
    told = _DIGEST.findall(_between_marks(page))
    return {version: each for each, versions in told for version in versions.split(", ")}


def outcomes(page: Path) -> dict[tuple[str, str], str]:
    """All flights that the page's table tells of."""
    if not _cells(page):
        return {}
    (_, *versions), _, *cells = _cells(page)
    return {
        (case, version): outcome
        for case, *outcomes in cells
        for version, outcome in zip(versions, outcomes, strict=True)
        if outcome not in (NOT_FLOWN, NOT_ASKED)
    }


def _between_marks(page: Path) -> str:
    return page.read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0]


def _cells(page: Path) -> list[list[str]]:
    lines = [line for line in _between_marks(page).splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def _by_number(version: str) -> tuple[list[int], str]:
    numbers, _, rest = version.partition("-")
    return [int(part) for part in numbers.split(".")], rest


def _first_line(report: pytest.TestReport) -> str:
    crash = getattr(report.longrepr, "reprcrash", None)
    message = str(crash.message if crash else report.longrepr)
    return (message.splitlines() or [""])[0].removeprefix("AssertionError: ")[:160]
