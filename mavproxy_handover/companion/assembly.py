# SPDX-License-Identifier: GPL-3.0-or-later

"""All parts of a companion, constructed in the order in which they need each other."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.companion.actions import ActionParts, Actions
from mavproxy_handover.companion.autopilot_parts import Autopilot, assemble
from mavproxy_handover.companion.beacons import Beacons
from mavproxy_handover.companion.decision_news import DecisionNews
from mavproxy_handover.companion.edge import Edge
from mavproxy_handover.companion.fail_closed import FailClosed
from mavproxy_handover.companion.faults import FaultLog, FaultNews
from mavproxy_handover.companion.onboard_parts import OnboardParts, assemble_onboard
from mavproxy_handover.companion.operator_parts import OperatorParts, assemble_operator
from mavproxy_handover.companion.periodic import EachSecond
from mavproxy_handover.companion.restart import Restart
from mavproxy_handover.companion.state_saver import PackageSaver, StateSaver
from mavproxy_handover.config.running import Running
from mavproxy_handover.core.arbiter import Arbiter, Identity
from mavproxy_handover.core.authority.payload import PayloadAuthority, PayloadKind, PayloadRules, PayloadSettings
from mavproxy_handover.core.common.events import Event
from mavproxy_handover.core.remote_id import Operators
from mavproxy_handover.gate.feeds import FeedNews
from mavproxy_handover.gate.filters import CompanionMatters
from mavproxy_handover.gate.gate import Gate
from mavproxy_handover.gate.in_force import AuthorityInForce
from mavproxy_handover.gate.passed import GateSettings, PassedFrames
from mavproxy_handover.gate.replies import GateReports
from mavproxy_handover.gate.stale_streams import News
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.operator.base.context import Authority, Reports
from mavproxy_handover.operator.stations.announcer import Announcer
from mavproxy_handover.operator.stations.event_log import EventLog
from mavproxy_handover.operator.stations.missing_heartbeats import MissingHeartbeats
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.operator.stations.sender import MessageSender
from mavproxy_handover.operator.uploads.package_loading import MissionSurroundings
from mavproxy_handover.operator.vehicle.remote_id import RemoteId, RemoteIdSources
from mavproxy_handover.operator.vehicle.terrain_answers import TerrainAnswers
from mavproxy_handover.store.journal import Journal, strangers_path
from mavproxy_handover.store.state_store import StateStore
from mavproxy_handover.tools.schedule import attempt
from mavproxy_handover.wire.frames import Frame

__all__ = ["Base", "Hub", "Parts", "base_of", "parts_of"]

#: the size of the journal of frames that no station has signed, twice
_STRANGERS_BYTES: Final = 8 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class Base:
    """The parts that all others need."""

    journal: Journal
    #: the journal of frames that no station has signed
    strangers: Journal
    faults: FaultLog
    in_force: AuthorityInForce
    passed: PassedFrames
    message_sender: MessageSender
    restart: Restart
    arbiter: Arbiter
    event_log: EventLog
    packages: PackageSaver
    #: what stations say of their operators
    operators: Operators

    def close(self) -> None:
        """Close state and journals."""
        attempt(self.faults.report, "closing the state", self.restart.close)
        self.journal.close()
        self.strangers.close()


@dataclass(frozen=True, slots=True)
class Hub:
    """Calls of the companion itself that its parts need."""

    #: gives an event to the rules
    handle: Callable[[Event, float], None]
    #: ends authority, with what broke
    fail_closed: Callable[[str, float], None]
    #: sends a lease to the guard
    send_lease: Callable[[float], None]
    #: whether the aircraft is neither armed nor about to be, by the rules
    grounded: Callable[[float], bool]


@dataclass(frozen=True, slots=True)
class Parts:
    """The parts that the companion works with."""

    autopilot: Autopilot
    gate: Gate
    operator: OperatorParts
    onboard: OnboardParts
    news: DecisionNews
    beacons: Beacons
    closing: FailClosed
    actions: Actions
    faults: FaultNews
    each_second: EachSecond
    remote_id: RemoteId
    terrain: TerrainAnswers


def base_of(running: Running, ports: Mapping[int, StationPort], edge: Edge) -> Base:
    """Open the journals and construct the parts that all others need.

    Raises OSError: the journal cannot be written, and it is no restart.
    """
    config, strict = running.config, not running.restart
    journal = Journal(config.journal, config.name, strict=strict)
    strangers = Journal(strangers_path(config.journal), config.name, _STRANGERS_BYTES, strict=strict)
    faults = FaultLog(journal)
    in_force = AuthorityInForce()
    operators = Operators({entry.station.sysid: entry.operator_id for entry in config.stations if entry.operator_id})
    onboard = tuple(program.rights.component for program in config.onboard)
    settings = GateSettings(config.observers, config.feeds, operators, onboard, edge.budget)
    passed = PassedFrames(config.sysid, ports, settings, in_force, edge.write_autopilot, faults.report)

    def write_autopilot(data: bytes) -> None:
        edge.write_autopilot(data)
        passed.companion_sent(data, edge.clocks.monotonic())

    def not_kept(text: str) -> None:
        """Memory or disk does not take the state. That is no internal fault, and no flight ends by it."""
        event_log.kept_elsewhere(text)
        message_sender.say_to_all(text)

    message_sender = MessageSender(config.sysid, write_autopilot, ports, faults.report)
    store = None if config.state is None else StateStore(config.state, config.name)
    restart = Restart(store, faults.report, not_kept)
    identity = Identity(config.name, tuple(entry.station for entry in config.stations), config.parent, edge.nonce)
    arbiter = Arbiter(identity, config.limits, restart.restored)
    event_log = EventLog(
        config.name,
        journal,
        strangers,
        arbiter,
        lambda line: attempt(faults.report, "console", edge.show, line),
        lambda: in_force.view.phase,
    )
    return Base(
        journal,
        strangers,
        faults,
        in_force,
        passed,
        message_sender,
        restart,
        arbiter,
        event_log,
        PackageSaver(restart, journal),
        operators,
    )


def parts_of(running: Running, base: Base, edge: Edge, hub: Hub) -> Parts:
    """Construct the parts. Raises what their construction raises, and closes state and journals before."""
    config, now = running.config, edge.clocks.monotonic()
    message_sender, event_log, arbiter, fault = base.message_sender, base.event_log, base.arbiter, base.faults.report

    def close_mission_files() -> None:
        for station, closing in base.passed.close_mission_files():
            event_log.closed(station, closing)

    authority = Authority(arbiter, hub.handle, base.in_force.commands)
    reports = Reports(event_log, message_sender, fault)
    mission = MissionSurroundings(base.packages.save, close_mission_files, lambda: base.passed.list_open)
    try:
        autopilot = assemble(running, authority, reports, mission, edge.clocks, edge.nonce, edge.budget, edge.box)
    except Exception:
        base.close()
        raise
    announcer = Announcer(message_sender)
    payload = PayloadAuthority(
        lambda: _payload_settings(config.payload, autopilot.mission.flown.package),
        partial(_is_heard, message_sender, edge.clocks.monotonic),
    )

    def from_manager(frame: Frame, now: float) -> None:
        gate.from_manager(frame, now)

    onboard = assemble_onboard(
        config.sysid,
        edge.onboard,
        autopilot,
        base.in_force,
        payload,
        reports,
        lambda: announcer.action,
        edge.write_autopilot,
        edge.budget,
        from_manager,
    )
    matters = CompanionMatters(
        autopilot.command_check.target,
        lambda intent, station, now: autopilot.command_check.judge(message_sender.ports[station], intent, now).passes,
        autopilot.orders.takes_over,
        lambda: autopilot.aircraft.judged_by,
        onboard.delegating.commander_sends if onboard.delegating.possible else None,
        partial(_payload_station, payload, base),
        onboard.programs.managers,
        onboard.programs.to_manager,
    )
    gate = Gate(
        config.sysid,
        message_sender.ports,
        base.in_force,
        base.passed,
        edge.write_autopilot,
        _gate_reports(base),
        matters,
    )
    gate.distrust()
    gate.change(arbiter.view, now)
    operator = assemble_operator(
        config.sysid, authority, base.in_force, gate, autopilot, reports, announcer, onboard.delegating, payload
    )
    news = DecisionNews(event_log, announcer, operator.briefing, operator.rehearsal, fault)
    saver = StateSaver(base.restart, arbiter, autopilot, fault)
    beacons = Beacons(base.in_force, arbiter, autopilot, message_sender, now)
    faults = FaultNews(base.faults, message_sender)
    closing = FailClosed(gate, autopilot, event_log, news, fault)
    parts = ActionParts(
        arbiter, autopilot, message_sender, news, operator.control, operator.warnings, saver, beacons, faults, closing
    )
    actions = Actions(config.sysid, parts, hub.fail_closed, hub.send_lease, fault)
    heartbeats = MissingHeartbeats(message_sender)
    each_second = EachSecond(autopilot, beacons, news, saver, faults, heartbeats, onboard, hub.grounded)
    sources = RemoteIdSources(base.in_force, base.operators, lambda: autopilot.mission.flown.package, edge.clocks.utc)
    terrain = TerrainAnswers(config.sysid, sources.package, autopilot.aircraft, reports)
    remote_id = RemoteId(config.sysid, config.remote_id, sources, autopilot.aircraft, reports)
    return Parts(
        autopilot, gate, operator, onboard, news, beacons, closing, actions, faults, each_second, remote_id, terrain
    )


#: a station whose heartbeat is older (s) does not keep payload authority from others
_HEARD_S: Final = 5.0


def _is_heard(message_sender: MessageSender, clock: Callable[[], float], name: str) -> bool:
    """Whether the station of this name is heard."""
    return any(port.name == name and clock() - port.heartbeat_at < _HEARD_S for port in message_sender.ports.values())


def _payload_settings(vehicle: PayloadRules, package: MissionPackage | None) -> PayloadSettings:
    return PayloadSettings(vehicle) if package is None else PayloadSettings(vehicle, package.payload)


def _payload_station(payload: PayloadAuthority, base: Base, kind: PayloadKind) -> int | None:
    """The station (system id) that has this kind of payload; None: no station has."""
    commander = base.in_force.view.commander
    payload.authority_moved("" if commander is None else base.arbiter.name(commander))
    ports = base.message_sender.ports.values()
    return next((port.sysid for port in ports if port.name == payload.holder(kind)), None)


def _gate_reports(base: Base) -> GateReports:
    message_sender, event_log = base.message_sender, base.event_log

    def stream(news: News, now: float) -> None:
        event_log.stream(message_sender.ports[news.station].name, news, now)

    def say(station: int, text: str, now: float) -> None:
        port = message_sender.ports[station]
        event_log.told(port.name, text, now)
        message_sender.say(port, text)

    def feed(news: FeedNews, _now: float) -> None:
        event_log.feed(news)
        if news.station is None:
            message_sender.say_to_all(news.text, mavlink.MAV_SEVERITY_NOTICE)
        else:
            message_sender.say(message_sender.ports[news.station], news.text)

    return GateReports(base.faults.report, stream, say, feed)
