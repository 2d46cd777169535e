# SPDX-License-Identifier: GPL-3.0-or-later

"""Every sentence of a station's journal, and the lines on the console that go with them.

Messages of a transfer are sampled for each sender: on the ground link any program can send them, and none may fill the
journal (`store/sampling.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

from gcs_module.alarms import EVENTS, Alarms, Level
from gcs_module.banner import Situation
from gcs_module.core import Notice, StationCore
from gcs_module.duty import Outcome
from gcs_module.texts import Text
from gcs_module.view import View
from mavproxy_handover.core.common.messages import Message, TransferMessage
from mavproxy_handover.core.common.model import Phase
from mavproxy_handover.store.journal import Journal
from mavproxy_handover.store.sampling import Sampler
from mavproxy_handover.wire import codec

__all__ = ["FlightEventLog", "StationEventLog"]

#: a limit far above the messages of the worst handovers: at once, and from then on one per interval (s)
_SAID = (5000, 0.1)


#: the journal has the seconds to a border that are shown, from this many on (s)
BORDER_S: Final = 20.0
#: entries that say which operator was on duty
_OF_OPERATORS = ("consent", "command", "acknowledged")


class StationEventLog:
    """Journal and lines about the station itself. `tell`: shows a line with its level."""

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
        """The replay state that was found is not as it should be."""
        self._journal.write("replay_state", text)
        self._tell(text, Level.INFO)

    def unloaded(self) -> None:
        """The module is unloaded; nothing is written after this."""
        self._journal.write("unloaded")
        self._journal.close()

    def wait_until_written(self, within_s: float) -> bool:
        """Wait, `within_s` at most, until the journal is written; returns whether it is. Not for the main loop."""
        return self._journal.wait_until_written(within_s)

    def fault(self, where: str, text: str) -> None:
        """An internal fault."""
        self._journal.write("fault", f"{where}: {text}")

    def duty(self, outcome: Outcome, name: str) -> None:
        """An operator signed on or off, or the shift changed."""
        self._journal.write("operator", outcome.text, operator=name or None, before=outcome.before or None)
        self._tell(outcome.text, Level.ADVISORY)

    def signed_off(self, text: str, before: str, *, required: bool) -> None:
        """The program was started again, and the operator who was on duty is signed off by that. `required`: the
        station takes no aircraft until an operator signs on."""
        consequence = " This station takes no aircraft until then." if required else ""
        self._journal.write("operator", text + consequence, before=before)
        self._tell(text + consequence, Level.WARNING if required else Level.ADVISORY)

    def unmanned(self) -> None:
        """The station requires an operator, and none is on duty."""
        text = "No operator is on duty: this station takes no aircraft. 'handover operator NAME' signs on."
        self._journal.write("operator", text)
        self._tell(text, Level.WARNING)

    def closing(self, text: str) -> None:
        """The station ends while it commands an aircraft in flight."""
        self._journal.write("closing", text)
        self._tell(text, Level.WARNING)

    def link(self, text: str) -> None:
        """A fault of a link, or of a sender on it."""
        self._journal.write("link", text)
        self._tell(text, Level.WARNING)

    def panel(self, order: str, argument: str) -> None:
        """The operator has given an order by the panel."""
        self._journal.write("panel", f"{order} {argument}".rstrip(), order=order)

    def notice(self, notice: Notice) -> None:
        """A notice about another station, from the rules of the vehicles."""
        self._journal.write(notice.event, notice.text)
        self._tell(notice.text, notice.gravity)


class FlightEventLog:
    """Journal and lines about one vehicle's flight. `vehicle`: its name in the journal; None: the station has no other
    one. `on_duty`: the operator on duty, "" without one."""

    def __init__(
        self,
        journal: Journal,
        core: StationCore,
        view: View,
        vehicle: str | None = None,
        on_duty: Callable[[], str] = str,
    ) -> None:
        self._journal = journal
        self._on_duty = on_duty
        self._core = core
        self._view = view
        self._vehicle = vehicle
        #: the standing alarms
        self.alarms = Alarms()
        #: the seconds to the next border that the journal has last
        self._border_shown: int | None = None
        #: samplers by sender or receiver, and link
        self._samplers: dict[tuple[str, str | None], Sampler] = {}

    def _write(self, event: str, text: str = "", **values: Any) -> None:
        operator = self._on_duty() if event in _OF_OPERATORS else ""
        if operator:
            text, values["operator"] = f"{text.rstrip('.')}. On duty: {operator}.", operator
        self._journal.write(event, text, vehicle=self._vehicle, **values)

    def notice(self, notice: Notice, now: float) -> None:
        """A notice of the station's rules."""
        self._write(notice.event, notice.text, role=self._core.role.value, epoch=self._core.epoch)
        self.alarms.on_line(notice.event, notice.gravity, notice.text, now, notice.row)
        self._view.line(notice.text, notice.gravity)

    def border_shown(self, now: Situation) -> None:
        """The seconds to the next border, as the status row shows them: the last BORDER_S, one entry a second."""
        shown = round(now.ahead_s) if now.ahead and not now.old and 0.0 < now.ahead_s <= BORDER_S else None
        if shown is not None and shown != self._border_shown:
            self._write("border_shown", f"{now.ahead} in {shown} s", station=now.ahead, in_s=shown)
        self._border_shown = shown

    def briefing(self, vehicle: str, lines: Sequence[str]) -> None:
        """The briefing that goes with the question whether the station takes the aircraft."""
        self._write("briefing", "\n".join(lines))
        for line in (f"{vehicle} as it is:", *(f"  {line}" for line in lines)):
            self._view.show(line)

    def repeat_alarms(self, now: float) -> None:
        """Repeat the standing alarms that are due; to be called each second."""
        if self._core.open_question is None:
            self.alarms.end("question")
        if self._core.phase is Phase.ON_LOAD:
            self.alarms.end("commander")
        for alarm in self.alarms.due(now):
            self._view.line(alarm.text, alarm.level)

    def acknowledged(self) -> None:
        """The operator has acknowledged the standing alarms."""
        alarms = self.alarms.acknowledge()
        for alarm in alarms:
            self._write("acknowledged", alarm.text, level=alarm.level.name.lower())
        told = "; ".join(alarm.text for alarm in alarms)
        self._view.show(f"acknowledged: {told}" if alarms else "no alarm to acknowledge", whose=True)

    def text(self, text: Text, now: float) -> None:
        """A text of the vehicle."""
        if self._sampler("texts", None).admit(now) is None:
            return
        self._write("text", text.words)
        if text.shown:
            self._view.alert(text.words, text.level)
        else:
            self._view.line(text.words, text.level)

    def sum_up(self, now: float) -> None:
        """Tell once a minute how many messages were left out; to be called each second."""
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
        """A message of a transfer, "in" or "out"; other messages are ignored. `via`: None is the vehicle's link."""
        if not isinstance(message, TransferMessage):
            return
        if self._sampler(who, via).admit(now) is not None:
            self._write("message", direction=direction, station=who, via=via, **codec.values_of(message))

    def stream(self, text: str, now: float) -> None:
        """The gate's text about this station's sticks and setpoints."""
        if self._sampler("sticks", None).admit(now) is not None:
            self._write("stream", text)
            self._view.line(text, EVENTS["stream"])

    def telemetry(self, lat_deg: float, lon_deg: float, zone: str) -> None:
        """The aircraft's position, by the vehicle's telemetry."""
        self._write("telemetry", lat_deg=lat_deg, lon_deg=lon_deg, zone=zone)

    def link_chosen(self, address: str) -> None:
        """Messages to the vehicle leave by another link."""
        text = f"link to the vehicle is {address} now"
        self._write("link", text, link=address, change="switched")
        self._view.line(f"{text[:1].upper()}{text[1:]}.")

    def package(self, event: str, text: str, who: str) -> None:
        """A mission package was offered, received or sent."""
        self._write(event, text, station=who)
        self._view.line(f"{who}: {text}")

    def command_sent(self, word: str) -> None:
        """The operator's command was sent."""
        self._write("command", f"{word} sent", what=word)
        self._view.line(f"{word} sent.")

    def command_ended(self, word: str, outcome: str, text: str) -> None:
        """The command was answered, or it was not."""
        self._write("command", text, what=word, result=outcome)
        self._view.line(text, Level.INFO if outcome in ("accepted", "pending") else Level.ADVISORY)
