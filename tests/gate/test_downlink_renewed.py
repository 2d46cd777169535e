# SPDX-License-Identifier: GPL-3.0-or-later

"""A window that is asked for again is as good as new."""

from __future__ import annotations

from collections.abc import Callable

from mavproxy_handover.core.common.model import AuthorityView, LeaseState, Phase
from mavproxy_handover.gate.downlink import DownlinkPolicy
from mavproxy_handover.gate.judge import StationIdentity
from mavproxy_handover.wire.frames import Frame

MISSION = AuthorityView(Phase.ON_MISSION, 251, None, 1, LeaseState.HELD)


def test_who_asks_for_a_list_again_before_it_ended_gets_its_whole_time_again(make: Callable[..., Frame]) -> None:
    policy = DownlinkPolicy([StationIdentity(251, frozenset({251})), StationIdentity(252, frozenset({252}))])
    value = make("PARAM_VALUE", sysid=1, compid=1)
    policy.asked(make("PARAM_REQUEST_LIST", sysid=252), 252, 0.0)
    heard = []
    for second in range(0, 800, 4):
        if second == 200:
            policy.asked(make("PARAM_REQUEST_LIST", sysid=252), 252, 200.0)
        if policy.receivers(value, [252], MISSION, float(second)) == [252]:
            heard.append(second)
    assert heard == list(range(0, 501, 4))
