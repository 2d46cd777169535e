# SPDX-License-Identifier: GPL-3.0-or-later

"""Missions and geofences that stations write to the autopilot on the ground: read back and judged.

1. The autopilot takes such an upload itself, by any protocol (mission messages, files, parameters). When the writing
   has ended, the companion reads mission, geofence and cruise speed back, and judges what it has read.
2. The judgement needs a package, for zones, stations, terrain and policies: the last package that was loaded, or else
   the one on board.
3. The rules are those of a plan in a file (`plan.on_ground`) and of an upload in flight. The way must not lead into the
   ground, out of the geofence or out of coverage. The operator lifts the last two as in flight (`CommandCheck.plan`).
   START itself judges energy, heights above the sea, the kind of aircraft and consent.
4. A mission that passes becomes the mission. The digest of the package stays, so the package's stations can still take
   the aircraft. They are told in words, and AUTHORITY_STATUS says that the route is another one.
5. A mission that does not pass stays on the autopilot, and START is refused with the reason.
6. Heights and ways begin at the autopilot's home. Until the autopilot has a home after power-up, the mission waits.
7. If the package's own mission is sent again, the package counts.

A worker thread does what takes time. Times are monotonic seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import Final

from mavproxy_handover.core.safety.commands import QUIET_S, Limit
from mavproxy_handover.gate.list_changes import MISSION, ListChange
from mavproxy_handover.gate.refusal_text import how_to_lift
from mavproxy_handover.mission.ahead import leaves_coverage, leaves_fence
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.fence import Fence
from mavproxy_handover.mission.heights import into_ground
from mavproxy_handover.mission.items import difference
from mavproxy_handover.mission.package import MissionPackage
from mavproxy_handover.mission.route_simulation import simulate_legs
from mavproxy_handover.operator.base.context import Context
from mavproxy_handover.operator.checks.command_check import CommandCheck
from mavproxy_handover.operator.stations.port import StationPort
from mavproxy_handover.operator.uploads.flown_mission import FlownMission
from mavproxy_handover.operator.uploads.mission_readiness import MissionReadiness
from mavproxy_handover.operator.uploads.prepared import Along, Prepared, way_ahead, way_of
from mavproxy_handover.tools.worker import Worker
from mavproxy_handover.vehicle.mission_protocol import fence_items, same_fence
from mavproxy_handover.vehicle.procedures import HeldPlan
from mavproxy_handover.wire.conversation import Conversation

__all__ = ["GroundUploads"]

#: the lists are read this long (s) after the last write: programs send mission and geofence one after the other
_SETTLED_S: Final = 0.5
#: after this time (s) the lists are read even if an upload has not ended; the autopilot ends one after 8 s of silence
_STALLED_S: Final = 10.0
#: interval of the attempts to read the lists (s), and their number
_AGAIN_S: Final = 2.0
_TRIES: Final = 3
#: an autopilot without a position has no home: the lists are read again after this time (s)
_NO_HOME_S: Final = 3.0
#: speeds that differ by more than this (m/s) are different
_SAME_MPS: Final = 0.01
#: name of the conversation
_READ: Final = "upload read back"


@dataclass(frozen=True, slots=True)
class _Written:
    """A list that a station wrote. `port`: of the station, None after a restart; `what`: mission or geofence."""

    port: StationPort | None
    what: str
    begun_at: float


@dataclass(frozen=True, slots=True)
class _Judged:
    """A mission that was read and judged. `own`: it is the package's; `left`: the limits that it leaves, in words."""

    prepared: Prepared
    own: bool
    left: Mapping[Limit, str]


class GroundUploads:
    """The uploads of one vehicle's stations on the ground.

    A mission is judged by the package that was loaded last, or else by the package on board (`readiness`). `list_open`:
    whether a station is writing the mission or the geofence.
    """

    def __init__(
        self,
        context: Context,
        command_check: CommandCheck,
        flown: FlownMission,
        readiness: MissionReadiness,
        list_open: Callable[[], bool],
    ) -> None:
        self._command_check = command_check
        self._procedures = context.procedures
        self._conversations = context.conversations
        self._authority = context.authority
        self._reports = context.reports
        self._flown = flown
        self._readiness = readiness
        self._list_open = list_open
        self._worker = Worker()
        #: the list to be judged; None: none
        self._written: _Written | None = None
        self._changed_at = self._due_at = -inf
        self._tries = 0

    @property
    def _package(self) -> MissionPackage | None:
        """The package whose zones count; None: there is none."""
        return self._flown.latest or self._readiness.on_board

    def changed(self, port: StationPort, change: ListChange, now: float) -> None:
        """A station's message that changes a list goes to the autopilot."""
        before = self._written
        # if both lists were written, the texts name the mission
        what = MISSION if before is not None and before.what == MISSION else change.what
        begun_at = now if before is None or before.port is not port else before.begun_at
        self._written = _Written(port, what, begun_at)
        self._changed_at, self._due_at, self._tries = now, now + _SETTLED_S, 0
        self._conversations.drop(_READ)

    def found(self, now: float) -> None:
        """After a restart on the ground, the autopilot still holds a list that a station wrote."""
        self._written = _Written(None, MISSION, now)
        self._changed_at, self._due_at, self._tries = now, now, 0

    def forget(self) -> None:
        """A package overwrites the list."""
        self._written = None
        self._conversations.drop(_READ)

    def tick(self, now: float) -> None:
        """Time has passed; to be called often."""
        self._worker.tick(now)
        if self._written is None or now < self._due_at or _READ in self._conversations:
            return
        if self._list_open() and now < self._changed_at + _STALLED_S:
            self._due_at = now + _SETTLED_S
        elif self._authority.arbiter.grounded(now):
            self._read(self._written, now)

    # ---- the steps ------------------------------------------------------------------------------------------------

    def _read(self, written: _Written, now: float) -> None:
        package = self._package
        self._due_at = inf
        if package is None:
            self._reject(written, "without a mission package no zones are known", now)
            return

        def done(talk: Conversation, now: float) -> None:
            if self._written is not written:
                return
            if talk.failure is None:
                self._judge(written, package, talk.result, now)
                return
            self._tries += 1
            self._due_at = now + _AGAIN_S
            if self._tries >= _TRIES:
                self._reject(written, f"it could not be read back: {talk.failure}", now)

        self._conversations.begin(_READ, self._procedures().held_plan(), done, now)

    def _judge(self, written: _Written, package: MissionPackage, held: HeldPlan, now: float) -> None:
        if len(held.items) <= 1:
            self._written = None
            self._readiness.cleared(_name(written), now)
            return
        if held.items[0].lat_deg == held.items[0].lon_deg == 0.0:
            self._due_at = now + _NO_HOME_S
            self._readiness.waits(_name(written), written.what, now)
            return
        port = written.port
        commander = port.sysid if port is not None and self._authority.commands(port.sysid) else package.parent.sysid

        def judged(result: _Judged | Exception, now: float) -> None:
            if self._written is written:
                self._conclude(written, held, result, now)

        if not self._worker.submit(lambda: _judge(package, held, commander), judged):
            self._due_at = now + _AGAIN_S  # the worker still judges an earlier list

    def _conclude(self, written: _Written, held: HeldPlan, result: _Judged | Exception, now: float) -> None:
        if not isinstance(result, _Judged):
            why = str(result)
            if not isinstance(result, (MissionError, TimeoutError)):
                self._reports.fault("upload on the ground", f"{type(result).__name__}: {result}")
                why = "internal fault"
            self._reject(written, why, now)
            return
        if not self._authority.arbiter.grounded(now):
            self._reject(written, "the aircraft was armed before it was judged", now)
            return
        wish = held.items[1:], held.fence
        ruling = self._command_check.plan(written.port, result.left, wish, written.begun_at, now)
        if not ruling.passes:
            self._reject(written, ruling.words, now, how_to_lift(ruling.limits[0], QUIET_S))
            return
        self._written = None
        prepared = result.prepared
        self._flown.loaded(prepared, now, uploaded=not result.own)
        count = len(held.items) - 1
        self._reports.event_log.mission_judged(_name(written), count, prepared.commanders, own=result.own)
        self._readiness.judged(_name(written), written.what, count, prepared.package.name, own=result.own, now=now)

    def _reject(self, written: _Written, why: str, now: float, lifted: str = "") -> None:
        self._written = None
        known = self._package is not None
        self._reports.event_log.mission_rejected(_name(written), written.what, why)
        self._readiness.rejected(_name(written), written.what, why, lifted, known=known, now=now)


def _name(written: _Written) -> str:
    """The name of the station; "" if it is not known any more."""
    return "" if written.port is None else written.port.name


def _judge(package: MissionPackage, held: HeldPlan, commander: int) -> _Judged:
    """Judge the mission on the autopilot with the zones of the package; for a worker thread. Raises MissionError.

    `commander`: the station (system id) that commands at the take-off.
    """
    own = _is_own(package, held)
    if not own:
        if package.route.fence and not held.fence:
            raise MissionError(f"the geofence of package {package.name} was cleared")
        package = package.with_mission(held.items, held.fence, held.cruise_mps)
    legs = package.legs()
    simulation = simulate_legs(legs, package.zone_finder(), commander, belonging=package.belonging)
    left = {}
    if not own:
        wrong = into_ground(package.route, legs, package.relief())
        if wrong:
            raise MissionError(wrong)
        stations = {zone.station for zone in package.zones}
        left = {
            Limit.FENCE: leaves_fence(legs, Fence(package.route.fence)),
            Limit.COVERAGE: leaves_coverage(legs, package.zone_finder(), stations),
        }
    along = Along(package.stretches(simulation), way_ahead(simulation, package.route), simulation.handovers)
    prepared = Prepared(package, package.zone_finder(), simulation.commanders, way_of(package), along)
    return _Judged(prepared, own, left)


def _is_own(package: MissionPackage, held: HeldPlan) -> bool:
    """Whether the autopilot holds the mission, geofence and speed that loading the package would write."""
    route = package.route
    items = route.upload_items()
    if package.cruise_speed_named and abs(held.cruise_mps - package.cruise_speed_mps) > _SAME_MPS:
        return False
    if len(items) != len(held.items) or (route.fence and not same_fence(fence_items(held.fence), route.fence)):
        return False
    return all(
        difference(sent, replace(got, seq=sent.seq), package.profile) is None
        for sent, got in zip(items[1:], held.items[1:], strict=True)
    )
