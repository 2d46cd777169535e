# SPDX-License-Identifier: GPL-3.0-or-later

"""Lines of the companion's console and journal that no station gets as a text."""

from __future__ import annotations

from typing import Final

from mavproxy_handover.core.common.levels import Level
from reference.sentences.row import NOTHING, Group, Sentence

__all__ = ["GROUPS"]


def _info(template: str, meaning: str, action: str = NOTHING) -> Sentence:
    return Sentence(template, Level.INFO, meaning, action)


def _warn(template: str, meaning: str, action: str = NOTHING) -> Sentence:
    return Sentence(template, Level.WARNING, meaning, action)


_LOGS: Final = "'handover logs', the entry 'fault' of the companion's journal, and tell us."
_CLOCK: Final = "Set the clock of the vehicle. It has to be right at each start."

_LINES: Final = (
    # authority
    _info("{station} commands, epoch {epoch}", "Authority has moved to this station."),
    _info("control released: no station commands", "The commander has released authority."),
    _info("{station} is lost: no station commands", "The commander has not been heard for its time-out."),
    _info("{station} answers no more: no station commands", "The commander is heard and does not answer."),
    _info(
        "{station} hears less than {percent} of what the aircraft sends: no station commands",
        "The commander receives too little.",
        "Check the downlink of that station.",
    ),
    _info(
        "{station} hears less than {percent} of what the aircraft sends",
        "The station receives too little to command.",
        "Check antenna, power and data rate.",
    ),
    _info("{station} commands on after the restart, epoch {epoch}", "The companion was started again."),
    _info("{station} is back and commands again, epoch {epoch}", "The lost commander is heard again."),
    _info(
        "{station} has not come back after the restart: no station commands",
        "The companion was started again, and its commander is not heard.",
    ),
    _info(
        "{station} says epoch {epoch}: no memory of this flight, not believed",
        "The station remembers another flight.",
        "Start that station's program again.",
    ),
    _info(
        "{station} remembers {other} in epoch {epoch}: no station commands",
        "The station knows a later commander than the companion.",
    ),
    _info(
        "{station} remembers no station in epoch {epoch}: no station commands",
        "The station knows a later state than the companion.",
    ),
    _info("{station} remembers epoch {epoch}: the state of an earlier run was lost", "The epoch is raised."),
    _info("{station} is heard", "The first heartbeat of the station has come."),
    _info("{station} is connected", "The station answers the vehicle's questions."),
    _info("{operator} is on duty at {station}", "An operator has signed on at the station."),
    _info("{operator} is on duty at {station}, after {before}", "The shift has changed at the station."),
    _info("{before} has signed off at {station}", "No operator is on duty at the station."),
    _info("{station} hears the aircraft again", "The station answers enough of the vehicle's questions."),
    _info(
        "{station} cannot be partner: {unfit}",
        "The station cannot take the aircraft now.",
        "Do what the advice to both operators says.",
    ),
    _info(
        "links of {station} are {quality}: {link_news}",
        "The measured links of the station have changed.",
        "If they are weak: look at antenna and place of the station.",
    ),
    _info(
        "another sender {speaks} in the name of {station}: {link_news}",
        "Frames with the station's system id have no valid signature.",
        "Look for a program with that system id.",
    ),
    _info("{station} {asks} control: {control_result}", "A station has asked for authority, or released it."),
    _info(
        "{station} {asks} control: {control_result} ({control})",
        "A station has asked for authority, or released it.",
        "Look for the reason in the table 'Why control is denied'.",
    ),
    # handovers
    _info("{station} -> {other} is expected in {seconds} s: both may answer now", "The next border is ahead."),
    _info("{station} agrees to it beforehand", "The station has answered before the border."),
    _info("{station} will not have it", "The station has denied before the border."),
    _info("{station} asks its operator", "The station waits for its operator."),
    _info("{station} is ready", "The partner is ready to take the aircraft."),
    _info("{station} denies the handover", "The station's operator has denied."),
    _info("Handover request sent to {station}. Waiting for {station}", "Step 1 of a handover."),
    _info("Handover request sent to {station}. Waiting for {station} and {other}", "Step 1 of a handover."),
    _info("OK handover received from {station}", "Step 3: the commander agrees."),
    _info("Connect handover sent to {station}. Waiting for {station}", "Step 4 of a handover."),
    _info("Connect handover sent to {station}. Waiting for {station} and {other}", "Step 4 of a handover."),
    _info("Drone connected received from {station}", "Step 5: the partner is set up."),
    _info("Disconnect received from {station}", "Step 6: the commander gives up authority."),
    _info("handover {number}: {station} -> {other}", "A handover has begun."),
    _info("handover {number} (forced): {station} -> {other}", "A forced handover has begun."),
    _info("handover {number} (forced): {station} is asked too", "Another station is asked beside the first."),
    _info("handover {number} (forced): {station} is the partner now", "This station was the first to be ready."),
    _info("handover {number} (forced): {station}: {handover_reason}", "This station cannot take the aircraft."),
    _info("handover {number} is now for {handover_reason}", "A graver reason has taken the place of the first."),
    _info("handover {number} committed: {station} commands, epoch {epoch}", "The handover is complete."),
    _info(
        "handover {number} aborted ({reason_name}): {station} commands",
        "The handover did not take place.",
        "Read the sentence 'No handover' at the stations.",
    ),
    _info(
        "handover {number} aborted ({reason_name}): no station commands",
        "The handover did not take place.",
        "Read the sentence 'No handover' at the stations.",
    ),
    _info(
        "{station} has not acknowledged how handover {number} ended",
        "The result was repeated long enough.",
        "Check the link of that station.",
    ),
    _info("Handover Zone ({station} and {other})", "The aircraft is in the overlap of two zones."),
    _info("zone of {station} entered", "The zone holds the aircraft now."),
    _info("zone of {station} left", "The zone does not hold the aircraft any more."),
    _info(
        "no fresh position: no handover by zone",
        "Without a position no zone is known to hold the aircraft.",
        "Look at the GPS.",
    ),
    _info("telemetry goes to {station}, once a second", "The commander gets the aircraft's telemetry."),
    _info("{cause}: {gap}", "The aircraft crosses a gap that its mission declares."),
    _info("the gap is crossed", "The aircraft has coverage again."),
    _info("the cause of the {cause_kind} is gone", "The decision is over."),
    # the companion
    _warn(
        "INTERNAL FAULT, authority ends here: {error}",
        "The rules have failed. The guard brings the aircraft home.",
        f"Land. {_LOGS}",
    ),
    _info("Started again by the supervisor: {error}", "The companion had ended or stood still.", _LOGS),
    _info(
        "Restarted in {where}, epoch {epoch}: waiting for {station}", "A restart continues where the run before ended."
    ),
    _info(
        "Restarted in {where}, epoch {epoch}: {station} has to show that it still has authority",
        "A restart found an old state.",
        "Keep that station running.",
    ),
    _info(
        "Restarted in {where}, epoch {epoch}: no station had authority",
        "A restart continues where the run before ended.",
        "Request control when the aircraft is in your zone.",
    ),
    _info(
        "Restart: configuration, keys and mission are those of the run before; {file} is read at the next start on the "
        "ground",
        "A restart in flight reads no file.",
    ),
    _info(
        "Restart: there is no record of the run before, so the files were read",
        "The record in memory is missing.",
        "On the ground: 'handover doctor'.",
    ),
    _warn(
        "State file: {error}: no station commands",
        "The saved state cannot be trusted.",
        "Request control when the aircraft is in your zone.",
    ),
    _warn(
        "the state is not kept as it should be: {state_fault}",
        "Disk or memory does not take what a restart needs.",
        "The flight goes on. Make room on the disk.",
    ),
    _info(
        "component {component} also claims to be the system manager: switch its operator control off",
        "Two programs of the vehicle manage operator control.",
        "Switch it off in the other program.",
    ),
    _info(
        "{mode} of {system}/{component} on the vehicle's side uses the companion's identity: not forwarded",
        "A program on the vehicle's side uses the companion's system and component id.",
        "Give that program another id.",
    ),
    _info("guard: {guard_before} -> {guard_now}", "The guard reports another state."),
    # the aircraft
    _info("the autopilot has started again", "The autopilot's own clock has gone back.", "Look at the aircraft."),
    _info("energy: the budget of the mission closes", "The battery lasts for the mission again."),
    _info("energy: {energy}", "The budget of the mission has changed.", "If it does not close: a full battery."),
    _info(
        "WARNING: the return site could not be written to the autopilot's rally list: {failure}. The companion tries "
        "again",
        "A return of the autopilot may go elsewhere.",
        "Be ready to fly it home by hand.",
    ),
    _info(
        "WARNING: another program has written the autopilot's rally list. The companion restores the return site",
        "Another program writes the autopilot's rally points.",
        "Switch that off in the other program.",
    ),
    _info("the return goes to {place} instead: GUIDED, then RTL again", "A better return site was found on the way."),
    _info("Delivery point reached, waypoint {waypoint}", "The aircraft is at its delivery point."),
    _info("the autopilot flies {mode}", "The vehicle's order is carried out."),
    _info(
        "{failure}",
        "The autopilot does not carry out an order. The row of the reason says why.",
        "Look who flies the aircraft.",
    ),
    _info("{station} lifts {limit_name} for {seconds} s", "An operator has typed 'handover override'."),
    _info(
        "{station} lifts {limit_name} for {seconds} s, on duty: {operator}",
        "The operator named has typed 'handover override'.",
    ),
    _info("The vehicle's console lifts {limit_name} for {seconds} s", "An operator has typed 'handover override'."),
    _info("{command} of {station} refused: {command_limit}", "A command of the commander is refused in flight."),
    _info("{command} of {station} refused: {limit}", "A command of the commander is refused in flight."),
    _info("{command} of {station} {passes}: {limits}", "A command is carried out although it leaves a limit."),
)

_UNFIT: Final = (
    _info("{handover_reason}", "The name of the reason."),
    _info("it has answered too few questions", "The station has just come into range.", "Wait ten seconds."),
    _info(
        "it hears less than {percent} of what the aircraft sends",
        "The station receives too little.",
        "Check the downlink.",
    ),
)

_STATE_FAULTS: Final = (
    _info("there is nowhere to keep it", "Neither memory nor disk takes the state.", "'handover doctor'."),
    _info("the disk does not take it: {error}", "The disk is full or cannot be written.", "Make room on the disk."),
    _info(
        "the mission package cannot be kept: {error}",
        "The disk is full or cannot be written.",
        "Make room on the disk.",
    ),
    _info("the copy in memory is older than the one on the disk", "The record in memory is old.", NOTHING),
    _info("the copy in memory is gone, and the disk may be older", "The record in memory is missing.", NOTHING),
    _info("the copy in memory is not to be trusted: {error}", "The record in memory is damaged.", NOTHING),
    _info("the copy in memory is {reason}", "The record in memory cannot be used.", NOTHING),
    _info("{error}", "The operating system's own words.", "'handover doctor'."),
)

GROUPS: Final = (
    Group(
        "console",
        "On the companion's console",
        "And in its journal, which 'handover logs' and the report show. A "
        "line begins with the time, the vehicle and the phase.",
        _LINES,
    ),
    Group("unfit", "Why a station is not partner", "After 'cannot be partner:'.", _UNFIT, whole=False),
    Group(
        "state_fault",
        "Faults of the saved state",
        "After 'the state is not kept as it should be:'.",
        _STATE_FAULTS,
        whole=False,
    ),
)
