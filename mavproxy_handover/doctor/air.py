# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks the vehicle from a station: is it heard, signed with its key, and does it announce the local mission?

This check listens. It sends only TIMESYNC questions, which the gate accepts from any station, and none while the
vehicle reports that it is armed. They come from the doctor's own component, so no program mistakes this for the
station's program.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from statistics import median
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.config.station import FleetVehicle, StationConfig
from mavproxy_handover.core.common.messages import Connect
from mavproxy_handover.doctor.check_context import CheckContext
from mavproxy_handover.doctor.finding import Finding, badly_signed, error, ok, unseen, warning
from mavproxy_handover.doctor.line import here, line_findings, usable
from mavproxy_handover.doctor.mission import shown
from mavproxy_handover.doctor.ports import held_by_ours
from mavproxy_handover.doctor.talk import Talk
from mavproxy_handover.link.devices import Kind, LinkError, open_device, parse_device
from mavproxy_handover.link.timesync import answered_stamp, draw_stamp, probe_message
from mavproxy_handover.store.confirmed_address import address_file, kept_address
from mavproxy_handover.store.keys import KeysError, load_station_keys
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID
from mavproxy_handover.wire.signing import SignedPeer

__all__ = ["air"]

#: listening time (s): the companion asks each station once a second whether it is there
_LISTEN_S: Final = 3.0
#: time (s) for answers, and interval of questions
_ASK_S: Final = 0.5
_ASKED: Final = 4
_NO_LINK: Final = "no link is named, and no address of another station is confirmed ('handover connect')"
_SILENT: Final = "Look whether its companion runs ('handover doctor' there), then at address, firewall and link."


def air(context: CheckContext) -> Iterator[Finding]:
    """The findings of this check."""
    station = context.station
    if station is None or not context.links:
        return
    if context.clock_wrong:
        yield unseen("vehicles", "the clock is wrong, and signatures are judged by it", "Set the clock first.")
        return
    for vehicle in station.vehicles:
        links = vehicle.links or ((context.master,) if context.master else ())
        kept = list(_kept(context, station, vehicle, own=bool(links)))
        yield from kept
        if not links and not kept:
            do = "Give --device LINK, as for 'handover station --master'."
            yield unseen(vehicle.called, _NO_LINK, do)
        for link in links:
            yield from _by(context, station, vehicle, link)


def _kept(context: CheckContext, station: StationConfig, vehicle: FleetVehicle, *, own: bool) -> Iterator[Finding]:
    """The vehicle's address that the operator confirmed. Nothing is sent to it, because the running station uses the
    link.
    """
    what = f"address of {vehicle.called}"
    file = context.at(address_file(station.path, station.station.name, vehicle.sysid))
    try:
        kept = kept_address(file)
    except (ValueError, OSError) as fault:
        do = f"Delete {file}. Then confirm the address again: 'handover share' at the parent sends it."
        yield error(what, f"{file}: {' '.join(str(fault).split())}", do)
        return
    if kept is not None:
        use = (
            "not used: this station has its own link" if own else "'handover status' at the station says what it hears"
        )
        yield ok(what, f"{kept.text} from {kept.sender}, confirmed {kept.at}; {use}")


def _by(context: CheckContext, station: StationConfig, vehicle: FleetVehicle, text: str) -> Iterator[Finding]:
    what = f"{vehicle.called}, {text}"
    try:
        spec = parse_device(text)
    except LinkError as fault:
        yield error(what, str(fault), "Name the link in one of these forms.")
        return
    if held_by_ours(context, spec):
        yield ok(what, "held by the station that runs: 'handover status' there says what it hears")
        return
    try:
        peer = None
        if vehicle.key is not None:
            keys = load_station_keys(context.at(vehicle.key), context.account.uid)
            peer = SignedPeer(keys.current, keys.previous)
        if spec.kind is Kind.SERIAL:
            findings = list(line_findings(context, spec, vehicle.called))
            yield from findings
            if not usable(findings):
                return
            spec = here(context, spec)
        listener = _Listener(context, station, vehicle, spec.text, peer)
    except KeysError:  # reported with the keys
        yield unseen(what, "the key cannot be used", "Put the key right first.")
        return
    except LinkError as fault:  # its user is reported with the ports
        yield unseen(what, str(fault), "Free it first.")
        return
    try:
        context.tell(f"listening to {vehicle.called} on {text}, {_LISTEN_S + _ASKED * _ASK_S:g} s at most")
        listener.listen()
        yield from listener.findings(what)
    finally:
        listener.talk.close()


class _Listener:
    """One link to one vehicle."""

    def __init__(
        self, context: CheckContext, station: StationConfig, vehicle: FleetVehicle, text: str, peer: SignedPeer | None
    ) -> None:
        """Raises LinkError."""
        self._context = context
        self._vehicle = vehicle
        self._connect: Connect | None = None
        self._frames = 0
        self._armed = False
        self._asked: dict[int, float] = {}
        self._trips_s: list[float] = []
        self.talk = Talk(
            open_device(text),
            station.station.sysid,
            (vehicle.sysid, 0),
            peer,
            context.clocks,
            self._heed,
            lambda: not self._armed,
        )

    def _heed(self, message: Any, frame: Frame) -> None:
        self._frames += 1
        now = self._context.clocks.monotonic()
        if frame.compid == AUTOPILOT_COMPID and message.get_type() == "HEARTBEAT":
            self._armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        decoded = codec.decode(message)
        if isinstance(decoded, Connect):
            self._connect = decoded
        stamp = answered_stamp(frame)
        if stamp is not None and stamp in self._asked:
            self._trips_s.append(now - self._asked.pop(stamp))

    def listen(self) -> None:
        """Listen, and measure the round trip."""
        self.talk.listen(_LISTEN_S, lambda: self._connect is not None)
        for _ in range(_ASKED):
            if self._armed:
                return
            now = self._context.clocks.monotonic()
            stamp = draw_stamp(now, secrets.randbits)
            self._asked[stamp] = now
            self.talk.send(probe_message(stamp))
            self.talk.listen(_ASK_S, lambda: not self._asked)

    def findings(self, what: str) -> Iterator[Finding]:
        """The results."""
        if not self._frames:
            yield self._silent(what)
            return
        trip = f", there and back in {median(self._trips_s) * 1000:.1f} ms" if self._trips_s else ""
        yield ok(what, f"heard{trip}{', armed: only listened to' if self._armed else ''}")
        yield from self._mission()

    def _silent(self, what: str) -> Finding:
        bad = self.talk.bad
        others = sorted(set(self.talk.heard) - {self._vehicle.sysid})
        if bad:
            return badly_signed(what, self._vehicle.called, list(bad), self.talk.peer)
        if others:
            found = f"no frame of system {self._vehicle.sysid}, but of {', '.join(map(str, others))}"
            return error(what, found, "Set the vehicle's sysid as the vehicle's own configuration has it.")
        trouble = self.talk.device.trouble
        return error(what, f"silent for {_LISTEN_S:g} s{f' ({trouble})' if trouble else ''}", _SILENT)

    def _mission(self) -> Iterator[Finding]:
        here, connect = self._context.digests.get(self._vehicle.sysid), self._connect
        what = f"mission of {self._vehicle.called}"
        if connect is None:
            found = "the vehicle does not ask for this station: its companion does not run, or does not know it"
            yield warning(what, found, "Look at the companion's configuration: 'handover doctor' there.")
        elif here is None or not connect.mission_digest:
            yield ok(what, f"the vehicle announces digest {shown(connect.mission_digest)}")
        elif connect.mission_digest != here:
            found = f"the vehicle announces digest {shown(connect.mission_digest)}, here lies {shown(here)}"
            do = "Share one mission from the parent (handover share), or copy the same folder to both."
            yield error(what, found, do)
        else:
            yield ok(what, f"the vehicle announces the same digest, {shown(here)}")
