# SPDX-License-Identifier: GPL-3.0-or-later

"""`module load handover_gcs`: the MAVProxy module of a ground station.

It connects MAVProxy's callbacks, the ground link and the operator's commands with the vehicles (`aircraft.py`). It
decides nothing. A fault in one vehicle's part does not affect another vehicle.
"""

from __future__ import annotations

import itertools
import sys
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from MAVProxy.modules.lib import mp_module, mp_util
from pymavlink.dialects.v20 import handover as mavlink

from gcs_module.aircraft import Aircraft
from gcs_module.alarms import Level
from gcs_module.banner import Situation
from gcs_module.closing import Closing
from gcs_module.console_rows import ConsoleRows
from gcs_module.core import Notice, PeerHeard, Role
from gcs_module.duty import Duty
from gcs_module.duty_commands import DutyCommands
from gcs_module.duty_file import DutyFile, signed_off
from gcs_module.event_log import StationEventLog
from gcs_module.fleet import FleetCommands, our_settings
from gcs_module.interrupts import Interrupts
from gcs_module.links import Links
from gcs_module.menu import Menu
from gcs_module.panel.collect import Collector
from gcs_module.panel.endpoint import EndpointError, open_endpoint
from gcs_module.panel.orders import Order, Reply, carry_out
from gcs_module.panel.publisher import Publisher
from gcs_module.peer_operators import PeerOperators, operator_message
from gcs_module.served_program import ServedProgram
from gcs_module.serving import Serving
from gcs_module.station_resources import StationResources
from gcs_module.terminal.lines import ConsoleLines
from gcs_module.terminal.look import Craft, status
from gcs_module.terminal.terminal import Terminal
from gcs_module.vehicle_selection import VehicleSelection
from gcs_module.view import alert, plain_line
from gcs_module.window_title import WindowTitles
from gcs_module.window_watchdog import WindowWatchdog
from mavproxy_handover.companion.hosting import SharedLog, guarded, why
from mavproxy_handover.config.files import (
    ConfigError,
    StationConfig,
    find_station_config,
    load_station,
    path_argument,
)
from mavproxy_handover.config.served import parse_served
from mavproxy_handover.link.devices import Device
from mavproxy_handover.link.forms import parse_device
from mavproxy_handover.supervision.must_load import loaded, refused
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.tools.version import VERSION
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame, parse_one
from mavproxy_handover.wire.ids import OUR_MESSAGES
from mavproxy_handover.wire.package_transfer import refusal

__all__ = ["HandoverGcsModule", "init"]

#: arguments of the last load, for `module reload handover_gcs`
_last: dict[str, str] = {}
#: our first status row in MAVProxy's console
_ROW = 6
#: Time between two turns (s) of the vehicles' own work. MAVProxy's main loop runs once for each frame: work for all
#: vehicles in each round would grow with the square of their number. MAVProxy's loop waits as long when nothing
#: arrives.
_TURN_S = 0.01


class HandoverGcsModule(mp_module.MPModule):
    """The station's side of authority handover."""

    def __init__(
        self,
        mpstate: Any,
        config: StationConfig,
        resources: StationResources,
    ) -> None:
        super().__init__(
            mpstate, "handover_gcs", "authority handover (ground station)", public=True, multi_vehicle=True
        )
        self.config = config
        self.faults: Counter[str] = Counter()
        self.journal = resources.journal
        self.peer_operators = PeerOperators(tuple(peer.station.sysid for peer in config.peers))
        self.settings_of_ours = our_settings()
        self.duty = Duty(config.require_operator)
        self.event_log = StationEventLog(resources.journal, self._tell)
        self.address_questions = itertools.count(1)
        self.links = Links(mpstate, config.vehicles, self._on_link_fault, self.faults)
        self.aircraft = tuple(
            Aircraft(self, vehicle, of_vehicle, _ROW + number)
            for number, (vehicle, of_vehicle) in enumerate(zip(config.vehicles, resources.vehicles, strict=True))
        )
        self._by_sysid = {aircraft.sysid: aircraft for aircraft in self.aircraft}
        self._ground = ground = resources.ground
        self._own = mavlink.MAVLink(None, srcSystem=config.station.sysid, srcComponent=self.settings.source_component)
        self._each_second_at = 0.0
        self._turn_at = 0.0
        self._shared_log = SharedLog(mpstate, self._show)
        self.selection = VehicleSelection(mpstate, config.vehicles, self._on_selection, self._show)
        self.menu = Menu(mpstate, [peer.station.name for peer in config.peers], self.fault)
        self._rows = ConsoleRows(lambda: mpstate.console, self.now, self._why_old)
        self.terminal = Terminal(mpstate, self._chosen_situation, self.fault)
        shows_all = partial(self.settings_of_ours.get, "mavproxy_lines")
        self._lines = ConsoleLines(lambda: mpstate.console, self.now, shows_all, self.terminal.painted)
        self._windows = WindowWatchdog(self.fault)
        self._titles = WindowTitles(mpstate, config.station.name, self._vehicle_names, self.fault)
        #: the thread of the main loop, and commands that came by another thread: MAVProxy's console has one for its
        #: menus
        self._thread = threading.get_ident()
        self._typed: deque[list[str]] = deque()
        self._duty_file = DutyFile(config.path, config.station.name)
        self._duty_commands = duty = DutyCommands(
            self.duty, self.aircraft, self.event_log, self._show, self._on_hand, self._duty_file
        )
        self.commands = FleetCommands(
            self.aircraft, self.selection, self.settings_of_ours, self._show, self.faults, duty
        )
        self.add_command(
            "handover", self._command, "authority handover, this station ('handover help')", self.commands.completions()
        )
        self.add_completion_function("(HANDOVERSETTING)", self.settings_of_ours.completion)
        if ground.listening is not None:
            mpstate.select_extra[ground.listening] = (self._readable, None)
        for link in self._links():
            mp_util.child_fd_list_add(link.fileno())  # else a map's process would keep the port after `unload`
        self.event_log.loaded(VERSION, str(config.path))
        names = ", ".join(vehicle.called for vehicle in config.vehicles)
        self._show(f"handover_gcs {VERSION}: {config.station.name}, {names}, configuration {config.path}")
        if ground.peers and not ground.signed:
            self.event_log.ground_open()
        elif ground.note:
            self.event_log.replay_state(ground.note)
        self._tell_duty()
        self._kept_source_system = self.settings.source_system
        self._kept_name = getattr(self.settings, "vehicle_name", None)
        if self.settings.source_system != config.station.sysid:
            text = f"source_system is {self.settings.source_system}: set to {config.station.sysid}."
            self._tell(text, Level.ADVISORY)
            self.settings.source_system = config.station.sysid
        self._served = self._serve(resources.served)
        try:
            self._set_up_links()
        except Exception:
            self._restore_links()
            if self._served is not None:
                self._served.release()
            raise
        if self._served is not None:
            self._served.begin(self.now())
        self._panel = self._open_panel()
        self.closing = Closing(self.aircraft, self.event_log.closing)
        self._interrupts = Interrupts(mpstate, self.closing, self.now)
        if "exit" not in mpstate.command_map:
            self.add_command("exit", lambda _args: self._interrupts.on_exit(), "end this station")
        self._interrupts.install()
        self.terminal.install()

    def _tell_duty(self) -> None:
        """Say that a restart has signed the operator off, or that the station is unmanned."""
        before = self._duty_file.before()
        if before:
            self.event_log.signed_off(signed_off(before), before, required=self.duty.required)
        elif not self.duty.manned:
            self.event_log.unmanned()

    def _set_up_links(self) -> None:
        if self.links.several:
            self.selection.install()
            self._choose(self.selection.sysid)
        self.links.refresh()
        for aircraft in self.aircraft:
            aircraft.begin()

    def _serve(self, opened: Device | None) -> Serving | None:
        """The program that flies through this station; None: there is none."""
        if opened is None or self.config.serve is None:
            return None
        program = ServedProgram(opened, self.config.station.sysid, tuple(self._by_sysid), self._on_link_fault)
        return Serving(self.mpstate, self.config.serve, program, self.aircraft)

    def _open_panel(self) -> Publisher | None:
        """Let `handover panel` connect. Without its socket the station works as well."""
        try:
            endpoint = open_endpoint(self.config.station.name)
        except EndpointError as error:
            self._show(f"No panel can connect: {error}")
            return None
        collector = Collector(self)
        return Publisher(
            endpoint,
            collector.snapshot,
            collector.missions,
            self._on_order,
            mp_util.child_fd_list_add,
            mp_util.child_fd_list_remove,
        )

    def _restore_links(self) -> None:
        for aircraft in self.aircraft:
            aircraft.release()
        self.links.release()
        self.selection.restore()

    # ---- MAVProxy's callbacks, all wrapped ------------------------------------------------------------------------

    def idle_task(self) -> None:
        """Called by MAVProxy in every round of its main loop."""
        self._guarded("idle", self._idle)

    def mavlink_packet(self, m: Any) -> None:
        """A message of the vehicle."""
        self._guarded("message of the vehicle", lambda: self._on_packet(m))

    def _readable(self, _unused: Any) -> None:
        self._guarded("ground link", self._read_ground)

    def _command(self, args: list[str]) -> None:
        if threading.get_ident() != self._thread:
            self._typed.append(list(args))
            return
        self._guarded("command", lambda: self.commands.run(args), "handover: internal fault, see the journal")

    def _on_order(self, order: Order) -> Reply:
        """An order of the panel."""
        found = Reply(order.number, False, "Not used: internal fault, see the station's journal.")

        def run() -> None:
            nonlocal found
            self.event_log.panel(order.do, order.argument)
            found = carry_out(
                order, self.aircraft, [peer.station.name for peer in self.config.peers], self._duty_commands
            )

        self._guarded("panel", run)
        return found

    def unload(self) -> None:
        """Restore everything: sockets, commands, settings, signing."""
        self._interrupts.restore()
        if self._panel is not None:
            self._guarded("panel", self._panel.close)
        self._guarded("menu", self.menu.remove)
        self._guarded("console rows", self._rows.release)
        self._guarded("lines", self._lines.release)
        self._guarded("terminal", self.terminal.restore)
        self._guarded("windows", self._windows.close)
        self._restore_links()
        self.mpstate.select_extra.pop(self._ground.listening, None)
        for link in self._links():
            mp_util.child_fd_list_remove(link.fileno())
        self._ground.close()
        if self._served is not None:
            self._guarded("served program", self._served.release)
        self.remove_command("handover")
        self.mpstate.command_map.pop("exit", None)
        self.mpstate.completion_functions.pop("(HANDOVERSETTING)", None)
        self.mpstate.public_modules.pop("handover_gcs", None)
        self.settings.source_system = self._kept_source_system
        if self._kept_name is not None:
            self.settings.vehicle_name = self._kept_name
        self.event_log.unloaded()

    def _on_hand(self) -> str:
        """Names of the aircraft in flight that this station commands, or is about to command; "" if there is none."""
        return " and ".join(
            aircraft.core.vehicle_name
            for aircraft in self.aircraft
            if aircraft.state.flown_from_here or aircraft.core.role is Role.PARTNER
        )

    def _links(self) -> list[Device]:
        return self._ground.devices

    def _guarded(self, where: str, job: Callable[[], None], line: str = "") -> None:
        """Run `job`; an exception is counted and journalled, and `line` is shown."""
        guarded(where, job, self.fault, partial(self._show, line) if line else None)

    # ---- what the vehicles' parts need ----------------------------------------------------------------------------

    @staticmethod
    def now() -> float:
        """Monotonic time (s)."""
        return time.monotonic()

    def fault(self, where: str, text: str) -> None:
        """Count and journal an internal fault, ten of each kind at most."""
        self.faults[where] += 1
        if self.faults[where] <= 10:
            self.event_log.fault(where, text)

    def speak(self, text: str) -> None:
        """Say a text by MAVProxy's speech module, if it is loaded."""
        if any(module.name == "speech" for module, _package in self.mpstate.modules):
            self.say(text)

    @staticmethod
    def ring(bell: str) -> None:
        """Ring the terminal's bell: the console's window has none."""
        sys.stdout.write(bell)
        sys.stdout.flush()

    def chosen(self, sysid: int) -> bool:
        """Whether MAVProxy's own lines and commands are about this vehicle."""
        return not self.links.several or self.selection.sysid in (0, sysid)

    def to_peer(self, peer: int, message: Any, vehicle: int) -> None:
        """Send a MAVLink message about a vehicle to another station."""
        if peer in self._ground.peers:
            if message.get_type().startswith("MISSION_"):
                message.vehicle = vehicle
            self._ground.write(peer, codec.pack(message, self._own))

    def of_station(self, notice: Notice, vehicle: int) -> None:
        """A notice about another station, which the rules of every vehicle make: only the first vehicle's is told."""
        if vehicle == self.aircraft[0].sysid:
            self.event_log.notice(notice)

    def ground_ports(self) -> tuple[int, ...]:
        """Ports at which the station listens for other stations."""
        listen = self.config.ground
        return () if listen is None else (parse_device(listen).port,)

    def _why_old(self) -> str:
        """Why the chosen vehicle's values in MAVProxy are old; "" if the reason is not known."""
        for aircraft in self.aircraft:
            now = aircraft.situation()
            if self.chosen(aircraft.sysid) and not now.old and now.commander and not now.own:
                return f"{now.commander} commands and gets them all."
        return ""

    def _chosen_situation(self) -> Situation | None:
        """The situation of the aircraft that MAVProxy has chosen; None: it is none of this station's."""
        return next((each.situation() for each in self.aircraft if self.chosen(each.sysid)), None)

    def _vehicle_names(self) -> list[str]:
        return [each.core.vehicle_name for each in self.aircraft]

    def _show_status(self) -> None:
        now = self.now()
        crafts = [Craft(each.situation(), each.view.values.aged(now)) for each in self.aircraft]
        clock = time.strftime("%H:%M:%S")
        line = status(self.config.station.name, crafts, clock, self.terminal.width, colour=self.terminal.colour)
        self.terminal.update(*line)

    def _tell(self, text: str, level: Level = Level.INFO) -> None:
        """A line about the station; if there is one vehicle, in that vehicle's form."""
        if self.links.several:
            plain_line(self.console, self.config.station.name, text, level)
            alert(text, level, self.speak, self.ring)
        else:
            self.aircraft[0].view.line(text, level)

    def _on_link_fault(self, text: str) -> None:
        self._guarded("link", lambda: self.event_log.link(text))

    def _show(self, text: str) -> None:
        self.console.writeln(text)

    # ---- in -------------------------------------------------------------------------------------------------------

    def _on_packet(self, m: Any) -> None:
        frame = parse_one(bytes(m.get_msgbuf()))
        if frame is not None and frame.known and frame.sysid in self._by_sysid:
            if self._served is not None:
                self._served.on_vehicle(frame)
            if frame.msgid == mavlink.MAVLINK_MSG_ID_STATUSTEXT:
                self._lines.said(m.text)
            self._by_sysid[frame.sysid].on_frame(frame, m)

    def _read_ground(self) -> None:
        frames = self._ground.read()
        for what, count in self._ground.refused.items():
            self.faults[f"ground frame: {what}"] = count
        for frame in frames:
            if frame.sysid not in self._ground.peers:
                self.faults["ground frame of a stranger"] += 1
            elif frame.msgid == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                for aircraft in self.aircraft:
                    self._guarded("ground link", partial(aircraft.handle, PeerHeard(frame.sysid)))
            elif frame.msgid in OUR_MESSAGES:
                self._guarded("ground link", partial(self._on_peer, frame))

    def _on_peer(self, frame: Frame) -> None:
        message = codec.decode_bytes(frame.raw)
        if message is None or getattr(message, "target_system", 0) not in (0, self.config.station.sysid):
            return
        if message.get_type() == "STATION_OPERATOR":
            self.peer_operators.on_message(frame.sysid, message, self.now())
            return
        if message.get_type().startswith("MISSION_"):
            self._on_package(frame, message)
            return
        aircraft = self._by_sysid.get(getattr(message, "vehicle", 0))
        if aircraft is None:
            self.faults["ground frame of another vehicle"] += 1
        else:
            aircraft.on_peer(frame.sysid, message)

    def _on_package(self, frame: Frame, message: Any) -> None:
        """Mission packages of other stations name their vehicle, except those of a station with an older version."""
        kind, vehicle = message.get_type(), message.vehicle
        if not vehicle and (kind == "MISSION_PACKAGE_ACK" or not self.links.several):
            for aircraft in self.aircraft:  # the vehicle whose package it is accepts the answer
                aircraft.on_package(frame, message)
            return
        if vehicle in self._by_sysid:
            self._by_sysid[vehicle].on_package(frame, message)
            return
        self.faults["mission package of another vehicle"] += 1
        if kind == "MISSION_PACKAGE":
            text = f"vehicle {vehicle} is not one of this station's" if vehicle else "it does not say for which vehicle"
            answer = refusal(bytes(message.mission_digest), text, (frame.sysid, frame.compid))
            self.to_peer(frame.sysid, answer, vehicle)

    # ---- time -----------------------------------------------------------------------------------------------------

    def _idle(self) -> None:
        now = time.monotonic()
        self._thread = threading.get_ident()
        while self._typed:
            self._command(self._typed.popleft())
        self._guarded("lines", self._lines.tick)
        self._guarded("ground link", self._read_ground)
        self._guarded("replay state", partial(self._ground.tick, now))
        if self.links.several:
            self._guarded("choice of vehicle", self.selection.poll)
            self._guarded("choice of link", self.links.align)
        if self._panel is not None:
            self._guarded("panel", partial(self._panel.tick, now))
        if now >= self._turn_at:
            self._turn_at = now + _TURN_S
            self._guarded("links", partial(self._turns, now))
            self._guarded("closing", partial(self.closing.tick, now))
            if self._served is not None:
                self._guarded("served program", partial(self._served.tick, now))
            self._guarded("links", self.links.push)
        if now >= self._each_second_at:
            self._each_second_at = now + 1.0
            self._guarded("links", self.links.refresh)
            self._guarded("beat", self._beat)
            self._guarded("shared log", partial(self._shared_log.check, now))
            for aircraft in self.aircraft:
                self._guarded(f"second of {aircraft.vehicle.called}", partial(aircraft.each_second, now))
            self._guarded("menu", self.menu.tick)
            self._guarded("console rows", partial(self._rows.tick, now))
            self._guarded("windows", self._windows.tick)
            self._guarded("window title", self._titles.tick)
            self._guarded("status line", self._show_status)
            self._guarded("operator on duty", partial(self._duty_file.tick, now))

    def _turns(self, now: float) -> None:
        links = self.links.of_each()
        for aircraft in self.aircraft:
            aircraft.idle(now, links[aircraft.sysid])

    def _beat(self) -> None:
        beat = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
        )
        for peer in self._ground.peers:
            self._ground.write(peer, codec.pack(beat, self._own))
            self._ground.write(peer, codec.pack(operator_message(peer, self.duty), self._own))

    # ---- which vehicle is chosen ----------------------------------------------------------------------------------

    def _on_selection(self, before: int, now: int) -> None:
        """MAVProxy's commands go to another vehicle from now on. The sticks are not carried over to it."""
        self._guarded("sticks", lambda: self._release_sticks(before))
        self._choose(now)

    def _choose(self, sysid: int) -> None:
        self.links.sticks_for = sysid
        self.links.align()
        self._guarded("prompt", lambda: self._name_in_prompt(sysid))

    def _name_in_prompt(self, sysid: int) -> None:
        """MAVProxy puts its setting `vehicle_name` before the mode when it next writes the prompt."""
        aircraft = self._by_sysid.get(sysid)
        name = "" if aircraft is None else aircraft.vehicle.name
        if hasattr(self.settings, "vehicle_name"):
            self.settings.vehicle_name = name
        mode = "" if aircraft is None else aircraft.situation().mode
        self.mpstate.rl.set_prompt(f"{name}{':' if name else ''}{mode or 'MAV'}> ")

    def _release_sticks(self, before: int) -> None:
        """Release the sticks of the vehicle that was chosen before, because MAVProxy would send them to the next
        one."""
        rc = self.mpstate.module("rc")
        aircraft = self._by_sysid.get(before)
        if rc is None or not any(rc.override):
            return
        rc.override = [0] * len(rc.override)
        if aircraft is not None:
            aircraft.connection.send(mavlink.MAVLink_rc_channels_override_message(before, 0, *([0] * 8)))
            aircraft.view.line("Its sticks are let go of: another vehicle is chosen.", Level.ADVISORY)


def init(
    mpstate: Any, config: Any = None, journal: Any = None, serve: Any = None, **unknown: Any
) -> HandoverGcsModule | None:
    """Called by MAVProxy. Without a usable configuration it says why, and MAVProxy runs on.

    `config`: path of the configuration file (`module load handover_gcs:{"config":"FILE"}`); `journal`: path of the
    journal instead of the configured one: `handover` gives each run its own folder. `serve`: link to a served program
    instead of the configured one.
    """
    resources: StationResources | None = None
    try:
        if unknown:
            raise ConfigError(f"unknown argument {', '.join(unknown)}; allowed are: config, journal, serve")
        if "handover" in mpstate.command_map:
            raise ConfigError("module handover is loaded here: vehicle and station need a MAVProxy each")
        settings = load_station(find_station_config(path_argument("config", config) or _last.get("config")))
        written = path_argument("journal", journal) or _last.get("journal")
        if written is not None:
            settings = replace(settings, journal=Path(written))
        serve = serve or _last.get("serve")
        if serve is not None:
            parse_served(str(serve))
            settings = replace(settings, serve=str(serve))
        resources = StationResources.of(settings, Clocks(time.time, time.monotonic))
        module = HandoverGcsModule(mpstate, settings, resources)
    except Exception as error:  # an exception would end MAVProxy while it loads its default modules
        if resources is not None:
            mpstate.select_extra.pop(resources.ground.listening, None)
            resources.close()
        mpstate.public_modules.pop("handover_gcs", None)
        mpstate.command_map.pop("handover", None)
        refused(mpstate, "handover_gcs", why(error))
        return None
    loaded()
    given = {"journal": written, "serve": serve}
    _last.update({"config": str(settings.path)} | {name: value for name, value in given.items() if value is not None})
    return module
