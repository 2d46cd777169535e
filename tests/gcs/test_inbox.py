# SPDX-License-Identifier: GPL-3.0-or-later

"""What other stations send a station: offers, each for itself, that count when the vehicle or the operator says so."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.inbox import Inbox
from mavproxy_handover.mission import package as mission_package
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.wire.package_transfer import PackageSender
from tests.packages import MISSIONS, ROUND

B, C = 252, 253
RECEIVED, REFUSED = mavlink.HANDOVER_PACKAGE_RESULT_RECEIVED, mavlink.HANDOVER_PACKAGE_RESULT_REFUSED


@pytest.fixture(scope="module")
def delivery() -> MissionPackage:
    return mission_package.load(ROUND)


@pytest.fixture(scope="module")
def linear() -> MissionPackage:
    return mission_package.load(MISSIONS / "linear")


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mavproxy_handover.tools.worker.in_thread", lambda run: run())


def sent(
    inbox: Inbox, sysid: int, package: MissionPackage, digest: bytes | None = None, steps: int = 9
) -> PackageSender:
    """A station sends a package, so many messages of it at most each way."""
    sender = PackageSender(package.to_bytes(), digest or package.digest, package.name, (251, 0))
    messages = sender.tick(0.0)
    for _ in range(steps):
        answers = [answer for message in messages for answer in inbox.on_message(sysid, 190, message)]
        answers += [message for receiver, message in inbox.tick(0.0)[0] if receiver == sysid]
        messages = [message for answer in answers for message in sender.on_ack(answer, 0.0)]
    return sender


def test_two_stations_offers_wait_side_by_side(delivery: MissionPackage, linear: MissionPackage) -> None:
    inbox = Inbox(None)
    assert (sent(inbox, B, delivery).result, sent(inbox, C, linear).result) == (RECEIVED, RECEIVED)
    assert inbox.waiting == (delivery, linear)
    assert inbox.held is None
    assert inbox.accept_announced(linear.digest, disarmed=False) != ""
    assert (inbox.held, inbox.waiting) == (linear, (delivery,))


def test_what_one_station_sends_breaks_off_nothing_of_another(delivery: MissionPackage, linear: MissionPackage) -> None:
    """One that offers something new again and again kept all others from ever being done."""
    inbox = Inbox(None)
    sender = PackageSender(delivery.to_bytes(), delivery.digest, "delivery", (251, 0))
    messages = sender.tick(0.0)
    for number in range(9):
        offer = mavlink.MAVLink_mission_package_message(251, 0, 500, [number] * 32, b"noise")
        inbox.on_message(C, 190, offer)
        answers = [answer for message in messages for answer in inbox.on_message(B, 190, message)]
        answers += [message for _receiver, message in inbox.tick(0.0)[0]]
        messages = [message for answer in answers for message in sender.on_ack(answer, 0.0)]
    assert sender.result == RECEIVED


def test_what_the_vehicle_announced_before_the_offer_came_is_taken_when_it_is_asked_again(
    delivery: MissionPackage,
) -> None:
    inbox = Inbox(None)
    assert inbox.accept_announced(delivery.digest, disarmed=True) == ""
    sent(inbox, B, delivery)
    line = inbox.accept_announced(delivery.digest, disarmed=True)
    assert line == "Mission 'delivery', f433d144, is the vehicle's: taken."
    assert inbox.accept_announced(delivery.digest, disarmed=True) == ""


def test_an_offer_under_a_false_digest_never_counts(delivery: MissionPackage, linear: MissionPackage) -> None:
    inbox = Inbox(None)
    sender = sent(inbox, B, linear, delivery.digest)
    assert (sender.result, inbox.waiting) == (REFUSED, ())
    assert inbox.accept_announced(delivery.digest, disarmed=True) == ""


@pytest.mark.parametrize("own", [True, False])
def test_the_package_that_is_held_already_is_not_sent_again(delivery: MissionPackage, own: bool) -> None:
    inbox = Inbox(delivery if own else None)
    if not own:
        sent(inbox, B, delivery)
        inbox.accept_announced(delivery.digest, disarmed=True)
    assert sent(inbox, C, delivery, steps=1).result == RECEIVED


def test_by_name_or_by_the_head_of_its_digest(delivery: MissionPackage, linear: MissionPackage) -> None:
    inbox = Inbox(None)
    sent(inbox, B, delivery)
    sent(inbox, C, linear)
    short = linear.digest.hex()[:8]
    assert inbox.accept_offer("nothing", disarmed=True) == (
        f"No mission 'nothing' is offered; offered are: delivery (f433d144), linear ({short})."
    )
    assert inbox.accept_offer("", disarmed=True).startswith("Several missions are called that; offered are: ")
    assert inbox.accept_offer(short, disarmed=True) == f"Mission 'linear', {short}, taken."


def test_while_one_package_is_read_another_is_asked_to_come_again(
    delivery: MissionPackage, linear: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    jobs: list[Callable[[], None]] = []
    monkeypatch.setattr("mavproxy_handover.tools.worker.in_thread", jobs.append)
    inbox = Inbox(None)
    first = sent(inbox, B, delivery)
    assert (len(jobs), first.result) == (1, None)
    second = sent(inbox, C, linear)
    assert (second.result, second.text) == (REFUSED, "another package is being read: share it again")
    jobs.pop()()
    messages, lines = inbox.tick(1.0)
    assert [receiver for receiver, _message in messages] == [B]
    assert [sysid for sysid, _line in lines] == [B]


def test_an_internal_fault_while_reading_refuses_and_is_told(
    delivery: MissionPackage, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_data: bytes) -> Any:
        raise RuntimeError("planted")

    monkeypatch.setattr("gcs_module.inbox.from_bytes", broken)
    inbox = Inbox(None)
    sender = sent(inbox, B, delivery)
    assert (sender.result, sender.text) == (REFUSED, "internal fault: planted")
    assert inbox.waiting == ()


class TestKept:
    """A package that was taken outlives the station's program; the vehicle's announcement alone brings it back."""

    def flown(self, file: Path, package: MissionPackage) -> None:
        """A run in which the package was taken."""
        inbox = Inbox(None, file)
        sent(inbox, B, package)
        inbox.accept_announced(package.digest, disarmed=True)
        inbox.tick(0.0)
        inbox.tick(0.0)

    def begun(self, file: Path) -> Inbox:
        """The next run, when it has read what there is."""
        inbox = Inbox(None, file)
        inbox.tick(0.0)
        inbox.tick(0.0)
        return inbox

    def test_it_counts_again_in_flight_when_the_vehicle_announces_it(
        self, tmp_path: Path, delivery: MissionPackage
    ) -> None:
        self.flown(tmp_path / "kept", delivery)
        inbox = self.begun(tmp_path / "kept")
        assert inbox.held is None
        assert inbox.accept_announced(delivery.digest, disarmed=False) == (
            f"Mission 'delivery', {delivery.digest.hex()[:8]}, is the vehicle's: taken."
        )
        assert inbox.held == delivery

    def test_for_another_announcement_it_counts_for_nothing(
        self, tmp_path: Path, delivery: MissionPackage, linear: MissionPackage
    ) -> None:
        self.flown(tmp_path / "kept", delivery)
        inbox = self.begun(tmp_path / "kept")
        assert inbox.accept_announced(linear.digest, disarmed=True) == ""
        assert inbox.accept_announced(bytes(32), disarmed=True) == ""
        assert inbox.held is None

    def test_it_is_no_offer_that_an_operator_could_take(self, tmp_path: Path, delivery: MissionPackage) -> None:
        self.flown(tmp_path / "kept", delivery)
        inbox = self.begun(tmp_path / "kept")
        assert inbox.waiting == ()
        assert inbox.accept_offer("delivery", disarmed=True) == "No mission 'delivery' is offered; offered are: none."

    def test_an_offer_that_was_not_taken_is_not_kept(self, tmp_path: Path, delivery: MissionPackage) -> None:
        inbox = Inbox(None, tmp_path / "kept")
        sent(inbox, B, delivery)
        inbox.tick(0.0)
        assert not (tmp_path / "kept").exists()

    def test_a_station_with_a_folder_of_its_own_keeps_and_reads_nothing(
        self, tmp_path: Path, delivery: MissionPackage, linear: MissionPackage
    ) -> None:
        self.flown(tmp_path / "kept", delivery)
        inbox = Inbox(linear, tmp_path / "kept")
        inbox.tick(0.0)
        assert inbox.accept_announced(delivery.digest, disarmed=True) == ""
        assert inbox.held == linear

    @pytest.mark.parametrize("data", [b"", b"noise", bytes(65 * 1024)])
    def test_a_file_that_holds_no_package_is_told_and_does_no_harm(self, tmp_path: Path, data: bytes) -> None:
        (tmp_path / "kept").write_bytes(data)
        inbox = Inbox(None, tmp_path / "kept")
        lines = [*inbox.tick(0.0)[1], *inbox.tick(0.0)[1]]
        assert len(lines) == 1
        assert lines[0][1].startswith("The mission that was kept cannot be read: ")
        assert inbox.held is None

    def test_a_folder_that_cannot_be_written_is_told_and_the_package_counts(
        self, tmp_path: Path, delivery: MissionPackage
    ) -> None:
        inbox = Inbox(None, tmp_path / "not there" / "kept")
        sent(inbox, B, delivery)
        inbox.accept_announced(delivery.digest, disarmed=True)
        lines = [line for _ in range(3) for _who, line in inbox.tick(0.0)[1]]
        assert any(line.startswith("The mission is not kept for a restart: ") for line in lines)
        assert inbox.held == delivery
