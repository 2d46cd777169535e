# SPDX-License-Identifier: GPL-3.0-or-later

"""Links that are opened to an address of the vehicle: MAVProxy's own, and never the last one is missing."""

from __future__ import annotations

import socket
from collections import Counter

import pytest

from gcs_module.links import Links
from gcs_module.vehicle_links import VehicleLinks
from mavproxy_handover.config.files import FleetVehicle
from mavproxy_handover.wire.vehicle_address import WAITING_LABEL, WAITING_LINK, VehicleAddress
from tests.module.proxy import LinkModule, Master, MPState

WIFI = VehicleAddress("10.0.0.2", 14552)
LTE = VehicleAddress("100.64.3.7", 5762)


class Bench:
    def __init__(self, *masters: Master, vehicles: tuple[FleetVehicle, ...] = (FleetVehicle(1),)) -> None:
        self.mpstate = MPState()
        self.mpstate.mav_master[:] = masters
        self.link = LinkModule(self.mpstate)
        self.mpstate.public_modules["link"] = self.link
        links = Links(self.mpstate, vehicles, lambda _text: None, Counter())
        self.made = VehicleLinks(self.mpstate, links, vehicles[0].sysid, vehicles[0].name, lambda: (15552,))

    def addresses(self) -> list[str]:
        return [master.address for master in self.mpstate.mav_master]


def waiting() -> Master:
    return Master(WAITING_LABEL, "127.0.0.1:0")


def test_the_first_link_takes_the_place_of_the_waiting_one() -> None:
    bench = Bench(waiting())
    assert bench.made.own() == ()
    assert bench.made.open(WIFI) == ""
    assert bench.link.added == ["udpout:10.0.0.2:14552"]
    assert bench.addresses() == ["10.0.0.2:14552"]
    assert bench.made.open(LTE) == ""
    assert bench.addresses() == ["10.0.0.2:14552", "100.64.3.7:5762"]
    assert bench.made.own() == ()
    assert (bench.made.is_open(WIFI), bench.made.is_open(LTE)) == (True, True)


def test_when_they_are_closed_the_waiting_one_is_back() -> None:
    bench = Bench(waiting())
    bench.made.open(WIFI)
    bench.made.open(LTE)
    bench.made.close()
    (master,) = bench.mpstate.mav_master
    assert (master.label, bench.link.added[-1]) == (WAITING_LABEL, WAITING_LINK)
    assert bench.made.is_open(WIFI) is False
    assert bench.made.open(WIFI) == ""
    assert bench.addresses() == ["10.0.0.2:14552"]


def test_links_of_the_stations_own_configuration_are_named_and_kept() -> None:
    bench = Bench(Master(None, "0.0.0.0:14550"))
    assert bench.made.own() == ("0.0.0.0:14550",)
    bench.made.open(WIFI)
    bench.made.close()
    assert bench.addresses() == ["0.0.0.0:14550"]


def test_what_mavproxy_cannot_open_leaves_the_waiting_link() -> None:
    bench = Bench(waiting())
    bench.link.opens = False
    assert bench.made.open(WIFI) == "MAVProxy cannot open it"
    assert (bench.addresses(), bench.made.is_open(WIFI)) == (["127.0.0.1:0"], False)


def test_without_mavproxys_link_module_nothing_is_opened() -> None:
    bench = Bench(waiting())
    bench.mpstate.public_modules.clear()
    assert bench.made.open(WIFI) == "MAVProxy's module 'link' is not loaded"
    bench.made.close()


def test_where_there_are_several_vehicles_the_link_is_named_after_its_own() -> None:
    two = (FleetVehicle(1, "drone-1"), FleetVehicle(2, "drone-2"))
    bench = Bench(Master("drone-2", "0.0.0.0:14560"), vehicles=two)
    assert bench.made.own() == ()
    bench.made.open(WIFI)
    assert bench.link.added == ['udpout:10.0.0.2:14552:{"label":"drone-1"}']
    assert bench.made.own() == ()


@pytest.mark.parametrize(("host", "own"), [("127.0.0.1", True), ("127.9.9.9", True), ("192.0.2.7", False)])
def test_an_address_of_this_computer_is_known_without_a_packet(host: str, own: bool) -> None:
    assert Bench(waiting()).made.leads_back(VehicleAddress(host, 14552)) is own


def test_the_ports_of_this_program_are_known() -> None:
    """The ground link, MAVProxy's links and its outputs."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp, socket.socket() as tcp:
        udp.bind(("127.0.0.1", 0))
        tcp.bind(("127.0.0.1", 0))
        master, output = waiting(), Master(None, "127.0.0.1:1")
        master.port, output.port = udp, tcp  # type: ignore[attr-defined]
        bench = Bench(master)
        bench.mpstate.mav_outputs.append(output)  # type: ignore[arg-type]
        ports = [udp.getsockname()[1], tcp.getsockname()[1], 15552]
        for port in ports:
            assert bench.made.is_ours(VehicleAddress("127.0.0.1", port))
        free = next(port for port in range(20000, 20010) if port not in ports)
        assert not bench.made.is_ours(VehicleAddress("127.0.0.1", free))


def test_without_mavproxys_link_module_an_open_link_is_not_called_closed() -> None:
    bench = Bench(waiting())
    bench.made.open(WIFI)
    bench.mpstate.public_modules.clear()
    assert bench.made.close() == "MAVProxy's module 'link' is not loaded"
    assert bench.made.is_open(WIFI) is True
    bench.mpstate.public_modules["link"] = bench.link
    assert bench.made.close() == ""
    assert [master.label for master in bench.mpstate.mav_master] == [WAITING_LABEL]


def test_a_link_that_mavproxy_keeps_because_it_is_the_last_one_is_not_called_closed() -> None:
    bench = Bench(waiting())
    bench.made.open(WIFI)
    bench.link.opens = False
    assert bench.made.close() == "MAVProxy cannot close it"
    assert bench.made.own() == ()
    assert bench.made.is_open(WIFI) is True
