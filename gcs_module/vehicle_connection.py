# SPDX-License-Identifier: GPL-3.0-or-later

"""The station's links to one vehicle: which one is used, whose frames count, and what is sent on them.

MAVProxy checks no signature of a message that it does not know, so `check` checks our own messages.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from gcs_module.links import Links
from gcs_module.signing import LinkSigning
from gcs_module.udp_senders import UdpSenders
from gcs_module.uplink import UplinkSelector
from mavproxy_handover.link.timesync import probe_answer
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.signing import SignatureVerdict

__all__ = ["VehicleConnection"]


class VehicleConnection:
    """Times are monotonic seconds. `signing`: the vehicle's key on its links; None: there is no key."""

    def __init__(
        self,
        links: Links,
        sysid: int,
        signing: LinkSigning | None,
        clock: Callable[[], float],
        fault: Callable[[str, str], None],
    ) -> None:
        self._links = links
        self._sysid = sysid
        self._signing = signing
        self._senders = UdpSenders(sysid, signing is not None, clock, fault)
        self._uplink = UplinkSelector()

    def refresh(self) -> None:
        """Set up links that were added; to be called once a second."""
        masters = self._links.of(self._sysid)
        self._senders.watch(masters)
        if self._signing is not None:
            self._signing.sign(masters, self._senders.proven)

    def release(self) -> None:
        """Restore the links."""
        self._senders.release()
        if self._signing is not None:
            self._signing.release()

    def check(self, frame: Frame) -> SignatureVerdict | None:
        """The verdict on the signature of one of our messages; OK without a key. None: a copy by another link."""
        return SignatureVerdict.OK if self._signing is None else self._signing.check(frame)

    def answer_probe(self, frame: Frame, now: float) -> None:
        """Answer a link probe on every link.

        MAVProxy does not say which link it came by, and the vehicle uses only the answer on the right one.
        """
        answer = probe_answer(frame, int(now * 1e9))
        if answer is not None:
            for master in self._links.of(self._sysid):
                master.mav.send(answer)

    def choose_link(self, masters: Sequence[Any], now: float) -> str:
        """Change to a better one of the vehicle's links `masters`; returns its address, "" if nothing changes.

        MAVProxy's own fail-over takes five seconds.
        """
        if len(masters) < 2:
            return ""
        before = self._links.number(self._sysid)
        chosen = self._uplink.choose([self._senders.received(master) for master in masters], before, now)
        return "" if chosen == before else str(self._links.use(self._sysid, chosen).address)

    def send(self, message: Any) -> None:
        """Send a MAVLink message to the vehicle; after `link remove` there may be no link, and nothing is sent."""
        # packed by MAVProxy: numbers of a second sequence on its link would look like lost frames at the vehicle
        link = self._links.carrier(self._sysid)
        if link is not None:
            link.mav.send(message)

    def links(self) -> list[tuple[str, bool, bool, int]]:
        """The vehicle's links: address, whether it works by MAVProxy's judgement, whether it is used, frames so far."""
        used = self._links.carrier(self._sysid)
        return [
            (
                str(master.address),
                not getattr(master, "linkerror", False),
                master is used,
                self._senders.received(master),
            )
            for master in self._links.of(self._sysid)
        ]

    def summary(self) -> str:
        """How many of the vehicle's links work by MAVProxy's judgement, "1 of 2"."""
        masters = self._links.of(self._sysid)
        return f"{sum(not getattr(master, 'linkerror', False) for master in masters)} of {len(masters)}"
