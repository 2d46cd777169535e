# SPDX-License-Identifier: GPL-3.0-or-later

"""The refusals of START and of commands that are a part of it, and what START still needs."""

from __future__ import annotations

from typing import Final

from mavproxy_handover.core.common.levels import Level
from reference.sentences.row import Group, Sentence

__all__ = ["GROUPS"]

_INFO, _ADVISORY, _WARNING, _EMERGENCY = Level


def _need(template: str, meaning: str, action: str) -> Sentence:
    return Sentence(template, Level.WARNING, meaning, action)


_ARM_AGAIN: Final = "Arm again, if you want the motors to run."
_SEND_AGAIN: Final = "Send START again."

_SENTENCES: Final = (
    _need(
        "{command} refused: {needs}",
        "The aircraft does not start. Each reason has its own row in the next table.",
        "Do what the row of the reason says. Then send the command again.",
    ),
    _need(
        "{command} refused: {needs}. {lift}",
        "The aircraft does not start, because the battery does not last for the mission with its reserve.",
        "Charge the battery. If you mean it, do what the end of the sentence says.",
    ),
    _need(
        "START refused: {board}",
        "The autopilot does not hold the mission that was checked.",
        "Upload the mission again through the companion, or type 'handover share'.",
    ),
    _need(
        "START failed: {failure}",
        "START was accepted, and a step of it failed. The aircraft does not fly its mission.",
        "Look at the mode and at the messages of the autopilot. Correct the reason, then send START again.",
    ),
    _need(
        "{word} failed: {failure}",
        "STOP or CONTINUE was accepted, and a step of it failed.",
        "Look at the mode. Choose a mode by hand.",
    ),
    _need(
        "{word} cancelled: {cancels}",
        "Another order has come before STOP or CONTINUE was carried out.",
        "Look at the mode. Send the command again if you still want it.",
    ),
    _need(
        "START, warning: energy: {energy}",
        "START passes. By its file the vehicle only warns that the battery may not last for the mission.",
        "Compare the figures. Land in good time.",
    ),
    _need(
        "{command} had no effect: the vehicle had landed and disarmed. Send START again.",
        "The command came in the second after the landing. The autopilot accepted it, and nothing flies.",
        "Send START again when the station shows 'disarmed'.",
    ),
    Sentence("START from {station}", _INFO, "A station has sent START, and all needs are met."),
    Sentence("START accepted from {station}", _INFO, "The companion arms the aircraft and begins the mission."),
    Sentence("{word} accepted from {station}", _INFO, "The commander's START, STOP or CONTINUE goes to the autopilot."),
    Sentence(
        "{word} rejected from {station}: {gate_reason}",
        _INFO,
        "The gate refuses START, STOP or CONTINUE of a station, and that station is told.",
        "Look for the reason in the table about the gate.",
    ),
    Sentence("on mission: {how}", _INFO, "The flight has begun, and the rules of flight apply."),
    Sentence("landed: the flight is over", _ADVISORY, "The autopilot is disarmed. The rules of the ground apply."),
    Sentence(
        "disarmed: the flight is over",
        _ADVISORY,
        "The autopilot is disarmed, and does not say that it is on the ground.",
        "If it still flies: look at it.",
    ),
    _need(
        "rehearsal does not begin: {needs}",
        "The aircraft is not carried in a rehearsal. The reason follows.",
        "Do what the row of the reason says. Type 'handover rehearse' again.",
    ),
    _need(
        "rehearsal does not end: {needs}",
        "Only the commander ends a rehearsal.",
        "End it at the station that commands.",
    ),
    _need(
        "{rehearse} refused: {needs}",
        "The rehearsal does not begin, or does not end. The reason follows.",
        "Do what the row of the reason says.",
    ),
)

_NEEDS: Final = (
    _need(
        "{station} does not command",
        "This station has no authority.",
        "'handover request', or START at the station that commands.",
    ),
    _need(
        "a rehearsal is under way: nothing arms",
        "The aircraft is carried along its route, with its motors off.",
        "'handover rehearse end'.",
    ),
    _need(
        "the vehicle is already flying or starting",
        "START was sent before, or the aircraft is armed.",
        "Wait. If the aircraft stands on the ground, disarm it.",
    ),
    _need(
        "no mission loaded",
        "The vehicle has no mission package, or its mission was changed after the load.",
        "'handover share' at the commander.",
    ),
    _need(
        "no mission loaded, because {mission_lacks}",
        "The mission is being judged, was cleared, or did not pass. The reason follows.",
        "Wait some seconds, or do what the row of the reason says.",
    ),
    _need("a handover is under way", "Authority is about to move to another station.", "Wait until it has moved."),
    _need(
        "no autopilot",
        "The companion receives no heartbeat of the autopilot.",
        "Check cable and baud rate: 'handover doctor'.",
    ),
    _need(
        "{autopilot} is neither ArduCopter nor ArduPlane",
        "The autopilot is of a kind that is not supported.",
        "Fly it without this system.",
    ),
    _need(
        "{guard_lacks}", "The guard does not protect this flight. The reason has its own row.", "Do what that row says."
    ),
    _need(
        "no position",
        "There is no fresh position of the autopilot, or of the position box in its place.",
        "Wait for the GPS. 'handover status' says what is missing.",
    ),
    _need(
        "outside the zone of {station}",
        "The aircraft does not stand where this station may command.",
        "Carry it there, or look at the zones: 'handover zones' in the companion.",
    ),
    _need(
        "position box {box}",
        "The records of the position box cannot be trusted. The row of the reason says why.",
        "Do what the row about the position box says.",
    ),
    _need(
        '{station} cannot be asked for consent: write consent = "automatic" or consent = "refuse" in its '
        "[[station]] of the vehicle's file",
        "The program of that station has not shown that it can ask its operator.",
        "Write one of the two lines into the vehicle's file, and load the module again.",
    ),
    _need(
        '{station} has consent = "refuse", and the route needs {name} -> {other}',
        "The route needs a handover that the vehicle's file refuses.",
        'Write consent = "automatic", or fly another route.',
    ),
    _need(
        "energy: {energy}",
        "The battery does not last for the mission with its reserve.",
        "Take a full battery. If you mean it: START again after 10 s, or 'handover override energy'.",
    ),
    _need(
        "heights: {heights}",
        "Items of the mission would be flown at other heights than those that were checked.",
        "Plan heights above home, or do what the reason says. Load the mission again.",
    ),
    _need(
        "a return does not land: {return_lacks}",
        "An aircraft with wings would circle for ever after a return.",
        "Set Q_RTL_MODE 1 to 3. Or set RTL_AUTOLAND, and plan a landing sequence.",
    ),
    _need(
        "gaps: {gaps}",
        "A gap in coverage of the mission takes longer than its limit or the guard allow.",
        "Raise HNDO_ALONE_MAX, or plan a shorter gap.",
    ),
    _need(
        "the mission is for a {kind}, and this is a {other_kind}",
        "The package was made for another kind of aircraft.",
        "Load the mission of this aircraft.",
    ),
    _need(
        "the mission has no take-off, it begins with {autopilot}",
        "A plane cannot begin this mission in the air.",
        "Add a take-off item as the first item of the mission.",
    ),
    _need(
        "Q_MAV_TYPE is {number}: its modes are taken for those of another aircraft",
        "The autopilot is another kind of vehicle than it says.",
        "Set Q_MAV_TYPE to 0, then reboot.",
    ),
    _need(
        "on the ground a flight begins with START",
        "The command would begin the mission without the checks of START.",
        "Send START.",
    ),
    _need(
        "the previous START is still being undone: send it again",
        "A disarm or a return has just ended START. The autopilot may still be in AUTO.",
        "Wait a second. Arm again.",
    ),
    _need(
        "withdrawn by a later disarm",
        "The command waited for the mission to be read back when a disarm came.",
        _ARM_AGAIN,
    ),
    _need(
        "the mission is being written",
        "The companion writes the mission to the autopilot just now.",
        "Wait some seconds, then send the command again.",
    ),
    _need(
        "the mission was changed without the companion",
        "The autopilot holds another mission than the one that was checked.",
        "Upload the mission through the companion, or 'handover share'.",
    ),
    _need(
        "the mission is still being read back: send it again",
        "The line to the autopilot is slow: arming waits 3 s at most.",
        "Send the command again.",
    ),
    _need(
        "the mission cannot be read back: {failure}",
        "The autopilot does not send its mission.",
        "Check the line to the autopilot. Then send the command again.",
    ),
)

_FAILURES: Final = (
    _need("{station} disarmed", "The commander disarmed while START was under way.", _SEND_AGAIN),
    _need(
        "{station} changed the {list}",
        "A station changed the mission or the geofence while START was under way.",
        "Wait until the mission is judged. Then send START again.",
    ),
    _need(
        "the aircraft is brought home",
        "A safety decision came while START was under way.",
        "Read the sentence about the decision.",
    ),
    _need("the commander has changed", "Authority moved while START was under way.", "START at the new commander."),
    _need(
        "its commander no longer has authority",
        "Authority moved while START was under way.",
        "START at the station that commands.",
    ),
    _need(
        "internal fault",
        "A part of the companion failed.",
        "Do not fly. 'handover logs', the entry 'fault' of the companion's journal, and tell us.",
    ),
    _need("the module is unloaded", "The companion ends.", "Start the companion again."),
    _need(
        "no answer to {autopilot}",
        "The autopilot does not answer a step of it.",
        "Check the line to the autopilot. Then send the command again.",
    ),
    _need(
        "{autopilot} refused ({reason})",
        "The autopilot refuses a step of it. Its own text follows.",
        "Correct what the autopilot says. Then send the command again.",
    ),
    _need(
        "{autopilot} refused ({reason}): {error}",
        "The autopilot refuses a step of it. Its own text follows.",
        "Correct what the autopilot says. Then send the command again.",
    ),
    _need(
        "the autopilot does not obey: {error}",
        "All tries to order it have failed.",
        "Take the aircraft by radio control, if you can.",
    ),
    _need(
        "{board}",
        "The autopilot does not hold the mission that was checked.",
        "Upload the mission again through the companion, or 'handover share'.",
    ),
    _need(
        "not commanded again: the autopilot is in {mode} now",
        "A pilot or a failsafe has chosen another mode.",
        "Look who flies the aircraft.",
    ),
    _need(
        "it flies {mode}, which nothing stops and nothing goes on with",
        "STOP and CONTINUE work in AUTO, LOITER and GUIDED only.",
        "Choose a mode.",
    ),
    _need(
        "it hovers: there is no stop before it flies forwards",
        "The aircraft has not finished its take-off.",
        "Wait until it flies forwards.",
    ),
    _need(
        "it takes off or lands: there is no stop so low",
        "Near the ground a plane cannot circle.",
        "Wait, or choose a mode by hand.",
    ),
    _need(
        "it flies {mode}, by which a failsafe waits: nothing goes on with it",
        "A failsafe of the autopilot has chosen this mode.",
        "Correct the reason of the failsafe. Choose a mode.",
    ),
)

GROUPS: Final = (
    Group(
        "start",
        "START and rehearsal",
        "Answers to START, to arming and to 'handover rehearse', at the station that sent it.",
        _SENTENCES,
    ),
    Group("need", "What START needs", "The reasons in 'START refused: REASON; REASON'.", _NEEDS, whole=False),
    Group(
        "failure",
        "Why an order to the autopilot failed",
        "The reasons in 'START failed', 'STOP failed', 'mission not loaded' and the like.",
        _FAILURES,
        whole=False,
    ),
)
