# SPDX-License-Identifier: GPL-3.0-or-later

"""`python log_reader.py pymavlink|mavsdk ADDRESS`: a ground station that downloads one log, as users write it.

It runs in the Python that has the library to be measured, and needs nothing else of this project. It says "ready" when
it hears the vehicle. It waits for one line, `log download NUMBER FILE`, and downloads that log. Then it tells bytes,
seconds, rate and retries in MAVProxy's words. MAVSDK does not tell its retries.
"""

from __future__ import annotations

import asyncio
import os
import socket
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

SYSID, VEHICLE, AUTOPILOT, GROUND_STATION = 251, 1, 1, 190
PIECE = 90
ALL = 0xFFFFFFFF
#: after this time (s) without data, missing data is requested
SILENT_S = 0.7
BEAT_S = 1.0


def tell(path: Path, seconds: float, retries: str) -> None:
    size = path.stat().st_size
    rate = size / seconds / 1e3
    print(f"Finished downloading {path} ({size} bytes {seconds:.3f} seconds, {rate:.1f} kbyte/sec {retries} retries)")


def typed() -> tuple[int, Path]:
    words = sys.stdin.readline().split()
    return int(words[2]), Path(words[3])


class WithPymavlink:
    """One thread, one link."""

    def __init__(self, address: str) -> None:
        from pymavlink import mavutil

        os.environ["MAVLINK20"] = "1"
        self._link = mavutil.mavlink_connection(address, source_system=SYSID, source_component=GROUND_STATION)
        self._beat_at = 0.0

    def run(self) -> None:
        while self._next("HEARTBEAT", BEAT_S) is None:
            pass
        print("ready", flush=True)
        number, path = typed()
        size = self._size(number)
        pieces: dict[int, bytes] = {}
        missing = set(range(0, size, PIECE))
        began, retries = time.monotonic(), 0
        self._ask(number, 0)
        while missing:
            message = self._next("LOG_DATA", SILENT_S)
            if message is None:
                retries += 1
                self._ask(number, min(missing))
            elif message.ofs in missing:
                missing.discard(message.ofs)
                pieces[message.ofs] = bytes(message.data[: message.count])
        seconds = time.monotonic() - began
        self._link.mav.log_request_end_send(VEHICLE, AUTOPILOT)
        path.write_bytes(b"".join(pieces[place] for place in sorted(pieces)))
        tell(path, seconds, str(retries))

    def _size(self, number: int) -> int:
        while True:
            self._link.mav.log_request_list_send(VEHICLE, AUTOPILOT, number, number)
            entry = self._next("LOG_ENTRY", 2.0)
            if entry is not None and entry.id == number:
                return int(entry.size)

    def _ask(self, number: int, begin: int) -> None:
        self._link.mav.log_request_data_send(VEHICLE, AUTOPILOT, number, begin, ALL)

    def _next(self, kind: str, timeout_s: float) -> Any:
        """The next message of this kind; None if there is none within `timeout_s`."""
        until = time.monotonic() + timeout_s
        while (now := time.monotonic()) < until:
            if now >= self._beat_at:
                self._beat_at = now + BEAT_S
                self._link.mav.heartbeat_send(6, 8, 0, 0, 4)
            message = self._link.recv_match(blocking=True, timeout=until - now)
            if message is not None and message.get_type() == kind and message.get_srcSystem() == VEHICLE:
                return message
        return None


async def with_mavsdk(address: str) -> None:
    import mavsdk

    if version("mavsdk") < "4":  # `mavsdk_server` and gRPC
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        system: Any = mavsdk.System(port=port, sysid=SYSID, compid=GROUND_STATION)
        await system.connect(system_address=address)
        async for state in system.core.connection_state():
            if state.is_connected:
                break
        logs = system.log_files
    else:
        from mavsdk.asyncio import Configuration, Mavsdk
        from mavsdk.asyncio.plugins.log_files import LogFilesAsync

        library: Any = Mavsdk(Configuration.create_manual(SYSID, GROUND_STATION, True))
        await library.add_any_connection(address)
        system = None
        while system is None:
            system = await library.first_autopilot(timeout_s=1.0)
        logs = LogFilesAsync(system)
    await asyncio.sleep(1.5)  # the first heartbeat goes out
    print("ready", flush=True)
    number, path = await asyncio.to_thread(typed)
    entry = next(entry for entry in await logs.get_entries() if entry.id == number)
    began = time.monotonic()
    async for _progress in logs.download_log_file(entry, str(path)):
        pass
    tell(path, time.monotonic() - began, "unknown")


def main() -> None:
    """Download, then wait to be ended."""
    library, address = sys.argv[1:]
    if library == "pymavlink":
        WithPymavlink(address).run()
    else:
        asyncio.run(with_mavsdk(address))
    sys.stdout.flush()
    sys.stdin.readline()
    os._exit(0)  # MAVSDK's threads are not waited for


if __name__ == "__main__":
    main()
