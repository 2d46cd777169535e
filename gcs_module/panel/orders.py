# SPDX-License-Identifier: GPL-3.0-or-later

"""Orders of the operator's panel: read from plain values, and carried out by the commands of the terminal.

Rules that live here
--------------------
* An answer names its question. If that question is over, or another one has taken its place, nothing is done and the
  panel gets that as its answer. So a press that was meant for one question never answers the next.
* All other orders are sent to the vehicle, which judges them. The outcome is a line, as for a typed command.
* Sign-on and the confirmation of a shift change are two orders: a second press on the first does not confirm.
* An order that cannot be read is answered with one line, and does nothing.

Pure, but for the commands themselves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

from gcs_module.core import StationCore
from gcs_module.duty import NEEDS_OPERATOR, OFF, Change, Outcome
from gcs_module.panel.question_number import border_number, number_of
from gcs_module.served_program import UNANSWERED
from gcs_module.standard_control import NOT_IN_STANDARD
from mavproxy_handover.core.common.model import Consent
from mavproxy_handover.wire.ids import LIMITS

__all__ = ["ORDERS", "Ordered", "Order", "OrderError", "Reply", "carry_out", "read_order"]


class OrderError(ValueError):
    """An order that cannot be used. The message is one line for the operator."""


@dataclass(frozen=True, slots=True)
class _Kind:
    """An order: its typed command, and what its argument is: "", "question", "station", "limit" or "name".

    `whole`: it is about the station, and not about one aircraft.
    """

    words: str
    argument: str = ""
    whole: bool = False


#: the panel's word -> the typed command
ORDERS: Final[Mapping[str, _Kind]] = {
    "accept": _Kind("accept", "question"),
    "deny": _Kind("deny", "question"),
    "request": _Kind("request"),
    "give": _Kind("give", "station"),
    "release": _Kind("release"),
    "stop": _Kind("stop"),
    "continue": _Kind("continue"),
    "resume": _Kind("resume"),
    "return": _Kind("return"),
    "override": _Kind("override", "limit"),
    "acknowledge": _Kind("ack"),
    "start": _Kind("start"),
    "share": _Kind("share"),
    "sign_on": _Kind("operator", "name", whole=True),
    "confirm": _Kind("operator", "name", whole=True),
    "sign_off": _Kind("operator", whole=True),
}
_MOST_LETTERS: Final = 80


@dataclass(frozen=True, slots=True)
class Order:
    """One order. `number`: the panel's, which its reply repeats; `vehicle`: system id, 0 for the station itself."""

    number: int
    do: str
    vehicle: int
    argument: str = ""


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to an order. `used`: the order has an effect here, or the vehicle got it."""

    number: int
    used: bool
    text: str

    def values(self) -> dict[str, Any]:
        """As plain values."""
        return {"kind": "reply", "number": self.number, "used": self.used, "text": self.text}


class Commands(Protocol):
    """The operator's commands to one aircraft."""

    def run(self, args: list[str]) -> None:
        """Run one command line."""


class OnDuty(Protocol):
    """The operators of the station."""

    @property
    def name(self) -> str:
        """The operator on duty; "" if none is."""

    def next_name(self) -> str:
        """The next operator, who has to confirm the briefing; "" if there is none."""

    def run(self, args: Sequence[str]) -> Outcome:
        """The command `handover operator ...`."""


class Ordered(Protocol):
    """One aircraft at the station."""

    sysid: int
    core: StationCore
    #: nothing is answered now, because the served program is silent
    mute: bool

    @property
    def commands(self) -> Commands:
        """The operator's commands to it."""


def read_order(values: Mapping[str, Any]) -> Order:
    """The order in the values of a line. Raises OrderError."""
    number, do, vehicle = values.get("number"), values.get("do"), values.get("vehicle")
    argument = values.get("argument", "")
    if not isinstance(number, int) or not isinstance(vehicle, int) or bool in (type(number), type(vehicle)):
        raise OrderError("an order needs the whole numbers 'number' and 'vehicle'")
    if not isinstance(do, str) or do not in ORDERS:
        raise OrderError(f"no order {str(do)[:_MOST_LETTERS]!r}; there are {', '.join(ORDERS)}")
    if not isinstance(argument, str) or len(argument) > _MOST_LETTERS or not argument.isprintable():
        raise OrderError(f"{do}: 'argument' must be a text of at most {_MOST_LETTERS} letters")
    wanted = ORDERS[do].argument
    if bool(wanted) != bool(argument):
        raise OrderError(f"{do}: needs a {wanted}" if wanted else f"{do}: takes no argument")
    if wanted == "limit" and argument not in LIMITS.values():
        raise OrderError(f"{do}: no limit {argument!r}; there are {', '.join(LIMITS.values())}")
    return Order(number, do, vehicle, argument)


def carry_out(order: Order, aircraft: Sequence[Ordered], stations: Sequence[str], duty: OnDuty) -> Reply:
    """Carry out an order. `stations`: names of the stations that can get an aircraft."""
    target = next((each for each in aircraft if each.sysid == order.vehicle), None)
    kind = ORDERS[order.do]
    if kind.whole:
        return _of_duty(order, duty)
    if target is None:
        return Reply(order.number, False, f"Not used: this station has no vehicle {order.vehicle}.")
    if not target.core.manned and kind.words in NEEDS_OPERATOR:
        text = "Not used: no operator is on duty. Sign on first."
        return Reply(order.number, False, text)
    if target.core.control.in_use and kind.words in NOT_IN_STANDARD:
        text = f"Not used: the MAVLink standard has no such command. {NOT_IN_STANDARD[kind.words]}"
        return Reply(order.number, False, text)
    if kind.argument == "station" and order.argument not in stations:
        known = ", ".join(stations) or "none"
        return Reply(order.number, False, f"Not used: no station {order.argument!r}; there are {known}.")
    if kind.argument == "question":
        return _answer(order, target)
    target.commands.run([kind.words, *([order.argument] if kind.argument else [])])
    return Reply(order.number, True, f"{order.do.capitalize()} {order.argument}".rstrip() + ".")


def _of_duty(order: Order, duty: OnDuty) -> Reply:
    """Sign-on, sign-off, and the change of shift. Only `confirm` confirms: a second press on `sign_on` does not."""
    name = " ".join(order.argument.split())
    if order.do == "sign_off":
        return _told(order, duty.run([OFF]))
    if order.do == "confirm":
        if not name or duty.next_name() != name:
            return Reply(order.number, False, "Not used: the time to confirm is over. Sign on again.")
        return _told(order, duty.run([name]))
    if name == OFF:
        return Reply(order.number, False, f"Not used: {OFF!r} is no name.")
    if name == duty.name and duty.next_name():  # the change of shift is cancelled
        return Reply(order.number, True, duty.run([name]).text)
    if name and duty.next_name() == name:
        return Reply(order.number, True, "Read the briefing, then confirm it.")
    return _told(order, duty.run([name]))


def _told(order: Order, outcome: Outcome) -> Reply:
    if outcome.change is Change.BRIEFED:
        text = f"Read the briefing, then confirm it. {outcome.before} is on duty until then."
        return Reply(order.number, True, text)
    return Reply(order.number, outcome.change is not Change.TOLD, outcome.text)


def _answer(order: Order, target: Ordered) -> Reply:
    """An answer to a question, or the change of an early answer."""
    yes, core = order.do == "accept", target.core
    if target.mute:
        return Reply(order.number, False, f"Not used: {UNANSWERED}")
    over = Reply(order.number, False, "Not used: that question is over.")
    asked = number_of(core.open_question)
    if asked and asked != order.argument:
        text = "Not used: another question has taken its place. Read it, then answer."
        return Reply(order.number, False, text)
    if not asked and border_number(core.ahead) != order.argument:
        return over
    target.commands.run([ORDERS[order.do].words])
    if number_of(core.open_question) == order.argument:
        return Reply(order.number, False, "Not used: the question is new. Read it, then answer again.")
    wanted = Consent.GRANTED if yes else Consent.DENIED
    if not asked and (core.ahead is None or core.ahead.consent is not wanted):
        return over
    return Reply(order.number, True, "Accepted." if yes else "Denied.")
