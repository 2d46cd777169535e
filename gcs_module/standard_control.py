# SPDX-License-Identifier: GPL-3.0-or-later

"""Control of one vehicle by the MAVLink operator-control standard, for a manager that is not our companion. Pure.

Rules that live here
--------------------
* The standard is used only if the vehicle sends no message of ours. A manager counts after GRACE_S in which none came.
  The first message of ours ends the use of the standard, until the module is loaded again.
* The manager is the component of the vehicle that sends CONTROL_STATUS with the flag of a system manager. The station
  stays with it until nothing of it was heard for LOST_S; then it follows another one. Two at once are an alarm.
* Only CONTROL_STATUS tells which station is in control. An accepted request alone changes nothing.
* A request stands for its time-out. If the owner allows takeover in that time, or releases control, the station sends
  the request once more: the standard wants that of the requester.
* A request that the manager passes on is acknowledged at once, and the operator is asked. An accept allows takeover for
  WINDOW_S. After that this station forbids it again. A denial, or no answer, changes nothing: the owner keeps control.
* A copy of a request within COPY_S of its answer is acknowledged without another question.

Layouts and results: `docs/operating.md`, and the messages in `wire/operator_control.xml`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil, inf
from typing import Any, Final

from gcs_module.events import AcknowledgeManager, Action, AskManager, ControlAsked, ControlStatusHeard, WishAnswered
from gcs_module.notices import notice

__all__ = ["GRACE_S", "LOST_S", "NOT_IN_STANDARD", "WINDOW_S", "ControlQuestion", "StandardControl"]

#: time (s) in which a companion of ours would have been heard
GRACE_S: Final = 3.0
#: a manager that was not heard for this long (s) may be replaced by another one
LOST_S: Final = 5.0
#: time (s) in which the requester may take control after the owner has allowed it
WINDOW_S: Final = 10.0
#: a copy of a request that was just answered comes within this time (s)
COPY_S: Final = 3.0
#: the operator is told at most this often (s) that one more station asks
_TOO_S: Final = 3.0
#: the shortest and the longest time-out (s) of a request
_SHORTEST_S: Final = 3.0
_LONGEST_S: Final = 60.0

#: commands without a counterpart in the operator-control standard, and what to do instead
NOT_IN_STANDARD: Final[Mapping[str, str]] = {
    "give": "'handover release' gives control up, or the other station requests it.",
    "override": "The limits of energy, fence and coverage belong to our companion.",
    "delegate": "Delegation to onboard programs needs our companion.",
    "payload": "Payload authority needs our companion.",
    "rehearse": "A rehearsal needs our companion.",
    "share": "The vehicle takes no mission package.",
    "telemetry": "MAVProxy's own displays show the vehicle's values.",
    "briefing": "Ask the other station how the aircraft is.",
}


@dataclass(slots=True)
class ControlQuestion:
    """Another station asks for control. `number`: of this question; `until`: end of its time (monotonic s)."""

    requester: int
    number: int
    until: float
    #: the time left (s) that the operator was told last
    told_left_s: float = inf


class StandardControl:
    """`own`: this station's system id. `name`: returns a station's name; `vehicle`: the vehicle's now. `automatic`: a
    request of another station needs no operator here."""

    def __init__(
        self, own: int, name: Callable[[int | None], str], vehicle: Callable[[], str], *, automatic: bool
    ) -> None:
        self._own = own
        self._name = name
        self._vehicle = vehicle
        self._automatic = automatic
        #: a message of our companion was heard
        self._ours = False
        #: since when a manager has been heard without a message of ours
        self._since = inf
        #: the component that manages control, and when it was last heard
        self.manager: int | None = None
        self.heard_at = -inf
        #: another component that claims the same, and when
        self._rival: int | None = None
        self._rival_at = -inf
        self.in_use = False
        #: the station in control, by the last CONTROL_STATUS
        self.in_control: int | None = None
        self._takeover = False
        self.question: ControlQuestion | None = None
        self._number = 0
        self._answered: tuple[int, float] = (0, -inf)
        #: when the operator was last told that one more station asks
        self._too_at = -inf
        #: the station that may take control now, and until when
        self._allowed: tuple[int, float] | None = None
        #: this station's own request: until when it stands, its time-out, whether the owner is asked about it, and
        #: whether it was sent once more
        self._request_until = -inf
        self._request_s = 0.0
        self._pending = self._repeated = False

    # ---- what others may look at ----------------------------------------------------------------------------------

    @property
    def partner(self) -> int | None:
        """The station that may take control next, as far as this one knows."""
        if self.question is not None:
            return self.question.requester
        if self._allowed is not None:
            return self._allowed[0]
        return self._own if self._request_until > -inf else None

    @property
    def answer_until(self) -> float:
        """End of the time of the question or of the request; inf: there is none."""
        if self.question is not None:
            return self.question.until
        return self._request_until if self._request_until > -inf else inf

    # ---- in -------------------------------------------------------------------------------------------------------

    def ours(self) -> None:
        """A message of our companion: the standard is not used."""
        if self._ours:
            return
        self._ours, self.in_use = True, False
        self.question = self._allowed = None
        self._request_until = -inf

    def on_status(self, heard: ControlStatusHeard, flying: bool, now: float) -> tuple[bool, list[Action]]:
        """CONTROL_STATUS of a component of the vehicle; returns whether it is the manager's, and the actions."""
        actions: list[Action] = []
        if self._ours or not heard.manager or not self._is_manager(heard.component, now, actions):
            return False, actions
        self.heard_at = now
        if not self.in_use:
            self._since = min(self._since, now)
            if now - self._since < GRACE_S:
                return False, actions
            self.in_use = True
            actions.append(notice("manager_found", vehicle=self._vehicle(), component=heard.component))
            self._tell_control(None, heard.main, flying, actions)
            self.in_control = heard.main
        if heard.main != self.in_control:
            before, self.in_control = self.in_control, heard.main
            self._on_change(before, flying, actions)
        self._takeover = heard.takeover
        self._send_again(now, actions)
        return True, actions

    def _is_manager(self, component: int, now: float, actions: list[Action]) -> bool:
        if self.manager is None:
            self.manager = component
        if component == self.manager:
            return True
        if now - self.heard_at >= LOST_S:
            if self.in_use:
                actions.append(notice("manager_moved", vehicle=self._vehicle(), old=self.manager, new=component))
            self.manager, self._rival = component, None
            return True
        if self.in_use and self._rival is None:
            actions.append(notice("managers", vehicle=self._vehicle(), one=self.manager, other=component))
            self._rival = component
        self._rival_at = now
        return False

    def _on_change(self, before: int | None, flying: bool, actions: list[Action]) -> None:
        if self.in_control != self._own:
            self._close_question(actions)
            self._allowed = None
        else:
            self._request_until = -inf
        self._tell_control(before, self.in_control, flying, actions)

    def _tell_control(self, before: int | None, main: int | None, flying: bool, actions: list[Action]) -> None:
        values: dict[str, Any] = {"vehicle": self._vehicle(), "station": self._name(main)}
        if main == self._own:
            actions.append(notice("control_here", **values))
        elif main is not None:
            actions.append(notice("control_passed_on" if before == self._own else "control_there", **values))
        else:
            actions.append(notice("control_free_in_flight" if flying else "control_free", **values))

    def _close_question(self, actions: list[Action]) -> None:
        if self.question is not None:
            self.question = None
            actions.append(notice("control_withdrawn", vehicle=self._vehicle(), own=self._name(self._own)))

    def _send_again(self, now: float, actions: list[Action]) -> None:
        """Send the operator's request once more, if it can be granted now."""
        free = self.in_control is None or (self._takeover and self.in_control != self._own)
        if free and self._pending and not self._repeated and now < self._request_until:
            self._repeated = True
            actions.append(notice("control_offered", vehicle=self._vehicle()))
            actions.append(AskManager("REQUEST", request=True, timeout_s=self._request_s))

    def on_asked(self, asked: ControlAsked, now: float) -> list[Action]:
        """The manager passes on another station's request."""
        if not self.in_use or asked.component != self.manager or asked.requester in (0, self._own):
            return []
        actions: list[Action] = [AcknowledgeManager(asked.component)]
        if self.in_control != self._own or self._known(asked.requester, now):
            return actions
        values: dict[str, Any] = {"station": self._name(asked.requester), "vehicle": self._vehicle()}
        if self._automatic:
            if self._allowed is not None:  # any station may take control now
                return actions
            actions.append(notice("control_asked_automatic", **values))
            self._allow(asked.requester, now, actions)
        elif self.question is not None:
            if now - self._too_at >= _TOO_S:
                self._too_at = now
                actions.append(notice("control_asked_too", other=self._name(self.question.requester), **values))
        else:
            self._number += 1
            until = now + min(max(asked.timeout_s, _SHORTEST_S), _LONGEST_S)
            self.question = ControlQuestion(asked.requester, self._number, until)
            actions.append(notice("control_asked", waits=True, **values))
        return actions

    def _known(self, requester: int, now: float) -> bool:
        """Whether the operator knows of this request."""
        if self.question is not None and self.question.requester == requester:
            return True
        if self._allowed is not None and self._allowed[0] == requester:
            return True
        return self._answered[0] == requester and now - self._answered[1] < COPY_S

    # ---- the operator ---------------------------------------------------------------------------------------------

    def request(self, timeout_s: float, now: float) -> None:
        """The operator has asked for control; the command itself is sent by `commands.py`."""
        if self.in_control != self._own:
            self._request_until, self._request_s = now + timeout_s, timeout_s
            self._pending = self._repeated = False

    def answered(self, answer: WishAnswered) -> None:
        """The manager's answer to the request."""
        self._pending = answer.pending
        if not answer.accepted:
            self._request_until = -inf

    def answer(self, yes: bool, now: float, actions: list[Action]) -> None:
        """The operator's answer to the question."""
        question, self.question = self.question, None
        assert question is not None
        self._answered = question.requester, now
        if yes:
            self._allow(question.requester, now, actions)
        else:
            actions.append(notice("denied"))

    def _allow(self, requester: int, now: float, actions: list[Action]) -> None:
        self._allowed = requester, now + WINDOW_S
        values: dict[str, Any] = {"station": self._name(requester), "vehicle": self._vehicle()}
        actions.append(notice("control_allowed", window_s=int(WINDOW_S), **values))
        actions.append(AskManager("ALLOW", request=True, takeover=True, timeout_s=WINDOW_S))

    # ---- time -----------------------------------------------------------------------------------------------------

    def tick(self, now: float, told_at: tuple[float, ...]) -> list[Action]:
        """Time has passed. `told_at`: the operator is told the time left when it falls below these values (s)."""
        actions: list[Action] = []
        if self._rival is not None and now - self._rival_at >= LOST_S:
            self._rival = None
            actions.append(notice("one_manager", vehicle=self._vehicle(), component=self.manager))
        self._question_time(now, told_at, actions)
        if self._allowed is not None and now >= self._allowed[1]:
            requester, self._allowed = self._allowed[0], None
            values: dict[str, Any] = {
                "station": self._name(requester),
                "vehicle": self._vehicle(),
                "own": self._name(self._own),
            }
            actions.append(notice("control_not_taken", window_s=int(WINDOW_S), **values))
            actions.append(AskManager("KEEP", request=True, timeout_s=WINDOW_S))
        if -inf < self._request_until <= now:
            self._request_until = -inf
            owner, timeout_s = self._name(self.in_control), round(self._request_s)
            actions.append(notice("control_not_given", timeout_s=timeout_s, owner=owner, vehicle=self._vehicle()))
        return actions

    def _question_time(self, now: float, told_at: tuple[float, ...], actions: list[Action]) -> None:
        question = self.question
        if question is None:
            return
        left_s = question.until - now
        values: dict[str, Any] = {
            "station": self._name(question.requester),
            "vehicle": self._vehicle(),
            "own": self._name(self._own),
        }
        if left_s <= 0.0:
            self.question, self._answered = None, (question.requester, now)
            actions.append(notice("control_not_answered", **values))
            return
        due = [at for at in told_at if left_s <= at < question.told_left_s]
        if due:
            question.told_left_s = min(due)
            actions.append(notice("time_left_control", waits=True, left_s=ceil(left_s), **values))
