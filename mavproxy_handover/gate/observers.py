# SPDX-License-Identifier: GPL-3.0-or-later

"""Thins telemetry for stations that do not command, out of the streams that flow already.

The autopilot sends at rates that the commander and the companion have asked for. A request of an observer never reaches
it: the autopilot has one channel to the companion, and load for one station would delay all of them. The companion
answers the request itself, and passes on every n-th message to keep to it. Rules:

1. `ALWAYS` goes to every station, as often as it comes. No station can ask for less of it.
2. `DEFAULTS` go to every station at their interval, unless it asked for another.
3. `WISHES` go to the stations that asked. Nothing else can be asked for: no parameters, files or tunnels.
4. No message is granted more often than `ObserverLimits.message_hz`. What goes beyond `DEFAULTS` is limited to
   `ObserverLimits.bytes_per_s` for each station.
5. SET_MESSAGE_INTERVAL and GET_MESSAGE_INTERVAL are acknowledged in the name of the component that was asked, or of
   the autopilot if all were asked. The answer tells the interval that is kept. REQUEST_DATA_STREAM asks for a group,
   as in ArduCopter, and has no answer.
6. Requests end when the station commands, and then asks the autopilot itself (`forget`). They also end when nothing
   came from the station for `ObserverLimits.silence_s`.

`questions.py` decides which other reads of an observer pass, and how often.
Memory is bounded: by the messages that may be asked for, and by `_MOST_SOURCES` of them.

Sources: MAVLink message-interval microservice; stream groups of ArduCopter's GCS_MAVLink_Copter.cpp.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.policy.access import names
from mavproxy_handover.wire.frames import Frame, field_bytes, field_int
from mavproxy_handover.wire.ids import AVAILABLE_MODES_MONITOR
from mavproxy_handover.wire.message_ids import COMMAND_MESSAGES, MESSAGE_IDS, message_ids

__all__ = ["ALWAYS", "DEFAULTS", "STREAMS", "WISHES", "ObserverLimits", "ObserverRates"]

#: Messages for every station, as often as they come: they are rare, or a station cannot work without them. Traffic,
#: threats of collision and the state of Remote ID are for every station, too: each may command next.
ALWAYS: Final = names("""
    HEARTBEAT AUTHORITY_STATUS CONTROL_STATUS STATUSTEXT ADSB_VEHICLE COLLISION OPEN_DRONE_ID_ARM_STATUS
""")

#: Messages for every station, and the seconds between two.
DEFAULTS: Final = {"GLOBAL_POSITION_INT": 0.2, "SYS_STATUS": 1.0, "BATTERY_STATUS": 1.0}

#: Messages that an observer may ask for: telemetry of the aircraft, which commands nothing.
WISHES: Final = names("""
    ATTITUDE ATTITUDE_QUATERNION VFR_HUD AHRS AHRS2 LOCAL_POSITION_NED ALTITUDE HOME_POSITION GPS_GLOBAL_ORIGIN
    GPS_RAW_INT GPS2_RAW GPS_RTK GPS2_RTK SYSTEM_TIME POWER_STATUS MEMINFO MCU_STATUS HWSTATUS EXTENDED_SYS_STATE
    MISSION_CURRENT MISSION_ITEM_REACHED NAV_CONTROLLER_OUTPUT POSITION_TARGET_GLOBAL_INT POSITION_TARGET_LOCAL_NED
    FENCE_STATUS RC_CHANNELS RC_CHANNELS_RAW SERVO_OUTPUT_RAW RAW_IMU SCALED_IMU SCALED_IMU2 SCALED_IMU3
    SCALED_PRESSURE SCALED_PRESSURE2 SCALED_PRESSURE3 WIND VIBRATION EKF_STATUS_REPORT RANGEFINDER DISTANCE_SENSOR
    TERRAIN_REPORT BATTERY2 RPM ESC_TELEMETRY_1_TO_4 ESC_TELEMETRY_5_TO_8
""")

#: MAV_DATA_STREAM -> its messages that an observer may ask for. 0 is all of them.
STREAMS: Final = {
    1: names("RAW_IMU SCALED_IMU SCALED_IMU2 SCALED_IMU3 SCALED_PRESSURE SCALED_PRESSURE2 SCALED_PRESSURE3"),
    2: names("""
        SYS_STATUS POWER_STATUS MCU_STATUS MEMINFO MISSION_CURRENT GPS_RAW_INT GPS2_RAW GPS_RTK GPS2_RTK
        NAV_CONTROLLER_OUTPUT FENCE_STATUS POSITION_TARGET_GLOBAL_INT
    """),
    3: names("SERVO_OUTPUT_RAW RC_CHANNELS RC_CHANNELS_RAW"),
    6: names("GLOBAL_POSITION_INT LOCAL_POSITION_NED"),
    10: names("ATTITUDE AHRS2"),
    11: names("VFR_HUD"),
    12: names("""
        AHRS WIND RANGEFINDER DISTANCE_SENSOR SYSTEM_TIME TERRAIN_REPORT BATTERY2 BATTERY_STATUS VIBRATION
        EKF_STATUS_REPORT RPM ESC_TELEMETRY_1_TO_4 ESC_TELEMETRY_5_TO_8 HWSTATUS
    """),
}

_ALL_STREAMS: Final = 0
#: Sources of messages that are told apart for one station: component, message, instance.
_MOST_SOURCES: Final = 512
#: A message may come early by this part of its interval: senders are not punctual, and a message that comes a
#: millisecond early would otherwise be lost.
_EARLY: Final = 0.25
_NEVER: Final = math.inf

#: and the notice that the list of modes has changed: it is rare, and the installed dialect does not know it
_ALWAYS_IDS: Final = frozenset((*(MESSAGE_IDS[name] for name in ALWAYS), AVAILABLE_MODES_MONITOR))
_DEFAULT_INTERVALS: Final = {MESSAGE_IDS[name]: interval_s for name, interval_s in DEFAULTS.items()}
_GRANTABLE: Final = message_ids(*DEFAULTS, *WISHES)
_STREAM_IDS: Final = {
    number: tuple(MESSAGE_IDS[name] for name in group if name in MESSAGE_IDS)
    for number, group in (*STREAMS.items(), (_ALL_STREAMS, (*DEFAULTS, *WISHES)))
}
_REQUEST_DATA_STREAM: Final = mavlink.MAVLINK_MSG_ID_REQUEST_DATA_STREAM
_SET_INTERVAL: Final = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
_GET_INTERVAL: Final = mavlink.MAV_CMD_GET_MESSAGE_INTERVAL
_FLOAT: Final = struct.Struct("<f")


def _instances() -> dict[int, str]:
    """Message id -> the field that numbers the battery or sensor. Each of them has its own interval."""
    fields = {msgid: getattr(mavlink.mavlink_map[msgid], "instance_field", None) for msgid in _GRANTABLE}
    return {msgid: name for msgid, name in fields.items() if name is not None}


_INSTANCES: Final = _instances()


@dataclass(frozen=True, slots=True)
class ObserverLimits:
    """The share of the downlink for one observer. Raises ValueError if nothing would get through."""

    message_hz: float = 10.0  #: of one kind of message
    bytes_per_s: float = 4000.0  #: of everything that it asked for
    silence_s: float = 30.0  #: after which it has to ask again

    def __post_init__(self) -> None:
        for name in ("message_hz", "bytes_per_s", "silence_s"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} = {getattr(self, name)}: must be above 0")


@dataclass(slots=True)
class _Observer:
    wishes: dict[int, float] = field(default_factory=dict)  #: message id -> seconds between two
    due_at: dict[tuple[int, int, int | None], float] = field(
        default_factory=dict
    )  #: (component, message, instance) -> time
    allowance: float = 0.0  #: bytes that may still go out
    counted_at: float = -math.inf
    heard_at: float = -math.inf


class ObserverRates:
    """The requests of observers, and whether a message is due. Time is an argument (monotonic seconds)."""

    def __init__(self, limits: ObserverLimits | None = None) -> None:
        self._limits = limits or ObserverLimits()
        self._observers: dict[int, _Observer] = {}

    def asked(self, frame: Frame, station_sysid: int, now: float) -> list[mavlink.MAVLink_message]:
        """Accept a request for rates that the gate gave to the companion (`Access.ANSWERED`). Returns the answers.

        The caller packs them in the name of the component that was asked (`Replies.answer_rates`).
        """
        if not frame.known:
            return []
        observer = self._observers.setdefault(station_sysid, _Observer())
        observer.heard_at = now
        if frame.msgid == _REQUEST_DATA_STREAM:
            self._stream(frame, observer)
        if frame.msgid not in COMMAND_MESSAGES:
            return []
        command = field_int(frame, "command")
        wanted = _float(frame, "param1")
        msgid = int(wanted) if math.isfinite(wanted) and wanted == int(wanted) else None
        if command == _SET_INTERVAL:
            return [_ack(frame, command, self._set(observer, msgid, _float(frame, "param2")))]
        if command != _GET_INTERVAL:
            return []
        if msgid is None or msgid not in mavlink.mavlink_map:
            return [_ack(frame, command, mavlink.MAV_RESULT_DENIED)]
        told = mavlink.MAVLink_message_interval_message(msgid, self._interval_us(observer, msgid))
        return [_ack(frame, command, mavlink.MAV_RESULT_ACCEPTED), told]

    def note_heard(self, station_sysid: int, now: float) -> None:
        """Note that a frame of the station came: its requests stay."""
        observer = self._observers.get(station_sysid)
        if observer is not None:
            observer.heard_at = now

    def due(self, frame: Frame, station_sysid: int, now: float) -> bool:
        """Whether an observer gets this message now. If so, it counts as sent."""
        msgid = frame.msgid
        if msgid in _ALWAYS_IDS:
            return True
        observer = self._observers.get(station_sysid)
        if observer is None:
            observer = self._observers[station_sysid] = _Observer()
        default_s = _DEFAULT_INTERVALS.get(msgid, _NEVER)
        if observer.wishes and now - observer.heard_at > self._limits.silence_s:
            observer.wishes.clear()
        interval_s = observer.wishes.get(msgid, default_s)
        if interval_s == _NEVER:
            return False
        instance = _INSTANCES.get(msgid)
        source = (frame.compid, msgid, None if instance is None else field_int(frame, instance))
        due_at = observer.due_at.get(source, now)
        early_s = _EARLY * interval_s
        if now < due_at - early_s:
            return False
        if interval_s < default_s and not self._affords(observer, len(frame.raw), now):
            return False
        if len(observer.due_at) >= _MOST_SOURCES:
            observer.due_at.clear()
        observer.due_at[source] = max(due_at, now - early_s) + interval_s
        return True

    def forget(self, station_sysid: int) -> None:
        """Drop the requests of a station, because it commands."""
        self._observers.pop(station_sysid, None)

    def _set(self, observer: _Observer, msgid: int | None, interval_us: float) -> int:
        """Note a request. Returns the result to acknowledge."""
        if (
            msgid is None
            or msgid not in _GRANTABLE
            or not math.isfinite(interval_us)
            or (interval_us < 0 and interval_us != -1)
        ):
            denied: int = mavlink.MAV_RESULT_DENIED
            return denied
        if interval_us == 0:
            observer.wishes.pop(msgid, None)
        else:
            self._wish(observer, msgid, _NEVER if interval_us == -1 else interval_us / 1e6)
        accepted: int = mavlink.MAV_RESULT_ACCEPTED
        return accepted

    def _stream(self, frame: Frame, observer: _Observer) -> None:
        group = _STREAM_IDS.get(field_int(frame, "req_stream_id"), ())
        rate_hz = field_int(frame, "req_message_rate")
        start = field_int(frame, "start_stop") == 1 and rate_hz > 0
        for msgid in group:
            if start:
                self._wish(observer, msgid, 1.0 / rate_hz)
            else:
                observer.wishes.pop(msgid, None)

    def _wish(self, observer: _Observer, msgid: int, interval_s: float) -> None:
        observer.wishes[msgid] = max(interval_s, 1.0 / self._limits.message_hz)

    def _interval_us(self, observer: _Observer, msgid: int) -> int:
        """The interval for MESSAGE_INTERVAL. -1: off; 0: the message cannot be asked for."""
        if msgid not in _GRANTABLE:
            return 0
        interval_s = observer.wishes.get(msgid, _DEFAULT_INTERVALS.get(msgid, _NEVER))
        return -1 if interval_s == _NEVER else min(round(interval_s * 1e6), 0x7FFFFFFF)

    def _affords(self, observer: _Observer, length: int, now: float) -> bool:
        """Whether the station's allowance has `length` bytes left. If so, spend them. It fills up within a second."""
        rate = self._limits.bytes_per_s
        observer.allowance = min(rate, observer.allowance + max(0.0, now - observer.counted_at) * rate)
        observer.counted_at = now
        if observer.allowance < length:
            return False
        observer.allowance -= length
        return True


def _float(frame: Frame, name: str) -> float:
    value: float = _FLOAT.unpack(field_bytes(frame, name))[0]
    return value


def _ack(frame: Frame, command: int, result: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_command_ack_message(command, result, 0, 0, frame.sysid, frame.compid)
