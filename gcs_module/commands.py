# SPDX-License-Identifier: GPL-3.0-or-later

"""The commands `handover ...` at a ground station. One table serves help, completion and dispatch."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from math import inf
from typing import Any, Final, Protocol

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.alarms import Level
from gcs_module.banner import Situation, age
from gcs_module.briefing import Briefing
from gcs_module.core import Answer, Event, Notice, StationCore, Wish, WishAnswered
from gcs_module.decisions import Decisions
from gcs_module.event_log import FlightEventLog
from gcs_module.events import AskManager
from gcs_module.mission_transfer import MissionTransfer
from gcs_module.route_watch import StationRouteWatch
from gcs_module.served_program import UNANSWERED
from gcs_module.standard_control import NOT_IN_STANDARD
from gcs_module.vehicle_addresses import VehicleAddresses
from gcs_module.vehicle_connection import VehicleConnection
from gcs_module.vehicle_state import VehicleState
from gcs_module.vehicle_texts import VehicleTexts
from gcs_module.view import View, telemetry_line, telemetry_table
from mavproxy_handover.config.station import StationConfig
from mavproxy_handover.core.common.model import Consent
from mavproxy_handover.mission.addresses import without_addresses
from mavproxy_handover.wire.conversation import Ask, Asking, Conversation, command_long
from mavproxy_handover.wire.ids import (
    AUTOPILOT_COMPID,
    COMPANION_COMPID,
    LIMITS,
    MISSION_START,
    OPERATOR_CONTROL,
    PAYLOAD_COMPIDS,
)

__all__ = ["OF_STATION", "StationCommands"]

#: Commands that replace each other: after a new one the earlier ones of its group are not repeated any more.
_MATTERS: Final = (("START", "STOP", "CONTINUE", "RESUME", "RETURN"), ("REQUEST", "RELEASE", "GIVE", "ALLOW", "KEEP"))
#: answers that may belong to earlier commands, at most: the last of three copies must be answerable
_MOST_OWED: Final = 2
#: arguments of `handover rehearse`
_REHEARSAL: Final = ("end", "report")
#: words of payload authority, and the time-out in the request, which is answered at once
_PAYLOAD: Final = ("request", "release")
_PAYLOAD_S: Final = 10.0
#: the most words of commands with more than one argument
_WORDS: Final = {"payload": 3}
#: word that ends a delegation, and the longest name of a program
_NO_PROGRAM: Final = "no"
_PROGRAM_BYTES: Final = 20
#: the request for a report, which is neither accepted nor refused
_REPORT: Final = "REPORT"

_PAUSE = mavlink.MAV_CMD_DO_PAUSE_CONTINUE
#: a second answer within this time (s) is the same key pressed twice
_PRESS_S: Final = 0.7
#: shorter than texts of the companion wait (`texts.py`)
_WHY_S = 0.4


#: the companion's names for a refused command, if they differ from the operator's
_SAID: Final = {
    "RESUME": ("AUTO", "mode AUTO"),
    "RETURN": ("RTL",),
    **{f"PAYLOAD {kind}": ("PAYLOAD",) for kind in PAYLOAD_COMPIDS},
}


#: a release in flight is meant if it is typed twice within this time (s)
_RELEASE_S: Final = 10.0


#: a command of the station and not of one aircraft (`duty_commands.py`)
OF_STATION: Final = (
    "operator NAME",
    "sign on as the operator on duty; 'operator off' signs off, 'operator' alone tells who is on duty",
)


class Host(Protocol):
    """One vehicle's part of the module, as far as the operator's commands need it."""

    config: StationConfig
    sysid: int
    of: str
    core: StationCore
    #: nothing is answered now, because the served program is silent
    mute: bool
    state: VehicleState
    connection: VehicleConnection
    mission_transfer: MissionTransfer
    route: StationRouteWatch
    decisions: Decisions
    briefing: Briefing
    texts: VehicleTexts
    view: View
    event_log: FlightEventLog
    faults: Counter[str]
    addresses: VehicleAddresses

    def handle(self, event: Event) -> None:
        """An event for the rules."""

    def situation(self) -> Situation:
        """What the station knows of the vehicle now."""


class StationCommands:
    """The operator's commands to one aircraft. A command is repeated until it is acknowledged.

    A command without an answer is not repeated after the operator's next command of the same group: its copy would undo
    that. Its late answer does not count for the new command: COMMAND_ACK names only the MAVLink command, and STOP and
    CONTINUE are the same one, as are REQUEST, RELEASE and GIVE.
    """

    def __init__(self, module: Host, settings: Any) -> None:
        """`settings`: from `fleet.our_settings`."""
        self._module = module
        self.settings = settings
        self._talks: dict[str, Conversation] = {}
        #: command and parameters that each operator's command was sent with
        self._sent: dict[str, tuple[int, tuple[float, ...]]] = {}
        #: the number of the last request about a limit or a rehearsal
        self._nonce = 0
        #: when the operator last answered a question
        self._answered_at = -inf
        #: lifted limits by name, and until when the vehicle lets commands leave them (monotonic s)
        self.overrides: dict[str, float] = {}
        #: when a release in flight was last typed, under the operator-control standard
        self._release_typed_at = -inf
        #: refused commands, and until when a text with the reason may still arrive
        self._refused: dict[str, tuple[str, float]] = {}
        self._table: dict[str, tuple[str, Callable[[], None]]] = {
            "status": ("the commander, this station's role, telemetry, links", self._status),
            "share": ("send the mission package to the vehicle and to the other stations", self._share),
            "rehearse": (
                "on the ground, disarmed: carry the aircraft through its zones, nothing arms; under way: its report",
                self._rehearse,
            ),
            "start": ("START: arm and fly the mission", lambda: self._command("START", MISSION_START)),
            "stop": ("STOP: hold where the aircraft is", lambda: self._command("STOP", _PAUSE, 0)),
            "continue": ("CONTINUE the mission", lambda: self._command("CONTINUE", _PAUSE, 1)),
            "request": ("ask for control of the aircraft", self._request),
            "release": ("give control up; in flight only to a station that can take it", self._release),
            "resume": (
                "AUTO again after a return or a landing: on with the mission where it was left",
                self._resume,
            ),
            "return": (
                "to the return site now, and land there",
                lambda: self._command("RETURN", mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH),
            ),
            "ack": ("silence the alarms that stand", module.event_log.acknowledged),
            "telemetry": ("all that the vehicle says of the aircraft", self._telemetry),
            "briefing": ("the aircraft as it was told with the last question", self._briefing),
            "accept": ("answer the question of a handover: yes", lambda: self._answer(True)),
            "deny": ("answer the question of a handover: no", lambda: self._answer(False)),
            "connect": ("the vehicle's addresses that other stations sent", self._list_addresses),
            "disconnect": (
                "close the link to an address that another station sent, and forget the address",
                self._disconnect,
            ),
        }

        #: commands with an argument: argument and help text, function
        self._named: dict[str, tuple[str, Callable[[str], None]]] = {
            "give": ("STATION: hand the aircraft to it now", self._give),
            "override": ("energy|fence|coverage: let commands leave this limit for a minute", self._override),
            "delegate": (
                "PROGRAM|no: let an onboard program lead the aircraft in GUIDED, or take that back",
                self._delegate,
            ),
            "payload": (
                "request|release [gimbal|camera|winch]: have all of the payload or this part of it, where the mission "
                "or the vehicle's file allows that",
                self._payload,
            ),
            "rehearse": ("end|report: of the rehearsal", self._of_rehearsal),
            "connect": (
                "NUMBER|no: open a link to the vehicle's address of this question, or refuse all",
                self._connect,
            ),
            "take": ("MISSION: make a mission that another station has offered this station's own", self._accept_offer),
        }

    def takes(self, args: list[str]) -> bool:
        """Whether these words are a command for one aircraft."""
        return args[:1] != [] and (args[0] in self._table or args[0] in self._named)

    def completions(self) -> list[str]:
        """For MAVProxy's tab completion."""
        peers = "|".join(peer.station.name for peer in self._module.config.peers)
        limits = "|".join(LIMITS.values())
        return [
            "<" + "|".join(self._table) + ">",
            f"give <{peers}>",
            f"override <{limits}>",
            "delegate <no>",
            f"payload <{'|'.join(_PAYLOAD)}> <{'|'.join(PAYLOAD_COMPIDS)}>",
            f"rehearse <{'|'.join(_REHEARSAL)}>",
            "connect <no>",
            "take",
            "set (HANDOVERSETTING)",
        ]

    def listed(self) -> list[tuple[str, str]]:
        """The commands, and what each does."""
        named = [
            (f"{name} {text.partition(': ')[0]}", text.partition(": ")[2]) for name, (text, _) in self._named.items()
        ]
        return [*((name, text) for name, (text, _run) in self._table.items()), *named, OF_STATION]

    def run(self, args: list[str]) -> None:
        """Run one command line; anything unknown shows the usage."""
        if args and args[0] == "set":
            self.settings.command(args[1:])
            return
        if args and self._module.core.control.in_use and args[0] in NOT_IN_STANDARD:
            self._not_in_standard(args[0])
            return
        if len(args) == 1 and args[0] in self._table:
            self._table[args[0]][1]()
            return
        if args and args[0] in self._named and 2 <= len(args) <= _WORDS.get(args[0], 2):
            self._named[args[0]][1](" ".join(args[1:]))
            return
        show = self._module.view.show
        if args and args[0] in self._named:
            show(f"usage: handover {args[0]} {self._named[args[0]][0]}")
            return
        if args and args[0] != "help":
            show(f"handover: unknown command {' '.join(args)!r}")
        words = [*self._table, *(name for name in self._named if name not in self._table), "operator", "set"]
        show("usage: handover <" + "|".join(words) + ">")
        for name, (text, _run) in self._table.items():
            show(f"  {name:9} {text}")
        for name, (text, _named) in self._named.items():
            show(f"  {name:9} {text}")
        show("  {:9} {}: {}".format(*OF_STATION[0].split(), OF_STATION[1]))
        show(
            "  set       NAME VALUE: "
            + ", ".join(f"{name} = {self.settings.get(name)}" for name in self.settings.list())
        )

    def _not_in_standard(self, word: str) -> None:
        component = self._module.core.control.manager
        self._module.view.show(
            f"handover {word}: the MAVLink standard has no such command, and component {component} of "
            f"{self._module.core.vehicle_name} speaks only the standard. {NOT_IN_STANDARD[word]}"
        )

    # ---- commands to the aircraft ---------------------------------------------------------------------------------

    def _command(self, word: str, command: int, *parameters: float) -> None:
        now = time.monotonic()
        owed = self._replace(word, (command, parameters))
        self._sent[word] = command, parameters
        self._talks[word] = Conversation(self._asking(command, parameters, owed), self._module.connection.send, now)
        self._module.event_log.command_sent(word)

    def _replace(self, word: str, sent: tuple[int, tuple[float, ...]]) -> int:
        """End the commands of the same group that wait for an answer.

        Returns how many answers to this MAVLink command may belong to them.
        """
        owed = 0
        for before in next((matter for matter in _MATTERS if word in matter), ()):
            talk = self._talks.get(before)
            if talk is None or not talk.copies or self._sent[before] == sent:
                continue
            if self._sent[before][0] == sent[0]:
                owed += talk.copies
            del self._talks[before]
            text = f"{before} was not answered: {word} takes its place."
            self._module.event_log.command_ended(before, "replaced", text)
        return min(owed, _MOST_OWED)

    def _asking(self, command: int, parameters: tuple[float, ...], owed: int) -> Asking:
        control = self._module.core.control
        standard = command == OPERATOR_CONTROL and control.in_use
        manager = control.manager if standard and control.manager is not None else COMPANION_COMPID
        component = manager if command == OPERATOR_CONTROL else AUTOPILOT_COMPID
        message = command_long((self._module.sysid, component), command, *parameters)
        own = self._module.config.station.sysid
        sender = component if standard else 0
        answer = _ack(command, own, owed=owed, sender=sender)
        result = yield Ask("the command", (message,), answer, timeout_s=1.5, tries=3)
        if standard and result == mavlink.MAV_RESULT_IN_PROGRESS:
            return mavlink.MAV_RESULT_FAILED  # the manager asks the owner; CONTROL_STATUS tells the end
        if result == mavlink.MAV_RESULT_IN_PROGRESS:
            result = yield Ask("the end of the command", (), _ack(command, own, final=True), timeout_s=60.0, tries=1)
        return result

    def _answer(self, yes: bool) -> None:
        """The operator's answer. A key pressed twice answers one question, not one that has just replaced it."""
        core, now = self._module.core, time.monotonic()
        if self._module.mute:
            self._module.view.line(f"Answer not used: {UNANSWERED}")
            return
        asked = core.open_question is not None
        if asked and now - self._answered_at < _PRESS_S:
            self._module.view.line("Answer not used: a new question came first. Read it, then answer.")
            return
        if asked:
            self._answered_at = now
        self._module.handle(Answer(yes))

    def _resume(self) -> None:
        """The vehicle checks it as any AUTO of its commander: leg, fence, coverage, energy."""
        if self._module.decisions.text:
            self._module.view.line(f"RESUME not sent: {self._module.decisions.text}", Level.ADVISORY)
            return
        custom = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
        self._command("RESUME", mavlink.MAV_CMD_DO_SET_MODE, custom, float(self._module.route.auto))

    def _request(self) -> None:
        """The commander is asked. COMMAND_ACK tells that; AUTHORITY_STATUS tells which station commands."""
        own = self._module.config.station.sysid
        self._module.handle(Wish(own, self.settings.request_timeout))
        self._command("REQUEST", OPERATOR_CONTROL, 1, 0, self.settings.request_timeout, own)

    def ask_manager(self, action: AskManager) -> None:
        """Send the standard's command to the manager."""
        own = self._module.config.station.sysid
        request, takeover = float(action.request), float(action.takeover)
        self._command(action.word, OPERATOR_CONTROL, request, takeover, action.timeout_s, own)

    def _release(self) -> None:
        own, now = self._module.config.station.sysid, time.monotonic()
        if self._module.core.control.in_use and self._module.state.flown_from_here:
            if now - self._release_typed_at > _RELEASE_S:
                self._release_typed_at = now
                self._module.view.line(
                    f"{self._module.core.vehicle_name} flies. After a release no station is in control, and its own "
                    "failsafe decides. To release it, type 'handover release' again within 10 s.",
                    Level.ADVISORY,
                )
                return
            self._release_typed_at = -inf
        self._module.handle(WishAnswered(own, False))  # withdraws an earlier request
        self._command("RELEASE", OPERATOR_CONTROL, 0, 0, 0, own)

    def _give(self, name: str) -> None:
        for peer in self._module.config.peers:
            if peer.station.name == name:
                self._module.handle(WishAnswered(self._module.config.station.sysid, False))
                self._module.handle(Wish(peer.station.sysid))
                self._command("GIVE", OPERATOR_CONTROL, 1, 0, self.settings.request_timeout, peer.station.sysid)
                return
        known = ", ".join(peer.station.name for peer in self._module.config.peers) or "none"
        self._module.view.show(f"handover give: no station {name!r}; the stations are {known}")

    def _override(self, limit: str) -> None:
        """Only the commander may override; the vehicle answers for how long."""
        number = next((number for number, name in LIMITS.items() if name == limit), None)
        if number is None:
            self._module.view.show(f"handover override: no limit {limit!r}; there are {', '.join(LIMITS.values())}")
            return
        now = time.monotonic()
        word = f"OVERRIDE {limit}"
        asking = _override_asking(self._module.sysid, number, self._next_nonce(now))
        self._talks[word] = Conversation(asking, self._module.connection.send, now)
        self._module.event_log.command_sent(word)

    def _delegate(self, program: str) -> None:
        """Only the commander may delegate guided targets; the vehicle answers whether it does."""
        now, ends = time.monotonic(), program == _NO_PROGRAM
        if len(program) > _PROGRAM_BYTES or not program.isascii():
            self._module.view.show(
                f"handover delegate: no program {program!r}; a name has 1 to {_PROGRAM_BYTES} letters"
            )
            return
        word = "DELEGATE END" if ends else f"DELEGATE {program}"
        wish = mavlink.HANDOVER_DELEGATION_WISH_END if ends else mavlink.HANDOVER_DELEGATION_WISH_BEGIN
        asking = _delegate_asking(self._module.sysid, wish, "" if ends else program, self._next_nonce(now))
        self._talks[word] = Conversation(asking, self._module.connection.send, now)
        self._module.event_log.command_sent(word)

    def _payload(self, words: str) -> None:
        """Payload authority: the standard's command, to the component of each kind."""
        word, _, kind = words.partition(" ")
        kinds = (kind,) if kind else tuple(PAYLOAD_COMPIDS)
        for given, allowed in ((word, _PAYLOAD), (kinds[0], tuple(PAYLOAD_COMPIDS))):
            if given not in allowed:
                self._module.view.show(f"handover payload: no {given!r}; there are {', '.join(allowed)}")
                return
        own, now = self._module.config.station.sysid, time.monotonic()
        for each in kinds:
            asking = _payload_asking(self._module.sysid, own, PAYLOAD_COMPIDS[each], request=word == _PAYLOAD[0])
            said = f"PAYLOAD {each}"
            self._talks[said] = Conversation(asking, self._module.connection.send, now)
            self._module.event_log.command_sent(said)

    def _next_nonce(self, now: float) -> int:
        """The number of a request: a new one each time, also within one step of a coarse clock."""
        self._nonce = max(self._nonce + 1, int(now * 1e6))
        return self._nonce & 0xFFFFFFFF

    def _rehearse(self) -> None:
        """Only the commander may begin a rehearsal; while one is under way, the command shows its report."""
        if self._module.state.rehearsal:
            self.rehearsal_report()
        else:
            self._ask_rehearsal("REHEARSE", mavlink.HANDOVER_REHEARSAL_WISH_BEGIN)

    def _of_rehearsal(self, word: str) -> None:
        if word == "end":
            self._ask_rehearsal("REHEARSE END", mavlink.HANDOVER_REHEARSAL_WISH_END)
        elif word == "report":
            self.rehearsal_report()
        else:
            self._module.view.show(f"handover rehearse: no {word!r}; there are {', '.join(_REHEARSAL)}")

    def rehearsal_report(self) -> None:
        """Ask for the report of the present or the last rehearsal; it is shown when all its lines have arrived."""
        self._ask_rehearsal(_REPORT, mavlink.HANDOVER_REHEARSAL_WISH_REPORT)

    def _ask_rehearsal(self, word: str, wish: int) -> None:
        now = time.monotonic()
        asking = _rehearsal_asking(self._module.sysid, wish, self._next_nonce(now))
        self._talks[word] = Conversation(asking, self._module.connection.send, now)
        if word != _REPORT:
            self._module.event_log.command_sent(word)

    def on_message(self, message: Any, now: float) -> None:
        """A COMMAND_ACK or heartbeat of the autopilot, or the vehicle's HANDOVER_OVERRIDE or HANDOVER_REHEARSAL."""
        if message.get_type() == "HANDOVER_OVERRIDE" and message.limit in LIMITS:
            self.overrides[LIMITS[message.limit]] = now + message.seconds
        for talk in list(self._talks.values()):
            talk.on_message(message, now)

    def tick(self, now: float) -> None:
        """Time has passed: repeats commands without an answer, and tells the outcome of those with one."""
        for word, talk in list(self._talks.items()):
            talk.tick(now)
            if talk.finished:
                del self._talks[word]
                self._ended(word, talk, now)
        for word, (outcome, until) in list(self._refused.items()):
            beginnings = [*(f"{said} refused: " for said in _SAID.get(word, (word,))), "Control denied: "]
            why = next((text for text in map(self._module.texts.pop, beginnings) if text), "")
            if why or now >= until:
                del self._refused[word]
                text = f"{word} refused: {why.partition(': ')[2] or outcome.replace('_', ' ')}"
                self._module.event_log.command_ended(word, outcome, f"{text.rstrip('.')}.{self._hint(word)}")

    def _ended(self, word: str, talk: Conversation, now: float) -> None:
        event_log = self._module.event_log
        if word == "REQUEST":
            accepted = talk.failure is None and talk.result in (
                mavlink.MAV_RESULT_ACCEPTED,
                mavlink.MAV_RESULT_FAILED,  # the vehicle asks the commander
            )
            pending = accepted and talk.result == mavlink.MAV_RESULT_FAILED
            self._module.handle(WishAnswered(self._module.config.station.sysid, accepted, pending))
        if word == _REPORT:
            for line in talk.result or ("no report of the rehearsal: no answer of the vehicle",):
                self._module.view.show(line)
        elif talk.failure is not None:
            event_log.command_ended(word, "no answer", f"{word}: no answer of the vehicle.")
        elif talk.result == mavlink.MAV_RESULT_ACCEPTED:
            event_log.command_ended(word, "accepted", f"{word} accepted.")
        elif word in ("REQUEST", "GIVE") and talk.result == mavlink.MAV_RESULT_FAILED:
            event_log.command_ended(word, "pending", f"{word}: the commander is being asked.")
        else:  # a text with the reason comes before or after the answer
            self._refused[word] = _result_name(talk.result), now + _WHY_S

    def _hint(self, word: str) -> str:
        """The command that resumes the mission if STOP and CONTINUE cannot."""
        mode = self._module.situation().mode
        if word in ("STOP", "CONTINUE") and mode not in ("", "AUTO"):
            return f" The aircraft is in {mode}: 'handover resume' brings it back to its mission."
        return ""

    # ---- others ---------------------------------------------------------------------------------------------------

    def _share(self) -> None:
        module = self._module
        if module.mission_transfer.held is None:
            where = "its [[vehicle]]" if module.of else "[station]"
            module.view.line(f"There is no mission to share: set mission in {where}.")
            return
        now = time.monotonic()
        module.mission_transfer.offer(module.sysid, COMPANION_COMPID, now, until_loaded=True)
        for peer in module.config.peers:
            module.mission_transfer.offer(peer.station.sysid, 0, now)
        module.view.line(f"Sharing mission {module.mission_transfer.held.name!r}.")
        if module.mission_transfer.held.addresses_fault:
            module.view.line(without_addresses(module.mission_transfer.held.addresses_fault))

    def _telemetry(self) -> None:
        module, telemetry = self._module, self._module.view.last_telemetry
        if telemetry is None:
            module.view.show("telemetry none yet: the vehicle sends it to who commands, and to a partner")
            return
        old = module.view.telemetry_age(time.monotonic())
        if old:
            module.view.show(f"telemetry{old}")
        if module.of:
            module.view.show(f"vehicle   {module.of}")
        zone = module.core.zone_name(telemetry.zone, telemetry.other_zone)
        for row in telemetry_table(telemetry, zone, module.situation().mode):
            module.view.show(row)

    def _briefing(self) -> None:
        """Show the last briefing, of any age."""
        module, briefing = self._module, self._module.briefing
        if not briefing.lines:
            module.view.show(
                "briefing  none yet: it comes with the question whether this station will take the aircraft"
            )
            return
        old = age(time.monotonic() - briefing.at)
        for line in (*((f"briefing  {old}",) if old else ()), *briefing.lines):
            module.view.show(line)

    def _accept_offer(self, name: str) -> None:
        self._module.view.line(self._module.mission_transfer.inbox.accept_offer(name, self._module.state.disarmed))

    def _list_addresses(self) -> None:
        lines = [*self._module.addresses.status()]
        self._module.addresses.asked_for()
        for line in lines or ["no station has sent an address of the vehicle"]:
            self._module.view.show(f"address   {line}")

    def _connect(self, word: str) -> None:
        self._tell_address(self._module.addresses.connect(word, self._module.state.armed(time.monotonic())))

    def _disconnect(self) -> None:
        self._tell_address(self._module.addresses.disconnect(self._module.state.armed(time.monotonic())))

    def _tell_address(self, line: str) -> None:
        self._module.event_log.notice(Notice("address", line), time.monotonic())

    def _status(self) -> None:
        module, core, now = self._module, self._module.core, time.monotonic()
        show = module.view.show
        name = f"{module.of}: " if module.of else ""
        show(f"vehicle   {name}{'connected' if core.vehicle_alive(now) else 'not heard'}, {core.phase.name}")
        if module.state.rehearsal:
            show("rehearsal the aircraft is carried: nothing arms ('handover rehearse' for its report)")
        show(f"commander {core.name(core.commander)}, epoch {core.epoch}; this station is {core.role.value}")
        if module.decisions.text:
            show(f"decision  {module.decisions.text}")
        for alarm in module.event_log.alarms.standing:
            show(f"alarm     {alarm.level.name}: {alarm.text}{' (acknowledged)' if alarm.acknowledged else ''}")
        if core.control.in_use:
            show(f"control   component {core.control.manager} manages it, by the MAVLink standard")
        for kind, station, at in module.state.payload:
            show(f"payload   {kind}: {station}{_old(now - at)}")
        if core.question is not None:
            show(f"question  handover {core.question.handover_id}: 'handover accept' or 'handover deny'")
        elif core.control.question is not None:
            asks = core.name(core.control.question.requester)
            show(f"question  {asks} asks for control: 'handover accept' or 'handover deny'")
        ahead = core.ahead
        if ahead is not None:
            said = {Consent.GRANTED: "accepted", Consent.DENIED: "denied", Consent.WAITING: "to be answered"}
            pair = f"{core.name(ahead.key.from_station)} -> {core.name(ahead.key.to_station)}"
            show(f"ahead     {pair} in {max(0.0, ahead.at - now):.0f} s, {said[ahead.consent]}")
        held = module.mission_transfer.held
        same = (
            "the vehicle has the same" if core.digest and core.digest == core.vehicle_digest else "the vehicle has not"
        )
        show(f"mission   {'none' if held is None else f'{held.name!r} {held.digest.hex()[:8]}, {same}'}")
        route = module.route.words(now)
        if route:
            show(f"route     {route}")
        for offer in module.mission_transfer.inbox.waiting:
            show(f"offered   {offer.name!r} {offer.digest.hex()[:8]}: 'handover take {offer.name}'")
        for line in module.addresses.status():
            show(f"address   {line}")
        for peer in module.config.peers:
            alive = "up" if core.peer_alive(peer.station.sysid, now) else "down"
            show(f"ground    {peer.station.name}: {alive}")
        telemetry = module.view.last_telemetry
        if telemetry is not None:
            zone = core.zone_name(telemetry.zone, telemetry.other_zone)
            show(f"telemetry {telemetry_line(telemetry, zone)}{module.view.telemetry_age(now)}")
        if module.faults:
            show("faults    " + ", ".join(f"{where} {count}" for where, count in module.faults.items()))


def _override_asking(vehicle: int, limit: int, nonce: int) -> Asking:
    message = mavlink.MAVLink_handover_override_message(vehicle, COMPANION_COMPID, vehicle, limit, nonce, 0)

    def answer(m: Any) -> Any:
        ours = m.get_type() == "HANDOVER_OVERRIDE" and m.nonce == nonce and m.limit == limit
        return m.seconds if ours else None

    seconds = yield Ask("the override", (message,), answer, timeout_s=1.0, tries=5)
    return mavlink.MAV_RESULT_ACCEPTED if seconds else mavlink.MAV_RESULT_DENIED


def _delegate_asking(vehicle: int, wish: int, program: str, nonce: int) -> Asking:
    message = mavlink.MAVLink_handover_delegate_message(
        vehicle, COMPANION_COMPID, vehicle, wish, nonce, 0, program.encode("ascii")
    )

    def answer(m: Any) -> Any:
        return m.accepted if m.get_type() == "HANDOVER_DELEGATE" and m.nonce == nonce else None

    accepted = yield Ask("the delegation", (message,), answer, timeout_s=1.0, tries=5)
    return mavlink.MAV_RESULT_ACCEPTED if accepted else mavlink.MAV_RESULT_DENIED


def _old(seconds: float) -> str:
    """The age of a value after it; "" if it is fresh."""
    return f" ({age(seconds)})" if age(seconds) else ""


def _payload_asking(vehicle: int, own: int, component: int, *, request: bool) -> Asking:
    message = command_long((vehicle, component), OPERATOR_CONTROL, float(request), 0, _PAYLOAD_S, own)
    answer = _ack(OPERATOR_CONTROL, own, sender=component)
    return (yield Ask("payload authority", (message,), answer, timeout_s=1.0, tries=5))


def _rehearsal_asking(vehicle: int, wish: int, nonce: int) -> Asking:
    """Returns a result, or the lines of the report."""
    message = mavlink.MAVLink_handover_rehearse_message(vehicle, COMPANION_COMPID, vehicle, wish, nonce)
    lines: dict[int, str] = {}

    def answer(m: Any) -> Any:
        if m.get_type() != "HANDOVER_REHEARSAL" or m.nonce != nonce or m.wish != wish:
            return None
        if not m.line:
            return mavlink.MAV_RESULT_ACCEPTED if m.accepted else mavlink.MAV_RESULT_DENIED
        lines[m.line] = m.text
        whole = len(lines) == m.lines and all(number in lines for number in range(1, m.lines + 1))
        return tuple(lines[number] for number in sorted(lines)) if whole else None

    return (yield Ask("the rehearsal", (message,), answer, timeout_s=1.0, tries=5))


def _ack(command: int, own: int, *, final: bool = False, owed: int = 0, sender: int = 0) -> Callable[[Any], Any]:
    """A filter for the COMMAND_ACK of a command. `own`: this station; `owed`: this many answers may belong to earlier
    commands; `sender`: the component that answers, 0: any."""
    left = owed

    def answer(m: Any) -> Any:
        nonlocal left
        if m.get_type() != "COMMAND_ACK" or m.command != command or getattr(m, "target_system", 0) not in (0, own):
            return None
        if sender and m.get_srcComponent() != sender:
            return None
        if final and m.result == mavlink.MAV_RESULT_IN_PROGRESS:
            return None
        if left:
            left -= 1
            return None
        return m.result

    return answer


def _result_name(result: int) -> str:
    names = mavlink.enums["MAV_RESULT"]
    return names[result].name.removeprefix("MAV_RESULT_").lower() if result in names else str(result)
