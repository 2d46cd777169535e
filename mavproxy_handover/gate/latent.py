# SPDX-License-Identifier: GPL-3.0-or-later

"""Sticks and setpoints that a station already sent before it had control: refused until they have ended once.

Ground station programs repeat them by themselves: MAVProxy an RC override ten times a second, for as long as nobody
takes it back. What was typed at an observer, and refused there, would fly the aircraft at the moment of its handover,
and nobody would have meant it. So such a stream is *latent*, and counts again once it was ended on purpose. Rules:

1. Streams are told apart by kind (`KINDS`: the policy's rows that name one) and by station: all its links, its systems
   and its components together.
2. A stream becomes latent by a frame that is refused because its station does not command; by the end of its station's
   authority, if it had begun under it (of one whose link has failed nobody knows what it goes on sending); and by
   `distrust`: what ran before this gate is not known.
3. A latent stream is refused, though its station commands, until it is released or has paused. What a station begins
   under its own authority is never latent while that lasts.
4. A release is a frame of the stream that holds nothing. It passes. Where several senders of a station hold, each has
   to release.
5. A pause is `PAUSE_S` without a frame of the stream, in which `BEATS` heartbeats of the station itself came. A hole in
   the link is none, of whatever kind it is: before it and behind it a heartbeat may come first, but no two. Nor is a
   stall of our own: what has come meanwhile is read in its order.
6. The station is told (`News`): when a stream is refused, that this will stay so after a handover; after the handover,
   that it is so, and why; both again every `REMIND_S`; and when it is over. No more than once a second of each.

Memory is bounded by the stations and the kinds, and `_MOST_HOLDERS` senders each. Time is an argument (monotonic s).

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

__all__ = ["BEATS", "KINDS", "PAUSE_S", "REMIND_S", "LatentStreams", "News", "State", "arms", "fuller", "lines"]

PAUSE_S: Final = 1.0
BEATS: Final = 3
#: who goes on sending what is refused hears of it that often
REMIND_S: Final = 30.0
#: senders of one stream that are told apart; more of them can only pause
_MOST_HOLDERS: Final = 8

_Sender = tuple[int, int]  #: system, component
_OTHERS: Final[_Sender] = (0, 0)

_NAMES: Final = {name: rule.stream for rule in MESSAGE_RULES for name in rule.names if rule.stream}
#: message id -> kind of stream
KINDS: Final[Mapping[int, str]] = {
    msgid: _NAMES[cls.msgname] for msgid, cls in mavlink.mavlink_map.items() if cls.msgname in _NAMES
}

#: the kinds that stand in a pilot's place: rudder and switches arm by them
_STICKS: Final = ("RC override", "manual control")

#: Values of a channel of RC_CHANNELS_OVERRIDE that hold nothing: released, or left as it is. 1 to 8, and the others.
_FREE: Final = frozenset((0, 0xFFFF))
_FREE_ABOVE_8: Final = frozenset((0, 0xFFFE, 0xFFFF))
_CHANNELS: Final = {f"chan{n}_raw": _FREE if n <= 8 else _FREE_ABOVE_8 for n in range(1, 19)}
#: MANUAL_CONTROL: an axis that is not there, and everything that a hand could be on besides
_NO_AXIS: Final = 0x7FFF
_AXES: Final = ("x", "y", "z", "r")
_BUTTONS: Final = ("buttons", "buttons2", "enabled_extensions")


def _no_channel(frame: Frame) -> bool:
    return all(field_int(frame, name) in free for name, free in _CHANNELS.items())


def _no_hand(frame: Frame) -> bool:
    return all(field_int(frame, name) == _NO_AXIS for name in _AXES) and not any(
        field_int(frame, name) for name in _BUTTONS
    )


#: What holds nothing, where a message can say so; anything else can only pause.
_RELEASES: Final[Mapping[int, Callable[[Frame], bool]]] = {
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: _no_channel,
    mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL: _no_hand,
}


def arms(frame: Frame) -> bool:
    """Whether a frame of a stream is one that can arm an aircraft on the ground: sticks that hold something."""
    return KINDS.get(frame.msgid) in _STICKS and not _releases(frame)


def _releases(frame: Frame) -> bool:
    release = _RELEASES.get(frame.msgid)
    return release is not None and release(frame)


class State(Enum):
    """What there is to say of a stream."""

    REFUSED = "refused"  #: its station does not command
    RAN_BEFORE = "ran before"  #: its station commands by now
    OBEYED = "obeyed"  #: it has ended: from now on its station's sticks count
    ENDED = "ended"  #: the same, of a station that does not command


class News(NamedTuple):
    """Something to say to a station, and to the journal."""

    station: int
    kind: str
    state: State


#: What a station is told: lines of 50 characters at most, and the same in full for a screen that has room.
_LINES: Final = {
    State.REFUSED: ("Handover: {kind}: not in control", "Handover: {kind}: end it before handover"),
    State.RAN_BEFORE: ("Handover: {kind}: refused until it pauses", "Handover: it ran before you had control"),
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
#: how each kind is ended
_ENDED: Final = {"RC override": "released (rc all 0) or has paused for 3 s", "manual control": "switched off for 3 s"}


def lines(news: News) -> tuple[str, ...]:
    """What the station is told."""
    return tuple(line.format(kind=news.kind) for line in _LINES[news.state])


def _sentence(kind: str, state: State) -> str:
    ended = _ENDED.get(kind, "stopped for 3 s")
    text = _FULL[state].format(kind=kind, ended=ended)
    return f"{text[:1].upper()}{text[1:]}"


#: the first line of everything that is told -> in full
_IN_FULL: Final = {
    _LINES[state][0].format(kind=kind): _sentence(kind, state) for state in State for kind in set(_NAMES.values())
}


def fuller(line: str) -> str | None:
    """What a line of `lines` says in full; None for any other text, and for a line that only goes with another."""
    return _IN_FULL.get(line)


@dataclass(slots=True)
class _Latent:
    """A stream that does not count."""

    #: who of the station was seen to hold, and has not released
    holders: set[_Sender] = field(default_factory=set)
    #: when the last frame of it came, and the heartbeats of its station since
    held_at: float = -math.inf
    beats: int = 0
    #: what was last said of it, and when
    told: State | None = None
    told_at: float = -math.inf

    def hold(self, senders: Iterable[_Sender], now: float) -> None:
        """It goes on, or is taken to."""
        self.held_at, self.beats = now, 0
        for sender in senders:
            self.holders.add(_told_apart(self.holders, sender))


def _told_apart(known: Collection[_Sender], sender: _Sender) -> _Sender:
    """The sender itself, or one of too many."""
    return sender if sender in known or len(known) < _MOST_HOLDERS else _OTHERS


class LatentStreams:
    """Follows the sticks and setpoints of all stations. `stations`: their system ids."""

    def __init__(self, stations: Iterable[int]) -> None:
        self._latent: dict[int, dict[str, _Latent]] = {station: {} for station in stations}
        #: what whoever commands has sent under its authority: kind -> the last frame of each sender
        self._begun: dict[str, dict[_Sender, Frame]] = {}
        #: what is to be told; whoever tells it takes it away
        self.untold: list[News] = []
        self._told = RefusalLimiter(1)

    def limit(self, frame: Frame, verdict: Verdict, station: int, now: float) -> Verdict:
        """The verdict on a frame of a stream that stands: `verdict`, or that it ran before its station had control."""
        kind = KINDS.get(frame.msgid)
        if kind is None:
            return verdict
        if verdict.reason is GateReason.NOT_IN_CONTROL:
            self._hold_or_release(frame, kind, station, State.REFUSED, now)
        elif (
            kind in self._latent[station]
            and verdict.fate is Fate.FORWARD
            and self._hold_or_release(frame, kind, station, State.RAN_BEFORE, now)
        ):
            return verdict._replace(fate=Fate.DROP, reason=GateReason.RAN_BEFORE)
        return verdict

    def _hold_or_release(self, frame: Frame, kind: str, station: int, state: State, now: float) -> bool:
        """Whether the frame holds something, of a latent stream; without authority every stream that holds is one."""
        streams, sender = self._latent[station], (frame.sysid, frame.compid)
        self._settle(station, kind, now, state is State.RAN_BEFORE)
        latent = streams.get(kind)
        if latent is None and state is State.RAN_BEFORE:
            return False
        if _releases(frame):
            if latent is not None:
                latent.holders.discard(sender)
                if not latent.holders:
                    self._end(station, kind, now, state is State.RAN_BEFORE)
            return False
        latent = streams.setdefault(kind, _Latent())
        latent.hold([sender], now)
        if latent.told is not state or now - latent.told_at >= REMIND_S:
            self._tell(News(station, kind, state), latent, now)
        return True

    def begun(self, frame: Frame) -> None:
        """A frame of a stream of the commander went to the autopilot."""
        kind = KINDS.get(frame.msgid)
        if kind is not None:
            frames = self._begun.setdefault(kind, {})
            frames[_told_apart(frames, (frame.sysid, frame.compid))] = frame

    def authority_ends(self, station: int | None, now: float) -> None:
        """`station` commands no more, None: nobody did. What it has begun goes on, for all that is known (rule 2)."""
        begun, self._begun = self._begun, {}
        streams = {} if station is None else self._latent.get(station, {})
        for kind, frames in begun.items():
            holders = [sender for sender, frame in frames.items() if sender == _OTHERS or not _releases(frame)]
            if holders:
                streams.setdefault(kind, _Latent()).hold(holders, now)

    def distrust(self) -> None:
        """What ran before this is not known: every stream is taken for one that did, until it is known to be quiet."""
        for streams in self._latent.values():
            for kind in set(KINDS.values()):
                streams.setdefault(kind, _Latent())

    def beat(self, station: int) -> None:
        """A heartbeat of the station itself."""
        for latent in self._latent[station].values():
            latent.beats += 1

    def tick(self, commander: int | None, now: float) -> None:
        """Look for streams that have paused; to be called often."""
        for station, streams in self._latent.items():
            for kind in list(streams):
                self._settle(station, kind, now, station == commander)

    def _settle(self, station: int, kind: str, now: float, commands: bool) -> None:
        latent = self._latent[station].get(kind)
        if latent is not None and latent.beats >= BEATS and now - latent.held_at >= PAUSE_S:
            self._end(station, kind, now, commands)

    def _end(self, station: int, kind: str, now: float, commands: bool) -> None:
        latent = self._latent[station].pop(kind)
        if latent.told is not None:  # of what nobody was told of nobody need know that it is over
            self._tell(News(station, kind, State.OBEYED if commands else State.ENDED), latent, now)

    def _tell(self, news: News, latent: _Latent, now: float) -> None:
        if self._told.allow(news.station, (news.kind, news.state), now):
            latent.told, latent.told_at = news.state, now
            self.untold.append(news)
