# SPDX-License-Identifier: GPL-3.0-or-later

"""For the tests of the doctor: companions that other tests run at the same time are not those of this machine."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from mavproxy_handover.doctor import processes


@pytest.fixture(autouse=True)
def only_own_companions(monkeypatch: pytest.MonkeyPatch) -> None:
    """The doctor takes a `handover companion` that names no configuration for the one that it looks at."""
    of_anybody = processes._words

    def words_of(pid: int) -> list[str]:
        words = of_anybody(pid)
        return words if "companion" not in words or _is_descendant(pid) else []

    monkeypatch.setattr(processes, "_words", words_of)


def _is_descendant(pid: int) -> bool:
    """Whether this process has started that one, or one that has started it."""
    while pid > 1:
        if pid == os.getpid():
            return True
        try:
            status = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8")
        except OSError:
            return False
        pid = int(status.rpartition(")")[2].split()[1])
    return False
