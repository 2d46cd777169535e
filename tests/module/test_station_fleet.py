# SPDX-License-Identifier: GPL-3.0-or-later

"""One station, several vehicles: whose each message and each word is, and that nothing of one reaches another."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from MAVProxy.modules.lib.mp_module import MPModule
from pymavlink.dialects.v20 import ardupilotmega as stock
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module import commands as station_commands
from gcs_module import fleet as station_fleet
from gcs_module import module as gcs_module
from mavproxy_handover.core.common.model import FlightAction, Phase, Reason
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.store.keys import key_of, write_key
from mavproxy_handover.wire.ids import PROBE_COMPID
from mavproxy_handover.wire.package_transfer import PackageSender
from mavproxy_handover.wire.vehicle_address import WAITING_LABEL, VehicleAddress, pack_addresses
from sitl.vehicles.ports import PortPicker
from tests.module.conftest import Clock
from tests.module.proxy import LinkModule, Master, MPState
from tests.module.test_station_module import START, Peer, heartbeat
from tests.module.vehicle import frames
from tests.packages import MISSIONS, ROUND

KEYS = {1: key_of("the-passphrase-of-drone-1"), 2: key_of("the-passphrase-of-drone-2")}


class Fleet:
    """GCSA's module with two vehicles on links of their own, and GCSB at the other end of the ground link."""

    def __init__(self, folder: Path, clock: Clock) -> None:
        self.clock, self.folder = clock, folder
        self.mpstate = MPState()
        self.links = {1: Master("drone-1", "127.0.0.1:14550"), 2: Master("drone-2", "127.0.0.1:14560")}
        self.mpstate.connect(*self.links.values())
        self.mpstate.settings.target_system = 1
        self.peer = Peer()
        self.listens = PortPicker().udp()
        self.config = folder / "station.toml"
        self.configure()
        self.module: Any = None

    def configure(self, consent: str = "automatic", second: str = "allow_unsigned = true", first: str = "") -> None:
        self.config.write_text(
            f"""
            [station]
            name = "GCSA"
            sysid = 251
            consent = "{consent}"
            [[vehicle]]
            name = "drone-1"
            sysid = 1
            links = ["udpin:127.0.0.1:14550"]
            {first or f'allow_unsigned = true; mission = "{ROUND}"'.replace("; ", chr(10))}
            [[vehicle]]
            name = "drone-2"
            sysid = 2
            links = ["udpin:127.0.0.1:14560"]
            {second}
            [ground]
            listen = "udpin:127.0.0.1:{self.listens}"
            allow_unsigned = true
            [[peer]]
            name = "GCSB"
            sysid = 252
            link = "udpout:127.0.0.1:{self.peer.port}"
            """
        )

    def load(self) -> Any:
        self.module = self.mpstate.load("handover_gcs", gcs_module, config=str(self.config))
        return self.module

    def hear(self, sysid: int, message: Any, *, component: int = 191, link: int | None = None) -> None:
        """A message of a vehicle, on its own link unless another one is named."""
        raw = message.pack(mavlink.MAVLink(None, srcSystem=sysid, srcComponent=component))
        self.mpstate.deliver(stock.MAVLink(None).decode(bytearray(raw)), self.links[sysid if link is None else link])

    def meet(self, commanders: tuple[int, int] = (251, 252)) -> None:
        """Both vehicles say who commands them, and what they are called."""
        for sysid, commander in enumerate(commanders, 1):
            self.hear(sysid, connect(sysid, commander))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            self.clock.now += 0.05
            self.mpstate.loop()

    def type(self, line: str) -> list[str]:
        return self.mpstate.type(line)

    def sent(self, sysid: int) -> list[Any]:
        """What has left by a vehicle's link since this was last asked."""
        written = self.links[sysid].written
        found = [message for data in written for message in frames(data)]
        written.clear()
        return found

    def commands(self, sysid: int) -> list[tuple[int, int]]:
        """What was commanded by its link: to whom, and what."""
        return [(m.target_system, m.command) for m in self.sent(sysid) if m.get_type() == "COMMAND_LONG"]

    def lines(self, about: str) -> list[str]:
        return [line for line in self.mpstate.console.lines if about in line]

    def journal(self, event: str) -> list[dict[str, Any]]:
        assert self.module.event_log.wait_until_written(10.0)
        lines = (self.folder / "GCSA.jsonl").read_text().splitlines()
        return [entry for entry in map(json.loads, lines) if entry["event"] == event]

    def ground(self, message: Any) -> None:
        """A message of GCSB over the ground link."""
        self.peer.socket.sendto(message.pack(self.peer.own), ("127.0.0.1", self.listens))
        self.run(0.1)

    def close(self) -> None:
        if self.mpstate.modules:
            self.mpstate.unload("handover_gcs")
        self.peer.socket.close()


def connect(sysid: int, commander: int, epoch: int = 1, digest: bytes = bytes(32), name: str = "") -> Any:
    called = (name or f"drone-{sysid}").encode()
    return mavlink.MAVLink_connect_message(251, 190, sysid, 251, 1, 7, epoch, commander, called, list(digest))


def status(phase: Phase, commander: int, zone: int = 251, epoch: int = 1) -> Any:
    return mavlink.MAVLink_authority_status_message(phase, commander, 0, zone, epoch, 0, 1, 2, 0, 0, 0)


def asked(sysid: int, handover_id: int = 3) -> Any:
    """GCSB is ready to take the vehicle from GCSA."""
    return mavlink.MAVLink_on_handover_message(251, 190, sysid, 251, 252, handover_id, 1, 0, Reason.ZONE, 0)


@pytest.fixture
def fleet(monkeypatch: pytest.MonkeyPatch, clock: Clock, tmp_path: Path) -> Iterator[Fleet]:
    for module in (gcs_module, station_commands, station_fleet):
        monkeypatch.setattr(module, "time", clock)
    bench = Fleet(tmp_path, clock)
    yield bench
    bench.close()
    assert bench.mpstate.escaped == []


class Watched(Master):
    """A link that counts how often it is asked whose it is."""

    asked = 0

    def __getattribute__(self, name: str) -> Any:
        if name == "label":
            Watched.asked += 1
        return super().__getattribute__(name)


def asked_in_a_round(fleet: Fleet, vehicles: int) -> int:
    """How often a station of so many vehicles asks a link whose it is, in one round of MAVProxy's main loop."""
    numbers = range(1, vehicles + 1)
    fleet.mpstate.connect(*(Watched(f"drone-{number}") for number in numbers))
    fleet.config.write_text(
        '[station]\nname = "GCSA"\nsysid = 251\n'
        + "".join(
            f'[[vehicle]]\nname = "drone-{number}"\nsysid = {number}\nlinks = ["udpin:127.0.0.1:{14550 + number}"]\n'
            "allow_unsigned = true\n"
            for number in numbers
        )
    )
    assert fleet.load() is not None
    fleet.run(0.5)
    Watched.asked = 0
    fleet.run(0.05)
    asked = Watched.asked
    fleet.mpstate.unload("handover_gcs")
    return asked


def test_a_round_costs_as_much_for_each_of_many_vehicles_as_for_each_of_few(fleet: Fleet) -> None:
    few, many = asked_in_a_round(fleet, 3), asked_in_a_round(fleet, 9)
    assert few > 0
    assert many <= 3 * few


def test_a_vehicles_own_work_does_not_grow_with_the_frames_of_the_others(
    fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each frame that comes is a round of MAVProxy's main loop."""
    assert fleet.load() is not None
    calls: list[int] = []
    idle = gcs_module.Aircraft.idle
    monkeypatch.setattr(
        gcs_module.Aircraft, "idle", lambda self, *rest: (calls.append(self.sysid), idle(self, *rest))[1]
    )
    fleet.run(0.1)
    assert [calls.count(sysid) for sysid in (1, 2)] == [2, 2], "where rounds are rare it has a turn in each"
    calls.clear()
    for _ in range(1000):
        fleet.clock.now += 0.001
        fleet.mpstate.loop()
    for sysid in (1, 2):
        assert 80 <= calls.count(sysid) <= 101


# ---- loading ------------------------------------------------------------------------------------------------------


def test_load_and_unload_give_the_links_and_the_command_back(fleet: Fleet) -> None:
    state = fleet.mpstate
    before = dict(state.command_map)
    callbacks = [link.mav.callback for link in fleet.links.values()]
    assert fleet.load() is not None, state.console.lines
    assert (
        f"handover_gcs {gcs_module.VERSION}: GCSA, drone-1, drone-2, configuration {fleet.config}"
        in state.console.lines
    )
    assert [link.mav.callback for link in fleet.links.values()] != callbacks
    assert state.settings.vehicle_name == "drone-1"
    state.unload("handover_gcs")
    assert state.settings.vehicle_name == ""
    assert state.command_map == before
    assert [link.mav.callback for link in fleet.links.values()] == callbacks
    assert all("send" not in vars(link.mav) for link in fleet.links.values())


def test_a_fault_while_loading_gives_them_back_too(fleet: Fleet, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_arguments: Any) -> None:
        raise RuntimeError("a bug")

    before = dict(fleet.mpstate.command_map)
    with monkeypatch.context() as patch:
        patch.setattr(gcs_module.Aircraft, "begin", broken)
        assert fleet.load() is None
    assert fleet.mpstate.command_map == before
    assert all("send" not in vars(link.mav) for link in fleet.links.values())
    assert fleet.load() is not None


def test_two_vehicles_of_one_key_are_refused(fleet: Fleet) -> None:
    for sysid in (1, 2):
        write_key(fleet.folder / f"{sysid}.key", KEYS[1])
    fleet.configure(first='key = "1.key"', second='key = "2.key"')
    assert fleet.load() is None
    assert fleet.mpstate.console.lines == [
        "handover_gcs is not loaded: drone-1 and drone-2 have the same key: what is sent to one could be played to the "
        "other; each vehicle needs one of its own"
    ]


def test_a_link_that_is_nobodys_is_told(fleet: Fleet) -> None:
    stray = Master(None, "/dev/ttyUSB9")
    fleet.mpstate.connect(*fleet.links.values(), stray)
    fleet.load()
    fleet.run(3.0)
    told = "Link 3 (/dev/ttyUSB9) is no vehicle's: its label names none of drone-1, drone-2."
    assert len(fleet.lines(told)) == 1


# ---- whose a message is -------------------------------------------------------------------------------------------


def test_each_vehicle_is_answered_on_its_own_link_and_believed_of_itself(fleet: Fleet) -> None:
    fleet.load()
    fleet.meet()
    assert [[m.commander for m in fleet.sent(n) if m.get_type() == "CONNECT_ACK"] for n in (1, 2)] == [[251], [252]]
    assert [each.core.role.value for each in fleet.module.aircraft] == ["commander", "observer"]
    assert len(fleet.lines("[drone-1 ONLOAD]: I have drone-1: GCSA is the commander now, epoch 1.")) == 1
    assert len(fleet.lines("[drone-2 ONLOAD]: GCSB commands, epoch 1.")) == 1


def test_what_speaks_as_one_vehicle_on_the_link_of_another_is_not_heard(fleet: Fleet) -> None:
    """Two aircraft that were left at system id 1 would be taken for one."""
    fleet.load()
    fleet.hear(1, connect(1, 252), link=2)
    fleet.hear(1, heartbeat(armed=True), component=1, link=2)
    assert fleet.module.aircraft[0].core.epoch == 0
    assert fleet.sent(1) == fleet.sent(2) == []
    told = "Another program speaks as drone-1 on the link of drone-2: not heard. Is a system id given twice?"
    assert len(fleet.lines(told)) == 1
    assert [entry["text"] for entry in fleet.journal("link")] == [told]
    assert fleet.module.faults == {"drone-1: frame on a link of another": 2}
    fleet.hear(1, connect(1, 251))
    assert fleet.module.aircraft[0].core.epoch == 1


def test_what_is_no_vehicle_of_ours_reaches_mavproxy_by_any_link(fleet: Fleet) -> None:
    heard: list[int] = []
    fleet.mpstate.modules.append(
        (SimpleNamespace(name="map", mavlink_packet=lambda m: heard.append(m.get_srcSystem())), gcs_module)
    )  # type: ignore[arg-type]
    fleet.load()
    fleet.links[9] = fleet.links[2]
    fleet.hear(9, heartbeat(armed=False), component=1)
    fleet.hear(1, heartbeat(armed=False), component=1, link=2)
    fleet.mpstate.modules.pop(0)
    assert heard == [9]


def test_with_keys_each_vehicle_has_its_own(fleet: Fleet) -> None:
    for sysid in (1, 2):
        write_key(fleet.folder / f"{sysid}.key", KEYS[sysid])
    fleet.configure(first='key = "1.key"', second='key = "2.key"')
    fleet.load()
    assert [fleet.links[sysid].mav.signing.secret_key for sysid in (1, 2)] == [KEYS[1], KEYS[2]]
    fleet.hear(1, connect(1, 251))
    assert fleet.module.aircraft[0].core.epoch == 0, "unsigned"
    assert [where for where in fleet.module.faults if where.startswith("drone-1: ")] != []
    fleet.mpstate.unload("handover_gcs")
    assert [fleet.links[sysid].mav.signing.secret_key for sysid in (1, 2)] == [None, None]


def test_a_fault_in_one_vehicles_part_leaves_the_other_alone(fleet: Fleet, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_arguments: Any, **_values: Any) -> None:
        raise RuntimeError("a bug")

    fleet.load()
    fleet.meet()
    first = fleet.module.aircraft[0]
    with monkeypatch.context() as patch:
        for name in ("handle", "tick"):
            patch.setattr(first.core, name, broken)
        patch.setattr(first.event_log, "repeat_alarms", broken)
        patch.setattr(first.view, "status", broken)
        fleet.hear(1, asked(1))
        fleet.hear(2, connect(2, 251, epoch=2))
        fleet.hear(2, asked(2))
        fleet.ground(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        fleet.run(2.0)
    assert "HANDOVER drone-2" in fleet.mpstate.console.statuses
    assert fleet.module.aircraft[1].core.peer_alive(252, fleet.clock.now)
    assert len(fleet.lines("I have drone-2")) == 1
    assert any(where.startswith("drone-1") or "drone-1" in where for where in fleet.module.faults)
    assert [m.get_type() for m in fleet.peer.received()].count("HEARTBEAT") >= 2


# ---- what is seen and heard ---------------------------------------------------------------------------------------


def test_alarms_name_the_aircraft_in_line_speech_and_status_row(fleet: Fleet) -> None:
    fleet.load()
    fleet.meet((251, 251))
    fleet.hear(2, status(Phase.ON_MISSION, 251))
    fleet.mpstate.modules.append((MPModule(fleet.mpstate, "speech"), gcs_module))
    decision = mavlink.MAVLink_handover_decision_message(
        1, FlightAction.RETURN, 5, b"home", b"Battery is low", b"RETURN to home. Battery is low"
    )
    fleet.hear(2, decision)
    fleet.run(12.0)
    fleet.mpstate.modules.pop()
    lines = fleet.lines("EMERGENCY: RETURN to home. Battery is low.")
    assert len(lines) == 2, "said again"
    assert all("[drone-2 ONMISSION" in line for line in lines)
    spoken = [text for text in fleet.mpstate.spoken if "Battery is low" in text]
    assert spoken
    assert all(text.startswith("drone-2: ") for text in spoken)
    statuses = fleet.mpstate.console.statuses
    assert set(statuses) >= {"HANDOVER drone-1", "HANDOVER drone-2"}
    assert all(text.startswith(f"{name.split()[1]}: ") for name, text in statuses.items() if "drone" in name)


def test_an_acknowledgement_is_for_all_or_for_one(fleet: Fleet) -> None:
    fleet.load()
    fleet.meet()
    fleet.run(6.5)  # neither is heard any more
    assert [len(each.event_log.alarms.standing) for each in fleet.module.aircraft] == [1, 1]
    (line,) = fleet.type("handover -v drone-2 ack")
    assert line == "drone-2: acknowledged: drone-2 is not heard any more."
    assert [each.event_log.alarms.standing[0].acknowledged for each in fleet.module.aircraft] == [False, True]
    assert fleet.type("handover ack") == [
        "drone-1: acknowledged: drone-1 is not heard any more.",
        "drone-2: no alarm to acknowledge",
    ]


def test_another_station_is_said_to_be_there_once(fleet: Fleet) -> None:
    fleet.load()
    fleet.ground(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    (line,) = fleet.lines("Ground link to GCSB is up.")
    assert "drone" not in line
    assert [entry.get("vehicle") for entry in fleet.journal("peer")] == [None]
    fleet.run(5.0)
    assert len(fleet.lines("Ground link to GCSB is down.")) == 1


def test_the_journal_says_of_which_vehicle(fleet: Fleet) -> None:
    fleet.load()
    fleet.meet((251, 251))
    assert [entry["vehicle"] for entry in fleet.journal("control_gained")] == ["drone-1", "drone-2"]


def test_a_vehicle_that_calls_itself_otherwise_is_told_once(fleet: Fleet) -> None:
    fleet.load()
    for _ in range(3):
        fleet.hear(2, connect(2, 251, name="albatross"))
        fleet.run(1.1)
    said = "The vehicle calls itself 'albatross', this station's file 'drone-2'. Check that it is the right one."
    assert len(fleet.lines(f"[drone-2 ONLOAD]: {said}")) == 1


def test_grave_texts_of_the_autopilot_that_mavproxy_does_not_show_are_shown(fleet: Fleet) -> None:
    """MAVProxy shows the texts of the chosen vehicle alone."""
    fleet.load()
    fleet.meet()
    for sysid in (1, 2):
        fleet.hear(sysid, mavlink.MAVLink_statustext_message(4, b"EKF variance"), component=1)
        fleet.hear(sysid, mavlink.MAVLink_statustext_message(6, b"Mission: 3 WP"), component=1)
    fleet.run(1.0)
    (line,) = fleet.lines("EKF variance")
    assert "[drone-2 " in line
    assert fleet.lines("Mission: 3 WP") == []


def test_the_same_words_of_two_companions_are_told_of_both(fleet: Fleet) -> None:
    """What MAVProxy has shown last may be the chosen vehicle's: of another one it has shown nothing."""
    fleet.load()
    fleet.meet()
    fleet.mpstate.status.last_apm_msg = "Wind is strong"
    for sysid in (1, 2):
        fleet.hear(sysid, mavlink.MAVLink_statustext_message(4, b"Wind is strong"))
    fleet.run(1.0)
    (line,) = fleet.lines("Wind is strong")
    assert "[drone-2 " in line


# ---- what is typed ------------------------------------------------------------------------------------------------


def test_a_command_is_for_the_vehicle_that_mavproxy_has_chosen(fleet: Fleet) -> None:
    fleet.load()
    fleet.type("handover start")
    assert (fleet.commands(1), fleet.commands(2)) == ([(1, START)], [])
    fleet.type("vehicle 2")
    fleet.type("handover start")
    assert (fleet.commands(1), fleet.commands(2)) == ([], [(2, START)])


@pytest.mark.parametrize("name", ["drone-2", "2"])
def test_a_command_may_name_its_vehicle(fleet: Fleet, name: str) -> None:
    fleet.load()
    fleet.type(f"handover -v {name} start")
    assert (fleet.commands(1), fleet.commands(2)) == ([], [(2, START)])
    assert [entry["vehicle"] for entry in fleet.journal("command")] == ["drone-2"]


@pytest.mark.parametrize("words", ["start", "request", "give GCSB", "accept", "release", "share", "telemetry"])
def test_without_a_choice_a_command_is_refused_with_the_names(fleet: Fleet, words: str) -> None:
    fleet.mpstate.settings.target_system = 0
    fleet.load()
    assert fleet.type(f"handover {words}") == [
        f"handover {words}: for which vehicle? MAVProxy's choice (0) is none of drone-1 (1), drone-2 (2): "
        f"'vehicle NAME' chooses one, or 'handover -v NAME {words}'"
    ]
    assert (fleet.sent(1), fleet.sent(2)) == ([], [])


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        ("-v", "handover -v: which vehicle?; there are drone-1 (1), drone-2 (2)"),
        ("-v drone-3 start", "handover -v: no vehicle 'drone-3'; there are drone-1 (1), drone-2 (2)"),
        ("-v drone-1", "handover -v drone-1: what?; 'handover help' lists them"),
        ("-v drone-1 strat", "handover -v drone-1: no command 'strat'; 'handover help' lists them"),
        (
            "-v drone-1 -v drone-2 start",
            "handover -v drone-1: no command '-v drone-2 start'; 'handover help' lists them",
        ),
    ],
)
def test_odd_names_are_one_line(fleet: Fleet, words: str, answer: str) -> None:
    fleet.load()
    assert fleet.type(f"handover {words}") == [answer]
    assert (fleet.sent(1), fleet.sent(2)) == ([], [])


def test_help_says_how_to_name_a_vehicle_and_settings_are_the_stations(fleet: Fleet) -> None:
    fleet.load()
    assert fleet.type("handover help")[-1] == (
        "  -v NAME   before the others: for this vehicle; there are drone-1 (1), drone-2 (2)"
    )
    fleet.type("handover set telemetry 3")
    assert [each.commands.settings.telemetry for each in fleet.module.aircraft] == [3.0, 3.0]
    assert fleet.mpstate.completions["handover"][-1] == "-v <drone-1|drone-2>"


def test_each_operators_question_is_its_own(fleet: Fleet) -> None:
    fleet.configure(consent="operator")
    fleet.load()
    fleet.meet((251, 251))
    for sysid in (1, 2):
        fleet.hear(sysid, asked(sysid))
        fleet.sent(sysid)
    assert len(fleet.lines("[drone-2 ONLOAD]: WARNING: GCSB is ready to take drone-2")) == 1
    fleet.type("handover -v drone-2 accept")
    assert [m.consent for m in fleet.sent(2) if m.get_type() == "OK_HANDOVER"] == [0]
    assert fleet.sent(1) == []
    assert fleet.module.aircraft[0].core.question is not None


def test_what_may_be_typed_is_said_with_the_name(fleet: Fleet) -> None:
    """Whichever is chosen, what the line says is what answers it."""
    fleet.configure(consent="operator")
    fleet.load()
    fleet.meet((251, 251))
    fleet.hear(2, asked(2))
    (line,) = fleet.lines("is ready to take drone-2")
    assert line.endswith("Type 'handover -v drone-2 accept' or 'handover -v drone-2 deny'.")
    assert fleet.type("handover accept") == [
        "handover accept: the question is about drone-2: 'handover -v drone-2 accept'"
    ]
    assert fleet.module.aircraft[1].core.question is not None
    fleet.hear(1, asked(1))
    fleet.type("handover accept")
    assert [each.core.question is None for each in fleet.module.aircraft] == [True, False], "both ask: the chosen one's"


def test_an_operator_who_is_asked_beforehand_is_told_about_which_too(fleet: Fleet) -> None:
    fleet.configure(consent="operator")
    fleet.load()
    fleet.meet((251, 252))
    ahead = mavlink.MAVLink_handover_ahead_message(251, 190, 2, 252, 251, 1, 1, 20, 0, 0)
    fleet.hear(2, status(Phase.ON_MISSION, 252))
    fleet.hear(2, ahead)
    assert fleet.module.aircraft[1].core.asked_ahead is not None
    assert fleet.type("handover deny") == ["handover deny: the question is about drone-2: 'handover -v drone-2 deny'"]
    fleet.type("handover -v drone-2 accept")
    assert "OK_AHEAD" in [m.get_type() for m in fleet.sent(2)]
    assert "OK_AHEAD" not in [m.get_type() for m in fleet.sent(1)]


def test_a_station_with_one_named_vehicle_takes_its_name_and_shows_nothing_of_it(fleet: Fleet) -> None:
    text = fleet.config.read_text()
    second = text[text.index("[[vehicle]]", text.index("[[vehicle]]") + 1) : text.index("[ground]")]
    fleet.config.write_text(text.replace(second, ""))
    fleet.mpstate.connect(fleet.links[1])
    fleet.load()
    fleet.hear(1, connect(1, 251))
    assert len(fleet.lines("|GCSA][ONLOAD]: I have drone-1: GCSA is the commander now, epoch 1.")) == 1
    fleet.type("handover -v drone-1 start")
    assert fleet.commands(1) == [(1, START)]
    assert fleet.type("handover status")[0] == "vehicle   connected, ON_LOAD"
    assert "send" not in vars(fleet.links[1].mav)
    assert "vehicle" not in fleet.journal("control_gained")[0]


def test_status_is_a_table_and_of_one_vehicle_all_there_is(fleet: Fleet) -> None:
    fleet.load()
    fleet.meet()
    fleet.hear(1, status(Phase.ON_MISSION, 251))
    fleet.hear(1, mavlink.MAVLink_heartbeat_message(2, 3, 129, 3, 4, 3), component=1)
    fleet.run(0.1)
    assert fleet.type("handover status") == [
        "  vehicle commander  phase           zone links  alarms heard",
        "* drone-1 GCSA (you) ON_MISSION AUTO GCSA 1 of 1 none   now",
        "  drone-2 GCSB       ON_LOAD         none 1 of 1 none   now",
        "ground    GCSB: down",
    ]
    assert fleet.type("handover -v drone-2 status")[:2] == [
        "vehicle   drone-2: connected, ON_LOAD",
        "commander GCSB, epoch 1; this station is observer",
    ]


def test_the_table_says_what_is_old_what_is_wrong_and_who_is_asked(fleet: Fleet) -> None:
    fleet.load()
    fleet.meet()
    fleet.links[2].linkerror = True
    fleet.run(12.0)
    header, _first, second, *rest = fleet.type("handover status")
    assert header.split() == ["vehicle", "commander", "phase", "zone", "links", "alarms", "heard"]
    assert second.split() == ["drone-2", "GCSB", "ON_LOAD", "none", "0", "of", "1", "1", "WARNING", "12", "s", "old"]
    assert "alarm     drone-1: WARNING: drone-1 is not heard any more." in rest


def telemetry(lat_e7: int, battery: int) -> Any:
    values = dict.fromkeys(mavlink.MAVLink_handover_telemetry_message.fieldnames, 0)
    values |= {"lat": lat_e7, "battery_remaining": battery, "zone": 251, "target_system": 251}
    return mavlink.MAVLink_handover_telemetry_message(**values)


def test_each_vehicles_telemetry_is_its_own(fleet: Fleet) -> None:
    fleet.load()
    fleet.meet()
    fleet.hear(1, telemetry(526_000_000, 91))
    fleet.hear(2, telemetry(527_000_000, 42))
    for sysid, percent in ((1, 91), (2, 42)):
        rows = fleet.type(f"handover -v {sysid} telemetry")
        assert rows[0] == f"vehicle   drone-{sysid}"
        assert f"          {percent} % left" in rows
    assert [entry["vehicle"] for entry in fleet.journal("telemetry")] == ["drone-1", "drone-2"]
    assert len(fleet.lines("[drone-2 ONLOAD]: 52.700000")) == 1


def test_an_observed_vehicle_is_asked_for_and_the_commanded_one_is_not_touched(fleet: Fleet) -> None:
    fleet.load()
    fleet.meet((251, 252))
    fleet.sent(1)
    fleet.type("handover -v drone-2 request")
    fleet.run(0.1)
    assert fleet.commands(2) == [(2, mavlink.MAV_CMD_REQUEST_OPERATOR_CONTROL)]
    assert fleet.commands(1) == []
    denied = mavlink.MAVLink_command_ack_message(32100, mavlink.MAV_RESULT_DENIED, 0, 0, 251, 190)
    fleet.hear(1, denied)
    fleet.run(0.6)
    assert fleet.journal("command")[-1].get("result") is None, "the answer of another vehicle is none"
    fleet.hear(2, denied)
    fleet.run(0.6)
    assert (fleet.journal("command")[-1]["result"], fleet.journal("command")[-1]["vehicle"]) == ("denied", "drone-2")


# ---- MAVProxy's own commands --------------------------------------------------------------------------------------


def mode(target: int) -> Any:
    return mavlink.MAVLink_command_long_message(target, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, 6, 0, 0, 0, 0, 0)


def test_what_is_for_a_vehicle_leaves_by_its_link_whatever_link_is_set(fleet: Fleet) -> None:
    """Right behind `vehicle 2` MAVProxy may have the first link set still: it sets that where nothing was heard yet."""
    fleet.load()
    fleet.mpstate.settings.target_system, fleet.mpstate.settings.link = 2, 1
    fleet.mpstate.master().mav.send(mode(2))  # type: ignore[union-attr]
    assert (fleet.commands(1), fleet.commands(2)) == ([], [(2, mavlink.MAV_CMD_DO_SET_MODE)])


def test_what_is_for_everybody_leaves_by_the_link_that_is_set(fleet: Fleet) -> None:
    fleet.load()
    fleet.mpstate.master().mav.send(mode(0))  # type: ignore[union-attr]
    assert fleet.commands(1) == [(0, mavlink.MAV_CMD_DO_SET_MODE)]
    assert fleet.commands(2) == []


def test_without_a_link_of_its_own_nothing_is_sent_to_a_vehicle(fleet: Fleet) -> None:
    fleet.load()
    fleet.mpstate.mav_master.pop()
    fleet.mpstate.master().mav.send(mode(2))  # type: ignore[union-attr]
    fleet.type("handover -v drone-2 start")
    assert fleet.commands(1) == []
    assert len(fleet.lines("drone-2 has no link: what is meant for it is not sent.")) == 1


def test_the_link_that_is_set_is_the_chosen_vehicles(fleet: Fleet) -> None:
    fleet.load()
    fleet.type("vehicle 2")
    assert fleet.mpstate.settings.link == 2
    fleet.mpstate.settings.target_system = 1  # `set target_system 1`
    fleet.run(0.05)
    assert fleet.mpstate.settings.link == 1


def test_a_vehicle_is_chosen_by_name_and_stands_in_the_prompt(fleet: Fleet) -> None:
    fleet.load()
    assert fleet.mpstate.prompts[-1] == "drone-1:MAV> "
    fleet.hear(2, heartbeat(armed=True), component=1)
    assert fleet.type("vehicle drone-2") == []
    assert fleet.mpstate.settings.target_system == 2
    assert fleet.mpstate.prompts[-1].startswith("drone-2:")
    assert fleet.mpstate.settings.vehicle_name == "drone-2", "MAVProxy's next prompt has it too"
    assert fleet.type("vehicle albatross") == ["vehicle: no vehicle 'albatross'; there are drone-1 (1), drone-2 (2)"]
    fleet.type("vehicle 9")
    assert fleet.mpstate.settings.target_system == 9


def sticks(target: int, throttle: int) -> Any:
    return mavlink.MAVLink_rc_channels_override_message(target, 0, 0, 0, throttle, 0, 0, 0, 0, 0)


def test_sticks_stay_behind_when_another_vehicle_is_chosen(fleet: Fleet) -> None:
    """MAVProxy repeats `rc 3 1200` to whoever is chosen: the other aircraft would be flown by it."""
    rc = SimpleNamespace(override=[0, 0, 1200] + [0] * 15)
    fleet.mpstate.public_modules["rc"] = rc
    fleet.load()
    assert rc.override[2] == 1200, "of the vehicle that is chosen already"
    fleet.sent(1)
    fleet.type("vehicle drone-2")
    assert rc.override == [0] * 18
    (released,) = [m for m in fleet.sent(1) if m.get_type() == "RC_CHANNELS_OVERRIDE"]
    assert (released.target_system, released.chan3_raw) == (1, 0)
    assert len(fleet.lines("[drone-1 ONLOAD]: Its sticks are let go of: another vehicle is chosen.")) == 1
    fleet.mpstate.public_modules.pop("rc")


def test_sticks_do_not_run_ahead_of_a_choice_that_was_not_noticed_yet(fleet: Fleet) -> None:
    fleet.load()
    fleet.mpstate.settings.target_system = 2
    fleet.mpstate.master().mav.send(sticks(2, 1200))  # type: ignore[union-attr]
    fleet.mpstate.master().mav.send(sticks(2, 0))  # type: ignore[union-attr]
    assert [m.chan3_raw for m in fleet.sent(2)] == [0], "given back they may be"
    fleet.run(0.05)
    fleet.mpstate.master().mav.send(sticks(2, 1300))  # type: ignore[union-attr]
    assert [m.chan3_raw for m in fleet.sent(2) if m.get_type() == "RC_CHANNELS_OVERRIDE"] == [1300]


def test_a_vehicle_with_two_links_is_followed_on_its_own_ones(fleet: Fleet) -> None:
    """The busiest of all links may be another vehicle's."""
    wifi, lte = Master("drone-1/1", "wifi"), Master("drone-1/2", "lte")
    fleet.links = {1: wifi, 2: Master("drone-2", "other")}
    fleet.mpstate.connect(wifi, fleet.links[2], lte)
    fleet.load()
    for _ in range(40):
        fleet.links[2].mav.total_packets_received += 20
        lte.mav.total_packets_received += 5
        fleet.run(0.05)
    fleet.type("handover start")
    assert fleet.mpstate.settings.link == 3
    assert [m.command for data in lte.written for m in frames(data) if m.get_type() == "COMMAND_LONG"] == [START]
    assert fleet.commands(2) == []
    assert [entry["vehicle"] for entry in fleet.journal("link")] == ["drone-1"]


# ---- the ground link ----------------------------------------------------------------------------------------------


def test_a_word_of_another_station_counts_for_the_vehicle_that_it_names(fleet: Fleet) -> None:
    fleet.load()
    fleet.meet((251, 251))
    for sysid in (1, 2):
        fleet.hear(sysid, asked(sysid))
        fleet.sent(sysid)
    fleet.ground(mavlink.MAVLink_drone_connected_message(251, 190, 2, 251, 252, 3, 1, 0))
    assert [m.get_type() for m in fleet.sent(2)] == ["DISCONNECT_HANDOVER"]
    assert [m.get_type() for m in fleet.sent(1) if m.get_type() != "HEARTBEAT"] == []
    fleet.ground(mavlink.MAVLink_drone_connected_message(251, 190, 3, 251, 252, 3, 1, 0))
    assert fleet.module.faults["ground frame of another vehicle"] == 1


def test_packages_for_two_vehicles_come_side_by_side(fleet: Fleet, delivery: MissionPackage) -> None:
    """One package at a time is received of a station, for each vehicle."""
    linear = mission_package.load(MISSIONS / "linear")
    fleet.configure(first="allow_unsigned = true")
    fleet.load()
    senders = {
        number: PackageSender(package.to_bytes(), package.digest, package.name, (251, 0))
        for number, package in ((1, delivery), (2, linear))
    }
    for _ in range(400):
        outgoing = [(number, message) for number, sender in senders.items() for message in sender.tick(fleet.clock.now)]
        for message in fleet.peer.received():
            if message.get_type() == "MISSION_PACKAGE_ACK":
                number = message.vehicle
                outgoing += [(number, answer) for answer in senders[number].on_ack(message, fleet.clock.now)]
        for number, message in outgoing:
            message.vehicle = number
            fleet.peer.socket.sendto(message.pack(fleet.peer.own), ("127.0.0.1", fleet.listens))
        fleet.run(0.05)
        if all(sender.finished for sender in senders.values()):
            break
    assert [sender.result for sender in senders.values()] == [mavlink.HANDOVER_PACKAGE_RESULT_RECEIVED] * 2
    fleet.hear(1, connect(1, 252, digest=delivery.digest))
    fleet.hear(2, connect(2, 252, digest=linear.digest))
    fleet.run(0.1)
    assert [each.mission_transfer.held.name for each in fleet.module.aircraft] == ["delivery", "linear"]
    assert [each.core.digest for each in fleet.module.aircraft] == [delivery.digest, linear.digest]


@pytest.mark.parametrize(
    ("vehicle", "why"), [(0, "it does not say for which vehicle"), (3, "vehicle 3 is not one of this station's")]
)
def test_a_package_of_nobodys_is_refused(fleet: Fleet, delivery: MissionPackage, vehicle: int, why: str) -> None:
    fleet.load()
    offer = mavlink.MAVLink_mission_package_message(251, 0, 100, list(delivery.digest), b"delivery", vehicle)
    fleet.ground(offer)
    (answer,) = [m for m in fleet.peer.received() if m.get_type() == "MISSION_PACKAGE_ACK"]
    assert (answer.result, answer.text) == (mavlink.HANDOVER_PACKAGE_RESULT_REFUSED, why)


def test_a_package_is_shared_under_its_vehicles_number(fleet: Fleet) -> None:
    fleet.load()
    fleet.type("handover share")
    fleet.run(0.2)
    offers = [m for m in fleet.peer.received() if m.get_type() == "MISSION_PACKAGE"]
    assert [offer.vehicle for offer in offers] == [1]
    assert [m.vehicle for m in fleet.sent(1) if m.get_type() == "MISSION_PACKAGE"] == [0], "it knows who it is"
    assert [m for m in fleet.sent(2) if m.get_type() == "MISSION_PACKAGE"] == []
    (line,) = fleet.type("handover -v drone-2 share")
    assert line.endswith("[drone-2 ONLOAD]: There is no mission to share: set mission in its [[vehicle]].")


# ---- links that change --------------------------------------------------------------------------------------------


@pytest.fixture
def two_links(fleet: Fleet) -> list[Master]:
    """The first vehicle has two links, and the second one's is between them in MAVProxy's list."""
    own = [Master("drone-1/1", "wifi"), Master("drone-1/2", "lte")]
    fleet.links = {1: own[0], 2: Master("drone-2", "other")}
    fleet.mpstate.connect(own[0], fleet.links[2], own[1])
    fleet.load()
    return own


def starts(links: list[Master]) -> list[int]:
    """How often START left by each of them, since this was last asked."""
    found = [sum(m.get_type() == "COMMAND_LONG" for data in link.written for m in frames(data)) for link in links]
    for link in links:
        link.written.clear()
    return found


def test_the_vehicle_that_is_not_chosen_is_followed_too(fleet: Fleet, two_links: list[Master]) -> None:
    fleet.type("vehicle drone-2")
    for _ in range(40):
        two_links[1].mav.total_packets_received += 5
        fleet.run(0.05)
    fleet.type("handover -v drone-1 start")
    assert starts(two_links) == [0, 1]
    assert fleet.mpstate.settings.link == 2, "the link that is set is the chosen vehicle's"


def test_the_operators_choice_among_a_vehicles_links_stands(fleet: Fleet, two_links: list[Master]) -> None:
    fleet.mpstate.settings.link = 3
    fleet.run(0.1)
    assert fleet.mpstate.settings.link == 3
    fleet.type("vehicle drone-2")
    fleet.type("handover -v drone-1 start")
    assert starts(two_links) == [0, 1]


def test_a_link_of_another_vehicle_cannot_be_set(fleet: Fleet, two_links: list[Master]) -> None:
    fleet.mpstate.settings.link = 2
    fleet.run(0.05)
    assert fleet.mpstate.settings.link == 1


def test_a_link_that_is_down_is_left(fleet: Fleet, two_links: list[Master]) -> None:
    two_links[0].linkerror = True
    fleet.type("handover start")
    assert starts(two_links) == [0, 1]
    two_links[1].linkerror = True
    fleet.type("handover -v drone-1 stop")
    assert starts(two_links) == [1, 0], "better than none"


def test_a_link_that_is_made_anew_is_watched_again(fleet: Fleet) -> None:
    """pymavlink makes another MAVLink when it switches to version 2, and keeps the callback."""
    fleet.load()
    old = fleet.links[2].mav
    fleet.links[2].mav = new = stock.MAVLink(fleet.links[2], srcSystem=255, srcComponent=230)
    new.callback, new.callback_args, new.callback_kwargs = old.callback, old.callback_args, old.callback_kwargs
    fleet.run(1.1)
    fleet.hear(1, connect(1, 252), link=2)
    assert fleet.module.aircraft[0].core.epoch == 0
    fleet.hear(2, connect(2, 252))
    assert [m.get_type() for m in fleet.sent(2)].count("CONNECT_ACK") == 1
    new.send(mode(1))
    assert (fleet.commands(1), fleet.commands(2)) == ([(1, mavlink.MAV_CMD_DO_SET_MODE)], [])
    fleet.mpstate.unload("handover_gcs")
    assert "send" not in vars(new)
    assert not isinstance(new.callback, partial)


def test_to_look_after_links_for_hours_leaves_one_watch_on_each(fleet: Fleet) -> None:
    fleet.load()
    for _ in range(1500):
        fleet.module.links.refresh()
    fleet.type("handover start")
    assert fleet.commands(1) == [(1, START)]


def test_a_probe_is_answered_on_the_vehicles_own_links(fleet: Fleet) -> None:
    fleet.load()
    probe = mavlink.MAVLink_timesync_message(0, 7_000)
    fleet.hear(2, probe, component=PROBE_COMPID)
    assert [m.get_type() for m in fleet.sent(2)] == ["TIMESYNC"]
    assert fleet.sent(1) == []


def test_sticks_that_are_set_for_the_new_vehicle_stay(fleet: Fleet) -> None:
    rc = SimpleNamespace(override=[0] * 18)
    fleet.mpstate.public_modules["rc"] = rc
    fleet.load()
    fleet.type("vehicle drone-2")
    rc.override = [0, 0, 1300] + [0] * 15
    fleet.run(0.2)
    assert rc.override[2] == 1300
    fleet.mpstate.public_modules.pop("rc")


def test_the_status_row_says_who_commands_which(fleet: Fleet) -> None:
    fleet.load()
    fleet.meet()
    fleet.run(1.1)
    statuses = fleet.mpstate.console.statuses
    assert statuses["HANDOVER drone-1"] == "drone-1: CONTROL: GCSA (you)"
    assert statuses["HANDOVER drone-2"] == "drone-2: CONTROL: GCSB"


def test_what_is_wrong_with_a_link_is_heard(fleet: Fleet, capsys: pytest.CaptureFixture[str]) -> None:
    fleet.load()
    capsys.readouterr()
    fleet.hear(1, connect(1, 252), link=2)
    assert "\a" in capsys.readouterr().out


def test_an_answer_of_a_station_of_an_older_version_is_its_packages(fleet: Fleet, delivery: MissionPackage) -> None:
    """It does not say for which vehicle it is."""
    fleet.load()
    fleet.type("handover share")
    fleet.run(0.2)
    fleet.peer.received()
    wants = mavlink.HANDOVER_PACKAGE_RESULT_RECEIVING
    short = int.from_bytes(delivery.digest[:4], "little")
    fleet.ground(mavlink.MAVLink_mission_package_ack_message(251, 0, short, 0, wants, b""))
    assert "MISSION_CHUNK" in [m.get_type() for m in fleet.peer.received()]


def test_two_vehicles_never_ask_about_addresses_by_the_same_number(fleet: Fleet) -> None:
    """What is typed is for the vehicle that is chosen, whichever the operator has read about."""
    fleet.mpstate.mav_master[:] = [Master(WAITING_LABEL, "127.0.0.1:0")]
    link = LinkModule(fleet.mpstate)
    fleet.mpstate.public_modules["link"] = link
    fleet.load()
    fleet.run(2.0)
    for vehicle in (1, 2):
        packed = list(pack_addresses({251: (VehicleAddress(f"10.0.0.{vehicle}", 14551),)}).ljust(176, b"\0"))
        digest = [vehicle] * 32
        fleet.ground(mavlink.MAVLink_mission_package_message(251, 0, 400, digest, b"delivery", vehicle, packed))
    fleet.run(2.0)
    (line,) = fleet.lines("GCSB sends the vehicle's address udpout:10.0.0.2:14551")
    assert "'handover -v drone-2 connect 2'" in line
    assert "No question 2." in fleet.type("handover connect 2")[-1]
    fleet.run(2.0)
    assert link.added == []
    fleet.type("handover -v drone-2 connect 2")
    fleet.run(2.0)
    assert link.added == ['udpout:10.0.0.2:14551:{"label":"drone-2"}']
