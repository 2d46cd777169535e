# SPDX-License-Identifier: GPL-3.0-or-later

"""Reads the entries of a journal about aircraft and stations. Pure: time is an argument, monotonic seconds.

Rules that live here
--------------------
* The entries tell what writes the journal: those of a station have a role, those of an aircraft a view or a position.
  Before one of these has come, no entry counts; the last few entries wait.
* An entry is as old as its `utc` by the watching machine's clock, and never newer than the moment when it was read: a
  wrong clock makes a flight look older than it is, or hides it.
* The level of a line comes from `alarms.py`: an aircraft's line has the level of the corresponding line of a station.
* What an aircraft's own journal tells is not repeated from the journals of its stations.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from gcs_module.alarms import DECISIONS, EVENTS, STANDS, Alarms, Level
from gcs_module.watch.scene import HOLDS_S, Aircraft, Place, Rank, Scene, Source, Station
from gcs_module.watch.tail import Entry
from mavproxy_handover.core.common.model import FlightAction

__all__ = ["TOLD", "Writer"]

#: entry of an aircraft's journal -> the entry of a station with the same level; others are not in the feed
TOLD: Final = {
    "loaded": "text",
    "unloaded": "peer_lost",
    "started_again": "peer_lost",
    "restarted": "peer_lost",
    "failed_closed": "no_commander",
    "fault": "peer_lost",
    "state_lost": "lost",
    "journal_lost": "peer_lost",
    "clock_step": "peer_lost",
    "station_heard": "connected",
    "authority_lost": "lost",
    "attack": "lost",
    "partner_unfit": "peer_lost",
    "authority": "authority",
    "started": "phase",
    "start_refused": "question",
    "start_failed": "asked",
    "gap": "countdown",
    "landed": "phase",
    "transfer_begun": "announced",
    "transfer_raised": "announced",
    "transfer_committed": "control_gained",
    "transfer_aborted": "aborted",
    "zone_entered": "phase",
    "zone_left": "zone_left",
    "off_route": "off_route",
    "on_route": "on_route",
    "rerouted": "rerouted",
    "decision": "decision",
    "guard": "peer",
    "mode": "phase",
    "delivery": "phase",
    "reached": "phase",
    "place": "phase",
    "link": "peer_lost",
    "command_refused": "question",
    "override": "question",
    "refused": "text",
    "stream": "stream",
    "mission_loaded": "phase",
    "mission_failed": "question",
    "position_source": "peer",
    "rehearsal": "phase",
    "rehearsal_refused": "question",
    "second_manager": "lost",
    "autopilot_restarted": "lost",
    "in_our_name": "lost",
    "energy_budget": "question",
}
#: entries about the station itself: shown with or without the aircraft's journal
_ITS_OWN: Final = frozenset(
    {
        *("loaded", "unloaded", "fault", "lost", "requested", "asked", "consent", "countdown", "peer", "peer_lost"),
        *("command", "acknowledged", "stream", "named", "link", "package_sent", "package_received"),
    }
)
#: alarms of a station that the aircraft's own journal tells better
_THE_AIRCRAFTS: Final = frozenset(("commander", "decision", "route"))
_GUARDS: Final = frozenset(("disabled", "waiting", "live", "expired", "lost", "silent"))
#: entries that wait until the journal's writer is known
_WAITING: Final = 64
#: most devices of one station
_MOST_LINKS: Final = 8
_ACTIONS: Final = {action.name.lower(): action for action in FlightAction}


def _place(entry: Entry) -> Place | None:
    lat_deg, lon_deg = entry.number("lat_deg"), entry.number("lon_deg")
    if lat_deg is None or lon_deg is None or not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):
        return None
    return Place(lat_deg, lon_deg, entry.number("alt_m"))


class Writer:
    """The writer of one journal, and the state from its entries. `name`: of the file, for people."""

    def __init__(self, scene: Scene, name: str) -> None:
        self.source = Source(name)
        #: the aircraft that writes the journal; None: no aircraft does, or it is not known yet
        self.aircraft: Aircraft | None = None
        self._scene = scene
        self._station: Station | None = None
        self._waiting: deque[tuple[Entry, float, float]] = deque(maxlen=_WAITING)

    def add_entry(self, entry: Entry, now: float, utc_now: float) -> None:
        """An entry that was read just now. `utc_now`: seconds since 1970 by this machine's clock."""
        at = now if entry.utc is None else min(now, now - (utc_now - entry.utc))
        utc = utc_now if entry.utc is None else entry.utc
        if self.aircraft is None and self._station is None and not self._known_by(entry):
            self._waiting.append((entry, at, utc))
            return
        while self._waiting:
            self._apply(*self._waiting.popleft())
        self._apply(entry, at, utc)

    def _known_by(self, entry: Entry) -> bool:
        """Whether this entry tells what writes the journal."""
        if "role" in entry.fields or entry.event == "telemetry" or entry.text.startswith("handover_gcs "):
            self._station = self._scene.station(entry.who)
        elif (entry.event == "view" and entry.word("lease")) or (entry.event == "position" and _place(entry)):
            self.aircraft = self._scene.craft(entry.who)
        return self.aircraft is not None or self._station is not None

    def _apply(self, entry: Entry, at: float, utc: float) -> None:
        self.source.heard_at = max(self.source.heard_at, at)
        if self.aircraft is not None:
            self._of_aircraft(self.aircraft, entry, at, utc)
        elif self._station is not None:
            self._of_station(self._station, entry, at, utc)

    # ---- an aircraft's own ----------------------------------------------------------------------------------------

    def _of_aircraft(self, craft: Aircraft, entry: Entry, at: float, utc: float) -> None:
        craft.source, craft.heard_at = self.source, max(craft.heard_at, at)
        craft.ended = entry.event == "unloaded"
        station = entry.word("station")
        if entry.event == "view":
            self._view(craft, entry, at)
        elif entry.event == "position":
            place = _place(entry)
            craft.commander.hear(entry.word("commander") or "", at, Rank.AIRCRAFT, self.source)
            craft.zone.hear(entry.word("zone") or "", at, Rank.AIRCRAFT)
            waypoint = entry.number("waypoint")
            craft.waypoint.hear(None if waypoint is None else int(waypoint), at, Rank.AIRCRAFT)
            if place is not None:
                craft.moved(place, at, Rank.AIRCRAFT)
        elif entry.event == "mode":
            craft.mode.hear(entry.word("mode") or "", at, Rank.AIRCRAFT, self.source)
        elif entry.event == "guard":
            self._guard(craft, entry, at)
        elif entry.event == "payload":
            self._payload(craft, entry, at)
        elif entry.event == "energy":
            left_wh = entry.number("left_wh")
            words = entry.text.split(" left", 1)[0] if left_wh is not None and " left" in entry.text else ""
            craft.battery_words.hear(words or ("" if left_wh is None else f"{left_wh:g} Wh"), at, Rank.AIRCRAFT)
        elif entry.event in ("station_heard", "connected", "authority_lost") and station:
            contact = craft.contact(station)
            if contact is not None:
                contact.heard = entry.event != "authority_lost"
            self._scene.station(station)
        elif entry.event == "link" and station:
            self._link(craft, station, entry)
        elif entry.event == "decision":
            self._decision(craft, entry, at)
        elif entry.event == "off_route":
            craft.alarms.begin("route", EVENTS["off_route"], entry.text, at)
        elif entry.event in ("on_route", "rerouted"):
            craft.alarms.end("route")
            craft.own_route = craft.own_route and entry.event != "rerouted"
        elif entry.event in ("mission_loaded", "loaded"):
            craft.own_route = True
        if entry.event == "unloaded":
            for name in ("decision", "route", "commander", "guard"):
                craft.alarms.end(name)
        if entry.event in TOLD:
            self._scene.tell(utc, craft.name, self._level(craft, entry), entry.text or entry.event)

    @staticmethod
    def _level(craft: Aircraft, entry: Entry) -> Level:
        if entry.event == "decision":
            action = _ACTIONS.get(entry.word("action") or "")
            over = action is None or craft.rehearsal.value  # in a rehearsal no action is taken
            return EVENTS["decision_over"] if over or action is None else DECISIONS[action]
        if entry.event == "authority" and not entry.word("station"):
            return EVENTS["no_commander"]
        if entry.event == "link" and entry.word("change") == "restored":
            return EVENTS["peer"]
        return EVENTS[TOLD[entry.event]]

    def _view(self, craft: Aircraft, entry: Entry, at: float) -> None:
        commander, phase, lease = (entry.word(key) or "" for key in ("commander", "phase", "lease"))
        epoch = entry.number("epoch")
        craft.commander.hear(commander, at, Rank.AIRCRAFT, self.source)
        craft.partner.hear(entry.word("partner") or "", at, Rank.AIRCRAFT, self.source)
        craft.phase.hear(phase, at, Rank.AIRCRAFT, self.source)
        craft.lease.hear(lease, at, Rank.AIRCRAFT, self.source)
        craft.epoch.hear(None if epoch is None else int(epoch), at, Rank.AIRCRAFT, self.source)
        craft.rehearsal.hear(entry.fields.get("rehearsal") is True, at, Rank.AIRCRAFT, self.source)
        if commander or phase == "on_load" or lease == "alone":
            craft.alarms.end("commander")
        else:
            craft.alarms.begin("commander", EVENTS["no_commander"], "no station commands", at)

    def _guard(self, craft: Aircraft, entry: Entry, at: float) -> None:
        state = entry.text.rpartition(" ")[2]
        if state not in _GUARDS:
            return
        craft.guard.hear(state, at, Rank.AIRCRAFT, self.source)
        if state in ("live", "disabled", "waiting"):
            craft.alarms.end("guard")
        else:
            craft.alarms.begin("guard", EVENTS["lost"], entry.text, at)

    @staticmethod
    def _link(craft: Aircraft, station: str, entry: Entry) -> None:
        contact, device, change = craft.contact(station), entry.word("link"), entry.word("change")
        if contact is None or device is None or change not in ("degraded", "restored"):
            return
        if device in contact.links or len(contact.links) < _MOST_LINKS:
            contact.links[device] = change == "restored"

    def _payload(self, craft: Aircraft, entry: Entry, at: float) -> None:
        kinds = entry.fields.get("kinds")
        for kind in kinds if isinstance(kinds, list) else ():
            if isinstance(kind, str) and kind in craft.payload:
                holder = entry.word("holder") or "no station"
                craft.payload[kind].hear(holder, at, Rank.AIRCRAFT, self.source)

    @staticmethod
    def _decision(craft: Aircraft, entry: Entry, at: float) -> None:
        action = _ACTIONS.get(entry.word("action") or "")
        if action is None or craft.rehearsal.value:
            craft.alarms.end("decision")
        else:
            craft.alarms.begin("decision", DECISIONS[action], entry.text, at)

    # ---- a station's ----------------------------------------------------------------------------------------------

    def _of_station(self, station: Station, entry: Entry, at: float, utc: float) -> None:
        station.source, station.ended = self.source, entry.event == "unloaded"
        craft = self._its_aircraft(station, entry)
        if craft is not None:
            self._about(craft, station, entry, at)
        told = craft is not None and craft.source is not None and craft.source.heard_at > at - HOLDS_S
        if entry.text and (entry.event in _ITS_OWN or (entry.event in EVENTS and not told)):
            level = EVENTS.get(entry.event, Level.INFO)
            self._scene.tell(utc, station.name, level, entry.text)

    def _its_aircraft(self, station: Station, entry: Entry) -> Aircraft | None:
        """The aircraft of an entry: the one that it names, or the only one that hears this station."""
        named = entry.word("vehicle")
        if named:
            return self._scene.craft(named)
        own = f"aircraft of {station.name}"
        hearing = [each for each in self._scene.aircraft.values() if station.name in each.contacts and each.name != own]
        if len(hearing) == 1:
            self._scene.aircraft.pop(own, None)  # its station's journal was found before its own
            return hearing[0]
        if own in self._scene.aircraft or "role" in entry.fields or entry.event == "telemetry":
            craft = self._scene.craft(own)
            if craft is not None:
                craft.contact(station.name)
            return craft
        return None

    def _about(self, craft: Aircraft, station: Station, entry: Entry, at: float) -> None:
        craft.heard_at = max(craft.heard_at, at) if entry.event == "telemetry" else craft.heard_at
        role, epoch = entry.word("role"), entry.number("epoch")
        if role == "commander":
            craft.commander.hear(station.name, at, Rank.STATION)
        elif role is not None and craft.commander.value == station.name:
            craft.commander.hear("", at, Rank.STATION)
        if epoch is not None:
            craft.epoch.hear(int(epoch), at, Rank.STATION)
        place = _place(entry)
        if entry.event == "telemetry" and place is not None:
            craft.zone.hear(entry.word("zone") or "", at, Rank.STATION)
            if craft.commander.rank is Rank.STATION and craft.commander.value == station.name:
                # a station that has lost control would have written that
                craft.commander.at = max(craft.commander.at, at)
            craft.moved(place, at, Rank.STATION)
        self._alarm(craft, station, entry, at)

    def _alarm(self, craft: Aircraft, station: Station, entry: Entry, at: float) -> None:
        alarms = craft.stations_alarms.get(station.name)
        if alarms is None:
            if craft.contact(station.name) is None:
                return
            alarms = craft.stations_alarms[station.name] = Alarms()
        if entry.event == "acknowledged":
            alarms.acknowledge()
        elif entry.event == "unloaded":
            craft.stations_alarms[station.name] = Alarms()
        elif entry.event in EVENTS:
            level = EVENTS[entry.event]
            if craft.source is None or STANDS.get(entry.event) not in _THE_AIRCRAFTS:
                alarms.on_line(entry.event, level, f"{station.name}: {entry.text}", at)
        if entry.event in ("set_up", "control_gained", "control_lost", "released"):
            alarms.end("question")
