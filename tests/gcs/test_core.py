# SPDX-License-Identifier: GPL-3.0-or-later

"""Each rule at the head of `gcs_module/core.py`."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from math import inf

import pytest

from gcs_module.alarms import Level
from gcs_module.core import (
    Action,
    Answer,
    AuthorityHeard,
    Event,
    FromPeer,
    FromVehicle,
    MissionHeld,
    Notice,
    PeerHeard,
    Role,
    StationCore,
    ToPeer,
    ToVehicle,
    VehicleHeard,
    Wish,
    WishAnswered,
)
from mavproxy_handover.core.authority.transfer_manager import READ_S
from mavproxy_handover.core.common.messages import (
    EPOCH_MAX,
    Connect,
    ConnectAck,
    ConnectHandover,
    CrossingKey,
    DisconnectHandover,
    DroneConnected,
    HandoverAhead,
    HandoverRequest,
    HandoverResult,
    Message,
    OkAhead,
    OkHandover,
    OnHandover,
    TransferKey,
)
from mavproxy_handover.core.common.model import (
    AUTOMATIC,
    Consent,
    Outcome,
    Phase,
    Reason,
    Station,
)
from tests.gcs.stations import (
    DIGEST,
    KEY,
    NAMES,
    NOW,
    A,
    B,
    C,
    announced,
    from_vehicle,
    notices,
    partner,
    passed_on,
    station,
    words,
)


class TestWhoCommands:
    """The vehicle decides who commands; a station believes the newest epoch it has heard and nothing else."""

    def test_at_first_nobody(self) -> None:
        core = StationCore(Station(A, "GCSA"), "drone", (), automatic=AUTOMATIC)
        assert (core.commander, core.epoch, core.role) == (None, 0, Role.OBSERVER)
        assert not core.alone

    @pytest.mark.parametrize(
        ("sysid", "commander", "partner", "role"),
        [
            (A, A, None, Role.COMMANDER),
            (A, A, B, Role.COMMANDER),
            (B, A, B, Role.PARTNER),
            (C, A, B, Role.OBSERVER),
            (C, None, None, Role.OBSERVER),
        ],
    )
    def test_role(self, sysid: int, commander: int | None, partner: int | None, role: Role) -> None:
        core = station(sysid, epoch=0)
        core.handle(AuthorityHeard(Phase.ON_HANDOVER, commander, partner, 5), NOW)
        assert core.role is role

    @pytest.mark.parametrize("how", ["status", "connect", "result"])
    def test_every_word_of_the_vehicle_tells(self, how: str) -> None:
        core = station(A)
        events: dict[str, Event] = {
            "status": AuthorityHeard(Phase.ON_MISSION, B, None, 4),
            "connect": FromVehicle(Connect(A, 1, 9, 4, B, "drone", DIGEST)),
            "result": FromVehicle(HandoverResult(TransferKey(A, B, 7, 4), B, Outcome.COMMITTED, Reason.ZONE)),
        }
        actions = core.handle(events[how], NOW)
        assert (core.commander, core.epoch, core.role) == (B, 4, Role.OBSERVER)
        assert notices(actions) == ["GCSB has drone: GCSB commands now, epoch 4."]

    @pytest.mark.parametrize("epoch", [0, 1, 2])
    def test_an_older_epoch_is_stale(self, epoch: int) -> None:
        core = station(A)
        for event in (
            AuthorityHeard(Phase.ON_MISSION, B, None, epoch),
            FromVehicle(Connect(A, 1, 9, epoch, B, "drone", DIGEST)),
            FromVehicle(HandoverResult(TransferKey(A, B, 7, epoch), B, Outcome.COMMITTED, Reason.ZONE)),
        ):
            assert notices(core.handle(event, NOW)) == []
        assert (core.commander, core.epoch) == (A, 3)

    def test_within_an_epoch_only_that_nobody_commands_any_more(self) -> None:
        core = station(A)
        assert notices(core.handle(AuthorityHeard(Phase.ON_MISSION, B, None, 3), NOW)) == []
        assert core.commander == A
        lost = core.handle(AuthorityHeard(Phase.ON_MISSION, None, None, 3), NOW)
        text = "No station commands drone. When it is in your zone, type 'handover request' to take over."
        assert lost == [Notice("no_commander", text)]
        # a status from before the loss comes late
        assert core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 3), NOW) == []
        assert core.role is Role.OBSERVER
        back = core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 4), NOW)
        assert notices(back) == ["I have drone: GCSA is the commander now, epoch 4."]

    def test_after_a_restart_the_same_commander_in_one_epoch(self) -> None:
        core = station(A)
        waiting = AuthorityHeard(Phase.ON_MISSION, None, None, 4, recovering=True)
        back = AuthorityHeard(Phase.ON_MISSION, A, None, 4)
        assert notices(core.handle(waiting, NOW)) == ["No station commands now, epoch 4."]
        assert core.role is Role.OBSERVER
        assert notices(core.handle(back, NOW)) == ["I have drone: GCSA is the commander now, epoch 4."]
        # a status of before comes late, over the slower of two links
        assert core.handle(waiting, NOW) == []
        assert core.role is Role.COMMANDER

    def test_after_a_restart_nobody_may_come_back(self) -> None:
        core = station(A)
        core.handle(AuthorityHeard(Phase.ON_MISSION, None, None, 4, recovering=True), NOW)
        assert core.handle(AuthorityHeard(Phase.ON_MISSION, None, None, 4), NOW) == []
        # what was said while it was awaited, or of a commander before the loss, comes late
        assert core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 4), NOW) == []
        assert core.commander is None
        assert notices(core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 5), NOW)) == [
            "I have drone: GCSA is the commander now, epoch 5."
        ]

    @pytest.mark.parametrize("order", list(permutations(range(4))))
    def test_in_whatever_order_it_is_heard_the_last_thing_said_is_believed(self, order: tuple[int, ...]) -> None:
        """What the vehicle says, in its order: before a restart, waiting after it, A commands, A is lost."""
        said = [
            AuthorityHeard(Phase.ON_MISSION, A, None, 3),
            AuthorityHeard(Phase.ON_MISSION, None, None, 4, recovering=True),
            AuthorityHeard(Phase.ON_MISSION, A, None, 4),
            AuthorityHeard(Phase.ON_MISSION, None, None, 4),
        ]
        core = station(B, epoch=0, commander=None)
        for number, heard in enumerate(order, start=1):
            core.handle(said[heard], NOW)
            latest = max(order[:number])
            assert (core.commander, core.epoch) == (said[latest].commander, said[latest].epoch)

    def test_connect_of_a_vehicle_without_a_commander_says_nothing_of_before_or_after(self) -> None:
        core = station(A)
        from_vehicle(core, Connect(A, 1, 9, 3, None, "drone", DIGEST))
        assert core.commander == A, "it may have been sent before there was one"
        from_vehicle(core, Connect(A, 1, 9, 4, None, "drone", DIGEST))
        assert (core.commander, core.epoch) == (None, 4)
        from_vehicle(core, Connect(A, 1, 9, 4, A, "drone", DIGEST))
        assert (core.commander, core.epoch) == (A, 4)

    def test_the_operator_hears_of_his_own_authority_aloud(self) -> None:
        core = station(B)
        assert core.handle(AuthorityHeard(Phase.ON_MISSION, B, None, 4), NOW) == [
            Notice("control_gained", "I have drone: GCSB is the commander now, epoch 4.")
        ]
        assert core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 5), NOW) == [
            Notice("control_lost", "GCSA has drone: GCSA commands now, epoch 5.")
        ]
        assert core.handle(AuthorityHeard(Phase.ON_MISSION, C, None, 6), NOW) == [
            Notice("authority", "GCSC commands, epoch 6.")
        ]

    def test_nobody_on_the_ground_is_no_emergency(self) -> None:
        core = station(A, commander=C)
        assert core.handle(AuthorityHeard(Phase.ON_LOAD, None, None, 3), NOW) == [
            Notice("phase", "drone is on load."),
            Notice("authority", "no station commands, epoch 3."),
        ]

    def test_no_peer_can_tell(self) -> None:
        core = station(A)
        for message in (
            HandoverResult(TransferKey(A, B, 7, 4), B, Outcome.COMMITTED, Reason.ZONE),
            Connect(A, 1, 9, 4, B, "drone", DIGEST),
            HandoverRequest(KEY, Reason.ZONE),
            ConnectHandover(KEY),
            DisconnectHandover(KEY),
            OkHandover(KEY),
        ):
            assert core.handle(FromPeer(B, message), NOW) == []
        assert (core.commander, core.epoch, core.question) == (A, 3, None)


class TestConnect:
    def test_is_answered_with_what_the_station_knows(self) -> None:
        core = station(B)
        core.handle(MissionHeld(DIGEST), NOW)
        answers = words(from_vehicle(core, Connect(B, 1, 0xFFFFFFFF, 3, A, "drone", DIGEST)))
        assert answers == [ToVehicle(ConnectAck(B, 1, 0xFFFFFFFF, 3, A, "GCSB", DIGEST))]

    def test_again_and_again(self) -> None:
        core = station(B)
        question = Connect(B, 1, 77, 3, A, "drone", b"")
        assert from_vehicle(core, question) == from_vehicle(core, question) != []

    def test_the_answer_shows_the_epoch_that_the_question_brought(self) -> None:
        core = station(B)
        answers = words(from_vehicle(core, Connect(B, 1, 1, 9, B, "drone", b"")))
        assert answers == [ToVehicle(ConnectAck(B, 1, 1, 9, B, "GCSB", b""))]

    def test_the_vehicles_mission_is_known(self) -> None:
        core = station(B)
        from_vehicle(core, Connect(B, 1, 1, 3, A, "drone", DIGEST))
        assert core.vehicle_digest == DIGEST


class TestPartner:
    """It answers HANDOVER_REQUEST with ON_HANDOVER, CONNECT_HANDOVER with DRONE_CONNECTED, to commander and vehicle."""

    def test_request(self) -> None:
        core = partner()
        assert from_vehicle(core, HandoverRequest(KEY, Reason.ZONE)) == [
            Notice("announced", "Handover requested (zone): GCSA -> GCSB."),
            ToPeer(A, OnHandover(KEY)),
            ToVehicle(OnHandover(KEY)),
            Notice("told", "GCSA is told over the ground link: ready to take drone."),
        ]

    def test_connect(self) -> None:
        core = partner()
        from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))
        actions = from_vehicle(core, ConnectHandover(KEY))
        assert words(actions) == [ToPeer(A, DroneConnected(KEY)), ToVehicle(DroneConnected(KEY))]
        assert notices(actions) == [
            "Set up as commander: Drone Connected.",
            "GCSA is told over the ground link: Drone Connected.",
        ]

    def test_without_a_ground_link_the_vehicle_is_asked_to_pass_it_on(self) -> None:
        core = partner(ground=False)
        ready = from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))
        assert words(ready) == [ToVehicle(OnHandover(KEY, relay=True))]
        connected = from_vehicle(core, ConnectHandover(KEY))
        assert words(connected) == [ToVehicle(DroneConnected(KEY, relay=True))]
        assert [line for line in notices(ready + connected) if "is told" in line] == [
            "GCSA is told by the vehicle: ready to take drone.",
            "GCSA is told by the vehicle: Drone Connected.",
        ]

    def test_who_is_told_is_said_once_and_of_a_lost_commander_not_at_all(self) -> None:
        core = partner()
        first, second = (notices(from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))) for _ in range(2))
        assert (len(first), second) == (2, [])
        first, second = (notices(from_vehicle(core, ConnectHandover(KEY))) for _ in range(2))
        assert (len(first), second) == (2, [])
        core = partner()
        lost = from_vehicle(core, HandoverRequest(KEY, Reason.COMMANDER_LOST))
        lost += from_vehicle(core, ConnectHandover(KEY))
        assert [line for line in notices(lost) if "is told" in line] == []

    def test_a_ground_link_counts_as_dead_after_three_seconds(self) -> None:
        core = partner()
        assert core.peer_alive(A, NOW + 2.999)
        assert words(from_vehicle(core, HandoverRequest(KEY, Reason.ZONE), NOW + 2.999))[0] == ToPeer(
            A, OnHandover(KEY)
        )
        assert not core.peer_alive(A, NOW + 3.0)
        assert words(from_vehicle(core, HandoverRequest(KEY, Reason.ZONE), NOW + 3.0)) == [
            ToVehicle(OnHandover(KEY, relay=True))
        ]

    def test_the_ground_link_to_a_third_station_does_not_help(self) -> None:
        core = partner(ground=False)
        core.handle(PeerHeard(C), NOW)
        assert words(from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))) == [ToVehicle(OnHandover(KEY, relay=True))]

    def test_the_same_question_gets_the_same_answer_and_the_operator_reads_it_once(self) -> None:
        core = partner()
        for message in (HandoverRequest(KEY, Reason.ZONE), ConnectHandover(KEY)):
            first = from_vehicle(core, message)
            for _ in range(3):
                assert from_vehicle(core, message) == words(first)

    def test_a_request_for_another_station_is_not_answered(self) -> None:
        for key in (TransferKey(A, C, 7, 3), TransferKey(B, A, 7, 3)):
            core = partner()
            assert from_vehicle(core, HandoverRequest(key, Reason.ZONE)) == []
            assert from_vehicle(core, ConnectHandover(key)) == []

    @pytest.mark.parametrize("epoch", [0, 1, 2])
    def test_a_request_of_an_older_epoch_is_not_answered(self, epoch: int) -> None:
        core = partner()
        assert from_vehicle(core, HandoverRequest(TransferKey(A, B, 7, epoch))) == []
        assert from_vehicle(core, ConnectHandover(TransferKey(A, B, 7, epoch))) == []

    def test_a_request_of_a_newer_epoch_is_answered_the_news_just_has_not_come(self) -> None:
        core = partner()
        key = TransferKey(A, B, 8, 4)
        assert words(from_vehicle(core, HandoverRequest(key, Reason.ZONE))) == [
            ToPeer(A, OnHandover(key)),
            ToVehicle(OnHandover(key)),
        ]
        assert core.epoch == 3

    def test_connect_without_a_request_first(self) -> None:
        # the request was answered before this station was started anew
        core = partner()
        assert from_vehicle(core, ConnectHandover(KEY)) == []  # nor is it known why it is asked
        announced(core)
        assert words(from_vehicle(core, ConnectHandover(KEY))) == [
            ToPeer(A, DroneConnected(KEY)),
            ToVehicle(DroneConnected(KEY)),
        ]

    def test_connect_to_what_the_vehicle_has_announced_for_another_station(self) -> None:
        key = TransferKey(A, C, 7, 3)
        assert from_vehicle(announced(partner(), key), ConnectHandover(key)) == []

    def test_connect_to_what_was_announced_before_the_last_commit(self) -> None:
        core = announced(station(B, epoch=4))
        assert from_vehicle(core, ConnectHandover(KEY)) == []

    def test_connect_to_another_transfer_than_it_has_consented_to(self) -> None:
        core = partner()
        from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))
        assert from_vehicle(core, ConnectHandover(TransferKey(A, B, 8, 3))) == []

    def test_connect_makes_what_was_before_it_late(self) -> None:
        core = announced(partner(), TransferKey(A, B, 8, 3))
        from_vehicle(core, ConnectHandover(TransferKey(A, B, 8, 3)))
        core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 3), NOW)
        assert from_vehicle(core, HandoverRequest(KEY, Reason.ZONE)) == []


class TestCommander:
    """ON_HANDOVER is answered with OK_HANDOVER; DRONE_CONNECTED with DISCONNECT_HANDOVER, if it has consented."""

    @pytest.mark.parametrize("relayed", [False, True])
    def test_consent_and_release(self, relayed: bool) -> None:
        core = announced(station(A))

        def hear(message: Message) -> list[Action]:
            return core.handle(FromVehicle(message) if relayed else FromPeer(B, message), NOW)

        actions = hear(passed_on() if relayed else OnHandover(KEY))
        assert words(actions) == [ToVehicle(OkHandover(KEY))]
        assert notices(actions) == ["GCSB is ready to take drone (zone).", "Handover Authorized."]
        actions = hear(DroneConnected(KEY, relayed=relayed))
        assert words(actions) == [ToVehicle(DisconnectHandover(KEY))]
        assert notices(actions) == ["GCSB has the drone: Disconnect."]

    def test_doubled_over_both_ways_it_is_answered_again_and_read_once(self) -> None:
        core = announced(station(A))
        core.handle(FromPeer(B, OnHandover(KEY)), NOW)
        assert from_vehicle(core, passed_on(KEY)) == [ToVehicle(OkHandover(KEY))]
        core.handle(FromPeer(B, DroneConnected(KEY)), NOW)
        assert from_vehicle(core, DroneConnected(KEY, relayed=True)) == [ToVehicle(DisconnectHandover(KEY))]
        assert core.handle(FromPeer(B, OnHandover(KEY)), NOW) == [ToVehicle(OkHandover(KEY))]

    @pytest.mark.parametrize("relayed", [False, True])
    def test_no_release_without_consent(self, relayed: bool) -> None:
        message = DroneConnected(KEY)
        event = FromVehicle(message) if relayed else FromPeer(B, message)
        assert announced(station(A)).handle(event, NOW) == []
        waiting = announced(station(A, asks=True))
        waiting.handle(FromPeer(B, OnHandover(KEY)), NOW)
        assert waiting.handle(event, NOW) == []
        denied = announced(station(A, asks=True))
        denied.handle(FromPeer(B, OnHandover(KEY)), NOW)
        denied.handle(Answer(False), NOW)
        assert denied.handle(event, NOW) == []

    def test_consent_to_one_transfer_is_no_consent_to_another(self) -> None:
        core = announced(station(A))
        core.handle(FromPeer(B, OnHandover(KEY)), NOW)
        for key in (TransferKey(A, B, 8, 3), TransferKey(A, C, 7, 3), TransferKey(A, B, 7, 4)):
            assert from_vehicle(core, DroneConnected(key)) == []

    def test_consent_as_partner_is_no_consent_as_commander(self) -> None:
        core = announced(station(A))
        key = TransferKey(A, A, 7, 3)
        from_vehicle(core, HandoverRequest(key, Reason.ZONE))
        assert from_vehicle(core, DroneConnected(key)) == []

    def test_nor_does_it_speak_for_the_commanders_operator(self) -> None:
        core = station(A, asks=True)
        key = TransferKey(A, A, 7, 3)
        core.handle(Wish(A), NOW)
        from_vehicle(core, HandoverRequest(key, Reason.REQUESTED))
        assert words(from_vehicle(core, OnHandover(key))) == [ToVehicle(OkHandover(key, Consent.WAITING))]

    def test_not_its_transfer(self) -> None:
        core = announced(station(A))
        for key in (TransferKey(B, C, 7, 3), TransferKey(C, B, 7, 3), TransferKey(A, B, 7, 2)):
            assert from_vehicle(core, OnHandover(key)) == []
            assert core.handle(FromPeer(key.to_station, OnHandover(key)), NOW) == []


class TestGroundLink:
    """A peer speaks for itself, in the present epoch, only to the station that commands, and of what the vehicle itself
    has announced."""

    FORGED = TransferKey(A, B, 8, 3)

    @pytest.mark.parametrize("asks", [False, True])
    def test_of_a_transfer_that_the_vehicle_has_not_announced(self, asks: bool) -> None:
        core = station(A, asks=asks)
        for word in (OnHandover(KEY), DroneConnected(KEY)):
            assert core.handle(FromPeer(B, word), NOW) == []
        assert core.question is None

    def test_it_replaces_no_question(self) -> None:
        """The operator's yes would be for another transfer than the one that was asked about."""
        core = announced(station(A, asks=True))
        from_vehicle(core, passed_on(KEY))
        assert core.handle(FromPeer(B, OnHandover(self.FORGED)), NOW) == []
        assert core.question == KEY
        assert words(core.handle(Answer(True), NOW)) == [ToVehicle(OkHandover(KEY))]
        assert core.handle(FromPeer(B, DroneConnected(self.FORGED)), NOW) == []

    def test_what_the_vehicle_has_passed_on_is_announced_by_that(self) -> None:
        core = station(A)
        from_vehicle(core, passed_on(KEY))
        assert words(core.handle(FromPeer(B, DroneConnected(KEY)), NOW)) == [ToVehicle(DisconnectHandover(KEY))]

    def test_an_announcement_ends_with_its_transfer(self) -> None:
        core = announced(station(A))
        core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 3), NOW)
        assert core.handle(FromPeer(B, OnHandover(KEY)), NOW) == []

    def test_even_where_its_partner_has_spoken(self) -> None:
        core = announced(station(A))
        core.handle(FromPeer(B, OnHandover(KEY)), NOW)
        core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 3), NOW)
        assert core.handle(FromPeer(B, OnHandover(KEY)), NOW) == []

    def test_a_status_that_names_no_number_announces_none(self) -> None:
        core = station(A)
        core.handle(AuthorityHeard(Phase.ON_HANDOVER, A, B, 3, why=Reason.ZONE), NOW)
        for number in (1, 2, 0xFFFF):
            assert core.handle(FromPeer(B, OnHandover(TransferKey(A, B, number, 3))), NOW) == []

    def test_for_another_station(self) -> None:
        core = announced(station(A))
        assert core.handle(FromPeer(C, OnHandover(KEY)), NOW) == []
        core.handle(FromPeer(B, OnHandover(KEY)), NOW)
        assert core.handle(FromPeer(C, DroneConnected(KEY)), NOW) == []

    @pytest.mark.parametrize("epoch", [0, 2, 4, 0xFFFFFFFF])
    def test_of_another_epoch(self, epoch: int) -> None:
        core = station(A)
        assert core.handle(FromPeer(B, OnHandover(TransferKey(A, B, 7, epoch))), NOW) == []

    def test_of_the_epoch_to_come(self) -> None:
        """The vehicle has passed its partner's word on, but has not said yet that the epoch is another."""
        core = station(A)
        key = TransferKey(A, B, 7, 4)
        from_vehicle(core, passed_on(key))
        assert core.handle(FromPeer(B, OnHandover(key)), NOW) == []

    ANNOUNCED = AuthorityHeard(Phase.ON_HANDOVER, A, B, 3, 7, why=Reason.ZONE)

    def test_a_moment_before_the_vehicle_speaks_of_it_waits_for_that(self) -> None:
        """The ground link may be quicker than the vehicle's: else its retransmission would be waited for."""
        core = station(A)
        assert core.handle(FromPeer(B, OnHandover(KEY)), NOW) == []
        assert words(core.handle(self.ANNOUNCED, NOW + 0.1)) == [ToVehicle(OkHandover(KEY))]
        assert words(core.handle(self.ANNOUNCED, NOW + 0.2)) == [], "once"

    def test_long_before_it_does_not(self) -> None:
        core = station(A)
        core.handle(FromPeer(B, OnHandover(KEY)), NOW)
        assert words(core.handle(self.ANNOUNCED, NOW + StationCore.TOO_SOON_S)) == []

    def test_of_another_transfer_than_the_vehicle_then_speaks_of_is_none(self) -> None:
        for key in (TransferKey(A, B, 8, 3), TransferKey(A, C, 7, 3)):
            core = station(A)
            core.handle(FromPeer(key.to_station, OnHandover(key)), NOW)
            assert words(core.handle(self.ANNOUNCED, NOW + 0.1)) == []

    def test_what_waits_asks_the_operator_as_the_vehicle_has_it(self) -> None:
        core = station(A, asks=True)
        core.handle(FromPeer(B, OnHandover(KEY, reason=Reason.COMMANDER_LOST)), NOW)
        assert words(core.handle(self.ANNOUNCED, NOW + 0.1)) == [ToVehicle(OkHandover(KEY, Consent.WAITING))]
        assert core.question == KEY

    def test_to_a_station_that_does_not_command(self) -> None:
        core = station(A, commander=C)
        assert core.handle(FromPeer(B, OnHandover(KEY)), NOW) == []
        lost = station(A, commander=None)
        assert lost.handle(FromPeer(B, OnHandover(KEY)), NOW) == []
        late = announced(station(A, commander=C))
        assert late.handle(FromPeer(B, OnHandover(KEY)), NOW) == []

    def test_what_the_vehicle_passes_on_counts_even_so(self) -> None:
        # the news of its own authority has not come yet
        core = station(A, commander=C, epoch=2)
        assert words(from_vehicle(core, passed_on(KEY))) == [ToVehicle(OkHandover(KEY))]

    def test_a_peer_cannot_make_the_transfer_under_way_stale(self) -> None:
        core = station(A)
        core.handle(FromPeer(B, OnHandover(TransferKey(A, B, 30000, 3))), NOW)
        assert words(from_vehicle(core, passed_on(KEY))) == [ToVehicle(OkHandover(KEY))]

    def test_is_announced_when_it_comes_up(self) -> None:
        core = station(A)
        assert notices(core.handle(PeerHeard(B), NOW)) == ["Ground link to GCSB is up."]
        assert core.handle(PeerHeard(B), NOW + 2.9) == []
        assert notices(core.handle(PeerHeard(B), NOW + 6.0)) == ["Ground link to GCSB is up."]

    def test_and_when_it_goes_down(self) -> None:
        core = station(A)
        for peer in (B, C):
            core.handle(PeerHeard(peer), NOW)
        core.handle(VehicleHeard(), NOW + 3.0)
        core.handle(PeerHeard(C), NOW + 2.0)
        assert core.tick(NOW + 2.9) == []
        assert core.tick(NOW + 3.0) == [Notice("peer_lost", "Ground link to GCSB is down.")]
        assert core.tick(NOW + 3.0) == []

    def test_every_word_of_a_peer_is_a_sign_of_life(self) -> None:
        core = station(A)
        core.handle(FromPeer(B, OnHandover(KEY)), NOW)
        assert core.peer_alive(B, NOW + 2.9)
        assert notices(core.handle(PeerHeard(B), NOW + 1.0)) == ["Ground link to GCSB is up."]


class TestLate:
    """What comes late from a transfer before the vehicle's latest is no question any more."""

    def test_request(self) -> None:
        core = partner(asks=True)
        from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))
        later = TransferKey(A, B, 8, 3)
        from_vehicle(core, HandoverRequest(later))
        core.handle(Answer(True), NOW + READ_S)
        assert from_vehicle(core, HandoverRequest(KEY, Reason.ZONE)) == []
        assert from_vehicle(core, ConnectHandover(KEY)) == []
        # and the answer given stands
        assert words(from_vehicle(core, HandoverRequest(later))) == [
            ToPeer(A, OnHandover(later)),
            ToVehicle(OnHandover(later)),
        ]

    def test_partners_word(self) -> None:
        core = announced(station(A, asks=True))
        core.handle(FromPeer(B, OnHandover(KEY)), NOW)
        assert core.question == KEY
        later = TransferKey(A, C, 8, 3)
        from_vehicle(core, passed_on(later))
        core.handle(Answer(True), NOW + READ_S)
        assert core.handle(FromPeer(B, OnHandover(KEY)), NOW) == []
        assert core.handle(FromPeer(B, DroneConnected(KEY)), NOW) == []
        assert from_vehicle(core, passed_on(later)) == [ToVehicle(OkHandover(later))]

    def test_a_copy_of_what_has_been_aborted_asks_nobody(self) -> None:
        """Over the slower of two links, or the ground link."""
        aborted = HandoverResult(KEY, A, Outcome.ABORTED, Reason.LEFT_REGION)
        taker, commander = partner(asks=True), announced(station(A, asks=True))
        from_vehicle(taker, HandoverRequest(KEY, Reason.ZONE))
        from_vehicle(commander, passed_on())
        for core in (taker, commander):
            from_vehicle(core, aborted)
        assert from_vehicle(taker, HandoverRequest(KEY, Reason.ZONE)) == []
        assert from_vehicle(commander, passed_on()) == []
        assert commander.handle(FromPeer(B, OnHandover(KEY)), NOW) == []
        assert (taker.question, commander.question) == (None, None)

    def test_what_the_vehicle_has_announced_is_its_latest(self) -> None:
        later = TransferKey(A, C, 8, 3)
        core = announced(station(A, asks=True), later)
        core.handle(FromPeer(C, OnHandover(later)), NOW)
        assert from_vehicle(core, passed_on()) == []
        assert core.question == later

    def test_the_number_wraps(self) -> None:
        core = partner()
        from_vehicle(core, HandoverRequest(TransferKey(A, B, 65535, 3)))
        assert from_vehicle(core, HandoverRequest(TransferKey(A, B, 1, 3))) != []
        assert from_vehicle(core, HandoverRequest(TransferKey(A, B, 65535, 3))) == []

    def test_a_new_epoch_begins_anew(self) -> None:
        core = partner()
        from_vehicle(core, HandoverRequest(TransferKey(A, B, 65535, 3)))
        assert from_vehicle(core, HandoverRequest(TransferKey(A, B, 5, 4))) != []


def test_who_crosses_a_declared_gap_alone_is_no_emergency() -> None:
    core = station(A)
    text = "No station commands drone: it crosses a gap that its mission declares."
    alone = AuthorityHeard(Phase.ON_MISSION, None, None, 3, alone=True)
    assert core.handle(alone, NOW) == [Notice("authority", text)]
    assert core.alone


def test_behind_a_declared_gap_somebody_commands_again() -> None:
    core = station(A)
    core.handle(AuthorityHeard(Phase.ON_MISSION, None, None, 3, alone=True), NOW)
    committed = HandoverResult(TransferKey(A, B, 7, 4), B, Outcome.COMMITTED, Reason.ZONE)
    assert notices(from_vehicle(core, committed)) == ["GCSB commands, epoch 4."]


class TestZone:
    """The operators hear that the commander's zone ends, and that it is left."""

    def heard(self, core: StationCore, zone: int | None = A, ends_s: float = inf, **changes: object) -> list[Action]:
        """What is told of the zone."""
        status = AuthorityHeard(Phase.ON_MISSION, A, None, 3, zone=zone, zone_ends_s=ends_s)
        actions = core.handle(replace(status, **changes), NOW)  # type: ignore[arg-type]
        return [each for each in actions if isinstance(each, Notice) and each.event.startswith("zone")]

    def ends(self, seconds: int, name: str = "GCSA") -> list[Action]:
        return [Notice("zone_ends", f"The zone of {name} ends in {seconds} s.")]

    def test_fifteen_seconds_before_it_ends(self) -> None:
        for core in (station(A), station(B), station(C)):
            assert self.heard(core, ends_s=15.1) == []
            assert self.heard(core, ends_s=15.0) == self.ends(15)
            assert self.heard(core, ends_s=14.5) == []

    def test_to_whom_has_just_been_started_at_once(self) -> None:
        core = StationCore(Station(A, "GCSA"), "drone", (), automatic=AUTOMATIC)
        assert self.heard(core, ends_s=4.2) == self.ends(4)

    def test_again_only_when_its_end_was_far(self) -> None:
        core = station(A)
        told = [self.heard(core, ends_s=seconds) for seconds in (14.0, 18.0, 14.0, 18.1, 14.0)]
        assert told == [self.ends(14), [], [], [], self.ends(14)]

    def test_again_when_it_was_left_meanwhile(self) -> None:
        core = station(A)
        self.heard(core, ends_s=14.0)
        self.heard(core, B, ends_s=14.0)
        assert self.heard(core, ends_s=14.0) == self.ends(14)

    def test_the_next_commanders_zone_may_end_as_soon(self) -> None:
        core = station(A)
        self.heard(core, ends_s=14.0)
        assert self.heard(core, B, 17.0, commander=B, epoch=4) == []
        assert self.heard(core, B, 14.0, commander=B, epoch=4) == self.ends(14, "GCSB")

    def test_nobodys_zone_ends(self) -> None:
        core = station(A)
        assert self.heard(core, B, 9.0) == [], "it is not the commander's"
        assert self.heard(core, None, 9.0, commander=None) == []
        assert self.heard(core, A, 9.0, commander=None) == []
        assert self.heard(core, A, 9.0) == self.ends(9)
        assert self.heard(core, None, 8.0, commander=None) == []

    def test_not_on_the_ground(self) -> None:
        core = station(A)
        self.heard(core, phase=Phase.ON_LOAD)
        assert self.heard(core, ends_s=9.0, phase=Phase.ON_LOAD) == []
        assert self.heard(core, B, phase=Phase.ON_LOAD) == []

    @pytest.mark.parametrize(("zone", "where"), [(B, "in the zone of GCSB"), (None, "in no zone")])
    def test_when_it_is_left_once(self, zone: int | None, where: str) -> None:
        core = station(A)
        assert self.heard(core) == self.heard(core) == []
        assert self.heard(core, zone) == [Notice("zone_left", f"drone has left the zone of GCSA: it is {where}.")]
        assert self.heard(core, zone) == []

    def test_who_was_not_in_it_has_not_left_it(self) -> None:
        core = station(A)
        assert self.heard(core, None) == self.heard(core, B) == self.heard(core, C) == []

    def test_where_nobody_commands_nothing_is_left(self) -> None:
        core = station(A, commander=None)
        assert self.heard(core, None, commander=None) == self.heard(core, B, commander=None) == []

    def test_with_a_commit_nothing_is_left(self) -> None:
        """The zone of the new commander held it, and what it says now is of the new one's time."""
        core = station(A)
        self.heard(core, B)
        assert self.heard(core, None, commander=B, epoch=4) == []


class TestVehicleName:
    @pytest.mark.parametrize(
        ("said", "name"), [("drone-7", "drone-7"), (" x ", "x"), ("", "drone"), ("  ", "drone"), ("a\x07b", "drone")]
    )
    def test_it_is_what_the_vehicle_calls_itself(self, said: str, name: str) -> None:
        core = station(A)
        from_vehicle(core, Connect(A, 1, 7, 3, A, said, DIGEST))
        assert core.vehicle_name == name


class TestOperator:
    """Consent is automatic, or the operator's: then the answer is "waiting" until there is one."""

    def test_partner_waits(self) -> None:
        core = partner(asks=True)
        actions = from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))
        # only the vehicle: the commander is not to be asked for a transfer that may not be wanted
        assert words(actions) == [ToVehicle(OnHandover(KEY, Consent.WAITING))]
        assert notices(actions) == [
            "Handover requested (zone): GCSA -> GCSB. Type 'handover accept' or 'handover deny'.",
        ]
        assert core.question == KEY

    def test_who_has_not_answered_is_told_at_ten_and_at_five_seconds_what_is_left(self) -> None:
        core = partner(asks=True)
        from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))
        told = []
        for second in range(30):
            now = NOW + second
            left_s = 29.0 - second
            status = AuthorityHeard(Phase.ON_HANDOVER, A, B, 3, 7, why=Reason.ZONE, zone=A, answer_left_s=left_s)
            core.handle(status, now)
            assert core.answer_left_s(now + 0.5) == left_s - 0.5
            core.handle(VehicleHeard(), now)
            told += [(second, each) for each in notices(core.tick(now)) if "left to answer" in each]
        words = "s left to answer: GCSA -> GCSB. Without an answer GCSA keeps the aircraft."
        hint = "Type 'handover accept' or 'handover deny'."
        assert told == [(19, f"10 {words} {hint}"), (24, f"5 {words} {hint}")]

    def test_whoever_has_answered_or_was_not_asked_is_told_nothing(self) -> None:
        for core in (partner(asks=True), partner()):
            from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))
            if core.question is not None:
                core.handle(Answer(True), NOW)
            core.handle(AuthorityHeard(Phase.ON_HANDOVER, A, B, 3, 7, why=Reason.ZONE, answer_left_s=4.0), NOW)
            assert notices(core.tick(NOW)) == []

    def test_what_is_left_is_not_known_before_the_vehicle_says_so(self) -> None:
        core = partner(asks=True)
        from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))
        assert core.answer_left_s(NOW) == inf
        assert notices(core.tick(NOW)) == []

    def test_partner_says_yes(self) -> None:
        core = partner(asks=True)
        from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))
        assert core.handle(Answer(True), NOW) == [
            Notice("consent", "Handover Authorized."),
            ToPeer(A, OnHandover(KEY)),
            ToVehicle(OnHandover(KEY)),
            Notice("told", "GCSA is told over the ground link: ready to take drone."),
        ]
        assert core.question is None

    def test_partner_says_no(self) -> None:
        core = partner(asks=True)
        from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))
        refusal = ToVehicle(OnHandover(KEY, Consent.DENIED, Reason.OPERATOR))
        assert core.handle(Answer(False), NOW) == [Notice("consent", "Handover Denied."), refusal]
        assert from_vehicle(core, HandoverRequest(KEY, Reason.ZONE)) == [refusal]
        assert from_vehicle(core, ConnectHandover(KEY)) == [refusal]

    def test_a_partner_whose_operator_has_not_answered_does_not_connect(self) -> None:
        core = announced(partner(asks=True))
        actions = from_vehicle(core, ConnectHandover(KEY))
        assert words(actions) == [ToVehicle(OnHandover(KEY, Consent.WAITING))]

    def test_commander_waits(self) -> None:
        core = announced(station(A, asks=True))
        actions = core.handle(FromPeer(B, OnHandover(KEY)), NOW)
        assert words(actions) == [ToVehicle(OkHandover(KEY, Consent.WAITING))]
        assert notices(actions) == [
            "GCSB is ready to take drone (zone). Type 'handover accept' or 'handover deny'.",
        ]
        assert from_vehicle(core, passed_on(KEY)) == [ToVehicle(OkHandover(KEY, Consent.WAITING))]

    def test_commander_says_yes(self) -> None:
        core = announced(station(A, asks=True))
        core.handle(FromPeer(B, OnHandover(KEY)), NOW)
        assert core.handle(Answer(True), NOW) == [
            Notice("consent", "Handover Authorized."),
            ToVehicle(OkHandover(KEY)),
        ]
        assert from_vehicle(core, passed_on(KEY)) == [ToVehicle(OkHandover(KEY))]

    def test_commander_says_no(self) -> None:
        core = announced(station(A, asks=True))
        core.handle(FromPeer(B, OnHandover(KEY)), NOW)
        refusal = ToVehicle(OkHandover(KEY, Consent.DENIED, Reason.OPERATOR))
        assert core.handle(Answer(False), NOW) == [Notice("consent", "Handover Denied."), refusal]
        assert from_vehicle(core, passed_on(KEY)) == [refusal]

    @pytest.mark.parametrize("yes", [False, True])
    def test_an_answer_to_nothing(self, yes: bool) -> None:
        core = announced(station(A, asks=True))
        assert core.handle(Answer(yes), NOW) == [Notice("question", "There is no question to answer.")]
        core.handle(FromPeer(B, OnHandover(KEY)), NOW)
        core.handle(Answer(True), NOW)
        assert core.handle(Answer(False), NOW) == [Notice("question", "There is no question to answer.")]


class TestCrossing:
    """Yes and no name no transfer: one that comes before the new question can have been read is to the old one."""

    NEXT = TransferKey(A, C, 8, 3)

    def asked_twice(self, pause_s: float = 0.0) -> StationCore:
        core = announced(station(A, asks=True))
        from_vehicle(core, passed_on(KEY))
        core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 3), NOW + 9.0)
        aborted = HandoverResult(KEY, A, Outcome.ABORTED, Reason.PREEMPTED)
        from_vehicle(core, aborted, NOW + 9.0)
        from_vehicle(core, OnHandover(self.NEXT, reason=Reason.REQUESTED, relayed=True), NOW + 9.0 + pause_s)
        assert core.question == self.NEXT
        return core

    @pytest.mark.parametrize("yes", [True, False])
    def test_it_is_not_taken(self, yes: bool) -> None:
        core = self.asked_twice()
        text = "Answer not used: a new question came first, GCSA -> GCSC. Read it, then answer."
        assert core.handle(Answer(yes), NOW + 10.9) == [Notice("question", text)]
        assert core.question == self.NEXT
        consent = OkHandover(self.NEXT) if yes else OkHandover(self.NEXT, Consent.DENIED, Reason.OPERATOR)
        assert words(core.handle(Answer(yes), NOW + 11.0)) == [ToVehicle(consent)]

    def test_nor_where_the_new_one_replaces_the_old_one(self) -> None:
        core = announced(station(A, asks=True))
        from_vehicle(core, passed_on(KEY))
        from_vehicle(core, OnHandover(self.NEXT, reason=Reason.REQUESTED, relayed=True), NOW + 9.0)
        assert words(core.handle(Answer(True), NOW + 9.5)) == []
        assert core.question == self.NEXT

    def test_a_question_after_a_while_or_after_an_answer_is_a_question_of_its_own(self) -> None:
        core = self.asked_twice(pause_s=2.0)
        assert words(core.handle(Answer(True), NOW + 11.0)) == [ToVehicle(OkHandover(self.NEXT))]
        core = announced(station(A, asks=True))
        from_vehicle(core, passed_on(KEY))
        core.handle(Answer(False), NOW)
        from_vehicle(core, OnHandover(self.NEXT, reason=Reason.REQUESTED, relayed=True), NOW)
        assert words(core.handle(Answer(True), NOW)) == [ToVehicle(OkHandover(self.NEXT))]

    def test_to_give_by_name_is_an_answer(self) -> None:
        core = self.asked_twice()
        assert words(core.handle(Wish(C), NOW + 9.1)) == [ToVehicle(OkHandover(self.NEXT))]


class TestForced:
    """A forced handover asks nobody: the operator is told, and may pass the aircraft on."""

    @pytest.mark.parametrize(
        ("why", "text", "level"),
        [
            (Reason.ZONE, "I have drone: GCSB is the commander now, epoch 4.", Level.ADVISORY),
            (
                Reason.COMMANDER_LOST,
                "I have drone: GCSB is the commander now, epoch 4. Its commander was lost. "
                "'handover give STATION' or 'handover release' passes it on.",
                Level.WARNING,
            ),
        ],
    )
    def test_the_operator_gets_an_alarm(self, why: Reason, text: str, level: Level) -> None:
        core = partner(ground=False)
        assert words(from_vehicle(core, HandoverRequest(KEY, why))) == [ToVehicle(OnHandover(KEY, relay=True))]
        told = [a for a in core.handle(AuthorityHeard(Phase.ON_MISSION, B, None, 4), NOW) if isinstance(a, Notice)]
        assert [(notice.text, notice.gravity) for notice in told if notice.event == "control_gained"] == [(text, level)]


class TestEpochOfNoFlight:
    """An epoch above 0x7FFFFFFF is damaged or forged: it must not keep a station from the vehicle's true word."""

    FORGED = (0x80000000, 0xFFFFFFFE, 0xFFFFFFFF)

    @pytest.mark.parametrize("epoch", FORGED)
    def test_the_vehicles_next_word_is_believed(self, epoch: int) -> None:
        core = station(A)
        core.handle(AuthorityHeard(Phase.ON_MISSION, C, B, epoch, 65535), NOW)
        assert core.epoch == epoch
        core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 3), NOW + 0.5)
        assert (core.role, core.epoch) == (Role.COMMANDER, 3)

    @pytest.mark.parametrize("epoch", FORGED)
    def test_and_it_takes_part_in_the_next_transfer(self, epoch: int) -> None:
        core = partner(ground=False)
        core.handle(AuthorityHeard(Phase.ON_MISSION, C, B, epoch, 65535), NOW)
        core.handle(AuthorityHeard(Phase.ON_HANDOVER, A, B, 3, 7, why=Reason.ZONE), NOW + 0.5)
        asked = from_vehicle(core, HandoverRequest(KEY, Reason.ZONE), NOW + 0.6)
        assert words(asked) == [ToVehicle(OnHandover(KEY, relay=True))]

    @pytest.mark.parametrize("epoch", [0x7FFFFFFE, 0x7FFFFFFF])
    def test_up_to_there_the_newest_counts(self, epoch: int) -> None:
        core = station(A)
        core.handle(AuthorityHeard(Phase.ON_MISSION, C, None, epoch), NOW)
        core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, epoch - 1), NOW + 0.5)
        assert (core.commander, core.epoch) == (C, epoch)

    def test_above_it_as_well_while_the_vehicle_itself_is_there(self) -> None:
        core = station(A)
        for epoch, commander in ((0x80000001, B), (0x80000002, C), (0x80000001, A)):
            core.handle(AuthorityHeard(Phase.ON_MISSION, commander, None, epoch), NOW)
        assert (core.commander, core.epoch) == (C, 0x80000002)


class TestWish:
    """Who has asked for control need not be asked whether it will have it: one transfer, within a minute.

    To give is no consent to anything else: the vehicle does not ask back about a gift.
    """

    def test_as_partner(self) -> None:
        core = partner(asks=True)
        core.handle(Wish(B), NOW)
        core.handle(WishAnswered(B, accepted=True), NOW)
        assert words(from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))) == [
            ToPeer(A, OnHandover(KEY)),
            ToVehicle(OnHandover(KEY)),
        ]
        assert core.question is None

    def test_a_refused_request_is_no_consent(self) -> None:
        # GCSB denied, asked for control, was refused, and then took the aircraft without being asked
        core = partner(asks=True)
        core.handle(Wish(B), NOW)
        core.handle(WishAnswered(B, accepted=False), NOW)
        for number, why in ((7, Reason.ZONE), (8, Reason.REQUESTED)):
            key = TransferKey(A, B, number, 3)
            asked = words(from_vehicle(core, HandoverRequest(key, why)))
            assert asked == [ToVehicle(OnHandover(key, Consent.WAITING))]

    @pytest.mark.parametrize(("why", "consent"), [(Reason.REQUESTED, Consent.GRANTED), (Reason.ZONE, Consent.WAITING)])
    def test_before_the_vehicle_has_answered_it_counts_for_a_transfer_that_was_requested(
        self, why: Reason, consent: Consent
    ) -> None:
        core = partner(asks=True, ground=False)
        core.handle(Wish(B), NOW)
        asked = words(from_vehicle(core, HandoverRequest(KEY, why)))
        assert asked == [ToVehicle(OnHandover(KEY, consent, relay=consent is Consent.GRANTED))]

    def test_a_late_refusal_of_an_earlier_request_ends_the_wish_as_well(self) -> None:
        core = partner(asks=True)
        core.handle(Wish(B), NOW)
        core.handle(WishAnswered(B, accepted=True), NOW)
        core.handle(WishAnswered(B, accepted=False), NOW + 1.0)
        asked = words(from_vehicle(core, HandoverRequest(KEY, Reason.REQUESTED), NOW + 1.0))
        assert asked == [ToVehicle(OnHandover(KEY, Consent.WAITING))]

    @pytest.mark.parametrize("whom", [A, B, C])
    def test_a_commander_that_wants_to_give_has_consented_to_nobodys_request(self, whom: int) -> None:
        core = announced(station(A, asks=True))
        core.handle(Wish(whom), NOW)
        assert words(core.handle(FromPeer(B, OnHandover(KEY)), NOW)) == [ToVehicle(OkHandover(KEY, Consent.WAITING))]

    def test_is_used_up_by_one_transfer(self) -> None:
        core = partner(asks=True)
        core.handle(Wish(B), NOW)
        for _ in range(3):
            assert words(from_vehicle(core, HandoverRequest(KEY, Reason.REQUESTED)))[-1] == ToVehicle(OnHandover(KEY))
        later = TransferKey(A, B, 8, 3)
        assert words(from_vehicle(core, HandoverRequest(later))) == [ToVehicle(OnHandover(later, Consent.WAITING))]

    def test_it_was_about_the_commander_of_then(self) -> None:
        core = partner(asks=True)
        core.handle(Wish(B), NOW)
        core.handle(AuthorityHeard(Phase.ON_MISSION, C, None, 4), NOW)
        later = TransferKey(C, B, 8, 4)
        asked = words(from_vehicle(core, HandoverRequest(later, Reason.GIVEN)))
        assert asked == [ToVehicle(OnHandover(later, Consent.WAITING))]

    @pytest.mark.parametrize(("after_s", "consent"), [(59.9, Consent.GRANTED), (60.0, Consent.WAITING)])
    def test_stands_for_a_minute(self, after_s: float, consent: Consent) -> None:
        core = partner(asks=True, ground=False)
        core.handle(Wish(B), NOW)
        (word,) = words(from_vehicle(core, HandoverRequest(KEY, Reason.REQUESTED), NOW + after_s))
        assert word == ToVehicle(OnHandover(KEY, consent, relay=consent is Consent.GRANTED))

    def test_asked_for_again_it_stands_anew(self) -> None:
        core = partner(asks=True, ground=False)
        core.handle(Wish(B), NOW)
        core.handle(Wish(B), NOW + 50.0)
        asked = words(from_vehicle(core, HandoverRequest(KEY, Reason.REQUESTED), NOW + 100.0))
        assert asked == [ToVehicle(OnHandover(KEY, relay=True))]

    def test_changes_nothing_by_itself(self) -> None:
        core = announced(station(A))
        assert core.handle(Wish(A), NOW) == []
        assert core.handle(Wish(77), NOW) == []
        assert (core.role, core.question) == (Role.COMMANDER, None)


class TestReason:
    """What needs no operator is a matter of why the vehicle asks; that is the vehicle's to say, and nobody else's."""

    @pytest.mark.parametrize(
        ("why", "consent"),
        [
            (Reason.ZONE, Consent.GRANTED),
            (Reason.ZONE_ENDS, Consent.GRANTED),
            (Reason.LINK_QUALITY, Consent.GRANTED),
            (Reason.COMMANDER_LOST, Consent.GRANTED),
            (Reason.REQUESTED, Consent.WAITING),
            (Reason.GIVEN, Consent.WAITING),
            (Reason.NONE, Consent.WAITING),
            (Reason.OPERATOR, Consent.WAITING),
        ],
        ids=lambda value: value.name,
    )
    def test_what_another_operator_wants_or_gives_is_for_an_operator(self, why: Reason, consent: Consent) -> None:
        commander, taker = station(A), partner(ground=False)
        asked = from_vehicle(commander, OnHandover(KEY, reason=why, relayed=True))
        assert words(asked) == [ToVehicle(OkHandover(KEY, consent))]
        asked = from_vehicle(taker, HandoverRequest(KEY, why))
        assert words(asked) == [ToVehicle(OnHandover(KEY, consent, relay=consent is Consent.GRANTED))]

    def test_the_question_says_why(self) -> None:
        asked = from_vehicle(station(A), OnHandover(KEY, reason=Reason.REQUESTED, relayed=True))
        assert notices(asked) == [
            "GCSB is ready to take drone (request). Type 'handover accept' or 'handover deny'.",
        ]

    def test_the_configuration_names_others(self) -> None:
        core = StationCore(Station(A, "GCSA"), "drone", (Station(B, "GCSB"),), automatic=("request",))
        core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 3), NOW)
        for why, consent in ((Reason.REQUESTED, Consent.GRANTED), (Reason.ZONE, Consent.WAITING)):
            core._part = None
            asked = from_vehicle(core, OnHandover(KEY, reason=why, relayed=True))
            assert words(asked) == [ToVehicle(OkHandover(KEY, consent))]

    def test_who_asked_itself_is_not_asked_back(self) -> None:
        core = partner(ground=False)
        core.handle(Wish(B), NOW)
        asked = from_vehicle(core, HandoverRequest(KEY, Reason.REQUESTED))
        assert words(asked) == [ToVehicle(OnHandover(KEY, relay=True))]

    def test_to_ask_for_what_is_on_offer_is_to_accept_it(self) -> None:
        core = partner(ground=False)
        from_vehicle(core, HandoverRequest(KEY, Reason.GIVEN))
        assert core.question == KEY
        assert words(core.handle(Wish(B), NOW)) == [ToVehicle(OnHandover(KEY, relay=True))]

    def test_to_wish_a_third_station_well_accepts_nothing(self) -> None:
        core = partner(ground=False)
        from_vehicle(core, HandoverRequest(KEY, Reason.GIVEN))
        assert core.handle(Wish(C), NOW) == []
        assert core.question == KEY

    def test_to_accept_so_is_no_wish_for_another_transfer(self) -> None:
        core = partner(ground=False)
        from_vehicle(core, HandoverRequest(KEY, Reason.GIVEN))
        core.handle(Wish(B), NOW)
        later = TransferKey(A, B, 8, 3)
        asked = words(from_vehicle(core, HandoverRequest(later, Reason.GIVEN)))
        assert asked == [ToVehicle(OnHandover(later, Consent.WAITING))]

    @pytest.mark.parametrize("yes", [True, False])
    def test_to_ask_for_what_has_been_answered_answers_nothing(self, yes: bool) -> None:
        core = partner(asks=True)
        from_vehicle(core, HandoverRequest(KEY, Reason.GIVEN))
        core.handle(Answer(yes), NOW)
        assert core.handle(Wish(B), NOW) == []

    def test_a_peer_cannot_say_why(self) -> None:
        core = station(A)
        core.handle(AuthorityHeard(Phase.ON_HANDOVER, A, B, 3, 7, why=Reason.REQUESTED), NOW)
        asked = core.handle(FromPeer(B, OnHandover(KEY, reason=Reason.ZONE)), NOW)
        assert words(asked) == [ToVehicle(OkHandover(KEY, Consent.WAITING))]

    def test_the_same_question_for_a_graver_reason_is_answered_by_that(self) -> None:
        commander, taker = station(A), partner(ground=False)
        from_vehicle(commander, OnHandover(KEY, reason=Reason.REQUESTED, relayed=True))
        asked = from_vehicle(commander, passed_on())
        assert words(asked) == [ToVehicle(OkHandover(KEY))]
        assert notices(asked) == ["GCSB is ready to take drone (zone).", "Handover Authorized."]
        from_vehicle(taker, HandoverRequest(KEY, Reason.GIVEN))
        asked = from_vehicle(taker, HandoverRequest(KEY, Reason.COMMANDER_LOST))
        assert words(asked) == [ToVehicle(OnHandover(KEY, relay=True))]

    def test_but_not_where_the_operator_has_said_no(self) -> None:
        core = station(A)
        from_vehicle(core, OnHandover(KEY, reason=Reason.REQUESTED, relayed=True))
        core.handle(Answer(False), NOW)
        refusal = ToVehicle(OkHandover(KEY, Consent.DENIED, Reason.OPERATOR))
        assert from_vehicle(core, passed_on()) == [refusal]

    def test_a_question_ends_when_the_vehicle_is_about_another_transfer(self) -> None:
        core = partner()
        from_vehicle(core, HandoverRequest(KEY, Reason.GIVEN))
        actions = core.handle(AuthorityHeard(Phase.ON_HANDOVER, A, C, 3, 8, why=Reason.ZONE_ENDS), NOW)
        assert "Handover 7 is over." in notices(actions)
        assert core.question is None

    def test_even_where_nobody_commands(self) -> None:
        core = partner()
        from_vehicle(core, HandoverRequest(KEY, Reason.GIVEN))
        actions = core.handle(AuthorityHeard(Phase.EMERGENCY, None, C, 3, 8, why=Reason.COMMANDER_LOST), NOW)
        assert "Handover 7 is over." in notices(actions)
        assert core.question is None

    def test_news_of_one_that_is_over_ends_nothing(self) -> None:
        core = partner()
        from_vehicle(core, HandoverRequest(KEY, Reason.GIVEN))
        core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 3, 8), NOW)
        assert core.question == KEY

    def test_late_news_of_an_older_one_ends_nothing(self) -> None:
        core = partner()
        from_vehicle(core, HandoverRequest(KEY, Reason.GIVEN))
        core.handle(AuthorityHeard(Phase.ON_HANDOVER, A, C, 3, 6, why=Reason.ZONE), NOW)
        assert core.question == KEY


class TestRestarted:
    """A station that was started anew in the middle of a transfer finds its place by what the vehicle asks next."""

    def fresh(self, sysid: int) -> StationCore:
        peers = tuple(Station(other, name) for other, name in NAMES.items() if other != sysid)
        return StationCore(Station(sysid, NAMES[sysid]), "drone", peers, automatic=AUTOMATIC)

    def test_a_partner_is_asked_again_in_every_step(self) -> None:
        core = self.fresh(B)
        assert words(from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))) == [ToVehicle(OnHandover(KEY, relay=True))]
        core = announced(self.fresh(B))
        assert words(from_vehicle(core, ConnectHandover(KEY))) == [ToVehicle(DroneConnected(KEY, relay=True))]

    def test_a_commander_that_has_not_consented_is_asked_again(self) -> None:
        core = self.fresh(A)
        assert words(from_vehicle(core, passed_on(KEY))) == [ToVehicle(OkHandover(KEY))]

    def test_a_commander_that_has_consented_before_does_not_release_what_it_knows_nothing_of(self) -> None:
        # the vehicle commits without it after two seconds, and it learns of that from the result
        core = self.fresh(A)
        assert words(from_vehicle(core, DroneConnected(KEY, relayed=True))) == []
        committed = HandoverResult(TransferKey(A, B, 7, 4), B, Outcome.COMMITTED, Reason.RELEASE_TIMEOUT)
        from_vehicle(core, committed)
        assert (core.commander, core.epoch, core.role) == (B, 4, Role.OBSERVER)

    def test_it_takes_no_peers_word_before_it_knows_that_it_commands(self) -> None:
        core = self.fresh(A)
        assert core.handle(FromPeer(B, OnHandover(KEY)), NOW) == []
        core.handle(AuthorityHeard(Phase.ON_HANDOVER, A, B, 3, 7), NOW)
        assert core.handle(FromPeer(B, OnHandover(KEY)), NOW) != []


class TestResult:
    def test_is_acknowledged_by_state_every_time(self) -> None:
        core = partner()
        committed = HandoverResult(TransferKey(A, B, 7, 4), B, Outcome.COMMITTED, Reason.ZONE)
        ack = ToVehicle(ConnectAck(B, 1, 0, 4, B, "GCSB", b""))
        assert from_vehicle(core, committed) == [
            Notice("control_gained", "I have drone: GCSB is the commander now, epoch 4."),
            ack,
        ]
        assert from_vehicle(core, committed) == [ack]

    def test_an_abort_is_told_once_and_closes_the_question(self) -> None:
        core = partner(asks=True)
        from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))
        aborted = HandoverResult(KEY, A, Outcome.ABORTED, Reason.LEFT_REGION)
        assert notices(from_vehicle(core, aborted)) == ["Handover 7 aborted: left region."]
        assert core.question is None
        assert notices(from_vehicle(core, aborted)) == []
        assert notices(core.handle(Answer(True), NOW)) == ["There is no question to answer."]

    def test_a_new_epoch_closes_the_question_of_an_older_one(self) -> None:
        # the abort was lost; since then the commander was lost and has come back
        core = partner(asks=True)
        from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))
        core.handle(AuthorityHeard(Phase.ON_MISSION, None, None, 3), NOW)
        assert core.question == KEY
        core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 4), NOW)
        assert core.question is None
        assert words(core.handle(Answer(True), NOW)) == []

    def test_nobody_is_the_partner_any_more(self) -> None:
        core = announced(partner())
        assert core.role is Role.PARTNER
        from_vehicle(core, HandoverResult(KEY, A, Outcome.ABORTED, Reason.LEFT_REGION))
        assert (core.partner, core.role) == (None, Role.OBSERVER)

    def test_nobody_may_be_left_to_command(self) -> None:
        core = station(A)
        actions = from_vehicle(core, HandoverResult(KEY, None, Outcome.ABORTED, Reason.COMMANDER_LOST))
        text = "No station commands drone. When it is in your zone, type 'handover request' to take over."
        assert Notice("no_commander", text) in actions
        assert core.commander is None

    def test_of_another_transfer_leaves_the_question_open(self) -> None:
        core = partner(asks=True)
        from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))
        from_vehicle(core, HandoverResult(TransferKey(A, B, 6, 3), A, Outcome.ABORTED, Reason.CANCELLED))
        assert core.question == KEY


class TestVehicle:
    def test_is_announced_and_missed_once(self) -> None:
        core = StationCore(Station(A, "GCSA"), "drone", (), automatic=AUTOMATIC)
        assert core.tick(0.0) == []
        assert core.handle(VehicleHeard(), 10.0) == [Notice("connected", "drone is connected.")]
        assert core.handle(VehicleHeard(), 11.0) == []
        assert core.vehicle_alive(15.999)
        assert core.tick(15.999) == []
        assert core.tick(16.0) == [Notice("lost", "drone is not heard any more.")]
        assert core.tick(17.0) == []
        assert core.handle(VehicleHeard(), 20.0) == [Notice("connected", "drone is connected.")]

    def test_every_message_of_its_companion_is_a_sign_of_life(self) -> None:
        core = StationCore(Station(A, "GCSA"), "drone", (), automatic=AUTOMATIC)
        actions = from_vehicle(core, Connect(A, 1, 5, 0, None, "drone", b""), 10.0)
        assert notices(actions) == ["drone is connected."]
        assert core.vehicle_alive(14.0)

    def test_its_phases_are_read_once(self) -> None:
        core = station(A)
        event = AuthorityHeard(Phase.ON_HANDOVER, A, B, 3)
        assert core.handle(event, NOW) == [Notice("phase", "drone is on handover.")]
        assert core.handle(event, NOW) == []

    def test_silence_changes_no_belief(self) -> None:
        core = station(A)
        core.tick(NOW + 60.0)
        assert core.role is Role.COMMANDER


def test_a_stranger_has_a_name_all_the_same() -> None:
    core = station(A)
    assert [core.name(sysid) for sysid in (A, B, 77, 0, None)] == [
        "GCSA",
        "GCSB",
        "station 77",
        "no station",
        "no station",
    ]


@pytest.mark.parametrize(
    ("zone", "other", "name"),
    [(0, 0, "none"), (A, 0, "GCSA"), (A, B, "Handover Zone (GCSA and GCSB)"), (0, B, "none")],
)
def test_the_zones_of_two_stations_together_are_the_handover_zone(zone: int, other: int, name: str) -> None:
    assert station(A).zone_name(zone, other) == name


def test_a_partner_that_has_heard_of_the_transfer_by_its_announcement_alone_tells_how_its_commander_is_informed() -> (
    None
):
    core = station(B, epoch=3)
    core.handle(AuthorityHeard(Phase.ON_HANDOVER, A, B, 3, 7, why=Reason.ZONE), NOW)
    told = notices(core.handle(FromVehicle(ConnectHandover(KEY)), NOW))
    assert "GCSA is told by the vehicle: Drone Connected." in told


def test_after_an_epoch_that_no_flight_has_connect_is_believed_too() -> None:
    core = station(A, epoch=3)
    core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, EPOCH_MAX + 5), NOW)
    assert core.epoch == EPOCH_MAX + 5
    core.handle(FromVehicle(Connect(A, 1, 9, 4, B, "drone", DIGEST)), NOW)
    assert (core.commander, core.epoch) == (B, 4)


@pytest.mark.parametrize(("moved", "consent"), [(False, Consent.GRANTED), (True, Consent.WAITING)])
def test_a_request_for_control_was_to_the_commander_of_then(moved: bool, consent: Consent) -> None:
    core = station(B, asks=True)
    core.handle(Wish(B), NOW)
    core.handle(WishAnswered(B, True), NOW)
    if moved:
        core.handle(AuthorityHeard(Phase.ON_MISSION, C, None, 4), NOW)
    key = TransferKey(C, B, 8, 4) if moved else KEY
    actions = from_vehicle(core, HandoverRequest(key, Reason.ZONE))
    assert [action.message.consent for action in words(actions) if isinstance(action, ToVehicle)] == [consent]


class TestAfterAnEpochThatNoFlightHas:
    """The station starts afresh with the vehicle's next message."""

    def core(self) -> StationCore:
        core = station(B, epoch=3)
        core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, EPOCH_MAX + 5), NOW)
        return core

    @pytest.mark.parametrize("epoch", [0, 1, EPOCH_MAX])
    def test_every_epoch_that_a_flight_can_have_is_believed(self, epoch: int) -> None:
        core = self.core()
        core.handle(AuthorityHeard(Phase.ON_MISSION, C, None, epoch), NOW)
        assert (core.commander, core.epoch) == (C, epoch)

    def test_a_transfer_of_then_is_not_the_latest_one(self) -> None:
        core = self.core()
        from_vehicle(core, HandoverRequest(TransferKey(A, B, 9, EPOCH_MAX + 5), Reason.ZONE))
        core.handle(AuthorityHeard(Phase.ON_MISSION, A, None, 4), NOW)
        assert words(from_vehicle(core, HandoverRequest(TransferKey(A, B, 1, 4), Reason.ZONE)))

    def test_a_transfer_that_the_same_message_announces_is_known(self) -> None:
        core = self.core()
        key = TransferKey(A, B, 1, 4)
        announced(core, key)
        assert words(from_vehicle(core, ConnectHandover(key)))


def consents(actions: list[Action]) -> list[Consent]:
    return [
        action.message.consent
        for action in actions
        if isinstance(action, ToVehicle) and isinstance(action.message, (OnHandover, OkHandover))
    ]


def test_a_request_for_control_counts_for_one_transfer() -> None:
    core = station(B, asks=True)
    core.handle(Wish(B), NOW)
    core.handle(WishAnswered(B, True), NOW)
    later = TransferKey(A, B, 8, 3)
    assert consents(from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))) == [Consent.GRANTED]
    assert consents(from_vehicle(core, HandoverRequest(later, Reason.ZONE))) == [Consent.WAITING]
    assert consents(from_vehicle(core, HandoverRequest(later, Reason.ZONE))) == [Consent.WAITING]


def test_a_commander_that_asked_for_control_has_consented_to_no_handover() -> None:
    core = station(A, asks=True)
    core.handle(Wish(A), NOW)
    core.handle(WishAnswered(A, True), NOW)
    assert consents(from_vehicle(core, passed_on())) == [Consent.WAITING]


def test_nor_to_the_one_at_the_border_ahead() -> None:
    core = station(A, asks=True)
    core.handle(Wish(A), NOW)
    core.handle(WishAnswered(A, True), NOW)
    ahead = HandoverAhead(CrossingKey(A, B, 5, 3), 40.0)
    assert words(from_vehicle(core, ahead)) == [ToVehicle(OkAhead(ahead.key, Consent.WAITING))]


@pytest.mark.parametrize(("commander", "told"), [(A, 1), (None, 0)])
def test_how_the_commander_is_informed_is_told_of_a_commander_that_is_known(commander: int | None, told: int) -> None:
    core = station(B, commander=commander)
    texts = notices(from_vehicle(core, HandoverRequest(KEY, Reason.ZONE)))
    assert len([text for text in texts if text.startswith("GCSA is told")]) == told


def test_an_answer_to_another_stations_request_is_none_to_this_ones() -> None:
    core = station(B, asks=True)
    core.handle(Wish(B), NOW)
    core.handle(WishAnswered(C, True), NOW)
    assert consents(from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))) == [Consent.WAITING]


def test_a_request_that_answers_a_question_counts_for_no_other_transfer() -> None:
    core = station(B, asks=True)
    assert consents(from_vehicle(core, HandoverRequest(KEY, Reason.ZONE))) == [Consent.WAITING]
    assert consents(core.handle(Wish(B), NOW)) == [Consent.GRANTED]
    core.handle(WishAnswered(B, True), NOW)
    later = HandoverRequest(TransferKey(A, B, 8, 3), Reason.ZONE)
    assert consents(from_vehicle(core, later)) == [Consent.WAITING]
