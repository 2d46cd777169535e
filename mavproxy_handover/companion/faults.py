# SPDX-License-Identifier: GPL-3.0-or-later

"""Internal faults that cost one frame or one tick: counted, written to the journal, and told to the stations."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from typing import Final

from mavproxy_handover.operator.stations.sender import MessageSender
from mavproxy_handover.store.journal import Journal

__all__ = ["FaultLog", "FaultNews"]

#: entries of the journal about one kind of fault
_ENTRIES: Final = 10
#: a station whose heartbeat is older (s) would not get the text
_HEARS_S: Final = 2.5


class FaultLog:
    """Of one vehicle."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        #: the number of faults, by where they happened
        self.counts: Counter[str] = Counter()

    def report(self, where: str, text: str) -> None:
        """Something broke. `text`: its traceback."""
        self.counts[where] += 1
        if self.counts[where] <= _ENTRIES:
            with suppress(Exception):  # the journal itself may have broken: the fault is counted anyway
                self._journal.write("fault", f"{where}: {text}")


class FaultNews:
    """Tells each station of the first fault of a kind, and at the next take-off if there were more."""

    def __init__(self, log: FaultLog, message_sender: MessageSender) -> None:
        self._log = log
        self._message_sender = message_sender
        #: for each station: the number of faults when it was told of their kind
        self._told: dict[int, Counter[str]] = {station: Counter() for station in message_sender.ports}

    def each_second(self, now: float) -> None:
        """Tell the stations that are heard."""
        for station, told in self._told.items():
            port = self._message_sender.ports[station]
            if now - port.heartbeat_at > _HEARS_S:
                continue
            for where, count in list(self._log.counts.items()):  # telling may break as well
                if not told[where]:
                    told[where] = count
                    self._message_sender.say(port, f"internal fault of the companion: {where}")

    def flight_begins(self) -> None:
        """Stations are told again of every kind of which there were more faults."""
        for told in self._told.values():
            for where in [where for where, count in told.items() if self._log.counts[where] > count]:
                del told[where]
