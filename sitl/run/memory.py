# SPDX-License-Identifier: GPL-3.0-or-later

"""The place in memory where the companions of a run keep their state; it ends with the run."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mavproxy_handover.store.memory import in_memory

__all__ = ["memory_of_a_run"]

_SHARED = Path("/dev/shm")
_VARIABLE = "RUNTIME_DIRECTORY"


@contextmanager
def memory_of_a_run() -> Iterator[None]:
    """All processes that are started meanwhile keep their state in there; elsewhere if it is set already.

    Where there is no such storage each says so itself, and keeps its state on the disk.
    """
    if os.environ.get(_VARIABLE) or not in_memory(_SHARED) or not os.access(_SHARED, os.W_OK):
        yield
        return
    with tempfile.TemporaryDirectory(prefix="handover-run-", dir=_SHARED, ignore_cleanup_errors=True) as folder:
        os.environ[_VARIABLE] = folder
        try:
            yield
        finally:
            os.environ.pop(_VARIABLE, None)
