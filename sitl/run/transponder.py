# SPDX-License-Identifier: GPL-3.0-or-later

"""A Remote ID transponder on a port of the autopilot: `python -m sitl.run.transponder --config FILE --autopilot PORT`.

    journal = "transponder.jsonl"
    vehicle = 1                # system id

It says once a second that it is there and that the aircraft may be armed (OPEN_DRONE_ID_ARM_STATUS), and journals
whose place the autopilot has it broadcast: `operator`, with `operator_latitude` and `operator_longitude` (degrees
x 10^7), at each change. So its journal shows what a receiver of Remote ID would. It ends when its input does.
"""

from __future__ import annotations

import argparse
import json
import select
import socket
import time
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Final, TextIO

from pymavlink.dialects.v20 import handover as mavlink

from sitl.run.ending import Orders
from sitl.vehicles.ports import LOOPBACK

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

__all__ = ["TRANSPONDER", "Transponder", "main"]

#: name of the process, and of its entries
TRANSPONDER: Final = "transponder"
_AUTOPILOT: Final = mavlink.MAV_COMP_ID_AUTOPILOT1
_BEAT_S: Final = 1.0
_CONNECT_S: Final = 10.0
_READ_BYTES: Final = 65536


class Transponder:
    """The transponder of one vehicle. Times are monotonic seconds."""

    def __init__(self, vehicle: int, port: int, journal: TextIO) -> None:
        """`port`: TCP port of the autopilot. Raises OSError."""
        self.socket = socket.create_connection((LOOPBACK, port), _CONNECT_S)
        self._vehicle = vehicle
        self._journal = journal
        self._mav: Any = mavlink.MAVLink(None, srcSystem=vehicle, srcComponent=mavlink.MAV_COMP_ID_ODID_TXRX_1)
        self._mav.robust_parsing = True
        self._beat_at = 0.0
        self._operator: tuple[int, int] | None = None
        self.note("loaded", "transponder of Remote ID")

    def note(self, event: str, text: str, **values: object) -> None:
        """Write to the journal."""
        utc = datetime.now(timezone.utc).isoformat(timespec="milliseconds")
        entry = {"t": round(time.monotonic(), 4), "utc": utc, "who": TRANSPONDER, "event": event, "text": text}
        self._journal.write(json.dumps({**entry, **values}) + "\n")

    def tick(self, now: float) -> None:
        """Send what is due."""
        if now < self._beat_at:
            return
        self._beat_at = now + _BEAT_S
        kind, none = mavlink.MAV_TYPE_ODID, mavlink.MAV_AUTOPILOT_INVALID
        for message in (
            mavlink.MAVLink_heartbeat_message(kind, none, 0, 0, mavlink.MAV_STATE_ACTIVE, 3),
            mavlink.MAVLink_open_drone_id_arm_status_message(mavlink.MAV_ODID_ARM_STATUS_GOOD_TO_ARM, b""),
        ):
            self.socket.sendall(message.pack(self._mav))

    def listen(self) -> bool:
        """Read what has come. False: the autopilot has gone."""
        data = self.socket.recv(_READ_BYTES)
        for message in self._mav.parse_buffer(data) or ():
            # what another sender says is no order to broadcast it
            own = (message.get_srcSystem(), message.get_srcComponent()) == (self._vehicle, _AUTOPILOT)
            if own and message.get_type() in ("OPEN_DRONE_ID_SYSTEM", "OPEN_DRONE_ID_SYSTEM_UPDATE"):
                self._heard(message.operator_latitude, message.operator_longitude)
        return bool(data)

    def _heard(self, lat: int, lon: int) -> None:
        if (lat, lon) != self._operator:
            self._operator = lat, lon
            text = f"the operator is at {lat / 1e7:.7f}, {lon / 1e7:.7f}"
            self.note("operator", text, operator_latitude=lat, operator_longitude=lon)


def main(argv: Sequence[str] | None = None) -> int:
    """Run until standard input ends, or the autopilot has gone."""
    parser = argparse.ArgumentParser(prog="python -m sitl.run.transponder", description="A Remote ID transponder.")
    parser.add_argument("--config", type=Path, required=True, metavar="FILE")
    parser.add_argument("--autopilot", type=int, required=True, metavar="PORT")
    arguments = parser.parse_args(argv)
    config = tomllib.loads(arguments.config.read_text(encoding="utf-8"))
    orders = Orders()
    with Path(config["journal"]).open("a", encoding="utf-8", buffering=1) as journal:
        transponder = Transponder(config["vehicle"], arguments.autopilot, journal)
        link = transponder.socket.fileno()
        while True:
            transponder.tick(time.monotonic())
            ready, _, _ = select.select([*orders.descriptors, link], [], [], 0.1)
            if link in ready and not transponder.listen():
                return 0
            if any(orders.read(each) is None for each in ready if each != link):
                return 0


if __name__ == "__main__":
    raise SystemExit(main())
