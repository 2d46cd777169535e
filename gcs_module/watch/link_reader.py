# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads what the frames of one link say about aircraft and stations. Pure: time is an argument, monotonic seconds.

Rules that live here
--------------------
* An aircraft is a system whose companion sends AUTHORITY_STATUS, or whose autopilot is heard.
* The name of an aircraft is the one in CONNECT and CONNECT_ACK. Before either has come it is "vehicle ID". The names of
  stations are those of a mission.
* Signatures are not checked: this page has no keys. It shows what is sent on its link.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import inf
from typing import Any, Final

from pymavlink import mavutil
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.alarms import DECISIONS, EVENTS
from gcs_module.texts import Texts
from gcs_module.watch.scene import MOST_AIRCRAFT, Aircraft, Border, Place, Rank, Scene, Source
from mavproxy_handover.core.common.model import FlightAction, GuardState, LeaseState, Phase
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, COMPANION_COMPID, LANGUAGE_COMPID, PAYLOAD_COMPIDS
from mavproxy_handover.wire.texts import COMMANDS_NOW, is_marked

__all__ = ["LinkReader"]

_TAKEN: Final = frozenset(
    (
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
        mavlink.MAVLINK_MSG_ID_AUTHORITY_STATUS,
        mavlink.MAVLINK_MSG_ID_CONTROL_STATUS,
        mavlink.MAVLINK_MSG_ID_HANDOVER_AHEAD,
        mavlink.MAVLINK_MSG_ID_HANDOVER_DECISION,
        mavlink.MAVLINK_MSG_ID_HANDOVER_TELEMETRY,
        mavlink.MAVLINK_MSG_ID_CONNECT,
        mavlink.MAVLINK_MSG_ID_CONNECT_ACK,
    )
)
#: components that send the companion's messages: LANGUAGE_COMPID is the sender of our own messages
_SPEAKERS: Final = (COMPANION_COMPID, LANGUAGE_COMPID)
#: components that say which station has a kind of payload
_PAYLOAD: Final = {component: kind for kind, component in PAYLOAD_COMPIDS.items()}
_NO_HEADING, _NO_VOLTAGE = 0xFFFF, 0xFFFF
_GUARD_TROUBLE: Final = (GuardState.EXPIRED, GuardState.LOST, GuardState.SILENT)


class LinkReader:
    """Reads one link. `station_name`: the name that a mission gives to a system id, "": none does."""

    def __init__(self, scene: Scene, name: str, station_name: Callable[[int], str]) -> None:
        self.source = Source(name)
        self._scene = scene
        self._station_name = station_name
        #: aircraft by system id, the texts of their companions, and number and words of the last decision
        self._aircraft: dict[int, Aircraft] = {}
        self._texts: dict[int, Texts] = {}
        self._decided: dict[int, tuple[int, str]] = {}

    def on_frame(self, frame: Frame, now: float, utc_now: float) -> None:
        """A frame of the link."""
        self.source.heard_at = now
        if frame.msgid == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
            companions = frame.compid == COMPANION_COMPID or (frame.compid == AUTOPILOT_COMPID and is_marked(frame))
            if companions and frame.sysid in self._aircraft:
                self._texts.setdefault(frame.sysid, Texts(lambda _text: False)).on_frame(frame, now)
            return
        if frame.msgid not in _TAKEN:
            return
        m = codec.decode_bytes(frame.raw)
        craft = None if m is None else self._craft(frame, m)
        if m is None or craft is None:
            return
        craft.heard_at, craft.ended = now, False
        if craft.source is None:
            craft.source = self.source
        if frame.compid in _SPEAKERS:
            self._of_companion(frame.sysid, craft, m, now, utc_now)
        elif frame.compid == AUTOPILOT_COMPID:
            self._of_autopilot(craft, m, now)
        elif m.get_type() == "CONTROL_STATUS" and frame.compid in _PAYLOAD:
            craft.payload[_PAYLOAD[frame.compid]].hear(self._name(m.gcs_main) or "no station", now, Rank.AIRCRAFT)

    def tick(self, now: float, utc_now: float) -> None:
        """Show complete texts; to be called each second."""
        for sysid, texts in self._texts.items():
            for text in texts.due(now, partial(self._told, sysid)):
                self._scene.tell(utc_now, self._aircraft[sysid].name, text.level, text.words)

    def _told(self, sysid: int, text: str) -> bool:
        """Decisions and changes of the commander arrive as messages of ours too, and are told from those."""
        return text == self._decided.get(sysid, (0, ""))[1] or COMMANDS_NOW in text

    def _craft(self, frame: Frame, m: Any) -> Aircraft | None:
        found = self._aircraft.get(frame.sysid)
        if found is not None:
            return found
        ours = frame.compid in _SPEAKERS and m.get_type() == "AUTHORITY_STATUS"
        flies = frame.compid == AUTOPILOT_COMPID and m.get_type() == "HEARTBEAT" and m.type != mavlink.MAV_TYPE_GCS
        if not (ours or flies) or len(self._aircraft) >= MOST_AIRCRAFT:
            return None
        found = self._scene.craft(f"vehicle {frame.sysid}")
        if found is not None:
            self._aircraft[frame.sysid] = found
        return found

    def _name(self, sysid: int) -> str:
        return "" if not sysid else self._station_name(sysid) or f"station {sysid}"

    def _of_companion(self, sysid: int, craft: Aircraft, m: Any, now: float, utc_now: float) -> None:
        kind = m.get_type()
        if kind == "AUTHORITY_STATUS":
            self._authority(craft, m, now, utc_now)
        elif kind == "HANDOVER_AHEAD":
            border = Border(self._name(m.from_station), self._name(m.to_station), now + m.in_s)
            craft.border.hear(border, now, Rank.AIRCRAFT)
        elif kind == "HANDOVER_DECISION":
            self._decision(sysid, craft, m, now, utc_now)
        elif kind == "HANDOVER_TELEMETRY":
            self._telemetry(craft, m, now)
        elif kind in ("CONNECT", "CONNECT_ACK") and m.vehicle == sysid:
            self._named(sysid, craft, m)

    def _named(self, sysid: int, craft: Aircraft, m: Any) -> None:
        raw = m.name if isinstance(m.name, str) else m.name.decode("utf-8", "replace")
        name = raw.rstrip("\0")
        if not name or not name.isprintable() or name == craft.name:
            return
        known = self._scene.aircraft.get(name)
        if known is None:  # the same aircraft, now with its name
            self._scene.aircraft[name] = self._scene.aircraft.pop(craft.name)
            craft.name = name
        elif (
            known is not craft and known.source is not self.source
        ):  # known already by another source, such as its journal
            self._scene.aircraft.pop(craft.name, None)
            self._aircraft[sysid] = known

    def _authority(self, craft: Aircraft, m: Any, now: float, utc_now: float) -> None:
        before, told = craft.commander.value, craft.commander.known
        commander, partner = self._name(m.commander), self._name(m.partner)
        lease = LeaseState(m.lease) if m.lease in list(LeaseState) else None
        guard = GuardState(m.guard) if m.guard in list(GuardState) else None
        phase = Phase(m.phase) if m.phase in list(Phase) else Phase.EMERGENCY
        craft.commander.hear(commander, now, Rank.AIRCRAFT)
        craft.partner.hear(partner, now, Rank.AIRCRAFT)
        craft.zone.hear(self._name(m.zone), now, Rank.AIRCRAFT)
        craft.epoch.hear(m.epoch, now, Rank.AIRCRAFT)
        craft.phase.hear(phase.name.lower(), now, Rank.AIRCRAFT)
        craft.lease.hear("" if lease is None else lease.name.lower(), now, Rank.AIRCRAFT)
        craft.guard.hear("" if guard is None else guard.name.lower(), now, Rank.AIRCRAFT)
        craft.rehearsal.hear(bool(m.rehearsal), now, Rank.AIRCRAFT)
        # the field is one more than the seconds; 0: no end in sight
        craft.zone_ends_at.hear(now + m.zone_ends - 1.0 if m.zone_ends else inf, now, Rank.AIRCRAFT)
        craft.own_route = not m.route_changed
        for name in (commander, partner):
            if name:
                craft.contact(name)
                self._scene.station(name)
        if commander or phase is Phase.ON_LOAD or lease is LeaseState.ALONE:
            craft.alarms.end("commander")
        else:
            craft.alarms.begin("commander", EVENTS["no_commander"], "no station commands", now)
        if guard in _GUARD_TROUBLE and phase is not Phase.ON_LOAD:
            craft.alarms.begin("guard", EVENTS["lost"], f"guard {craft.guard.value}", now)
        else:
            craft.alarms.end("guard")
        if told and before != commander and craft.source is self.source:
            event = "authority" if commander else "no_commander"
            words = f"{commander or 'no station'} commands, epoch {m.epoch}"
            self._scene.tell(utc_now, craft.name, EVENTS[event], words)

    def _decision(self, sysid: int, craft: Aircraft, m: Any, now: float, utc_now: float) -> None:
        raw = m.text if isinstance(m.text, str) else m.text.decode("utf-8", "replace")
        text = raw.rstrip("\0")
        action = FlightAction(m.action) if m.action in list(FlightAction) else None
        over = m.action == mavlink.HANDOVER_ACTION_NONE
        # an action of a newer version is not known here: it alarms as a return does
        level = EVENTS["decision_over"] if over else DECISIONS[action or FlightAction.RETURN]
        if over or craft.rehearsal.value:
            craft.alarms.end("decision")
        else:
            craft.alarms.begin("decision", level, text, now)
        if self._decided.get(sysid) != (m.number, text):
            self._decided[sysid] = m.number, text
            self._scene.tell(utc_now, craft.name, level, text)

    def _telemetry(self, craft: Aircraft, m: Any, now: float) -> None:
        place = _place(m.lat, m.lon, m.relative_alt)
        if place is not None:
            craft.moved(place, now, Rank.AIRCRAFT)
        craft.waypoint.hear(m.waypoint, now, Rank.AIRCRAFT)
        self._battery(craft, m.battery_remaining, m.battery_voltage, now)

    def _of_autopilot(self, craft: Aircraft, m: Any, now: float) -> None:
        kind = m.get_type()
        if kind == "HEARTBEAT":
            craft.mode.hear(mavutil.mode_string_v10(m), now, Rank.AIRCRAFT)
        elif kind == "SYS_STATUS":
            self._battery(craft, m.battery_remaining, m.voltage_battery, now)
        elif kind == "MISSION_CURRENT":
            craft.waypoint.hear(m.seq, now, Rank.AIRCRAFT)
        elif kind == "GLOBAL_POSITION_INT":
            place = _place(m.lat, m.lon, m.relative_alt)
            if place is not None:
                craft.moved(place, now, Rank.AIRCRAFT)
            heading = None if m.hdg == _NO_HEADING else m.hdg / 100.0
            craft.heading_deg.hear(heading, now, Rank.AIRCRAFT)
            craft.speed_mps.hear((m.vx**2 + m.vy**2) ** 0.5 / 100.0, now, Rank.AIRCRAFT)

    @staticmethod
    def _battery(craft: Aircraft, percent: int, millivolts: int, now: float) -> None:
        if 0 <= percent <= 100:
            craft.battery_percent.hear(float(percent), now, Rank.AIRCRAFT)
        if 0 < millivolts < _NO_VOLTAGE:
            craft.battery_words.hear(f"{millivolts / 1000.0:.1f} V", now, Rank.AIRCRAFT)


def _place(lat: int, lon: int, relative_mm: int) -> Place | None:
    """The place in units of the messages; None: it is not known."""
    lat_deg, lon_deg = lat / 1e7, lon / 1e7
    if (lat, lon) == (0, 0) or abs(lat_deg) > 90.0 or abs(lon_deg) > 180.0:
        return None
    return Place(lat_deg, lon_deg, relative_mm / 1000.0)
