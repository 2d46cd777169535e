# SPDX-License-Identifier: GPL-3.0-or-later

"""What a station has open at the autopilot, and the frames that close it when the station's authority ends.

At a commit the former commander may be in the middle of something: an upload, a file it writes, sticks that
override the pilot's, a velocity that it streams. Its next frames are refused, so nobody would end it. The
companion does, at once, in the former commander's name: the autopilot binds each of these to the system and
component that began it. Rules, from ArduPilot's source:

1. **Upload of mission, fence or rally points** (MissionItemProtocol): it belongs to its sender and blocks everybody
   else's for 8 s of silence. MISSION_ACK from a station is ignored. A new MISSION_COUNT of the same sender ends the
   old upload before the count is looked at, and one that is too large is then refused: nothing is truncated,
   nothing begins. MISSION_CLEAR_ALL would end it too, and take the mission with it. What had arrived of a mission or
   of rally points is stored already and stays (a fence is swapped only when it is whole); `Closing.incomplete` says so.
2. **File open for writing** (GCS_FTP): one for everybody. TerminateSession closes it, and closing is what applies
   a parameter or mission file, half-written or not. So the header of such a file is overwritten with zeros first:
   a file without its magic number is thrown away. Left alone it would be closed, and applied, whenever some
   station next asks for a file. They are closed at arming too (`arming`: nobody may write them then), and mission
   files before a mission package is written (`mission_files`: closed afterwards, they would replace its mission).
   What a request says is not what has happened: a file counts as open until the autopilot has acknowledged its end,
   or refused to open it. A second one that is refused, because one is open, does not hide the first.
3. **Sticks** (RC_CHANNELS_OVERRIDE, its second version, MANUAL_CONTROL): released; the autopilot would wait for
   RC_OVERRIDE_TIME, as it does with channels of the second version beyond the 18th.
4. **Guided stream** of velocity, acceleration or attitude: zero velocity. GUID_TIMEOUT (3 s) would stop it as well;
   until then the aircraft would go on as the former commander said last. A place to fly to is not a stream: the
   aircraft goes there and holds, as it does when no handover takes place, and the new commander decides. Outside
   GUIDED the autopilot ignores the frame. A plane is sent nothing: it knows no velocity, and up to ArduPlane 4.6 it
   flies to the height in such a frame whatever the mask leaves out. It forgets an attitude after 3 s by itself.
5. **Log download**: ended, it fills the channel.

Nothing is sent for what has ended: the autopilot's answers (`heard`) and the station's own frames tell.
Memory is bounded: `_MOST_OPEN` of a kind for one station; the oldest is forgotten first, of files the oldest that the
autopilot has not acknowledged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.judge import Fate, Verdict
from mavproxy_handover.gate.policy.files import is_mission_file, is_upload
from mavproxy_handover.gate.policy.parts import MISSION_TYPES
from mavproxy_handover.wire.file_transfer import DATA, Head, head_of
from mavproxy_handover.wire.file_transfer import message as file_message
from mavproxy_handover.wire.frames import Frame, field_bytes, field_int, target
from mavproxy_handover.wire.ids import (
    AUTOPILOT_COMPID,
    FTP_ACK,
    FTP_CREATE,
    FTP_NAK,
    FTP_OPEN_WRITE,
    FTP_RESET,
    FTP_TERMINATE,
    FTP_WRITE,
    MISSION_START,
)

__all__ = ["Closing", "FlushTracker"]

_MOST_OPEN: Final = 8
#: More items than any autopilot stores: the count is refused after it has ended the upload before it.
_TOO_MANY_ITEMS: Final = 0xFFFF

#: Sequence number, session, opcode, size of the data, opcode that is answered.
_HEADER_BYTES: Final = 12  #: at least as long as the headers of parameter and mission files

#: MAV_MISSION_TYPEs that a flight goes by
_FLOWN_LISTS: Final = (mavlink.MAV_MISSION_TYPE_MISSION, mavlink.MAV_MISSION_TYPE_FENCE)
_COUNT: Final = mavlink.MAVLINK_MSG_ID_MISSION_COUNT
_PARTIAL: Final = mavlink.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST
_ITEMS: Final = (mavlink.MAVLINK_MSG_ID_MISSION_ITEM, mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT)
_ACK: Final = mavlink.MAVLINK_MSG_ID_MISSION_ACK
_FTP: Final = mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL
_STICKS: Final = tuple(
    msgid
    for msgid, cls in mavlink.mavlink_map.items()
    if cls.msgname in ("RC_CHANNELS_OVERRIDE", "RC_CHANNELS_OVERRIDE_V2", "MANUAL_CONTROL")
)
_TARGETS: Final = (
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
)
_ATTITUDE: Final = mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET
_LOG_BEGINS: Final = (mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST, mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA)
_LOG_END: Final = mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END
_COMMANDS: Final = (mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_COMMAND_INT)

#: What gives GUIDED another aim, or leaves it: a stream before it has no part in the flight any more.
_NEW_AIMS: Final = (
    mavlink.MAV_CMD_DO_REPOSITION,
    mavlink.MAV_CMD_NAV_TAKEOFF,
    mavlink.MAV_CMD_NAV_LAND,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
    mavlink.MAV_CMD_NAV_LOITER_UNLIM,
    mavlink.MAV_CMD_DO_SET_MODE,
    MISSION_START,
)
_VELOCITY_IGNORED: Final = 0b111 << 3
_ACCELERATION_IGNORED: Final = 0b111 << 6
#: Only the velocity counts: position, acceleration, yaw and yaw rate are ignored.
_ONLY_VELOCITY: Final = 0b1101_1100_0111
#: What an upload survives: an item out of turn, and a question by its own sender that had to wait for its end.
_UPLOAD_GOES_ON: Final = (mavlink.MAV_MISSION_INVALID_SEQUENCE, mavlink.MAV_MISSION_DENIED)
_GUIDED_ITEM: Final = 2  #: MISSION_ITEM.current: not an item but a place to fly to

_Sender = tuple[int, int]  #: system, component


@dataclass(frozen=True, slots=True)
class Closing:
    """One thing that was open, and the frames to the autopilot that close it, in the name of who opened it."""

    what: str  #: for journal and console
    frames: tuple[bytes, ...]
    incomplete: bool = False  #: what the autopilot stores may be a mixture of old and new


_FileName = tuple[_Sender, int, bytes]  #: who, session, path


@dataclass(frozen=True, slots=True)
class _File:
    component: int  #: that the file is open at
    asked: int  #: sequence number of the request to open it
    sequence: int  #: of the sender's last request
    acknowledged: bool = False  #: the autopilot has opened it


@dataclass(slots=True)
class _Open:
    """What one station has open. Values are the component that was addressed, or a file."""

    uploads: dict[tuple[_Sender, int], int] = field(default_factory=dict)  #: by sender and mission type
    files: dict[_FileName, _File] = field(default_factory=dict)
    sticks: dict[_Sender, int] = field(default_factory=dict)
    streams: dict[_Sender, int] = field(default_factory=dict)
    logs: dict[_Sender, int] = field(default_factory=dict)


class FlushTracker:
    """Follows what stations have open. Give it every frame of a station with its verdict, and what comes back."""

    def __init__(self, vehicle_sysid: int) -> None:
        self._vehicle = vehicle_sysid
        self._open: dict[int, _Open] = {}
        self._handlers: dict[int, Callable[[Frame, _Open, _Sender, int], None]] = {
            _COUNT: self._saw_upload,
            _PARTIAL: self._saw_upload,
            _FTP: self._saw_file,
            **dict.fromkeys(_ITEMS, self._saw_item),
            **dict.fromkeys(_STICKS, self._saw_sticks),
            **dict.fromkeys(_TARGETS, self._saw_target),
            _ATTITUDE: self._saw_attitude,
            mavlink.MAVLINK_MSG_ID_SET_MODE: self._saw_mode,
            **dict.fromkeys(_COMMANDS, self._saw_command),
            **dict.fromkeys(_LOG_BEGINS, self._saw_log),
            _LOG_END: self._saw_log,
        }

    def saw(self, frame: Frame, verdict: Verdict, station_sysid: int) -> None:
        """A frame of a station; only what was forwarded to the autopilot can have opened or ended anything there."""
        if verdict.fate is not Fate.FORWARD:
            return
        handler = self._handlers.get(frame.msgid)
        if handler is None:
            return
        aim = target(frame)
        component = aim[1] if aim is not None and aim[1] != 0 else AUTOPILOT_COMPID
        opened = self._open.get(station_sysid)
        if opened is None:
            opened = self._open[station_sysid] = _Open()
        handler(frame, opened, (frame.sysid, frame.compid), component)

    def heard(self, frame: Frame) -> None:
        """A frame of the autopilot: it says when an upload has ended, or that a file is not open."""
        if frame.msgid == _ACK:
            self._heard_ack(frame)
        elif frame.msgid == _FTP:
            self._heard_file(frame)

    def flush(self, station_sysid: int, *, wings: bool = False) -> list[Closing]:
        """Close everything that a station has open, and forget it. `wings`: no stream is stopped (rule 4)."""
        opened = self._open.pop(station_sysid, None)
        if opened is None:
            return []
        closings = [self._close_sticks(sender, at) for sender, at in opened.sticks.items()]
        if not wings:
            closings += [self._close_stream(sender, at) for sender, at in opened.streams.items()]
        closings += [self._close_upload(sender, kind, at) for (sender, kind), at in opened.uploads.items()]
        # One session may have had several: what closing would apply is spoiled before anything closes it.
        files = sorted(opened.files.items(), key=lambda entry: not is_upload(entry[0][2]))
        closings += [self._close_file(name, file) for name, file in files]
        closings += [self._close_log(sender, at) for sender, at in opened.logs.items()]
        return closings

    def writes(self, station_sysid: int) -> bool:
        """Whether a station has a file open for writing at the autopilot."""
        opened = self._open.get(station_sysid)
        return opened is not None and bool(opened.files)

    @property
    def list_open(self) -> bool:
        """Whether a station is writing the autopilot's mission or geofence: an upload or a mission file is open."""
        return any(
            any(kind in _FLOWN_LISTS for _sender, kind in opened.uploads)
            or any(is_mission_file(name[2]) for name in opened.files)
            for opened in self._open.values()
        )

    def arming(self) -> list[Closing]:
        """Throw away parameter and mission files that are being written: to be called when the vehicle is armed."""
        return self._throw_away(is_upload)

    def mission_files(self) -> list[Closing]:
        """Throw away mission, fence and rally files that are being written."""
        return self._throw_away(is_mission_file)

    def _throw_away(self, concerned: Callable[[bytes], bool]) -> list[Closing]:
        closings = []
        for opened in self._open.values():
            for name, file in list(opened.files.items()):
                if concerned(name[2]):
                    del opened.files[name]
                    closings.append(self._close_file(name, file))
        return closings

    # ---- what opens and ends ----------------------------------------------------------------------------------------

    def _saw_upload(self, frame: Frame, opened: _Open, sender: _Sender, component: int) -> None:
        _remember(opened.uploads, (sender, field_int(frame, "mission_type")), component)

    def _saw_item(self, frame: Frame, opened: _Open, _sender: _Sender, _component: int) -> None:
        if field_int(frame, "current") == _GUIDED_ITEM:
            opened.streams.clear()

    def _saw_file(self, frame: Frame, opened: _Open, sender: _Sender, component: int) -> None:
        request = field_bytes(frame, "payload")
        head = head_of(request)
        if head.opcode in (FTP_CREATE, FTP_OPEN_WRITE):
            name = sender, head.session, request[DATA].partition(b"\0")[0]
            known = opened.files.get(name)
            acknowledged = known is not None and known.acknowledged
            if known is None and len(opened.files) >= _MOST_OPEN:  # rather what may never have been opened
                del opened.files[min(opened.files, key=lambda other: opened.files[other].acknowledged)]
            _remember(opened.files, name, _File(component, head.sequence, head.sequence, acknowledged))
        for name, file in opened.files.items():
            if name[0] == sender:
                opened.files[name] = replace(file, sequence=head.sequence)

    def _saw_sticks(self, _frame: Frame, opened: _Open, sender: _Sender, component: int) -> None:
        _remember(opened.sticks, sender, component)

    def _saw_target(self, frame: Frame, opened: _Open, sender: _Sender, component: int) -> None:
        mask = field_int(frame, "type_mask")
        if mask & _VELOCITY_IGNORED and mask & _ACCELERATION_IGNORED:
            opened.streams.clear()
        else:
            _remember(opened.streams, sender, component)

    def _saw_attitude(self, _frame: Frame, opened: _Open, sender: _Sender, component: int) -> None:
        _remember(opened.streams, sender, component)

    def _saw_mode(self, _frame: Frame, opened: _Open, _sender: _Sender, _component: int) -> None:
        opened.streams.clear()

    def _saw_command(self, frame: Frame, opened: _Open, _sender: _Sender, _component: int) -> None:
        if field_int(frame, "command") in _NEW_AIMS:
            opened.streams.clear()

    def _saw_log(self, frame: Frame, opened: _Open, sender: _Sender, component: int) -> None:
        if frame.msgid == _LOG_END:
            opened.logs.clear()
        else:
            _remember(opened.logs, sender, component)

    def _heard_ack(self, frame: Frame) -> None:
        if field_int(frame, "type") not in _UPLOAD_GOES_ON:
            for opened in self._open.values():
                opened.uploads.pop((_addressee(frame), field_int(frame, "mission_type")), None)

    def _heard_file(self, frame: Frame) -> None:
        head = head_of(field_bytes(frame, "payload"))
        asked = (head.sequence - 1) & 0xFFFF
        session_of = _addressee(frame), head.session
        for opened in self._open.values():
            for name, file in list(opened.files.items()):
                if name[:2] != session_of:
                    continue
                if head.opcode == FTP_ACK and head.answered in (FTP_TERMINATE, FTP_RESET):
                    del opened.files[name]
                elif head.answered in (FTP_CREATE, FTP_OPEN_WRITE) and file.asked == asked:
                    if head.opcode == FTP_ACK:
                        opened.files[name] = replace(file, acknowledged=True)
                    elif head.opcode == FTP_NAK and not file.acknowledged:
                        del opened.files[name]

    # ---- what closes ------------------------------------------------------------------------------------------------

    def _close_upload(self, sender: _Sender, kind: int, component: int) -> Closing:
        count = mavlink.MAVLink_mission_count_message(self._vehicle, component, _TOO_MANY_ITEMS, kind)
        name = MISSION_TYPES.get(kind, str(kind)).lower()
        fence = kind == mavlink.MAV_MISSION_TYPE_FENCE
        return Closing(f"unfinished {name} upload ended", _packed(sender, count), incomplete=not fence)

    def _close_file(self, name: _FileName, file: _File) -> Closing:
        sender, session, path = name
        requests = [(FTP_TERMINATE, 0)]
        if is_upload(path):
            requests.insert(0, (FTP_WRITE, _HEADER_BYTES))  # zeros, at offset zero
        messages = []
        for number, (opcode, size) in enumerate(requests, start=1):
            head = Head((file.sequence + number) & 0xFFFF, session, opcode, size)
            messages.append(file_message((self._vehicle, file.component), head))
        shown = path.decode("ascii", "replace")
        thrown_away = ", contents thrown away" if is_upload(path) else ""
        return Closing(f"file {shown!r} closed{thrown_away}", _packed(sender, *messages), incomplete=not thrown_away)

    def _close_sticks(self, sender: _Sender, component: int) -> Closing:
        # 0 releases channels 1 to 8, UINT16_MAX - 1 the others.
        release = [0] * 8 + [0xFFFE] * 10
        message = mavlink.MAVLink_rc_channels_override_message(self._vehicle, component, *release)
        return Closing("RC override released", _packed(sender, message))

    def _close_stream(self, sender: _Sender, component: int) -> Closing:
        frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
        zeros = [0] * 11  # place, velocity, acceleration, yaw, yaw rate
        stop = mavlink.MAVLink_set_position_target_global_int_message(
            0, self._vehicle, component, frame, _ONLY_VELOCITY, *zeros
        )
        return Closing("guided stream stopped", _packed(sender, stop))

    def _close_log(self, sender: _Sender, component: int) -> Closing:
        message = mavlink.MAVLink_log_request_end_message(self._vehicle, component)
        return Closing("log download ended", _packed(sender, message))


def _remember(entries: dict, key: object, value: object) -> None:  # type: ignore[type-arg]
    entries.pop(key, None)
    entries[key] = value
    if len(entries) > _MOST_OPEN:
        del entries[next(iter(entries))]


def _packed(sender: _Sender, *messages: mavlink.MAVLink_message) -> tuple[bytes, ...]:
    as_sender = mavlink.MAVLink(None, srcSystem=sender[0], srcComponent=sender[1])
    return tuple(bytes(message.pack(as_sender)) for message in messages)


def _addressee(frame: Frame) -> _Sender:
    return field_int(frame, "target_system"), field_int(frame, "target_component")
