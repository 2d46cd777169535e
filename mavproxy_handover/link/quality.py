# SPDX-License-Identifier: GPL-3.0-or-later

"""Quality of a link, and the limits above which it is degraded.

A limit has hysteresis in value and in time, so that a link at its limit makes one event and not many. A value above the
limit for `hold_s` degrades the link. A value below RESTORE_SHARE of the limit for `hold_s` restores it. Silence needs
no hold, because it is a time already. An unknown value (not measured) changes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

__all__ = ["LinkEvent", "LinkEventKind", "LinkLimits", "LinkQuality", "LimitWatch", "Measure"]

RESTORE_SHARE: Final = 0.75


@dataclass(frozen=True, slots=True)
class LinkQuality:
    """Measurements of a link at one time. Counts and shares cover the last `window_s`; None means "not known"."""

    window_s: float
    heard_ago_s: float | None  #: time since the last genuine frame
    answered_ago_s: float | None  #: time since the newest answered probe was sent, less the usual round trip
    loss: float | None  #: share of the station's frames that were lost, by sequence numbers
    probes_lost: float | None  #: share of probes without an answer
    downlink_loss: float | None  #: share of the vehicle's frames that are lost, as estimated from probes
    downlink_loss_least: float | None  #: that share less 2.5 standard deviations: its certain part
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
    """The measures that have limits."""

    SILENCE = "silence"
    LOSS = "loss"
    DOWNLINK_LOSS = "downlink loss"
    ROUND_TRIP = "round trip"
    BAD_SIGNATURES = "bad signatures"
    OVERFLOW = "receive overflow"


@dataclass(frozen=True, slots=True)
class LinkLimits:
    """Limits above which a link is degraded. Raises ValueError for a limit that is not above 0.

    `loss` limits the loss of the uplink and of the downlink. The limit of the round trip is what STANAG 4586 #1-#5
    allow for a message one way. The heartbeat of a ground station comes once a second, so a silence of 3 s is three of
    them.
    """

    silence_s: float = 3.0
    loss: float = 0.25
    round_trip_s: float = 1.0
    bad_signatures: float = 10.0  #: number within the window of the measurement
    hold_s: float = 1.0

    def __post_init__(self) -> None:
        for name in ("silence_s", "loss", "round_trip_s", "bad_signatures", "hold_s"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} = {getattr(self, name):g}: must be above 0")


class LinkEventKind(Enum):
    DEGRADED = "degraded"  #: a measure went over its limit
    RESTORED = "restored"  #: a measure came back below its limit
    SWITCHED = "switched"  #: the downlink moved to this link


@dataclass(frozen=True, slots=True)
class LinkEvent:
    """An event of a link for the rules, the journal or people. `text` is one line for people."""

    kind: LinkEventKind
    device: str
    text: str
    measure: Measure | None = None
    value: float | None = None
    limit: float | None = None


class LimitWatch:
    """Compares one measure of one link to its limit."""

    def __init__(self, device: str, measure: Measure, limit: float, hold_s: float) -> None:
        self.degraded = False
        self._device = device
        self._measure = measure
        self._limit = limit
        self._hold_s = hold_s
        self._since: float | None = None

    def update(self, value: float | None, now: float) -> LinkEvent | None:
        """The event that this value causes, if any."""
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
