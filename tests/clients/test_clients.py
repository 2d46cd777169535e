# SPDX-License-Identifier: GPL-3.0-or-later

"""Programs of others as stations, with real processes: what each is expected to be able to do, and to be refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.clients.flight import fly, table_of
from tests.clients.table import CLIENTS, Client
from tests.sitl.firmware import Firmware

pytestmark = [pytest.mark.clients, pytest.mark.process, pytest.mark.timeout(900)]

Tell = Callable[[list[str]], None]
each_client = pytest.mark.parametrize("client", [pytest.param(client, id=client.name) for client in CLIENTS])


@each_client
def test_it_flies_as_commander_and_is_refused_as_observer(
    client: Client, environments: Path, tell: Tell, tmp_path: Path
) -> None:
    flown = fly(client, environments, None, tmp_path)
    tell(table_of(flown))
    assert flown.faults == []


@pytest.mark.sitl
@each_client
def test_the_same_with_arducopter(
    client: Client, environments: Path, arducopter: Firmware, tell: Tell, tmp_path: Path
) -> None:
    flown = fly(client, environments, arducopter.program, tmp_path)
    tell([f"ArduCopter {arducopter.version}", *table_of(flown)])
    assert flown.faults == []
