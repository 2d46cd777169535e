# SPDX-License-Identifier: GPL-3.0-or-later

"""A frame that names somebody else on a signed link: dropped for its name, and nothing is said of the station's key."""

from __future__ import annotations

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.judge import GateReason
from tests.module.test_signed import SignedBench, sign_with, signed  # noqa: F401 (a fixture)


def test_it_is_no_bad_signature(signed: SignedBench) -> None:  # noqa: F811
    signed.connect()
    port = signed.companion.ports[251]
    sign_with(signed.a, None)
    counts = signed.companion.gate.counts[251]
    before = counts.copy()
    signed.a.alive = False
    signed.a.own.srcSystem = 77
    signed.a.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 1))
    signed.run(0.2)
    told = counts - before
    assert list(told) == [GateReason.SPOOFED_STATION]
    assert port.quality(port.links[0], signed.clock.now).bad_signatures == 0
