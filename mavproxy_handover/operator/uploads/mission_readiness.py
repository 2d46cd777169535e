# SPDX-License-Identifier: GPL-3.0-or-later

"""Whether START may fly the mission on the autopilot, and the messages to operators about it.

1. A list that a station writes to the autopilot on the ground stays there until a package is shared or the mission is
   cleared. The companion judges it (`ground_uploads.py`). If it passes, START flies it; else START is refused with the
   reason.
2. Every station is told the result, and what to do.
3. The package on board (`mission` in the vehicle's configuration) is loaded automatically: at the start, after a flight
   that changed the mission, and after the mission was cleared. Every station is told.
4. START does not fly a mission that was neither loaded nor judged (`changed_past`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.events import Event, MissionJudged
from mavproxy_handover.gate.list_changes import MISSION, ListChange
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.operator.base.context import Reports
from mavproxy_handover.operator.stations.port import StationPort

__all__ = ["ON_BOARD_RETRY_S", "MissionReadiness"]

#: between two attempts to load the package on board, and after a station has changed the mission (s)
ON_BOARD_RETRY_S: Final = 10.0

_NOTICE: Final[int] = mavlink.MAV_SEVERITY_NOTICE
_CURE: Final = "START needs 'handover share'"
_OR_UPLOAD: Final = "START needs another mission or 'handover share'"
_OR_CLEAR: Final = "Or clear the mission: then the package on board is loaded"
_NO_PACKAGE: Final = "START needs a mission package: 'handover share'"
#: name of the source of the package on board
_VEHICLE: Final = "the vehicle's own package"


class MissionReadiness:
    """The readiness of one vehicle's mission. `on_board`: the package that its configuration names; None: none."""

    def __init__(
        self, on_board: MissionPackage | None, handle: Callable[[Event, float], None], reports: Reports
    ) -> None:
        self.on_board = on_board
        self._handle = handle
        self._reports = reports
        #: a station wrote the list that the autopilot holds: the package on board does not replace it
        self.kept = False
        #: the last reason given to the arbiter why no mission is loaded
        self._lacks = ""
        #: the last message that the package on board was not loaded
        self._failure = ""

    # ---- lists that stations wrote --------------------------------------------------------------------------------

    def changed(self, port: StationPort, change: ListChange, was_loaded: bool, now: float) -> None:
        """A station's message changes a list of the autopilot. `was_loaded`: until now a mission was loaded."""
        cleared = change.clears and change.what == MISSION
        if was_loaded or not self.kept:
            self._reports.event_log.list_changed(port.name, change.what, counted=was_loaded)
        self.kept = True
        lacks = self._cleared_words(port.name) if cleared else f"the {change.what} of {port.name} is being judged"
        self._lack(lacks, now)

    def cleared(self, name: str, now: float) -> None:
        """The autopilot holds no mission any more. `name`: of the station that cleared it, "" if not known."""
        self.kept = False
        self._lack(self._cleared_words(name), now)
        follows = (
            f"The package on board is loaded in {ON_BOARD_RETRY_S:g} s"
            if self.on_board
            else "START needs a mission or 'handover share'"
        )
        who = f"{name} cleared the mission on the autopilot" if name else "The autopilot holds no mission"
        self._say(f"{who}. {follows}.")

    def _cleared_words(self, name: str) -> str:
        words = f"{name} cleared it" if name else "it was cleared"
        return f"{words}. The package on board is loaded within {ON_BOARD_RETRY_S:g} s" if self.on_board else words

    def waits(self, name: str, what: str, now: float) -> None:
        """A list of a station cannot be judged yet."""
        of = f" of {name}" if name else ""
        self._lack(f"the {what}{of} waits to be judged: the autopilot has no home yet", now)

    def judged(self, name: str, what: str, items: int, package: str, *, own: bool, now: float) -> None:
        """A list of a station passed the judgement: it is the mission now. `own`: it is the package's own."""
        self.kept = not own
        self._lack("", now)
        of = f" of {name}" if name else ""
        if own:
            text = f"The mission{of} on the autopilot is that of package {package}. START flies it."
        else:
            flies = "it" if what == MISSION else "the mission within it"
            text = (
                f"The {what}{of} on the autopilot was read back and judged. START flies {flies} ({items} items). Zones "
                f"and stations stay those of package {package}."
            )
        self._say(text, _NOTICE)

    def rejected(self, name: str, what: str, why: str, lifted: str, *, known: bool, now: float) -> None:
        """A list of a station did not pass the judgement. `known`: there is a package to judge it by.

        `lifted`: how an operator can lift the refusal, "" if that is not possible.
        """
        self._lack(why, now)
        of = f" of {name}" if name else ""
        text = f"The mission{of} is on the autopilot and is not flown: {why}"
        if what != MISSION:
            text = f"The {what}{of} is on the autopilot and the mission is not flown: {why}"
        cure = _NO_PACKAGE if not known else f"{_OR_UPLOAD}. {_OR_CLEAR}" if self.on_board else _OR_UPLOAD
        sentences = (text, lifted, cure)
        self._say("".join(f"{sentence}. " for sentence in sentences if sentence).strip())

    def changed_past(self, how: str, now: float) -> None:
        """The autopilot holds another mission or geofence than the one that counted, written without the companion."""
        self.kept = True
        words = f"it was changed without the companion ({how})"
        self._lack(words, now)
        cure = f"{_CURE}. {_OR_CLEAR}" if self.on_board else _CURE
        self._say(f"The mission does not count any more: {words}. {cure}.")

    # ---- packages -------------------------------------------------------------------------------------------------

    def flight_over(self, now: float) -> None:
        """The flight is over, and the mission was changed in flight, so it does not count.

        A list that a station wrote on the ground before is judged again instead.
        """
        if self.kept:
            return
        follows = "The package on board is loaded now" if self.on_board else _CURE
        self._lack("it was changed in flight", now)
        self._say(f"The mission was changed in flight. {follows}.")

    def loaded(self, mission: str, sender: StationPort | None, now: float) -> None:
        """A package was written and read back. `sender` gets its own answer; None: the package on board."""
        self.kept = False
        self._lack("", now)
        self._failure = ""
        source = _VEHICLE if sender is None else sender.name
        text = f"Mission {mission} loaded from {source}: written, read back, equal."
        for port in self._reports.message_sender.ports.values():
            if port is not sender:
                self._reports.message_sender.say(port, text, _NOTICE)

    def failed(self, mission: str, why: str, station: str | None, now: float) -> None:
        """A package was not loaded. For the package on board, operators hear only a new reason: it is tried again."""
        text = f"Mission {mission} not loaded: {why}."
        self._lack(f"package {mission} was not loaded: {why}", now)
        if station is not None:
            self._say(f"{text} {_CURE}.")
        elif text != self._failure:
            self._failure = text
            self._say(f"{text} It is tried again every {ON_BOARD_RETRY_S:g} s.")

    def _lack(self, words: str, now: float) -> None:
        if words != self._lacks:
            self._lacks = words
            self._handle(MissionJudged(words), now)

    def _say(self, text: str, severity: int = mavlink.MAV_SEVERITY_WARNING) -> None:
        self._reports.message_sender.say_to_all(text, severity)
