# SPDX-License-Identifier: GPL-3.0-or-later

"""`guard_key` of the vehicle's configuration: leases that the guard can tell from anybody else's."""

from __future__ import annotations

from mavproxy_handover.store.keys import key_of, write_key
from mavproxy_handover.wire.lease_tag import lease_tag
from tests.module.conftest import Bench

KEY = key_of("correct-horse-battery-staple")


def test_every_lease_has_the_tag_of_the_key(bench: Bench) -> None:
    write_key(bench.folder / "guard.key", KEY)
    bench.configure(more='guard_key = "guard.key"')
    assert bench.load() is not None
    bench.wait(3.0)
    leases = bench.autopilot.lease_payloads()
    assert len(leases) >= 14
    for lease in leases:
        assert len(lease) == 32
        assert lease[3] == 1
        assert lease[24:] == lease_tag(KEY, 47116, (1, 1), lease[:24])


def test_without_a_key_leases_are_as_ever(bench: Bench) -> None:
    assert bench.load() is not None
    bench.run(1.0)
    assert {len(lease) for lease in bench.autopilot.lease_payloads()} == {24}


def test_a_key_that_cannot_be_used_is_said_in_one_line_and_nothing_is_loaded(bench: Bench) -> None:
    bench.configure(more='guard_key = "keys/guard.key"')
    assert bench.load() is None
    line = f"handover is not loaded: {bench.folder}/keys/guard.key: no such key file; 'handover keys make' writes one"
    assert bench.mpstate.console.lines[-1] == line
    bench.folder.joinpath("guard.key").write_text(KEY.hex())
    bench.folder.joinpath("guard.key").chmod(0o644)
    bench.configure(more='guard_key = "guard.key"')
    assert bench.load() is None
    assert "must be 0600" in bench.mpstate.console.lines[-1]
    assert KEY.hex()[:8] not in "".join(bench.mpstate.console.lines)
