# SPDX-License-Identifier: GPL-3.0-or-later

"""A ground station that is a script with pymavlink, as its users write them."""

from __future__ import annotations

import argparse
import importlib.metadata
import os
import tempfile
import threading
import time
from collections.abc import Callable
from typing import Any

from pymavlink import mavftp, mavutil
from talk import COMMAND_RESULTS, MISSION, PARAMETER, Journal, Program, Texts, serve

GROUND_STATION = 190
AUTOPILOT = 1
HEIGHT_M = 8.0
#: a command is sent three times, each time it waits so long
TRY_S, TRIES = 1.5, 3
PATIENCE_S = 30.0
VERSION, MODES = 148, 435
GUIDED, LOITER, RTL, LAND = 4, 5, 6, 9
ARM, REBOOT, HOLD_IN_BOOT_LOADER = 400, 246, 3
MISSION_RESULTS = {0: "accepted", 1: "failed", 14: "denied"}
FILE = "@SYS/uarts.txt"
#: a camera, whose program uses the station's system id
CAMERA = 100
#: bytes of one LOG_DATA; what is missing is asked for after so long without any
LOG_PIECE, LOG_GAP_S = 90, 0.5
WHOLE_LOG = 0xFFFFFFFF


class Station(Program):
    """The connection and the jobs."""

    def __init__(self, address: str, options: argparse.Namespace, journal: Journal) -> None:
        self._heartbeats = not options.no_heartbeats
        self._link: Any = mavutil.mavlink_connection(
            address, source_system=options.sysid, source_component=GROUND_STATION
        )
        self._vehicle, self._sysid = options.vehicle, options.sysid
        self._texts = Texts(journal)
        self._beating = False
        self.jobs = {
            "connect": self._connect,
            "parameters": self._parameters,
            "mission": self._mission,
            "version": lambda: self._message(VERSION, "AUTOPILOT_VERSION"),
            "modes": lambda: self._message(MODES, "AVAILABLE_MODES"),
            "file": self._file,
            "param": self._set_parameter,
            "upload": self._upload,
            "arm": lambda: (self._command(ARM, 1.0), None),
            "disarm": lambda: (self._command(ARM, 0.0), None),
            "arm-reading": self._arm_reading,
            "arm-camera": self._arm_as_camera,
            "boot-loader": lambda: (self._command(REBOOT, HOLD_IN_BOOT_LOADER), None),
            "logs": lambda: ("read", len(self._logs())),
            "log": self._log,
            "guided": lambda: self._mode(GUIDED),
            "loiter": lambda: self._mode(LOITER),
            "rtl": lambda: self._mode(RTL),
            "land": lambda: self._mode(LAND),
            "takeoff": lambda: (self._command(22, 0, 0, 0, 0, 0, 0, HEIGHT_M), None),
            "start": lambda: (self._command(300), None),
        }

    def idle(self) -> None:
        """Take in what comes."""
        self.next(0.05)

    def _beat(self) -> None:
        while True:
            self._link.mav.heartbeat_send(6, 8, 0, 0, 4)
            time.sleep(1.0)

    # ---- in -------------------------------------------------------------------------------------------------------

    def next(self, timeout_s: float) -> Any:
        """The next message of the vehicle; None if there is none for `timeout_s`."""
        message = self._link.recv_match(blocking=timeout_s > 0, timeout=timeout_s)
        if message is None or message.get_srcSystem() != self._vehicle:
            return None
        if message.get_type() == "STATUSTEXT":
            self._texts.take(message.get_srcComponent(), message.id, message.text, message.severity)
        return message

    def _await(self, wanted: Callable[[Any], bool], timeout_s: float) -> Any:
        until = time.monotonic() + timeout_s
        while (left := until - time.monotonic()) > 0:
            message = self.next(left)
            if message is not None and wanted(message):
                return message
        return None

    # ---- jobs -----------------------------------------------------------------------------------------------------

    def _connect(self) -> tuple[str, int | None]:
        heard = self._await(lambda m: m.get_type() == "HEARTBEAT" and m.get_srcComponent() == AUTOPILOT, PATIENCE_S)
        if heard is None:
            return "not heard", None
        self._link.target_system, self._link.target_component = self._vehicle, AUTOPILOT
        if not self._beating and self._heartbeats:
            self._beating = True
            threading.Thread(target=self._beat, daemon=True).start()
        return "done", None

    def _command(self, number: int, *parameters: float) -> str:
        values = (*parameters, *([0.0] * (7 - len(parameters))))
        for repeated in range(TRIES):
            self._link.mav.command_long_send(self._vehicle, AUTOPILOT, number, repeated, *values)
            ack = self._await(lambda m: m.get_type() == "COMMAND_ACK" and m.command == number, TRY_S)
            while ack is not None and COMMAND_RESULTS[ack.result] == "in_progress":
                ack = self._await(lambda m: m.get_type() == "COMMAND_ACK" and m.command == number, PATIENCE_S)
            if ack is not None:
                return COMMAND_RESULTS[ack.result] if ack.result < len(COMMAND_RESULTS) else str(ack.result)
        return "no answer"

    def _arm_reading(self) -> tuple[str, int | None]:
        """Arm while the parameters come. The count is that of the parameters."""
        self._link.mav.param_request_list_send(self._vehicle, AUTOPILOT)
        armed = self._command(ARM, 1.0)
        result, count = self._parameters()
        return (armed if result == "read" else result), count

    def _arm_as_camera(self) -> tuple[str, int | None]:
        """Arm as another component of the same system id."""
        mav = self._link.mav
        mav.srcComponent = CAMERA
        try:
            return self._command(ARM, 1.0), None
        finally:
            mav.srcComponent = GROUND_STATION

    def _mode(self, number: int) -> tuple[str, int | None]:
        return self._command(176, 1.0, float(number)), None

    def _message(self, number: int, name: str) -> tuple[str, int | None]:
        self._link.mav.command_long_send(self._vehicle, AUTOPILOT, 512, 0, float(number), 0, 0, 0, 0, 0, 0)
        came = self._await(lambda m: m.get_type() == name, TRY_S)
        return ("read" if came is not None else "no answer"), None

    def _parameters(self) -> tuple[str, int | None]:
        self._link.mav.param_request_list_send(self._vehicle, AUTOPILOT)
        known: set[int] = set()
        count = 0
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until:
            value = self._await(lambda m: m.get_type() == "PARAM_VALUE", 1.0)
            if value is not None and value.param_index < value.param_count:
                count = value.param_count
                known.add(value.param_index)
            if count and len(known) == count:
                return "read", count
            if value is None:  # as every station does it: what is missing is asked for singly
                for missing in sorted(set(range(count)) - known)[:20]:
                    self._link.mav.param_request_read_send(self._vehicle, AUTOPILOT, b"", missing)
        return "incomplete", len(known)

    def _set_parameter(self) -> tuple[str, int | None]:
        name, value = PARAMETER
        self._link.mav.param_set_send(self._vehicle, AUTOPILOT, name.encode("ascii"), value, 9)
        kinds = ("PARAM_VALUE", "PARAM_ERROR")
        answer = self._await(lambda m: m.get_type() in kinds and m.param_id == name, TRY_S)
        if answer is None:
            return "no answer", None
        return ("denied" if answer.get_type() == "PARAM_ERROR" else "accepted"), None

    def _mission(self) -> tuple[str, int | None]:
        self._link.mav.mission_request_list_send(self._vehicle, AUTOPILOT)
        count = self._await(lambda m: m.get_type() == "MISSION_COUNT" and m.target_system == self._sysid, TRY_S)
        if count is None:
            return "no answer", None
        for number in range(count.count):
            self._link.mav.mission_request_int_send(self._vehicle, AUTOPILOT, number)
            if (
                self._await(lambda m, number=number: m.get_type() == "MISSION_ITEM_INT" and m.seq == number, TRY_S)
                is None
            ):
                return "incomplete", number
        self._link.mav.mission_ack_send(self._vehicle, AUTOPILOT, 0)
        return "read", count.count

    def _upload(self) -> tuple[str, int | None]:
        self._link.mav.mission_count_send(self._vehicle, AUTOPILOT, len(MISSION))
        wanted = ("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK")
        while True:
            message = self._await(lambda m: m.get_type() in wanted and m.target_system == self._sysid, 5.0)
            if message is None:
                return "no answer", None
            if message.get_type() == "MISSION_ACK":
                return MISSION_RESULTS.get(message.type, str(message.type)), None
            command, latitude, longitude, height = MISSION[message.seq]
            place = (round(latitude * 1e7), round(longitude * 1e7), height)
            self._link.mav.mission_item_int_send(
                self._vehicle, AUTOPILOT, message.seq, 3, command, 0, 1, 0, 0, 0, 0, *place
            )

    def _file(self) -> tuple[str, int | None]:
        transfer = mavftp.MAVFTP(self._link, self._vehicle, AUTOPILOT)
        target = os.path.join(tempfile.mkdtemp(), "file")
        transfer.cmd_get([FILE, target])
        done = transfer.process_ftp_reply("OpenFileRO", timeout=10)
        if done.error_code != 0:
            return f"error {done.error_code}", None
        return "read", os.path.getsize(target)

    def _logs(self) -> list[Any]:
        """The entries of all logs."""
        self._link.mav.log_request_list_send(self._vehicle, AUTOPILOT, 0, 0xFFFF)
        entries: list[Any] = []
        while not entries or entries[-1].id < entries[-1].last_log_num:
            entry = self._await(lambda m: m.get_type() == "LOG_ENTRY", TRY_S)
            if entry is None or not entry.num_logs:
                break
            entries.append(entry)
        return entries

    def _log(self) -> tuple[str, int | None]:
        """Download the newest log, whole. The count is in bytes."""
        newest = self._logs()[-1]
        missing = set(range(0, newest.size, LOG_PIECE))
        ask = self._link.mav.log_request_data_send
        ask(self._vehicle, AUTOPILOT, newest.id, 0, WHOLE_LOG)
        while missing:
            data = self._await(lambda m: m.get_type() == "LOG_DATA" and m.id == newest.id, LOG_GAP_S)
            if data is None:
                ask(self._vehicle, AUTOPILOT, newest.id, min(missing), WHOLE_LOG)
            else:
                missing.discard(data.ofs)
        self._link.mav.log_request_end_send(self._vehicle, AUTOPILOT)
        return "read", newest.size


def main() -> None:
    """Until the input ends."""
    version = f"pymavlink {importlib.metadata.version('pymavlink')}"
    serve(__doc__, version, Station)


if __name__ == "__main__":
    main()
