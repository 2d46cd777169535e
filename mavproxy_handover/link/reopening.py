# SPDX-License-Identifier: GPL-3.0-or-later

"""A link that is opened again and again while it cannot be opened.

Rules that live here:

1. A restart in flight must not fail because of one link. A port may be in use, an address may be gone with its
   interface, or a name look-up may fail. Then this link is closed and names its fault (`trouble`). The other links go
   on.
2. A host's name is looked up in a thread (`names.py`). While nothing is heard on a link for SILENT_S, its name is
   looked up again. A link that stays silent goes on to the next address of the name.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from mavproxy_handover.link.base import Backoff, Clock, Device
from mavproxy_handover.link.forms import DeviceSpec, Kind, LinkError
from mavproxy_handover.link.names import Names, is_number
from mavproxy_handover.wire.frames import Frame

__all__ = ["SILENT_S", "ReopeningLink"]

SILENT_S: Final = 10.0
_LISTENING: Final = (Kind.UDP_IN, Kind.TCP_IN)


class ReopeningLink(Device):
    """Wraps another device that may be unable to open."""

    def __init__(
        self,
        spec: DeviceSpec,
        make: Callable[[DeviceSpec, Clock], Device],
        names: Names,
        clock: Clock = time.monotonic,
        *,
        strict: bool = False,
    ) -> None:
        """`make` opens the device of a spec whose host is an address; it raises LinkError.

        `strict`: raise LinkError if it cannot open now. Otherwise nothing raises.
        """
        super().__init__(spec.text, clock)
        self._spec = spec
        self._make = make
        self._names = names
        self._named = spec.kind is not Kind.SERIAL and not is_number(spec.host)
        self._inner: Device | None = None
        #: address of `_inner`, and number of changes of the address
        self._address = ""
        self._turn = 0
        self._backoff = Backoff(0.5, 1.0)
        #: time of the last frame, or of the opening
        self._heard_at = clock()
        fault = self._try_to_open()
        if fault is not None and strict:
            raise fault

    @property
    def trouble(self) -> str:
        """Text of the last error, "" while there is none."""
        return self._trouble if self._inner is None else self._inner.trouble

    @trouble.setter
    def trouble(self, text: str) -> None:
        self._trouble = text

    @property
    def open(self) -> bool:
        return self._inner is not None and self._inner.open

    @property
    def unfinished(self) -> bool:
        return self._inner is not None and self._inner.unfinished

    def fileno(self) -> int:
        return -1 if self._inner is None else self._inner.fileno()

    def descriptors(self) -> list[int]:
        return [] if self._inner is None else self._inner.descriptors()

    def read(self, once: bool = False) -> list[Frame]:
        if self._closed:
            return []
        inner = self._inner
        if inner is None:
            if self._backoff.due(self._clock()):
                self._try_to_open()
            return []
        frames = inner.read(once)
        if self._named:
            now = self._clock()
            if frames:
                self._heard_at = now
            elif now - self._heard_at >= SILENT_S:
                self._go_to_another(now)
        return frames

    def write(self, data: bytes) -> bool:
        return self._refused() if self._inner is None else self._inner.write(data)

    def write_more(self, data: bytes) -> bool:
        return self._inner is not None and self._inner.write_more(data)

    def flush(self) -> None:
        if self._inner is not None:
            self._inner.flush()

    @property
    def flow_controlled(self) -> bool:
        return self._inner is None or self._inner.flow_controlled

    def accept_sender(self, frame: Frame) -> bool:
        return self._inner is not None and self._inner.accept_sender(frame)

    def reply(self, frame: Frame, data: bytes) -> None:
        if self._inner is not None:
            self._inner.reply(frame, data)

    def _try_to_open(self) -> LinkError | None:
        """Try to open the device; returns the error if that fails."""
        now = self._clock()
        self._backoff.tried(now)
        fault = LinkError(f"link {self._spec.text} cannot be opened: the address of {self._spec.host} is not known yet")
        addresses = self._addresses()
        for number in range(len(addresses)):
            address = addresses[(self._turn + number) % len(addresses)]
            try:
                self._inner = self._make(replace(self._spec, host=address), self._clock)
            except LinkError as error:
                fault = error
                continue
            self._address, self._heard_at = address, now
            self._inner.counters = self.counters
            self._backoff.succeeded()
            self._trouble = ""
            return None
        self._failed(fault)
        return fault

    def _addresses(self) -> tuple[str, ...]:
        return self._names.addresses(self._spec.host) if self._named else (self._spec.host,)

    def _go_to_another(self, now: float) -> None:
        """Use another address, because nothing is heard. The name may have several addresses, or a new one."""
        self._heard_at = now
        self._names.request(self._spec.host)
        if self._spec.kind in _LISTENING:  # it listens on its own address, so the sender's address does not matter
            return
        addresses = self._addresses()
        if self._address in addresses:
            self._turn = addresses.index(self._address) + 1
        if len(addresses) > 1 or self._address not in addresses:
            self._shut()
            self._try_to_open()

    def _shut(self) -> None:
        if self._inner is not None:
            self._inner.close()
            self._inner = None
