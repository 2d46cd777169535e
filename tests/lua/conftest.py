# SPDX-License-Identifier: GPL-3.0-or-later

"""Every text of the guard in a test is in the table that the page about messages is made from."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from gcs_module.texts import SEVERITIES
from mavproxy_handover.core.common.levels import Level
from reference.sentences import OF_GUARD
from tests.lua.stub import FakeVehicle

PREFIX = "HNDO: "


@pytest.fixture(autouse=True)
def guard_texts(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Each text has a row, of its level. A guard with a planted fault may say anything."""
    said: dict[tuple[int, str], None] = {}
    send = FakeVehicle.send_text

    def noted(vehicle: FakeVehicle, severity: int, text: str) -> None:
        if text.startswith(PREFIX):  # not what the firmware says of scripts
            said[severity, text] = None
        send(vehicle, severity, text)

    monkeypatch.setattr(FakeVehicle, "send_text", noted)
    yield
    if "PLANTED_GUARD" not in os.environ:
        assert unknown(said) == []


def unknown(said: dict[tuple[int, str], None]) -> list[str]:
    wrong = []
    for severity, text in said:
        levels = {row.level for row in OF_GUARD.all(text)}
        if SEVERITIES.get(severity, Level.INFO) not in levels:
            wrong.append(f"severity {severity}, in its row {levels or 'none'}: {text}")
    return wrong
