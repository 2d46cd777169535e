# SPDX-License-Identifier: GPL-3.0-or-later

"""The table of the sentences that a station's rules tell its operator, with meaning and action of each.

`docs/reference/messages.md` is made from it. A rule names a row and its values: `notice("vehicle_lost", vehicle=...)`.
Pure, as `core` is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from gcs_module.alarms import EVENTS, Level
from gcs_module.events import Notice

__all__ = ["NOTICES", "QUESTION", "Row", "notice"]

#: the end of a sentence that asks the operator
QUESTION: Final = " Type 'handover accept' or 'handover deny'."


@dataclass(frozen=True, slots=True)
class Row:
    """One sentence. `event`: a key of `alarms.EVENTS`; `level`: instead of that event's, None: the event's."""

    event: str
    template: str
    meaning: str
    action: str
    level: Level | None = None

    @property
    def gravity(self) -> Level:
        """The level of the line."""
        return EVENTS[self.event] if self.level is None else self.level


_NOTHING: Final = "Nothing."

#: id -> row, in the order of a flight
NOTICES: Final[Mapping[str, Row]] = {
    "vehicle_found": Row(
        "connected", "{vehicle} is connected.",
        "The station receives the heartbeat of the companion.", _NOTHING),
    "vehicle_lost": Row(
        "lost", "{vehicle} is not heard any more.",
        "The station has received no heartbeat of the companion for 5 s. What it shows of the aircraft is old.",
        "Check link and antenna. The aircraft acts by itself if its commander is lost."),
    "other_name": Row(
        "named",
        "The vehicle calls itself {calls_itself!r}, this station's file {configured!r}. "
        "Check that it is the right one.",
        "The vehicle has another name than the station's file gives it.",
        "Check that it is the right aircraft. Correct the name in the file."),
    "peer_up": Row(
        "peer", "Ground link to {station} is up.",
        "The two stations hear each other directly.", _NOTHING),
    "peer_down": Row(
        "peer_lost", "Ground link to {station} is down.",
        "The other station has not been heard for 3 s. A handover still works by the vehicle.",
        "Check the network between the stations."),
    "program_awaited": Row(
        "program", "The served program is not heard yet ({link}). Start it: until then the vehicle does not count "
        "this station as present.",
        "Another program flies through this station, and it has not been heard yet.",
        "Start QGroundControl, Mission Planner or the other program.", Level.ADVISORY),
    "program_heard": Row(
        "program", "The served program is heard ({link}). It flies through this station.",
        "The served program sends heartbeats, and they count as this station's.", _NOTHING, Level.ADVISORY),
    "program_silent": Row(
        "program_lost",
        "The served program is silent for {silent_s:g} s ({link}). After {lost_s:g} s the vehicle counts this station "
        "as lost. Look at the program, or start it again.",
        "The served program has sent no heartbeat. If this station commands, the vehicle acts by itself then.",
        "Start the program again, or hand the aircraft over."),
    "commands": Row(
        "authority", "{station} commands, epoch {epoch}.",
        "The vehicle names its commander.", _NOTHING),
    "gained": Row(
        "control_gained", "I have {vehicle}: {station} is the commander now, epoch {epoch}.",
        "This station has authority.", "Fly the aircraft."),
    "gained_forced": Row(
        "control_gained",
        "I have {vehicle}: {station} is the commander now, epoch {epoch}. Its commander was lost. "
        "'handover give STATION' or 'handover release' passes it on.",
        "This station has authority after a forced handover. Its operator was not asked.",
        "Fly the aircraft, or pass it on with one of the two commands.", Level.WARNING),
    "passed_on": Row(
        "control_lost", "{station} has {vehicle}: {station} commands now, epoch {epoch}.",
        "Another station has authority. Commands of this one are refused.", _NOTHING),
    "no_commander_now": Row(
        "control_lost", "No station commands now, epoch {epoch}.",
        "This station has lost authority, and no other station has it.",
        "'handover request', if the aircraft is in your zone."),
    "no_commander": Row(
        "no_commander",
        "No station commands {vehicle}. When it is in your zone, type 'handover request' to take over.",
        "The commander is lost or has released the aircraft in flight. By default it comes home.",
        "'handover request', if the aircraft is in your zone. Else watch it."),
    "in_gap": Row(
        "authority", "No station commands {vehicle}: it crosses a gap that its mission declares.",
        "The mission declares a gap in coverage here. The aircraft flies on alone.",
        "Wait until it comes out of the gap."),
    "manager_found": Row(
        "connected",
        "{vehicle} is connected. Component {component} manages control, by the MAVLink standard. "
        "Zones and borders are not known here.",
        "The vehicle has another manager of control than our companion. The station uses the standard's messages.",
        "'handover request' asks for control. Ask the other stations where their coverage ends."),
    "manager_silent": Row(
        "lost", "The manager of control of {vehicle} is not heard any more. Which station commands is not known.",
        "No CONTROL_STATUS of the manager has come for 5 s. What is shown of control is old.",
        "Check the link. Talk to the other stations before you command."),
    "manager_heard": Row(
        "connected", "The manager of control of {vehicle} is heard again.",
        "CONTROL_STATUS comes again.", _NOTHING),
    "manager_moved": Row(
        "manager", "Component {new} manages control of {vehicle} now, in place of {old}.",
        "The former manager is not heard any more, and another component claims its role.",
        "Check that this was intended."),
    "managers": Row(
        "managers",
        "Components {one} and {other} of {vehicle} both claim to manage control. This station believes {one}.",
        "Exactly one component may be the system manager. With two, stations may disagree about who commands.",
        "Land, or switch one of them off. Talk to the other stations."),
    "one_manager": Row(
        "manager", "Only component {component} manages control of {vehicle} again.",
        "The second component does not claim to be the manager any more.", _NOTHING),
    "control_here": Row(
        "control_gained", "I have {vehicle}: {station} is in control now.",
        "The manager of control names this station.", "Fly the aircraft."),
    "control_passed_on": Row(
        "control_lost", "{station} has {vehicle}: {station} is in control now.",
        "The manager of control names another station. Commands of this one are refused.", _NOTHING),
    "control_there": Row(
        "authority", "{station} is in control of {vehicle}.",
        "The manager of control names another station.", _NOTHING),
    "control_free": Row(
        "authority", "No station is in control of {vehicle}.",
        "The manager of control names no station.", "'handover request' asks for control."),
    "control_free_in_flight": Row(
        "no_commander", "No station is in control of {vehicle}. Type 'handover request' to take over.",
        "The aircraft flies, and the manager of control names no station. Its own failsafe decides what it does.",
        "'handover request', if you can fly it. Else watch it."),
    "control_asked": Row(
        "asked", "{station} asks for control of {vehicle}.",
        "The manager passes on another station's request. Without an answer this station keeps the aircraft.",
        "Accept or deny. An accept lets that station take the aircraft for 10 s."),
    "control_asked_automatic": Row(
        "told", "{station} asks for control of {vehicle}. This station agrees, as configured.",
        "The manager passes on another station's request, and the configuration agrees to it.", _NOTHING),
    "control_asked_too": Row(
        "told", "{station} asks for control of {vehicle}, too. Answer {other} first.",
        "A second request has come while a question is open. That station has to ask again.",
        "Answer the open question."),
    "control_allowed": Row(
        "consent", "{station} may take {vehicle} for {window_s} s.",
        "Takeover is allowed. The manager grants the next request without a question.", _NOTHING),
    "control_not_taken": Row(
        "aborted", "{station} has not taken {vehicle} within {window_s} s. {own} keeps it.",
        "The other station did not repeat its request in time. Takeover is forbidden again.",
        "Talk to that operator. A new request is asked about again."),
    "control_not_answered": Row(
        "aborted", "No answer to the request of {station}. {own} keeps {vehicle}.",
        "The time of the request is over.", _NOTHING),
    "control_withdrawn": Row(
        "aborted", "Question withdrawn: {own} is not in control of {vehicle} any more.",
        "Another station has taken control, or no station has it.", _NOTHING),
    "control_offered": Row(
        "told", "{vehicle} can be taken now. The request is sent again.",
        "The owner allows it or has released control, and your request still stands.", _NOTHING),
    "control_not_given": Row(
        "aborted", "The request was not granted within {timeout_s} s. In control of {vehicle}: {owner}.",
        "The operator of the other station has denied the request, or has not answered.",
        "Talk to that operator, then 'handover request' again."),
    "time_left_control": Row(
        "countdown", "{left_s} s left to answer {station}. Without an answer {own} keeps {vehicle}.",
        "You have not answered the question.", "Accept or deny."),
    "phase": Row(
        "phase", "{vehicle} is {phase}.",
        "The phase of the flight has changed: on load, on mission or on handover.", _NOTHING),
    "zone_ends": Row(
        "zone_ends", "The zone of {station} ends in {left_s:.0f} s.",
        "The route leaves the zone of the commander.", "Expect a handover."),
    "zone_left": Row(
        "zone_left", "{vehicle} has left the zone of {station}: it is in the zone of {other}.",
        "The commander's zone does not hold the aircraft any more.",
        "'handover request' at the station of the zone that holds it."),
    "zones_left": Row(
        "zone_left", "{vehicle} has left the zone of {station}: it is in no zone.",
        "No zone holds the aircraft. By default it comes home if this lasts.", "Watch it."),
    "ahead": Row(
        "ahead", "Handover {stations} of {vehicle} in {in_s:.0f} s.",
        "The aircraft reaches the overlap of two zones. This station agrees by itself.", _NOTHING),
    "ahead_to_take": Row(
        "requested", "Handover {stations} of {vehicle} in {in_s:.0f} s.",
        "The aircraft is about to reach your zone. You are asked whether you take it.",
        "Read the briefing. Accept or deny."),
    "ahead_to_give": Row(
        "asked", "Handover {stations} of {vehicle} in {in_s:.0f} s.",
        "The aircraft is about to reach the zone of the partner. You are asked whether it may take it.",
        "Accept or deny."),
    "ahead_denied": Row(
        "ahead", "{station} has denied the handover {stations}.",
        "The operator of the other station does not agree. The handover at the border is not possible.",
        "Talk to that operator. Stop the aircraft, or change the route.", Level.ADVISORY),
    "ahead_answered": Row(
        "consent", "{stations} {answer} beforehand; 'handover {other}' changes that.",
        "Your answer is stored, and used at the border.", "The named command, if you change your mind."),
    "ahead_over": Row(
        "aborted", "Question withdrawn: the route does not lead to that border any more.",
        "The route does not lead to this border any more.", _NOTHING),
    "ahead_emergency": Row(
        "aborted", "Question withdrawn: there is an emergency.",
        "In an emergency no planned handover takes place.", "Follow the line about the emergency."),
    "time_left_ahead": Row(
        "countdown", "{left_s} s left to answer: {stations}. At the border you are asked again.",
        "You have not answered the question about the handover ahead.", "Accept or deny."),
    "time_left": Row(
        "countdown", "{left_s} s left to answer: {stations}. Without an answer {commander} keeps the aircraft.",
        "You have not answered the question. Without an answer there is no handover.", "Accept or deny."),
    "time_left_no_commander": Row(
        "countdown", "{left_s} s left to answer: {stations}. Without an answer no station commands the aircraft.",
        "You have not answered the question, and no station has authority.", "Accept or deny."),
    "to_take": Row(
        "requested", "Handover requested{why}: {stations}.",
        "The vehicle asks whether this station takes the aircraft.", "Read the briefing. Accept or deny."),
    "takes": Row(
        "announced", "Handover requested{why}: {stations}.",
        "The vehicle asks whether this station takes the aircraft. The answer is known or automatic.", _NOTHING),
    "to_give": Row(
        "asked", "{station} is ready to take {vehicle}{why}.",
        "The partner is ready. You are asked whether it may take the aircraft.", "Accept or deny."),
    "gives": Row(
        "told", "{station} is ready to take {vehicle}{why}.",
        "The partner is ready. This station agrees by itself, or has agreed before.", _NOTHING),
    "commander_told": Row(
        "told", "{station} is told {way}: {what}.",
        "This station informs the commander of a step of the handover.", _NOTHING),
    "authorized": Row(
        "consent", "Handover Authorized.",
        "This station agrees to the handover.", _NOTHING),
    "denied": Row(
        "consent", "Handover Denied.",
        "This station does not agree. Authority stays where it is.", _NOTHING),
    "denied_before": Row(
        "consent", "Handover Denied, as answered beforehand.",
        "The operator denied this handover before the border was reached.", _NOTHING),
    "set_up": Row(
        "set_up", "Set up as commander: Drone Connected.",
        "This station is ready to command; authority follows.", _NOTHING),
    "released": Row(
        "released", "{station} has the drone: Disconnect.",
        "The partner is set up, and this station gives up authority.", _NOTHING),
    "aborted": Row(
        "aborted", "Handover {number} aborted: {why}",
        "The handover did not take place. Authority stays where it was.", "Read the reason; it names the cure."),
    "superseded": Row(
        "aborted", "Handover {number} is over.",
        "The vehicle has begun another handover, and the question of this one is closed.", _NOTHING),
    "no_question": Row(
        "question", "There is no question to answer.",
        "You typed an answer, and no question waits.", "'handover status' shows what goes on."),
    "other_question": Row(
        "question", "Answer not used: a new question came first, {stations}. Read it, then answer.",
        "A new question came just before your answer. The answer was not used.",
        "Read the new question, then answer it."),
    "rerouted": Row(
        "rerouted", "The commander has changed the mission in flight: no route check here until it has landed.",
        "The aircraft flies another mission than the package's.", _NOTHING),
    "off_route": Row(
        "off_route", "{news}, as this station sees it.",
        "The aircraft is not where its route leads, by the position that this station receives.",
        "Look at mode, wind and position."),
    "on_route": Row(
        "on_route", "{news}, as this station sees it.",
        "The aircraft is on its route again.", _NOTHING),
}  # fmt: skip


def notice(name: str, *, waits: bool = False, **values: object) -> Notice:
    """A line for the operator and the journal. `name`: its row; `waits`: the operator has to answer."""
    row = NOTICES[name]
    return Notice(row.event, row.template.format(**values) + (QUESTION if waits else ""), row.level, name)
