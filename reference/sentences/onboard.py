# SPDX-License-Identifier: GPL-3.0-or-later

"""What people and programs hear about onboard programs: refusals, delegation, and the hold at its end."""

from __future__ import annotations

from typing import Final

from mavproxy_handover.core.authority.delegation import End
from mavproxy_handover.core.common.levels import Level
from reference.sentences.row import NOTHING, Group, Sentence

__all__ = ["GROUPS"]

_INFO, _ADVISORY, _WARNING, _EMERGENCY = Level


def _warn(template: str, meaning: str, action: str = NOTHING) -> Sentence:
    return Sentence(template, Level.WARNING, meaning, action)


def _info(template: str, meaning: str, action: str = NOTHING) -> Sentence:
    return Sentence(template, Level.INFO, meaning, action)


_SENTENCES: Final = (
    _warn(
        "{command} of {station} refused: {onboard_why}",
        "A frame of an onboard program was not passed on to the autopilot. The program hears this, once a minute.",
        "Do what the row of the reason says.",
    ),
    _warn(
        "Link of {station} closed after an internal fault. Restart the companion on the ground.",
        "The companion broke on a frame of an onboard program. Its link stays closed; nothing else is affected.",
        "Fly on without the program. After the flight send the journal to the developers.",
    ),
    _info("{station} is heard", "The onboard program sends, at first or after a silence. In the journal only."),
    Sentence(
        "{station} is silent for {seconds} s",
        _ADVISORY,
        "The onboard program sends nothing any more. In the journal only.",
        "Look after the program.",
    ),
    _info(
        "{station} delegates guided targets to {other}",
        "The commander has typed 'handover delegate'. Targets of the onboard program pass in GUIDED.",
    ),
    _info("{station} delegates guided targets to you", "The onboard program hears that its targets pass now."),
    _warn(
        "{station} no longer leads the aircraft: {delegation_end}",
        "The delegation is over. No target of the onboard program passes any more.",
        "Lead the aircraft yourself. To delegate again, order GUIDED and type 'handover delegate NAME'.",
    ),
    _warn(
        "{station} no longer leads the aircraft: {delegation_end}. A hold is ordered.",
        "The delegation is over, and the companion stops the aircraft where it is. A second line confirms that.",
        "Wait for the second line. Then order GUIDED, or another mode.",
    ),
    _warn(
        "targets are no longer delegated to you: {delegation_end}",
        "The onboard program hears that its targets pass no longer.",
        "The program waits until the commander delegates again.",
    ),
    _warn(
        "Position estimate is {metres} m from the GPS receiver. EKF source set {number} (GPS) ordered, programs' "
        "positions stopped.",
        "A program moves the estimate away, or the receiver is wrong. The autopilot uses the receiver now.",
        "Watch where it flies. Without GPS reception land it.",
    ),
    _warn(
        "Position estimate is {metres} m from the GPS receiver. No EKF source set has GPS. Land, or fly by hand.",
        "A program moves the estimate away, or the receiver is wrong. Modes with a position are led astray.",
        "Land where it is safe, or let the pilot fly. Set EK3_SRC2_POSXY to 3 before the next flight.",
    ),
    _warn(
        "Return comes no nearer, {metres} m from its site. Order LAND, or end the obstacle program.",
        "For 45 s the aircraft has not come 5 m nearer. Obstacles that an onboard program reports may keep it away.",
        "Order LAND if the place allows it, or end the program.",
    ),
    _info("Position estimate and GPS receiver agree again.", "They are as near as they should be."),
    Sentence(
        "Hold confirmed: {mode}. Order GUIDED to lead it again.",
        _ADVISORY,
        "The autopilot flies a mode that stands still.",
    ),
    _warn(
        "Hold not confirmed: {autopilot}. Command the aircraft now.",
        "The autopilot did not take the hold after a delegation. A velocity of zero was sent before.",
        "Order a mode at once, such as LOITER or RTL.",
    ),
    _warn(
        "DELEGATE {name} refused: {delegate_need}",
        "No guided target is delegated. The reason follows.",
        "Do what the row of the reason says.",
    ),
)

_REQUESTS: Final = (
    Sentence(
        "{station} has payload authority: {payload_kinds}",
        _ADVISORY,
        "This part of the payload is commanded by this station or onboard program now.",
    ),
    Sentence(
        "no station has payload authority: {payload_kinds}",
        _ADVISORY,
        "No station has flight authority, nor this part of the payload with it.",
    ),
    _warn(
        "PAYLOAD refused: {payload_need}",
        "Payload authority does not move. The reason follows.",
        "Do what the row of the reason says.",
    ),
)

_NEEDS: Final = (
    _warn("only the commander delegates", "This station does not command.", "Ask for control first."),
    _warn("only the commander takes targets back", "This station does not command.", "Ask for control first."),
    _warn(
        "targets are delegated to {station}; take that back first",
        "One program leads at a time.",
        "Type 'handover delegate no'.",
    ),
    _warn("the aircraft does not fly", "Guided targets need an aircraft in flight.", "Take off first."),
    _warn(
        "the companion has decided what the aircraft does now",
        "A hold, a return or a landing of the companion is in force.",
        "Wait until its cause is over.",
    ),
    _warn("the aircraft does not fly GUIDED; order GUIDED first", "Targets have an effect in GUIDED only."),
    _warn(
        "this GUIDED was not ordered by the commander; order GUIDED again",
        "A pilot, a program or an earlier commander chose the mode.",
        "Order GUIDED, then delegate.",
    ),
    _warn(
        "no program '{name}' has the right 'guided'; those that have it: {stations}",
        "The name is not one of [[onboard]] in the vehicle's file with that right.",
        "Use a name of the list, or change the vehicle's file on the ground.",
    ),
    _warn("the companion brings it home", "A return or a landing is ordered: no hold is ordered beside it."),
)

_WHY: Final = (
    _warn(
        "its rights in [[onboard]] do not have it",
        "No right of the program contains this message or command.",
        "If it is meant, add the right or the name of the sensor message to the vehicle's file.",
    ),
    _warn(
        "no targets are delegated. The commander types 'handover delegate {name}' in GUIDED",
        "A target came while no delegation was in force.",
    ),
    _warn("it comes more often than its limit", "The message has a highest rate, and the program a number of bytes."),
    _warn(
        "it leads the landing more than {metres} m away",
        "The target, or the aircraft that follows it, is too far from where the landing began. It lands where it is.",
        "Watch the landing. Check the program on the ground; landing_m in [[onboard]] is the limit.",
    ),
    _warn(
        "the aircraft stands and has not landed",
        "It is on the ground and armed, or hovers, and a LANDING_TARGET keeps it there. Without one it lands.",
        "If it does not disarm on the ground within 20 s, disarm it.",
    ),
    _warn(
        "position estimate and GPS receiver disagree",
        "The companion has stopped what moves the position estimate, until the vehicle is disarmed.",
        "Look after the program on the ground.",
    ),
    _warn(
        "the line to the autopilot has no more room",
        "Feeds, onboard programs and payload stations together fill their half of the serial line.",
        "Raise the baud rate of the line, or have one of them send less.",
    ),
    _warn("another has payload authority", "The payload belongs to a station or to another program."),
    _warn("it would leave energy, fence or coverage", "The target is judged as the commander's targets are."),
    _warn("a number in it is none", "A field has NaN or infinity."),
    _warn("system id must be {number}, the vehicle's", "An onboard program speaks with the vehicle's system id."),
    _warn("component must be {number}, as in [[onboard]]", "The program speaks as another component than configured."),
    _warn("the companion takes none, ask the autopilot", "The frame was addressed to component 191."),
)

_PAYLOAD: Final = (
    _warn(
        "{payload_kind} authority is that of flight by the {payload_file}",
        "This part of the payload is the commander's.",
        "Ask for control of the aircraft.",
    ),
    _warn(
        "{payload_kind} authority is {station}'s by the {payload_file}",
        "The mission, else the vehicle's file, gives it to a station or to an onboard program.",
    ),
    _warn(
        "{station} has {payload_kind} authority; it must release it first",
        "Another station asked for the payload before.",
        "Ask its operator to release it.",
    ),
    _warn("it has no {payload_kind} authority that was requested", "This station gives back what it does not have."),
)

GROUPS: Final = (
    Group(
        "onboard",
        "Onboard programs",
        "Told to the onboard program, to the commander, and written to the journal.",
        (*_SENTENCES, *_REQUESTS),
    ),
    Group(
        "payload_need",
        "Why a station gets no payload authority",
        "The end of a refusal.",
        _PAYLOAD,
        whole=False,
    ),
    Group("onboard_why", "Why a frame of an onboard program is refused", "The end of a refusal.", _WHY, whole=False),
    Group("delegate_need", "Why a delegation is refused", "The end of a refusal.", _NEEDS, whole=False),
    Group(
        "delegation_end",
        "Why a delegation is over",
        "The end of a sentence.",
        tuple(_info(end.value, "The delegation of guided targets ended by this.") for end in End),
        whole=False,
    ),
)
