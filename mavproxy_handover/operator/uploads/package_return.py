# SPDX-License-Identifier: GPL-3.0-or-later

"""In flight a station that has no mission package gets the vehicle's back, by the vehicle's own link.

A station that was started again in flight may have lost its package. Without it the station cannot be partner. So the
vehicle offers the package that it flies, by the messages that stations use for it (`wire/package_transfer.py`), until
the station's answer to CONNECT shows the same digest. Only then it counts as partner.

Rules that live here
--------------------
* In flight only: on the ground the commander shares the mission.
* One station at a time, and at most one window of chunks (1.6 kB) a second: the link carries telemetry and handovers.
* A station that refuses, or does not answer for NO_ANSWER_S, is offered nothing more until it connects again, or
  AGAIN_S are over.
* The package is packed beside the main loop, once.
* The offer carries the vehicle's addresses for that station, as far as the package came with them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import Reason
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.tools.worker import Worker
from mavproxy_handover.wire.package_transfer import PackageSender
from mavproxy_handover.wire.vehicle_address import pack_addresses

__all__ = ["AGAIN_S", "NO_ANSWER_S", "WINDOW_S", "PackageReturn"]

NO_ANSWER_S: Final = 15.0
AGAIN_S: Final = 60.0
#: between two windows of chunks
WINDOW_S: Final = 1.0

_REFUSED: Final = mavlink.HANDOVER_PACKAGE_RESULT_REFUSED


class PackageReturn:
    """Of one vehicle. Times are monotonic seconds; not safe for threads."""

    def __init__(
        self, ports: Mapping[int, StationPort], unfit: Callable[[int, float], Reason | None], event_log: EventLog
    ) -> None:
        """`unfit`: why a station could not be partner now, None if it could."""
        self._ports = ports
        self._unfit = unfit
        self._event_log = event_log
        self._worker = Worker()
        #: the package that is flown, and its bytes once they are packed
        self._package: MissionPackage | None = None
        self._data: bytes | None = None
        #: the station that is being sent the package, since when it has not answered, and its sender
        self._to: int | None = None
        self._answered_at = -inf
        self._sender: PackageSender | None = None
        #: chunks that wait for their second, and when the next window may go
        self._waiting: list[Any] = []
        self._window_at = -inf
        #: station -> until when it is offered nothing
        self._paused: dict[int, float] = {}

    def tick(self, package: MissionPackage | None, flying: bool, now: float) -> None:
        """Time has passed; `package`: the one that is flown."""
        self._worker.tick(now)
        if package is None or not flying:
            self._stop()
            return
        if package is not self._package:
            self._stop()
            self._package, self._data = package, None
        if self._data is None:
            self._pack(package)
            return
        why = Reason.MISSION_MISSING if self._to is None else self._unfit(self._to, now)
        if self._to is not None and why is not Reason.MISSION_MISSING:  # it has the package, or is not there any more
            if why is None:
                self._event_log.package_returned(self._ports[self._to].name, "the station has it")
            self._stop()
        if self._to is None:
            self._begin(package, self._data, now)
        if self._to is not None:
            self._go_on(self._to, now)

    def on_ack(self, port: StationPort, message: Any, now: float) -> None:
        """MISSION_PACKAGE_ACK of a station."""
        if port.sysid != self._to or self._sender is None:
            return
        self._answered_at = now
        self._waiting = self._sender.on_ack(message, now) or self._waiting
        if self._sender.result == _REFUSED:
            self._event_log.package_returned(port.name, f"refused: {self._sender.text}")
            self._paused[port.sysid] = now + AGAIN_S
            self._stop()

    def _pack(self, package: MissionPackage) -> None:
        def packed(result: bytes | Exception, _now: float) -> None:
            if package is self._package and isinstance(result, bytes):
                self._data = result

        self._worker.submit(package.to_bytes, packed)

    def _begin(self, package: MissionPackage, data: bytes, now: float) -> None:
        for sysid, port in self._ports.items():
            if now < self._paused.get(sysid, -inf) or self._unfit(sysid, now) is not Reason.MISSION_MISSING:
                continue
            self._to, self._answered_at, self._waiting = sysid, now, []
            addresses = pack_addresses(package.addresses, sysid)
            self._sender = PackageSender(data, package.digest, package.name, port.target, addresses=addresses)
            self._event_log.package_returned(port.name, "sent")
            return

    def _go_on(self, station: int, now: float) -> None:
        assert self._sender is not None
        port = self._ports[station]
        if now - self._answered_at >= NO_ANSWER_S:
            self._event_log.package_returned(port.name, "no answer")
            self._paused[station] = now + AGAIN_S
            self._stop()
            return
        for message in self._sender.tick(now):
            port.send(message)
        if self._waiting and now >= self._window_at:
            self._window_at = now + WINDOW_S
            waiting, self._waiting = self._waiting, []
            for message in waiting:
                port.send(message)

    def _stop(self) -> None:
        self._to = self._sender = None
        self._waiting = []
