# SPDX-License-Identifier: GPL-3.0-or-later

"""Three MAVProxys: a companion, its parent station, and a partner whose configuration has no link to the vehicle.

The mission that the parent shares carries the vehicle's address. The flight with it is the scenario `partner-address`.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from mavproxy_handover.cli.launch import companion_argv, station_argv
from mavproxy_handover.store.keys import write_key
from sitl.vehicles.ports import PortPicker
from tests.loopback.conftest import Autopilot, MavProxy, wait_for
from tests.packages import ROUND


class Site:
    """The files of all three, and the vehicle's end. GCSB has neither mission nor link."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.autopilot = Autopilot()
        ports = PortPicker()
        self.to_a, self.to_b, self.ground_a, self.ground_b = (ports.udp() for _ in range(4))
        self.running: list[MavProxy] = []
        mission = shutil.copytree(ROUND, folder / "delivery")
        (mission / "addresses.toml").write_text(f'[vehicle]\nGCSB = ["udpout:127.0.0.1:{self.to_b}"]\n')
        for name, key in (("GCSA", b"\1" * 32), ("GCSB", b"\2" * 32), ("ground", b"\3" * 32)):
            write_key(folder / f"{name}.key", key)
        self.vehicle = folder / "vehicle.toml"
        self.vehicle.write_text(
            f"""
            [vehicle]
            name = "drone-1"
            parent = "GCSA"
            journal = "companion.jsonl"
            guard = false
            [[station]]
            name = "GCSA"
            sysid = 251
            key = "GCSA.key"
            links = ["udpout:127.0.0.1:{self.to_a}"]
            [[station]]
            name = "GCSB"
            sysid = 252
            key = "GCSB.key"
            links = ["udpin:127.0.0.1:{self.to_b}"]
            """
        )
        self.a = self.station("GCSA", 251, self.ground_a, ("GCSB", 252, self.ground_b), f'mission = "{mission}"')
        self.b = self.station(
            "GCSB", 252, self.ground_b, ("GCSA", 251, self.ground_a), "offered_addresses_local = true"
        )

    def station(self, name: str, sysid: int, listen: int, peer: tuple[str, int, int], more: str) -> Path:
        path = self.folder / f"{name}.toml"
        path.write_text(
            f"""
            [station]
            name = "{name}"
            sysid = {sysid}
            vehicle = 1
            key = "{name}.key"
            {more}
            [ground]
            listen = "udpin:127.0.0.1:{listen}"
            key = "ground.key"
            [[peer]]
            name = "{peer[0]}"
            sysid = {peer[1]}
            link = "udpout:127.0.0.1:{peer[2]}"
            """
        )
        return path

    def run(self, command: list[str]) -> MavProxy:
        self.running.append(MavProxy(command, self.folder))
        return self.running[-1]

    def start_b(self) -> MavProxy:
        process = self.run([*station_argv(self.b, None, self.folder / "GCSB.tlog"), "--append-log"])
        process.shows("Loaded module handover_gcs")
        return process

    def end(self, process: MavProxy) -> None:
        self.running.remove(process)
        process.end()

    def close(self) -> None:
        for process in self.running:
            process.end()
        self.autopilot.close()


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    site = Site(tmp_path)
    yield site
    site.close()


def test_a_partner_without_a_link_connects_by_the_mission_and_again_after_a_restart(site: Site) -> None:
    companion = site.run(companion_argv(site.vehicle, site.autopilot.master, site.folder / "companion.tlog"))
    companion.shows("Loaded module handover")
    parent = site.run(station_argv(site.a, f"udpin:127.0.0.1:{site.to_a}", site.folder / "GCSA.tlog"))
    parent.shows("GCSA is the commander now")
    partner = site.start_b()
    partner.shows("Ground link to GCSA is up.")
    parent.type("handover share")
    address = f"udpout:127.0.0.1:{site.to_b}"
    partner.shows(f"GCSA sends the vehicle's address {address}. This station has no link to the vehicle.")
    time.sleep(1.5)
    assert not any("is connected" in line for line in partner.lines)
    partner.answer("handover connect 1", f"Connecting to the vehicle at {address}, the address from GCSA.")
    partner.shows(f"Link to the vehicle opened: {address}.")
    partner.shows("is connected.")
    companion.answer("handover stations", "GCSB")
    site.end(partner)
    again = site.start_b()
    again.shows(f"Link to the vehicle opened: {address}.")
    again.shows("is connected.")
    again.answer("handover status", f"address   {address} from GCSA with mission 'delivery', confirmed ")
    again.answer(
        "handover disconnect", f"The link to the vehicle at {address} is closed, and its address is forgotten."
    )
    again.alive()
    file = site.folder / "GCSB-vehicle-1.address"
    wait_for(lambda: not file.exists(), lambda: f"{file} is still there")
