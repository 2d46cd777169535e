# SPDX-License-Identifier: GPL-3.0-or-later

"""Refuses sticks and setpoints that began before their station had control, until they have ended once.

Ground station programs repeat such streams: MAVProxy sends an RC override ten times a second until its operator takes
it back. If such a stream was begun at an observer, it would fly the aircraft at the moment of the handover, although no
operator meant that. So such a stream is *stale*, and counts again after it was ended on purpose. Rules:

1. Streams are told apart by kind (`KINDS`: the rows of the policy that name one) and by station: all links, systems and
   components of a station together.
2. A stream becomes stale in three ways. A frame of it is refused because its station does not command. Its station
   loses authority after it had begun: if the link failed, the station may go on sending. Or `distrust` is called: what
   ran before this gate was started is not known.
3. A stale stream is refused even if its station commands, until the stream is released or has paused. A stream that
   begins under the authority of its station is not stale while that authority lasts.
4. A release is a frame of the stream that holds nothing. It passes. If several senders of a station hold, each must
   release.
5. A pause is `PAUSE_S` without a frame of the stream, in which `BEATS` heartbeats of the station itself came. A hole in
   the link is no pause: at most one heartbeat comes before it, and one after it ahead of the stream. A stall of the
   companion is no pause either: frames that came meanwhile are read in their order.
6. The station is told (`News`). When a stream is refused: that it will also be refused after a handover. After the
   handover: that it is refused, and why. Both again every `REMIND_S`. And when the stream has ended. Each at most once
   a second.

Memory is bounded by the stations and the kinds, and by `_MOST_HOLDERS` senders of each. Time is an argument (monotonic
s).

Sources: MAVLink's RC_CHANNELS_OVERRIDE and MANUAL_CONTROL, ArduPilot's GCS_Common.cpp, MAVProxy's module rc.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.judge import Fate, GateReason, Verdict
from mavproxy_handover.gate.policy.messages import MESSAGE_RULES
from mavproxy_handover.gate.refusals import RefusalLimiter
from mavproxy_handover.wire.frames import Frame, field_int
from mavproxy_handover.wire.message_ids import MESSAGE_NAMES

__all__ = [
    "BEATS",
    "KINDS",
    "PAUSE_S",
    "REMIND_S",
    "STICKS",
    "StaleStreams",
    "News",
    "State",
    "full_form",
    "lines",
    "releases",
]

PAUSE_S: Final = 1.0
BEATS: Final = 3
#: a station that goes on sending a refused stream is told again after this time
REMIND_S: Final = 30.0
#: senders of one stream that are told apart; the others count as one, which can only pause
_MOST_HOLDERS: Final = 8

_Sender = tuple[int, int]  #: system, component
_OTHERS: Final[_Sender] = (0, 0)

_NAMES: Final = {name: rule.stream for rule in MESSAGE_RULES for name in rule.names if rule.stream}
#: message id -> kind of stream
KINDS: Final[Mapping[int, str]] = {msgid: _NAMES[name] for msgid, name in MESSAGE_NAMES.items() if name in _NAMES}

#: messages that replace a pilot's sticks: rudder and switches can arm by them
STICKS: Final = frozenset(msgid for msgid, kind in KINDS.items() if kind in ("RC override", "manual control"))

#: Values of RC_CHANNELS_OVERRIDE that hold nothing: released, or unchanged. Channels 1 to 8, and the others.
_FREE: Final = frozenset((0, 0xFFFF))
_FREE_ABOVE_8: Final = frozenset((0, 0xFFFE, 0xFFFF))
_CHANNELS: Final = {f"chan{n}_raw": _FREE if n <= 8 else _FREE_ABOVE_8 for n in range(1, 19)}
#: MANUAL_CONTROL: the value of an absent axis, and the fields besides the axes
_NO_AXIS: Final = 0x7FFF
_AXES: Final = ("x", "y", "z", "r")
_BUTTONS: Final = ("buttons", "buttons2", "enabled_extensions")


def _no_channel(frame: Frame) -> bool:
    return all(field_int(frame, name) in free for name, free in _CHANNELS.items())


def _no_hand(frame: Frame) -> bool:
    return all(field_int(frame, name) == _NO_AXIS for name in _AXES) and not any(
        field_int(frame, name) for name in _BUTTONS
    )


#: Tests for frames that hold nothing, by message. A stream of another message can only pause.
_RELEASES: Final[Mapping[int, Callable[[Frame], bool]]] = {
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: _no_channel,
    mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL: _no_hand,
}


def releases(frame: Frame) -> bool:
    """Whether a frame of a stream holds nothing: sticks that are released."""
    release = _RELEASES.get(frame.msgid)
    return release is not None and release(frame)


class State(Enum):
    """The state of a stream, as its station is told."""

    REFUSED = "refused"  #: its station does not command
    RAN_BEFORE = "ran before"  #: its station commands now
    OBEYED = "obeyed"  #: the stream has ended: from now on the station's sticks count
    ENDED = "ended"  #: the stream has ended, and its station does not command


#: constants, because Python 3.11 takes 0.1 us to look up a member of an enumeration
_FORWARD: Final = Fate.FORWARD
_NOT_IN_CONTROL: Final = GateReason.NOT_IN_CONTROL
_REFUSED: Final = State.REFUSED
_RAN_BEFORE: Final = State.RAN_BEFORE


class News(NamedTuple):
    """A notice for a station and for the journal."""

    station: int
    kind: str
    state: State


#: The notices: lines of at most 50 characters, and the same in full for a screen with more room.
_LINES: Final = {
    State.REFUSED: ("Handover: {kind}: not in control", "Handover: {kind}: end it before handover"),
    State.RAN_BEFORE: ("Handover: {kind}: stop it for 3 s first", "Handover: it ran before you had control"),
    State.OBEYED: ("Handover: {kind}: obeyed from now on",),
    State.ENDED: ("Handover: {kind}: it has ended",),
}
_FULL: Final = {
    State.REFUSED: "{kind} refused: this station does not command. It will be refused after a handover, too, until it "
    "is {ended}: end it now.",
    State.RAN_BEFORE: "{kind} has been running since before this station had control: still refused, until it is "
    "{ended}.",
    State.OBEYED: "{kind} has ended: what this station sends from now on is obeyed.",
    State.ENDED: "{kind} has ended: nothing of it is left for a handover.",
}
#: how an operator ends each kind
_ENDED: Final = {"RC override": "released (rc all 0) or has paused for 3 s", "manual control": "switched off for 3 s"}


def lines(news: News) -> tuple[str, ...]:
    """The notice as short lines."""
    return tuple(line.format(kind=news.kind) for line in _LINES[news.state])


def _sentence(kind: str, state: State) -> str:
    ended = _ENDED.get(kind, "stopped for 3 s")
    text = _FULL[state].format(kind=kind, ended=ended)
    return f"{text[:1].upper()}{text[1:]}"


#: first line of each notice -> the notice in full
_IN_FULL: Final = {
    _LINES[state][0].format(kind=kind): _sentence(kind, state) for state in State for kind in set(_NAMES.values())
}


def full_form(line: str) -> str | None:
    """The full form of a first line of `lines`; None for any other text."""
    return _IN_FULL.get(line)


@dataclass(slots=True)
class _Stale:
    """A stream that is refused."""

    #: senders of the station that hold, and have not released
    holders: set[_Sender] = field(default_factory=set)
    #: when its last frame came, and the heartbeats of its station since
    held_at: float = -math.inf
    beats: int = 0
    #: the last notice of it, and when that was sent
    told: State | None = None
    told_at: float = -math.inf

    def hold(self, senders: Iterable[_Sender], now: float) -> None:
        """The stream goes on, or may go on."""
        self.held_at, self.beats = now, 0
        for sender in senders:
            self.holders.add(_told_apart(self.holders, sender))


def _told_apart(known: Collection[_Sender], sender: _Sender) -> _Sender:
    """The sender itself, or the one that stands for all others."""
    return sender if sender in known or len(known) < _MOST_HOLDERS else _OTHERS


class StaleStreams:
    """Tracks the sticks and setpoints of all stations. `stations`: their system ids."""

    def __init__(self, stations: Iterable[int]) -> None:
        self._streams: dict[int, dict[str, _Stale]] = {station: {} for station in stations}
        #: what the commander has sent under its authority: kind -> the last frame of each sender
        self._begun: dict[str, dict[_Sender, Frame]] = {}
        #: notices that were not sent yet; the sender of them clears the list
        self.untold: list[News] = []
        self._told = RefusalLimiter(1)

    def limit(self, frame: Frame, verdict: Verdict, station: int, now: float) -> Verdict:
        """The verdict that stands: `verdict`, or that the stream ran before its station had control."""
        kind = KINDS.get(frame.msgid)
        if kind is None:
            return verdict
        if verdict.reason is _NOT_IN_CONTROL:
            self._hold_or_release(frame, kind, station, _REFUSED, now)
        elif (
            kind in self._streams[station]
            and verdict.fate is _FORWARD
            and self._hold_or_release(frame, kind, station, _RAN_BEFORE, now)
        ):
            return verdict._replace(fate=Fate.DROP, reason=GateReason.RAN_BEFORE)
        return verdict

    def _hold_or_release(self, frame: Frame, kind: str, station: int, state: State, now: float) -> bool:
        """Whether the frame holds something in a stale stream. Without authority every stream that holds is stale."""
        streams, sender = self._streams[station], (frame.sysid, frame.compid)
        self._end_if_paused(station, kind, now, state is _RAN_BEFORE)
        stream = streams.get(kind)
        if stream is None and state is _RAN_BEFORE:
            return False
        if releases(frame):
            if stream is not None:
                stream.holders.discard(sender)
                if not stream.holders:
                    self._end(station, kind, now, state is _RAN_BEFORE)
            return False
        stream = streams.setdefault(kind, _Stale())
        stream.hold([sender], now)
        if stream.told is not state or now - stream.told_at >= REMIND_S:
            self._tell(News(station, kind, state), stream, now)
        return True

    def begun(self, frame: Frame) -> None:
        """Note a frame of a stream of the commander that went to the autopilot."""
        kind = KINDS.get(frame.msgid)
        if kind is not None:
            frames = self._begun.setdefault(kind, {})
            frames[_told_apart(frames, (frame.sysid, frame.compid))] = frame

    def authority_ends(self, station: int | None, now: float) -> None:
        """`station` has lost authority; None: no station had it. The streams that it began may go on (rule 2)."""
        begun, self._begun = self._begun, {}
        streams = {} if station is None else self._streams.get(station, {})
        for kind, frames in begun.items():
            holders = [sender for sender, frame in frames.items() if sender == _OTHERS or not releases(frame)]
            if holders:
                streams.setdefault(kind, _Stale()).hold(holders, now)

    def distrust(self) -> None:
        """Treat every stream as stale until it is known to be quiet: what ran before is not known."""
        for streams in self._streams.values():
            for kind in set(KINDS.values()):
                streams.setdefault(kind, _Stale())

    def beat(self, station: int) -> None:
        """Note a heartbeat of the station itself."""
        for stream in self._streams[station].values():
            stream.beats += 1

    def tick(self, commander: int | None, now: float) -> None:
        """Find streams that have paused. To be called often."""
        for station, streams in self._streams.items():
            for kind in list(streams):
                self._end_if_paused(station, kind, now, station == commander)

    def _end_if_paused(self, station: int, kind: str, now: float, commands: bool) -> None:
        stream = self._streams[station].get(kind)
        if stream is not None and stream.beats >= BEATS and now - stream.held_at >= PAUSE_S:
            self._end(station, kind, now, commands)

    def _end(self, station: int, kind: str, now: float, commands: bool) -> None:
        stream = self._streams[station].pop(kind)
        if stream.told is not None:  # if no notice was sent, the end needs none
            self._tell(News(station, kind, State.OBEYED if commands else State.ENDED), stream, now)

    def _tell(self, news: News, stream: _Stale, now: float) -> None:
        if self._told.allow(news.station, (news.kind, news.state), now):
            stream.told, stream.told_at = news.state, now
            self.untold.append(news)
