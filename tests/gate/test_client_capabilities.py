# SPDX-License-Identifier: GPL-3.0-or-later

"""Who gets the result NOT_IN_CONTROL: who has shown to know it, and only as long as it is surely the same program."""

from __future__ import annotations

import pytest

from mavproxy_handover.gate.client_capabilities import ANEW_S, MOST, Tongue, Tongues

PROGRAM, ANOTHER = (252, 190), (242, 190)


def test_it_is_for_who_has_shown_to_know_it() -> None:
    tongues = Tongues()
    assert not tongues.knows_not_in_control(PROGRAM)
    tongues.show(PROGRAM, Tongue.STANDARD, 0.0)
    assert tongues.knows_not_in_control(PROGRAM)
    assert not tongues.knows_not_in_control(ANOTHER), "for itself alone"
    assert (tongues.of(PROGRAM), tongues.of(ANOTHER)) == (Tongue.STANDARD, Tongue.NONE)


def test_ours_may_use_the_standard_and_stays_ours() -> None:
    tongues = Tongues()
    tongues.show(PROGRAM, Tongue.STANDARD, 0.0)
    tongues.show(PROGRAM, Tongue.OURS, 1.0)
    tongues.show(PROGRAM, Tongue.STANDARD, 2.0)
    assert tongues.of(PROGRAM) is Tongue.OURS


def test_after_a_silence_it_has_to_be_shown_anew() -> None:
    tongues = Tongues()
    tongues.show(PROGRAM, Tongue.OURS, 10.0)
    tongues.show(ANOTHER, Tongue.STANDARD, 20.0)
    tongues.silence_ends(20.5)
    assert not tongues.knows_not_in_control(PROGRAM)
    assert tongues.knows_not_in_control(ANOTHER), "it was shown just now, by who is there now"
    tongues.silence_ends(20.0 + ANEW_S)
    assert not tongues.knows_not_in_control(ANOTHER)


@pytest.mark.parametrize(("policy", "knows"), [("always", True), ("never", False)])
def test_the_configuration_may_say_it(policy: str, knows: bool) -> None:
    tongues = Tongues(policy)
    assert tongues.knows_not_in_control(PROGRAM) is knows
    tongues.show(PROGRAM, Tongue.OURS, 0.0)
    assert tongues.knows_not_in_control(PROGRAM) is knows
    assert tongues.of(PROGRAM) is Tongue.OURS, "how its operator asks for control is another question"


def test_a_flood_of_senders_takes_bounded_memory() -> None:
    tongues = Tongues()
    for component in range(1, 256):
        tongues.show((252, component), Tongue.OURS, 0.0)
    known = [component for component in range(256) if tongues.knows_not_in_control((252, component))]
    assert known == list(range(1, 1 + MOST))
