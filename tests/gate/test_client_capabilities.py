# SPDX-License-Identifier: GPL-3.0-or-later

"""Who gets the result NOT_IN_CONTROL: who has shown to know it, and only as long as it is surely the same program."""

from __future__ import annotations

import pytest

from mavproxy_handover.gate.client_capabilities import ANEW_S, INSTEAD, MOST, ClientCapabilities, Dialect

PROGRAM, ANOTHER = (252, 190), (242, 190)


def test_it_is_for_who_has_shown_to_know_it() -> None:
    capabilities = ClientCapabilities()
    assert not capabilities.knows_not_in_control(PROGRAM)
    capabilities.show(PROGRAM, Dialect.STANDARD, 0.0)
    assert capabilities.knows_not_in_control(PROGRAM)
    assert not capabilities.knows_not_in_control(ANOTHER), "for itself alone"
    assert (capabilities.of(PROGRAM), capabilities.of(ANOTHER)) == (Dialect.STANDARD, Dialect.NONE)


def test_who_uses_the_standard_twice_has_not_shown_ours() -> None:
    capabilities = ClientCapabilities()
    for at in (0.0, 1.0):
        capabilities.show(PROGRAM, Dialect.STANDARD, at)
    assert capabilities.of(PROGRAM) is Dialect.STANDARD


def test_a_station_has_our_program_if_one_of_its_programs_has_shown_our_dialect() -> None:
    capabilities = ClientCapabilities()
    assert not capabilities.ours
    capabilities.show(PROGRAM, Dialect.STANDARD, 0.0)
    assert not capabilities.ours
    capabilities.show(ANOTHER, Dialect.OURS, 0.0)
    assert capabilities.ours


def test_ours_may_use_the_standard_and_stays_ours() -> None:
    capabilities = ClientCapabilities()
    capabilities.show(PROGRAM, Dialect.STANDARD, 0.0)
    capabilities.show(PROGRAM, Dialect.OURS, 1.0)
    capabilities.show(PROGRAM, Dialect.STANDARD, 2.0)
    assert capabilities.of(PROGRAM) is Dialect.OURS


def test_after_a_silence_it_has_to_be_shown_anew() -> None:
    capabilities = ClientCapabilities()
    capabilities.show(PROGRAM, Dialect.OURS, 10.0)
    capabilities.show(ANOTHER, Dialect.STANDARD, 20.0)
    capabilities.silence_ends(20.5)
    assert not capabilities.knows_not_in_control(PROGRAM)
    assert capabilities.knows_not_in_control(ANOTHER), "it was shown just now, by who is there now"
    assert ANEW_S == 5.0
    capabilities.silence_ends(20.0 + ANEW_S)
    assert not capabilities.knows_not_in_control(ANOTHER)


@pytest.mark.parametrize(("policy", "knows"), [("always", True), ("never", False)])
def test_the_configuration_may_say_it(policy: str, knows: bool) -> None:
    capabilities = ClientCapabilities(policy)
    assert capabilities.knows_not_in_control(PROGRAM) is knows
    capabilities.show(PROGRAM, Dialect.OURS, 0.0)
    assert capabilities.knows_not_in_control(PROGRAM) is knows
    assert capabilities.of(PROGRAM) is Dialect.OURS, "how its operator asks for control is another question"


def test_a_flood_of_senders_takes_bounded_memory() -> None:
    capabilities = ClientCapabilities()
    for component in range(1, 256):
        capabilities.show((252, component), Dialect.OURS, 0.0)
    known = [component for component in range(256) if capabilities.knows_not_in_control((252, component))]
    assert known == list(range(1, 1 + MOST))
    assert MOST == 16


def test_of_a_known_sender_a_new_dialect_is_noted_however_many_are_known() -> None:
    capabilities = ClientCapabilities()
    for component in range(MOST):
        capabilities.show((252, component), Dialect.STANDARD, 0.0)
    capabilities.show((252, 0), Dialect.OURS, 1.0)
    assert capabilities.of((252, 0)) is Dialect.OURS


def test_a_program_gets_no_result_that_it_does_not_know() -> None:
    not_in_control, denied, failed = 10, 2, 4
    capabilities = ClientCapabilities()
    assert dict(INSTEAD) == {not_in_control: denied}
    assert (capabilities.result(PROGRAM, not_in_control), capabilities.result(PROGRAM, failed)) == (denied, failed)
    capabilities.show(PROGRAM, Dialect.STANDARD, 0.0)
    assert capabilities.result(PROGRAM, not_in_control) == not_in_control
    assert capabilities.result(ANOTHER, not_in_control) == denied
