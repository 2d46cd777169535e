# SPDX-License-Identifier: GPL-3.0-or-later

"""The front of this wing: the autopilot, as the rest of the companion knows it.

What it says is taken in here: the state of the aircraft, and events for the arbiter made of it. What the companion
wants of it goes through here: leases, orders, missions, the checks before flight. The parts that do all this are built
here and known nowhere else.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.autopilot.authority import Authority
from mavproxy_handover.autopilot.command_desk import CommandDesk
from mavproxy_handover.autopilot.copter import Copter
from mavproxy_handover.autopilot.flown_mission import FlownMission, MissionMonitors, MissionUsers
from mavproxy_handover.autopilot.ground_uploads import GroundUploads
from mavproxy_handover.autopilot.guard import Guard
from mavproxy_handover.autopilot.guard_link import GuardLink
from mavproxy_handover.autopilot.package_loading import (
    Along,
    MissionLoader,
    MissionSurroundings,
    MissionWriter,
    Prepared,
    Way,
    way_of,
)
from mavproxy_handover.autopilot.orders import Orders
from mavproxy_handover.autopilot.package_standing import PackageStanding
from mavproxy_handover.autopilot.plane import Plane
from mavproxy_handover.autopilot.preflight import Preflight
from mavproxy_handover.autopilot.procedures import Procedures
from mavproxy_handover.autopilot.read_back import ReadBack
from mavproxy_handover.autopilot.reports import Reports
from mavproxy_handover.autopilot.return_site import ReturnSite
from mavproxy_handover.autopilot.staging import Staging
from mavproxy_handover.autopilot.streams import Streams
from mavproxy_handover.autopilot.telemetry import Telemetry
from mavproxy_handover.autopilot.teller import MonitorOutput, Teller
from mavproxy_handover.clocks import Clocks
from mavproxy_handover.config.running import Running
from mavproxy_handover.core.events import AutopilotState, PositionSeen
from mavproxy_handover.core.model import AuthorityView, Flown, Phase, ZoneFact
from mavproxy_handover.core.safety.battery import PackMemory
from mavproxy_handover.core.safety.energy import EnergyFact
from mavproxy_handover.gate.list_changes import ListChange
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.walk import speed_at
from mavproxy_handover.monitors.borders import BorderMonitor
from mavproxy_handover.monitors.energy import EnergyMonitor
from mavproxy_handover.monitors.execution import ExecutionMonitor
from mavproxy_handover.monitors.gaps import GapMonitor
from mavproxy_handover.monitors.position.source import Box, PositionMonitor
from mavproxy_handover.monitors.preflight.plan_fit import PlanFitMonitor, not_as_checked
from mavproxy_handover.monitors.preflight.rules import Finding
from mavproxy_handover.monitors.reboots import RebootMonitor
from mavproxy_handover.monitors.route import RouteMonitor
from mavproxy_handover.monitors.signs import SignMonitor
from mavproxy_handover.monitors.waypoints import WaypointMonitor
from mavproxy_handover.schedule import attempt
from mavproxy_handover.stations.port import StationPort
from mavproxy_handover.vehicle.kinds import COPTER, PLANE
from mavproxy_handover.vehicle.state import VehicleState
from mavproxy_handover.wire.conversation import Asking, Conversation, Conversations
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import COMPANION_COMPID, EVERYBODY
from mavproxy_handover.wire.status import LeaseSequence

__all__ = ["Autopilot"]

#: name of a conversation
_HELD: Final = "held"
#: a restart in flight is over by then (s): what takes the processor a while has waited for that
_WALK_S: Final = 10.0
#: what an older heartbeat has said of arming and of the mode does not count
_HEARTBEAT_S: Final = 2.5
#: what operators read; a STATUSTEXT has 50 bytes
_RESTARTED: Final = "Autopilot restarted in flight. Check the aircraft."
#: a position that has waited for longer, because the main loop stood still, does not count: another is on its way
_OLD_S: Final = 0.2


class Autopilot:
    """The autopilot of the vehicle of a configuration. Times are monotonic seconds."""

    def __init__(
        self,
        running: Running,
        authority: Authority,
        reports: Reports,
        around: MissionSurroundings,
        clocks: Clocks,
        nonce: int,
        box: Box | None = None,
    ) -> None:
        """`nonce`: of this run's leases, never 0; `box`: the position box, where there is one."""
        config = running.config
        self.aircraft = VehicleState()
        #: whose word of where it is counts
        self.positions = PositionMonitor(config.position, self.aircraft, box)
        self._sysid = config.sysid
        self._authority = authority
        self._reports = reports
        self._teller = Teller(authority.handle, reports)
        self._on_board = running.mission
        key = running.guard_key
        leases = LeaseSequence(nonce, key)
        link = GuardLink(config.sysid, key, leases)
        self.guard = Guard(config.sysid, self.aircraft, leases, link, reports, clocks.monotonic)
        #: those with the autopilot that are going on
        talks = self.conversations = Conversations(reports.voice.to_autopilot, reports.fault)
        to_whom = config.sysid, lambda: self.aircraft.telemetry.text
        self._procedures = {
            COPTER: Copter(*to_whom, lambda: self.aircraft.foreign),
            PLANE: Plane(*to_whom, self.aircraft),
        }
        self._preflight = Preflight(
            config.sysid, self.aircraft, config.limits, talks, reports.narrator.preflight, config.energy
        )
        self._streams = Streams(self.procedures, reports.voice.ask_rates)
        #: before a flight begins: whether the autopilot still holds its mission
        self.read_back = ReadBack(talks, self._compare, self._changed_past)
        self.orders = Orders(self.procedures, talks, authority, reports, self.read_back.asking, self._changed_past)
        self._telemetry = Telemetry(
            self.aircraft, authority.arbiter.zones, reports, clocks.utc, config.limits.position_stale_s
        )
        self._energy = EnergyMonitor(config.energy, reports.fault)
        self._loader = MissionLoader(config, self._adopted)
        #: the aircraft against its route
        self.route = RouteMonitor(config.route)
        self._gaps = GapMonitor(config.limits)
        self._waypoints = WaypointMonitor(config.limits.leave_margin_m)
        self._borders = BorderMonitor(config.limits.operator_timeout_s)
        self._execution = ExecutionMonitor(lambda: self.places.goes_to)
        #: where a return goes
        self.places = ReturnSite(
            config.sysid, self.aircraft, lambda: self._energy.fact, self.orders, talks, authority, reports
        )
        standing = self._standing = PackageStanding(self._on_board is not None, authority.handle, reports)
        #: the commander's commands in flight, judged by the situation
        self.desk = CommandDesk(
            config.commands,
            self.aircraft,
            self._energy,
            self.places.candidates,
            authority,
            reports,
            self._teller,
            config.limits.position_stale_s,
        )
        fit = PlanFitMonitor()
        compared = MissionMonitors(self._waypoints, self._gaps, self._borders, self.route, fit, self._energy)
        users = MissionUsers(self._loader, self._preflight, self.places, self.desk, self.read_back)
        #: what it holds to fly
        self.flown = FlownMission(self.aircraft, authority, self._teller, compared, users)
        #: what stations write to the autopilot on the ground
        self._uploads = GroundUploads(
            self.desk,
            self.procedures,
            talks,
            authority,
            reports,
            lambda: self._missions.latest or self._on_board,
            self._fly_upload,
            standing,
            around.list_open,
        )
        self._missions = MissionWriter(
            self._loader,
            self.procedures,
            talks,
            authority,
            reports,
            self.flown.by_package,
            self.places.candidates.first_point,
            standing,
            self._uploads.forget,
            around,
        )
        #: and what it uploads then
        self.staging = Staging(
            self.desk,
            self.procedures,
            talks,
            authority,
            reports,
            lambda: self._loader.package,
            lambda facts: not_as_checked(facts, self.aircraft),
            self.flown.reroute,
        )
        self._heed: dict[str, Callable[[Any, float], None]] = {
            "HEARTBEAT": self._on_state,
            "EXTENDED_SYS_STATE": self._on_state,
            "GLOBAL_POSITION_INT": self._on_position,
            "TUNNEL": self._on_tunnel,
            "STATUSTEXT": self._on_text,
            "PARAM_VALUE": self.places.take,
            **dict.fromkeys(("BATTERY_STATUS", "WIND"), self._on_energy),
            "MISSION_ITEM_REACHED": self._on_reached,
            "HOME_POSITION": self.places.take,
        }
        self._signs = SignMonitor(
            lambda: self.places.energy_words if self.places.short else None,
            lambda: self.route.deviation,
            reports.fault,
        )
        self._second_manager_told = False
        self._reboots = RebootMonitor()
        #: after a restart: walks the route once more, beside the main loop, and when
        self._walk: Callable[[float], None] = lambda _now: None
        self._walk_at = math.inf

    # ---- what others may look at ----------------------------------------------------------------------------------

    @property
    def findings(self) -> tuple[Finding, ...] | None:
        """What does not fit, of guard, parameters and firmware; None before they were read."""
        return self._preflight.findings

    @property
    def energy(self) -> EnergyFact:
        """What is left, what flying costs, and what is odd about it; made anew each second."""
        return self._energy.fact

    @property
    def packs(self) -> tuple[PackMemory, ...]:
        """What a run after this one needs to know of the batteries; empty on the ground."""
        return self._energy.memory

    @property
    def package(self) -> MissionPackage | None:
        """The mission package that the autopilot holds; None: none is known."""
        return self._loader.package

    @property
    def kept(self) -> tuple[bool, bytes]:
        """Whether the autopilot holds a mission that a station wrote on the ground, and the digest of the package by
        which it is judged; empty: there is none."""
        package = self._missions.latest
        kept = self._standing.kept
        return kept, package.digest if kept and package is not None else b""

    def procedures(self) -> Procedures:
        """What there is to ask an autopilot of its kind."""
        return self._procedures[self.aircraft.vehicle]

    def zone_facts(self) -> tuple[ZoneFact, ...]:
        """Facts about every zone at the last position; none before there are mission and position."""
        finder, where = self._loader.finder, self.aircraft.where
        if finder is None or where is None:
            return ()
        lat_deg, lon_deg, alt_m = where
        way = self._loader.way(self.aircraft.waypoint, where[:2]) if self.aircraft.flies_mission else ()
        course_deg, speed_mps = self.aircraft.track
        if self.aircraft.kind.winged and self.aircraft.flown is Flown.STOP:
            speed_mps = 0.0  # it circles: its track leads nowhere
        facts = finder.facts(lat_deg, lon_deg, course_deg, speed_mps, alt_m, way)
        return self._waypoints.marked(self.aircraft, facts)

    # ---- what it says ---------------------------------------------------------------------------------------------

    def take(self, message: Any, now: float) -> None:
        """A message of the autopilot itself."""
        aircraft, narrator = self.aircraft, self._reports.narrator
        if self._reboots.seen(message, aircraft.flying, now):
            self._tell_restart(now)
        waypoint, mode, known = aircraft.waypoint, aircraft.custom_mode, aircraft.telemetry.heartbeat.at > -math.inf
        on_mission = aircraft.flies_mission
        aircraft.take(message, now)
        if self.conversations and _for_companion(message, self._sysid):
            self.conversations.on_message(message, now)
        if aircraft.custom_mode != mode:
            narrator.mode(aircraft.vehicle.mode_name(aircraft.custom_mode))
            if known:
                self.orders.mode_changed()
                self.desk.mode_changed()
        if known and aircraft.flies_mission is not on_mission:
            self._mission_flown(now)
        if known and aircraft.custom_mode != mode:
            self._keeps_speed(now)  # after that call, which forgets the speed of the mission
        if aircraft.waypoint != waypoint:
            narrator.waypoint(aircraft.waypoint)
            self._waypoints.flies_on()
        heed = self._heed.get(message.get_type())
        if heed is not None:
            heed(message, now)

    def _tell_restart(self, now: float) -> None:
        """The autopilot has started again. In flight the operators have to know: it may say that it is disarmed."""
        self.places.autopilot_restarted(now)
        if self._reboots.in_flight(now):
            self._reports.narrator.autopilot_restarted(_RESTARTED)
            self._reports.voice.say_to_all(_RESTARTED, mavlink.MAV_SEVERITY_CRITICAL)
        else:
            self._reports.narrator.autopilot_restarted("the autopilot has started again")

    def second_manager(self, frame: Frame) -> None:
        """CONTROL_STATUS of somebody else on board: people have to know, the stations do not hear it (`gate`)."""
        manager = bool(frame.payload[0] & mavlink.GCS_CONTROL_STATUS_FLAGS_SYSTEM_MANAGER)
        if manager and not self._second_manager_told:
            self._second_manager_told = True
            self._reports.narrator.second_manager(frame.compid)

    def check_zones(self, now: float) -> None:
        """Tell the arbiter where the last position is with respect to every zone."""
        self.aircraft.compared()
        if now - self.aircraft.position.at > _OLD_S:
            return
        if self.aircraft.dead_reckoning and not self.positions.by_box:
            return
        self._authority.handle(PositionSeen(self.zone_facts(), self._gaps.fact(self.aircraft)), now)
        self._attempt("route", self._look, self.route.update, now)

    def _mission_flown(self, now: float) -> None:
        """It flies its mission, or does so no more.

        In AUTO again, in flight, it has forgotten what a DO_CHANGE_SPEED had set before the aircraft left it.
        """
        aircraft, route = self.aircraft, self.flown.route
        resumes = aircraft.flies_mission and aircraft.flying and not aircraft.foreign
        speed_mps = speed_at(route, aircraft.waypoint) if resumes and route is not None else None
        self.orders.resume_speed(speed_mps, now)

    def _keeps_speed(self, now: float) -> None:
        """A copter has begun to return. A speed of its commander's that passed just before may have come later."""
        if self.aircraft.to_place and not self.aircraft.kind.winged and self.desk.sped_lately(now):
            self.orders.resume_speed(self.places.candidates.return_mps, now)

    def _on_state(self, message: Any, now: float) -> None:
        aircraft = self.aircraft
        self._attempt("places of a return", self.places.take, message, now)
        # without a heartbeat of late nothing is known of arming and of the mode: what was before need not be so
        if now - aircraft.telemetry.heartbeat.at < _HEARTBEAT_S:
            # first: what is flown by now need not be commanded
            self._attempt("motion", self._look, self._execution.heard, now)
            self._authority.handle(self._autopilot_state(), now)

    def _autopilot_state(self) -> AutopilotState:
        aircraft = self.aircraft
        is_one = aircraft.armed, aircraft.flying, aircraft.foreign
        room = (aircraft.circles_s, aircraft.circle_m) if aircraft.flying else (0.0, 0.0)
        return AutopilotState(*is_one, aircraft.kind, *room)

    def _on_text(self, message: Any, now: float) -> None:
        self._preflight.text(message.text)
        self._teller.tell(self._execution.text(self.aircraft, message.text), now)

    def _on_position(self, _message: Any, now: float) -> None:
        if self.aircraft.telemetry.own_position.at == now:  # else that message held no position
            self._streams.position_seen()

    def look_at_box(self, now: float) -> None:
        """Read the position box, if there is one; to be called often."""
        self._look(self.positions.read, now)

    def _on_tunnel(self, message: Any, now: float) -> None:
        found, status = self.guard.take(message, now)
        self._teller.tell(found, now)
        if status is not None:
            self._teller.tell(self._execution.guard(status), now)

    def _on_energy(self, message: Any, now: float) -> None:
        aircraft = self.aircraft  # before its first heartbeat nothing is known of arming
        self._energy.take(message, now, on_ground=not aircraft.armed and aircraft.telemetry.heartbeat.at > -math.inf)

    def _adopted(self, package: MissionPackage, way: Way, now: float) -> None:
        self._teller.tell(self._energy.adopt(package.energy, way, now, wings=package.kind.winged), now)

    def _on_reached(self, message: Any, _now: float) -> None:
        owner = self._waypoints.reached(self.aircraft, message.seq)
        delivery = self._loader.delivery.reached(message.seq)
        self._reports.narrator.reached(message.seq, owner, delivery)
        if delivery is not None:
            text = f"delivery point reached, waypoint {delivery}"
            self._reports.voice.say_to_all(text, mavlink.MAV_SEVERITY_NOTICE)

    def tell_landed(self) -> None:
        """The flight is over: every station hears it."""
        on_ground = self.aircraft.telemetry.landed.state == mavlink.MAV_LANDED_STATE_ON_GROUND
        text = f"{'landed' if on_ground else 'disarmed'}: the flight is over"
        self._reports.voice.say_to_all(text, mavlink.MAV_SEVERITY_NOTICE)

    # ---- what is wanted of it -------------------------------------------------------------------------------------

    def adopt(self, package: MissionPackage, now: float) -> None:
        """The autopilot holds this mission since the run before; who commands along its route is known from there.

        Unless a station has sent another one: it is read back, and where it differs it is read whole when the restart
        is over.
        What lies along its route is found anew: gaps at once, the borders of zones when the restart is over.
        """
        self._missions.latest = package
        self._loader.adopt(package, package.zone_finder(), way_of(package), now)
        self.flown.by_package(package, Along(), now)

        def found(along: Along) -> None:
            if self.flown.route is package.route:
                self.flown.lies_along(along)

        self._walk = lambda _now: self._missions.walk_along(package, found)
        self._walk_at = now if package.gaps else now + _WALK_S

        def done(talk: Conversation, now: float) -> None:
            if talk.result:
                self.flown.reroute(None, now)
                self._walk, self._walk_at = self.staging.found, now + _WALK_S

        asking = self.procedures().holds_another(package.route.upload_items())
        self.conversations.begin(_HELD, asking, done, now)

    def resume(self, packs: Sequence[PackMemory], now: float) -> None:
        """What the run before knew of the batteries; behind `adopt`."""
        self._energy.resume(packs, now)

    def keep_upload(self, package: MissionPackage | None, now: float) -> None:
        """In the run before, a station wrote the mission that the autopilot holds. On the ground it is judged anew, by
        the zones of that package, None: of the one on board."""
        self._standing.kept = True
        if self._missions.latest is None:
            self._missions.latest = package
        if self._authority.arbiter.view.phase is Phase.ON_LOAD:
            self._uploads.found(now)

    def holds(self, prepared: Prepared, now: float) -> None:
        """The same where the autopilot cannot be asked, and the walk is done: in the replay of a recording."""
        self._loader.adopt(prepared.package, prepared.finder, prepared.way, now)
        self.flown.by_package(prepared.package, prepared.along, now)

    def drop_mission(self, now: float) -> None:
        """What the autopilot holds is not known any more: in the replay of a recording."""
        self._missions.drop(now)

    def list_changed(self, port: StationPort, change: ListChange, on_ground: bool, now: float) -> None:
        """A station's message that changes the mission or the geofence goes to the autopilot.

        Other than on the ground (in a rehearsal) the package counts until the end of the phase, as after an upload in
        flight.
        """
        if on_ground:
            why = f"{port.name} changed the {change.what}"
            self._attempt("end of START", self.orders.give_start_up, why, now)
            self._missions.list_changed(port, change, now)
            self._uploads.changed(port, change, now)
        else:
            self.flown.reroute(None, now)

    def _compare(self) -> Asking | None:
        """The asking that sees whether the autopilot holds what counts; None: nothing does."""
        return None if self.flown.route is None else self.procedures().holds(self.flown.route)

    def _changed_past(self, how: str, now: float) -> None:
        """On the ground the autopilot holds another mission or geofence than it did."""
        self._missions.changed_past(how, now)

    def _fly_upload(self, prepared: Prepared, other: bool, now: float) -> None:
        """The autopilot holds a mission that a station wrote on the ground and that was judged; `other`: than the
        package's. Rally points that a station has sent stay."""
        self.flown.by_package(prepared.package, prepared.along, now, uploaded=other)
        self._missions.fly(prepared, now)

    def authority_moved(self, now: float) -> None:
        """Somebody else commands, or nobody."""
        self.desk.authority_moved()
        self.staging.authority_moved(now)

    def on_package(self, port: StationPort, message: Any, now: float) -> None:
        """A message of a mission package. Only the commander's is taken, on the ground."""
        held = b"" if self.flown.changed else self._authority.arbiter.mission_digest
        self._missions.on_message(port, message, held, now)

    def renew_streams(self) -> None:
        """Whoever had set the rates of telemetry commands no more."""
        self._streams.renew()

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        self._attempt("conversations", self.conversations.tick, now)
        if self.flown.unjudged:
            self._attempt("the plan", self.flown.judge, now)
        self._attempt("mission packages", self._missions.tick, now)
        self._attempt("places of a return", self.places.tick, now)
        self._attempt("mission read back", self.read_back.tick, now)
        self._attempt("uploads in flight", self.staging.tick, now)
        self._attempt("uploads on the ground", self._uploads.tick, now)

    def each_second(self, view: AuthorityView, grounded: bool, now: float) -> None:
        """Telemetry, streams that are missing, the mission on board, the checks before flight, and what the aircraft is
        judged by; `view`: in force, `grounded`: neither armed nor about to be. What breaks in one of these is that
        one's alone."""
        aircraft = self.aircraft
        for where, job, *arguments in (
            ("positions", self._look, self.positions.update, now),
            ("telemetry", self._telemetry.each_second, view, now),
            ("streams", self._streams.each_second, aircraft, now),
            ("the mission on board", self._load_on_board, grounded, now),
            ("preflight", self._check, grounded, now),
            ("energy", self._watch_energy, grounded, now),
            ("the plan", self.flown.judge, now),
            ("the way ahead", self._look_ahead, now),
            ("places of a return", self.places.each_second, now),
            ("motion", self._look, self._execution.update, now),
            ("signs", self._look, self._signs.update, now),
        ):
            self._attempt(where, job, *arguments)

    def _look(self, update: Callable[[VehicleState, float], Sequence[MonitorOutput]], now: float) -> None:
        """Hand on what a monitor finds in the state now."""
        self._teller.tell(update(self.aircraft, now), now)

    def _attempt(self, where: str, job: Callable[..., None], *arguments: Any) -> None:
        attempt(self._reports.fault, where, job, *arguments)

    def _load_on_board(self, grounded: bool, now: float) -> None:
        if self.flown.changed_aloft and grounded:
            self._missions.flight_over(now)
            if self._standing.kept:
                self._uploads.found(now)
        if self._on_board is not None and grounded and self.aircraft.position.value is not None:
            self._missions.load_on_board(self._on_board, now)

    def _check(self, grounded: bool, now: float) -> None:
        firmware = None if self.guard.status is None else self.guard.status.firmware
        asked = grounded or self.aircraft.always_armed
        misfit = self.guard.problem(now)
        self._preflight.each_second(asked, self._authority.arbiter.guard(now), firmware, now, misfit)

    def _watch_energy(self, grounded: bool, now: float) -> None:
        self._teller.tell(self._energy.update(self.aircraft, now, grounded=grounded), now)

    def _look_ahead(self, now: float) -> None:
        if now >= self._walk_at:
            self._walk_at = math.inf
            self._walk(now)
        self._look(self._borders.update, now)


def _for_companion(message: Any, sysid: int) -> bool:
    """Whether a message is for the companion, among others at least."""
    system, component = getattr(message, "target_system", EVERYBODY), getattr(message, "target_component", EVERYBODY)
    return system in (EVERYBODY, sysid) and component in (EVERYBODY, COMPANION_COMPID)
