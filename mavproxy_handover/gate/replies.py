# SPDX-License-Identifier: GPL-3.0-or-later

"""Sends the answers of the gate: refusals, data rates of observers, and news of sticks and setpoints.

Every refusal is answered in its protocol, and a text says why, but not more often than the limits of `refusals.py`
allow: that is known before an answer is made. A frame that is dropped has no answer; if a person may have meant it, a
text says why, once for a stream. The companion itself answers an observer that asks for data rates
(`observers.py` grants or denies them): the autopilot is not asked.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.feeds import FeedNews, Feeds
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.gate.judge import GateReason, Verdict
from mavproxy_handover.gate.log_turn import LogTurn
from mavproxy_handover.gate.observers import ObserverRates
from mavproxy_handover.gate.port import Port
from mavproxy_handover.gate.refusal_text import LOG_ENDED, sentence, subject_of
from mavproxy_handover.gate.refusals import (
    OncePerCause,
    OncePerStream,
    RefusalLimiter,
    asked_component,
    drop_has_words,
    has_words,
    line_of_text,
    pack_as,
    refusal,
)
from mavproxy_handover.gate.stale_streams import News, StaleStreams, State, lines
from mavproxy_handover.vehicle.profiles import Modes
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import COMPANION_COMPID

__all__ = ["GateReports", "Replies"]

_WARNINGS: Final = (State.REFUSED, State.RAN_BEFORE)
#: answers to requests for data rates, to one station
_RATE_ANSWERS_PER_S: Final = 20


@dataclass(frozen=True, slots=True)
class GateReports:
    """Services of the companion for the gate: `fault` and `stream` write to its journal, `say` tells a station."""

    #: what broke: where, and the text
    fault: Callable[[str, str], None]
    #: what a station was told of its sticks and setpoints
    stream: Callable[[News, float], None]
    #: tells a station (system id) in words why a frame is refused
    say: Callable[[int, str, float], None]
    #: tells stations of their feeds
    feed: Callable[[FeedNews, float], None]


class Replies:
    """Of one vehicle. Times are monotonic seconds."""

    def __init__(
        self,
        vehicle: int,
        ports: Mapping[int, Port],
        in_force: AuthorityInForce,
        log_turn: LogTurn,
        reports: GateReports,
    ) -> None:
        self._ports = ports
        self._names = {station: port.name for station, port in ports.items()}
        self._in_force = in_force
        self._log_turn = log_turn
        self._reports = reports
        self._refusals = RefusalLimiter()
        self._in_words = OncePerCause()
        self._streams_in_words = OncePerStream()
        self._rate_answers = RefusalLimiter(_RATE_ANSWERS_PER_S)
        self._own = mavlink.MAVLink(None, srcSystem=vehicle, srcComponent=COMPANION_COMPID)

    def refuse(self, port: Port, frame: Frame, verdict: Verdict, modes: Modes, now: float) -> None:
        """Answer a refused frame in its protocol, and say why."""
        if not self._refusals.allow(port.sysid, (frame.msgid, verdict.access), now):
            return
        capabilities, sender = port.capabilities, (frame.sysid, frame.compid)
        for answer in refusal(frame, verdict, self._own, partial(capabilities.result, sender)):
            self.send(port, answer)
        if has_words(frame, verdict) and self._in_words.allow(port.sysid, self._cause(frame, verdict, now), now):
            self._say(port, frame, verdict, modes, now)

    def drop(self, port: Port, frame: Frame, verdict: Verdict, modes: Modes, now: float) -> None:
        """Say why a frame was dropped, if a person may have meant it: once for a stream of such frames."""
        if not drop_has_words(frame, verdict):
            return
        if self._streams_in_words.allow(port.sysid, (subject_of(frame), verdict.reason), now):
            self._say(port, frame, verdict, modes, now)

    def log_ended(self, station: int, now: float) -> None:
        """Say that a download of logs was ended, because the vehicle is armed."""
        self._reports.say(station, LOG_ENDED, now)

    def _cause(self, frame: Frame, verdict: Verdict, now: float) -> tuple[Hashable, ...]:
        return subject_of(frame), verdict.reason, self._in_the_way(verdict, now)

    def _in_the_way(self, verdict: Verdict, now: float) -> int | None:
        """The station that a refusal names: the commander, or the one that reads a log."""
        busy = verdict.reason is GateReason.LOG_BUSY
        return self._log_turn.station(now) if busy else self._in_force.view.commander

    def _say(self, port: Port, frame: Frame, verdict: Verdict, modes: Modes, now: float) -> None:
        station, dialect = self._in_the_way(verdict, now), port.capabilities.of((frame.sysid, frame.compid))
        name = "" if station is None else self._names[station]
        words = sentence(subject_of(frame), verdict.reason, name, dialect, modes=modes)
        self._reports.say(port.sysid, words, now)

    def answer_rates(self, port: Port, frame: Frame, rates: ObserverRates, now: float) -> None:
        """Grant or deny the data rates that an observer asks for, in the name of the component that was asked."""
        answers = rates.asked(frame, port.sysid, now)
        if answers and self._rate_answers.allow(port.sysid, "rates", now):
            for answer in answers:
                self.send(port, pack_as(answer, self._own, asked_component(frame)))

    def tell_streams(self, streams: StaleStreams, now: float) -> None:
        """Tell stations the news of their sticks and setpoints."""
        untold, streams.untold = streams.untold, []
        for news in untold:
            severity = mavlink.MAV_SEVERITY_WARNING if news.state in _WARNINGS else mavlink.MAV_SEVERITY_NOTICE
            for line in lines(news):
                self.send(self._ports[news.station], line_of_text(line, severity, self._own))
            self._reports.stream(news, now)

    def tell_feeds(self, feeds: Feeds, now: float) -> None:
        """Tell stations the news of feeds. A fault costs this news only."""
        untold, feeds.untold = feeds.untold, []
        for news in untold:
            try:
                self._reports.feed(news, now)
            except Exception:
                self._reports.fault("news of feeds", traceback.format_exc(limit=-3))

    def send(self, port: Port, raw: bytes) -> None:
        """Send a whole frame to a station. A fault costs this frame only."""
        try:
            port.write(raw)
        except Exception:
            self._reports.fault(f"sending to {port.name}", traceback.format_exc(limit=-3))
