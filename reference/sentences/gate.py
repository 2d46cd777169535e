# SPDX-License-Identifier: GPL-3.0-or-later

"""The gate's refusals, and the notices about sticks and setpoints of a station."""

from __future__ import annotations

from typing import Final

from mavproxy_handover.core.common.levels import Level
from mavproxy_handover.gate.judge import GateReason
from reference.sentences.row import NOTHING, Group, Sentence

__all__ = ["GROUPS"]

_INFO, _ADVISORY, _WARNING, _EMERGENCY = Level


def _warn(template: str, meaning: str, action: str = NOTHING) -> Sentence:
    return Sentence(template, Level.WARNING, meaning, action)


_SENTENCES: Final = (
    _warn(
        "{command} refused: {gate_why}",
        "The gate does not pass a command of this station to the autopilot. The reason follows.",
        "Do what the row of the reason says.",
    ),
    _warn(
        "log download ended: the vehicle is armed",
        "This station was reading flight logs. No station may while the vehicle is armed.",
        "Read the logs after the landing.",
    ),
    _warn(
        "{command} refused: {command_limit}",
        "The command would change how a return is flown, or too many came. It does not go to the autopilot.",
        "Do what the row of the reason says.",
    ),
    _warn(
        "{command} refused: {command_limit}. {lift}",
        "The command would leave energy, geofence or coverage. It does not go to the autopilot.",
        "Choose another command. If you mean it, do what the end of the sentence says.",
    ),
    _warn(
        "{command} refused: {limit}. {lift}",
        "The command would leave energy, geofence or coverage. It does not go to the autopilot.",
        "Choose another command. If you mean it, do what the end of the sentence says.",
    ),
    _warn(
        "{command}, warning: {limits}",
        "The command is carried out. By its file the vehicle only warns of this limit.",
        "Watch energy, geofence and coverage. Correct the command if you did not mean it.",
    ),
    _warn(
        "{list} rejected: {upload}",
        "The upload in flight is not flown: the aircraft flies on as before.",
        "Correct the reason, and upload again.",
    ),
    _warn(
        "mission, warning: {autopilot}",
        "The mission is flown, and may come too near to the ground.",
        "Plan higher, or bring the heights of the ground.",
    ),
    _warn(
        "Control denied: {control}",
        "Authority does not move. The reason follows.",
        "Do what the row of the reason says.",
    ),
)

_WHY: Final = (
    _warn(
        "another has payload authority",
        "Gimbal, camera and winch are another station's, or an onboard program's.",
        "Type 'handover payload request', where the mission or the vehicle's file allows that.",
    ),
    _warn(
        "no command of a camera, gimbal or winch. Send it to the autopilot",
        "It was addressed to a payload manager on board, which takes commands of the payload only.",
        "Address it to component 1.",
    ),
    _warn("{station} commands", "Another station has authority.", "Request control at this station."),
    _warn("{station} commands (request control)", "Another station has authority.", "Request control by your program."),
    _warn("{station} commands ('handover request')", "Another station has authority.", "'handover request'."),
    _warn(
        "no station commands",
        "No station has authority.",
        "On the ground the parent commands first. In flight, request control when the aircraft is in your zone.",
    ),
    _warn(
        "no station commands (request control)",
        "No station has authority.",
        "On the ground the parent commands first. In flight, request control when the aircraft is in your zone.",
    ),
    _warn(
        "no station commands ('handover request')",
        "No station has authority.",
        "On the ground the parent commands first. In flight, 'handover request' when the aircraft is in your zone.",
    ),
    _warn(
        "locked while armed",
        "Guard, failsafes, authority or a return depend on it.",
        "Change it on the ground, disarmed. For another speed send DO_CHANGE_SPEED.",
    ),
    _warn(
        "maintenance only, over no radio link",
        "It reconfigures links, scripts or keys.",
        "Do it on the bench, by cable.",
    ),
    _warn(
        "there is no such file, use the mission protocol",
        "The program wants the mission as a file.",
        "Set the program to upload missions by the mission protocol.",
    ),
    _warn(
        "not known to this vehicle",
        "The gate has no class for this command, so it is refused.",
        "'handover policy COMMAND' says what passes.",
    ),
    _warn(
        "a rehearsal is under way: nothing arms",
        "The aircraft is carried along its route, with its motors off.",
        "'handover rehearse end'.",
    ),
    _warn(
        "this component has no authority ('components' in [[station]])",
        "A camera, a tracker or a second program with the station's own system id sent a command.",
        "Give it an id of its own in 'sysids', or name its component in 'components'.",
    ),
    _warn(
        "the companion takes none, ask the autopilot",
        "The frame was addressed to the companion.",
        "Address it to component 1.",
    ),
    _warn(
        "in flight {station} alone may ask",
        "Its answer slows the telemetry of every station.",
        "Ask on the ground, or as the commander.",
    ),
    _warn("not in flight", "Its answer slows the telemetry of every station.", "Ask on the ground."),
    _warn("{station} is using file transfer", "The autopilot serves one program at a time.", "Wait, then ask again."),
    _warn(
        "another station is using file transfer", "The autopilot serves one program at a time.", "Wait, then ask again."
    ),
    _warn(
        "only while the vehicle is disarmed",
        "A download of logs loads the link on which the aircraft learns who commands.",
        "Read the logs after the landing.",
    ),
    _warn(
        "{station} reads a log, try again later",
        "The autopilot serves one download at a time.",
        "Wait until that station has finished.",
    ),
    _warn(
        "another station reads a log, try again later",
        "The autopilot serves one download at a time.",
        "Wait until that station has finished.",
    ),
    _warn(
        "not before arming, sticks could arm the vehicle",
        "Sticks of a program do not pass while the vehicle is disarmed.",
        "Switch the joystick off, or release the RC override. Use it after the vehicle is armed.",
    ),
    _warn(
        "the vehicle takes it from no station",
        "Such a message moves the estimate, the battery's state or the traffic that the autopilot flies by.",
        "Stop the module or program that sends it.",
    ),
    _warn("a value in it is no number", "A guided target has a NaN in it.", "Correct the program that sends it."),
    _warn(
        "too many requests, wait some seconds",
        "A station without authority may ask so much a second, so that the commander's telemetry stays.",
        "Wait, or ask after you have control.",
    ),
    *(
        _warn(
            f"{reason.value}",
            "The gate refuses the frame for this reason.",
            "'handover policy' says what passes, and for which station.",
        )
        for reason in (
            GateReason.RAN_BEFORE,
            GateReason.SPOOFED_VEHICLE,
            GateReason.SPOOFED_STATION,
            GateReason.UNKNOWN_MESSAGE,
            GateReason.OTHER_TARGET,
            GateReason.LIVENESS_NOT_COMMANDER,
            GateReason.SITUATION,
        )
    ),
)

_COMMAND_LIMITS: Final = (
    _warn(
        "where it leads is not known",
        "The aircraft would fly after another system, which the companion cannot judge.",
        "Fly to places instead.",
    ),
    _warn(
        "a return keeps the speed that its energy is calculated with",
        "The aircraft returns or lands.",
        "To fly at another speed choose another mode first.",
    ),
    _warn(
        "slower than the {number} m/s that the energy is calculated with",
        "It would climb or descend too slowly.",
        "Send a higher speed.",
    ),
    _warn(
        "it would set MIN_GROUNDSPEED, which also applies to a return",
        "It changes a parameter that a return is flown by.",
        "Send an airspeed, without a throttle.",
    ),
    _warn(
        "it would set TRIM_THROTTLE, which also applies to a return",
        "It changes a parameter that a return is flown by.",
        "Send an airspeed, without a throttle.",
    ),
    _warn(
        "too many commands at once", "Ten commands were judged within two seconds.", "Wait two seconds. Send it again."
    ),
)

_LIMITS: Final = (
    _warn("leaves coverage {where}", "The way leads out of every zone.", "Choose a target inside the zones."),
    _warn("leads out of coverage", "The target is in no zone.", "Choose a target inside the zones."),
    _warn(
        "leads out of coverage (item {number})", "This item of the mission is in no zone.", "Plan it inside the zones."
    ),
    _warn("breaks the geofence {where}", "The way leaves the geofence.", "Choose a target inside the geofence."),
    _warn(
        "climbs above the fence's ceiling of {number} m",
        "The target is higher than the geofence allows.",
        "Choose a lower target.",
    ),
    _warn(
        "{energy}", "The battery does not last for the way and the return, with the reserve.", "Choose a nearer target."
    ),
    _warn(
        "coverage cannot be judged: internal fault",
        "A part of the companion failed.",
        "Send it again after 10 s if you mean it, or RTL. Then end the flight and tell us.",
    ),
    _warn(
        "energy cannot be judged: internal fault",
        "A part of the companion failed.",
        "Send it again after 10 s if you mean it, or RTL. Then end the flight and tell us.",
    ),
    _warn(
        "fence cannot be judged: internal fault",
        "A part of the companion failed.",
        "Send it again after 10 s if you mean it, or RTL. Then end the flight and tell us.",
    ),
    _warn(
        "no return site is inside the fence",
        "A return could go to no place inside the geofence.",
        "Plan a rally point inside the geofence.",
    ),
    _warn(
        "where it leads is not known", "The companion cannot judge where the command leads.", "Fly to places instead."
    ),
)

_LIFTS: Final = (
    _warn(
        "To insist, send it again after {seconds} s, or type 'handover override {limit_name}'",
        "The same command passes if its operator insists.",
        "Wait this time without sending it. Then send it once, within 30 s. Or type the command.",
    ),
    _warn(
        "To lift it, type 'handover override {limit_name}'",
        "Only the typed command lifts this refusal.",
        "Type the command at the commander if you mean it.",
    ),
)

_CONTROL: Final = (
    _warn("only the commander can release", "A station without authority wanted to release it.", NOTHING),
    _warn(
        "only the commander can ask for another station",
        "A station without authority wanted to pass it on.",
        "Request control for your own station.",
    ),
    _warn("the transfer that was asked about is over", "The answer came after the end of the handover.", NOTHING),
    _warn(
        "the commander may come back after the restart",
        "The companion was started again some seconds ago.",
        "Wait some seconds, then ask again.",
    ),
    _warn("there is no commander to follow", "No station has had authority in this flight.", "Watch the aircraft."),
    _warn(
        "too soon: again in {seconds} s",
        "The last handover to this station has just failed.",
        "Wait this time, then ask again.",
    ),
    _warn("unknown station", "The vehicle's file does not name this station.", "Add it to the vehicle's file."),
    _warn("another handover is under way", "A handover comes first.", "Wait until it is over, then ask again."),
    _warn(
        "no position of the aircraft",
        "There is no fresh position, so no zone is known to hold it.",
        "Wait for the position.",
    ),
    _warn(
        "the aircraft is outside the zone of {station}",
        "In flight a station commands only inside its zone.",
        "Wait until the aircraft is in that zone.",
    ),
    _warn("parameters must be numbers", "The program's request is not valid.", "Update the program."),
    _warn("action and takeover must be 0 or 1", "The program's request is not valid.", "Update the program."),
    _warn(
        "release with takeover: the request of an old ground station?",
        "The program speaks an older version of the standard.",
        "Update the program, or use 'handover request'.",
    ),
    _warn("system id must be 0 to 255", "The program's request is not valid.", "Update the program."),
    _warn("{cure}", "The station cannot take the aircraft. The reason has its own row.", "Do what that row says."),
)

_STREAMS: Final = (
    _warn(
        "Handover: {stream}: not in control",
        "Sticks or setpoints of this station are refused.",
        "End them before a handover: they stay refused after it.",
    ),
    _warn(
        "Handover: {stream}: end it before handover",
        "The sticks or setpoints stay refused after a handover.",
        "Release the sticks, or stop the stream for 3 s.",
    ),
    _warn(
        "Handover: {stream}: stop it for 3 s first",
        "They ran before this station had authority.",
        "Release the sticks, or stop the stream for 3 s.",
    ),
    _warn(
        "Handover: it ran before you had control",
        "The sticks or setpoints are old, so they are refused.",
        "Release the sticks, or stop the stream for 3 s.",
    ),
    Sentence("Handover: {stream}: obeyed from now on", _ADVISORY, "The old sticks have ended. New ones count."),
    Sentence("Handover: {stream}: it has ended", _ADVISORY, "The sticks or setpoints have ended."),
    _warn(
        "{stream} refused: this station does not command. It will be refused after a handover, too, until it is "
        "{ended}: end it now.",
        "The same at a station with more room.",
        "Do what the sentence says.",
    ),
    _warn(
        "{stream} has been running since before this station had control: still refused, until it is {ended}.",
        "The same at a station with more room.",
        "Do what the sentence says.",
    ),
    Sentence(
        "{stream} has ended: what this station sends from now on is obeyed.",
        _ADVISORY,
        "The old sticks have ended. New ones count.",
    ),
    Sentence(
        "{stream} has ended: nothing of it is left for a handover.", _ADVISORY, "The sticks or setpoints have ended."
    ),
)

GROUPS: Final = (
    Group("gate", "Refusals", "At the station that sent the command. Each reason has its row below.", _SENTENCES),
    Group("gate_why", "Why the gate refuses", "The reasons in 'COMMAND refused: REASON'.", _WHY, whole=False),
    Group(
        "command_limit",
        "Why a command is refused in flight",
        "The reasons in 'COMMAND refused: REASON'.",
        _COMMAND_LIMITS,
        whole=False,
    ),
    Group(
        "limit",
        "Limits that a command would leave",
        "The reasons in 'COMMAND refused: REASON. To insist, ...'.",
        _LIMITS,
        whole=False,
    ),
    Group("lift", "How to insist", "The end of a refusal that the commander can lift.", _LIFTS, whole=False),
    Group("control", "Why control is denied", "The reasons in 'Control denied: REASON'.", _CONTROL, whole=False),
    Group("streams", "Sticks and setpoints", "At the station that sends them.", _STREAMS),
)
