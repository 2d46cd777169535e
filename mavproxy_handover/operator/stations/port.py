# SPDX-License-Identifier: GPL-3.0-or-later

"""A station as the companion reaches it: its links, its identity, and its counters."""

from __future__ import annotations

import secrets
from collections import Counter, deque
from collections.abc import Mapping
from math import inf
from typing import Any, Final

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.config.files import StationLinks
from mavproxy_handover.gate.client_capabilities import ANEW_S, ClientCapabilities
from mavproxy_handover.gate.judge import StationIdentity
from mavproxy_handover.link.bundle import LinkBundle
from mavproxy_handover.link.devices import Device, LinkError, open_link
from mavproxy_handover.link.link_sequencer import NO_STAMP
from mavproxy_handover.link.names import Names
from mavproxy_handover.link.quality import LinkEvent, LinkEventKind, LinkQuality, Measure
from mavproxy_handover.link.timesync import probe_message
from mavproxy_handover.store.keys import StationKeys, check_distinct
from mavproxy_handover.tools.clocks import Clocks
from mavproxy_handover.wire import codec
from mavproxy_handover.wire.frames import Frame
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, COMPANION_COMPID, LANGUAGE_COMPID, OUR_MESSAGES, PROBE_COMPID
from mavproxy_handover.wire.signing import SignatureVerdict, SignedPeer
from mavproxy_handover.wire.texts import marked_texts

__all__ = ["StationPort", "open_ports"]

#: heartbeats come every second: after a longer pause (s) the uplink was interrupted
_INTERRUPTED_S = 3.5
#: measures that other senders cause, and that say nothing about the station's own frames
_OF_OTHERS: Final = {Measure.BAD_SIGNATURES, Measure.OVERFLOW}
#: rejected frames that wait to be journalled; in a flood only the newest are kept
_REJECTED = 32
#: a sender whose frames are rejected is told why at most once in this time (s), and not while the station is heard
_EXPLAIN_S = 10.0
_HEARD_S = 5.0
_FOREIGN = "system id {other} is not one of {name}: set this program's to {sysid}."
_UNPROVEN = {
    SignatureVerdict.UNSIGNED: "frames of {name} are not signed: give this program the key of {name}.",
    SignatureVerdict.BAD: "frames of {name} are signed with another key: give this program the key of {name}.",
    SignatureVerdict.TOO_OLD: "frames of {name} carry an old time: set the clock of this computer.",
}


class _Key:
    """Signs frames to a station with its key. All links share one link id: pymavlink copies that of the other end."""

    def __init__(self, peer: SignedPeer, clocks: Clocks) -> None:
        self._peer = peer
        self._clocks = clocks

    def stamp(self) -> int:
        stamp = self._peer.clock.next(self._clocks.utc(), self._clocks.monotonic())
        return NO_STAMP if stamp is None else stamp

    def sealed(self, data: bytes, stamp: int) -> bytes | None:
        return self._peer.seal(data, 0, stamp)


class StationPort:
    """One station: its identity, its links, its counters."""

    def __init__(
        self,
        config: StationLinks,
        links: tuple[Device, ...],
        vehicle_sysid: int,
        keys: StationKeys | None,
        clocks: Clocks,
    ) -> None:
        """`keys`: the station's keys, for both directions; None: nothing is signed or checked."""
        self._clocks = clocks
        self.sysid = config.station.sysid
        self.name = config.station.name
        self.identity = StationIdentity(config.station.sysid, config.sysids, config.components)
        #: whether it gets the companion's heartbeat
        self.companion_heartbeat = config.companion_heartbeat
        #: the dialects that its programs have shown
        self.capabilities = ClientCapabilities(config.not_in_control)
        self.links = links
        #: the component of the station's own messages
        self.component = 0
        #: the station's last heartbeat, and when it came (monotonic s)
        self.heartbeat = b""
        self.heartbeat_at = -inf
        #: the first heartbeat after the last interruption
        self._heard_since = -inf
        #: invalid signatures, by the reason
        self.bad_signatures: Counter[SignatureVerdict] = Counter()
        #: the station's key and the frames signed with it; None: the station has no key
        self.peer = None if keys is None else SignedPeer(keys.current, keys.previous)
        #: frames with an invalid signature, with the verdict, newest last
        self.rejected: deque[tuple[Frame, SignatureVerdict]] = deque(maxlen=_REJECTED)
        self._over: dict[str, set[Measure]] = {}
        self._encoder = mavlink.MAVLink(None, srcSystem=vehicle_sysid, srcComponent=COMPANION_COMPID)
        self._language = mavlink.MAVLink(None, srcSystem=vehicle_sysid, srcComponent=LANGUAGE_COMPID)
        self._prober = mavlink.MAVLink(None, srcSystem=vehicle_sysid, srcComponent=PROBE_COMPID)
        seal = None if self.peer is None else _Key(self.peer, clocks)
        self._autopilot = mavlink.MAVLink(None, srcSystem=vehicle_sysid, srcComponent=AUTOPILOT_COMPID)
        #: when a frame of the station was last accepted, and when a sender was last told why its frames are rejected
        self.frames_at = self._explained_at = -inf
        self._bundle = LinkBundle(links, self._probe, secrets.randbits, config.limits, seal)

    @property
    def target(self) -> tuple[int, int]:
        """System and component to address."""
        return self.sysid, self.component

    def spoke(self, component: int) -> None:
        """Note the component of the station's own messages."""
        self.component = component

    def record_heartbeat(self, heartbeat: Frame, now: float) -> None:
        """Note a heartbeat of the station itself."""
        self.spoke(heartbeat.compid)
        if now - self.heartbeat_at >= ANEW_S:
            self.capabilities.silence_ends(now)
        self._heard_since = self.heard_since(now)
        self.heartbeat, self.heartbeat_at = heartbeat.raw, now

    def heard_since(self, now: float) -> float:
        """Since when the station's heartbeats have come without an interruption; `now` if they do not."""
        return now if now - self.heartbeat_at > _INTERRUPTED_S else self._heard_since

    def read(self, link: Device, now: float, once: bool = False) -> list[Frame]:
        """Frames that arrived on `link`, without copies from another link and without answers to probes.

        `once`: see `link.base.Device.read`.

        Frames with another sender's ids are included: the gate drops and counts them. They change neither the link's
        measurements nor the address that it answers.
        """
        kept = []
        sysids, peer, bundle = self.identity.sysids, self.peer, self._bundle
        for frame in bundle.read(link, now, once):
            if frame.sysid not in sysids:
                self._explain(link, frame, _FOREIGN, now)
            else:
                if peer is not None:
                    verdict = peer.check(frame, self._clocks.utc(), now)
                    if verdict is not SignatureVerdict.OK:
                        self._reject(link, frame, verdict, now)
                        continue
                if not bundle.accept(link, frame, now):
                    continue
                self.frames_at = now
            kept.append(frame)
        return kept

    def proves(self, frame: Frame) -> bool:
        """Whether a frame from `read` was signed with the station's key."""
        return self.peer is not None and frame.sysid in self.identity.sysids

    def _reject(self, link: Device, frame: Frame, verdict: SignatureVerdict, now: float) -> None:
        """Count and keep a frame that is not proven to be the station's."""
        self._bundle.bad_signature(link, now)
        self.bad_signatures[verdict] += 1
        self.rejected.append((frame, verdict))
        self._explain(link, frame, _UNPROVEN.get(verdict, ""), now)

    def _explain(self, link: Device, frame: Frame, why: str, now: float) -> None:
        """Tell the sender of a rejected frame why, while the station is not heard otherwise.

        Its program cannot learn that in another way: a listening link does not answer rejected frames. The text is
        unsigned, because such a program cannot check a signature, and rare, because the sender may be any program.
        """
        if not why or now - self._explained_at < _EXPLAIN_S or now - self.heartbeat_at <= _HEARD_S:
            return
        self._explained_at = now
        text = why.format(name=self.name, sysid=self.sysid, other=frame.sysid)
        for message in marked_texts(text, mavlink.MAV_SEVERITY_WARNING, 1):
            link.reply(frame, codec.pack(message, self._autopilot))

    def send(self, message: Any, *, everywhere: bool = False) -> None:
        """Send a message of the companion's own: on the best link, or on every one."""
        data = codec.pack(message, self._language if message.get_msgId() in OUR_MESSAGES else self._encoder)
        if everywhere:
            self.write_all(data)
        else:
            self.write(data)

    def write(self, data: bytes) -> None:
        """Send a frame on the best link, numbered and signed for it (what is signed must be MAVLink 2)."""
        self._bundle.write(data)

    def write_more(self, data: bytes) -> bool:
        """Send a frame of a download, of which more follow; False if the link does not take it now."""
        return self._bundle.write_more(data)

    def flush(self) -> None:
        """Send the frames that `write_more` kept."""
        self._bundle.flush()

    @property
    def flow_controlled(self) -> bool:
        """Whether the link refuses what the station cannot take yet."""
        return self._bundle.flow_controlled

    def write_all(self, data: bytes) -> None:
        """Send a frame on every link: transfer messages must get through."""
        self._bundle.write_all(data)

    def tick(self, now: float) -> list[LinkEvent]:
        """Probe the links and evaluate the measurements. To be called often. Returns what changed."""
        events = self._bundle.tick(now)
        for event in events:
            if event.kind is not LinkEventKind.SWITCHED and event.measure is not None:
                over = self._over.setdefault(event.device, set())
                (over.add if event.kind is LinkEventKind.DEGRADED else over.discard)(event.measure)
        return events

    @property
    def weak(self) -> bool:
        """Whether every link exceeds a limit of its quality."""
        return all(self._over.get(link.device, set()) - _OF_OTHERS for link in self.links)

    @property
    def attacked(self) -> bool:
        """Whether bad signatures arrive on a link at a rate that is no accident."""
        return any(Measure.BAD_SIGNATURES in over for over in self._over.values())

    def quality(self, link: Device, now: float) -> LinkQuality:
        """The measurements of one link."""
        return self._bundle.quality(link, now)

    def carries(self, link: Device) -> bool:
        """Whether this is the link for frames that go out on the best one."""
        return self._bundle.carries(link)

    def close(self) -> None:
        """Close all links."""
        self._bundle.close()

    def _probe(self, stamp: int) -> bytes:
        return codec.pack(probe_message(stamp), self._prober)


def open_ports(
    configs: tuple[StationLinks, ...],
    vehicle_sysid: int,
    clocks: Clocks,
    keys: Mapping[str, StationKeys] | None = None,
    names: Names | None = None,
    *,
    strict: bool = True,
) -> dict[int, StationPort]:
    """Open every link of every station, or none. Raises LinkError, KeysError (two with the same key, for one).

    `keys`: by the name of the station. `strict` False: a link that cannot be opened is no error; it is closed, and
    opened later.
    """
    keys, names = keys or {}, names or Names()
    check_distinct(keys)
    ports: dict[int, StationPort] = {}
    opened: list[Device] = []
    try:
        for config in configs:
            links = []
            for device in config.links:
                links.append(open_link(device, names, strict=strict))
                opened.append(links[-1])
            name = config.station.name
            ports[config.station.sysid] = StationPort(config, tuple(links), vehicle_sysid, keys.get(name), clocks)
    except LinkError:
        for link in opened:
            link.close()
        raise
    return ports
