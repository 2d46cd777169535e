# SPDX-License-Identifier: GPL-3.0-or-later

"""The check before flight: guard, parameters and firmware, and what it says of each."""

from __future__ import annotations

from typing import Final

from mavproxy_handover.core.common.levels import Level
from reference.sentences.row import NOTHING, Group, Sentence

__all__ = ["GROUPS"]

_SET: Final = "Set this parameter: 'handover doctor' names the value. Then reboot the autopilot."
_GUARD: Final = "The guard would not act as it should."
_HOME: Final = "A return of the autopilot would not go to the return site."
_ENERGY: Final = "The energy or the height of a return was counted for another value."
_FENCE: Final = "The autopilot would not keep the plan's geofence as it was checked."
_BATTERY: Final = "The autopilot's own failsafe of the battery would not help."
_MISSION: Final = "The mission would not be flown as it was checked."
_OBSERVERS: Final = "Stations that do not command would see no telemetry."


def _warn(template: str, meaning: str, action: str = _SET) -> Sentence:
    return Sentence(template, Level.WARNING, meaning, action)


_SENTENCES: Final = (
    _warn(
        "preflight: {preflight}",
        "The check before flight has a finding, told to the station that starts.",
        "Do what the row of the finding says. 'handover doctor' shows all.",
    ),
    _warn(
        "preflight: {count} more are in the companion's journal",
        "There are more findings than are told.",
        "'handover doctor'.",
    ),
    _warn("{guard_lacks}", "The guard does not fit this companion.", "Do what the row of the reason says."),
    Sentence(
        "Preflight WARNING: {preflight}",
        Level.INFO,
        "The check before flight has a finding.",
        "Do what the row of the finding says.",
    ),
    Sentence("Preflight: guard, parameters and firmware fit", Level.INFO, "The check before flight has no finding."),
)

_GUARD_LACKS: Final = (
    _warn(
        "the guard does not answer the lease",
        "No guard, a guard of another vehicle, or one with another key.",
        "'handover guard CARD --check'. Set SCR_ENABLE to 1, and reboot.",
    ),
    _warn(
        "the guard is older than this companion: put the handover_guard.lua of this release on the card",
        "The card has the script of an older release.",
        "'handover guard CARD --force'. Reboot the autopilot.",
    ),
    _warn(
        "the guard is newer than this companion: install the same release on both",
        "The card has the script of a newer release.",
        "Install the same release on both.",
    ),
    _warn(
        "the guard has no key: put handover.key on its card, beside the script",
        "Only the companion has a key.",
        "'handover guard CARD --key FILE'. Reboot the autopilot.",
    ),
    _warn(
        "the guard's status does not fit guard_key: its handover.key is another key, or a stranger sends it",
        "The card has another key, or another device sends on that wire.",
        "'handover guard CARD --key FILE' with the file of guard_key.",
    ),
    _warn(
        "the guard has a key: set guard_key in the vehicle's configuration",
        "Only the card has a key.",
        "Set guard_key in [vehicle], or delete handover.key from the card.",
    ),
    _warn(
        "two guards answer: remove one of the two scripts from the card",
        "The card holds the guard twice.",
        "Delete one of them. Reboot the autopilot.",
    ),
)

_FINDINGS: Final = (
    _warn(
        "{name} of an onboard program is not used: {parameter} is {number}",
        "The vehicle's file lets a program send this sensor message, and the autopilot ignores it.",
        "Set the parameter if the sensor is meant, or remove the message from [[onboard]].",
    ),
    _warn(
        "{parameter} is {number}, and no onboard program may send {name}",
        "The autopilot expects this sensor by MAVLink, and the vehicle's file lets no program send it.",
        "Name the message in [[onboard]], or pass over this if another port of the autopilot has the sensor.",
    ),
    _warn(
        "{parameter} is {number}, and no onboard program may send {name} or its like",
        "The autopilot expects this sensor by MAVLink, and the vehicle's file lets no program send it.",
        "Name the message in [[onboard]], or pass over this if another port of the autopilot has the sensor.",
    ),
    _warn(
        "{name} of an onboard program moves {autopilot}",
        "The autopilot flies by this message of an onboard program. The parameters say where.",
        "Check the sensor on the ground before each flight.",
    ),
    _warn(
        "line to the autopilot: room for {number} bytes/s at {baud} baud, limits sum to {count} ({claims})",
        "Feeds, onboard programs and payload stations may send more than their half of the serial line. The rest is "
        "dropped.",
        "Raise the baud rate, or lower bytes_per_s in [[onboard]] and rtk_bytes_per_s in [feeds].",
    ),
    _warn(
        "PLND_STRICT 2: without a landing target it hovers until the battery is empty",
        "A return would not end if the landing target is not seen, or does not pass.",
        "Set PLND_STRICT to 0 or 1.",
    ),
    _warn(
        "scripting is off: the guard does not run", "No guard protects the flight.", "Set SCR_ENABLE to 1, and reboot."
    ),
    _warn(
        "the guard is not loaded; 'handover guard' puts it on the SD card",
        "No guard protects the flight.",
        "'handover guard CARD'. Reboot the autopilot.",
    ),
    _warn("the guard is switched off", "HNDO_ENABLE is 0.", "Set it to 1."),
    _warn("{guard_lacks}", "The guard does not fit this companion.", "Do what the row of the reason says."),
    _warn(
        "the guard takes leases from any port: any program that reaches one can send them",
        "HNDO_CHAN is below 0.",
        "Set HNDO_CHAN to the port of the companion.",
    ),
    _warn("{parameter} is {number}, but this companion is on channel {value}", _GUARD),
    _warn("{parameter} is {number} and the guard is silent here: is that the port of this companion?", _GUARD),
    _warn("{parameter} is {number}, must be {value}", _GUARD),
    _warn("{parameter} is {seconds} s: a few lost leases (there are five a second) end the flight", _GUARD),
    _warn(
        "{parameter} is {seconds} s, not shorter than {other_parameter}: the guard would not be the first to act",
        _GUARD,
    ),
    _warn(
        "{parameter} is {seconds} s: the guard acts while the companion still looks for a partner, up to {value} s",
        _GUARD,
    ),
    _warn("{parameter} is {seconds} s: the guard acts while the companion recovers from a restart ({value} s)", _GUARD),
    _warn("{parameter} is {number}: below {value} the guard may be removed in flight", _GUARD),
    _warn(
        "{parameter} is -1: an SD card that is gone or changed is not noticed at arming; set SCR_DEBUG_OPTS to 32 once",
        _GUARD,
    ),
    _warn(
        "{parameter} is 0: the guard believes no pilot then; on a vehicle without radio control set RC_PROTOCOLS 0 "
        "as well",
        "With its radio failsafe off the guard cannot know a pilot.",
    ),
    _warn(
        "{parameter} is 0: the autopilot's GCS failsafe goes on watching one station, also when another commands",
        "After a handover the autopilot would return.",
    ),
    _warn(
        "{parameter} is {seconds} s: too short for a gap of the mission ({value} s), START is refused",
        "The guard would end the flight in the gap.",
    ),
    _warn("{parameter} is {number}: {failsafe_lack}", _HOME),
    _warn(
        "{parameter} is 0: nothing brings the aircraft home if companion and guard both fail",
        "The third line of defence is off.",
    ),
    _warn(
        "{parameter} is {seconds} s: the autopilot returns before a partner can take over ({value} s)",
        "The autopilot's GCS failsafe is too fast.",
    ),
    _warn(
        "{parameter} is {number}: bit 1 lets a mission go on without a ground station",
        "The third line of defence is off.",
    ),
    _warn("{parameter} is {number}: bit 4 is for flights with a safety pilot at hand", "The failsafe would not act."),
    _warn("{parameter} is {number}: a return goes home if the return site is farther away", _HOME),
    _warn("{parameter} is 1: the autopilot does not answer observers", _OBSERVERS),
    _warn("{parameter} is {number}: bit 0 makes the autopilot not answer observers", _OBSERVERS),
    _warn("{parameter} is 0: the guard cannot refuse arming, only disarm", _GUARD),
    _warn("{parameter} is -1: the guard cannot refuse arming, only disarm", _GUARD),
    _warn(
        "{parameter} is 0: it is always armed and takes off by a change of mode; the guard cannot refuse arming", _GUARD
    ),
    _warn("a return does not land: {return_lacks}; START is refused", "An aircraft with wings would circle for ever."),
    _warn(
        "{heights}; START is refused",
        "Items would be flown at other heights than those that were checked.",
        "Plan heights above home, or do what the reason says.",
    ),
    _warn(
        "{autopilot}: its modes are taken for those of another aircraft; START is refused",
        "The autopilot is another kind of vehicle than it says.",
    ),
    _warn(
        "firmware {number} is {age} that this was made for, {value}",
        "This firmware was not tested.",
        "Install a firmware that was tested.",
    ),
    _warn(
        "{autopilot} is neither ArduCopter nor ArduPlane: START is refused, and the guard refuses arming",
        "The autopilot is of a kind that is not supported.",
        NOTHING,
    ),
    _warn(
        "the autopilot answers no request for parameters: nothing could be checked",
        "No finding means nothing now.",
        "Check the line to the autopilot: 'handover doctor'.",
    ),
    _warn("{low}", "The mission may lead into the ground.", "Plan higher."),
    _warn(
        "{item} above terrain: the mission has no heights of the ground, so its heights above home are not known",
        "Geofence and energy are judged without them.",
        "Bring the heights of the ground (key 'terrain').",
    ),
    _warn("{parameter} is 0: item {number} (DO_GRIPPER) moves no gripper, and the load stays on board", _MISSION),
    _warn("{parameter} is {number} degrees/s: a circle of the mission {circle} ({value} were counted)", _MISSION),
    _warn("{parameter} is {number}: a return ends hovering at {metres} m, not landed", _HOME),
    _warn("{parameter} is {number}: {value} m/s is flown, handover check and START count {most} m/s", _ENERGY),
    _warn("{parameter} is {number}: a return climbs at {value} m/s, and the energy of {most} m/s is counted", _ENERGY),
    _warn(
        "{parameter} is {number}: a return comes down at {value} m/s, and the energy of {most} m/s is counted", _ENERGY
    ),
    _warn("{parameter} is {number}: it lands at {value} m/s, and the energy of {most} m/s is counted", _ENERGY),
    _warn(
        "{parameter} is {number}: it speeds up and brakes at {value} m/s2, and the energy of {most} m/s2 is counted",
        _ENERGY,
    ),
    _warn(
        "{parameter} is {number}: it lands slowly from {metres} m on, and the energy is counted from {value} m", _ENERGY
    ),
    _warn(
        "{parameter} is {number} ({autopilot}): a station's RC override switches it in flight, which "
        "DO_AUX_FUNCTION may not",
        "A channel of the radio switches a safeguard.",
    ),
    _warn(
        "{parameter} is {number}: a return flies around obstacles, and the energy and coverage of that are not counted",
        _ENERGY,
    ),
    _warn(
        "{parameter} is {number}: a return is flown at {value} m/s, handover check and START count the mission's "
        "cruise speed",
        _ENERGY,
    ),
    _warn("{parameter} is {metres} m, above FENCE_ALT_MAX: a return is flown at {value} m", _ENERGY),
    _warn(
        "{parameter} is {metres} m: a return climbs by so much first, and the energy of that is not counted", _ENERGY
    ),
    _warn(
        "{parameter} is {seconds} s: a return waits this long above its site, but the energy of {value} s is counted",
        _ENERGY,
    ),
    _warn(
        "{parameter} is {metres} m: a return from the route's {value} m climbs above FENCE_ALT_MAX first, {most} m",
        _FENCE,
    ),
    _warn("{parameter} is {metres} m: QRTL from afar comes in at {value} m, above FENCE_ALT_MAX, {most} m", _FENCE),
    _warn(
        "{parameter} is {number}: bit 4 has a return climb straight on to its whole height, whatever RTL_CLIMB_MIN is",
        _ENERGY,
    ),
    _warn(
        "{parameter} is {number}: a return keeps a height above the ground, not the one above home that is judged",
        _ENERGY,
    ),
    _warn(
        "{parameter} is {number}: without bit 5 the failsafes land it out of hover where it is, not at the return site",
        _HOME,
    ),
    _warn(
        "{parameter} is {number}: bits 1 and 2 make a plane's of take-off and landing; the mission was checked "
        "with those "
        "of a QuadPlane",
        _MISSION,
    ),
    _warn("{parameter} is 1: where home is nearer a return goes there, not to the return site", _HOME),
    _warn("{parameter} is 0: the autopilot does not measure the battery", _BATTERY),
    _warn("{parameter} is 0: nothing brings the aircraft home when the battery is low", _BATTERY),
    _warn("{parameter} is 0, and {battery_name}_LOW_MAH is 0: the battery's failsafe never acts", _BATTERY),
    _warn("{parameter} is {number}: never acts after {battery_name}_FS_LOW_ACT {value}", _BATTERY),
    _warn("{parameter} is 0: the plan's geofence is stored, and not kept to", _FENCE),
    _warn("{parameter} is {number}: without bit 2 the plan's geofence is stored, and not kept to", _FENCE),
    _warn("{parameter} is 0: leaving the geofence is reported, and nothing is done", _FENCE),
    _warn(
        "{parameter} is 0, and DID_OPTIONS wants Remote ID for arming: arming is refused",
        "The autopilot does not arm: Remote ID is off, and its options want it for arming.",
        "Set DID_ENABLE to 1, or take bit 0 out of DID_OPTIONS.",
    ),
    _warn(
        "{parameter} is -1, and DID_CANDRIVER is 0: Remote ID is enabled and has no transponder",
        "The autopilot has Remote ID switched on, and knows no transponder.",
        "Set DID_MAVPORT to the serial port of the transponder, or DID_CANDRIVER to its CAN driver.",
    ),
    _warn(
        "{parameter} is {number}: bit 1 makes one area of those to stay inside; the plan was checked against each",
        _FENCE,
    ),
    _warn("{parameter} is {metres} m, and the route goes {value} m from home: take bit 1 out of FENCE_TYPE", _FENCE),
    _warn("{parameter} is {metres} m, and the route climbs to {value} m", _FENCE),
)

_FAILSAFES: Final = (
    *(
        _warn(text, _HOME)
        for text in (
            "SMART_RTL flies back the way it came, not to the return site",
            "AUTO_RTL follows the mission's landing sequence, and does not go to the return site",
            "the return goes straight to the mission's landing sequence, not to the return site",
            "AUTOLAND lands at home, not at the return site",
            "circles at the fence's own return point, and does not go to the return site",
            "the failsafes let a mission go on without radio and ground station",
            "the failsafes fly the mission on",
            "flies on straight ahead, by hand, without a radio",
            "SMART_RTL is no mode of ArduPlane",
            "ArduPlane knows no such action: nothing is done",
            "it acts only in AUTO, and nothing brings the aircraft home from LOITER or GUIDED",
        )
    ),
    *(
        _warn(text, "The aircraft would come down where it is.")
        for text in (
            "stops the motors in the air",
            "releases the parachute in the air",
            "the failsafes release the parachute",
            "glides without a motor, wherever it is",
        )
    ),
    _warn("CONTINUE, and AUTO after a return, begin the mission again", _MISSION),
)

_BOX: Final = (
    _warn(
        'sends layout {layout}, not {other_layout} (set layout = "{name}" in [position])',
        "The box sends another record than the vehicle's file says.",
        "Write what the message says. Load the module again.",
    ),
    _warn(
        "layout {layout} not recognised yet (the autopilot needs a position; or turn or move the aircraft)",
        "The records fit every known layout, or are too few.",
        "Wait for the GPS, or turn the aircraft away from north.",
    ),
    _warn(
        "sends neither layout {layout} nor another known one (compare with docs/position-box.md)",
        "The values fit no known layout.",
        "Compare them with [Position box](../position-box.md).",
    ),
    _warn("{box_state}", "The box does not count now. The reason has its own row.", "Do what that row says."),
)

_BOX_STATES: Final = (
    _warn("not heard yet", "No record has come since the start.", "Check the cable and the address of the box."),
    _warn(
        "not heard yet ({error})", "No record has come since the start.", "Check the cable and the address of the box."
    ),
    _warn("silent", "No record comes any more.", "Check the cable of the box."),
    _warn("silent ({error})", "No record comes any more.", "Check the cable of the box."),
    _warn("has no position", "The box itself has no position.", "Wait, or check its antenna."),
    _warn("{seconds} s late (limit {value} s)", "The records are old.", "Check the line of the box."),
    _warn(
        "cannot be checked by the autopilot's position",
        "The autopilot has no position to compare.",
        "Wait for the GPS.",
    ),
    _warn("and autopilot {metres} m apart (limit {value} m)", "The two positions differ.", "Find which one is wrong."),
    _warn(
        "and autopilot {metres} m apart in height (limit {value} m)",
        "The two heights differ.",
        "Find which one is wrong.",
    ),
    _warn(
        "and autopilot {number} m/s apart in speed (limit {value} m/s)",
        "The two speeds differ.",
        "Find which one is wrong.",
    ),
)

_BOX_NEWS: Final = (
    _warn("{box}", "As the row of the reason says."),
    _warn(
        "{box}: no position is used", "The box was the source of the position, or makes it doubtful. No zone is known."
    ),
    _warn("{box} ({count} records of another layout in flight)", "Some records in flight had another layout."),
    _warn(
        "{box} ({count} records of another layout in flight): no position is used",
        "Some records in flight had another layout. No zone is known.",
    ),
)

_BATTERIES: Final = (
    _warn(
        "{pack} says that {number} Wh are left after {value} Wh",
        "The battery reports more or much less than before.",
        "Check the battery monitor.",
    ),
    _warn("{pack} does not say what is left", "The battery reports no remaining energy.", "Check the battery monitor."),
    _warn("{pack} has been silent for {seconds} s", "The battery reports nothing.", "Check its cable."),
    _warn("{pack} counts back in flight", "The battery's counter went back.", "Check the battery monitor."),
    _warn(
        "{pack} counts {number} Wh, its rest voltage {value} V says {most} Wh at most",
        "The counter shows more than the voltage allows.",
        "Charge it fully, or correct BATT_CAPACITY.",
    ),
    _warn(
        "{pack} has {number} V under load: {value} Wh at most",
        "The voltage is low for what the counter shows.",
        "Land in good time.",
    ),
    _warn("{count} of {number} batteries are not heard", "Some batteries report nothing.", "Check their cables."),
    _warn("no battery is heard", "No battery reports anything.", "Check the battery monitor."),
)

_ENERGY_LACKS: Final = (
    _warn(
        "{number} Wh are needed with the reserve, {value} Wh are left",
        "The battery holds less than is needed.",
        "Charge it, or fly a shorter way.",
    ),
    _warn(
        "{number} Wh are needed with the reserve, and what is left is not known",
        "The battery reports no energy.",
        "Check the battery monitor.",
    ),
    _warn(
        "the wind does not let it be flown", "Against the wind the aircraft would not get there.", "Wait for less wind."
    ),
    _warn("internal fault", "The part that counts the energy failed.", "Do not fly. 'handover logs', and tell us."),
    _warn("no [energy] numbers", "The vehicle's file has no [energy].", "Write [energy] into the vehicle's file."),
    _warn("[energy] has no battery_wh", "The vehicle's file does not say what the battery holds.", "Write battery_wh."),
    _warn(
        "[energy] has neither {energy_keys}",
        "The vehicle's file does not say what flying costs.",
        "Write one of the two.",
    ),
    _warn("not looked at yet", "The energy is not counted yet.", "Wait a second."),
    _warn("the budget of the mission closes", "The battery lasts again.", NOTHING),
)

_HEIGHTS: Final = (
    _warn(
        "{item}: home is at {metres} m in the plan and at {value} m in the autopilot (allowed: {most} m apart). Plan "
        "heights above home, or home at its height",
        "The plan's home is higher or lower than the autopilot's.",
        "Plan heights above home, or set the plan's home to its height.",
    ),
    _warn(
        "{item} above terrain: TERRAIN_ENABLE is not 1 and there is no range finder. Set it to 1, or plan heights "
        "above "
        "home",
        "The autopilot cannot follow the ground.",
        "Set TERRAIN_ENABLE to 1, or plan heights above home.",
    ),
    _warn(
        "{item} above terrain: the parameters are not read yet", "The check is not complete yet.", "Wait some seconds."
    ),
    _warn("{item}: the autopilot's home is not known yet", "The check is not complete yet.", "Wait for the GPS."),
)

_RETURN_LACKS: Final = (
    _warn(
        "it would never land: the landing sequence of item {number} (DO_LAND_START) comes to no landing",
        "A return follows this sequence and circles for ever.",
        "Plan a landing at its end.",
    ),
    _warn("its parameters are not read yet", "The check is not complete yet.", "Wait some seconds."),
    _warn(
        "it would circle for ever: {missing}",
        "A return of this aircraft does not end in a landing.",
        "Set the parameter, or plan a landing sequence.",
    ),
)

_GAPS: Final = (
    _warn(
        "{gap_name} takes {seconds} s against the wind, its limit is {value} s",
        "The gap takes too long in this wind.",
        "Wait for less wind, or raise the limit in the mission.",
    ),
    _warn(
        "{gap_name} takes for ever in the wind, its limit is {value} s",
        "Against this wind the gap is never crossed.",
        "Wait for less wind.",
    ),
    _warn(
        "without a guard nothing brings the aircraft home out of one", "A gap needs the guard.", "Install the guard."
    ),
    _warn("the guard's parameters are not read yet", "The check is not complete yet.", "Wait some seconds."),
    _warn(
        "the guard has no {parameter}: it knows no gaps", "The guard is too old.", "Install the guard of this release."
    ),
    _warn(
        "{parameter} is {seconds} s, {gap_name} may take {value} s",
        "The guard would end the flight in the gap.",
        "Set HNDO_ALONE_MAX to the longest gap.",
    ),
    _warn(
        "{parameter} is 0: the autopilot's GCS failsafe would end them",
        "The failsafe would act in the gap.",
        "Set HNDO_SYSID_SW to 1.",
    ),
)

GROUPS: Final = (
    Group(
        "preflight_told",
        "The check before flight",
        "At the station that starts, and on the companion's console.",
        _SENTENCES,
    ),
    Group(
        "preflight",
        "Findings of the check before flight",
        "After 'preflight:'. PARAMETER is the parameter to change. The page about parameters explains each.",
        _FINDINGS,
        whole=False,
    ),
    Group(
        "failsafe_lack",
        "Failsafes that lead elsewhere",
        "The end of 'PARAMETER is NUMBER: ...'.",
        _FAILSAFES,
        whole=False,
    ),
    Group("guard_lacks", "Why the guard does not fit", "Also a reason in 'START refused'.", _GUARD_LACKS, whole=False),
    Group("box_news", "The position box in flight", "After 'position box'.", _BOX_NEWS, whole=False),
    Group("box", "The position box", "After 'position box', also in 'START refused'.", _BOX, whole=False),
    Group("box_state", "States of the position box", "After 'position box'.", _BOX_STATES, whole=False),
    Group("battery", "Batteries", "After 'energy:'.", _BATTERIES, whole=False),
    Group("energy", "Energy", "In refusals and warnings about energy.", _ENERGY_LACKS, whole=False),
    Group("heights", "Heights", "In 'START refused: heights: REASON'.", _HEIGHTS, whole=False),
    Group(
        "return_lacks",
        "Returns with wings",
        "In 'START refused: a return does not land: REASON'.",
        _RETURN_LACKS,
        whole=False,
    ),
    Group("gaps", "Gaps", "In 'START refused: gaps: REASON'.", _GAPS, whole=False),
)
