# SPDX-License-Identifier: GPL-3.0-or-later

"""The guard's texts: reasons against arming, and what it does in flight. Each begins with `HNDO: `."""

from __future__ import annotations

from typing import Final

from mavproxy_handover.core.common.levels import Level
from reference.sentences.row import NOTHING, Group, Sentence

__all__ = ["GROUPS"]

_INFO, _ADVISORY, _WARNING, _EMERGENCY = Level
_ONE_GUARD: Final = "Delete one of the two scripts from the card. Reboot the autopilot."
_SCRIPT: Final = "Land. Remove the other script from the card."
_LOSS: Final = "Authority is missing. "
_TELL: Final = "Install the guard again and reboot. If it comes again, tell us."


def _row(template: str, level: Level, meaning: str, action: str = NOTHING) -> Sentence:
    return Sentence(template, level, meaning, action)


def _loss(end: str, level: Level, meaning: str, action: str = NOTHING) -> Sentence:
    return Sentence(f"HNDO: {{loss}}{end}", level, f"{_LOSS}{meaning}", action)


_ARMING: Final = (
    _row(
        "no lease from companion",
        _WARNING,
        "The guard has never heard the companion.",
        "Start the companion. Check SERIALx_PROTOCOL 2 and the baud rate.",
    ),
    _row(
        "no station has authority", _WARNING, "The companion is there, and no station commands.", "Bring the parent up."
    ),
    _row("authority is being recovered", _WARNING, "The companion was started again.", "Wait some seconds."),
    _row("lease lost", _WARNING, "The companion was heard before, and is not heard now.", "Check companion and cable."),
    _row(
        "companion is older, update it",
        _WARNING,
        "Guard and companion are of different releases.",
        "Install the same release on both.",
    ),
    _row(
        "guard is older, update it",
        _WARNING,
        "Guard and companion are of different releases.",
        "'handover guard CARD --force'. Reboot the autopilot.",
    ),
    _row("two guards run, remove one script", _WARNING, "The card holds the guard twice, under two names.", _ONE_GUARD),
    _row(
        "scripting restarted, reboot",
        _WARNING,
        "Scripting was restarted, and the guard is not sure of its place.",
        "Reboot the autopilot.",
    ),
    _row("guard fault, see messages", _WARNING, "An error in the guard's script.", f"Read 'HNDO: fault ...'. {_TELL}"),
    _row("guard stopped while armed", _WARNING, "The guard's script has ended in flight.", "Reboot the autopilot."),
    _row("another script tampers", _WARNING, "Another script takes the guard's messages.", _SCRIPT),
    _row("MAVLink rx taken by a script", _WARNING, "Another script reads the guard's messages.", _SCRIPT),
    _row(
        "lease for another guard or start",
        _WARNING,
        "Leases come that were made for another start of the guard: a recording, or a second guard.",
        "Use one companion, and one copy of the script.",
    ),
    _row(
        "lease refused, {objection}",
        _WARNING,
        "A lease came that does not count. The reason follows.",
        "Do what the row of the reason says.",
    ),
    _row(
        "{guard_vehicle} not supported",
        _WARNING,
        "The guard does not know this kind of vehicle.",
        "Fly it without this system.",
    ),
)

_OBJECTIONS: Final = (
    *(
        _row(text, _WARNING, "The lease does not carry the tag of the guard's key.", "Put the same key on both sides.")
        for text in ("no tag", "tag", "key file")
    ),
    *(
        _row(
            text, _WARNING, "The lease is a copy of an earlier one.", "Look for a second companion, or for a recording."
        )
        for text in ("old nonce", "nonce", "sequence", "epoch")
    ),
    _row(
        "channel {number} not {value}", _WARNING, "HNDO_CHAN names another port.", "Set HNDO_CHAN to the first number."
    ),
    _row(
        "channel {number}",
        _WARNING,
        "The lease came by another port than the ones before.",
        "Look for a second companion.",
    ),
    _row("system {number}", _WARNING, "The sender has another system id.", "Look for another companion on that port."),
    _row("component {number}", _WARNING, "The sender has another component id.", "Set HNDO_COMPID to 191."),
    _row(
        "state {number}",
        _WARNING,
        "The lease has a state that the guard does not know.",
        "Install the same release on both.",
    ),
    *(
        _row(text, _WARNING, "The lease is damaged or not for this vehicle.", "Check the cable.")
        for text in ("CRC", "length", "target")
    ),
)

_TEXTS: Final = (
    _row("HNDO: handover guard {number} loaded", _INFO, "The guard runs."),
    _row("HNDO: handover guard {number} loaded, key", _INFO, "The guard runs, and takes only leases with its key."),
    _row(
        "HNDO: lease live, {number} commands",
        _INFO,
        "The guard hears the companion, and the station with this system id commands.",
    ),
    _row("HNDO: lease live, nobody commands", _INFO, "The aircraft crosses a gap that its mission declares."),
    _row(
        "HNDO: could not add param table",
        _WARNING,
        "Another script uses the guard's table of parameters. The guard does not run.",
        "Remove the other script.",
    ),
    _row(
        "HNDO: could not add param {parameter}",
        _WARNING,
        "Another script uses the guard's table of parameters. The guard does not run.",
        "Remove the other script.",
    ),
    _row("HNDO: guard disabled", _WARNING, "HNDO_ENABLE is 0: the guard does nothing.", "Set it to 1."),
    _row(
        "HNDO: lease refused, {objection}",
        _WARNING,
        "A lease came that does not count. The reason follows.",
        "Do what the row of the reason says.",
    ),
    _row(
        "HNDO: strange lease refused, {objection}",
        _WARNING,
        "A lease came that does not count. The reason follows.",
        "Do what the row of the reason says.",
    ),
    *(
        _row(f"HNDO: {text}", _WARNING, meaning, action)
        for text, meaning, action in (
            (
                "companion is older, update it",
                "Guard and companion are of different releases.",
                "Install the same release on both.",
            ),
            (
                "guard is older, update it",
                "Guard and companion are of different releases.",
                "'handover guard CARD --force'.",
            ),
            (
                "lease for another guard or start",
                "Leases come that were made for another start of the guard.",
                "Use one companion, and one copy of the script.",
            ),
            ("two guards run, remove one script", "The card holds the guard twice, under two names.", _ONE_GUARD),
            ("scripting restarted, reboot", "Scripting was restarted.", "Reboot the autopilot."),
            ("MAVLink rx taken by another script", "Another script reads the guard's messages.", _SCRIPT),
            ("MAVLink rx was reset by a script", "Another script has cleared the guard's messages.", _SCRIPT),
            (
                "no arming authorisation available",
                "Other scripts hold all that ArduPilot has. The firmware itself refuses arming then.",
                "Remove the other script.",
            ),
            ("handover.key cannot be used", "The key on the card is no key.", "'handover guard CARD --key FILE'."),
            (
                "{guard_vehicle} not supported",
                "The guard does not know this kind of vehicle.",
                "Fly it without this system.",
            ),
            ("no answer on channel {number}", "The guard cannot send its status by this port.", _TELL),
            (
                "{parameter} was changed, set again",
                "Another program changes the station that the autopilot obeys.",
                "Look for the other program.",
            ),
            (
                "{parameter} cannot be set",
                "The autopilot does not take the commander's system id.",
                "Look at the parameter.",
            ),
            (
                "scripting command of {number}/{value} denied",
                "A station sent a command to scripting, and authority is missing.",
                NOTHING,
            ),
            (
                "DO_AUX of {number}/{value} denied",
                "A station sent an auxiliary function, and authority is missing.",
                NOTHING,
            ),
            ("fault, no entry {number}/{value}", "An error in the guard's script.", _TELL),
            ("fault {error}", "An error in the guard's script. It goes on.", f"Land. {_TELL}"),
        )
    ),
    _row(
        "HNDO: MAVLink rx was in use before",
        _ADVISORY,
        "Another script reads MAVLink messages too.",
        "Remove scripts that you do not need.",
    ),
    _row(
        "HNDO: no SmartRTL here, HNDO_ACTION 2 is RTL",
        _ADVISORY,
        "This firmware has no SmartRTL. The guard orders RTL.",
    ),
    _loss("", _ADVISORY, "The guard orders the way home.", "Watch the aircraft."),
    _loss(", {rung}", _EMERGENCY, "The guard has ordered this mode.", "Watch the return. Bring a station up."),
    _loss(
        ", {loss_why}, {rung}",
        _EMERGENCY,
        "The guard has ordered this mode, for the reason before it.",
        "Watch the return. Bring a station up.",
    ),
    _loss(
        ", {rung} refused",
        _EMERGENCY,
        "The autopilot does not take this mode. The guard tries the next one.",
        "Take the aircraft by radio control.",
    ),
    _loss(
        ", disarmed",
        _EMERGENCY,
        "The guard has stopped the motors on the ground.",
        "Bring the companion up before arming.",
    ),
    _loss(", in {rung}", _ADVISORY, "The aircraft comes home already. The guard watches.", "Watch the aircraft."),
    _loss(", AUTO, landing", _ADVISORY, "The mission lands already. The guard watches.", "Watch the aircraft."),
    _loss(", in AUTO, landing", _ADVISORY, "The mission lands already. The guard watches.", "Watch the aircraft."),
    _loss(
        ", pilot flies",
        _ADVISORY,
        "A pilot flies by radio control. The guard does not overrule a pilot.",
        "The pilot lands.",
    ),
    _loss(", failsafe acts", _ADVISORY, "A failsafe of the autopilot acts. The guard lets it.", "Watch the aircraft."),
    _loss(
        ", taking off",
        _ADVISORY,
        "The aircraft takes off. The guard waits until it is high enough.",
        "Watch the aircraft.",
    ),
    _loss(
        ", traffic avoidance", _ADVISORY, "The autopilot avoids other traffic. The guard waits.", "Watch the aircraft."
    ),
    _loss(
        ", {undone}",
        _WARNING,
        "Another mode was chosen. The guard has ordered the way home again.",
        "A pilot needs a live radio, and the switch. Else watch the return.",
    ),
    _row("HNDO: authority back", _ADVISORY, "A station commands again.", "The commander chooses a mode."),
    _row(
        "HNDO: authority back, staying in {rung}",
        _ADVISORY,
        "A station commands again. The aircraft still comes home.",
        "The commander chooses a mode, or 'handover resume'.",
    ),
)

_UNDONE: Final = tuple(
    _row(text, _WARNING, meaning)
    for text, meaning in (
        ("command undone", "A command has chosen another mode."),
        ("script undone", "A script has chosen another mode."),
        ("DDS command undone", "A ROS program has chosen another mode."),
        ("mode change undone", "A source that is not known has chosen another mode."),
        ("switch undone, rx taken", "A switch has chosen the mode. The guard cannot tell whether by a pilot."),
        ("switch undone, rx flooded", "A switch has chosen the mode. The guard cannot tell whether by a pilot."),
        ("DO_AUX of {number}/{value} undone", "A station's auxiliary function has chosen another mode."),
        ("switch undone, no radio", "A switch has chosen the mode, and no radio is heard."),
        ("switch undone, {parameter} 0", "A switch has chosen the mode. With this parameter 0 no pilot is believed."),
    )
)

GROUPS: Final = (
    Group("guard", "The guard in flight", "At every program that shows the autopilot's texts.", _TEXTS),
    Group("guard_arming", "Why the guard refuses arming", "In the autopilot's 'Arm: ...' and 'PreArm: ...'.", _ARMING),
    Group("objection", "Why a lease is refused", "After 'lease refused,'.", _OBJECTIONS, whole=False),
    Group("undone", "Which change of mode the guard has undone", "The end of such a text.", _UNDONE, whole=False),
)

#: the values of these rows
WORDS: Final = {
    "loss": "no authority|lease lost|no lease",
    "rung": "RTL|SMART_RTL|AUTO_RTL|LAND|QRTL|QLAND|LOITER_ALT_QLAND|AUTOLAND|CIRCLE|LOITER|[A-Z][A-Z_]+",
    "loss_why": "landing left|radio gone|held 10 s|taken off",
    "guard_vehicle": r"Rover|Tracker|Sub|Blimp|Heli|vehicle type \S+",
}
