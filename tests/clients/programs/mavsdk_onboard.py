# SPDX-License-Identifier: GPL-3.0-or-later

"""A program on the companion that is a program of MAVSDK, as its users write them.

It takes the options of `sitl.run.onboard` and keeps the same kind of journal. It runs in the Python that has the MAVSDK
to be tried. Typed, a line each:

    connect version           wait for the vehicle; read its version, by MAVSDK's `Info`
    position NORTH EAST DOWN  MAVSDK's `Offboard`: metres from where the position estimate began
    velocity NORTH EAST DOWN  likewise, in metres a second
    silent                    `Offboard.stop()`: it sends no more targets, and asks for LOITER
    rtl                       MAVSDK's `Action`
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import os
import sys
import time
from pathlib import Path
from typing import Any

from mavsdk_station import New, Old, _result_of, _version
from talk import Journal


class Onboard:
    """The program: what is typed, what is heard."""

    def __init__(self, vehicle: int, component: int, journal: Journal) -> None:
        self.note = journal.note
        self._started = time.monotonic()
        self.program: Any = (Old if _version() < "4" else New)(vehicle, component)
        self._connected = asyncio.Event()
        self.note("loaded", f"MAVSDK {_version()}, component {component}")

    async def run(self, address: str) -> None:
        """Until what is typed ends."""
        lines: asyncio.Queue[str] = asyncio.Queue()
        asyncio.get_running_loop().add_reader(sys.stdin, lambda: lines.put_nowait(sys.stdin.readline()))
        listening = asyncio.ensure_future(self._listen(address))
        orders: set[asyncio.Future[None]] = set()
        while line := await lines.get():
            orders.add(asyncio.ensure_future(self._order(line)))
        listening.cancel()

    async def _listen(self, address: str) -> None:
        await self.program.connect(address)
        self.note("connected", "the vehicle is heard", took_s=round(time.monotonic() - self._started, 2))
        self._connected.set()
        async for text in self.program.texts():
            self.note("said", text.text)

    async def _order(self, line: str) -> None:
        word, *numbers = line.split()
        await self._connected.wait()
        began = time.monotonic()
        try:
            result = await self._do(word, [float(number) for number in numbers])
        except Exception as error:  # what MAVSDK raises is the answer
            result = _result_of(error)
        took_s = round(time.monotonic() - began, 4)
        self.note("command", f"{line.strip()}: {result}", what=word, result=result, took_s=took_s)

    async def _do(self, word: str, numbers: list[float]) -> str:
        offboard, targets = self.program.offboard, self.program.targets
        if word == "version":
            version = await self.program.info.get_version()
            return f"{version.flight_sw_major}.{version.flight_sw_minor}"
        if word == "position":
            await offboard.set_position_ned(targets.PositionNedYaw(*numbers, 0.0))
        elif word == "velocity":
            await offboard.set_velocity_ned(targets.VelocityNedYaw(*numbers, 0.0))
        elif word == "silent":
            await offboard.stop()
        elif word == "rtl":
            await self.program.action.return_to_launch()
        elif word != "connect":
            self.note("fault", f"not understood: {word!r}")
            return "unknown word"
        return "success"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--journal", type=Path, required=True)
    for option in ("--vehicle", "--component", "--port"):
        parser.add_argument(option, type=int, required=True)
    options = parser.parse_args()
    logging.basicConfig(level=logging.DEBUG, format="%(name)s %(levelname)s %(message)s")
    with options.journal.open("w", encoding="utf-8", buffering=1) as file:
        program = Onboard(options.vehicle, options.component, Journal("onboard", file))
        asyncio.run(program.run(f"udpout://127.0.0.1:{options.port}"))
    sys.stdout.flush()
    os._exit(0)  # MAVSDK's threads are not waited for


if __name__ == "__main__":
    main()
