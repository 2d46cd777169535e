# SPDX-License-Identifier: GPL-3.0-or-later

"""What people get to read of a flight while it lasts and after it: entries of the journal, lines of the console.

One method for each kind of entry, so that its words and values are the same wherever it comes from. Nothing is decided
here, and nothing that arrived in a frame is more than words here.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from enum import Enum
from typing import Any

from mavproxy_handover.autopilot.aircraft import Aircraft
from mavproxy_handover.autopilot.preflight import Finding
from mavproxy_handover.core import events
from mavproxy_handover.core.arbiter import Arbiter
from mavproxy_handover.core.model import AuthorityView, Phase, Reason
from mavproxy_handover.gate.flush import Closing
from mavproxy_handover.link.quality import LinkEvent
from mavproxy_handover.stations.port import StationPort
from mavproxy_handover.store.journal import Journal
from mavproxy_handover.wire import codec

__all__ = ["Narrator"]

_DISPLAY_MODE = {phase: phase.name.replace("_", "") for phase in Phase}
_CLOCK_STEP_S = 1.0


class Narrator:
    """Tells the flight of one vehicle. `show` takes a console line, `phase` is the phase that is in force."""

    def __init__(
        self,
        vehicle: str,
        journal: Journal,
        arbiter: Arbiter,
        show: Callable[[str], None],
        phase: Callable[[], Phase],
    ) -> None:
        self.journal = journal
        self._vehicle = vehicle
        self._arbiter = arbiter
        self._show = show
        self._phase = phase
        #: by station, message and reason: when it was journalled last, and how many were left out since
        self._refusals: dict[tuple[int, int, Enum], tuple[float, int]] = {}
        self._clock_offset_s: float | None = None

    def tell(self, text: str) -> None:
        """A line on the console, in the form of the thesis."""
        stamp = time.strftime("%H:%M:%S")
        self._show(f"[{stamp}|{self._vehicle}][{_DISPLAY_MODE[self._phase()]}]: {text}")

    def record(self, action: events.Record) -> None:
        """An entry that the arbiter asks for."""
        self.journal.write(
            action.event,
            action.text,
            reason=action.reason.name.lower() if action.reason is not Reason.NONE else None,
            station=self._name(action.station),
            duration_s=None if action.duration_s is None else round(action.duration_s, 4),
            handover_id=self._arbiter.view.handover_id if action.event.startswith(("transfer", "step")) else None,
            epoch=self._arbiter.view.epoch if action.event in ("transfer_committed", "authority") else None,
        )
        if action.event != "step":
            self.tell(action.text[:1].upper() + action.text[1:] + ".")

    def view(self, view: AuthorityView, reason: Reason) -> None:
        """A new view is in force."""
        self.journal.write(
            "view",
            phase=view.phase.name.lower(),
            commander=self._name(view.commander),
            partner=self._name(view.partner),
            epoch=view.epoch,
            lease=view.lease.name.lower(),
            reason=reason.name.lower(),
        )

    def message(self, direction: str, port: StationPort, message: Any, attempt: int | None = None) -> None:
        """A message of a transfer, `direction` "in" or "out"."""
        key = message.key
        self.journal.write(
            "message",
            direction=direction,
            name=codec.name_of(message),
            station=port.name,
            handover_id=key.handover_id,
            epoch=key.epoch,
            attempt=attempt,
            relayed=getattr(message, "relayed", False) or None,
            consent=message.consent.name.lower() if hasattr(message, "consent") else None,
        )

    def refused(
        self, port: StationPort, key: tuple[int, int, Enum], what: str, reason: str, answered: bool, now: float
    ) -> None:
        """One entry a second for each station, message and reason; the next one says how many were left out."""
        since, kept_back = self._refusals.get(key, (-1.0, 0))
        if now - since < 1.0:
            self._refusals[key] = (since, kept_back + 1)
            return
        self._refusals[key] = (now, 0)
        text = f"{what} of {port.name} refused: {reason}"
        also = kept_back or None
        self.journal.write("refused", text, station=port.name, what=what, reason=reason, answered=answered, also=also)

    def link(self, port: StationPort, change: LinkEvent) -> None:
        """What the measuring of a link has brought to light."""
        self.journal.write(
            "link",
            change.text,
            station=port.name,
            link=change.device,
            change=change.kind.value,
            measure=None if change.measure is None else change.measure.value,
            value=None if change.value is None else round(change.value, 3),
        )

    def closed(self, station: int, closing: Closing) -> None:
        """Something that `station` had open at the autopilot was closed."""
        name, incomplete = self._arbiter.name(station), closing.incomplete or None
        self.journal.write("flush", f"{closing.what} ({name})", station=name, incomplete=incomplete)

    def preflight(self, finding: Finding, fits: bool) -> None:
        """What the checks before flight found."""
        self.journal.write("preflight", finding.text, parameter=finding.parameter or None, fits=fits)
        self.tell(f"Preflight: {finding.text}." if fits else f"Preflight WARNING: {finding.text}.")

    def position(self, aircraft: Aircraft, zone: int, commander: int | None) -> None:
        """Where the aircraft is; only while its position is known."""
        position = aircraft.position
        if position is None:
            return
        self.journal.write(
            "position",
            lat_deg=position.lat / 1e7,
            lon_deg=position.lon / 1e7,
            alt_m=position.relative_alt / 1000.0,
            zone=self._name(zone),
            commander=self._name(commander),
            waypoint=aircraft.waypoint,
        )

    def clock(self, now: float) -> None:
        """Nothing goes by the wall clock; who reads the journal must know that it was set. `now`: monotonic s."""
        offset_s = time.time() - now
        if self._clock_offset_s is not None and abs(offset_s - self._clock_offset_s) > _CLOCK_STEP_S:
            step_s = offset_s - self._clock_offset_s
            self.journal.write("clock_step", f"the clock was set by {step_s:+.1f} s", step_s=round(step_s, 3))
        self._clock_offset_s = offset_s

    def _name(self, station: int | None) -> str | None:
        return self._arbiter.name(station) if station else None
