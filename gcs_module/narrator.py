# SPDX-License-Identifier: GPL-3.0-or-later

"""What people get to read of a flight at a station: every sentence of its journal, and the lines that go with them.

Messages of a transfer are sampled, sender by sender: on the ground link anybody can say them, and nobody may fill the
journal (see `store/sampling.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from gcs_module.alarms import EVENTS, Alarms, Level
from gcs_module.core import Notice, StationCore
from gcs_module.texts import Text
from gcs_module.view import View
from mavproxy_handover.core.common.messages import Message, TransferMessage
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.store.journal import Journal
from mavproxy_handover.store.sampling import Sampler
from mavproxy_handover.wire import codec

__all__ = ["FlightNarrator", "StationNarrator"]

#: far more messages than there are in the worst of handovers: at once, and the interval (s) from then on
_SAID = (5000, 0.1)


class StationNarrator:
    """Tells what is the station's own, whatever vehicles it has. `tell`: a line for the operator, and its level."""

    def __init__(self, journal: Journal, tell: Callable[[str, Level], None]) -> None:
        self._journal = journal
        self._tell = tell

    def loaded(self, version: str, configuration: str) -> None:
        """The module is loaded."""
        self._journal.write("loaded", f"handover_gcs {version}, configuration {configuration}", version=version)

    def ground_open(self) -> None:
        """The ground link has no key."""
        self._journal.write("unsigned_allowed", "frames of the ground link are taken unsigned")
        self._tell(
            "WARNING: the ground link has no key: any program that reaches it can speak as another station.", Level.INFO
        )

    def replay_state(self, text: str) -> None:
        """What is remarkable about the replay state that was found."""
        self._journal.write("replay_state", text)
        self._tell(text, Level.INFO)

    def unloaded(self) -> None:
        """The module is unloaded; nothing comes after this."""
        self._journal.write("unloaded")
        self._journal.close()

    def settle(self, within_s: float) -> bool:
        """Wait, so long at most, until the journal has everything; whether it has. Not for the main loop."""
        return self._journal.settle(within_s)

    def fault(self, where: str, text: str) -> None:
        """Something broke."""
        self._journal.write("fault", f"{where}: {text}")

    def link(self, text: str) -> None:
        """What is wrong with a link, or with who speaks there."""
        self._journal.write("link", text)
        self._tell(text, Level.WARNING)

    def notice(self, notice: Notice) -> None:
        """What several vehicles' rules have to say of another station."""
        self._journal.write(notice.event, notice.text)
        self._tell(notice.text, notice.gravity)


class FlightNarrator:
    """Tells one vehicle's flight as a station sees it. `vehicle`: its name in the journal; None: there is no other."""

    def __init__(self, journal: Journal, core: StationCore, view: View, vehicle: str | None = None) -> None:
        self._journal = journal
        self._core = core
        self._view = view
        self._vehicle = vehicle
        #: what stands, and is said again
        self.alarms = Alarms()
        #: by sender or receiver, and link
        self._samplers: dict[tuple[str, str | None], Sampler] = {}

    def _write(self, event: str, text: str = "", **values: Any) -> None:
        self._journal.write(event, text, vehicle=self._vehicle, **values)

    def notice(self, notice: Notice, now: float) -> None:
        """What the station's rules have to say."""
        self._write(notice.event, notice.text, role=self._core.role.value, epoch=self._core.epoch)
        self.alarms.heard(notice.event, notice.gravity, notice.text, now)
        self._view.line(notice.text, notice.gravity)

    def briefing(self, vehicle: str, lines: Sequence[str]) -> None:
        """What the operator is told of the aircraft with the question whether he will take it."""
        self._write("briefing", "\n".join(lines))
        for line in (f"{vehicle} as it is:", *(f"  {line}" for line in lines)):
            self._view.show(line)

    def repeat_alarms(self, now: float) -> None:
        """Say again what stands and was not acknowledged; to be called each second."""
        if self._core.question is None and self._core.asked_ahead is None:
            self.alarms.end("question")
        if self._core.phase is Phase.ON_LOAD:
            self.alarms.end("commander")
        for alarm in self.alarms.due(now):
            self._view.line(alarm.text, alarm.level)

    def acknowledged(self) -> None:
        """The operator has noticed what stands."""
        alarms = self.alarms.acknowledge()
        for alarm in alarms:
            self._write("acknowledged", alarm.text, level=alarm.level.name.lower())
        told = "; ".join(alarm.text for alarm in alarms)
        self._view.show(f"acknowledged: {told}" if alarms else "no alarm to acknowledge", whose=True)

    def text(self, text: Text, now: float) -> None:
        """What the vehicle's companion says in words."""
        if self._sampler("texts", None).take(now) is None:
            return
        self._write("text", text.words)
        if text.shown:
            self._view.alert(text.words, text.level)
        else:
            self._view.line(text.words, text.level)

    def sum_up(self, now: float) -> None:
        """Tell what was left out, once a minute; to be called each second."""
        for (who, via), sampler in self._samplers.items():
            count = sampler.left_out(now)
            if count:
                self._write("left_out", f"{count} more messages, {who}", station=who, via=via, count=count)

    def _sampler(self, who: str, via: str | None) -> Sampler:
        sampler = self._samplers.get((who, via))
        if sampler is None:
            sampler = self._samplers[who, via] = Sampler(*_SAID)
        return sampler

    def message(self, direction: str, message: Message, who: str, now: float, via: str | None = None) -> None:
        """A message of a transfer, "in" or "out"; none of others. `via`: None is the vehicle's link."""
        if not isinstance(message, TransferMessage):
            return
        if self._sampler(who, via).take(now) is not None:
            self._write("message", direction=direction, station=who, via=via, **codec.values_of(message))

    def stream(self, text: str, now: float) -> None:
        """What the vehicle's gate says of this station's sticks and setpoints."""
        if self._sampler("sticks", None).take(now) is not None:
            self._write("stream", text)
            self._view.line(text, EVENTS["stream"])

    def telemetry(self, lat_deg: float, lon_deg: float, zone: str) -> None:
        """Where the vehicle says that the aircraft is."""
        self._write("telemetry", lat_deg=lat_deg, lon_deg=lon_deg, zone=zone)

    def link_chosen(self, address: str) -> None:
        """Another link carries what goes to the vehicle."""
        text = f"link to the vehicle is {address} now"
        self._write("link", text, link=address, change="switched")
        self._view.line(f"{text[:1].upper()}{text[1:]}.")

    def package(self, event: str, text: str, who: str) -> None:
        """A mission package was offered, received or sent."""
        self._write(event, text, station=who)
        self._view.line(f"{who}: {text}")

    def command_sent(self, word: str) -> None:
        """The operator's command is on its way."""
        self._write("command", f"{word} sent", what=word)
        self._view.line(f"{word} sent.")

    def command_ended(self, word: str, outcome: str, text: str) -> None:
        """It was answered, or not."""
        self._write("command", text, what=word, result=outcome)
        self._view.line(text, Level.INFO if outcome in ("accepted", "pending") else Level.ADVISORY)
