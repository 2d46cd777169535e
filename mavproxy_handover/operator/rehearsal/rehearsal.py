# SPDX-License-Identifier: GPL-3.0-or-later

"""A rehearsal on the ground: requests and reports of stations. `core/authority/rehearsal.py` decides.

HANDOVER_REHEARSE begins or ends one, or asks for its report; HANDOVER_REHEARSAL answers. A station repeats its question
until it is answered, so a copy (the same nonce of the same station) is answered again and changes nothing. Any known
station gets the report: what it costs is bounded (`_REPORTS_PER_S`).

While it lasts, what is seen is counted (`rehearsal_stats.py`). The journal gets the counts when it is over and each
minute before, so a crash of the companion loses one minute at most.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.common.events import (
    Announce,
    Event,
    Record,
    RehearsalAsked,
    RehearsalMoved,
    RehearsalRefused,
)
from mavproxy_handover.core.common.model import AuthorityView, FlightAction, in_words
from mavproxy_handover.gate.refusals import RefusalLimiter
from mavproxy_handover.mission.geodesy import distance_m
from mavproxy_handover.operator.rehearsal.rehearsal_stats import Foreseen, LinkSeen, RehearsalStats
from mavproxy_handover.operator.stations.announcer import Announcer
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.operator.stations.sender import MessageSender
from mavproxy_handover.wire import status

__all__ = ["RehearsalManager", "Surroundings"]

_BEGIN: Final[int] = mavlink.HANDOVER_REHEARSAL_WISH_BEGIN
_END: Final[int] = mavlink.HANDOVER_REHEARSAL_WISH_END
_REPORT: Final[int] = mavlink.HANDOVER_REHEARSAL_WISH_REPORT
#: what a station's operator typed, for the text of a refusal
_TYPED: Final = {True: "REHEARSE", False: "REHEARSE END"}
#: reports of one station
_REPORTS_PER_S: Final = 2
#: how often links are looked at, and how often the journal gets what was seen so far (s)
_SAMPLE_S, _KEEP_S = 0.5, 60.0


@dataclass(frozen=True, slots=True)
class Surroundings:
    """The facts that the counts need. `place`: the zones that hold the aircraft, in words; `where`:
    latitude and longitude (degrees), None: not known; `foreseen`: the handovers that the check of the mission has.
    """

    view: Callable[[], AuthorityView]
    place: Callable[[], str]
    where: Callable[[], tuple[float, float] | None]
    foreseen: Callable[[], Sequence[Foreseen]]


class RehearsalManager:
    """Of one vehicle. Times are monotonic seconds."""

    def __init__(
        self,
        vehicle: int,
        arbiter: Arbiter,
        handle: Callable[[Event, float], None],
        message_sender: MessageSender,
        event_log: EventLog,
        announcer: Announcer,
        around: Surroundings,
    ) -> None:
        """`vehicle`: its system id; `handle` gives an event to the arbiter and carries out what it asks for."""
        self._vehicle = vehicle
        self._arbiter = arbiter
        self._handle = handle
        self._message_sender = message_sender
        self._event_log = event_log
        self._announcer = announcer
        self._around = around
        #: of the one under way, or the last one; None: there was none
        self.stats: RehearsalStats | None = None
        #: the last wish of each station to begin and to end one: its nonce, and whether it came true
        self._last: dict[tuple[int, int], tuple[int, bool]] = {}
        #: the stations whose last wish to begin one (True), or to end one, the rules refused
        self._refused: set[tuple[int, bool]] = set()
        self._reports = RefusalLimiter(_REPORTS_PER_S)
        self._sample_at = self._keep_at = -inf
        #: the name of the station that had authority when a transfer began
        self._owner = ""

    # ---- what stations want ---------------------------------------------------------------------------------------

    def handle_request(self, port: StationPort, message: Any, now: float) -> None:
        """HANDOVER_REHEARSE of a station, any."""
        if message.vehicle != self._vehicle:
            return
        if message.wish == _REPORT:
            if self._reports.allow(port.sysid, _REPORT, now):
                self._answer(port, message, True, self.lines(now))
        elif message.wish in (_BEGIN, _END):
            asked = port.sysid, message.wish
            known = self._last.get(asked)
            if known is None or known[0] != message.nonce:
                known = self._last[asked] = message.nonce, self._ask(port, message.wish == _BEGIN, now)
            self._answer(port, message, known[1])
        else:
            self._answer(port, message, False)

    def _ask(self, port: StationPort, begin: bool, now: float) -> bool:
        asked = port.sysid, begin
        self._refused.discard(asked)
        self._handle(RehearsalAsked(port.sysid, begin), now)
        return asked not in self._refused and self._around.view().rehearsal is begin

    def _answer(self, port: StationPort, message: Any, accepted: bool, lines: Sequence[str] = ()) -> None:
        for each in status.rehearsal(port.target, self._vehicle, message.wish, message.nonce, accepted, lines):
            port.send(each)

    def lines(self, now: float) -> tuple[str, ...]:
        """The report, as far as it goes."""
        return ("no rehearsal since the companion was started",) if self.stats is None else self.stats.lines(now)

    # ---- what the rules say ---------------------------------------------------------------------------------------

    def moved(self, moved: RehearsalMoved, now: float) -> None:
        """A rehearsal has begun or ended: tell every station."""
        self._event_log.rehearsal(moved)
        self._announcer.rehearsal(moved)
        if moved.on:
            self._open(now, restarted=False)
        elif self.stats is not None and not self.stats.over:
            self._sample_links(now)
            self.stats.end(now, moved.text.partition(": ")[2])
            self._event_log.rehearsal_report(self.stats.lines(now), self.stats.entry(now))

    def refused(self, refused: RehearsalRefused, now: float) -> None:
        """Tell a station why its request to begin or end a rehearsal is refused."""
        self._refused.add((refused.station, refused.begin))
        text = f"{_TYPED[refused.begin]} refused: {'; '.join(refused.needs)}"
        port = self._message_sender.ports[refused.station]
        self._event_log.told(port.name, text, now)
        self._message_sender.say(port, text)

    def _open(self, now: float, *, restarted: bool) -> None:
        self.stats = RehearsalStats(now, self._around.foreseen(), restarted=restarted)
        self._owner = self._arbiter.name(self._around.view().commander)
        self._sample_at, self._keep_at = now, now + _KEEP_S

    # ---- what is seen ---------------------------------------------------------------------------------------------

    @property
    def _open_stats(self) -> RehearsalStats | None:
        """The statistics of the rehearsal under way; None: none is."""
        return None if self.stats is None or self.stats.over else self.stats

    def record(self, record: Record, now: float) -> None:
        """An entry that the arbiter asks for: of a handover."""
        stats = self._open_stats
        if stats is None or record.station is None:
            return
        to, took_s = self._arbiter.name(record.station), record.duration_s or 0.0
        if record.event == "transfer_committed":
            stats.handover(self._owner, to, now, took_s, in_words(record.reason), distance_m)
            self._owner = to
        elif record.event == "transfer_aborted":
            stats.aborted(self._owner, to, now, took_s, in_words(record.reason))
        elif record.event == "authority":
            self._owner = to

    def told(self, told: Announce, now: float) -> None:
        """A decision was told; here it is what would be done."""
        stats = self._open_stats
        if stats is not None and told.action is not None and told.action > FlightAction.TRANSFER:
            stats.would(now, told.text.removeprefix("REHEARSAL: "))

    def turned_away(self, station: str, what: str, why: str) -> None:
        """Something of a station was refused."""
        if self._open_stats is not None:
            self._open_stats.refused(station, what, why)

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        if not self._around.view().rehearsal:
            return
        if self._open_stats is None:  # it was under way when this run began
            self._open(now, restarted=True)
        if now >= self._sample_at:
            self._sample_links(now)
        if now >= self._keep_at and self.stats is not None:
            self._keep_at = now + _KEEP_S
            self._event_log.rehearsal_report((), self.stats.entry(now))

    def _sample_links(self, now: float) -> None:
        assert self.stats is not None
        self._sample_at = now + _SAMPLE_S
        self.stats.expects(self._around.foreseen())
        links = [_seen(port, now) for port in self._message_sender.ports.values()]
        self.stats.saw(now, self._around.place(), self._around.where(), [each for port in links for each in port])


def _seen(port: StationPort, now: float) -> list[LinkSeen]:
    """All links of a station."""
    seen = []
    for link in port.links:
        quality = port.quality(link, now)
        seen.append(LinkSeen(port.name, link.device, quality.heard_ago_s, quality.loss, quality.round_trip_s))
    return seen
