# SPDX-License-Identifier: GPL-3.0-or-later

"""Which MAVSDK is tried: `--mavsdk PYTHON`, as often as wanted, each a Python that has one; else that of this one."""

from __future__ import annotations

import importlib.metadata
import os.path
import subprocess
import sys
from dataclasses import dataclass

import pytest


@dataclass(frozen=True, slots=True)
class Mavsdk:
    """A Python and the version of MAVSDK that it has."""

    python: str
    version: str


def _version_in(python: str) -> str:
    ask = "from importlib.metadata import version; print(version('mavsdk'))"
    try:
        done = subprocess.run([python, "-I", "-c", ask], capture_output=True, text=True, timeout=30, check=True)
    except (OSError, subprocess.SubprocessError) as error:
        raise pytest.UsageError(f"--mavsdk {python}: this is no Python that has MAVSDK ({error})") from None
    return done.stdout.strip()


def _found(given: list[str]) -> list[Mavsdk]:
    if given:
        # not resolved: the link in an environment is what tells Python where it is
        return [Mavsdk(os.path.abspath(python), _version_in(python)) for python in given]
    try:
        return [Mavsdk(sys.executable, importlib.metadata.version("mavsdk"))]
    except importlib.metadata.PackageNotFoundError:
        return []


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "mavsdk" not in metafunc.fixturenames:
        return
    reason = "no MAVSDK: `make mavsdk` installs the versions that are tried, apart, and runs this"
    missing = pytest.param(None, id="none", marks=pytest.mark.skip(reason=reason))
    found = [pytest.param(each, id=each.version) for each in _found(metafunc.config.getoption("--mavsdk") or [])]
    metafunc.parametrize("mavsdk", found or [missing])
