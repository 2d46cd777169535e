# SPDX-License-Identifier: GPL-3.0-or-later

"""The companion's sentences about missions: packages, uploads, and what the autopilot holds."""

from __future__ import annotations

from typing import Final

from mavproxy_handover.core.common.levels import Level
from reference.sentences.row import NOTHING, Group, Sentence

__all__ = ["GROUPS"]

_INFO, _ADVISORY, _WARNING, _EMERGENCY = Level
_SHARE: Final = "'handover share' at the commander."


def _warn(template: str, meaning: str, action: str = NOTHING) -> Sentence:
    return Sentence(template, Level.WARNING, meaning, action)


def _advice(template: str, meaning: str, action: str = NOTHING) -> Sentence:
    return Sentence(template, Level.ADVISORY, meaning, action)


_SENTENCES: Final = (
    _advice(
        "Mission {package} loaded from {source}: written, read back, equal.",
        "The autopilot holds the mission of this package.",
    ),
    _warn(
        "Mission {package} not loaded: {load_failure}. START needs 'handover share'.",
        "The package was not written, or came back differently. START is refused.",
        "Correct the reason. Then 'handover share' again.",
    ),
    _warn(
        "Mission {package} not loaded: {load_failure}. It is tried again every {seconds} s.",
        "The package of the vehicle's file was not written, or came back differently.",
        "Correct the reason. Then wait.",
    ),
    _warn(
        "{station} cleared the mission on the autopilot. {follows}.",
        "The autopilot holds no mission any more.",
        f"Wait, or upload a mission. Or {_SHARE}",
    ),
    _warn(
        "The autopilot holds no mission. {follows}.",
        "The mission was cleared by a program that is not known.",
        f"Wait, or upload a mission. Or {_SHARE}",
    ),
    _advice(
        "The mission of {station} on the autopilot is that of package {package}. START flies it.",
        "A station has uploaded the mission of the package.",
    ),
    _advice(
        "The mission on the autopilot is that of package {package}. START flies it.",
        "The autopilot holds the mission of the package.",
    ),
    *(
        _advice(
            f"The {what}{of} on the autopilot was read back and judged. START flies {flies} ({{items}} items). Zones "
            "and stations stay those of package {package}.",
            "A list that a station wrote on the ground has passed the check.",
            "Check that it is the mission that you want.",
        )
        for what, flies in (("mission", "it"), ("geofence", "the mission within it"))
        for of in ("", " of {station}")
    ),
    *(
        _warn(
            f"The {what}{of} is on the autopilot and {flown} not flown: {{judged}}.{lift} {{remedy}}.",
            "A list that a station wrote on the ground has not passed the check. START is refused.",
            "Correct the reason and upload again. Or 'handover share'.",
        )
        for what, flown in (("mission", "is"), ("geofence", "the mission is"))
        for of in ("", " of {station}")
        for lift in ("", " {lift}.")
    ),
    _warn(
        "The mission does not count any more: it was changed without the companion ({board}). {remedy}.",
        "START or arming read the mission back. Another program has written it, by USB or another port.",
        f"Upload the mission through the companion, or {_SHARE}",
    ),
    _warn(
        "The mission was changed in flight. {follows}.",
        "The upload in flight counted for that flight only.",
        f"Wait, or {_SHARE}",
    ),
    Sentence(
        "mission not loaded: {load_failure}",
        _INFO,
        "The companion's console names why a package was not loaded.",
        "Correct the reason. Then 'handover share' again.",
    ),
    Sentence("Mission '{package}' received from {station}", _INFO, "A whole mission package has arrived."),
    Sentence("Mission package for {station}: sent", _INFO, "The vehicle sends its package to a station that has none."),
    Sentence("Mission package for {station}: the station has it", _INFO, "The station has the vehicle's package."),
    Sentence(
        "Mission package for {station}: no answer",
        _INFO,
        "The station has not answered the package.",
        "Check its program and its link.",
    ),
    Sentence(
        "Mission package for {station}: refused: {reason}",
        _INFO,
        "The station does not take the package.",
        "Update its program.",
    ),
    Sentence(
        "mission loaded, commanders along the route: {stations}",
        _INFO,
        "The route of the loaded mission needs these commanders, in this order.",
    ),
    Sentence(
        "the autopilot no longer holds the mission that was loaded",
        _INFO,
        "The mission does not count any more.",
        f"Upload again, or {_SHARE}",
    ),
    Sentence("mission, return site and geofence written, read back, equal", _INFO, "The autopilot holds all lists."),
    Sentence("mission and return site written, read back, equal", _INFO, "The autopilot holds both lists."),
    Sentence(
        "the plan has no geofence: the autopilot keeps the one that it has ({count} areas)",
        _INFO,
        "The flight is judged by the autopilot's own geofence.",
        "Check that it is the right one.",
    ),
    Sentence(
        "the plan names no cruise speed: flown at {number} m/s, checked at {value}",
        _INFO,
        "The autopilot's own cruise speed counts.",
        "Write a cruise speed into the plan.",
    ),
    Sentence("{station} changes the {list} on the autopilot", _INFO, "A station writes a list of the autopilot."),
    Sentence(
        "{station} changes the {list} on the autopilot. The companion judges it again",
        _INFO,
        "Until it is judged, START is refused.",
        "Wait some seconds.",
    ),
    Sentence(
        "the mission on the autopilot was changed without the companion: {board}",
        _INFO,
        "Another program has written the autopilot's mission or geofence.",
        f"Upload again, or {_SHARE}",
    ),
    Sentence(
        "mission of {items} items on the autopilot read back and judged: START flies it",
        _INFO,
        "A list that a station wrote on the ground has passed the check.",
    ),
    Sentence(
        "{list} on the autopilot is not flown: {judged}",
        _INFO,
        "A list that a station wrote on the ground has not passed the check.",
        "Correct the reason, and upload again.",
    ),
    Sentence(
        "mission of {station} written in flight, read back, equal: {items} items",
        _INFO,
        "The commander has replaced the mission in flight.",
    ),
    Sentence(
        "the mission that is flown was read back: {items} items, not the package's",
        _INFO,
        "After a restart in flight the companion has found another mission than the package's.",
    ),
    Sentence(
        "{list} of {station} rejected: {upload}",
        _INFO,
        "An upload in flight is not flown.",
        "Correct the reason, and upload again.",
    ),
    Sentence(
        "{count} rally points of {station} replace the mission's for this flight",
        _INFO,
        "A return is chosen from these places.",
    ),
    Sentence("mission speed restored: {number} m/s", _INFO, "The aircraft flies at the mission's speed again."),
)

_FOLLOWS: Final = (
    _warn("The package on board is loaded in {seconds} s", "The vehicle's file has a package.", "Wait this time."),
    _warn("The package on board is loaded now", "The vehicle's file has a package.", "Wait some seconds."),
    _warn("START needs a mission or 'handover share'", "No mission is loaded.", "Upload one, or 'handover share'."),
    _warn("START needs 'handover share'", "No mission is loaded.", _SHARE),
)

_REMEDIES: Final = (
    _warn("START needs 'handover share'", "No mission counts.", _SHARE),
    _warn(
        "START needs another mission or 'handover share'",
        "This mission does not count.",
        "Upload another one, or 'handover share'.",
    ),
    _warn("START needs a mission package: 'handover share'", "The vehicle has no zones.", _SHARE),
    _warn(
        "START needs 'handover share'. Or clear the mission: then the package on board is loaded",
        "The vehicle's file has a package.",
        "One of the two.",
    ),
    _warn(
        "START needs another mission or 'handover share'. Or clear the mission: then the package on board is loaded",
        "The vehicle's file has a package.",
        "One of the three.",
    ),
)

_LACKS: Final = (
    _warn("the {list} of {station} is being judged", "A station has just written it.", "Wait some seconds."),
    _warn("{station} cleared it", "A station has cleared the mission.", "Upload one, or 'handover share'."),
    _warn(
        "{station} cleared it. The package on board is loaded within {seconds} s",
        "A station has cleared the mission.",
        "Wait this time.",
    ),
    _warn("it was cleared", "A program has cleared the mission.", "Upload one, or 'handover share'."),
    _warn(
        "it was cleared. The package on board is loaded within {seconds} s",
        "A program has cleared the mission.",
        "Wait this time.",
    ),
    _warn(
        "the {list} waits to be judged: the autopilot has no home yet", "Heights count from home.", "Wait for the GPS."
    ),
    _warn(
        "the {list} of {station} waits to be judged: the autopilot has no home yet",
        "Heights count from home.",
        "Wait for the GPS.",
    ),
    _warn(
        "it was changed without the companion ({board})",
        "Another program has written the mission.",
        "Upload again through the companion, or 'handover share'.",
    ),
    _warn("it was changed in flight", "The upload in flight counted for that flight only.", _SHARE),
    _warn(
        "package {package} was not loaded: {load_failure}",
        "The package was not written, or came back differently.",
        "Correct the reason. Then 'handover share' again.",
    ),
    _warn("{judged}", "A list that a station wrote has not passed the check.", "Correct the reason, and upload again."),
)

_JUDGED: Final = (
    _warn("without a mission package no zones are known", "A mission was uploaded before any package came.", _SHARE),
    _warn(
        "it could not be read back: {failure}",
        "The autopilot does not send its mission.",
        "Check the line. Upload again.",
    ),
    _warn("the aircraft was armed before it was judged", "The check takes some seconds.", "Disarm. Wait. Then START."),
    _warn(
        "the geofence of package {package} was cleared",
        "The package's plan has a geofence.",
        "Upload the geofence again.",
    ),
    _warn("{limits}", "The mission would leave energy, geofence or coverage.", "Change the mission."),
    _warn("internal fault", "A part of the companion failed.", "'handover logs', and tell us."),
    _warn(
        "the first flown item is {mode} (allowed: {mode} first)",
        "A flight begins with a take-off.",
        "Add a take-off as the first item.",
    ),
    _warn(
        "item {number}: {error}",
        "This item cannot be flown or judged. [Missions](../missions.md) lists all.",
        "Change this item.",
    ),
    _warn("{low}", "The mission would lead into the ground.", "Plan higher."),
)

_LOW: Final = (
    _warn(
        "item {number} ({mode}): {metres} m above home, less than {value} m. Plan higher, or bring the heights of the "
        "ground (key 'terrain')",
        "The item is so low that the ground may be in the way.",
        "Plan higher.",
    ),
    _warn(
        "item {number} ({mode}): down to {metres} m below home: into the ground unless that is lower there. Plan "
        "higher, or bring the heights of the ground (key 'terrain')",
        "The item is below home.",
        "Plan higher.",
    ),
)

_LOAD: Final = (
    _warn(
        "{failure}",
        "The autopilot refuses a step of it, or does not answer.",
        "Check the line to the autopilot. Then 'handover share' again.",
    ),
    _warn(
        "{station} changed the {list} meanwhile",
        "A station wrote a list while the package was written.",
        "Wait, then 'handover share' again.",
    ),
    _warn(
        "too late: it has no authority, or START was given",
        "The package came too late.",
        "'handover share' on the ground.",
    ),
    _warn("another package is being read: share it again", "Two packages came at once.", "'handover share' again."),
    _warn(
        "only from the commander, on the ground, disarmed",
        "This station may not load a package now.",
        "'handover share' at the commander, on the ground.",
    ),
    _warn(
        "the contents do not have the digest that was promised",
        "The package was damaged on its way.",
        "'handover share' again.",
    ),
    _warn(
        "station {station} ({number}) is not one of this vehicle's",
        "The package names a station that the vehicle's file does not have.",
        "Correct the package or the vehicle's file.",
    ),
    _warn(
        "parent {station} is not this vehicle's",
        "The package has another parent than the vehicle's file.",
        "Correct the package or the vehicle's file.",
    ),
    _warn("held already, nothing was written", "The vehicle flies this package already.", NOTHING),
    _warn(
        "the autopilot does not take {parameter} {number}, {speed_of}",
        "The autopilot keeps another value.",
        "Set this parameter by hand. Then 'handover share' again.",
    ),
    _warn(
        "the mission's cruise speed, {number} m/s, is {speed_is} than {parameter}",
        "The autopilot's limit does not allow the mission's speed.",
        "Change the plan or the parameter.",
    ),
    _warn("{judged}", "The package did not pass the check.", "Correct the reason. Then 'handover share' again."),
)

_BOARD: Final = (
    _warn(
        "the autopilot refused the {list}: {autopilot}",
        "The autopilot does not take the list.",
        "Look up the result (MAV_MISSION_...). Correct the list.",
    ),
    _warn("the autopilot does not send its mission now", "The autopilot answers with an error.", "Try again."),
    _warn("the autopilot does not send its rally points now", "The autopilot answers with an error.", "Try again."),
    _warn(
        "the autopilot asks for {list} item {number} of {count}",
        "The autopilot asks for an item that is not there.",
        "Try again.",
    ),
    _warn(
        "the autopilot holds {count} {list} items of {number} written",
        "The autopilot has not stored all items.",
        "Try again. Check its limit of items.",
    ),
    _warn(
        "the autopilot holds a geofence with a circle of {number} m",
        "A circle of the autopilot's geofence is not valid.",
        "Upload the geofence again.",
    ),
    _warn(
        "the autopilot holds a geofence with an incomplete polygon",
        "The autopilot's geofence is not whole.",
        "Upload the geofence again.",
    ),
    _warn(
        "item {number}: {field} {value} came back as {most}",
        "The autopilot holds another value than was written.",
        "Write it again. Look for another program that writes it.",
    ),
    _warn(
        "rally point {number} came back at {value} {most}",
        "The autopilot holds another place than was written.",
        "Write it again.",
    ),
    _warn(
        "geofence item {number} came back at {value} {most}",
        "The autopilot holds another place than was written.",
        "Write it again.",
    ),
    _warn(
        "geofence item {number}: command {value} came back as {most}",
        "The autopilot holds another geofence than was written.",
        "Write it again.",
    ),
    _warn(
        "rally point {number}: altitude {metres} m came back as {value} m",
        "The autopilot holds another height than was written.",
        "Write it again.",
    ),
    _warn(
        "geofence item {number}: {count} corners or metres came back as {value}",
        "The autopilot holds another geofence than was written.",
        "Write it again.",
    ),
    _warn("no answer to {autopilot}", "The autopilot does not answer.", "Check the line. Try again."),
)

_UPLOAD: Final = (
    _warn("{count} items (at most {number})", "The list is too long for the autopilot.", "Plan fewer items."),
    _warn("too long", "The list is too long for the autopilot.", "Plan fewer items."),
    _warn(
        "items {number} to {value} are none of those that are there",
        "The program changes items that are not there.",
        "Upload the whole mission.",
    ),
    _warn("another upload is under way", "One program at a time.", "Wait, then upload again."),
    _warn("the list has changed meanwhile", "A part was uploaded to a list that changed.", "Upload the whole mission."),
    _warn("the upload was called off by its sender", "The program gave the upload up.", NOTHING),
    _warn("the upload was given up: item {number} did not come", "The link lost too much.", "Upload again."),
    _warn("its sender no longer has authority", "Authority moved during the upload.", "Upload at the commander."),
    _warn("it cannot be changed in flight", "In flight the geofence stays.", "Change it on the ground."),
    _warn(
        "it cannot be cleared in flight, only replaced", "In flight a mission must be there.", "Upload another mission."
    ),
    _warn(
        "without a mission package and a position it cannot be judged",
        "The companion has no zones or no position.",
        "Wait for the position. Load a package on the ground.",
    ),
    _warn("another mission is being read", "One mission at a time.", "Wait, then upload again."),
    _warn(
        "{board}: what the autopilot holds is not known, send it again",
        "The write failed midway.",
        "Upload again at once.",
    ),
    _warn(
        "item {number}: command {value} is not one that can be judged",
        "The companion cannot judge where it leads.",
        "Take this item out.",
    ),
    _warn("item {number}: no rally point", "The list of rally points has another item.", "Take it out."),
    _warn(
        "item {number}: the height does not count from home",
        "Rally points need heights above home.",
        "Change the frame of this point.",
    ),
    _warn("item {number}: no place", "The rally point has no valid position.", "Give it a place."),
    _warn("item {number}: altitude out of range", "The height is no height of a flight.", "Correct it."),
    _warn("item {number}: latitude out of range", "The position is no place.", "Correct it."),
    _warn("item {number}: longitude out of range", "The position is no place.", "Correct it."),
    _warn("item {number}: parameter {value} is no number", "The item is not valid.", "Correct it."),
    _warn("the upload: item {number}: {error}", "This item cannot be flown or judged.", "Change this item."),
    _warn(
        "a return would not land: {return_lacks}",
        "An aircraft with wings would circle for ever after a return.",
        "Plan a landing sequence.",
    ),
    _warn("{heights}", "The heights would not be flown as they were checked.", "Plan heights above home."),
    _warn("{judged}", "The mission did not pass the check.", "Correct the reason, and upload again."),
)

GROUPS: Final = (
    Group(
        "mission",
        "Missions",
        "At all stations, by STATUSTEXT. Lines of level 'info' are in the companion's console and journal only.",
        _SENTENCES,
    ),
    Group("follows", "What follows a cleared or changed mission", "The end of such a sentence.", _FOLLOWS, whole=False),
    Group("remedy", "What START needs then", "The end of 'is not flown'.", _REMEDIES, whole=False),
    Group(
        "mission_lacks",
        "Why no mission is loaded",
        "The reasons in 'no mission loaded, because REASON'.",
        _LACKS,
        whole=False,
    ),
    Group(
        "judged",
        "Why a mission is not flown",
        "The reasons in 'is on the autopilot and is not flown: REASON'.",
        _JUDGED,
        whole=False,
    ),
    Group("low", "Heights near the ground", "Of single items.", _LOW, whole=False),
    Group(
        "load_failure",
        "Why a package is not loaded",
        "The reasons in 'Mission NAME not loaded: REASON'.",
        _LOAD,
        whole=False,
    ),
    Group(
        "board",
        "What the autopilot holds",
        "The difference between what was written and what was read back.",
        _BOARD,
        whole=False,
    ),
    Group(
        "upload",
        "Why an upload in flight is rejected",
        "The reasons in 'mission rejected: REASON'.",
        _UPLOAD,
        whole=False,
    ),
)
