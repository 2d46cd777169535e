# SPDX-License-Identifier: GPL-3.0-or-later

"""Chooses the stations that hear each frame of the vehicle.

The commander hears everything. During a transfer the partner does too, because it must see the aircraft before it takes
the aircraft. An observer hears general frames (heartbeat, authority, position, battery, status texts), frames that are
addressed to it, answers to its questions, and the telemetry that it asked for at the rates of `observers`. Rules:

1. Lease, guard status and frames addressed to the companion or to an onboard program never leave the vehicle. The gate
   also keeps the answers to the companion's own reads of parameters aboard (`own_reads`).
2. A frame addressed to a station goes to that station only, whatever the roles of the stations are.
3. Answers without an address (a parameter, a version) are known only by the question. A question opens a window for the
   ids that answer it. If one question has many answers, each answer extends the window, but never past `LIMIT_S` after
   the question: otherwise the answers to other stations would keep it open. If a question has one answer, it is good
   for `EACH` messages. So a station cannot get round `observers` by asking again and again for a stream.
4. A station that commands asks the autopilot itself for rates. The rates that it had asked of the companion are
   forgotten.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import AuthorityView
from mavproxy_handover.gate.judge import StationIdentity
from mavproxy_handover.gate.observers import ALWAYS, DEFAULTS, ObserverRates
from mavproxy_handover.wire.frames import Frame, field_bytes, field_int, target
from mavproxy_handover.wire.ids import (
    AVAILABLE_MODES,
    COMPANION_COMPID,
    GUARD_STATUS_TUNNEL,
    LEASE_TUNNEL,
    RATES_COMPID,
)
from mavproxy_handover.wire.message_ids import COMMAND_MESSAGES, MESSAGE_IDS

__all__ = [
    "ANSWERS",
    "COMMAND_ANSWERS",
    "EACH",
    "FOR_EVERYBODY",
    "LIMIT_S",
    "WINDOW_S",
    "DownlinkPolicy",
    "stays_aboard",
]

#: An answer counts within this time after its question, or after an answer that extended the window.
WINDOW_S: Final = 5.0

#: The longest window of one question: a parameter list over a slow link.
LIMIT_S: Final = 300.0

#: Messages that may be the answer to one question: an answer to another station or a stream may come first.
EACH: Final = 4
#: The most such messages that are expected at once, for any number of questions.
_MOST: Final = 1000

#: What every known station hears.
FOR_EVERYBODY: Final = (*ALWAYS, *DEFAULTS)


@dataclass(frozen=True, slots=True)
class Answers:
    """The messages that answer a question; `many` if there is more than one, so that each extends the window."""

    names: tuple[str, ...]
    many: bool = False


#: Answers to messages. In MAVLink 2 an answer has the address of the station that asked; these names cover the answers
#: without an address. A name that the installed dialect lacks is ignored.
ANSWERS: Final = {
    "PING": Answers(("PING",)),
    "TIMESYNC": Answers(("TIMESYNC",)),
    "PARAM_REQUEST_READ": Answers(("PARAM_VALUE", "PARAM_ERROR")),
    "PARAM_REQUEST_LIST": Answers(("PARAM_VALUE",), many=True),
    "PARAM_EXT_REQUEST_READ": Answers(("PARAM_EXT_VALUE",)),
    "PARAM_EXT_REQUEST_LIST": Answers(("PARAM_EXT_VALUE",), many=True),
    "MISSION_REQUEST_LIST": Answers(("MISSION_COUNT", "MISSION_ACK")),
    "MISSION_REQUEST": Answers(("MISSION_ITEM", "MISSION_ITEM_INT", "MISSION_ACK")),
    "MISSION_REQUEST_INT": Answers(("MISSION_ITEM_INT", "MISSION_ACK")),
    "MISSION_REQUEST_PARTIAL_LIST": Answers(("MISSION_ITEM", "MISSION_ITEM_INT", "MISSION_ACK"), many=True),
    "FENCE_FETCH_POINT": Answers(("FENCE_POINT",)),
    "AUTOPILOT_VERSION_REQUEST": Answers(("AUTOPILOT_VERSION",)),
    "REQUEST_EVENT": Answers(("EVENT", "RESPONSE_EVENT_ERROR"), many=True),
    "OSD_PARAM_SHOW_CONFIG": Answers(("OSD_PARAM_SHOW_CONFIG_REPLY",)),
    "GOPRO_GET_REQUEST": Answers(("GOPRO_GET_RESPONSE",)),
    "TERRAIN_CHECK": Answers(("TERRAIN_REPORT",)),
    "FILE_TRANSFER_PROTOCOL": Answers(("FILE_TRANSFER_PROTOCOL",), many=True),
}

#: Answers to commands, besides COMMAND_ACK. Names without their MAV_CMD_.
COMMAND_ANSWERS: Final = {
    "REQUEST_PROTOCOL_VERSION": Answers(("PROTOCOL_VERSION",)),
    "REQUEST_AUTOPILOT_CAPABILITIES": Answers(("AUTOPILOT_VERSION",)),
    "REQUEST_CAMERA_INFORMATION": Answers(("CAMERA_INFORMATION",)),
    "REQUEST_CAMERA_SETTINGS": Answers(("CAMERA_SETTINGS",)),
    "REQUEST_STORAGE_INFORMATION": Answers(("STORAGE_INFORMATION",)),
    "REQUEST_CAMERA_CAPTURE_STATUS": Answers(("CAMERA_CAPTURE_STATUS",)),
    "REQUEST_FLIGHT_INFORMATION": Answers(("FLIGHT_INFORMATION",)),
    "REQUEST_VIDEO_STREAM_INFORMATION": Answers(("VIDEO_STREAM_INFORMATION",)),
    "REQUEST_VIDEO_STREAM_STATUS": Answers(("VIDEO_STREAM_STATUS",)),
    "GET_HOME_POSITION": Answers(("HOME_POSITION", "GPS_GLOBAL_ORIGIN")),
    "UAVCAN_GET_NODE_INFO": Answers(("UAVCAN_NODE_INFO", "UAVCAN_NODE_STATUS"), many=True),
}

_COMMANDS: Final[dict[str, int]] = {e.name: number for number, e in mavlink.enums["MAV_CMD"].items()}


def _ids(answers: Answers) -> tuple[int, ...]:
    return tuple(MESSAGE_IDS[name] for name in answers.names if name in MESSAGE_IDS)


#: Question -> (ids of its answers, whether there are many).
_BY_MESSAGE: Final = {MESSAGE_IDS[name]: (_ids(a), a.many) for name, a in ANSWERS.items() if name in MESSAGE_IDS}
_BY_COMMAND: Final = {
    _COMMANDS[f"MAV_CMD_{name}"]: (_ids(a), a.many)
    for name, a in COMMAND_ANSWERS.items()
    if f"MAV_CMD_{name}" in _COMMANDS
}

_COMMAND_ACK: Final = mavlink.MAVLINK_MSG_ID_COMMAND_ACK
_TUNNEL: Final = mavlink.MAVLINK_MSG_ID_TUNNEL
_REQUEST_MESSAGE: Final = mavlink.MAV_CMD_REQUEST_MESSAGE
_QUESTIONS: Final = frozenset({*_BY_MESSAGE, *COMMAND_MESSAGES})
#: components that the companion asks the autopilot as
_COMPANION: Final = (COMPANION_COMPID, RATES_COMPID)
_FLOAT: Final = struct.Struct("<f")


@dataclass(slots=True)
class _Window:
    until: float  #: monotonic seconds
    limit: float  #: never extended past this
    many: bool
    left: int  #: messages that may still be an answer, if there are not many


def stays_aboard(frame: Frame, aim: tuple[int, int] | None, aboard: Collection[int]) -> bool:
    """Rule 1: lease, guard status, and frames of a component of the vehicle to one of the components `aboard`."""
    if frame.msgid == _TUNNEL and field_int(frame, "payload_type") in (LEASE_TUNNEL, GUARD_STATUS_TUNNEL):
        return True
    return aim is not None and aim[0] == frame.sysid and aim[1] in aboard


def _answers_to(frame: Frame) -> list[tuple[tuple[int, ...], bool]]:
    """The messages that may answer a question of a station."""
    if frame.msgid in _BY_MESSAGE:
        return [_BY_MESSAGE[frame.msgid]]
    command = field_int(frame, "command")
    answers: list[tuple[tuple[int, ...], bool]] = [((_COMMAND_ACK,), False)]
    if command == _REQUEST_MESSAGE:
        wish = _FLOAT.unpack(field_bytes(frame, "param1"))[0]
        if math.isfinite(wish) and (int(wish) in mavlink.mavlink_map or int(wish) == AVAILABLE_MODES):
            answers.append(((int(wish),), int(wish) == AVAILABLE_MODES))  # one request may ask for every mode
    elif command in _BY_COMMAND:
        answers.append(_BY_COMMAND[command])
    return answers


class DownlinkPolicy:
    """Chooses, for each frame of the vehicle and each station, whether the station gets it.

    Knows the stations, so that it can tell a frame addressed to one of them from one addressed to a component
    of the vehicle. Time is an argument (monotonic seconds).
    """

    def __init__(
        self,
        stations: Iterable[StationIdentity],
        rates: ObserverRates | None = None,
        onboard: Collection[int] = (),
    ) -> None:
        """`onboard`: the components that onboard programs speak as."""
        self._aboard = frozenset((*_COMPANION, *onboard))
        self.rates = rates or ObserverRates()
        self._owner = {sysid: station.sysid for station in stations for sysid in station.sysids}
        self._windows: dict[int, dict[int, _Window]] = {}

    def asked(self, frame: Frame, station_sysid: int, now: float) -> None:
        """Note a question of a station that passed the gate. All other frames are ignored."""
        if not frame.known or frame.msgid not in _QUESTIONS:
            return
        for msgids, many in _answers_to(frame):
            windows = self._windows.setdefault(station_sysid, {})
            for msgid in msgids:
                window = windows.get(msgid)
                if window is None or now > window.until:
                    windows[msgid] = _Window(now + WINDOW_S, now + LIMIT_S, many, EACH)
                    continue
                window.until, window.limit = now + WINDOW_S, now + LIMIT_S
                window.many = window.many or many  # a single question during a list must not shorten the list
                window.left = min(window.left + EACH, _MOST)

    def is_station(self, sysid: int) -> bool:
        """Whether a system id is one of a station."""
        return sysid in self._owner

    def receivers(self, frame: Frame, stations: Iterable[int], view: AuthorityView, now: float) -> list[int]:
        """The stations (system ids) that get this frame of the vehicle. For them it counts as sent.

        An answer that is one of many extends its window.
        """
        aim = target(frame)
        if aim is not None or frame.msgid == _TUNNEL:  # most frames have no address
            if stays_aboard(frame, aim, self._aboard):
                return []
            owner = None if aim is None else self._owner.get(aim[0])
            if owner is not None:
                return [station for station in stations if station == owner]
        found = []
        for station in stations:
            if station == view.commander:
                self.rates.forget(station)
                found.append(station)
            elif (
                station == view.partner
                or self._answers(frame.msgid, station, now)
                or self.rates.due(frame, station, now)
            ):
                found.append(station)
        return found

    def _answers(self, msgid: int, station_sysid: int, now: float) -> bool:
        windows = self._windows.get(station_sysid)
        window = None if windows is None else windows.get(msgid)
        if window is None or now > window.until:
            return False
        if window.many:
            window.until = min(now + WINDOW_S, window.limit)
            return True
        if not window.left:
            return False
        window.left -= 1
        return True
