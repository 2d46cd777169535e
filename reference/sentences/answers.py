# SPDX-License-Identifier: GPL-3.0-or-later

"""Answers to commands that are typed at the companion's console, the briefing, and lines at the companion's start."""

from __future__ import annotations

from typing import Final

from mavproxy_handover.core.common.levels import Level
from mavproxy_handover.link.quality import LinkEventKind, Measure
from reference.sentences.row import NOTHING, Group, Sentence

__all__ = ["GROUPS"]

#: what each measure of a link is
_MEASURES: Final = {
    Measure.SILENCE: "Nothing came by it for this time.",
    Measure.LOSS: "This share of the station's frames was lost.",
    Measure.DOWNLINK_LOSS: "This share of the vehicle's frames was lost.",
    Measure.ROUND_TRIP: "A question and its answer took this time.",
    Measure.BAD_SIGNATURES: "So many frames had no valid signature.",
    Measure.OVERFLOW: "So many frames came faster than the companion read them.",
}


def _info(template: str, meaning: str, action: str = NOTHING) -> Sentence:
    return Sentence(template, Level.INFO, meaning, action)


def _warn(template: str, meaning: str, action: str = NOTHING) -> Sentence:
    return Sentence(template, Level.WARNING, meaning, action)


_STATUS: Final = (
    _info("phase {name}", "Phase of the flight: ON_LOAD, ON_MISSION, ON_HANDOVER or EMERGENCY."),
    _warn(
        "phase {name} (INTERNAL FAULT: no station commands)",
        "The rules have failed. The guard acts.",
        "Land. Start the companion again, and tell us.",
    ),
    _info(
        "rehearsal the aircraft is carried: nothing arms, and nothing is commanded",
        "A rehearsal is under way.",
        "'handover rehearse end' at the commander.",
    ),
    _info("commander {station}, epoch {epoch}, lease {name}", "The commander, and the state of the lease."),
    _info("commander {station}, epoch {epoch}, lease {name}, transfer to {partner}", "A handover is under way."),
    _info(
        "guard {name}, firmware {number}, {count} leases refused",
        "The guard's last status. WARNING words in capitals.",
        "ENFORCING: watch the aircraft. Else read the row about the guard.",
    ),
    _info("mission none", "No mission is loaded.", "'handover share' at the commander."),
    _info("mission {digest}", "The first half of the digest of the loaded package."),
    _info("zone {station}", "The zone that holds the aircraft."),
    _info("zone none", "No zone holds the aircraft, or no position is known."),
    _info(
        "position by the {name}; position box {box_news}; layout {layout_name}",
        "The source of the position, and the box.",
    ),
    _info("energy {number} Wh of {value} Wh left", "What is left, and what is counted for the flight."),
    _info(
        "energy unknown: {error}",
        "The energy is not known. The reason follows.",
        "Correct [energy] in the vehicle's file.",
    ),
    _info("wind not known, {number} m/s from ahead", "The energy is counted with this wind from ahead."),
    _info("lifted {limit_name}, {seconds} s yet", "An operator has lifted this limit."),
    _info("START ready", "START would pass."),
    _info("START not yet: {needs}", "START would be refused. Each reason has its row.", "Do what the rows say."),
    _info("preflight guard, parameters and firmware fit", "The check before flight has no finding."),
    _info("preflight WARNING: {preflight}", "The check before flight has a finding.", "Do what its row says."),
    _info(
        "aboard frames in the companion's name from the vehicle's side, by sender: {error}",
        "Programs on the vehicle's side use the companion's identity.",
        "Give them another id.",
    ),
    _info(
        "faults {error} (see {file})",
        "Parts of the companion have failed, and how often.",
        "'handover logs', the entry 'fault', and tell us.",
    ),
    _info("journal {count} entries lost: is the disk full?", "The journal is not complete.", "Make room on the disk."),
    _info("{station} ({system}): heard {seconds} s ago, connected", "The station answers."),
    _info(
        "{station} ({system}): never heard, not connected",
        "Nothing has come from the station.",
        "Check its link and its system id.",
    ),
    _info(
        "{station} ({system}): frames, but no heartbeat, not connected",
        "Its program sends no heartbeat.",
        "Have it send HEARTBEAT each second.",
    ),
    _info("{file}: heard {seconds} s ago, {count} frames in, {number} out, {value} damaged", "Counts of a link."),
    _info(
        "{percent} lost, {left} of the downlink lost, round trip {number} ms (jitter {value} ms), {count} out of "
        "order, "
        "{items} badly signed, {most} dropped by a full receive buffer",
        "Measurements of a link.",
        "If much is lost: antenna, power, channel.",
    ),
    _info("gate: nothing yet", "The gate has judged no frame of the station."),
    _info("no mission loaded, or no position yet", "Zones are not known."),
    _info(
        "{station}: inside, {metres} m to its border, ends in {seconds} s on this track, awaits it at a waypoint",
        "The zone holds the aircraft. The route comes to it at a waypoint.",
    ),
    _info("{station}: {metres} m away", "The zone does not hold the aircraft."),
    _info("no transfer is under way", "There is no handover to end."),
    _info(
        "no rehearsal since the companion was started",
        "There is nothing to report.",
        "'handover rehearse' at the commander.",
    ),
    _info("handover: unknown command {error}", "The command is not known here.", "'handover help'."),
)

_HELP: Final = tuple(
    _info(text, "A line of 'handover help'.")
    for text in (
        "phase, commander, epoch, lease, guard, mission, energy",
        "every station: link, liveness, what the gate did",
        "zones of the loaded mission and where the aircraft is",
        "what was seen in the rehearsal on the ground, or in the last one",
        "call the present transfer off; the commander stays",
        "let commands leave this limit for a minute, as the commander may",
        "authority handover of this vehicle ('handover help')",
    )
)

_BRIEFING: Final = (
    _info("position not known", "There is no fresh position.", "Ask the commander's operator."),
    _info(
        "{track}; {number} {value}, {metres} m above home, {most} m/s", "Where the aircraft is, and how fast it flies."
    ),
    _info("what is left is not known", "The battery reports nothing.", "Ask the commander's operator."),
    _info(
        "{percent} left; mission with reserve {left}; return to {place}",
        "Battery and need of the mission.",
    ),
    _info("{percent} left; what the mission needs is not known", "Only the battery is known."),
    _info("not known (internal fault)", "A part of the companion failed.", "Ask the commander's operator. Tell us."),
    _info("{station} -> {other} in {seconds} s; zone of {name} ends in {number} s", "The next border."),
    _info("no border in sight", "The route stays in the zone."),
    _info("{cause}; last decision: {error}, over for {seconds} s", "What is wrong, and the last decision."),
)

_REHEARSAL: Final = (
    _info("rehearsal {why_over}, {seconds} s, seen since a restart", "How long the rehearsal took, and how it ended."),
    _info(
        "handovers {count}, {number} of {value} that the check has", "Handovers in the rehearsal, and those expected."
    ),
    _info(
        "{number}: {station} -> {other} at {seconds} s, took {value} s of {most} s in flight, item {items}",
        "A handover at the expected border.",
    ),
    _info(", {metres} m off the check's place", "How far from the expected border a handover was."),
    _info(
        "{number}: {station} -> {other} at {seconds} s, took {value} s ({error}); the check has none here",
        "A handover that the check does not expect.",
        "Compare the zones with the route that you walked.",
    ),
    _info(
        "{number}: {station} -> {other} at {seconds} s: came to nothing ({error}), {value} s",
        "A handover that failed.",
        "Read the reason. Walk there again.",
    ),
    _info(
        "not made: {station} -> {other}, way to item {items}",
        "An expected handover did not take place.",
        "Walk that part of the route, or look at the stations.",
    ),
    _info("link {station} {file}", "The link of the next lines."),
    _info(
        "{place} {seconds} s, lost {percent} (most {left}), trip {number} ms (most {value}), silent {most} s",
        "Measurements of this link in this part of the route.",
        "If much is lost: move the antenna.",
    ),
    _info("refused {count} x {command} of {station}: {gate_reason}", "Commands that the gate refused."),
    _info("nothing would have been commanded", "No safety decision would have been carried out."),
    _info("{count} more entries left out", "The report holds the first ones."),
)

_START: Final = (
    _info("handover {error}: {vehicle}, stations {stations}, configuration {file}", "The module is loaded."),
    _warn(
        "handover: WARNING: {stations} without a key: any program on the link counts as the station",
        "Frames of these stations are not signed.",
        "Give them keys: 'handover keys make NAME'.",
    ),
    _warn(
        "handover: {name} is set back to {value}: only the gate lets stations through",
        "A setting of MAVProxy would pass frames around the gate.",
        "Leave this setting.",
    ),
    _warn(
        "handover: output {file} is closed: stations belong in the configuration",
        "An output of MAVProxy would pass frames around the gate.",
        "Name the station in the vehicle's file.",
    ),
    _warn(
        "handover: internal fault, see the journal", "A part of the companion failed.", "'handover logs', and tell us."
    ),
    _warn(
        "handover: {file} is written by another MAVProxy as well, and is of no use to either: start each with a "
        "--logfile of "
        "its own",
        "Two programs write one log.",
        "Start each with its own --logfile.",
    ),
    _warn(
        "restarted too often: no leases, no station commands, the guard brings the aircraft home. Find out why in the "
        "journal, then start `handover companion` again",
        "The companion failed again and again.",
        "Watch the return. Then 'handover logs'.",
    ),
    _warn(
        "unknown argument {name}; allowed are: config, journal",
        "The module was loaded with another argument.",
        "Load it with 'config' or 'journal'.",
    ),
    _warn(
        "module handover_gcs is loaded here: vehicle and station need a MAVProxy each",
        "Both modules are in one program.",
        "Start one MAVProxy for each.",
    ),
    _warn(
        "MAVProxy has outputs ({error}): programs there could pass the gate. Start without --out, or set "
        "listen_only_outputs = true in [vehicle]",
        "Programs at these outputs are not judged.",
        "Start without --out.",
    ),
    _warn(
        "{name}: the aircraft is in flight. Without this module no station commands it, and the guard brings it "
        "home. Type it "
        "again within {seconds} s if that is meant.",
        "You have typed 'module unload' in flight.",
        "Do not type it again.",
    ),
    _info(
        "{file}: no replay state yet; signed frames are accepted if they are new by the clock",
        "The first start of a link with this key.",
        "Check that the clock is right.",
    ),
    _warn(
        "{file}: replay state cannot be read ({error}); what was signed before now is refused",
        "The record of old signatures is damaged.",
        "Check that all clocks are right.",
    ),
    _warn(
        "{file}: replay state cannot be written ({error})",
        "A restart could accept old frames.",
        "Make room on the disk.",
    ),
    _info("the file is kept as {file}", "The damaged file is kept.", "Send it to us, or delete it."),
)

_JOURNAL: Final = (
    _info("handover {number}, configuration {file}", "The module is loaded."),
    _info("frames of {stations} are taken unsigned", "These stations have no key.", "'handover keys make NAME'."),
    _info("the clock was set by {seconds} s", "The wall clock has moved. No rule uses it.", "Set it before the start."),
    _info("{count} more entries of {station} left out: {work}", "A sender caused too many entries."),
    _info(
        "{name} of {station} is not valid",
        "A message of a handover had values that are not allowed.",
        "Update the program of that station.",
    ),
    _info(
        "request of {station} not understood: {control}",
        "A request of operator control is not valid.",
        "Update the program of that station.",
    ),
    _info("{station} is asked: may {other} have control?", "The commander is asked by MAVLink's own message."),
    _info("restarted in {where}; {station} had authority", "The companion was started again."),
    _info(
        "the mission package of the previous run is missing: no zones",
        "A restart found no package.",
        "'handover share' on the ground.",
    ),
    _info("{stream} of {station} refused: it does not command", "Sticks or setpoints of the station are refused."),
    _info(
        "{stream} of {station} refused: it ran before {other} had control",
        "Sticks or setpoints of the station are old.",
    ),
    _info("{stream} of {station} has ended: obeyed from now on", "New sticks or setpoints count."),
    _info("{stream} of {station} has ended", "Sticks or setpoints have ended."),
    *(
        _info(why, "Why a message of a handover was dropped.")
        for why in (
            "doubled answer to CONNECT",
            "stale answer to CONNECT",
            "no such border ahead",
            "not the sender's to say",
            "stale epoch or unknown transfer",
            "the commander is lost",
            "transfer already over",
        )
    ),
    _info("flying to waypoint {waypoint}", "The autopilot flies to this item."),
    _info("delivery point (waypoint {waypoint}) reached", "The aircraft is at its delivery point."),
    _info(
        "unfinished {list} upload ended",
        "After a handover: an upload of the earlier commander was closed.",
        "Upload again.",
    ),
    _info(
        "file {file} closed, contents thrown away",
        "After a handover: a file of the earlier commander was closed.",
        "Upload again.",
    ),
    _info("RC override released", "After a handover: the earlier commander's sticks were released."),
    _info("guided stream stopped", "After a handover: the earlier commander's setpoints were stopped."),
    _info("default message rates restored: {error}", "After a handover: rates are as before."),
    _info("log download ended", "After a handover: a download was closed.", "Ask for it again."),
    *(
        _info(
            f"link {{file}} {kind.value}: {measure.value} {{figure}}, limit {{figure_limit}}",
            f"{_MEASURES[measure]} The link is {state}.",
            action,
        )
        for kind, state, action in (
            (LinkEventKind.DEGRADED, "bad", "Look at the link, if it stays so."),
            (LinkEventKind.RESTORED, "good again", NOTHING),
        )
        for measure in Measure
    ),
    _info(
        "off route: {track} the leg to waypoint {waypoint}",
        "The aircraft is not where its route leads.",
        "Look at mode, wind and position.",
    ),
    _info(
        "off route: course {number} deg off the leg to waypoint {waypoint}, {metres} m right of it",
        "The aircraft flies in another direction than its route.",
        "Look at mode, wind and position.",
    ),
    _info("on the route again: {track}", "The aircraft is on its route again."),
    _info("no leg of the mission is flown any more: the deviation is over", "The mission is over."),
    _info("arbiter failed on {name}: {error}", "The rules have failed.", "Land. 'handover logs', and tell us."),
    _info(
        "positions cannot be compared to the zones: {error}", "The comparison failed.", "'handover logs', and tell us."
    ),
    _info(
        "a new view could not be put in force: {error}",
        "The change of authority failed.",
        "Land. 'handover logs', and tell us.",
    ),
)

GROUPS: Final = (
    Group(
        "status",
        "Answers at the companion's console",
        "To 'handover status', 'handover stations', 'handover zones' and the other commands that are typed there.",
        _STATUS,
    ),
    Group("help", "Help at the companion's console", "The meaning of each command is the line itself.", _HELP),
    Group("briefing", "The briefing", "At the partner's operator, with the question.", _BRIEFING),
    Group(
        "rehearsal",
        "The report of a rehearsal",
        "'handover rehearsal' at the companion and at the commander.",
        _REHEARSAL,
    ),
    Group("loading", "When the companion starts", "On its console. Some end the start.", _START),
    Group("journal", "Only in the journal", "'handover logs' and the report show it.", _JOURNAL),
)
