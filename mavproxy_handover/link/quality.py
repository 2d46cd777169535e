# SPDX-License-Identifier: GPL-3.0-or-later

"""How good a link is, and from when on it is called bad.

A limit is watched with hysteresis in value and in time, so that a link at its limit makes one event and not many:
a value over the limit for `hold_s` degrades the link, one below RESTORE_SHARE of it for `hold_s` restores it. Silence
needs no hold: it is a time already. A value that is not known (nothing measured) changes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

__all__ = ["LinkEvent", "LinkEventKind", "LinkLimits", "LinkQuality", "LimitWatch", "Measure"]

RESTORE_SHARE: Final = 0.75


@dataclass(frozen=True, slots=True)
class LinkQuality:
    """A link at one moment. Counts and shares are of the last `window_s`; None is "not known"."""

    window_s: float
    heard_ago_s: float | None  #: since the last genuine frame
    answered_ago_s: float | None  #: since the newest probe that was answered was sent, less the usual round trip
    loss: float | None  #: share of the station's frames that never came, by sequence numbers
    probes_lost: float | None  #: share of probes without an answer
    downlink_loss: float | None  #: share of what the vehicle sends that never arrives, as far as probes show it
    downlink_loss_least: float | None  #: the same less 2.5 standard deviations: so much of it is certain
    round_trip_s: float | None  #: median
    jitter_s: float | None  #: median distance of the round trips from their median
    frames: int = 0
    duplicates: int = 0
    reordered: int = 0
    bad_crc: int = 0
    bad_signatures: int = 0
    bytes_in_per_s: float = 0.0
    bytes_out_per_s: float = 0.0
    overflowed: int = 0  #: datagrams that our own system dropped because its buffer was full


class Measure(Enum):
    """What is limited."""

    SILENCE = "silence"
    LOSS = "loss"
    DOWNLINK_LOSS = "downlink loss"
    ROUND_TRIP = "round trip"
    BAD_SIGNATURES = "bad signatures"
    OVERFLOW = "receive overflow"


@dataclass(frozen=True, slots=True)
class LinkLimits:
    """From when on a link is called bad. Raises ValueError for a limit that is not above 0.

    `loss` limits the loss of the uplink, and that of the downlink. The round trip is limited to what STANAG 4586 #1-#5
    allow a message one way. The heartbeat of a ground station comes once a second, so silence of 3 s is three of them.
    """

    silence_s: float = 3.0
    loss: float = 0.25
    round_trip_s: float = 1.0
    bad_signatures: float = 10.0  #: in the window of the measurement
    hold_s: float = 1.0

    def __post_init__(self) -> None:
        for name in ("silence_s", "loss", "round_trip_s", "bad_signatures", "hold_s"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} = {getattr(self, name):g}: must be above 0")


class LinkEventKind(Enum):
    DEGRADED = "degraded"  #: a measure went over its limit
    RESTORED = "restored"  #: and came back
    SWITCHED = "switched"  #: the downlink moved to this link


@dataclass(frozen=True, slots=True)
class LinkEvent:
    """Something about a link that the rules, the journal or people should know. `text` is a line for people."""

    kind: LinkEventKind
    device: str
    text: str
    measure: Measure | None = None
    value: float | None = None
    limit: float | None = None


class LimitWatch:
    """One measure of one link against its limit."""

    def __init__(self, device: str, measure: Measure, limit: float, hold_s: float) -> None:
        self.degraded = False
        self._device = device
        self._measure = measure
        self._limit = limit
        self._hold_s = hold_s
        self._since: float | None = None

    def update(self, value: float | None, now: float) -> LinkEvent | None:
        """The event that this value makes, if it makes one."""
        if value is None:
            self._since = None
            return None
        turned = value <= self._limit * RESTORE_SHARE if self.degraded else value > self._limit
        if not turned:
            self._since = None
            return None
        if self._since is None:
            self._since = now
        if now - self._since < self._hold_s:
            return None
        self._since = None
        self.degraded = not self.degraded
        kind = LinkEventKind.DEGRADED if self.degraded else LinkEventKind.RESTORED
        shown, limit = _shown(self._measure, value), _shown(self._measure, self._limit)
        text = f"link {self._device} {kind.value}: {self._measure.value} {shown}, limit {limit}"
        return LinkEvent(kind, self._device, text, self._measure, value, self._limit)


def _shown(measure: Measure, value: float) -> str:
    if measure in (Measure.LOSS, Measure.DOWNLINK_LOSS):
        return f"{value:.0%}"
    if measure is Measure.OVERFLOW:
        return f"{value:g} datagrams"
    return f"{value:g}" if measure is Measure.BAD_SIGNATURES else f"{value:.2f} s"
