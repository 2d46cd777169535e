# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads a telemetry log in the form of MAVProxy: a time of eight bytes before each frame.

Frames are found by our own splitter and not by pymavlink's `mavutil`, whose dialect is the whole process's: a log is
read with ours whatever else the process does. What is no frame is passed over and counted; only messages that tell
something here are decoded, so a long log is read in seconds.

The log shows its writer: only the companion sends leases, and a ground station's log has heartbeats of one ground
station. The commander comes, in this order, from AUTHORITY_STATUS (at stations) and from the leases (on board).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.core.common.model import journal_in_words
from mavproxy_handover.wire.frames import MAX_FRAME_BYTES, Frame, parse_one
from mavproxy_handover.wire.ids import GUARD_STATUS_TUNNEL, LEASE_TUNNEL
from mavproxy_handover.wire.lease import unpack_guard_status, unpack_lease
from sitl.report.journal_reader import Entry
from sitl.report.strand import CLOCK_SET_S, Kind, Stamps, Strand, Tick
from sitl.report.watch import AUTOPILOT, VEHICLE, Watch

__all__ = ["frames", "read_tlog"]

_STAMP: Final = struct.Struct(">Q")
_V1, _V2, _SIGNED = 0xFE, 0xFD, 0x01
#: a gap of this time (s) without a frame of the vehicle is told; heartbeats come each second
SILENT_S: Final = 3.0
#: how often (s) battery and radio are told, and what commands although nothing has changed
_BATTERY_S, _VIEW_S = 1.0, 2.0
_COMPANION: Final = 191

#: of the vehicle: what `Watch` knows
_WATCHED: Final = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
        mavlink.MAVLINK_MSG_ID_MISSION_ITEM_REACHED,
        mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
        mavlink.MAVLINK_MSG_ID_STATUSTEXT,
        mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
    }
)
_STEPS: Final = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HANDOVER_REQUEST,
        mavlink.MAVLINK_MSG_ID_ON_HANDOVER,
        mavlink.MAVLINK_MSG_ID_OK_HANDOVER,
        mavlink.MAVLINK_MSG_ID_CONNECT_HANDOVER,
        mavlink.MAVLINK_MSG_ID_DRONE_CONNECTED,
        mavlink.MAVLINK_MSG_ID_DISCONNECT_HANDOVER,
        mavlink.MAVLINK_MSG_ID_HANDOVER_RESULT,
    }
)
_OTHERS: Final = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_RADIO_STATUS,
        mavlink.MAVLINK_MSG_ID_TUNNEL,
        mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT,
        mavlink.MAVLINK_MSG_ID_CONNECT,
        mavlink.MAVLINK_MSG_ID_CONNECT_ACK,
        mavlink.MAVLINK_MSG_ID_AUTHORITY_STATUS,
        mavlink.MAVLINK_MSG_ID_HANDOVER_DECISION,
        mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
    }
)
_WANTED: Final = _WATCHED | _STEPS | _OTHERS


def frames(data: bytes, spoilt: list[int] | None = None) -> Iterator[tuple[float, Frame]]:
    """The frames of a log with their times (UTC, s). `spoilt` gets how many bytes were no part of one."""
    place, passed, size = 0, 0, len(data)
    while place + 9 < size:
        end = _end(data, place + 8)
        frame = parse_one(data[place + 8 : end]) if end and end <= size else None
        if frame is None or (not frame.known and not (end == size or _end(data, end + 8))):
            place, passed = place + 1, passed + 1
            continue
        yield _STAMP.unpack_from(data, place)[0] / 1e6, frame
        place = end
    if spoilt is not None:
        spoilt.append(passed)


def _end(data: bytes, at: int) -> int:
    """Where the frame that begins at `at` ends; 0 when none does."""
    head = data[at : at + 3]
    if len(head) < 3 or head[0] not in (_V1, _V2):
        return 0
    if head[0] == _V1:
        return at + 8 + head[1]
    length = 12 + head[1] + (13 if head[2] & _SIGNED else 0)
    return at + length if length <= MAX_FRAME_BYTES else 0


def read_tlog(path: Path) -> Strand:
    """Read a telemetry log. Raises OSError; bytes that are no frame are skipped."""
    reader = _Reader(path)
    spoilt: list[int] = []
    stamps = Stamps()
    for t, frame in frames(path.read_bytes(), spoilt):
        if stamps.believed(t):
            reader.on_frame(t, frame)
        else:
            spoilt.append(1)
    return reader.finish(sum(spoilt))


class _Reader:
    def __init__(self, path: Path) -> None:
        self.strand = Strand(path, Kind.TLOG)
        self._decode = mavlink.MAVLink(None).decode
        self._watches: dict[int, Watch] = {}
        self._authorities: dict[int, _Authority] = {}
        self._heard_t: dict[int, float] = {}
        self._grounds: set[int] = set()
        self._leases = False
        self._due: dict[tuple[int, str], float] = {}

    def on_frame(self, t: float, frame: Frame) -> None:
        """Take in one frame."""
        if frame.compid == AUTOPILOT and frame.sysid in self._watches:
            self._hear(t, frame.sysid)
        if frame.msgid not in _WANTED:
            return
        try:
            message = self._decode(bytearray(frame.raw))
        except (mavlink.MAVError, UnicodeDecodeError, ValueError, struct.error):
            self.strand.broken += len(frame.raw)
            return
        self._heartbeats(message, t, frame)
        sysid = frame.sysid
        watch = self._watches.get(sysid)
        if watch is not None and frame.msgid in _WATCHED:
            self.strand.seen[sysid] += watch.on_message(message, t)
        handler = getattr(self, "_on_" + message.get_type().lower(), None)
        if handler is not None:
            handler(message, t, sysid, frame.compid)
        elif frame.msgid in _STEPS:
            self._authority(message.vehicle).step(message, t, sysid)

    def finish(self, spoilt: int) -> Strand:
        """The strand of the whole log."""
        strand = self.strand
        strand.broken += spoilt
        strand.on_board = self._leases
        vehicles = list(self._watches)
        if self._leases and len(vehicles) == 1:
            strand.who = strand.vehicles.get(vehicles[0], "")
        elif not self._leases and len(self._grounds) == 1:
            station = next(iter(self._grounds))
            strand.who = strand.stations.setdefault(station, f"station {station}")
        for sysid, authority in self._authorities.items():
            if sysid:
                strand.told[sysid] = authority.entries(strand)
        return strand

    # ---- what is in it --------------------------------------------------------------------------------------------

    def _hear(self, t: float, sysid: int) -> None:
        last = self._heard_t.get(sysid)
        if last is not None and t - last > SILENT_S:
            self.strand.silences.setdefault(sysid, []).append((last, t))
        self._heard_t[sysid] = t

    def _heartbeats(self, message: Any, t: float, frame: Frame) -> None:
        if frame.msgid != mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            return
        if message.type == mavlink.MAV_TYPE_GCS:
            self._grounds.add(frame.sysid)
        elif frame.compid == AUTOPILOT and frame.sysid not in self._watches:
            if message.autopilot == mavlink.MAV_AUTOPILOT_INVALID:
                return
            self._watches[frame.sysid] = Watch(frame.sysid, 1.0)
            self.strand.seen[frame.sysid] = []
            self._heard_t[frame.sysid] = t

    def _authority(self, sysid: int) -> _Authority:
        return self._authorities.setdefault(sysid, _Authority())

    def _is_due(self, t: float, sysid: int, what: str, interval_s: float) -> bool:
        if t < self._due.get((sysid, what), 0.0):
            return False
        self._due[sysid, what] = t + interval_s
        return True

    def _on_system_time(self, message: Any, t: float, sysid: int, compid: int) -> None:
        gps_s = message.time_unix_usec / 1e6
        if compid == AUTOPILOT:
            set_s = gps_s if gps_s > CLOCK_SET_S else None
            self.strand.ticks.append(Tick(t, sysid, message.time_boot_ms / 1e3, set_s))

    def _on_global_position_int(self, message: Any, t: float, sysid: int, compid: int) -> None:
        if compid == AUTOPILOT and self._is_due(t, sysid, "tick", 1.0):
            self.strand.ticks.append(Tick(t, sysid, message.time_boot_ms / 1e3))

    def _on_sys_status(self, message: Any, t: float, sysid: int, compid: int) -> None:
        if compid != AUTOPILOT or sysid not in self._watches or not self._is_due(t, sysid, "battery", _BATTERY_S):
            return
        values: dict[str, Any] = {}
        if message.battery_remaining >= 0:
            values["percent"] = message.battery_remaining
        if message.voltage_battery not in (0, 0xFFFF):
            values["volts"] = message.voltage_battery / 1e3
        if values:
            self.strand.seen[sysid].append(Entry(t, VEHICLE, "battery", "", values))

    def _on_radio_status(self, message: Any, t: float, sysid: int, compid: int) -> None:
        for vehicle, entries in self.strand.seen.items():
            if self._is_due(t, vehicle, "radio", _BATTERY_S):
                values = {"rssi": message.rssi, "remote_rssi": message.remrssi, "noise": message.noise}
                entries.append(Entry(t, VEHICLE, "radio", "", values))

    def _on_tunnel(self, message: Any, t: float, sysid: int, compid: int) -> None:
        payload = bytes(message.payload[: message.payload_length])
        if message.payload_type == LEASE_TUNNEL and compid == _COMPANION:
            lease = unpack_lease(payload)
            if lease is not None:
                self._leases = True
                self._authority(sysid).leased(t, lease.commander, lease.epoch, lease.state.name.lower())
        elif message.payload_type == GUARD_STATUS_TUNNEL and compid == AUTOPILOT:
            status = unpack_guard_status(payload)
            if status is not None:
                self._authority(sysid).guarded(t, status.state.name.lower())

    def _on_mission_item_int(self, message: Any, t: float, sysid: int, compid: int) -> None:
        vehicle = sysid if compid == AUTOPILOT and sysid in self._watches else message.target_system
        if message.mission_type == mavlink.MAV_MISSION_TYPE_MISSION and (message.x or message.y) and message.seq:
            self.strand.items.setdefault(vehicle, {})[message.seq] = (message.x / 1e7, message.y / 1e7)

    def _on_connect(self, message: Any, t: float, sysid: int, compid: int) -> None:
        if sysid == message.vehicle and message.name:
            self.strand.vehicles[sysid] = message.name

    def _on_connect_ack(self, message: Any, t: float, sysid: int, compid: int) -> None:
        if message.name:
            (self.strand.vehicles if sysid == message.vehicle else self.strand.stations)[sysid] = message.name

    def _on_authority_status(self, message: Any, t: float, sysid: int, compid: int) -> None:
        self._authority(sysid).status(message, t)

    def _on_handover_decision(self, message: Any, t: float, sysid: int, compid: int) -> None:
        self._authority(sysid).decision(message, t)


class _Alarm(IntEnum):
    """How grave it is."""

    NONE = 0
    HOLD = 1
    EMERGENCY = 2


#: by the action of a decision
_ALARMS: Final = {"hold": _Alarm.HOLD, "return": _Alarm.EMERGENCY, "land": _Alarm.EMERGENCY}


class _Authority:
    """The commanders of one vehicle, and the decisions, by its frames.

    Stations are numbers here: another file may know their names.
    """

    def __init__(self) -> None:
        self._told: list[tuple[float, str, str, dict[str, Any]]] = []
        self._leases: list[tuple[float, str, str, dict[str, Any]]] = []
        self._steps: list[tuple[float, Any, int]] = []
        self._last: dict[str, tuple[float, Any]] = {}
        self._begun: dict[int, float] = {}
        self._ended: set[int] = set()
        self._decision: tuple[int, str] | None = None
        #: what says that the aircraft is held, or that there is an emergency: the phase, or a decision
        self._alarms: dict[str, _Alarm] = {}

    def status(self, message: Any, t: float) -> None:
        """AUTHORITY_STATUS."""
        phase = _word("HANDOVER_PHASE", message.phase)
        values = {
            "phase": phase,
            "commander": message.commander,
            "epoch": message.epoch,
            "lease": _word("HANDOVER_LEASE", message.lease),
            "reason": _word("HANDOVER_REASON", message.reason),
        }
        if message.partner and message.handover_id not in self._begun and phase == "on_handover":
            self._begin(t, message.handover_id, message.commander, message.partner, message.transfer_reason)
        if self._changed(t, "view", values):
            self._told.append((t, "view", "", values))
        self.guarded(t, _word("HANDOVER_GUARD", message.guard))
        alarm = _Alarm.EMERGENCY if phase == "emergency" else _Alarm.NONE
        self._alarm(t, "phase", alarm, values["reason"])

    def leased(self, t: float, commander: int, epoch: int, state: str) -> None:
        """A lease, of which the companion sends several a second."""
        values = {"commander": commander, "epoch": epoch, "lease": state}
        if self._changed(t, "lease", values):
            self._leases.append((t, "view", "", values))

    def guarded(self, t: float, state: str) -> None:
        """A status of the guard."""
        before = self._last.get("guard")
        if before is None and state == "silent":
            return
        if before is None or before[1] != state:
            self._last["guard"] = (t, state)
            self._told.append((t, "guard", f"guard: {before[1] if before else 'silent'} -> {state}", {}))

    def decision(self, message: Any, t: float) -> None:
        """HANDOVER_DECISION, which is said again while it lasts."""
        word = (message.number, message.text)
        if word == self._decision:
            return
        self._decision = word
        action = _word("HANDOVER_ACTION", message.action)
        values = {"action": action, "reason": _word("HANDOVER_REASON", message.cause), "figures": message.figures}
        self._told.append((t, "decision", message.text, values))
        self._alarm(t, "decision", _ALARMS.get(action, _Alarm.NONE), message.figures or values["reason"])

    def step(self, message: Any, t: float, sender: int) -> None:
        """A message of a transfer."""
        self._steps.append((t, message, sender))
        number = message.handover_id
        if message.get_type() == "HANDOVER_REQUEST" and number not in self._begun:
            self._begin(t, number, message.from_station, message.to_station, message.reason)
        if message.get_type() == "HANDOVER_RESULT" and number not in self._ended:
            self._ended.add(number)
            if number not in self._begun:
                self._begin(t, number, message.from_station, message.to_station, message.reason)
            done = message.outcome == mavlink.HANDOVER_OUTCOME_COMMITTED
            reason = _word("HANDOVER_REASON", message.reason)
            values = {"handover_id": number, "epoch": message.epoch, "reason": reason, "station": message.to_station}
            if done and t > self._begun[number]:
                values["duration_s"] = round(t - self._begun[number], 4)
            text = f"handover {number} " + ("committed" if done else f"aborted: {journal_in_words(reason)}")
            self._told.append((t, "transfer_committed" if done else "transfer_aborted", text, values))

    def entries(self, strand: Strand) -> list[Entry]:
        """Everything, sorted."""
        told = self._told
        if not any(event == "view" for _, event, _, _ in told):
            told = told + self._leases
        found = [Entry(t, "", event, text, values) for t, event, text, values in told]
        for t, message, sender in self._steps:
            found.append(_as_entry(strand, t, message, sender))
        return sorted(found, key=lambda entry: entry.t)

    def _begin(self, t: float, number: int, commander: int, partner: int, reason: int) -> None:
        self._begun[number] = t
        values = {"handover_id": number, "station": partner, "reason": _word("HANDOVER_REASON", reason)}
        self._told.append((t, "transfer_begun", "", {**values, "from_station": commander}))

    def _alarm(self, t: float, what: str, alarm: _Alarm, reason: str) -> None:
        before = max(self._alarms.values(), default=_Alarm.NONE)
        self._alarms[what] = alarm
        now = max(self._alarms.values())
        if before and not now:
            self._told.append((t, "emergency_over", "the cause of the emergency is gone", {"reason": reason}))
        elif now > before:
            values = {"reason": reason, **({"action": "hold"} if now is _Alarm.HOLD else {})}
            self._told.append((t, "emergency", reason.replace("_", " "), values))

    def _changed(self, t: float, what: str, values: Any) -> bool:
        before = self._last.get(what)
        if before is not None and before[1] == values and t < before[0] + _VIEW_S:
            return False
        self._last[what] = (t, values)
        return True


def _word(enum: str, value: int) -> str:
    """The word of a value of our dialect, as journals have it."""
    entry = mavlink.enums[enum].get(value)
    return str(value) if entry is None else entry.name.removeprefix(enum + "_").lower()


def _as_entry(strand: Strand, t: float, message: Any, sender: int) -> Entry:
    """A transfer's message as the one who wrote the log saw it: `who` is "" for the vehicle's companion."""
    number_of = {name: number for number, name in strand.stations.items()}
    own = number_of.get(strand.who, message.vehicle)
    out = sender == own
    other = message.target_system if out else sender
    values: dict[str, Any] = {
        "name": message.get_type(),
        "direction": "out" if out else "in",
        "handover_id": message.handover_id,
        "epoch": message.epoch,
    }
    if other != message.vehicle:
        values["station"] = other
        if own != message.vehicle:
            values["via"] = "ground"
    if hasattr(message, "consent"):
        values["consent"] = _word("HANDOVER_CONSENT", message.consent)
    if getattr(message, "flags", 0) & mavlink.HANDOVER_FLAGS_RELAYED:
        values["relayed"] = True
    return Entry(t, strand.who if own != message.vehicle else "", "message", "", values)
