# SPDX-License-Identifier: GPL-3.0-or-later

"""Safety decisions, authority and handovers: the vehicle's sentences to stations and to its own console."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from mavproxy_handover.core.authority.cures import _CURES, _ENDED  # the sentences themselves: nothing is written twice
from mavproxy_handover.core.common.causes import CAUSES
from mavproxy_handover.core.common.levels import DECISION_LEVELS, Level
from mavproxy_handover.core.common.model import FlightAction, Reason, in_words
from reference.sentences.row import NOTHING, Group, Sentence

__all__ = ["GROUPS"]

_INFO, _ADVISORY, _WARNING, _EMERGENCY = Level
_RETURN, _LAND = DECISION_LEVELS[FlightAction.RETURN], DECISION_LEVELS[FlightAction.LAND]
_HOLD, _TRANSFER = DECISION_LEVELS[FlightAction.HOLD], DECISION_LEVELS[FlightAction.TRANSFER]
_CONTINUE, _WARN = DECISION_LEVELS[FlightAction.CONTINUE], DECISION_LEVELS[FlightAction.WARN]
_WATCH: Final = "Watch the aircraft. The commander can choose another mode."
_IN_ZONE: Final = "If the aircraft is in your zone, 'handover request'."


def _info(template: str, meaning: str, action: str = NOTHING) -> Sentence:
    return Sentence(template, Level.INFO, meaning, action)


_DECISIONS: Final = (
    Sentence(
        "RETURN to {place}. {cause}. {site_figures}",
        _RETURN,
        "The aircraft leaves its mission and flies to this return site. Cause and figures follow.",
        f"{_WATCH} {_IN_ZONE}",
    ),
    Sentence(
        "RETURN to {place}. {cause}",
        _RETURN,
        "The aircraft leaves its mission and flies to this return site.",
        f"{_WATCH} {_IN_ZONE}",
    ),
    Sentence("RETURN. {cause}", _RETURN, "The aircraft leaves its mission and returns.", f"{_WATCH} {_IN_ZONE}"),
    Sentence(
        "LAND. {cause}",
        _LAND,
        "The aircraft lands. A return is not possible, or the vehicle's file wants a landing.",
        "Clear the ground below it. The commander can choose another mode.",
    ),
    Sentence(
        "HOLD. {cause}",
        _HOLD,
        "The aircraft stops, or circles, and waits.",
        "Remove the cause, or hand the aircraft over: 'handover give STATION'.",
    ),
    Sentence(
        "TRANSFER. {cause}",
        _TRANSFER,
        "Authority moves to a station that is ready.",
        "At that station: take the aircraft. At the others: watch.",
    ),
    Sentence(
        "CONTINUE. {cause}. {gap}",
        _CONTINUE,
        "The aircraft crosses a gap in coverage that its mission declares.",
        "Wait until it comes out of the gap. After the time that is told it returns.",
    ),
    Sentence(
        "WARNING. {cause}",
        _WARN,
        "Something is wrong. The vehicle's file wants only a warning of this cause.",
        "Look at the cause, and correct it. Nothing is commanded.",
    ),
    Sentence(
        "WARNING. {cause}. {withheld}",
        _WARN,
        "Something is wrong. The vehicle commands nothing, for the reason at the end.",
        "Look at the cause, and correct it.",
    ),
    Sentence(
        "ALL CLEAR. Over: {cause}",
        _ADVISORY,
        "No cause is left. The mission goes on if it waited.",
        "After a return: 'handover resume' continues the mission.",
    ),
    Sentence(
        "ALL CLEAR. Over: the emergency before the restart",
        _ADVISORY,
        "The companion was started again, and the earlier cause is over.",
    ),
    Sentence("ALL CLEAR. Over: the rehearsal", _ADVISORY, "The decisions of the rehearsal do not count any more."),
    Sentence(
        "PILOT: a pilot has taken over, {mode}",
        _WARN,
        "A pilot flies the aircraft by radio control.",
        "Talk to the pilot. Do not command.",
    ),
    Sentence(
        "PILOT: a pilot has taken over, {mode} ({cause})",
        _WARN,
        "A pilot flies the aircraft by radio control.",
        "Talk to the pilot. Do not command.",
    ),
    Sentence(
        "PILOT: a pilot has taken over, {mode}; {command} is not commanded any more ({cause})",
        _WARN,
        "A pilot flies the aircraft by radio control. The vehicle's own order has ended.",
        "Talk to the pilot. Do not command.",
    ),
    Sentence(
        "PILOT: a pilot has taken over, {mode}; {command} is not commanded any more",
        _WARN,
        "A pilot flies the aircraft by radio control. The vehicle's own order has ended.",
        "Talk to the pilot. Do not command.",
    ),
    Sentence(
        "PILOT: the pilot has given it back, {mode}",
        _WARN,
        "The pilot does not fly the aircraft any more.",
        "The commander flies it again.",
    ),
    Sentence(
        "PILOT: the pilot has given it back, {mode} ({cause})",
        _WARN,
        "The pilot does not fly the aircraft any more. The cause is still there.",
        "The commander flies it again. Look at the cause.",
    ),
    Sentence(
        "{mode}: {chosen}; {command} is not commanded any more",
        _WARN,
        "Another source has chosen this mode, and the vehicle's own order has ended.",
        "Check that the mode is meant.",
    ),
    Sentence(
        "{mode}: {chosen}; {command} is not commanded any more ({cause})",
        _WARN,
        "Another source has chosen this mode, and the vehicle's own order has ended. The cause is still there.",
        "Check that the mode is meant.",
    ),
    *(
        Sentence(
            f"{action.name} is ordered again. The aircraft has not begun it, in {{mode}} ({{cause}})",
            DECISION_LEVELS[action],
            "The autopilot accepted the order and does not carry it out.",
            "If it does not follow, order the mode yourself, or by radio control.",
        )
        for action in (FlightAction.HOLD, FlightAction.RETURN, FlightAction.LAND)
    ),
    Sentence(
        "{command}: {disobeyed}. The autopilot is in {mode}",
        _WARN,
        "The autopilot does not carry out the vehicle's order.",
        "Order the mode yourself, or by radio control.",
    ),
    Sentence(
        "{command}: {disobeyed}. The autopilot is in {mode} ({cause})",
        _WARN,
        "The autopilot does not carry out the vehicle's order.",
        "Order the mode yourself, or by radio control.",
    ),
    *(
        Sentence(
            f"{action.name}: internal fault of the companion, no station commands",
            DECISION_LEVELS[action],
            "The companion cannot judge authority any more. It ends authority and brings the aircraft home.",
            "Watch the aircraft. Take it by radio control if you must. Then tell us.",
        )
        for action in (FlightAction.RETURN, FlightAction.LAND)
    ),
    Sentence(
        "Autopilot restarted in flight. Check the aircraft.",
        _EMERGENCY,
        "The autopilot's own clock has gone back in flight. It may be disarmed, or in another mode.",
        "Look at mode and height. If it flies, order RTL or AUTO.",
    ),
    Sentence(
        "internal fault of the companion: {work}",
        _WARNING,
        "A part of the companion failed. It is tried again, and the other parts go on.",
        "End the flight. 'handover logs', the entry 'fault' of the companion's journal, and tell us.",
    ),
    Sentence("delivery point reached, waypoint {waypoint}", _ADVISORY, "The aircraft is at its delivery point."),
    Sentence(
        "A return goes to {place}: {site_figures}", _ADVISORY, "A return that begins now would go to this return site."
    ),
    Sentence(
        "{place} is not in the autopilot's list: a return may go elsewhere",
        _WARNING,
        "The return site could not be written to the autopilot. The companion tries again.",
        "Be ready to fly it home by hand.",
    ),
    Sentence(
        "Rally list changed by another program. Restoring the return site",
        _WARNING,
        "Another program writes the autopilot's rally points. The companion keeps one return site there.",
        "Switch that off in the other program.",
    ),
    Sentence(
        "energy: {troubles}",
        _WARNING,
        "The battery's own values do not fit, or are missing.",
        "The companion counts with the worse value. Land in good time.",
    ),
    Sentence(
        "position box {box_news}",
        _WARNING,
        "The position box is not as it should be. The reason follows.",
        "Do what the row about the position box says.",
    ),
    Sentence("position box in order", _ADVISORY, "The position box counts again."),
    Sentence(
        "position box in order, {number} m from the autopilot's position", _ADVISORY, "The position box counts again."
    ),
)

_CAUSE_WORDS: Final = (
    *(
        Sentence(row.words, _WARNING, f"{row.meaning[:1].upper()}{row.meaning[1:]}.", _action)
        for (_cause, row), _action in zip(
            CAUSES.items(),
            (
                "Watch the return.",
                "At another station: 'handover request'.",
                "Watch the return.",
                "Bring up a station there.",
                "Bring up the next station.",
                "Look for a program with the station's name.",
                "Improve antenna and place of the station.",
                "Land: nothing protects the flight if the companion fails.",
                "Lead the aircraft back into the fence.",
                "Look at mode, wind and position.",
                "Land by sight or by radio control.",
                "Take the aircraft by radio control.",
            ),
            strict=True,
        )
    ),
    Sentence(
        "{station} silent for {seconds} s",
        _WARNING,
        "The commander is lost: it has not been heard for this time.",
        "Check its program and link. At another station: 'handover request'.",
    ),
    Sentence(
        "{station} hears nothing",
        _WARNING,
        "The commander is heard and does not hear the aircraft.",
        "Check the downlink.",
    ),
    Sentence(
        "{station} hears nothing for {seconds} s",
        _WARNING,
        "The commander is heard and does not hear the aircraft.",
        "Check the downlink.",
    ),
    Sentence(
        "{station} hears less than {percent} of what the aircraft sends",
        _WARNING,
        "The commander's receiver is weak, or the channel is busy.",
        "Check antenna, power and data rate.",
    ),
    Sentence(
        "out of coverage, {metres} m outside the zone of {station}",
        _WARNING,
        "The aircraft is in no zone. The nearest one is named.",
        "Watch the return.",
    ),
    Sentence(
        "no station whose zone holds the aircraft can take it: {stations}",
        _WARNING,
        "The zones here belong to stations that are not ready.",
        "Bring one of these stations up.",
    ),
    Sentence(
        "the zone of {station} ends in {seconds} s, and no station is ready beyond it",
        _WARNING,
        "The border of the last zone is ahead.",
        "Bring up the next station.",
    ),
    Sentence(
        "a sender without the key of {station} speaks in its name",
        _WARNING,
        "Frames in this station's name have no valid signature.",
        "Look for a program with the station's system id.",
    ),
    Sentence(
        "the links of {station} are weak, and no station has better ones",
        _WARNING,
        "The commander's links lose too much or take too long.",
        "Improve antenna and place of the station.",
    ),
    Sentence(
        "{number} Wh left, the way back needs {value} Wh with the reserve",
        _WARNING,
        "The energy is only enough for the way back.",
        "Watch the return.",
    ),
    Sentence("guard switched off", _WARNING, "HNDO_ENABLE is 0.", "Land. Set it to 1."),
    Sentence("guard silent for {seconds} s", _WARNING, "The guard is not heard.", "Land, and check the autopilot."),
    Sentence(
        "autopilot silent for {seconds} s",
        _WARNING,
        "The autopilot is not heard.",
        "Take the aircraft by radio control.",
    ),
    Sentence("no fresh position for {seconds} s", _WARNING, "The position is old.", "Look at the GPS."),
    Sentence(
        "outside the fence ({breach})",
        _WARNING,
        "The autopilot reports this breach of its fence.",
        "Lead the aircraft back into the fence.",
    ),
    Sentence(
        "off route: {track}", _WARNING, "The aircraft is not where its route leads.", "Look at mode, wind and position."
    ),
    Sentence(
        "off route: course {number} deg off the leg to waypoint {waypoint}",
        _WARNING,
        "The aircraft flies in another direction than its route.",
        "Look at mode, wind and position.",
    ),
)

_SITE: Final = (
    _info("{number} km away", "How far the return site is."),
    _info("{metres} m away", "How far the return site is."),
    Sentence(
        "the wind does not let it be flown",
        _WARNING,
        "Against the wind the aircraft would not get there.",
        "Land where it is.",
    ),
    _info("needs {percent} of the battery ({left} left)", "What the way costs, and what the battery has."),
    Sentence("OUT OF REACH", _WARNING, "The energy does not last for the way.", "Be ready to land on the way."),
    Sentence("outside the fence", _WARNING, "The return site is outside the geofence.", "Plan rally points inside it."),
    Sentence(
        "the way leaves the fence",
        _WARNING,
        "The straight way there leads through the border of the geofence.",
        "Watch the return.",
    ),
    Sentence(
        "the way is too near to the ground",
        _WARNING,
        "The straight way there comes too near to the ground.",
        "Watch the height.",
    ),
    _info("covered by no station", "No station that could take the aircraft covers the way."),
    _info("covered by {stations} all the way", "These stations cover the whole way."),
    _info("covered by {stations} at its end only", "These stations cover the return site, and not the whole way."),
    Sentence(
        "NOT IN THE AUTOPILOT'S LIST",
        _WARNING,
        "The autopilot's rally list does not hold this return site.",
        "Be ready to fly it home by hand.",
    ),
)

_WITHHELD: Final = (
    _info("The aircraft is on the ground", "Nothing is commanded on the ground."),
    Sentence("The autopilot is not heard", _WARNING, "No order would arrive.", "Take the aircraft by radio control."),
    _info("A pilot has the aircraft", "A pilot is never overruled.", "Talk to the pilot."),
    _info("A failsafe of the autopilot acts", "The autopilot's own failsafe is not overruled."),
    _info("The aircraft returns already", "A milder order would end the return."),
    _info("The aircraft lands already", "A milder order would end the landing."),
)

_ADVICE: Final[Mapping[Reason, tuple[str, str]]] = {
    Reason.PARTNER_SILENT: ("The station does not answer the vehicle's questions.", "Check its program and its link."),
    Reason.VERSION_DIFFERS: ("The station's module is of another version.", "Install the vehicle's version there."),
    Reason.MISSION_DIFFERS: ("The station has another mission package.", "'handover share' at the commander."),
    Reason.MISSION_MISSING: ("The station has no mission package.", "'handover share' at the commander, or wait."),
    Reason.UNMANNED: ("The station requires an operator, and none has signed on.", "'handover operator NAME' there."),
    Reason.CONSENT_REFUSED: (
        "The vehicle's file refuses handovers for this station.",
        "Fly another route, or change the file.",
    ),
    Reason.PARTNER_REFUSED: ("The partner's operator has denied the handover.", "Talk to that operator."),
    Reason.COMMANDER_DENIED: ("The commander's operator has denied the handover.", "Talk to that operator."),
    Reason.PARTNER_UNANSWERED: ("The partner's operator did not answer in time.", "Talk to that operator. Ask again."),
    Reason.COMMANDER_UNANSWERED: (
        "The commander's operator did not answer in time.",
        "Talk to that operator. Ask again.",
    ),
    Reason.COMMANDER_SILENT: (
        "The commander does not answer the vehicle's questions.",
        "Check its program and its link.",
    ),
    Reason.CANNOT_BE_ASKED: (
        "The commander's program has no way to ask its operator.",
        "Set 'consent' in the vehicle's file.",
    ),
}

_CURE_ROWS: Final = (
    *(Sentence(text.format(name="{station}").rstrip("."), _WARNING, *_ADVICE[why]) for why, text in _CURES.items()),
    Sentence(
        "{station} cannot be partner: {handover_reason}",
        _WARNING,
        "The station cannot take the aircraft now.",
        "Look at its program and its link.",
    ),
)

_HANDOVER: Final = (
    Sentence(
        "{station} gives up control, and no station can take the aircraft now. When it is in your zone, type "
        "'handover request'",
        _WARNING,
        "The commander's operator has released the aircraft in flight, or its program ends. It commands until a "
        "station has taken the aircraft.",
        "'handover request', if the aircraft is in your zone.",
    ),
    Sentence(
        "{cure}",
        _WARNING,
        "The named station cannot be partner. Each reason has its row below.",
        "Do what the row says.",
    ),
    Sentence(
        "No handover: {ended_why}",
        _WARNING,
        "The planned handover did not take place. Authority stays where it is.",
        "Do what the row of the reason says.",
    ),
    Sentence("{station} commands now", _ADVISORY, "Authority has moved to this station."),
    Sentence("{station} commands now (handover {number})", _ADVISORY, "Authority has moved by this handover."),
    Sentence("no station commands now", _ADVISORY, "The commander is lost, or has released the aircraft.", _IN_ZONE),
    Sentence(
        "REHEARSAL: begun by {station}, nothing arms",
        _WARNING,
        "The aircraft is carried along its route. Decisions are told and not commanded.",
        "Keep the motors off. 'handover rehearse end' ends it.",
    ),
    Sentence("REHEARSAL OVER: ended by {station}", _ADVISORY, "The rules of the ground apply again."),
    Sentence(
        "REHEARSAL OVER: the aircraft is armed",
        _EMERGENCY,
        "The aircraft was armed while it was carried.",
        "Stand clear of the aircraft, and disarm it.",
    ),
    Sentence(
        "REHEARSAL OVER: no station has had authority for {seconds} s",
        _EMERGENCY,
        "The rehearsal ended because its commander was lost.",
        "Bring a station up. Begin the rehearsal again.",
    ),
    Sentence(
        "{station} sends no heartbeat, so it cannot command. Send HEARTBEAT each second as system {system}.",
        _WARNING,
        "Frames of the station arrive, and its heartbeat does not.",
        "Have its program send HEARTBEAT each second with this system id.",
    ),
    Sentence(
        "system id {system} is not one of {station}: set this program's to {number}",
        _WARNING,
        "The program has a system id that the vehicle's file does not give this station.",
        "Set it in the program (MAVProxy: --source-system), or add it to 'sysids'.",
    ),
    Sentence(
        "frames of {station} are not signed: give this program the key of {name}",
        _WARNING,
        "The vehicle has a key for this station, and the program does not sign.",
        "Enter the key in the program (MAVProxy: signing key PASSPHRASE).",
    ),
    Sentence(
        "frames of {station} are signed with another key: give this program the key of {name}",
        _WARNING,
        "The program signs with a key that is not this station's.",
        "Enter the key of this station.",
    ),
    Sentence(
        "frames of {station} carry an old time: set the clock of this computer",
        _WARNING,
        "Signatures carry the time, and this computer's clock is wrong.",
        "Set the clock.",
    ),
)

_ENDED_ROWS: Final = (
    *(
        Sentence(text.format(commander="{commander}", partner="{partner}").rstrip("."), _WARNING, *_ADVICE[why])
        for why, text in _ENDED.items()
    ),
    *(
        Sentence(in_words(why), _INFO, "The name of the reason, as the journal has it.")
        for why in Reason
        if why not in _ENDED and why is not Reason.NONE
    ),
)

_REASON_ROWS: Final = tuple(
    Sentence(in_words(why), _INFO, "The name of the reason, as the journal has it.") for why in Reason
)

GROUPS: Final = (
    Group(
        "decision",
        "Safety decisions and the aircraft",
        "At every station, by STATUSTEXT. A decision comes as "
        "HANDOVER_DECISION as well. In a rehearsal it begins with 'REHEARSAL:' or 'REHEARSAL: would'.",
        _DECISIONS,
    ),
    Group(
        "cause",
        "Causes with their figures",
        "The sentence of a decision names its cause in these words.",
        _CAUSE_WORDS,
        whole=False,
    ),
    Group("site", "Figures of the return site", "The end of the sentence about a return.", _SITE, whole=False),
    Group("withheld", "Why nothing is commanded", "The end of 'WARNING. CAUSE. REASON'.", _WITHHELD, whole=False),
    Group("handover", "Authority and handovers", "At the stations, by STATUSTEXT.", _HANDOVER),
    Group(
        "cure",
        "Why a station cannot be partner",
        "At both operators, and in 'Control denied: REASON'.",
        _CURE_ROWS,
        whole=False,
    ),
    Group(
        "ended_why",
        "Why a handover did not take place",
        "The reasons in 'No handover: REASON'.",
        _ENDED_ROWS,
        whole=False,
    ),
    Group(
        "handover_reason",
        "Names of reasons",
        "As the journal and the console name a reason.",
        _REASON_ROWS,
        whole=False,
    ),
)
