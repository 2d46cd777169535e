# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVProxy's map and menus at a station: what is handed to them, when, and what is taken back.

The map is a fake that keeps what it is given: the real one needs wx, a screen, and OpenCV.
"""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from MAVProxy.modules.lib import mp_menu, mp_util
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module import map_view
from mavproxy_handover.mission import package as mission_package
from tests.module.test_station_module import StationBench, connect_message, station  # noqa: F401
from tests.packages import MISSIONS

ZONES = {f"handover 1 zone {number}" for number in (251, 252)}


class Map:
    """A map of MAVProxy."""

    def __init__(self) -> None:
        self.alive, self.broken = True, False
        self.objects: dict[str, Any] = {}
        self.given: list[str] = []

    def is_alive(self) -> bool:
        return self.alive

    def add_object(self, item: Any) -> None:
        self.given.append(item.key)
        if self.broken:
            raise OSError("handle is closed")
        self.objects[item.key] = item

    def remove_object(self, key: str) -> None:
        del self.objects[key]

    def rows(self) -> list[str]:
        return [row.words for row in self.objects["handover 1 plate"].item.rows]


class Host:
    """A module of MAVProxy that has a menu, as its console and its map do."""

    def __init__(self, name: str) -> None:
        self.name, self.broken = name, False
        self.menus: dict[str, Any] = {}
        self.added = 0
        if name.startswith("map"):
            self.map = Map()

    def add_menu(self, menu: Any) -> None:
        if self.broken:
            raise BrokenPipeError
        self.added += 1
        self.menus[menu.name] = menu

    def remove_menu(self, menu: Any) -> None:
        del self.menus[menu.name]

    def idle_task(self) -> None:
        pass

    def mavlink_packet(self, _message: Any) -> None:
        pass


@pytest.fixture(autouse=True)
def world(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where maps can be: OpenCV and wx are there. Missions are looked at at once."""
    cv2 = ModuleType("cv2")
    cv2.FONT_HERSHEY_DUPLEX = cv2.FONT_HERSHEY_SIMPLEX = 0  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "cv2", cv2)
    monkeypatch.setattr(mp_util, "has_wxpython", True)
    worker = map_view.Worker
    monkeypatch.setattr(map_view, "Worker", lambda: worker(lambda run: run()))


def load(bench: StationBench, name: str) -> Host:
    host = Host(name)
    bench.mpstate.modules.append((host, sys))
    bench.mpstate.public_modules[name] = host
    return host


def close(bench: StationBench, host: Host) -> None:
    bench.mpstate.modules.remove((host, sys))
    bench.mpstate.public_modules.pop(host.name)


def status(commander: int = 251, epoch: int = 1, place: str = "home", **more: Any) -> Any:
    """AUTHORITY_STATUS in flight, in the zone of GCSA."""
    return mavlink.MAVLink_authority_status_message(
        1, commander, 0, 251, epoch, 0, 2, 2, 0, **more, place_lat=526790000, place_lon=59240000, place=place.encode()
    )


# ---- the map ------------------------------------------------------------------------------------------------------


def test_without_a_map_nothing_is_looked_at(station: StationBench, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    looked: list[Any] = []
    monkeypatch.setattr(map_view, "mission_map", looked.append)
    station.load()
    station.run(3.0)
    assert looked == []


def test_a_map_gets_everything_once_and_then_what_changes(station: StationBench) -> None:  # noqa: F811
    host = load(station, "map")
    module = station.load()
    station.run(3.0)
    assert set(host.map.objects) >= ZONES
    assert {"handover 1 overlaps", "handover 1 route 251", "handover 1 handover 1"} <= set(host.map.objects)
    assert host.map.rows() == ["vehicle 1: NOT HEARD YET"]
    host.map.given.clear()
    station.run(5.0)
    assert set(host.map.given) == {"handover 1 plate"}, "only its time has changed"
    host.map.given.clear()
    station.hear(connect_message(digest=module.aircraft[0].mission_transfer.held.digest))
    station.hear(status(252, 2))
    station.run(1.0)
    assert set(host.map.given) == {
        *ZONES, "handover 1 name 252", "handover 1 return", "handover 1 plate",
    } - {"handover 1 zone 251"}  # fmt: skip
    assert host.map.objects["handover 1 zone 252"].item.width == 5
    assert host.map.rows() == ["CONTROL: GCSB", "a return goes to home"]
    assert module.faults == {}


def test_the_seconds_before_a_border_are_counted_each_second(station: StationBench) -> None:  # noqa: F811
    host = load(station, "map")
    module = station.load()
    station.hear(connect_message(digest=module.aircraft[0].mission_transfer.held.digest))
    station.hear(status())
    ahead = mavlink.MAVLink_handover_ahead_message(251, 190, 1, 251, 252, 1, 1, 20, 0, 0)
    station.hear(ahead)
    station.run(1.0)
    first = host.map.rows()[1]
    station.hear(ahead)
    station.run(3.0)
    assert first in ("GCSA -> GCSB in 20 s", "GCSA -> GCSB in 19 s")
    assert host.map.rows()[1] in ("GCSA -> GCSB in 18 s", "GCSA -> GCSB in 17 s")


def test_a_map_that_is_loaded_later_or_again_gets_everything(station: StationBench) -> None:  # noqa: F811
    station.load()
    station.run(3.0)
    first = load(station, "map")
    station.run(2.0)
    assert set(first.map.objects) >= ZONES
    close(station, first)
    station.run(2.0)
    again, other = load(station, "map"), load(station, "map2")
    station.run(2.0)
    assert set(again.map.objects) == set(other.map.objects) == set(first.map.objects)


def test_a_closed_window_is_given_nothing(station: StationBench) -> None:  # noqa: F811
    host = load(station, "map")
    host.map.alive = False
    station.load()
    station.run(3.0)
    assert host.map.given == []


def test_a_map_that_broke_while_it_was_loaded_is_none(station: StationBench) -> None:  # noqa: F811
    """MAVProxy leaves it among its public modules, half made."""
    station.mpstate.public_modules["map"] = object()
    module = station.load()
    station.run(3.0)
    assert module.faults == {}
    del station.mpstate.public_modules["map"]


def test_unload_takes_everything_back(station: StationBench) -> None:  # noqa: F811
    host, console = load(station, "map"), load(station, "console")
    station.load()
    station.run(3.0)
    assert host.map.objects
    assert (set(host.menus), set(console.menus)) == ({"Handover"}, {"Handover"})
    station.mpstate.unload("handover_gcs")
    assert (host.map.objects, host.menus, console.menus) == ({}, {}, {})
    assert station.mpstate.console.looks["HANDOVER"] == ("", "black", "white"), "nobody keeps it true any more"
    station.mpstate.modules.clear()


def test_a_map_that_breaks_is_one_fault_and_the_others_go_on(station: StationBench) -> None:  # noqa: F811
    broken, sound = load(station, "map"), load(station, "map2")
    broken.map.broken = True
    module = station.load()
    station.run(5.0)
    assert len(broken.map.given) == 1
    assert set(sound.map.objects) >= ZONES
    assert module.faults == {"map": 1}
    assert "handle is closed" in station.journal("fault")[0]["text"]


def test_a_mission_that_cannot_be_shown_is_one_fault(
    station: StationBench,  # noqa: F811
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def no_survey(_package: Any) -> Any:
        raise ArithmeticError("no room")

    monkeypatch.setattr(map_view, "mission_map", no_survey)
    host = load(station, "map")
    module = station.load()
    station.run(4.0)
    assert set(host.map.objects) == {"handover 1 plate"}
    assert module.faults == {"map": 1}
    assert station.journal("fault")[0]["text"] == "map: mission 'delivery' cannot be shown: ArithmeticError: no room"


def test_a_mission_that_the_vehicle_does_not_fly_is_not_shown(station: StationBench) -> None:  # noqa: F811
    host = load(station, "map")
    station.load()
    station.run(3.0)
    assert set(host.map.objects) >= ZONES
    other = mission_package.load(MISSIONS / "linear").digest
    station.hear(connect_message(digest=other))
    station.run(3.0)
    assert set(host.map.objects) == {"handover 1 plate"}


def test_a_route_that_was_changed_in_flight_is_taken_away(station: StationBench) -> None:  # noqa: F811
    host = load(station, "map")
    module = station.load()
    station.hear(connect_message(digest=module.aircraft[0].mission_transfer.held.digest))
    station.hear(status(route_changed=1))
    station.run(3.0)
    assert set(host.map.objects) >= ZONES
    assert not [key for key in host.map.objects if "route" in key or "handover 1 handover" in key]


def test_on_the_way_home_the_place_is_red(station: StationBench) -> None:  # noqa: F811
    host = load(station, "map")
    module = station.load()
    station.hear(connect_message(digest=module.aircraft[0].mission_transfer.held.digest))
    station.hear(status(0, place="rally 2"))
    station.hear(mavlink.MAVLink_heartbeat_message(2, 3, 129, 6, 4, 3), autopilot=True)
    station.run(1.0)
    assert host.map.objects["handover 1 return"].item.words == ("RETURNS TO rally 2",)
    assert host.map.rows() == ["NO COMMANDER - RTL", "returns to rally 2"]


# ---- the menus ----------------------------------------------------------------------------------------------------


def entries(menu: Any) -> dict[str, str]:
    found: dict[str, str] = {}
    for item in menu.items:
        if isinstance(item, mp_menu.MPMenuSubMenu):
            found |= {f"{item.name} {name}": key for name, key in entries(item).items()}
        else:
            found[item.name] = item.returnkey
    return found


def test_each_entry_types_what_the_operator_could_type(station: StationBench) -> None:  # noqa: F811
    console = load(station, "console")
    station.load()
    station.run(1.0)
    assert entries(console.menus["Handover"]) == {
        "Accept": "# handover accept",
        "Deny": "# handover deny",
        "Start": "# handover start",
        "Stop": "# handover stop",
        "Continue": "# handover continue",
        "Return": "# handover return",
        "Resume after a return": "# handover resume",
        "Request": "# handover request",
        "Give to GCSB": "# handover give GCSB",
        "Release": "# handover release",
        "Override for 60 s energy": "# handover override energy",
        "Override for 60 s fence": "# handover override fence",
        "Override for 60 s coverage": "# handover override coverage",
        "Payload request": "# handover payload request",
        "Payload request gimbal": "# handover payload request gimbal",
        "Payload request camera": "# handover payload request camera",
        "Payload request winch": "# handover payload request winch",
        "Payload release": "# handover payload release",
        "Payload release gimbal": "# handover payload release gimbal",
        "Payload release camera": "# handover payload release camera",
        "Payload release winch": "# handover payload release winch",
        "Acknowledge alarms": "# handover ack",
        "Briefing": "# handover briefing",
        "Telemetry": "# handover telemetry",
        "Share the mission": "# handover share",
        "Rehearse on the ground": "# handover rehearse",
        "Report of the rehearsal": "# handover rehearse report",
        "End rehearsal": "# handover rehearse end",
        "Addresses of the vehicle": "# handover connect",
        "Forget the vehicle's address": "# handover disconnect",
        "Operator on duty": "# handover operator",
        "Operator signs off": "# handover operator off",
        "Status": "# handover status",
    }
    for line in entries(console.menus["Handover"]).values():
        told = station.mpstate.type(line.removeprefix("# "))
        assert not any("unknown command" in each or "usage" in each for each in told), line


def test_what_the_consoles_menu_calls_waits_for_the_main_loop(station: StationBench) -> None:  # noqa: F811
    """MAVProxy's console has a thread for its menus, and the station's rules are not safe for threads."""
    station.load()
    station.run(1.0)
    station.sent()
    chosen = threading.Thread(target=lambda: station.mpstate.type("handover request"))
    chosen.start()
    chosen.join()
    assert station.commands() == []
    station.run(0.1)
    assert [command for command, _first in station.commands()] == [32100]


def test_menus_come_with_their_hosts_once(station: StationBench) -> None:  # noqa: F811
    station.load()
    station.run(2.0)
    console = load(station, "console")
    station.run(5.0)
    assert console.added == 1
    close(station, console)
    station.run(2.0)
    again = load(station, "console")
    station.run(2.0)
    assert (console.added, again.added) == (1, 1)


def test_a_menu_that_breaks_is_one_fault(station: StationBench) -> None:  # noqa: F811
    console = load(station, "console")
    console.broken = True
    module = station.load()
    station.run(5.0)
    assert module.faults == {"menu": 1}


def test_without_wx_there_are_no_menus(station: StationBench, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    monkeypatch.setattr(mp_util, "has_wxpython", False)
    console = load(station, "console")
    module = station.load()
    station.run(3.0)
    assert (console.added, module.faults) == (0, {})


def test_nothing_of_ours_asks_for_wx_but_what_runs_in_a_windows_own_process() -> None:
    folder = Path(map_view.__file__).parent
    texts = {path.name: path.read_text(encoding="utf-8") for path in folder.glob("*.py")}
    asking = [name for name, text in texts.items() if "import wx" in text or "wx_loader" in text]
    assert "map_view.py" in texts
    assert sorted(asking) == ["map_drawing.py", "window_title.py"]
