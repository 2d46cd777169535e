# SPDX-License-Identifier: GPL-3.0-or-later

"""For all tests: what companions keep in memory goes when the tests are over, and none finds what another one kept.

And which programs of ArduPilot's SITL the flights are flown with: `--arducopter`, `--arduplane` and `--ardurover`, each
as often as wanted; a test that takes the fixture of that name runs once for each.
"""

from __future__ import annotations

import gc
import os
import shutil
import sys
import tempfile
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from mavproxy_handover.store.memory import in_memory
from sitl.vehicles import LaunchError, find_arducopter
from tests.sitl.firmware import Firmware, NotFirmware, firmware_of
from tests.sitl.flown import Recorder
from tests.sitl.guard_flight import GUARD, PARAMETERS, PLANE_PARAMETERS

# `reference` is in no package that is installed. At the end: what is tested is the installed package
sys.path.append(str(Path(__file__).resolve().parents[1]))

# a machine that others use as well must not fail a test by its speed
settings.register_profile("no deadline", deadline=None)
settings.load_profile("no deadline")

_SHARED = Path("/dev/shm")
#: options, fixtures and names of the programs
_PROGRAMS = ("arducopter", "arduplane", "ardurover")


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("ArduPilot")
    for name in _PROGRAMS:
        group.addoption(
            f"--{name}", action="append", metavar="PATH", help=f"an {name} SITL program; may be given several times"
        )
    group.addoption("--clients", metavar="FOLDER", help="where `make clients` has installed the programs of others")
    group.addoption("--long", action="store_true", help="no test is left out for its length, and each goes to its end")
    group.addoption("--flown", metavar="PAGE", type=Path, help="write the guard's table of flights into this page")


def pytest_configure(config: pytest.Config) -> None:
    page = config.getoption("--flown")
    if page is not None and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Recorder(page, GUARD, PARAMETERS, PLANE_PARAMETERS))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect without the garbage collector, and leave the tests that were collected out of its later rounds."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if not config.getoption("--long"):
        skip = pytest.mark.skip(reason="only with --long")
        for item in items:
            if item.get_closest_marker("long") is not None:
                item.add_marker(skip)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    for name in _PROGRAMS:
        if name in metafunc.fixturenames:
            programs = _programs(name, metafunc.config.getoption(f"--{name}"))
            missing = pytest.param(None, id="none", marks=pytest.mark.skip(reason=_how_to(name)))
            metafunc.parametrize(
                name, [pytest.param(each, id=each.version) for each in programs] or [missing], scope="session"
            )


def _programs(name: str, given: list[str] | None) -> list[Firmware]:
    try:
        paths = [Path(path).expanduser() for path in given] if given else _found(name)
        firmwares = [firmware_of(path) for path in paths]
    except (LaunchError, NotFirmware) as error:
        raise pytest.UsageError(str(error)) from error
    for firmware in firmwares:
        if f"ardu{firmware.vehicle.lower()}" != name:
            raise pytest.UsageError(f"--{name}: {firmware.program} is Ardu{firmware}")
    return firmwares


def _found(name: str) -> list[Path]:
    """The program where nothing was said: for Copter as everywhere, for the others beside it."""
    copter = find_arducopter()
    if name == "arducopter":
        return [copter] if copter else []
    found = shutil.which(name) or (copter and shutil.which(str(copter.with_name(name))))
    return [Path(found)] if found else []


def _how_to(name: str) -> str:
    return f"no {name} SITL program: give --{name} PATH, or build one in ~/ardupilot (waf {name.removeprefix('ardu')})"


@pytest.fixture(scope="session", autouse=True)
def runtime_directory() -> Iterator[Path | None]:
    """Where companions keep their state in memory, those in processes of their own too; None: nowhere."""
    if not in_memory(_SHARED) or not os.access(_SHARED, os.W_OK):
        yield None
        return
    with tempfile.TemporaryDirectory(dir=_SHARED, prefix="handover-tests-") as folder:
        patch = pytest.MonkeyPatch()
        patch.setenv("RUNTIME_DIRECTORY", folder)
        yield Path(folder)
        patch.undo()


@pytest.fixture(scope="session", autouse=True)
def panels_directory() -> Iterator[Path]:
    """Where stations have the sockets of their panels: those of other tests, and of this user, are not found."""
    with tempfile.TemporaryDirectory(prefix="handover-panels-") as folder:
        patch = pytest.MonkeyPatch()
        patch.setenv("HANDOVER_PANELS", folder)
        yield Path(folder)
        patch.undo()
