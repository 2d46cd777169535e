# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks Python and the packages for the required versions, and that MAVProxy finds our modules.

The requirements are in the package's own metadata (made from `pyproject.toml`) and in `constraints.txt`. The check
covers the installation that the unit runs; without a unit, the one that runs this.
"""

from __future__ import annotations

import platform
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from shutil import which
from typing import Final

from mavproxy_handover.doctor.check_context import CheckContext
from mavproxy_handover.doctor.finding import Finding, error, ok, unseen, warning
from mavproxy_handover.tools.resources import shipped

__all__ = ["programs"]

_NAME: Final = "mavproxy-handover"
_REQUIREMENT: Final = re.compile(r"([\w.-]+)\s*(?:\[[^]]*\])?\s*([^;]*?)\s*(?:;\s*(.*))?")
_OLDER_PYTHON: Final = re.compile(r"python_version < ['\"](\d+)\.(\d+)['\"]")
#: kind -> the top-level module that MAVProxy loads by `module load`
_MODULES: Final = {"companion": "handover.py", "station": "handover_gcs.py"}
_DIALECT: Final = Path("mavproxy_handover", "data", "dialect", "handover.py")
#: text in our files that another program's file of the same name would not have
_LOADED: Final = "mavproxy_handover.supervision.must_load"
_STARTED: Final = "import handover_dialect"


@dataclass(frozen=True, slots=True)
class _Installation:
    """A Python installation.

    `path`: its search path for modules. `pip`: command that installs into it. `mavproxy`: the program `mavproxy.py`
    that this Python runs, None if there is none.
    """

    python: str
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
    yield ok("handover", f"{ours.version}, in {ours.locate_file('')}")
    yield _python(installation.python, ours.metadata["Requires-Python"] or "")
    pins = _pins()
    for line in ours.requires or ():
        wanted = _wanted(line, installation.python)
        if wanted is not None:
            yield _package(*wanted, found, pins, again)
    yield from _modules(context.kind, installation, again)


def _installation(context: CheckContext) -> _Installation | Finding:
    unit = context.unit
    program = unit.program if unit is not None and context.installed else None
    prefix = None if program is None else context.at(program.parent.parent)
    if prefix is None or prefix == Path(sys.prefix):
        path = tuple(Path(place) for place in sys.path if place)
        here = Path(sys.executable).parent
        return _Installation(platform.python_version(), path, str(here / "pip"), _mavproxy(here))
    places = sorted(prefix.glob("lib/python3.*/site-packages"))
    if not places:
        return unseen(
            "program",
            f"{prefix} is no virtual environment, and the unit runs {program}",
            "Make one there and install into it (docs/installation.md).",
        )
    here = prefix / "bin"
    return _Installation(_version_of(prefix), tuple(places), str(here / "pip"), _mavproxy(here))


def _mavproxy(folder: Path) -> Path | None:
    """The program as `cli/launch.py` finds it: beside this Python, else on the PATH (a system's own MAVProxy)."""
    beside = folder / "mavproxy.py"
    found = str(beside) if beside.is_file() else which("mavproxy.py")
    return None if found is None else Path(found)


def _version_of(prefix: Path) -> str:
    """The version of a virtual environment's Python."""
    try:
        text = (prefix / "pyvenv.cfg").read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    named = re.search(r"^version(?:_info)?\s*=\s*(\d+\.\d+(?:\.\d+)?)", text, re.MULTILINE)
    if named is not None:
        return named[1]
    return next(iter(sorted(prefix.glob("lib/python3.*")))).name.removeprefix("python")


# ---- versions -------------------------------------------------------------------------------------------------------


def _python(version: str, requires: str) -> Finding:
    if _fits(version, requires):
        return ok("Python", version)
    return error(
        "Python", f"{version}, but {requires} is needed", "Make a new virtual environment with a newer Python."
    )


def _package(
    name: str, requires: str, found: Mapping[str, metadata.Distribution], pins: Mapping[str, str], again: str
) -> Finding:
    present = found.get(_plain(name))
    if present is None:
        return error(name, f"is not installed, but {requires or 'any version'} is needed", f"Run {again}.")
    if not _fits(present.version, requires):
        return error(name, f"{present.version}, but {requires} is needed", f"Run {again}.")
    pinned = pins.get(_plain(name))
    if pinned is not None and present.version != pinned:
        return warning(name, f"{present.version}, constraints.txt has {pinned}", f"Run {again}.")
    return ok(name, f"{present.version}{f' (needed: {requires})' if requires else ''}")


def _wanted(line: str, python: str) -> tuple[str, str] | None:
    """Name and versions of a requirement; None for one of an extra, or of another Python."""
    match = _REQUIREMENT.fullmatch(line.strip())
    if match is None:
        return None
    marker = match[3] or ""
    older = _OLDER_PYTHON.search(marker)
    if "extra" in marker or (older is not None and _numbers(python)[:2] >= (int(older[1]), int(older[2]))):
        return None
    return match[1], match[2].strip("() ")


def _pins() -> dict[str, str]:
    """`constraints.txt`: name -> required version; empty if the file was not shipped."""
    try:
        text = shipped("constraints.txt").read_text(encoding="utf-8")
    except OSError:
        return {}
    lines = (line.partition("#")[0].strip() for line in text.splitlines())
    return {_plain(line.partition("==")[0]): line.partition("==")[2].strip() for line in lines if "==" in line}


def _fits(version: str, requires: str) -> bool:
    """True if a version is within ">=1.2,<2"; other forms count as fitting."""
    ours = _numbers(version)
    for part in filter(None, (each.strip() for each in requires.split(","))):
        match = re.fullmatch(r"(>=|<=|==|!=|<|>)\s*([\d.]+)", part)
        if match is None:
            continue
        other = _numbers(match[2])
        size = max(len(ours), len(other))
        left, right = ours + (0,) * (size - len(ours)), other + (0,) * (size - len(other))
        holds = {
            ">=": left >= right, "<=": left <= right, "==": left == right,
            "!=": left != right, "<": left < right, ">": left > right,
        }  # fmt: skip
        if not holds[match[1]]:
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
        ("dialect", str(_DIALECT), ""),
    ):
        place = next((each for each in installation.path if (each / file).is_file()), None)
        if place is None:
            yield error(what, f"{file} is in no folder of this Python's packages", f"Run {again}.")
        elif word not in (place / file).read_text(encoding="utf-8", errors="replace"):
            yield error(what, f"{place / file} is another program's", f"Remove or rename it, then run {again}.")
        else:
            yield ok(what, f"{place / file}")
    if installation.mavproxy is None:
        yield error("mavproxy.py", "it is in no folder of programs", f"Run {again}.")
