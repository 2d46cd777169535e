# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover doctor` beside a real companion: it takes no port, line or connection from one that starts or restarts."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mavproxy_handover.doctor.processes import listens
from tests.doctor.machine import free_port
from tests.loopback.conftest import Autopilot, vehicle_file, wait_for
from tests.loopback.test_supervised import HANDOVER, Companion

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(sys.platform != "linux", reason="what holds a port is read in /proc"),
]


class Doctors:
    """One after the other, until `end`."""

    def __init__(self, config: Path, master: str) -> None:
        self.reports: list[dict[str, Any]] = []
        self._argv = [*HANDOVER, "doctor", "companion", "--config", str(config), "--device", master, "--json"]
        self._environment = {**os.environ, "HOME": str(config.parent)}
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._done.is_set():
            ran = subprocess.run(
                self._argv, check=False, env=self._environment, capture_output=True, text=True, timeout=60
            )
            self.reports.append(json.loads(ran.stdout))

    def end(self) -> None:
        self._done.set()
        self._thread.join()

    def said(self, check: str) -> list[str]:
        return [
            f"{each['what']}: {each['found']}"
            for report in self.reports
            for each in report["findings"]
            if each["check"] == check
        ]


@pytest.fixture
def port() -> int:
    return free_port()


@pytest.fixture
def config(tmp_path: Path, port: int) -> Path:
    """The companion listens for its station, at a port that only one program can have."""
    return vehicle_file(tmp_path / "handover.toml", port, kind="udpin")


@pytest.fixture
def doctors(config: Path, autopilot: Autopilot) -> Iterator[Doctors]:
    running = Doctors(config, autopilot.master)
    yield running
    running.end()


def test_a_companion_starts_and_restarts_whatever_a_doctor_looks_at(
    doctors: Doctors, config: Path, port: int, autopilot: Autopilot
) -> None:
    """The fault: a doctor that did not see it opened its links for seconds, and the companion could not."""
    wait_for(lambda: listens(True, "127.0.0.1", port), lambda: "no doctor listens")
    running = Companion(autopilot, config)
    try:
        running.sends_leases()
        time.sleep(3.0)
        running.signal_child(signal.SIGKILL)
        running.sends_leases()
        time.sleep(3.0)
        doctors.end()
        for trouble in ("in use", "locked", "cannot"):
            assert trouble not in running.console()
        assert "failed_closed" not in running.events()
    finally:
        running.close()
    assert len(doctors.reports) >= 2
    assert not [text for text in doctors.said("ports") if "in use" in text]
    assert f"link of GCSA: udpin:127.0.0.1:{port} is held by the companion that runs" in doctors.said("ports")
    assert [text for text in doctors.said("service") if "what it holds is not opened here" in text]
