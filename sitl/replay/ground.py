# SPDX-License-Identifier: GPL-3.0-or-later

"""The stations of a replay: when each is heard, and what it answers.

No recording of the vehicle contains what a station sent in a transfer. So:

* Heartbeats come once a second. A commander's are in the tlog: where those stop for longer than `_GAP_S` while its
  lease goes on, it is silent until it is seen again.
* With a journal a station is there from the moment it was first heard. If it was lost, or missed as a partner, its
  silence began before that moment: as long before as the limits that were flown with say.
* A transfer gets the answers of the recorded transfer between the same two stations that is nearest in time. They come
  at the same time after its beginning; a missing answer stays missing. Without one, each step is granted after
  `_ANSWER_S`.
* A silent station answers nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.messages import (
    Connect,
    ConnectAck,
    ConnectHandover,
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
from mavproxy_handover.core.common.model import PROTOCOL_VERSION, Consent
from sitl.replay.happened import Answer, Happened, Transfer, nearest
from sitl.replay.recording import COMMANDED, Recording

__all__ = ["Ground", "Silence", "silences"]

#: a commander without a heartbeat in the file for this time (s) is silent: it sends one a second
_GAP_S: Final = 2.2
_ANSWER_S: Final = 0.01
#: a crossing that was foreseen is answered as one that was foreseen so near to it (s)
_ALIKE_S: Final = 60.0

#: from and until when a station is silent (UTC s)
Silence = tuple[float, float]
#: hands a message to the rules at a time: station, message, time
Later = Callable[[int, Message, float], None]


def silences(
    recording: Recording, happened: Happened | None, sysids: dict[str, int], flown: Limits
) -> dict[int, list[Silence]]:
    """When each station is silent, as far as anything says so."""
    found: dict[int, list[Silence]] = {sysid: [] for sysid in sysids.values()}
    for sysid in found:
        found[sysid] += _unheard_commander(recording, sysid)
    if happened is None:
        return found
    for name, sysid in sysids.items():
        heard = [at for at, station in happened.heard if station == name]
        if not heard or heard[0] > recording.begin:
            found[sysid].append((-float("inf"), heard[0] if heard else float("inf")))
        missed = [(at, flown.heartbeat_lost_s) for at, station in happened.lost if station == name]
        missed += [(at, flown.connect_lost_s) for at, station in happened.unfit if station == name]
        for at, before_s in sorted(missed):
            begin = at - before_s
            if any(since - 1.5 <= begin <= until for since, until in found[sysid]):
                continue
            found[sysid].append((begin, min((back for back in heard if back > at), default=float("inf"))))
    return found


def _unheard_commander(recording: Recording, sysid: int) -> list[Silence]:
    beats = recording.station_beats.get(sysid, [])
    found: list[Silence] = []
    commanded = [(at, lease.commander == sysid and lease.state in COMMANDED) for at, lease in recording.leases]
    for index, at in enumerate(beats):
        back = beats[index + 1] if index + 1 < len(beats) else float("inf")
        if back - at <= _GAP_S:
            continue
        # it has to be the commander all that while: the autopilot hears no other's heartbeats
        within = [ours for lease_at, ours in commanded if at < lease_at < min(back, at + _GAP_S)]
        if within and all(within):
            found.append((at, back))
    return found


class Ground:
    """All stations. `later` hands a message to the rules at its time; times are UTC (s)."""

    def __init__(
        self, names: dict[int, str], silent: dict[int, list[Silence]], happened: Happened | None, later: Later
    ) -> None:
        self._names, self._silent, self._happened, self._later = names, silent, happened, later
        self._sysids = {name: sysid for sysid, name in names.items()}
        #: by number and epoch of the transfer: how it was answered when it was flown, None: nothing like it was
        self._like: dict[tuple[int, int], tuple[float, Transfer | None]] = {}
        #: what was answered already: its copies bring nothing new
        self._said: set[tuple[object, ...]] = set()
        #: transfers and foreseen crossings whose answers were not recorded
        self.assumed = 0

    def there(self, station: int, at: float) -> bool:
        """Whether a station is heard at that time."""
        return not any(since < at < until for since, until in self._silent[station])

    def silent(self, station: int) -> list[Silence]:
        """When a station is not heard."""
        return self._silent[station]

    def hears(self, station: int, message: Message, digest: bytes, now: float) -> None:
        """The vehicle says something to a station."""
        match message:
            case Connect():
                answer = ConnectAck(
                    station, PROTOCOL_VERSION, message.nonce, message.epoch, message.commander,
                    self._names[station], digest,
                )  # fmt: skip
                self._say(station, answer, now + _ANSWER_S)
            case HandoverAhead():
                self._ahead(station, message, now)
            case HandoverRequest():
                self._requested(station, message, now)
            case ConnectHandover():
                self._connects(station, message.key, now)
            case HandoverResult():
                key = message.key
                answer = ConnectAck(
                    station, PROTOCOL_VERSION, 0, key.epoch, message.commander, self._names[station], digest
                )
                self._say(station, answer, now + _ANSWER_S)
            case OnHandover():  # passed on by the vehicle, where the stations have no link: the answer is on its way
                self._consents(station, message.key, now)
            case _:
                pass

    def _say(self, station: int, message: Message, at: float) -> None:
        if self.there(station, at):
            self._later(station, message, at)

    def _ahead(self, station: int, message: HandoverAhead, now: float) -> None:
        if ("ahead", station, message.key) in self._said:
            return
        self._said.add(("ahead", station, message.key))
        granted = True
        if self._happened is not None:
            near = [
                (abs(at - now), agrees)
                for at, name, agrees in self._happened.foreseen
                if name == self._names[station] and abs(at - now) <= _ALIKE_S
            ]
            granted = min(near)[1] if near else True
            self.assumed += not near
        if granted:
            self._say(station, OkAhead(message.key), now + _ANSWER_S)

    def _answers(self, key: TransferKey, now: float) -> tuple[float, list[Answer] | None]:
        """When this transfer began, and what was answered in the recorded one that is next to it."""
        known = self._like.get((key.handover_id, key.epoch))
        if known is None:
            transfers = () if self._happened is None else self._happened.transfers
            names = self._names.get(key.from_station, ""), self._names.get(key.to_station, "")
            known = self._like[key.handover_id, key.epoch] = now, nearest(transfers, *names, now)
            self.assumed += known[1] is None
        return known[0], None if known[1] is None else known[1].answers

    def _step(self, key: TransferKey, station: int, name: str, now: float) -> list[tuple[float, Consent]]:
        """When a station takes a step, and with which consent; empty for further copies of the question."""
        if (key, station, name) in self._said:
            return []
        self._said.add((key, station, name))
        began, answers = self._answers(key, now)
        if answers is None:
            return [(now + _ANSWER_S, Consent.GRANTED)]
        mine = [each for each in answers if (each.station, each.name) == (self._names[station], name)]
        return [(max(now + 1e-3, began + each.after_s), each.consent or Consent.GRANTED) for each in mine]

    def _requested(self, partner: int, message: HandoverRequest, now: float) -> None:
        key = message.key
        for at, consent in self._step(key, partner, "ON_HANDOVER", now):
            self._say(partner, OnHandover(key, consent, crossing=message.crossing), at)
            if consent is Consent.GRANTED:
                self._consents(key.from_station, key, at)

    def _consents(self, commander: int, key: TransferKey, now: float) -> None:
        if commander in self._names:
            for at, consent in self._step(key, commander, "OK_HANDOVER", now):
                self._say(commander, OkHandover(key, consent), at)

    def _connects(self, partner: int, key: TransferKey, now: float) -> None:
        for at, _consent in self._step(key, partner, "DRONE_CONNECTED", now):
            self._say(partner, DroneConnected(key), at)
            if key.from_station in self._names:
                for then, _ in self._step(key, key.from_station, "DISCONNECT_HANDOVER", at):
                    self._say(key.from_station, DisconnectHandover(key), then)
