# SPDX-License-Identifier: GPL-3.0-or-later

"""Whatever a station hears, from whomever: it does not raise, and it never says what is not its own to say."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_module.core import (
    Answer,
    AuthorityHeard,
    Event,
    FromPeer,
    FromVehicle,
    MissionHeld,
    Notice,
    PeerHeard,
    StationCore,
    ToPeer,
    VehicleHeard,
)
from mavproxy_handover.core.common.messages import (
    Connect,
    ConnectAck,
    ConnectHandover,
    DisconnectHandover,
    DroneConnected,
    HandoverRequest,
    HandoverResult,
    Message,
    OkHandover,
    OnHandover,
    TransferKey,
)
from mavproxy_handover.core.common.model import (
    AUTOMATIC,
    Consent,
    Outcome,
    Phase,
    Reason,
    Station,
)

ME, OTHER, THIRD = 251, 252, 253

sysids = st.sampled_from([ME, ME, OTHER, OTHER, THIRD, 0, 1, 255])
commanders = st.one_of(st.none(), sysids)
epochs = st.sampled_from([0, 1, 1, 2, 2, 3, 0xFFFFFFFF])
keys = st.builds(TransferKey, sysids, sysids, st.sampled_from([0, 1, 1, 2, 3, 32768, 65535]), epochs)
consents = st.sampled_from(Consent)
reasons = st.sampled_from(Reason)
digests = st.sampled_from([b"", bytes(32), bytes(range(32))])
nonces = st.sampled_from([0, 1, 0xFFFFFFFF])
versions = st.sampled_from([0, 1, 255])
names = st.sampled_from(["", "drone", "\x00" * 20, "é" * 10])
messages: st.SearchStrategy[Message] = st.one_of(
    st.builds(OnHandover, keys, consents, reasons, st.booleans(), st.booleans()),
    st.builds(OkHandover, keys, consents, reasons),
    st.builds(DroneConnected, keys, st.booleans(), st.booleans()),
    st.builds(DisconnectHandover, keys),
    st.builds(HandoverRequest, keys, reasons),
    st.builds(ConnectHandover, keys),
    st.builds(HandoverResult, keys, commanders, st.sampled_from(Outcome), reasons),
    st.builds(Connect, sysids, versions, nonces, epochs, commanders, names, digests),
    st.builds(ConnectAck, sysids, versions, nonces, epochs, commanders, names, digests, st.booleans()),
)
events: st.SearchStrategy[Event] = st.one_of(
    st.builds(FromVehicle, messages),
    st.builds(FromVehicle, messages),
    st.builds(FromPeer, sysids, messages),
    st.builds(PeerHeard, sysids),
    st.just(VehicleHeard()),
    st.builds(AuthorityHeard, st.sampled_from(Phase), commanders, commanders, epochs, st.sampled_from([0, 1, 2])),
    st.builds(MissionHeld, digests),
    st.builds(Answer, st.booleans()),
)


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(st.sampled_from([0.0, 0.1, 2.0, 5.0]), events), max_size=40), st.booleans())
def test_anything(story: list[tuple[float, Event]], asks: bool) -> None:
    peers = (Station(OTHER, "GCSB"), Station(THIRD, "GCSC"))
    core = StationCore(Station(ME, "GCSA"), "drone", peers, automatic=() if asks else AUTOMATIC)
    now, consented = 0.0, set()
    said_yes = False
    for wait_s, event in story:
        now += wait_s
        epoch = core.epoch
        asked = core.question
        actions = core.handle(event, now) + core.tick(now)
        assert core.epoch >= epoch or epoch > 0x7FFFFFFF, "only an epoch of no flight is forgotten"
        said_yes = said_yes or (isinstance(event, Answer) and event.yes and asked is not None)
        for action in actions:
            if isinstance(action, Notice):
                assert action.text.isprintable()
                continue
            word = action.message
            # a station speaks as itself: as partner of steps 2 and 5, as commander of 3 and 6, nothing else
            assert isinstance(word, (ConnectAck, OnHandover, DroneConnected, OkHandover, DisconnectHandover))
            if isinstance(word, ConnectAck):
                assert word.station == ME
                continue
            assert word.key.epoch >= epoch or epoch > 0x7FFFFFFF
            if isinstance(word, (OnHandover, DroneConnected)):
                assert word.key.to_station == ME
            else:
                assert word.key.from_station == ME
            if isinstance(action, ToPeer):
                assert action.peer == word.key.from_station
                assert isinstance(word, (OnHandover, DroneConnected))
            if isinstance(word, (OnHandover, OkHandover)) and word.consent is Consent.GRANTED:
                assert said_yes or not asks
                consented.add((type(word), word.key))
            if isinstance(word, DroneConnected):
                assert said_yes or not asks
            if isinstance(word, DisconnectHandover):
                assert (OkHandover, word.key) in consented
