# SPDX-License-Identifier: GPL-3.0-or-later

"""Connects a served program (`served_program.py`) with MAVProxy and the vehicles of the station."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.aircraft import Aircraft
from gcs_module.events import Notice
from gcs_module.notices import notice
from gcs_module.served_ids import Kind
from gcs_module.served_program import LOST_S, SILENT_S, Change, ServedProgram
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame, target

__all__ = ["Serving"]

#: MAVProxy's settings that are changed while a program is served: it sends no heartbeats of its own, and what comes
#: from its outputs is not passed on (they may watch)
_SETTINGS: Final = {"heartbeat": 0, "mavfwd": False}


class Serving:
    """`link`: as the configuration names it. `aircraft`: the station's vehicles."""

    def __init__(self, mpstate: Any, link: str, program: ServedProgram, aircraft: Sequence[Aircraft]) -> None:
        self._mpstate = mpstate
        self._link = link
        self._program = program
        self._aircraft = aircraft
        self._kept = {name: getattr(mpstate.settings, name) for name in _SETTINGS if hasattr(mpstate.settings, name)}
        for name in self._kept:
            setattr(mpstate.settings, name, _SETTINGS[name])

    def begin(self, now: float) -> None:
        """Tell the operator what is waited for. Nothing is answered before the program is heard."""
        self._update_mute(now)
        self._tell(notice("program_awaited", link=self._link), now)

    def tick(self, now: float) -> None:
        """Pass on what the program sent; to be called often."""
        self._update_mute(now)  # first: a fault below must not let the module answer for a dead program
        for kind, frame in self._program.read(now):
            if kind is Kind.HEARTBEAT:
                self._beat()
            else:
                self._pass_on(frame)
        self._update_mute(now)
        change = self._program.change(now)
        if change is not Change.NONE:
            row = "program_heard" if change is Change.HEARD else "program_silent"
            self._tell(notice(row, link=self._link, silent_s=SILENT_S, lost_s=LOST_S), now)

    def on_vehicle(self, frame: Frame) -> None:
        """A frame of a vehicle of this station."""
        self._program.to_program(frame)

    def release(self) -> None:
        """Restore MAVProxy's settings, and close the port."""
        for aircraft in self._aircraft:
            aircraft.mute = False
        for name, value in self._kept.items():
            setattr(self._mpstate.settings, name, value)
        self._program.close()

    def _update_mute(self, now: float) -> None:
        mute = not self._program.is_there(now)
        for aircraft in self._aircraft:
            aircraft.mute = mute

    def _beat(self) -> None:
        """The station's heartbeat on every link, as MAVProxy sends it."""
        for master in self._mpstate.mav_master:
            with suppress(OSError):  # one link is gone: MAVProxy notices that, and the others get the heartbeat
                master.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)

    def _pass_on(self, frame: Frame) -> None:
        """Send a frame to the vehicle that it is for; one without a target, to each."""
        message = codec.decode_bytes(frame.raw)
        if message is None:
            return
        to = target(frame)
        for aircraft in self._aircraft:
            if to is None or to[0] in (0, aircraft.sysid):
                aircraft.connection.send(message)

    def _tell(self, told: Notice, now: float) -> None:
        self._aircraft[0].event_log.notice(told, now)
