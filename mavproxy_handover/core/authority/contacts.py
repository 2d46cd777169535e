# SPDX-License-Identifier: GPL-3.0-or-later

"""Questions to every station whether it is there (CONNECT), and answers to the same question.

After a restart in flight the vehicle asks as often as it repeats a message of a transfer: an answer brings back the
commander of the run before, and a lost question must not cost seconds. At other times `Presence.pause_s` sets the pause
between two questions: short while an answer is overdue, else by the share of answers (`Hearing.pause_s`). With one
question a second, a link that loses a third of everything leaves ten seconds without an answer several times in an
hour.

The results are in the station's `Presence`. Questions are numbered by nonces of this run: an answer to any other is
no proof, and is dropped.
"""

from __future__ import annotations

from mavproxy_handover.core.authority.authority import Authority
from mavproxy_handover.core.authority.presence import Presence
from mavproxy_handover.core.common.events import Action, Record, Send
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import Connect, ConnectAck
from mavproxy_handover.core.common.model import PROTOCOL_VERSION, Station

__all__ = ["Contacts"]


def _duty(operator: str, before: str, station: str) -> str:
    """Which operator is on duty at a station now, for people."""
    if not operator:
        return f"{before} has signed off at {station}"
    return f"{operator} is on duty at {station}" + (f", after {before}" if before else "")


class Contacts:
    """Every station of the mission, and the questions that are out. Times are monotonic seconds."""

    __slots__ = ("_limits", "_nonce", "_vehicle", "presence")

    def __init__(self, vehicle: str, stations: tuple[Station, ...], nonce: int, limits: Limits) -> None:
        self._vehicle = vehicle
        self._nonce = nonce
        self._limits = limits
        self.presence = {station.sysid: Presence(station, limits) for station in stations}

    def note_heard(self, station: int, now: float, actions: list[Action], *, commanded: bool = False) -> None:
        """A station is heard; a station that was away is asked at once. `commanded`: it waits to command again."""
        presence = self.presence[station]
        if not presence.alive(now):
            presence.hearing.begin(commanded=commanded)
            actions.append(Record("station_heard", f"{presence.station.name} is heard", station=station))
            presence.ask_at_once(now)
        presence.note_heard(now)

    def answer(
        self, station: int, question: Connect, authority: Authority, digest: bytes, actions: list[Action]
    ) -> None:
        """The vehicle's answer to a station's CONNECT."""
        accepted = question.protocol_version == PROTOCOL_VERSION
        commander = authority.view.commander
        answer = ConnectAck(
            station, PROTOCOL_VERSION, question.nonce, authority.epoch, commander, self._vehicle, digest, accepted
        )
        actions.append(Send(station, answer))

    def answered(
        self, station: int, answer: ConnectAck, now: float, actions: list[Action], *, grounded: bool = False
    ) -> str | None:
        """A station's answer to CONNECT; returns why it was dropped, None if it counts. `grounded`: nothing flies."""
        presence = self.presence[station]
        asked_at = presence.answers(answer.nonce, now)
        if asked_at is None:
            doubled = presence.answer is not None and answer.nonce == presence.answer.nonce
            return "doubled answer to CONNECT" if doubled else "stale answer to CONNECT"
        was_connected = presence.connected(now)
        was_barred = presence.hearing.barred
        before = "" if presence.answer is None else presence.answer.operator
        presence.answer_counts(answer, asked_at, now, at_once=grounded)
        if was_barred and not presence.hearing.barred:
            actions.append(Record("hears_again", f"{presence.station.name} hears the aircraft again", station=station))
        if not was_connected:
            actions.append(Record("connected", f"{presence.station.name} is connected", station=station))
        if answer.operator != before:
            text = _duty(answer.operator, before, presence.station.name)
            actions.append(Record("operator", text, station=station))
        return None

    def ask(self, authority: Authority, digest: bytes, now: float, actions: list[Action]) -> None:
        """Send the questions that are due."""
        limits = self._limits
        interval_s = limits.connect_interval_s
        if authority.recovering:
            interval_s = min(interval_s, limits.retry_first_s)
        for station, presence in self.presence.items():
            if now < presence.ask_at:
                continue
            self._nonce = self._nonce % 0xFFFFFFFF + 1
            pause_s = min(interval_s, presence.pause_s(now, owner=station == authority.owner))
            presence.ask(self._nonce, now, now + pause_s)
            commander = authority.view.commander
            question = Connect(
                station, PROTOCOL_VERSION, self._nonce, authority.epoch, commander, self._vehicle, digest
            )
            actions.append(Send(station, question))
