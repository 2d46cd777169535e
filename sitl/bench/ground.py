# SPDX-License-Identifier: GPL-3.0-or-later

"""The ground link of an artificial station: one end for all its vehicles, as a station has it.

The link itself is the one that ships (`gcs_module/ground.py`), signed with the ground key. This module does what
MAVProxy's module does around it: a heartbeat a second, and each message to its vehicle.
"""

from __future__ import annotations

import time
from functools import partial
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.core import FromPeer, PeerHeard
from gcs_module.ground import GroundLink
from mavproxy_handover.config.station import StationConfig
from mavproxy_handover.core.common.messages import Message
from mavproxy_handover.link.devices import LinkError
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.ids import STATION_COMPID
from sitl.bench.loop import BenchError, Loop, Timer
from sitl.bench.talker import TalkingStation

__all__ = ["GroundEnd"]

_TICK_S: Final = 0.1


class GroundEnd:
    """One station's end. `config`: of that, as far as the ground link goes."""

    def __init__(self, loop: Loop, config: StationConfig) -> None:
        """Listen. Raises BenchError, KeysError."""
        self._loop = loop
        self._talkers: dict[int, TalkingStation] = {}
        self._own = mavlink.MAVLink(None, srcSystem=config.station.sysid, srcComponent=STATION_COMPID)
        try:
            self._link = GroundLink(config, Clocks(time.time, time.monotonic))
        except LinkError as error:
            raise BenchError(f"{config.station.name}: ground link: {error}") from None
        listening = self._link.listening
        if listening is None:
            raise BenchError(f"{config.station.name} has no ground link")
        self._descriptor = listening
        loop.add_reader(listening, self._read)
        self._timers: list[Timer] = [loop.every(1.0, self._beat), loop.every(_TICK_S, self._tick)]

    @property
    def refused(self) -> dict[str, int]:
        """Frames that were dropped, by what was wrong with their signature."""
        return dict(self._link.refused)

    def join(self, talker: TalkingStation) -> None:
        """From now on it is this station's part for its vehicle."""
        vehicle = talker.companion[0]
        self._talkers[vehicle] = talker
        talker.to_peer = partial(self._send, vehicle)

    def _read(self) -> None:
        for frame in self._link.read():
            if frame.msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                for talker in self._talkers.values():
                    talker.hear(PeerHeard(frame.sysid))
                continue
            message = codec.decode_bytes(frame.raw)
            decoded = None if message is None else codec.decode(message)
            about = self._talkers.get(getattr(message, "vehicle", 0))
            if decoded is not None and about is not None:
                about.hear(FromPeer(frame.sysid, decoded))

    def _send(self, vehicle: int, peer: int, message: Message) -> None:
        self._link.write(peer, codec.pack(codec.encode(message, (peer, 0), vehicle), self._own))

    def _beat(self) -> None:
        beat = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
        )
        for peer in self._link.peers:
            self._link.write(peer, codec.pack(beat, self._own))

    def _tick(self) -> None:
        self._link.tick(time.monotonic())

    def close(self) -> None:
        """Close everything."""
        for timer in self._timers:
            timer.cancel()
        self._loop.remove_reader(self._descriptor)
        self._link.close()
