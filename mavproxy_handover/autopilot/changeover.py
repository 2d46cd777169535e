# SPDX-License-Identifier: GPL-3.0-or-later

"""What a change of commander means at the autopilot, in this order.

1. What the former commander has open there is closed, in its own name (`gate/flush.py`), before the next lease goes
   out: the autopilot takes sticks from nobody but its commander, whom the lease names.
2. The rates that the former commander has set are taken back, as far as the companion has its own (`streams.py`).
3. The successor's last heartbeat is passed on, if it is fresh: the autopilot watches this station from now on.

At arming, parameter files that are being written are thrown away: nobody may set those in flight.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import chain

from mavproxy_handover.autopilot.streams import Streams
from mavproxy_handover.core.model import AuthorityView
from mavproxy_handover.gate.flush import Closing, FlushTracker
from mavproxy_handover.narrator import Narrator
from mavproxy_handover.stations.port import StationPort

__all__ = ["Changeover"]

#: a heartbeat this old still says that its station lives
_HEARTBEAT_FRESH_S = 2.0


class Changeover:
    """`flusher` follows what is open at the autopilot, `write_autopilot` takes whole frames."""

    def __init__(
        self,
        flusher: FlushTracker,
        write_autopilot: Callable[[bytes], None],
        ports: Mapping[int, StationPort],
        streams: Streams,
        narrator: Narrator,
    ) -> None:
        self._flusher = flusher
        self._write_autopilot = write_autopilot
        self._ports = ports
        self._streams = streams
        self._narrator = narrator

    def view_changed(self, before: AuthorityView, view: AuthorityView, now: float) -> None:
        """A new view is in force: what follows from it at the autopilot."""
        if view.commander != before.commander:
            if before.commander is not None:
                self.close_all_of(before.commander)
                self._streams.renew()
            successor = self._ports.get(view.commander or 0)
            if successor is not None and now - successor.heartbeat_at < _HEARTBEAT_FRESH_S:
                self._write_autopilot(successor.heartbeat)
        if view.armed and not before.armed and view.commander is not None:
            self._close(view.commander, self._flusher.parameters())

    def close_all_of(self, station: int) -> None:
        """Close everything that `station` has open at the autopilot."""
        self._close(station, self._flusher.flush(station))

    def _close(self, station: int, closings: list[Closing]) -> None:
        for raw in chain.from_iterable(closing.frames for closing in closings):
            self._write_autopilot(raw)
        for closing in closings:
            self._narrator.closed(station, closing)
