# SPDX-License-Identifier: GPL-3.0-or-later

"""The door between stations and autopilot: all frames of stations go through here, up and down.

Up (`up`): a frame of a station is judged (`judge`), and may have to wait (`questions`). Then it goes to the autopilot
byte for byte, or is answered, or is the companion's own business; the verdict says which. Down (`down`): a frame of the
vehicle goes to the stations that hear it (`downlink`). `change`: authority, and with it what passes, is another from
now on.

Rules that live here
--------------------
1. One view. What is judged by is swapped whole (`change`), and nowhere else.
2. Nothing delays a frame that may pass: what it means for the gate (what it asks, what it leaves open at the autopilot)
   is noted behind it. What may come often, a commander's streams and questions, is noted with the next tick (`note`):
   several together cost much less than each by itself. But it is noted before another station's frames and before a
   change, and what opens something that an answer of the autopilot may close is noted at once.
3. Every refusal is answered in its protocol's own way, and a text says why (`words`), but neither in a storm: whether
   there is one is known before anything is made of it (`refusals`). What an observer wants to hear is the companion's
   to give (`observers`): the autopilot is not asked for more.
4. What a former commander left open at the autopilot is closed in its own name (`flush`), before anything else is sent
   for the new one; then the successor's last heartbeat is passed on if it is fresh: the autopilot watches this station
   from now on. At arming, parameter and mission files that are being written are thrown away: nobody may write those
   in flight.
5. The stations hear one manager, the companion: CONTROL_STATUS of anybody else on board goes no further.
6. Sticks and setpoints that a station already sent before it had control are refused until they have ended once, and
   the station is told (`latent`).
7. In flight a guided target is judged by the situation before it passes, whatever rate it comes at (`targets`).
8. The stations hear one companion: what comes from the vehicle's side in its name (its component, those of its language
   and of its link probes) or in its language (the messages of `handover.xml`, whoever says them) stays aboard and is
   counted. It would be sealed with the stations' keys, and they would believe it. The companion's own words do not come
   this way.
9. What the autopilot of this aircraft does not know and the companion does in its place (`takes_over`: a plane's STOP)
   is the companion's matter in flight. The verdict is the same: the commander's passes, and nobody else's.
10. What a station asks of a file that the companion serves in the autopilot's place is the companion's matter; which
   requests those are, whoever serves it knows (`of_served_file`).
11. Frames of downloads (`_DOWNLOADS`) go after all others. Several share a datagram, which leaves at the end of a round
    of the main loop at the latest (`send_downloads`). The commander's LOG_DATA is paced (`log_download`).
12. What the autopilot answers to the companion's own reads of parameters stays aboard (`own_reads`).

What breaks in the noting of a frame costs that frame's note, and a station that cannot be written to what was for it;
both are told. Whatever else raises is the caller's.
"""

from __future__ import annotations

import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Final, Protocol

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView, Phase
from mavproxy_handover.gate.downlink import DownlinkPolicy
from mavproxy_handover.gate.flush import Closing, FlushTracker
from mavproxy_handover.gate.intent import TARGET_MESSAGES
from mavproxy_handover.gate.judge import Fate, GateReason, StationIdentity, Verdict, judge, outcome
from mavproxy_handover.gate.latent import LatentStreams, News, State, arms, lines
from mavproxy_handover.gate.log_download import LogDownload
from mavproxy_handover.gate.naming import named
from mavproxy_handover.gate.observers import ObserverLimits, ObserverRates
from mavproxy_handover.gate.own_reads import OwnReads
from mavproxy_handover.gate.policy.access import Access
from mavproxy_handover.gate.policy.modes import COPTER, Modes
from mavproxy_handover.gate.questions import Questions
from mavproxy_handover.gate.refusals import OncePerCause, RefusalLimiter, has_words, line_of_text, refusal
from mavproxy_handover.gate.targets import TargetStreams
from mavproxy_handover.gate.tongues import Tongues
from mavproxy_handover.gate.words import sentence, subject_of, unsaid
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame, parse_one
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, COMPANION_COMPID, LANGUAGE_COMPID, OUR_MESSAGES, PROBE_COMPID

__all__ = ["UNNOTED", "Gate", "Port"]

_HEARTBEAT: Final[int] = mavlink.MAVLINK_MSG_ID_HEARTBEAT
_FTP: Final[int] = mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL
_CONTROL_STATUS: Final[int] = mavlink.MAVLINK_MSG_ID_CONTROL_STATUS
#: components of the vehicle that only the companion speaks as (rule 8)
_OURS: Final = frozenset((COMPANION_COMPID, LANGUAGE_COMPID, PROBE_COMPID))
#: of the commander's frames, what may come often (rule 2)
_FREQUENT: Final = frozenset((Access.READ, Access.BULK, Access.STREAM))
_STREAM: Final = Access.STREAM
_PARAM_VALUE: Final[int] = mavlink.MAVLINK_MSG_ID_PARAM_VALUE
_LOG_DATA: Final[int] = mavlink.MAVLINK_MSG_ID_LOG_DATA
_LOG_REQUESTS: Final = frozenset(
    (
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST,
        mavlink.MAVLINK_MSG_ID_LOG_ERASE,
    )
)
#: what comes in long rows
_DOWNLOADS: Final = frozenset((_LOG_DATA, _PARAM_VALUE, _FTP))
_WARNINGS: Final = (State.REFUSED, State.RAN_BEFORE)
#: frames that wait to be noted, at most
UNNOTED: Final = 512
#: a heartbeat this old still says that its station lives
_HEARTBEAT_FRESH_S: Final = 2.0
#: answers to wishes for rates, of one station
_RATE_ANSWERS_PER_S: Final = 20


class Port(Protocol):
    """A station as far as the gate needs it."""

    @property
    def sysid(self) -> int:
        """The station's system id."""

    @property
    def name(self) -> str:
        """What people call it."""

    @property
    def tongues(self) -> Tongues:
        """What its programs have shown to understand."""

    @property
    def identity(self) -> StationIdentity:
        """Who may speak on its links."""

    @property
    def heartbeat(self) -> bytes:
        """Its last heartbeat, a whole frame; empty before there was one."""

    @property
    def heartbeat_at(self) -> float:
        """When that came (monotonic s)."""

    def write(self, data: bytes) -> None:
        """Send it a whole frame."""

    def write_more(self, data: bytes) -> bool:
        """Send it a whole frame of a download, of which more follow; False: not now."""

    def flush(self) -> None:
        """Send what `write_more` kept."""

    @property
    def flow_controlled(self) -> bool:
        """Whether `write_more` refuses what the station cannot take yet."""


class Gate:
    """The gate of one vehicle. Times are monotonic seconds; not safe for threads."""

    def __init__(
        self,
        vehicle: int,
        ports: Mapping[int, Port],
        limits: ObserverLimits,
        to_autopilot: Callable[[bytes], None],
        fault: Callable[[str, str], None],
        told: Callable[[News, float], None],
        say: Callable[[int, str, float], None],
    ) -> None:
        """`vehicle`: its system id; `ports`: every known station by system id; `to_autopilot` takes whole frames;
        `fault` is told what broke, and where, `told` what a station was told of its sticks and setpoints; `say` tells a
        station in words why something is refused."""
        self.view = AuthorityView(armed=True)
        #: what became of every station's frames and why
        self.counts: dict[int, Counter[GateReason]] = {station: Counter() for station in ports}
        #: frames of the vehicle's side in the companion's name or language, by system and component (rule 8)
        self.in_our_name: Counter[tuple[int, int]] = Counter()
        self._vehicle = vehicle
        self._ports = ports
        self._names = {station: port.name for station, port in ports.items()}
        self._to_autopilot = to_autopilot
        self._fault = fault
        self._told = told
        self._say = say
        #: whether the companion carries this out in the autopilot's place; whoever knows the aircraft sets it
        self.takes_over: Callable[[Frame], bool] = lambda _frame: False
        #: what a station's request of file transfer takes that belongs to a file which the companion serves, None: it
        #: belongs to none; whoever serves one sets it
        self.of_served_file: Callable[[int, Frame], Access | None] = lambda _station, _frame: None
        #: what the numbers of its modes mean; whoever knows the autopilot sets it
        self.modes: Modes = COPTER
        self._flusher = FlushTracker(vehicle)
        self._questions = Questions(self._flusher)
        self._latent = LatentStreams(ports)
        #: whoever knows the situation sets `judge` of it
        self.targets = TargetStreams()
        self._own_reads = OwnReads()
        self._rates = ObserverRates(limits)
        self._downlink = DownlinkPolicy((port.identity for port in ports.values()), self._rates)
        self._refusals = RefusalLimiter()
        self._in_words = OncePerCause()
        self._log_download = LogDownload(to_autopilot)
        #: `send_downloads` has something to do
        self.downloads_wait = False
        self._rate_answers = RefusalLimiter(_RATE_ANSWERS_PER_S)
        self._own = mavlink.MAVLink(None, srcSystem=vehicle, srcComponent=COMPANION_COMPID)
        self._as_autopilot = mavlink.MAVLink(None, srcSystem=vehicle, srcComponent=AUTOPILOT_COMPID)
        #: frames that went to the autopilot and are not noted yet (rule 2)
        self._passed: list[tuple[Port, Frame, Verdict, float]] = []

    @property
    def unnoted(self) -> int:
        """Frames that wait to be noted."""
        return len(self._passed)

    # ---- up -------------------------------------------------------------------------------------------------------

    def sign_of_life(self, port: Port, frame: Frame) -> bool:
        """Whether a frame is the station's own heartbeat. The caller hears of it before it is judged: a commander that
        was lost may command again by it."""
        own = frame.sysid == port.sysid != self._vehicle and port.identity.speaks(frame)
        return frame.msgid == _HEARTBEAT and own and frame.known

    def up(self, port: Port, frame: Frame, now: float) -> Verdict:
        """A frame that came from a station: what becomes of it.

        It is passed on or answered here. What is left to the caller is what the companion itself has to do about it
        (CONSUME), and to tell people.
        """
        verdict = judge(frame, port.identity, self.view, self._vehicle, self.modes)
        if verdict.access is _STREAM:
            verdict = self._latent.limit(frame, verdict, port.sysid, now)
            reason = self._keeps_sticks()
            if reason is not None and verdict.fate is Fate.FORWARD and arms(frame):
                verdict = verdict._replace(fate=Fate.DROP, reason=reason)
            if self._latent.untold:
                self._tell_stations(now)
            if frame.msgid in TARGET_MESSAGES and verdict.fate is Fate.FORWARD and self.view.phase is not Phase.ON_LOAD:
                verdict = self.targets.limit(frame, verdict, port.sysid, now, self.modes)
        commands = port.sysid == self.view.commander and port.identity.speaks(frame)
        if frame.msgid == _FTP and verdict.fate is not Fate.DROP:
            access = self.of_served_file(port.sysid, frame)
            if access is not None:
                fate, reason = outcome(access, commands, self.view.armed)
                verdict = Verdict(fate, access, reason, verdict.what)
        if (
            verdict.access is Access.COMMAND
            and verdict.fate is Fate.FORWARD
            and self._in_flight
            and self.takes_over(frame)
        ):
            verdict = verdict._replace(fate=Fate.CONSUME, reason=GateReason.COMPANION)
        if not commands:
            self.note()
            verdict = self._questions.limit(frame, verdict, port.sysid, self.view.commander, now)
            self._rates.heard(port.sysid, now)
        if verdict.fate is Fate.FORWARD:
            if frame.msgid in _LOG_REQUESTS and commands:
                self._log_download.asked(port, frame, now)
            else:
                self._to_autopilot(frame.raw)
            self._passed.append((port, frame, verdict, now))
            if not commands or verdict.access not in _FREQUENT or len(self._passed) >= UNNOTED:
                self.note()
            return verdict
        self.counts[port.sysid][verdict.reason] += 1
        if verdict.access is Access.LIVENESS and frame.sysid == port.sysid:
            self._latent.beat(port.sysid)
        if verdict.fate is Fate.REFUSE:
            self._refuse(port, frame, verdict, now)
        elif verdict.reason is GateReason.OBSERVER_RATES:
            self._grant_rates(port, frame, now)
        return verdict

    @property
    def _in_flight(self) -> bool:
        return self.view.phase is not Phase.ON_LOAD and not self.view.rehearsal

    def _keeps_sticks(self) -> GateReason | None:
        """Why nobody's sticks pass now; None: the commander's do."""
        if self.view.rehearsal:
            return GateReason.REHEARSAL
        return GateReason.NOT_ARMED if self.view.phase is Phase.ON_LOAD and not self.view.armed else None

    def release(self, port: Port, frame: Frame, verdict: Verdict, now: float) -> Verdict:
        """Pass on a frame of the commander that was the companion's matter first; how it is judged then."""
        assert port.sysid == self.view.commander
        passed = Verdict(Fate.FORWARD, verdict.access, GateReason.ALLOWED, verdict.what)
        self._to_autopilot(frame.raw)
        self._passed.append((port, frame, passed, now))
        self.note()
        return passed

    def turn_down(self, port: Port, frame: Frame, verdict: Verdict, now: float) -> Verdict:
        """Refuse a frame of the commander that was the companion's matter first; how it is judged then.

        It is answered in its protocol's own way; the words are the caller's.
        """
        refused = Verdict(Fate.REFUSE, verdict.access, GateReason.SITUATION, verdict.what)
        self.counts[port.sysid][refused.reason] += 1
        if self._refusals.allow(port.sysid, frame.msgid, now):
            for answer in refusal(frame, refused, self._own, knows=False):
                self._to_station(port, answer)
        return refused

    def companion_sent(self, raw: bytes, now: float) -> None:
        """The companion itself says this to the autopilot, a whole frame."""
        frame = parse_one(raw, proven=True)
        if frame is not None:
            self._own_reads.companion_sent(frame, now)

    def tick(self, now: float) -> None:
        """Note what waits to be noted, and see which streams have ended; to be called often."""
        self.note()
        self._latent.tick(self.view.commander, now)
        self._log_download.tick(now)
        self._tell_stations(now)

    def note(self) -> None:
        """Note what the frames mean that went to the autopilot (rule 2)."""
        if self._passed:
            self._note(self.view.commander)

    def _note(self, commander: int | None) -> None:
        passed, self._passed = self._passed, []
        for port, frame, verdict, at in passed:
            try:
                self.counts[port.sysid][verdict.reason] += 1
                if port.sysid == commander:
                    self._commander_sent(port, frame, verdict, at)
                self._downlink.asked(frame, port.sysid, at)
                self._own_reads.station_sent(frame)
                self._flusher.saw(frame, verdict, port.sysid)
            except Exception:
                self._fault("frame that passed", traceback.format_exc(limit=-3))

    def _commander_sent(self, port: Port, frame: Frame, verdict: Verdict, at: float) -> None:
        self._questions.commander_sent(frame, at)
        if verdict.access is _STREAM:
            self._latent.begun(frame)
        elif verdict.access is Access.LIVENESS:
            self._latent.beat(port.sysid)

    def _tell_stations(self, now: float) -> None:
        untold, self._latent.untold = self._latent.untold, []
        for news in untold:
            severity = mavlink.MAV_SEVERITY_WARNING if news.state in _WARNINGS else mavlink.MAV_SEVERITY_NOTICE
            for line in lines(news):
                self._to_station(self._ports[news.station], line_of_text(line, severity, self._own))
            self._told(news, now)

    def _refuse(self, port: Port, frame: Frame, verdict: Verdict, now: float) -> None:
        if not self._refusals.allow(port.sysid, frame.msgid, now):
            return
        tongues, sender = port.tongues, (frame.sysid, frame.compid)
        for answer in refusal(frame, verdict, self._own, tongues.knows_not_in_control(sender)):
            self._to_station(port, answer)
        if not has_words(frame, verdict):
            return
        subject, commander = subject_of(frame), self.view.commander
        if self._in_words.allow(port.sysid, (subject, verdict.reason, commander), now):
            name = "" if commander is None else self._names[commander]
            words = sentence(subject, verdict.reason, name, tongues.of(sender), modes=self.modes)
            self._say(port.sysid, words, now)

    def unsaid(self, frame: Frame) -> str:
        """What the name of a refused frame leaves open, such as the mode; "" if the name says all."""
        return unsaid(frame, modes=self.modes)

    def _grant_rates(self, port: Port, frame: Frame, now: float) -> None:
        answers = self._rates.asked(frame, port.sysid, now)
        if answers and self._rate_answers.allow(port.sysid, "rates", now):
            for answer in answers:
                self._to_station(port, codec.pack(answer, self._as_autopilot))

    def _to_station(self, port: Port, raw: bytes) -> None:
        """A station that cannot be written to costs nobody else anything."""
        try:
            port.write(raw)
        except Exception:
            self._fault(f"sending to {port.name}", traceback.format_exc(limit=-3))

    # ---- down -----------------------------------------------------------------------------------------------------

    def down(self, frame: Frame, now: float) -> bool:
        """A frame that came from the vehicle's side: it goes to the stations that hear it.

        False: it speaks in the companion's name (rule 8); to tell people is left to the caller.
        """
        if frame.msgid in OUR_MESSAGES or (frame.compid in _OURS and frame.sysid == self._vehicle):
            self.in_our_name[frame.sysid, frame.compid] += 1
            return False
        if frame.sysid == self._vehicle and frame.known:
            if frame.msgid == _CONTROL_STATUS:
                return True
            if frame.compid == AUTOPILOT_COMPID:
                self._flusher.heard(frame)
                if frame.msgid == _PARAM_VALUE and self._own_reads.keeps(frame, now):
                    return True
        raw = named(frame, self._names)
        for station in self._downlink.receivers(frame, self._ports, self.view, now):
            if frame.msgid in _DOWNLOADS:
                self._download(self._ports[station], frame, raw, now)
            else:
                self._to_station(self._ports[station], raw)
        return True

    def _download(self, port: Port, frame: Frame, raw: bytes, now: float) -> None:
        try:
            kept = frame.msgid == _LOG_DATA and self._log_download.keeps(port, frame, raw, now)
            if not kept and not port.write_more(raw):
                port.write(raw)
            self.downloads_wait = True
        except Exception:
            self._fault(f"sending to {port.name}", traceback.format_exc(limit=-3))

    def send_downloads(self, now: float) -> None:
        """Send what waits of downloads; to be called in every round of the main loop while `downloads_wait`."""
        try:
            self.downloads_wait = self._log_download.send(now)
        except Exception:
            self.downloads_wait = False
            self._log_download.forget()
            self._fault("log download", traceback.format_exc(limit=-3))
        for port in self._ports.values():
            try:
                port.flush()
            except Exception:
                self._fault(f"sending to {port.name}", traceback.format_exc(limit=-3))

    # ---- authority ------------------------------------------------------------------------------------------------

    def change(self, view: AuthorityView, now: float) -> list[tuple[int, Closing]]:
        """This view is in force: what follows from it at the autopilot is sent (rule 4).

        Returns what was closed, and whose it was, for the journal.
        """
        before, self.view = self.view, view
        if self._passed:
            self._note(before.commander)
        closed: list[tuple[int, Closing]] = []
        if view.commander != before.commander:
            self._log_download.forget()
            self._latent.authority_ends(before.commander, now)
            if before.commander is not None:
                closed += self._close(before.commander, self._flusher.flush(before.commander, wings=self.modes.wings))
            successor = None if view.commander is None else self._ports.get(view.commander)
            if successor is not None and now - successor.heartbeat_at < _HEARTBEAT_FRESH_S:
                self._to_autopilot(successor.heartbeat)
        if view.armed and not before.armed and view.commander is not None:
            closed += self._close(view.commander, self._flusher.arming())
        return closed

    @property
    def list_open(self) -> bool:
        """Whether the mission or the geofence is being written to the autopilot by a station."""
        self.note()
        return self._flusher.list_open

    def close_mission_files(self) -> list[tuple[int, Closing]]:
        """Throw away the mission files that the commander has open at the autopilot; what was closed, for the journal.

        The autopilot applies such a file when it is closed: after a package was written it would replace its mission.
        """
        self.note()
        commander = self.view.commander
        return [] if commander is None else self._close(commander, self._flusher.mission_files())

    def distrust(self) -> None:
        """The gate begins where a flight may be under way: what stations sent before this is not known (rule 6)."""
        self._latent.distrust()

    def _close(self, station: int, closings: list[Closing]) -> list[tuple[int, Closing]]:
        for closing in closings:
            for raw in closing.frames:
                self._to_autopilot(raw)
        return [(station, closing) for closing in closings]
