# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks the installation that the unit runs: the packages that it needs, and that MAVProxy finds our modules.

The requirements are in the package's own metadata (made from `pyproject.toml`). Without a unit, the check covers the
installation that runs this.
"""

from __future__ import annotations

import operator
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from shutil import which
from typing import Final

from mavproxy_handover.doctor.check_context import CheckContext
from mavproxy_handover.doctor.finding import Finding, error, ok, unseen

__all__ = ["programs"]

_NAME: Final = "mavproxy-handover"
_REQUIREMENT: Final = re.compile(r"([\w.-]+)\s*(.*)")
_VERSIONS: Final = re.compile(r"(>=|<=|==|!=|<|>)\s*([\d.]+)")
_HOLDS: Final = {
    ">=": operator.ge,
    "<=": operator.le,
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
}
#: kind -> the top-level module that MAVProxy loads by `module load`
_MODULES: Final = {"companion": "handover.py", "station": "handover_gcs.py"}
_DIALECT: Final = "mavproxy_handover/data/dialect/handover.py"
#: text in our files that another program's file of the same name would not have
_LOADED: Final = "mavproxy_handover.supervision.must_load"
_STARTED: Final = "import handover_dialect"


@dataclass(frozen=True, slots=True)
class _Installation:
    """A Python installation.

    `path`: its search path for modules. `pip`: command that installs into it. `mavproxy`: the program `mavproxy.py`
    that this Python runs, None if there is none.
    """

    path: tuple[Path, ...]
    pip: str
    mavproxy: Path | None


def programs(context: CheckContext) -> Iterator[Finding]:
    """The findings of this check."""
    installation = _installation(context)
    if isinstance(installation, Finding):
        yield installation
        return
    found = {
        _plain(each.metadata["Name"] or ""): each
        for each in reversed(list(metadata.distributions(path=[str(place) for place in installation.path])))
    }
    ours = found.get(_NAME)
    again = f"{installation.pip} install -c constraints.txt ."
    if ours is None:
        yield error("handover", "the package is not installed there", f"Run {again} in the sources of this program.")
        return
    wrong = [*_packages(ours.requires or (), found, again), *_modules(context.kind, installation, again)]
    yield from wrong
    if not wrong:
        yield ok("handover", f"{ours.version}, in {ours.locate_file('')}, with all that it needs")


def _installation(context: CheckContext) -> _Installation | Finding:
    unit = context.unit
    program = unit.program if unit is not None and context.installed else None
    prefix = None if program is None else context.at(program.parent.parent)
    if prefix is None or prefix == Path(sys.prefix):
        path = tuple(Path(place) for place in sys.path if place)
        here = Path(sys.executable).parent
        return _Installation(path, str(here / "pip"), _mavproxy(here))
    places = sorted(prefix.glob("lib/python3.*/site-packages"))
    if not places:
        return unseen(
            "program",
            f"{prefix} is no virtual environment, and the unit runs {program}",
            "Make one there and install into it (docs/installation.md).",
        )
    here = prefix / "bin"
    return _Installation(tuple(places), str(here / "pip"), _mavproxy(here))


def _mavproxy(folder: Path) -> Path | None:
    """The program as `cli/launch.py` finds it: beside this Python, else on the PATH (a system's own MAVProxy)."""
    beside = folder / "mavproxy.py"
    found = str(beside) if beside.is_file() else which("mavproxy.py")
    return None if found is None else Path(found)


# ---- packages -------------------------------------------------------------------------------------------------------


def _packages(requires: Sequence[str], found: Mapping[str, metadata.Distribution], again: str) -> Iterator[Finding]:
    """What lacks or does not fit. A requirement of an extra, or of some Pythons only, is left out."""
    for line in requires:
        match = None if ";" in line else _REQUIREMENT.fullmatch(line.strip())
        if match is None:
            continue
        name, versions = match[1], match[2].strip("() ")
        present = found.get(_plain(name))
        if present is None:
            yield error(name, f"is not installed, but {versions or 'any version'} is needed", f"Run {again}.")
        elif not _fits(present.version, versions):
            yield error(name, f"{present.version}, but {versions} is needed", f"Run {again}.")


def _fits(version: str, versions: str) -> bool:
    """True if a version is within ">=1.2,<2"; other forms count as fitting."""
    ours = _numbers(version)
    for sign, other in _VERSIONS.findall(versions):
        theirs = _numbers(other)
        size = max(len(ours), len(theirs))
        left, right = ours + (0,) * (size - len(ours)), theirs + (0,) * (size - len(theirs))
        if not _HOLDS[sign](left, right):
            return False
    return True


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", re.split(r"[^\d.]", version, maxsplit=1)[0]))


def _plain(name: str) -> str:
    """Normalised name of a package (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


# ---- modules --------------------------------------------------------------------------------------------------------


def _modules(kind: str, installation: _Installation, again: str) -> Iterator[Finding]:
    for what, file, word in (
        ("module load", _MODULES[kind], _LOADED),
        ("dialect", "handover_dialect.pth", _STARTED),
        ("dialect", _DIALECT, ""),
    ):
        place = next((each for each in installation.path if (each / file).is_file()), None)
        if place is None:
            yield error(what, f"{file} is in no folder of this Python's packages", f"Run {again}.")
        elif word not in (place / file).read_text(encoding="utf-8", errors="replace"):
            yield error(what, f"{place / file} is another program's", f"Remove or rename it, then run {again}.")
    if installation.mavproxy is None:
        yield error("mavproxy.py", "it is in no folder of programs", f"Run {again}.")
