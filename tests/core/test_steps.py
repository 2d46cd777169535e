# SPDX-License-Identifier: GPL-3.0-or-later

"""The steps of a transfer in words: each once in a transfer, and only messages that count."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.authority.steps import StepWords
from mavproxy_handover.core.common.messages import (
    ConnectHandover,
    DisconnectHandover,
    DroneConnected,
    HandoverRequest,
    OkHandover,
    OnHandover,
    TransferKey,
    TransferMessage,
)
from mavproxy_handover.core.common.model import AuthorityView, Consent, Phase

A, B, C = 251, 252, 253
NAMES = {A: "GCSA", B: "GCSB", C: "GCSC"}
KEY = TransferKey(A, B, 7, 3)
VIEW = AuthorityView(Phase.ON_HANDOVER, A, B, 3, handover_id=7)


def words() -> StepWords:
    return StepWords(NAMES.__getitem__)


@pytest.mark.parametrize(
    ("station", "message", "line"),
    [
        (B, OnHandover(KEY), "GCSB is ready."),
        (B, OnHandover(KEY, Consent.WAITING), "GCSB asks its operator."),
        (B, OnHandover(KEY, Consent.DENIED), "GCSB denies the handover."),
        (A, OkHandover(KEY), "OK handover received from GCSA."),
        (A, OkHandover(KEY, Consent.WAITING), "GCSA asks its operator."),
        (A, OkHandover(KEY, Consent.DENIED), "GCSA denies the handover."),
        (B, DroneConnected(KEY), "Drone connected received from GCSB."),
        (A, DisconnectHandover(KEY), "Disconnect received from GCSA."),
        # not its to say
        (A, OnHandover(KEY), ""),
        (C, OnHandover(KEY), ""),
        (B, OkHandover(KEY), ""),
        (A, DroneConnected(KEY), ""),
        (B, DisconnectHandover(KEY), ""),
        (B, HandoverRequest(KEY), ""),
        # another transfer
        (B, OnHandover(TransferKey(A, B, 6, 3)), ""),
        (B, OnHandover(TransferKey(A, B, 7, 2)), ""),
        (C, OnHandover(TransferKey(A, C, 7, 3)), ""),
    ],
)
def test_what_is_received(station: int, message: TransferMessage, line: str) -> None:
    assert words().received(station, message, VIEW) == line


def test_a_lost_commander_is_asked_nothing_so_its_late_words_are_no_steps() -> None:
    """The fault: "OK handover received from GCSA." in a forced transfer, which drops that word."""
    forced = AuthorityView(Phase.EMERGENCY, None, B, 3, handover_id=7)
    for message in (OkHandover(KEY), OkHandover(KEY, Consent.DENIED), DisconnectHandover(KEY)):
        assert words().received(A, message, forced) == ""
    assert words().received(B, DroneConnected(KEY), forced) == "Drone connected received from GCSB."


@pytest.mark.parametrize(
    ("message", "awaits", "line"),
    [
        (HandoverRequest(KEY), True, "Handover request sent to GCSB. Waiting for GCSB and GCSA."),
        (HandoverRequest(KEY), False, "Handover request sent to GCSB. Waiting for GCSB."),
        (ConnectHandover(KEY), True, "Connect handover sent to GCSB. Waiting for GCSB and GCSA."),
        (ConnectHandover(KEY), False, "Connect handover sent to GCSB. Waiting for GCSB."),
        (OnHandover(KEY, relayed=True), True, ""),
    ],
)
def test_what_is_sent(message: TransferMessage, awaits: bool, line: str) -> None:
    assert words().sent(B, message, awaits_commander=awaits) == line


def test_a_step_is_told_once_in_a_transfer_and_again_in_the_next() -> None:
    told = words()
    assert [told.sent(B, HandoverRequest(KEY), awaits_commander=True) != "" for _ in range(3)] == [True, False, False]
    assert [told.received(B, OnHandover(KEY), VIEW) != "" for _ in range(2)] == [True, False]
    following = TransferKey(A, B, 8, 3)
    assert told.sent(B, HandoverRequest(following), awaits_commander=True) != ""
    view = AuthorityView(Phase.ON_HANDOVER, A, B, 3, handover_id=8)
    assert told.received(B, OnHandover(following), view) == "GCSB is ready."
