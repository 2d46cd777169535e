# SPDX-License-Identifier: GPL-3.0-or-later

"""Tracks what a station has open at the autopilot, and closes it when the station loses authority.

At a commit the former commander may be in the middle of an action: an upload, a file that it writes, sticks that
override the pilot's, a velocity that it streams. The gate refuses its next frames, so the station cannot end it any
more. The companion ends it at once, in the name of the former commander: the autopilot binds each action to the system
and component that began it. Rules, from ArduPilot's source:

1. **Upload of mission, fence or rally points** (MissionItemProtocol). An upload belongs to its sender and blocks all
   other senders until 8 s pass without a message. The autopilot ignores MISSION_ACK from a station. A new MISSION_COUNT
   of the same sender ends the old upload before the autopilot looks at the count. A count that is too large is then
   refused: nothing is cut off, and nothing begins. MISSION_CLEAR_ALL would also end the upload, but would delete the
   mission. Items of a mission or of rally points that had arrived are stored already and stay; `Closing.incomplete`
   says so. A fence is replaced only when all its items have arrived.
2. **File open for writing** (GCS_FTP): the autopilot has one for all stations. TerminateSession closes it, and closing
   applies a parameter or mission file, complete or not. So the header of such a file is overwritten with zeros first:
   the autopilot discards a file without its magic number. If the file stayed open, the next request of any station for
   a file would close and apply it. Such files are also closed at arming, because no station may write them in flight
   (`arming`), and mission files before a mission package is written (`mission_files`): closed afterwards, they would
   replace its mission. A file counts as open until the autopilot has acknowledged its end, or refused to open it. If a
   second file is refused because the first is open, the first still counts as open.
3. **Sticks** (RC_CHANNELS_OVERRIDE, its second version, MANUAL_CONTROL): released. Otherwise the autopilot would use
   them for RC_OVERRIDE_TIME, as it does with channels of the second version beyond the 18th.
4. **Guided stream** of velocity, acceleration or attitude: zero velocity. GUID_TIMEOUT (3 s) would also stop it, but
   until then the aircraft would follow the former commander. A place to fly to is not a stream: the aircraft flies
   there and holds, and the new commander decides. Outside GUIDED the autopilot ignores the frame. A plane gets no such
   frame: it does not use the velocity, and up to ArduPlane 4.6 it flies to the height in the frame whatever the mask
   says. A plane forgets an attitude after 3 s by itself.
5. **Log download**: ended, because it fills the channel.
6. **Message rates** (SET_MESSAGE_INTERVAL of the autopilot): set to the autopilot's default, except those of
   `OWN_RATES`, which the companion restores (`operator/vehicle/streams.py`). The autopilot binds no rate to a sender,
   so the companion asks in its own name and gets the answer itself. Rates of REQUEST_DATA_STREAM stay until a
   commander asks for others: the autopilot stores them as parameters, and so they are its default.

Nothing is sent for what has ended already. The answers of the autopilot (`note_reply`) and the frames of the station
show that. Memory is bounded: `_MOST_OPEN` of a kind for one station, `_MOST_RATES` of its rates. The oldest is
forgotten first; of files, the oldest that the autopilot has not acknowledged.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.judge import Fate, Verdict
from mavproxy_handover.gate.policy.files import is_mission_file, is_upload
from mavproxy_handover.gate.policy.parts import MISSION_TYPES
from mavproxy_handover.wire.conversation import command_long
from mavproxy_handover.wire.file_transfer import DATA, Head, head_of
from mavproxy_handover.wire.file_transfer import message as file_message
from mavproxy_handover.wire.frames import Frame, field_bytes, field_float, field_int, target
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
    RATES_COMPID,
)
from mavproxy_handover.wire.message_ids import COMMAND_MESSAGES, MESSAGE_NAMES, message_ids
from mavproxy_handover.wire.own_rates import OWN_RATES

__all__ = ["Closing", "FlushTracker"]

#: constants, because Python 3.11 takes 0.1 us to look up a member of an enumeration
_FORWARD: Final = Fate.FORWARD
_MOST_OPEN: Final = 8
#: more than the messages of one MAV_DATA_STREAM; the frames that reset them take 0.1 s at 115200 baud
_MOST_RATES: Final = 32
#: More items than an autopilot stores: the autopilot ends the upload before it, and then refuses this count.
_TOO_MANY_ITEMS: Final = 0xFFFF

#: Sequence number, session, opcode, size of the data, opcode that is answered.
_HEADER_BYTES: Final = 12  #: at least as long as the headers of parameter and mission files

#: MAV_MISSION_TYPEs that the flight follows
_FLOWN_LISTS: Final = (mavlink.MAV_MISSION_TYPE_MISSION, mavlink.MAV_MISSION_TYPE_FENCE)
_COUNT: Final = mavlink.MAVLINK_MSG_ID_MISSION_COUNT
_PARTIAL: Final = mavlink.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST
_ITEMS: Final = (mavlink.MAVLINK_MSG_ID_MISSION_ITEM, mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT)
_ACK: Final = mavlink.MAVLINK_MSG_ID_MISSION_ACK
_FTP: Final = mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL
_STICKS: Final = message_ids("RC_CHANNELS_OVERRIDE", "RC_CHANNELS_OVERRIDE_V2", "MANUAL_CONTROL")
_TARGETS: Final = (
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
    mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
)
_ATTITUDE: Final = mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET
_LOG_BEGINS: Final = (mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST, mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA)
_LOG_END: Final = mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END

_SET_INTERVAL: Final = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL

#: Commands that give GUIDED another target, or leave it: a stream before them has no effect any more.
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
#: Results that do not end an upload: an item out of turn, and a question of its sender that must wait for its end.
_UPLOAD_GOES_ON: Final = (mavlink.MAV_MISSION_INVALID_SEQUENCE, mavlink.MAV_MISSION_DENIED)
_GUIDED_ITEM: Final = 2  #: MISSION_ITEM.current: a place to fly to, and no item

_Sender = tuple[int, int]  #: system, component


@dataclass(frozen=True, slots=True)
class Closing:
    """Frames to the autopilot that close what a station left open, in the name of the sender that opened it."""

    what: str  #: for journal and console
    frames: tuple[bytes, ...]
    incomplete: bool = False  #: the autopilot may have stored a mixture of old and new


_FileName = tuple[_Sender, int, bytes]  #: sender, session, path


@dataclass(frozen=True, slots=True)
class _File:
    component: int  #: the component that the file is open at
    asked: int  #: sequence number of the request to open it
    sequence: int  #: of the sender's last request
    acknowledged: bool = False  #: the autopilot has opened it


@dataclass(slots=True)
class _Open:
    """Open uploads, files and streams of one station. Values are the component that was addressed, or a file."""

    uploads: dict[tuple[_Sender, int], int] = field(default_factory=dict)  #: by sender and mission type
    files: dict[_FileName, _File] = field(default_factory=dict)
    sticks: dict[_Sender, int] = field(default_factory=dict)
    streams: dict[_Sender, int] = field(default_factory=dict)
    logs: dict[_Sender, int] = field(default_factory=dict)
    rates: dict[int, None] = field(default_factory=dict)  #: message ids


class FlushTracker:
    """Tracks what stations have open, by the frames of stations with their verdicts and the frames of the autopilot."""

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
            **dict.fromkeys(COMMAND_MESSAGES, self._saw_command),
            **dict.fromkeys(_LOG_BEGINS, self._saw_log),
            _LOG_END: self._saw_log,
        }

    def saw(self, frame: Frame, verdict: Verdict, station_sysid: int) -> None:
        """A frame of a station. Only a frame that went to the autopilot can open or end anything there."""
        if verdict.fate is not _FORWARD:
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

    def note_reply(self, frame: Frame) -> None:
        """A frame of the autopilot. It may say that an upload has ended, or that a file is not open."""
        if frame.msgid == _ACK:
            self._note_ack(frame)
        elif frame.msgid == _FTP:
            self._note_file_reply(frame)

    def flush(self, station_sysid: int, *, ends_streams: bool = True) -> list[Closing]:
        """Close everything that a station has open, and forget it. Guided streams only with `ends_streams` (rule 4)."""
        opened = self._open.pop(station_sysid, None)
        if opened is None:
            return []
        closings = [self._close_sticks(sender, at) for sender, at in opened.sticks.items()]
        if ends_streams:
            closings += [self._close_stream(sender, at) for sender, at in opened.streams.items()]
        closings += [self._close_upload(sender, kind, at) for (sender, kind), at in opened.uploads.items()]
        # One session may have had several files: overwrite those that closing would apply, before anything closes them.
        files = sorted(opened.files.items(), key=lambda entry: not is_upload(entry[0][2]))
        closings += [self._close_file(name, file) for name, file in files]
        closings += [self._close_log(sender, at) for sender, at in opened.logs.items()]
        if opened.rates:
            closings.append(self._close_rates(opened.rates))
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
        """Discard parameter and mission files that are being written. To be called when the vehicle is armed."""
        return self._throw_away(is_upload)

    def mission_files(self) -> list[Closing]:
        """Discard mission, fence and rally files that are being written."""
        return self._throw_away(is_mission_file)

    def end_logs(self) -> list[tuple[int, Closing]]:
        """End the log downloads of all stations. Returns whose they were, and what closes them."""
        closings = []
        for station, opened in self._open.items():
            closings += [(station, self._close_log(sender, at)) for sender, at in opened.logs.items()]
            opened.logs.clear()
        return closings

    def _throw_away(self, concerned: Callable[[bytes], bool]) -> list[Closing]:
        closings = []
        for opened in self._open.values():
            for name, file in list(opened.files.items()):
                if concerned(name[2]):
                    del opened.files[name]
                    closings.append(self._close_file(name, file))
        return closings

    # ---- frames that open and end ------------------------------------------------------------------------------------

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
            if known is None and len(opened.files) >= _MOST_OPEN:  # first one that was perhaps never opened
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

    def _saw_command(self, frame: Frame, opened: _Open, _sender: _Sender, component: int) -> None:
        command = field_int(frame, "command")
        if command in _NEW_AIMS:
            opened.streams.clear()
        elif command == _SET_INTERVAL and component == AUTOPILOT_COMPID:
            self._saw_rate(field_float(frame, "param1"), field_float(frame, "param2"), opened)

    def _saw_rate(self, msgid: float, interval_us: float, opened: _Open) -> None:
        if msgid not in MESSAGE_NAMES or msgid in OWN_RATES:
            return
        if interval_us == 0:  # the default
            opened.rates.pop(int(msgid), None)
        else:
            _remember(opened.rates, int(msgid), None, _MOST_RATES)

    def _saw_log(self, frame: Frame, opened: _Open, sender: _Sender, component: int) -> None:
        if frame.msgid == _LOG_END:
            opened.logs.clear()
        else:
            _remember(opened.logs, sender, component)

    def _note_ack(self, frame: Frame) -> None:
        if field_int(frame, "type") not in _UPLOAD_GOES_ON:
            for opened in self._open.values():
                opened.uploads.pop((_addressee(frame), field_int(frame, "mission_type")), None)

    def _note_file_reply(self, frame: Frame) -> None:
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

    # ---- frames that close -------------------------------------------------------------------------------------------

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

    def _close_rates(self, msgids: Collection[int]) -> Closing:
        target = self._vehicle, AUTOPILOT_COMPID
        frames = _packed((self._vehicle, RATES_COMPID), *(command_long(target, _SET_INTERVAL, each) for each in msgids))
        names = " ".join(MESSAGE_NAMES[each] for each in msgids)
        return Closing(f"default message rates restored: {names}", frames)

    def _close_log(self, sender: _Sender, component: int) -> Closing:
        message = mavlink.MAVLink_log_request_end_message(self._vehicle, component)
        return Closing("log download ended", _packed(sender, message))


def _remember(entries: dict, key: object, value: object, most: int = _MOST_OPEN) -> None:  # type: ignore[type-arg]
    entries.pop(key, None)
    entries[key] = value
    if len(entries) > most:
        del entries[next(iter(entries))]


def _packed(sender: _Sender, *messages: mavlink.MAVLink_message) -> tuple[bytes, ...]:
    as_sender = mavlink.MAVLink(None, srcSystem=sender[0], srcComponent=sender[1])
    return tuple(bytes(message.pack(as_sender)) for message in messages)


def _addressee(frame: Frame) -> _Sender:
    return field_int(frame, "target_system"), field_int(frame, "target_component")
