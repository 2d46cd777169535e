# SPDX-License-Identifier: GPL-3.0-or-later

"""The rules know no clock, no network, no chance, and nothing but the standard library."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

import gcs_module
import mavproxy_handover.core

CORE = "mavproxy_handover.core"
#: what the station's rules have beside them, and is looked at as well
STATION = (
    "gcs_module.events",
    "gcs_module.standard_control",
    "gcs_module.ahead",
    "gcs_module.alarms",
    "gcs_module.notices",
)

FORBIDDEN = {
    "asyncio",
    "concurrent",
    "ctypes",
    "datetime",
    "importlib",
    "multiprocessing",
    "os",
    "queue",
    "random",
    "sched",
    "secrets",
    "select",
    "selectors",
    "signal",
    "socket",
    "socketserver",
    "ssl",
    "subprocess",
    "threading",
    "time",
    "timeit",
    "uuid",
}
#: built-in functions that reach the outside or hide an import
FORBIDDEN_CALLS = {"__import__", "compile", "eval", "exec", "input", "open", "print"}


def sources() -> list[Path]:
    core = sorted(Path(mavproxy_handover.core.__file__).parent.rglob("*.py"))
    station = Path(gcs_module.__file__).parent
    return [*core, station / "core.py", station / "ahead.py", station / "events.py", station / "alarms.py"]


def offences(source: str) -> list[str]:
    """What this source text takes from outside the rules."""
    found = []
    for node in ast.walk(ast.parse(source)):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module or ""] if node.level == 0 else []
            if node.level > 1:
                found.append("import from above the package")
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in FORBIDDEN_CALLS:
            found.append(f"{node.func.id}()")
        for name in names:
            top = name.split(".")[0]
            if name in (CORE, *STATION) or name.startswith(CORE + "."):
                continue
            if top in FORBIDDEN or top not in sys.stdlib_module_names:
                found.append(name)
    return found


@pytest.mark.parametrize("path", sources(), ids=lambda path: f"{path.parent.name}/{path.name}")
def test_rules_import_nothing_impure(path: Path) -> None:
    assert offences(path.read_text(encoding="utf-8")) == []


def test_every_module_of_the_rules_is_looked_at() -> None:
    names = {path.name for path in sources()}
    assert names >= {
        "__init__.py",
        "arbiter.py",
        "authority.py",
        "candidates.py",
        "transfer_manager.py",
        "contacts.py",
        "core.py",
        "events.py",
        "flight.py",
        "limits.py",
        "links.py",
        "messages.py",
        "model.py",
        "phases.py",
        "presence.py",
        "requests.py",
        "battery.py",
        "emergency.py",
        "energy.py",
        "energy_prior.py",
        "learning.py",
        "start.py",
        "transfer.py",
        "zones.py",
    }


@pytest.mark.parametrize(
    ("source", "offence"),
    [
        ("import time", "time"),
        ("from time import monotonic", "time"),
        ("def f():\n    import socket", "socket"),
        ("import shapely.geometry", "shapely.geometry"),
        ("import random as r", "random"),
        ("from pymavlink import mavutil", "pymavlink"),
        ("from mavproxy_handover.wire import codec", "mavproxy_handover.wire"),
        ("import mavproxy_handover.corelike", "mavproxy_handover.corelike"),
        ("from datetime import datetime", "datetime"),
        ("from ..wire import codec", "import from above the package"),
        ("x = open('f')", "open()"),
    ],
)
def test_the_walk_sees(source: str, offence: str) -> None:
    assert offences(source) == [offence]
