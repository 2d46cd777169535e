# SPDX-License-Identifier: GPL-3.0-or-later

"""`module load handover`: the MAVProxy module of the companion computer.

It decides nothing. It opens the stations' sockets, passes bytes, messages and ticks to `Companion`, and shows the
output. It does what MAVProxy does not:

* no frame reaches the autopilot past the gate. It refuses to load while `--out` links exist. It switches `mavfwd`,
  `mavfwd_disarmed` and MAVProxy's own heartbeat off, and again off if an operator switches them on;
* every callback is wrapped, because MAVProxy would swallow an exception or drop the socket without a report. An
  exception in one step of the main loop does not stop the others, above all not the lease;
* its sockets are polled in `idle_task` as well, because MAVProxy does not select on them without a master;
* it is the vehicle's only judge: it holds the lock of the vehicle, and that of a serial line to the autopilot.

MAVProxy's main loop sends the lease, so the lease stops if that loop stalls. The same is true of the signs of life to
the supervisor (`supervision/watchdog_pipe.py`) or, without one, to a service manager (`supervision/manager.py`).
"""

from __future__ import annotations

import gc
import math
import os
import secrets
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import serial
from MAVProxy.modules.lib import mp_module, mp_util

from mavproxy_handover.companion.commands import VehicleCommands
from mavproxy_handover.companion.companion import Companion
from mavproxy_handover.companion.edge import Edge
from mavproxy_handover.companion.hosting import SharedLog, guarded, refusal, why
from mavproxy_handover.companion.unloading import UnloadQuestion
from mavproxy_handover.config.files import VehicleConfig, find_vehicle_config, path_argument
from mavproxy_handover.config.line_claims import line_claims
from mavproxy_handover.config.running import Running, forget, keep, load_running
from mavproxy_handover.gate.line_budget import LineBudget
from mavproxy_handover.link.autopilot_line import AutopilotLink
from mavproxy_handover.link.box_line import BoxLine
from mavproxy_handover.link.devices import Device, parse_device
from mavproxy_handover.link.names import Names
from mavproxy_handover.operator.onboard.port import OnboardPort, open_onboard
from mavproxy_handover.operator.stations.port import StationPort, open_ports
from mavproxy_handover.store.background_writer import BackgroundWriter
from mavproxy_handover.store.lock import VehicleLock, lock_line
from mavproxy_handover.store.memory import memory_folder, memory_name
from mavproxy_handover.store.replay import ReplayStore
from mavproxy_handover.supervision.main_loop import (
    DOWNLOAD_S,
    STAY_S,
    TALKING_S,
    is_ending,
    poller,
    readable,
    waited_for,
)
from mavproxy_handover.supervision.manager import ServiceManager, named_manager
from mavproxy_handover.supervision.must_load import loaded, refused
from mavproxy_handover.supervision.watchdog_pipe import watchdog_pipe
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.tools.schedule import TICK_S, Schedule
from mavproxy_handover.tools.version import VERSION
from mavproxy_handover.wire.signing import SignedPeer

__all__ = ["HandoverModule", "init"]

#: MAVProxy settings that would let frames past the gate -> the value that does not
_SETTINGS = {"mavfwd": False, "mavfwd_disarmed": False, "heartbeat": 0}
#: intervals (s) of measuring the links: with several links of a station, which are probed 10 times a second, and
#: without
_SEVERAL_S, _SINGLE_S = 0.05, 0.5
#: interval (s) of reading links even if MAVProxy waits for them, because lines have to be opened again
_POLL_S = 0.2
_TOO_OFTEN = (
    "restarted too often: no leases, no station commands, the guard brings the aircraft home. Find out why in the "
    "journal, then start `handover companion` again"
)
#: the autopilot's name in the replay state, longer than a station's can be
_AUTOPILOT = "autopilot of this vehicle"
_Link = tuple[StationPort | OnboardPort, Device]
#: arguments of the last load, for `module reload handover`
_last: dict[str, str] = {}


class HandoverModule(mp_module.MPModule):
    """The vehicle's side of authority handover."""

    def __init__(
        self,
        mpstate: Any,
        running: Running,
        ports: dict[int, StationPort],
        lock: VehicleLock,
        clocks: Clocks,
        names: Names,
        box: BoxLine | None = None,
        onboard: tuple[OnboardPort, ...] = (),
    ) -> None:
        """`lock`: lock of the vehicle. `names`: addresses of the hosts of links and box. `box`: the position box, if
        there is one. `onboard`: the onboard programs.

        Raises OSError if the journal cannot be written, except in a restart.
        """
        config = running.config
        super().__init__(mpstate, "handover", "authority handover (companion)", public=True, multi_vehicle=True)
        self.lock = lock
        for descriptor in lock.descriptors:  # otherwise a map's process would keep it open
            mp_util.child_fd_list_add(descriptor)
        self._watchdog_pipe = watchdog_pipe()
        self._manager = ServiceManager() if self._watchdog_pipe is not None else named_manager()
        self._kept = {name: getattr(self.settings, name) for name in _SETTINGS if hasattr(self.settings, name)}
        #: checked in every round of the main loop, so not by name
        self._doors = [(self.settings.get_setting(name), _SETTINGS[name]) for name in self._kept]
        autopilot = None if running.autopilot_key is None else SignedPeer(running.autopilot_key, keeps_sent=True)
        budget = LineBudget(line_claims(config))
        self._to_autopilot = AutopilotLink(mpstate, lambda: self.master, autopilot, clocks, budget.line_opened)
        nonce = secrets.randbelow(0xFFFFFFFF) + 1
        edge = Edge(self._to_autopilot.write, self._show, clocks, nonce, box, onboard, budget)
        self.companion = Companion(running, ports, edge)
        self._box = box
        self._box_holds: list[int] = []
        self._commands = VehicleCommands(self.companion, self._show)
        self._links: list[_Link] = [(port, link) for port in ports.values() for link in port.links]
        self._links += [(port, port.link) for port in onboard]
        self._idle_at = 0.0
        jobs = [("measuring links", partial(self._measure, port), _measured_s(port)) for port in ports.values()]
        jobs += [("link", partial(self._read_link, port, link), _POLL_S) for port, link in self._links]
        self._running, self._names = running, names
        self._record = BackgroundWriter("restart copy")
        jobs.append(("names", partial(self._update_addresses), _POLL_S))
        jobs.append(("shared log", partial(SharedLog.check, SharedLog(mpstate, self._show)), 1.0))
        self._schedule = Schedule(jobs, self.companion.fault)
        #: time of the last read of a station's frames
        self._heard_at = -math.inf
        #: True if other frames came shortly before, because a single heartbeat is no burst
        self._talking = False
        #: time at which MAVProxy gets its turn, however much our links have to read
        self._stay_until = 0.0
        self._watched: dict[Device, tuple[int, list[int]]] = {}
        self._by_descriptor: dict[int, _Link] = {}
        for port, link in self._links:
            self._watch(port, link)
        self.add_command(
            "handover",
            self._command,
            "authority handover of this vehicle ('handover help')",
            self._commands.completions(),
        )
        self._unload_question = UnloadQuestion(
            mpstate.command_map, "handover", flies=self._flies, show=self._show, clock=time.monotonic
        )
        self._unload_question.install()
        self.companion.event_log.loaded(VERSION, str(config.path))
        for note in running.notes:
            self.companion.event_log.running_by(note)
        self._close_side_doors(tell=False)
        self._supervised()
        stations = ", ".join(
            f"{port.name} (parent)" if port.sysid == config.parent else port.name for port in ports.values()
        )
        self._show(f"handover {VERSION}: {config.name}, stations {stations}, configuration {config.path}")
        self._replay: ReplayStore | None = None
        peers = {port.name: port.peer for port in ports.values() if port.peer is not None}
        if autopilot is not None:
            peers[_AUTOPILOT] = autopilot
        if peers:
            self._guard_against_replay(config, peers)
        open_doors = ", ".join(port.name for port in ports.values() if port.peer is None)
        if open_doors:
            self.companion.event_log.unsigned_allowed(open_doors)
            self._show(f"handover: WARNING: {open_doors} without a key: any program on the link counts as the station")
        not_kept = "" if running.recorded else keep(running)
        if not_kept:
            self.companion.event_log.running_by(not_kept)
        self._running = replace(running, recorded=not not_kept)
        # these objects stay, so the garbage collector need not check them in flight. On a PC that takes 30
        # ms at once, and a sender of much data would choose the time
        gc.freeze()

    def _guard_against_replay(self, config: VehicleConfig, peers: dict[str, SignedPeer]) -> None:
        folder = config.state or config.journal.parent
        place = memory_folder(os.environ)
        memory = None if place is None else place / f"{memory_name(folder, config.name)}.replay"
        replay = self._replay = ReplayStore(folder / f"{config.name}.replay.json", memory=memory)
        note = replay.load(time.time(), first=not self._running.restart)
        for name, peer in peers.items():
            replay.attach(name, peer)
        if note:
            self.companion.event_log.replay_state(note)
            self._show(f"handover: {note}")

    def _supervised(self) -> None:
        """Report the supervisor's facts, if there is one: why this is a restart, and if it was one too many."""
        if self._watchdog_pipe is None:
            return
        told = self._watchdog_pipe.told
        if told.why:
            self.companion.event_log.started_again(told.why)
        if not told.leases:
            self.companion.fail_closed(_TOO_OFTEN, time.monotonic())

    # ---- MAVProxy's callbacks, all wrapped ------------------------------------------------------------------------

    def idle_task(self) -> None:
        """Called by MAVProxy in every round of its main loop."""
        now = time.monotonic()
        self._send_downloads(now)
        self._stay_until = now + STAY_S
        self._guarded("side doors", self._close_side_doors)
        if self.companion.gate.downloads.wait or (self._talking and now - self._heard_at < TALKING_S):
            self._guarded("link", self._stay)
        self._guarded("idle", self._idle)

    def mavlink_packet(self, m: Any) -> None:
        """A message from the vehicle's side."""
        if self._to_autopilot.signed:
            self._guarded("stamps of the autopilot", partial(self._to_autopilot.track_timestamp, m))
        try:
            self.companion.on_autopilot(m, time.monotonic())
        except Exception:
            self.companion.fault("message of the autopilot", traceback.format_exc(limit=-3))

    def _readable(self, where: _Link) -> None:
        """Read a link that is readable."""
        self._guarded("link", partial(self._serve, *where, once=True))
        self._guarded("link", self._stay)

    def _command(self, args: list[str]) -> None:
        self._guarded("command", lambda: self._commands.run(args), "handover: internal fault, see the journal")

    def unload(self) -> None:
        """Release everything: sockets, command, settings."""
        for fileno, held in self._watched.values():
            self.mpstate.select_extra.pop(fileno, None)
            for descriptor in held:
                mp_util.child_fd_list_remove(descriptor)
        self._links.clear()
        self._by_descriptor = {}
        if self._box is not None:
            self._box.close()
            self._hold_box()
        self._unload_question.give_back()
        self.remove_command("handover")
        self.mpstate.public_modules.pop("handover", None)
        for name, value in self._kept.items():
            setattr(self.settings, name, value)
        if self._watchdog_pipe is not None:
            (self._watchdog_pipe.ending if is_ending(self.mpstate) else self._watchdog_pipe.let_go)()
        elif is_ending(self.mpstate):
            self._manager.stopping()
        self._manager.close()
        if self._replay is not None:
            self._guarded("replay state", self._replay.close)
        grounded = not self._flies()
        self._record.close()
        if grounded:
            forget(self.companion.config)
        self._guarded("unload", self.companion.close)
        gc.unfreeze()
        self._guarded("tlog", self._to_autopilot.log)
        self._to_autopilot.release()
        for descriptor in self.lock.descriptors:
            mp_util.child_fd_list_remove(descriptor)
        self.lock.release()

    def close_journal(self) -> None:
        """Called by the supervised process before it ends without an unload."""
        self._guarded("journal", self.companion.journal.close)

    # ---- implementation ---------------------------------------------------------------------------------------------

    def _guarded(self, where: str, job: Callable[[], object], line: str = "") -> None:
        """Run `job`. If it raises, count and journal that, and show `line`."""
        guarded(where, job, self.companion.fault, partial(self._show, line) if line else None)

    def _stay(self) -> None:
        """Serve our links until MAVProxy has something to do (see `main_loop`)."""
        now, until, gate = time.monotonic(), self._stay_until, self.companion.gate
        waiting, ours = poller(waited_for(self.mpstate)), self._by_descriptor
        while now < until:
            due = now if self.companion.autopilot.aircraft.uncompared else min(self._idle_at, until)
            wait_s = due - now
            if gate.downloads.wait:
                self._send_downloads(now)
                wait_s = min(wait_s, DOWNLOAD_S)
            ready, others = readable(waiting, ours, wait_s)
            for fileno in ready:
                port, link = ours[fileno]
                self._serve(port, link, once=True)
                if self._by_descriptor is not ours:  # `waiting` is obsolete too
                    return
            if others:
                return
            now = time.monotonic()
            if now >= due:  # even if there is more to read
                self._guarded("idle", self._idle)
                waiting, ours = poller(waited_for(self.mpstate)), self._by_descriptor
                now = time.monotonic()

    def _send_downloads(self, now: float) -> None:
        gate = self.companion.gate
        if gate.downloads.wait:  # checked in every round; nearly always false
            self._guarded("downloads", partial(gate.downloads.send, now))

    def _serve(self, port: StationPort | OnboardPort, link: Device, once: bool = False) -> None:
        try:
            now = time.monotonic()
            if isinstance(port, OnboardPort):
                self.companion.onboard.serve(port, now, once)
            elif (frames := port.read(link, now, once)) or port.rejected:
                self._talking = now - self._heard_at < TALKING_S
                self._heard_at = now
                self.companion.on_station(port, frames, now)
        except Exception:
            self.companion.fault("link", traceback.format_exc(limit=-3))
        if not link.settled and link.fileno() != self._watched[link][0]:
            self._guarded("link", partial(self._watch, port, link))

    def _idle(self) -> None:
        now = time.monotonic()
        if self.companion.autopilot.aircraft.uncompared:
            self.companion.check_zones(now)
        if now < self._idle_at:  # called for every frame that comes in: usually there is nothing to do
            return
        self._idle_at = now + TICK_S
        self._guarded("autopilot link", self._to_autopilot.choose)
        self._guarded("links", partial(self._poll, now))
        for port, link in self._links:
            if link.unfinished:
                self._serve(port, link)
        self._schedule.run(now)
        self.companion.tick(now)
        self._guarded("position box", self._hold_box)
        self._guarded("tlog", partial(self._to_autopilot.tick, now))
        if self._replay is not None:
            self._guarded("replay state", partial(self._replay.tick, now))
        if self._watchdog_pipe is not None:  # last, so that an exception above shows by silence
            self._watchdog_pipe.beat(now)
        self._manager.in_order(now, lived=True)

    def _poll(self, now: float) -> None:
        """Read all links if MAVProxy does not wait for them, for example without a link to the autopilot."""
        if waited_for(self.mpstate):
            return
        for port, link in self._links:
            self._guarded("link", partial(self._read_link, port, link, now))

    def _read_link(self, port: StationPort | OnboardPort, link: Device, _now: float) -> None:
        self._serve(port, link)
        self._watch(port, link)

    def _update_addresses(self, now: float) -> None:
        """Start look-ups of host names in a thread, and store the results for a restart."""
        self._names.tick(now)
        if self._names.known != self._running.addresses:
            running = self._running = replace(self._running, addresses=self._names.known)
            self._record.put("addresses", lambda: _keep(running))

    def _measure(self, port: StationPort, now: float) -> None:
        self.companion.on_links(port, port.tick(now), now)

    def _watch(self, port: StationPort | OnboardPort, link: Device) -> None:
        """Let MAVProxy wait for the link's current descriptor; a new connection has a new one."""
        before, held = self._watched.get(link, (-1, []))
        fileno, holds = link.fileno(), link.descriptors()
        if (before, held) == (fileno, holds):
            return
        handler = (self._readable, (port, link))
        if self.mpstate.select_extra.get(before) == handler:  # the number may be another link's by now
            del self.mpstate.select_extra[before]
        if fileno >= 0:
            self.mpstate.select_extra[fileno] = handler
        for descriptor in held:
            mp_util.child_fd_list_remove(descriptor)
        for descriptor in holds:  # otherwise a map's process would keep the port after `unload`
            mp_util.child_fd_list_add(descriptor)
        self._watched[link] = (fileno, holds)
        self._by_descriptor = {
            self._watched[link][0]: (port, link) for port, link in self._links if link in self._watched
        }

    def _hold_box(self) -> None:
        """Keep the box's connection out of a map's process. The companion's ticks read the box."""
        holds = [] if self._box is None else self._box.descriptors()
        if holds != self._box_holds:
            for descriptor in self._box_holds:
                mp_util.child_fd_list_remove(descriptor)
            for descriptor in holds:
                mp_util.child_fd_list_add(descriptor)
            self._box_holds = holds

    def _close_side_doors(self, *, tell: bool = True) -> None:
        for setting, value in self._doors:
            if setting.value != value:
                name, setting.value = setting.name, value
                if tell:
                    self._show(f"handover: {name} is set back to {value}: only the gate lets stations through")
        # checked in every round; nearly always true
        if not self.mpstate.mav_outputs and not self.mpstate.sysid_outputs:
            return
        for output in _remove_outputs(self.mpstate, self.companion.config):
            self._guarded("output", output.close)
            self._show(f"handover: output {output.address} is closed: stations belong in the configuration")

    def _flies(self) -> bool:
        return not self.companion.arbiter.grounded(time.monotonic())

    def _show(self, text: str) -> None:
        self.console.writeln(text)


def _keep(running: Running) -> None:
    """Store the run. If there is no room, the next restart looks up what it can."""
    keep(running)


def _measured_s(port: StationPort) -> float:
    return _SEVERAL_S if len(port.links) > 1 else _SINGLE_S


def _outputs(mpstate: Any, config: VehicleConfig) -> list[Any]:
    """Forbidden outputs of MAVProxy. An output for a system id takes that system's messages from us."""
    allowed = [] if not config.listen_only_outputs else list(mpstate.mav_outputs)
    return [output for output in (*mpstate.mav_outputs, *mpstate.sysid_outputs.values()) if output not in allowed]


def _remove_outputs(mpstate: Any, config: VehicleConfig) -> list[Any]:
    """Remove the forbidden outputs from MAVProxy's lists."""
    outputs = _outputs(mpstate, config)
    for output in outputs:
        if output in mpstate.mav_outputs:
            mpstate.mav_outputs.remove(output)
    mpstate.sysid_outputs.clear()
    return outputs


def init(mpstate: Any, config: Any = None, journal: Any = None, **unknown: Any) -> HandoverModule | None:
    """Called by MAVProxy. Without a valid configuration it reports the reason, and MAVProxy goes on.

    `config`: path of the configuration file (`module load handover:{"config":"FILE"}`). `journal`: path of the journal,
    instead of the configuration's, because `handover` makes a folder for each run.
    """
    if unknown:
        refused(mpstate, "handover", f"unknown argument {', '.join(unknown)}; allowed are: config, journal")
        return None
    if "handover" in mpstate.command_map:
        refused(mpstate, "handover", "module handover_gcs is loaded here: vehicle and station need a MAVProxy each")
        return None
    ports: dict[int, StationPort] = {}
    onboard: tuple[OnboardPort, ...] = ()
    lock: VehicleLock | None = None
    box: BoxLine | None = None
    try:
        path = find_vehicle_config(path_argument("config", config) or _last.get("config"))
        line = watchdog_pipe()
        running = load_running(path, restarted=line is not None and bool(line.told.why))
        written = path_argument("journal", journal) or _last.get("journal")
        if written is not None:
            running = replace(running, config=replace(running.config, journal=Path(written)))
        settings, strict = running.config, not running.restart
        forbidden = _outputs(mpstate, settings)
        if forbidden:
            outputs = ", ".join(output.address for output in forbidden)
            refused(
                mpstate,
                "handover",
                f"MAVProxy has outputs ({outputs}): programs there could pass the gate. Start without --out, "
                "or set listen_only_outputs = true in [vehicle]",
            )
            return None
        lock = VehicleLock(settings.state or settings.journal.parent, settings.name, strict=strict)
        _lock_lines(mpstate)
        clocks = Clocks(time.time, time.monotonic)
        names = Names(running.addresses)
        ports = open_ports(settings.stations, settings.sysid, clocks, running.keys, names, strict=strict)
        onboard = open_onboard(settings.onboard, settings.sysid, names, strict=strict)
        if settings.position.box:
            if strict:
                names.find(parse_device(settings.position.box))
            box = BoxLine(settings.position.box, clocks.monotonic, names, settings.position.layout)
        module = HandoverModule(mpstate, running, ports, lock, clocks, names, box, onboard)
    except Exception as error:  # any error: MAVProxy would end if a default module raised
        for port in ports.values():
            for link in port.links:
                mpstate.select_extra.pop(link.fileno(), None)
            port.close()
        for program in onboard:
            mpstate.select_extra.pop(program.link.fileno(), None)
            program.close()
        if box is not None:
            box.close()
        if lock is not None:
            for descriptor in lock.descriptors:
                mp_util.child_fd_list_remove(descriptor)
            lock.release()
        mpstate.public_modules.pop("handover", None)
        mpstate.command_map.pop("handover", None)
        refused(mpstate, "handover", why(error), refusal(error))
        return None
    loaded()
    _last.update({"config": str(path)} if written is None else {"config": str(path), "journal": written})
    return module


def _lock_lines(mpstate: Any) -> None:
    """Lock the serial lines to the autopilot. Raises LockError if another program uses one too."""
    for master in mpstate.mav_master:
        port = getattr(master, "port", None)
        if isinstance(port, serial.Serial) and port.is_open:
            lock_line(port.fileno(), str(port.port))
