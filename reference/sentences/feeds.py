# SPDX-License-Identifier: GPL-3.0-or-later

"""Feeds: which station is the source, and why the frames of a station are not used."""

from __future__ import annotations

from typing import Final

from mavproxy_handover.core.common.levels import Level
from reference.sentences.row import NOTHING, Group, Sentence

__all__ = ["GROUPS"]

_SENTENCES: Final = (
    Sentence("{feed}: from {station}.", Level.ADVISORY, "This station is the source of the feed.", NOTHING),
    Sentence(
        "{feed}: from {station} after {other}.",
        Level.ADVISORY,
        "The source was silent, or an earlier station of the order sends again on the ground.",
        "If the change was not meant, look after the program that sends the feed at the other station.",
    ),
    Sentence("{feed}: from {station} again.", Level.ADVISORY, "The source sends again.", NOTHING),
    Sentence(
        "{feed}: none. {station} is silent for {seconds} s.",
        Level.ADVISORY,
        "No station of the order sends corrections that may be used. The position grows less exact.",
        "Look after the base and its program at the station.",
    ),
    Sentence(
        "The base of {station} does not send its place (RTCM 1005 or 1006): a second base is not checked.",
        Level.ADVISORY,
        "The corrections are used. Another station's base could be elsewhere, and then the position would jump.",
        "Switch on message 1005 or 1006 at the base, every ten seconds.",
    ),
    Sentence(
        "{feed} of {station} are not used: {feed_why}.",
        Level.WARNING,
        "Frames of this feed do not go to the autopilot. The reason follows.",
        "Do what the row of the reason says.",
    ),
    Sentence(
        "Remote ID: the place of {station} is not known ('place' in [[stations]] of the mission).",
        Level.WARNING,
        "The vehicle has Remote ID (DID_ENABLE 1), and nothing says where the operator of the commander is.",
        "Write 'place' in the mission's [[stations]], or have the station's program send OPEN_DRONE_ID_SYSTEM.",
    ),
    Sentence(
        "The mission's terrain is at {metres} m where the autopilot's home is at {value} m: it is not sent to the "
        "autopilot. Use heights above the sea.",
        Level.WARNING,
        "The heights of the mission's terrain count from another level than the autopilot's.",
        "Use a grid with heights above the sea, and set home where the plan has it.",
    ),
)
_WHY: Final = (
    Sentence(
        "'{feed_key}' in [feeds] does not name it",
        Level.WARNING,
        "The vehicle's file names the stations that may send the feed, and this one is not among them.",
        "Name the station in [feeds], or end the program that sends.",
    ),
    Sentence(
        "its base is {apart} from that of {station} (rtk_apart_m {metres})",
        Level.WARNING,
        "Corrections of a base elsewhere would move the position.",
        "Correct the place of the base. If each station has a base of its own, raise rtk_apart_m in [feeds].",
    ),
    Sentence(
        "its base has not sent its place (RTCM 1005 or 1006)",
        Level.WARNING,
        "Without its place it cannot be compared with the base that is used.",
        "Wait ten seconds, or switch on message 1005 or 1006 at the base.",
    ),
    Sentence(
        "too many bytes in a second",
        Level.WARNING,
        "The station sends more than its share of the link to the autopilot.",
        "Have the base send fewer messages, or raise rtk_bytes_per_s in [feeds].",
    ),
    Sentence(
        "the line to the autopilot has no more room",
        Level.WARNING,
        "Feeds, onboard programs and payload stations together fill their half of the serial line.",
        "Raise the baud rate of the line, or have one of them send less.",
    ),
    Sentence(
        "a feed with values that cannot be",
        Level.WARNING,
        "A length, a place or a number in the frame is out of range.",
        "Look after the program that sends it.",
    ),
)

GROUPS: Final = (
    Group("feeds", "Feeds", "At all stations, or at the one whose frames are not used.", _SENTENCES),
    Group(
        "feed_why",
        "Why a feed is not used",
        "The reasons in 'FEED of STATION are not used: REASON'.",
        _WHY,
        whole=False,
    ),
)
