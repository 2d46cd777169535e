# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover station` for two vehicles, in a MAVProxy as it comes: what is typed for one goes to that one alone.

The vehicles are two ends of TCP links that say they are autopilots; what reaches each of them is kept.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.cli.launch import station_argv
from tests.loopback.conftest import Autopilot, MavProxy, wait_for

CONFIG = """
[station]
name = "GCSA"
sysid = 251
[[vehicle]]
name = "drone-1"
sysid = 1
links = ["{}"]
allow_unsigned = true
[[vehicle]]
name = "drone-2"
sysid = 2
links = ["{}"]
allow_unsigned = true
"""
RTL, GUIDED = 6, 4


class Two:
    """Two vehicles, and the MAVProxy of their station."""

    def __init__(self, folder: Path) -> None:
        self.vehicles = {1: Autopilot(1), 2: Autopilot(2)}
        config = folder / "station.toml"
        config.write_text(CONFIG.format(*(vehicle.master for vehicle in self.vehicles.values())))
        self.console = MavProxy(station_argv(config, None, folder / "station.tlog"), folder)
        self.console.shows("Loaded module handover_gcs")
        for sysid in self.vehicles:
            self.console.shows(f"Detected vehicle {sysid}:1")

    def got(self, sysid: int, kind: str) -> list[Any]:
        """What has reached a vehicle of this kind of message."""
        return [m for m in list(self.vehicles[sysid].received) if m.get_type() == kind]

    def modes(self, sysid: int) -> list[tuple[int, int]]:
        """Modes that were asked of a vehicle: of whom, and which."""
        wanted = [(m.target_system, int(m.param2)) for m in self.got(sysid, "COMMAND_LONG") if m.command == 176]
        return wanted + [(m.target_system, m.custom_mode) for m in self.got(sysid, "SET_MODE")]

    def sticks(self, sysid: int) -> list[tuple[int, int]]:
        """The third channel of what was held for a vehicle, and whom it was for."""
        return [(m.target_system, m.chan3_raw) for m in self.got(sysid, "RC_CHANNELS_OVERRIDE")]

    def close(self) -> None:
        self.console.end()
        for vehicle in self.vehicles.values():
            vehicle.close()


@pytest.fixture
def two(tmp_path: Path) -> Iterator[Two]:
    two = Two(tmp_path)
    yield two
    two.close()


def test_what_is_typed_goes_to_the_chosen_vehicle_and_by_its_link(two: Two) -> None:
    two.console.type("mode RTL")
    wait_for(lambda: two.modes(1), lambda: "the first vehicle was asked for nothing")
    two.console.type("vehicle drone-2\nmode GUIDED\nmode RTL")  # in one go: no round of the main loop between them
    wait_for(lambda: len(two.modes(2)) >= 2, lambda: f"the second vehicle was asked for {two.modes(2)}")
    assert set(two.modes(1)) == {(1, RTL)}
    assert set(two.modes(2)) == {(2, GUIDED), (2, RTL)}
    two.console.answer("handover status", "* drone-2")
    two.console.type("handover -v drone-1 start")
    wait_for(
        lambda: any(m.command == mavlink.MAV_CMD_MISSION_START for m in two.got(1, "COMMAND_LONG")),
        lambda: "START never came",
    )
    assert not any(m.command == mavlink.MAV_CMD_MISSION_START for m in two.got(2, "COMMAND_LONG"))


def test_what_is_typed_for_all_reaches_each_as_its_own(two: Two) -> None:
    two.console.type("alllinks mode GUIDED")
    wait_for(lambda: two.modes(1) and two.modes(2), lambda: f"asked for: {two.modes(1)}, {two.modes(2)}")
    assert set(two.modes(1)) == {(1, GUIDED)}
    assert set(two.modes(2)) == {(2, GUIDED)}


def test_sticks_are_not_taken_along_to_the_next_vehicle(two: Two) -> None:
    two.console.type("rc 3 1200")
    wait_for(lambda: (1, 1200) in two.sticks(1), lambda: "no sticks came")
    two.console.answer("vehicle 2", "Its sticks are let go of")
    wait_for(lambda: two.sticks(1)[-1] == (1, 0), lambda: f"not given back: {two.sticks(1)[-3:]}")
    two.console.type("rc 3 1400")
    wait_for(lambda: (2, 1400) in two.sticks(2), lambda: "no sticks came to the second vehicle")
    assert {value for _whom, value in two.sticks(2)} <= {0, 1400}
    assert {whom for whom, _value in two.sticks(1)} == {1}


def test_both_vehicles_hear_the_station_and_the_prompt_names_the_chosen_one(two: Two) -> None:
    for sysid in two.vehicles:
        wait_for(
            lambda sysid=sysid: any(m.get_srcSystem() == 251 for m in two.got(sysid, "HEARTBEAT")),
            lambda: "no heartbeat of the station came",
        )
    two.console.answer("vehicle drone-2", "Set vehicle 2 (link 2)")
    two.console.answer("set vehicle_name", "vehicle_name drone-2")
    two.console.answer("module unload handover_gcs", "Unloaded module handover_gcs")
    two.console.answer("vehicle 1", "Set vehicle 1")
    two.console.alive()
