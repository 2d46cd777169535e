# SPDX-License-Identifier: GPL-3.0-or-later

"""A ground station that is a program of MAVSDK, as its users write them.

It runs in the Python that has the MAVSDK to be tried, and needs nothing else: `mavsdk` before version 4 speaks gRPC
with a program of its own, `mavsdk_server`; from version 4 on the library is in this process. It takes the same options
and keeps the same kind of journal as `sitl/run/standard_gcs.py`, so a scenario can put it in that one's place. Typed:

    connect version                               wait for the vehicle; ask for its version, by `MavlinkDirect`
    arm disarm takeoff land rtl hold loiter fly   MAVSDK's `Action`; loiter is hold, fly goes to a place 50 m north
    auto pause mission upload clear               MAVSDK's `MissionRaw`; mission reads it
    parameters param                              MAVSDK's `Param`: read all; a value for FS_OPTIONS
    arm-reading                                   `Action` arms while `Param` reads all
    logs log                                      MAVSDK's `LogFiles`: list them; download the newest
    boot-loader                                   a restart that stays in the boot loader, by `MavlinkDirect`
    start stop continue                           the mission's start, stop, continue, by `MavlinkDirect`
    request allow release                         operator control, likewise
    alive                                         whether MAVSDK still runs, and still tells where the vehicle is

The journal has MAVSDK's own word for what each came to, with the seconds that it took. If `mavsdk_server` ends, this
program ends with code 3.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
import socket
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from talk import COMMAND_RESULTS, MISSION, PARAMETER, Journal, arguments

REQUEST = 32100
REQUEST_MESSAGE, VERSION = 512, 148
REBOOT, HOLD_IN_BOOT_LOADER = 246, 3.0
MISSION_START, PAUSE_CONTINUE, CONTROL_STATUS_MANAGER = 300, 193, 1
AUTOPILOT, COMPANION, GROUND_STATION = 1, 191, 190
SERVER_GONE = 3
#: word -> command, its parameters, whom it is for
DIRECT: dict[str, tuple[int, tuple[float, ...], int]] = {
    "start": (MISSION_START, (), AUTOPILOT),
    "stop": (PAUSE_CONTINUE, (0.0,), AUTOPILOT),
    "continue": (PAUSE_CONTINUE, (1.0,), AUTOPILOT),
    "version": (REQUEST_MESSAGE, (float(VERSION),), AUTOPILOT),
    "boot-loader": (REBOOT, (HOLD_IN_BOOT_LOADER,), AUTOPILOT),
    "request": (REQUEST, (1.0, 0.0, 30.0), COMPANION),
    "allow": (REQUEST, (1.0, 1.0, 30.0), COMPANION),
    "release": (REQUEST, (0.0, 0.0, 0.0), COMPANION),
}
IN_PROGRESS = COMMAND_RESULTS.index("in_progress")
#: no last word about a command that was sent by hand
PATIENCE_S = 60.0
HEIGHT_M = 8.0


class Old:
    """MAVSDK before 4: `mavsdk_server` and gRPC."""

    def __init__(self, sysid: int, component: int) -> None:
        import mavsdk
        from mavsdk import offboard
        from mavsdk.mavlink_direct import MavlinkMessage
        from mavsdk.mission_raw import MissionItem

        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self._system = mavsdk.System(port=port, sysid=sysid, compid=component)
        self.message, self.item, self.targets = MavlinkMessage, MissionItem, offboard

    async def connect(self, address: str) -> None:
        await self._system.connect(system_address=address)
        self.action, self.mission, self.param = self._system.action, self._system.mission_raw, self._system.param
        self.logs, self.offboard, self.info = self._system.log_files, self._system.offboard, self._system.info
        self._telemetry, self.direct = self._system.telemetry, self._system.mavlink_direct
        self.messages = self.direct.message
        async for state in self._system.core.connection_state():
            if state.is_connected:
                return

    def texts(self) -> Any:
        return self._telemetry.status_text()

    def positions(self) -> Any:
        return self._telemetry.position()

    def died(self) -> int | None:
        """What `mavsdk_server` ended with, if it has."""
        code: int | None = self._system._server_process.poll()
        return code


class New:
    """MAVSDK from 4 on: the library itself."""

    def __init__(self, sysid: int, component: int) -> None:
        from mavsdk.asyncio import Configuration, Mavsdk
        from mavsdk.plugins import offboard
        from mavsdk.plugins.mavlink_direct import MavlinkMessage
        from mavsdk.plugins.mission_raw import MissionItem

        self._mavsdk = Mavsdk(Configuration.create_manual(sysid, component, True))
        self.message, self.item, self.targets = MavlinkMessage, MissionItem, offboard

    async def connect(self, address: str) -> None:
        from mavsdk.asyncio.plugins.action import ActionAsync
        from mavsdk.asyncio.plugins.info import InfoAsync
        from mavsdk.asyncio.plugins.log_files import LogFilesAsync
        from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
        from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
        from mavsdk.asyncio.plugins.offboard import OffboardAsync
        from mavsdk.asyncio.plugins.param import ParamAsync
        from mavsdk.asyncio.plugins.telemetry import TelemetryAsync

        await self._mavsdk.add_any_connection(address)
        system = None
        while system is None:
            system = await self._mavsdk.first_autopilot(timeout_s=1.0)
        self.action, self.mission, self.param = ActionAsync(system), MissionRawAsync(system), ParamAsync(system)
        self.logs, self.offboard, self.info = LogFilesAsync(system), OffboardAsync(system), InfoAsync(system)
        self._telemetry, self.direct = TelemetryAsync(system), MavlinkDirectAsync(system)
        self.messages = self.direct.subscribe_message

    def texts(self) -> Any:
        return self._telemetry.subscribe_status_text()

    def positions(self) -> Any:
        return self._telemetry.subscribe_position()

    def died(self) -> int | None:
        """It cannot, without this process."""
        return None


class Station:
    """The program: what is typed, what is heard."""

    def __init__(self, sysid: int, vehicle: int, control: str, journal: Journal) -> None:
        """`control`: the definitions of operator control, as XML."""
        self.sysid, self.vehicle = sysid, vehicle
        self._control, self.note = control, journal.note
        self._started = time.monotonic()
        version = _version()
        self.program: Any = (Old if version < "4" else New)(sysid, GROUND_STATION)
        self._waiting: dict[int, asyncio.Future[int]] = {}
        self._owner: int | None = None
        self.note("loaded", f"MAVSDK {version}", version=version)

    async def run(self, address: str) -> int:
        """Until what is typed ends, or MAVSDK does. Returns the exit code."""
        self._moved, self._connected = asyncio.Event(), asyncio.Event()
        lines: asyncio.Queue[str | None] = asyncio.Queue()
        typing = asyncio.get_running_loop()
        typing.add_reader(sys.stdin, lambda: lines.put_nowait(sys.stdin.readline() or None))
        tasks = [asyncio.ensure_future(self._connect(address)), asyncio.ensure_future(self._watch())]
        orders: set[asyncio.Future[None]] = set()
        while True:
            typed = asyncio.ensure_future(lines.get())
            await asyncio.wait([typed, *tasks], return_when=asyncio.FIRST_COMPLETED)
            for task in tasks:
                if task.done():
                    if task.exception() is not None:
                        self.note("fault", repr(task.exception()))
                    return SERVER_GONE
            line = typed.result()
            if line is None:
                return 0
            orders.add(asyncio.ensure_future(self._order(line.strip())))  # side by side, as people press buttons

    async def _connect(self, address: str) -> None:
        """Connect, then listen for ever."""
        await self.program.connect(address)
        self.note("connected", "the vehicle is heard")
        await self.program.direct.load_custom_xml(self._control)
        self._connected.set()
        await asyncio.gather(
            self._texts(),
            self._positions(),
            self._listen("CONTROL_STATUS", self._on_status),
            self._listen("COMMAND_ACK", self._on_ack),
            self._listen("COMMAND_LONG", self._on_question),
        )

    # ---- out --------------------------------------------------------------------------------------------------------

    async def _order(self, word: str) -> None:
        began = self._started if word == "connect" else time.monotonic()
        self.note("asked", word, what=word)
        await self._connected.wait()
        count: dict[str, int] = {}
        try:
            result = "read" if await self._read(word, count) else await self._do(word)
        except Exception as error:  # what MAVSDK raises is the answer
            result = _result_of(error)
        took_s = round(time.monotonic() - began, 4)
        self.note("command", f"{word}: {result}", what=word, result=result, took_s=took_s, **count)

    async def _read(self, word: str, count: dict[str, int]) -> bool:
        """What is read, and how many of it; False if the word is another one."""
        if word == "parameters":
            count["count"] = await self._parameters()
        elif word == "arm-reading":
            count["count"], _ = await asyncio.gather(self._parameters(), self.program.action.arm())
        elif word == "logs":
            count["count"] = len(await self.program.logs.get_entries())
        elif word == "log":
            count["count"] = await self._log()
        elif word == "mission":
            count["count"] = len(await self.program.mission.download_mission())
        else:
            return False
        return True

    async def _parameters(self) -> int:
        every = await self.program.param.get_all_params()
        return len(every.int_params) + len(every.float_params)

    async def _log(self) -> int:
        """Download the newest log. Returns its bytes."""
        newest = max(await self.program.logs.get_entries(), key=lambda entry: entry.id)
        target = Path(tempfile.mkdtemp()) / "log"
        async for _progress in self.program.logs.download_log_file(newest, str(target)):
            pass
        return target.stat().st_size

    async def _do(self, word: str) -> str:
        action, mission = self.program.action, self.program.mission
        plain = {
            "arm": action.arm,
            "disarm": action.disarm,
            "land": action.land,
            "rtl": action.return_to_launch,
            "hold": action.hold,
            "loiter": action.hold,
            "auto": mission.start_mission,
            "pause": mission.pause_mission,
            "clear": mission.clear_mission,
        }
        if word in plain:
            await plain[word]()
        elif word == "takeoff":
            await action.set_takeoff_altitude(HEIGHT_M)
            await action.takeoff()
        elif word == "fly":
            await action.goto_location(52.6772, 5.9222, 50.0, 0.0)
        elif word == "upload":
            await mission.upload_mission([self._item(number) for number in range(len(MISSION))])
        elif word == "param":
            await self.program.param.set_param_float(*PARAMETER)
        elif word == "connect":
            return "done"
        elif word == "alive":
            return await self._alive()
        elif word in DIRECT:
            return await self._command(*DIRECT[word])
        else:
            self.note("fault", f"not understood: {word!r}")
            return "unknown word"
        return "success"

    def _item(self, number: int) -> Any:
        command, latitude, longitude, height = MISSION[number]
        place = (round(latitude * 1e7), round(longitude * 1e7), height)
        return self.program.item(number, 6, command, int(number == 0), 1, 0.0, 0.0, 0.0, 0.0, *place, 0)

    async def _command(self, command: int, parameters: tuple[float, ...], component: int) -> str:
        values = (*parameters, *([0.0] * (7 - len(parameters))))
        if command == REQUEST:
            values = (*values[:3], float(self.sysid), *values[4:])
        fields = {f"param{place}": value for place, value in enumerate(values, 1)}
        fields.update(target_system=self.vehicle, target_component=component, command=command, confirmation=0)
        answer: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        self._waiting[command] = answer
        await self._send("COMMAND_LONG", fields, component)
        try:
            result = await asyncio.wait_for(answer, PATIENCE_S)
        except asyncio.TimeoutError:
            return "no answer"
        return COMMAND_RESULTS[result] if result < len(COMMAND_RESULTS) else str(result)

    async def _alive(self) -> str:
        """A MAVSDK whose threads hang is there, and does nothing any more."""
        self._moved.clear()
        try:
            await asyncio.wait_for(self._moved.wait(), PATIENCE_S)
        except asyncio.TimeoutError:
            return "no"
        return "yes"

    async def _send(self, name: str, fields: dict[str, Any], component: int) -> None:
        await self.program.direct.send_message(
            self.program.message(name, self.sysid, GROUND_STATION, self.vehicle, component, json.dumps(fields))
        )

    # ---- in ---------------------------------------------------------------------------------------------------------

    async def _texts(self) -> None:
        async for text in self.program.texts():
            self.note("said", text.text, severity=text.type.name.lower())

    async def _positions(self) -> None:
        async for place in self.program.positions():
            self.note("position", "", alt_m=round(place.relative_altitude_m, 1))
            self._moved.set()

    async def _listen(self, name: str, take: Any) -> None:
        async for message in self.program.messages(name):
            if message.system_id == self.vehicle:
                await take(message, json.loads(message.fields_json))

    async def _on_status(self, _message: Any, fields: dict[str, Any]) -> None:
        if not int(fields["flags"]) & CONTROL_STATUS_MANAGER or fields["gcs_main"] == self._owner:
            return
        self._owner = int(fields["gcs_main"])
        self.note("control", f"station {self._owner} is in control", owner=self._owner)

    async def _on_ack(self, _message: Any, fields: dict[str, Any]) -> None:
        if int(fields["result"]) == IN_PROGRESS:
            return
        waiting = self._waiting.pop(int(fields["command"]), None)
        if waiting is not None and not waiting.done():
            waiting.set_result(int(fields["result"]))

    async def _on_question(self, message: Any, fields: dict[str, Any]) -> None:
        if int(fields["command"]) != REQUEST:
            return
        answer = {"command": REQUEST, "result": 0, "progress": 0, "result_param2": 0}
        answer.update(target_system=self.vehicle, target_component=message.component_id)
        await self._send("COMMAND_ACK", answer, message.component_id)
        asker = int(fields["param4"])
        self.note("notified", f"station {asker} asks for control", asker=asker)

    async def _watch(self) -> None:
        while self.program.died() is None:
            await asyncio.sleep(0.2)
        self.note("fault", f"mavsdk_server ended with {self.program.died()}")


def _version() -> str:
    from importlib.metadata import version

    return version("mavsdk")


def _result_of(error: Exception) -> str:
    told = error if hasattr(error, "result") else getattr(error, "_result", error)
    result = getattr(told, "result", None)
    return repr(error) if result is None else str(result.name).lower()


def main() -> int:
    options = arguments(__doc__)
    logging.basicConfig(level=logging.DEBUG, format="%(name)s %(levelname)s %(message)s")
    address = f"tcpout://127.0.0.1:{options.tcp}" if options.tcp else f"udpin://127.0.0.1:{options.listen}"
    with options.journal.open("a", encoding="utf-8", buffering=1) as file:
        control = options.control.read_text(encoding="utf-8")
        station = Station(options.sysid, options.vehicle, control, Journal(options.name, file))
        code = asyncio.run(station.run(address))
    sys.stdout.flush()
    os._exit(code)  # MAVSDK's threads are not waited for


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        main()
