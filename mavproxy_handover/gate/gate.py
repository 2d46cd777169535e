# SPDX-License-Identifier: GPL-3.0-or-later

"""The gate between stations and autopilot: every frame of a station passes it, up and down.

Up (`up`): the policy judges a frame of a station (`judge.py`), then the filters do (`filters.py`). The verdict is
final. The frame goes to the autopilot byte for byte, or is answered, or the companion carries it out. Down (`down`): a
frame of the vehicle goes to the stations that may hear it (`downlink.py`). `change` puts another authority in force.

Rules
-----
1. There is one view (`in_force.py`). Only `change` replaces it, as a whole.
2. Nothing delays a frame that may pass (`passed.py`).
3. Every refusal is answered in its protocol, and a text says why (`replies.py`). What is dropped and may be meant by a
   person gets such a text, too.
4. What a former commander left open at the autopilot is closed in its name (`flush.py`), before anything else is sent
   for the new commander. Then the last heartbeat of the new commander is passed on if it is fresh, because the
   autopilot watches that station from now on. At arming, open parameter and mission files are discarded: no station may
   write them in flight.
5. Stations hear one manager, the companion: CONTROL_STATUS of another component of the vehicle is not passed on.
6. Sticks and setpoints that a station sent before it had authority are refused until they have stopped once
   (`stale_streams.py`).
7. In flight, the situation decides whether a command of the commander passes (`CompanionMatters.command_passes`), and
   whether a guided target does, at whatever rate targets come (`targets.py`).
8. Stations hear one companion. A frame from the vehicle's side is counted and not passed on in two cases. It has the
   component id of the companion, of its language or of its link probes; or it is a message of `wire/handover.xml`. It
   would be signed with the stations' keys, and they would believe it.
9. In flight, the companion carries out commands that this autopilot does not know (`CompanionMatters.takes_over`: STOP
   of a plane). Only the commander's pass, as with any command.
10. Frames of downloads go after all others (`downloads.py`). One station at a time reads flight logs, and none while
    the vehicle is armed (`log_turn.py`).
11. Answers of the autopilot to the companion's own reads of parameters are not passed on (`own_reads.py`).
12. A frame that is addressed to a payload manager on board goes there, and never to the autopilot. What a manager says
    goes to the stations that may hear the vehicle, and to the station with that payload (`policy/managers.py`).

A fault while a frame is noted costs that note; a fault while a station is written to costs that frame. Both are
reported. Any other exception goes to the caller.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView
from mavproxy_handover.gate.downloads import DOWNLOADS, LOG_ANSWERS, LOG_REQUESTS, Downloads
from mavproxy_handover.gate.filters import CompanionMatters, Filters
from mavproxy_handover.gate.flush import Closing
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.gate.judge import Fate, GateReason, Verdict, decide, usual
from mavproxy_handover.gate.naming import named
from mavproxy_handover.gate.passed import PassedFrames
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.payload import KIND_OF_COMPONENT
from mavproxy_handover.gate.port import Port
from mavproxy_handover.gate.refusal_text import unsaid
from mavproxy_handover.gate.replies import GateReports, Replies
from mavproxy_handover.wire.frames import Frame, target
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, COMPANION_COMPID, LANGUAGE_COMPID, OUR_MESSAGES, PROBE_COMPID

__all__ = ["UNNOTED", "Gate"]

_HEARTBEAT: Final[int] = mavlink.MAVLINK_MSG_ID_HEARTBEAT
_CONTROL_STATUS: Final[int] = mavlink.MAVLINK_MSG_ID_CONTROL_STATUS
_TERRAIN_REQUEST: Final[int] = mavlink.MAVLINK_MSG_ID_TERRAIN_REQUEST
_PARAM_VALUE: Final[int] = mavlink.MAVLINK_MSG_ID_PARAM_VALUE
#: answers and requests of the autopilot that go to the stations that asked, or that are to answer
_CHOSEN: Final = LOG_ANSWERS | {_TERRAIN_REQUEST}
#: components of the vehicle that only the companion speaks as (rule 8)
_OURS: Final = frozenset((COMPANION_COMPID, LANGUAGE_COMPID, PROBE_COMPID))
#: classes of the commander's frames that may come often (rule 2)
_FREQUENT: Final = frozenset((Access.READ, Access.BULK, Access.STREAM, Access.FEED))
#: constants, because Python 3.11 takes 0.1 us to look up a member of an enumeration
_FORWARD: Final = Fate.FORWARD
_REFUSE: Final = Fate.REFUSE
_DROP: Final = Fate.DROP
_LIVENESS: Final = Access.LIVENESS
#: the most frames that wait to be noted
UNNOTED: Final = 512
#: a heartbeat of this age (s) still says that its station lives
_HEARTBEAT_FRESH_S: Final = 2.0


class Gate:
    """The gate of one vehicle. Times are monotonic seconds; not safe for threads."""

    def __init__(
        self,
        vehicle: int,
        ports: Mapping[int, Port],
        in_force: AuthorityInForce,
        passed: PassedFrames,
        to_autopilot: Callable[[bytes], None],
        reports: GateReports,
        matters: CompanionMatters,
    ) -> None:
        """`vehicle`: its system id; `ports`: every known station by system id; `to_autopilot` takes whole frames."""
        #: frames of the vehicle's side in the companion's name or language, by system and component (rule 8)
        self.in_our_name: Counter[tuple[int, int]] = Counter()
        self.downloads = Downloads(ports, to_autopilot, reports.fault)
        self._vehicle = vehicle
        self._ports = ports
        self._in_force = in_force
        self._passed = passed
        self._to_autopilot = to_autopilot
        self._matters = matters
        self._filters = Filters(in_force, passed, matters)
        self._replies = Replies(vehicle, ports, in_force, passed.log_turn, reports)
        self._names = {station: port.name for station, port in ports.items()}

    @property
    def view(self) -> AuthorityView:
        """The authority in force."""
        return self._in_force.view

    @property
    def counts(self) -> dict[int, Counter[GateReason]]:
        """The number of frames of each station, by the reason of their verdict."""
        return self._passed.counts

    # ---- up -------------------------------------------------------------------------------------------------------

    def sign_of_life(self, port: Port, frame: Frame) -> bool:
        """Whether a frame is the station's own heartbeat. The caller handles it before it is judged: a commander that
        was lost may command again by it."""
        own = frame.sysid == port.sysid != self._vehicle and port.identity.speaks(frame)
        return frame.msgid == _HEARTBEAT and own and frame.known

    def up(self, port: Port, frame: Frame, now: float) -> Verdict:
        """A frame that came from a station: the verdict.

        The frame is passed on or answered here. The caller carries out what the companion has to do (CONSUME), and
        tells people.
        """
        passed = self._passed
        view, identity = self._in_force.view, port.identity
        commands = port.sysid == view.commander
        verdict = usual(frame, identity, view, self._vehicle)
        if verdict is None:
            speaks = identity.speaks(frame)
            verdict = decide(frame, identity, speaks, view, self._vehicle, self._matters.modes())
            commands = commands and speaks
        if not commands and passed.unnoted:
            passed.note_for(view.commander)
        verdict = self._filters.limit(frame, verdict, port.sysid, commands, now)
        if passed.stale_streams.untold:
            self._replies.tell_streams(passed.stale_streams, now)
        if not commands:
            passed.rates.note_heard(port.sysid, now)
        if verdict.fate is _FORWARD:
            if self._filters.to_manager(frame):
                passed.to_manager(port, frame, verdict, now)
                self._matters.to_manager(frame, now)
                return verdict
            if frame.msgid in LOG_REQUESTS:
                self.downloads.asked(port, frame, now)
            else:
                self._to_autopilot(frame.raw)
            unnoted = passed.unnoted
            unnoted.append((port, frame, verdict, now))
            if not commands or verdict.access not in _FREQUENT or len(unnoted) >= UNNOTED:
                passed.note()
            return verdict
        passed.counts[port.sysid][verdict.reason] += 1
        if verdict.access is _LIVENESS and frame.sysid == port.sysid:
            passed.stale_streams.beat(port.sysid)
        if verdict.fate is _REFUSE:
            self._replies.refuse(port, frame, verdict, self._matters.modes(), now)
        elif verdict.fate is _DROP:
            self._replies.drop(port, frame, verdict, self._matters.modes(), now)
        elif verdict.reason is GateReason.OBSERVER_RATES:
            self._replies.answer_rates(port, frame, passed.rates, now)
        return verdict

    def release(self, port: Port, frame: Frame, verdict: Verdict, now: float) -> Verdict:
        """Pass on a command of the commander that the companion held on the ground, until the mission was read back.
        Returns the verdict now."""
        assert self._in_force.commands(port.sysid)
        forwarded = Verdict(Fate.FORWARD, verdict.access, GateReason.ALLOWED, verdict.what)
        self._to_autopilot(frame.raw)
        self._passed.unnoted.append((port, frame, forwarded, now))
        self._passed.note()
        return forwarded

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        passed = self._passed
        passed.note()
        passed.stale_streams.tick(self._in_force.view.commander, now)
        self.downloads.tick(now)
        self._replies.tell_streams(passed.stale_streams, now)
        passed.feeds.tick(now)  # last: a fault here costs only the news of feeds
        self._replies.tell_feeds(passed.feeds, now)

    def unsaid(self, frame: Frame) -> str:
        """What the name of a refused frame leaves open, such as the mode; "" if the name says all."""
        return unsaid(frame, modes=self._matters.modes())

    # ---- down -----------------------------------------------------------------------------------------------------

    def down(self, frame: Frame, now: float) -> bool:
        """A frame that came from the vehicle's side: it goes to the stations that may hear it.

        False: it has the companion's name or language (rule 8); the caller tells people.
        """
        passed = self._passed
        if frame.msgid in OUR_MESSAGES or (frame.compid in _OURS and frame.sysid == self._vehicle):
            self.in_our_name[frame.sysid, frame.compid] += 1
            return False
        if frame.sysid == self._vehicle and frame.known:
            if frame.msgid == _CONTROL_STATUS:
                return True
            if frame.compid == AUTOPILOT_COMPID:
                passed.flusher.note_reply(frame)
                if frame.msgid == _PARAM_VALUE and passed.own_reads.keeps(frame, now):
                    return True
        raw = named(frame, self._names)
        receivers = passed.downlink.receivers(frame, self._ports, self._in_force.view, now)
        if frame.msgid in _CHOSEN:
            receivers = self._chosen(frame, receivers, now)
        if frame.msgid in DOWNLOADS:
            for station in receivers:
                self.downloads.forward(self._ports[station], frame, raw, now)
            return True
        for station in receivers:
            self._replies.send(self._ports[station], raw)
        return True

    def _chosen(self, frame: Frame, receivers: list[int], now: float) -> list[int]:
        """The stations that get a message of `_CHOSEN`. `receivers`: those that hear everything now."""
        passed = self._passed
        if frame.msgid in LOG_ANSWERS:
            reader = passed.log_turn.reader(now)
            passed.log_turn.answered(now)
            return receivers if reader is None else [reader]
        return passed.feeds.terrain_asked(frame, receivers, now) if frame.known else receivers

    def from_manager(self, frame: Frame, now: float) -> None:
        """A frame of a payload manager that its rights let pass (`onboard.py`), for the stations (rule 12)."""
        downlink, aim = self._passed.downlink, target(frame)
        general = aim is None or aim[0] in (0, self._vehicle)
        if not general and aim is not None and not downlink.is_station(aim[0]):
            return
        receivers = downlink.receivers(frame, self._ports, self._in_force.view, now)
        holder = self._matters.payload(KIND_OF_COMPONENT[frame.compid])
        if general and holder is not None and holder in self._ports and holder not in receivers:
            receivers.append(holder)
        for station in receivers:
            self._replies.send(self._ports[station], frame.raw)

    # ---- authority ------------------------------------------------------------------------------------------------

    def change(self, view: AuthorityView, now: float) -> list[tuple[int, Closing]]:
        """Put this view in force, and close what must be closed at the autopilot (rule 4).

        Returns what was closed, and whose it was, for the journal.
        """
        passed = self._passed
        before, self._in_force.view = self._in_force.view, view
        if passed.unnoted:
            passed.note_for(before.commander)
        closed: list[tuple[int, Closing]] = []
        if view.commander != before.commander:
            if passed.log_turn.station(now) in (None, before.commander):
                self._end_logs()
            passed.stale_streams.authority_ends(before.commander, now)
            if before.commander is not None:
                left_open = passed.flusher.flush(before.commander, ends_streams=self._matters.modes().takes_velocities)
                closed += passed.close(before.commander, left_open)
            successor = None if view.commander is None else self._ports.get(view.commander)
            if successor is not None and now - successor.heartbeat_at < _HEARTBEAT_FRESH_S:
                self._to_autopilot(successor.heartbeat)
        if view.armed and not before.armed:
            closed += self._no_logs_while_armed(now)
            if view.commander is not None:
                closed += passed.close(view.commander, passed.flusher.arming())
        return closed

    def _end_logs(self) -> None:
        self.downloads.forget()
        self._passed.log_turn.ends()

    def _no_logs_while_armed(self, now: float) -> list[tuple[int, Closing]]:
        """The vehicle is armed: end the download of logs, and say so to its station."""
        reader = self._passed.log_turn.station(now)
        if reader is not None:
            self._replies.log_ended(reader, now)
        self._end_logs()
        closed: list[tuple[int, Closing]] = []
        for station, closing in self._passed.flusher.end_logs():
            closed += self._passed.close(station, [closing])
        return closed

    def distrust(self) -> None:
        """The gate starts, perhaps in flight: what stations sent before is not known (rule 6)."""
        self._passed.stale_streams.distrust()
