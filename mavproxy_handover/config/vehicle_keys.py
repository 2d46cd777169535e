# SPDX-License-Identifier: GPL-3.0-or-later

"""The keys of the vehicle's file, table by table. `config/vehicle.py` reads them.

The ranges are wide enough for any sound installation and narrow enough that they switch nothing off. The longest
allowed limit still detects a loss, and the shortest does not degrade a healthy link.
"""

from __future__ import annotations

from typing import Final

from mavproxy_handover.config.feeds import FEEDS
from mavproxy_handover.config.onboard import ONBOARD
from mavproxy_handover.config.payload import PAYLOAD
from mavproxy_handover.config.position import POSITION
from mavproxy_handover.config.remote_id import REMOTE_ID
from mavproxy_handover.config.route import ROUTE
from mavproxy_handover.core.common.causes import CAUSES, Cause
from mavproxy_handover.core.common.limits import Limits
from mavproxy_handover.core.common.model import StandingConsent
from mavproxy_handover.core.safety.commands import POLICIES, Limit
from mavproxy_handover.gate.client_capabilities import POLICIES as CAPABILITY_POLICIES
from mavproxy_handover.gate.observers import ObserverLimits
from mavproxy_handover.link.forms import FORMS
from mavproxy_handover.link.quality import LinkLimits
from mavproxy_handover.mission.keys import ENERGY
from mavproxy_handover.tools.key_table import Key, KeyTable, called, flag, items, number, numbers, sysid, text, word
from mavproxy_handover.wire.ids import STATION_COMPIDS

__all__ = [
    "CLEAR",
    "COMMANDS",
    "HOLD_OFF",
    "LIMITS",
    "LINKS",
    "OBSERVERS",
    "POLICY",
    "STATION",
    "VEHICLE",
    "VEHICLE_FILE",
]

VEHICLE: Final = KeyTable(
    "vehicle",
    (
        called("name", "what the vehicle is called at the stations"),
        sysid("sysid", "system id of the autopilot: MAV_SYSID, older SYSID_THISMAV", 1),
        called("parent", "name of the station that loads the mission and starts the flight"),
        text(
            "journal",
            "file of the journal; `handover companion` writes it to the folder of the run (--logs)",
            "handover.jsonl",
        ),
        flag("guard", "false only for a vehicle without handover_guard.lua", default=True),
        flag("listen_only_outputs", "true: MAVProxy may have --out links; they only receive", default=False),
        text("state", "folder where authority is kept over a loss of power", "state"),
        text(
            "mission",
            "folder of a mission package on board; without it the parent sends one. A mission that a station uploads "
            "on the ground stays until it is cleared, or until a package is shared",
            example="missions/delivery",
        ),
        flag(
            "allow_unsigned",
            "true: stations may have no key; any program that reaches such a link counts as the station",
            default=False,
        ),
        text(
            "autopilot_key",
            "file of the autopilot's own MAVLink 2 key, if its link is signed",
            example="keys/autopilot.key",
        ),
        text(
            "guard_key",
            "file of the key on the guard's card ('handover guard CARD --key FILE'), if it has one",
            example="keys/guard.key",
        ),
    ),
    required=True,
)
STATION: Final = KeyTable(
    "station",
    (
        called("name", "as in the mission package"),
        sysid("sysid", "its MAVLink id, as in the mission package"),
        items(
            "links",
            f"one or more, side by side: {', '.join(FORMS.values())}. udpout and tcp call the station, udpin and "
            "tcpin wait for it; udpout:HOST:PORT@wwan0 leaves only by that interface; an IPv6 address as HOST stands "
            "in brackets",
            required=True,
        ),
        text(
            "key",
            "file of the key that it signs with, needed unless allow_unsigned; 'handover keys make NAME' makes one",
        ),
        flag(
            "module", "false: it runs no handover_gcs, but any program of the operator-control standard", default=True
        ),
        word(
            "consent",
            tuple(each.value for each in StandingConsent),
            "with module = false, if its operator cannot be asked (no released QGroundControl or Mission Planner "
            "asks): automatic (planned handovers need no answer) or refuse (it is never partner, and keeps the "
            "aircraft)",
        ),
        items(
            "sysids",
            "further MAVLink ids at this station: a second program, a tracker",
            [],
            limits=(1, 255),
            rule="a MAVLink system id, 1 to 255",
            example=[245],
        ),
        word(
            "not_in_control",
            CAPABILITY_POLICIES,
            "which programs get the result NOT_IN_CONTROL (10): auto, those that have shown support for it; always, "
            "all; never, none: they get DENIED. Some programs take 10 for no answer at all",
            CAPABILITY_POLICIES[0],
        ),
        items(
            "components",
            "MAVLink components of the station's own id that have its authority; others may only read",
            sorted(STATION_COMPIDS),
            limits=(0, 255),
            rule="a MAVLink component id, 0 to 255",
        ),
        text(
            "operator_id",
            "id of its operator, as Remote ID broadcasts it while the station has authority",
            rule="1 to 20 printable ASCII characters",
            example="FIN87astrdge12k8",
        ),
        flag(
            "companion_heartbeat",
            "false: this station gets no heartbeat of component 191; for programs that take every heartbeat of the "
            "vehicle for the autopilot's (DroneKit 2). With module = false",
            default=True,
        ),
    ),
    "One block for each ground station, in any order.",
    many=True,
    required=True,
)
LIMITS: Final = KeyTable(
    "limits",
    numbers(
        """
            heartbeat_lost_s    1.5 to 60     a station silent this long is lost
            recovery_s          0.5 to 30     how long the companion waits for the former commander after a restart in
                                              flight; the guard's HNDO_LOST_T must be half a second longer
            connect_interval_s  0.2 to 10     how often each station is asked whether it is there; below deaf_lost_s
            connect_lost_s      1 to 60       an answer to that older than this proves nothing
            deaf_lost_s         3 to 120      a commander that is heard and has not answered for this long is lost,
                                              because it hears nothing
            deaf_share          0.02 to 0.25  a station that answers less than this share of the questions of that time
                                              is deaf: it neither commands nor takes the aircraft nor counts as coverage
            deaf_back_share     0.2 to 0.6    it counts again when it has answered this share or more, above deaf_share,
            deaf_back_s         1 to 300      for this long; three times as long after each further loss of command in
                                              the flight, to 300 s
            retry_first_s       0.05 to 5     first retransmission of a transfer message
            retry_max_s         0.05 to 10    the longest wait for one
            step_timeout_s      0.5 to 60     a step of a transfer that takes longer aborts it: the commander stays
            operator_timeout_s  3 to 300      the same while an operator is asked
            release_timeout_s   0.5 to 30     commander consented, partner connected, release missing this long: the
                                              vehicle commits
            forced_timeout_s    0.2 to 10     the commander is lost: a forced transfer may take this long
            retry_pause_s       0.1 to 60     pause before a failed transfer is tried again
            denied_pause_s      0.1 to 600    the same after an operator's denial
            result_timeout_s    1 to 120      how long the result is repeated to a station that does not show it
            enter_margin_m      0 to 1000     a zone is entered this far inside its border
            leave_margin_m      0 to 1000     and left this far outside
            dwell_s             0 to 600      no transfer for a zone's sake sooner than this after the last one, unless
                                              coverage ends
            hold_lead_s         1 to 60       the last coverage that counts ends within this time along the track: the
                                              aircraft is to stop
            answer_s            0.3 to 10     a station that was asked and has not taken the aircraft after this time
                                              does not count as able to
            hold_s              0 to 3600     how long the aircraft holds before the end of coverage; then it returns
            obey_s              2 to 30       a commanded mode that does not show for this long is commanded again, then
                                              the next graver one
            stuck_s             10 to 600     a return that gets no nearer, or a landing that does not come down, for
                                              this long has failed
            rehearsal_lost_s    10 to 3600    a rehearsal on the ground ends after this time without a commander
            link_weak_s         0 to 60       the commander's links have been weak this long, and
            link_steady_s       0 to 600      a partner's good this long: reason enough to move authority
            position_stale_s    0.2 to 30     an older position counts as lost
            autopilot_lost_s    1.5 to 30     an older heartbeat of the autopilot counts as lost
            guard_lost_s        1 to 30       an older status of the guard counts as lost
            """,
        Limits(),
    ),
    "When something is lost, how long a step may take, margins at the border of a zone.",
)

# ---- causes --------------------------------------------------------------------------------------------------------

_HELD_NOWHERE: Final = '; "hold" comes to "return": it is outside its commander\'s zone then, and held only inside'


def _policy(cause: Cause) -> Key:
    says = CAUSES[cause].meaning + (_HELD_NOWHERE if cause is Cause.NO_STATION else "")
    policies = CAUSES[cause].policies
    return word(cause.value, policies, says, policies[0])


def _wait(cause: Cause, default_s: float) -> Key:
    return number(cause.value, 0, 600, "see [policy]", default_s, unit="s")


POLICY: Final = KeyTable(
    "policy",
    tuple(_policy(cause) for cause in Cause),
    "What is done at the most about each thing that may be wrong: warn; hold (stop inside coverage, or return if that "
    "is not possible); return (RTL, or land if no return site is in reach); land; off (not looked at). On the ground, "
    "and while a pilot steers, everything is a warning.",
)
HOLD_OFF: Final = KeyTable(
    "hold_off",
    tuple(_wait(cause, CAUSES[cause].hold_off_s) for cause in Cause),
    "How long each condition must last until it counts as a cause. Shorter ones are ignored.",
)
CLEAR: Final = KeyTable(
    "clear",
    tuple(_wait(cause, CAUSES[cause].clear_s) for cause in Cause),
    "How long the condition must be over until the cause ends.",
)

# ---- links, commands -----------------------------------------------------------------------------------------------

#: a station's heartbeat comes once a second, so less than 1.5 s of silence is meaningless
LINKS: Final = KeyTable(
    "links",
    numbers(
        """
            silence_s       1.5 to 60   nothing genuine heard for this long
            loss            0.01 to 1   share of frames lost, up or down; 1 is never exceeded
            round_trip_s    0.05 to 30  median of the probes' round trips
            bad_signatures  1 to 1000   in the last 10 s: another sender pretends to be this station
            hold_s          0.1 to 60   a value must be over its limit, or well below it again, this long
            """,
        LinkLimits(),
    ),
    "From when on one link of a station is called bad.",
)
#: an allowance below the longest frame (280 bytes) would never let that one through
OBSERVERS: Final = KeyTable(
    "observers",
    numbers(
        """
            message_hz   0.1 to 100      the fastest that one message is granted
            bytes_per_s  300 to 1000000  for all that it asked for
            silence_s    2 to 3600       an observer silent this long has to ask again
            """,
        ObserverLimits(),
    ),
    "What one observer may take of the downlink, beyond what every station hears.",
)
_LEFT: Final = {
    Limit.ENERGY: "too little for the way there and back to a place, with the reserve",
    Limit.FENCE: "the geofence of the mission",
    Limit.COVERAGE: "out of the zones of stations that could take the aircraft",
}
COMMANDS: Final = KeyTable(
    "commands",
    tuple(word(limit.value, POLICIES, _LEFT[limit], POLICIES[0]) for limit in Limit),
    "What to do with a command of the commander that would leave one of these: refuse (with the reason; its operator "
    "may send it again after 10 s to insist), warn (it is carried out), off. RTL, LAND, LOITER, BRAKE and a pause are "
    "never refused.",
)

#: in the order in which they stand in the sample and in the reference
VEHICLE_FILE: Final = (
    VEHICLE,
    STATION,
    LIMITS,
    POLICY,
    HOLD_OFF,
    CLEAR,
    LINKS,
    OBSERVERS,
    ENERGY,
    ROUTE,
    COMMANDS,
    POSITION,
    FEEDS,
    REMOTE_ID,
    ONBOARD,
    PAYLOAD,
)
