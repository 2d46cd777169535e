# SPDX-License-Identifier: GPL-3.0-or-later

"""For all tests: what companions keep in memory goes when the tests are over, and none finds what another one kept."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from mavproxy_handover.store.memory import in_memory

_SHARED = Path("/dev/shm")


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
