# SPDX-License-Identifier: GPL-3.0-or-later

"""The keyed tag: with a key on the card only leases of somebody who knows it count."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from lupa import lua53

from tests.depth import first
from tests.lua.stub import AUTO, GUARD, RTL, Bench, stated
from tests.wire.half_siphash_vectors import KEY as VECTOR_KEY
from tests.wire.half_siphash_vectors import VECTORS

WAITING, LIVE, EXPIRED = 1, 2, 3
KEY = bytes(range(7, 39))
OTHER_KEY = bytes(range(8, 40))


def keyed_bench(folder: Path, content: str = KEY.hex() + "\n", **options: Any) -> Bench:
    """The guard with a file handover.key beside it; the companion has the right key."""
    scripts = folder / "scripts"
    scripts.mkdir()
    shutil.copy(GUARD, scripts)
    (scripts / "handover.key").write_text(content)
    bench = Bench(guard=scripts / GUARD.name, **options)
    bench.companion.key = KEY
    return bench


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return keyed_bench(tmp_path)


def refused(bench: Bench, frame: bytes) -> bool:
    """Whether the guard counts the frame as refused and takes nothing from it."""
    bench.run(600)
    before = bench.status
    assert bench.receive(frame)
    bench.run(600)
    after = bench.status
    taken = (after.nonce, after.sequence, after.epoch) != (before.nonce, before.sequence, before.epoch)
    return not taken and after.rejected == before.rejected + 1


@pytest.fixture(scope="module")
def half_siphash() -> Any:
    """The function of the shipped script, alone."""
    source = GUARD.read_text(encoding="utf-8")
    function = re.search(r"^local (function half_siphash\(.*?\n)end\n", source, re.MULTILINE | re.DOTALL)
    assert function is not None
    lua = lua53.LuaRuntime(encoding="latin-1")
    return lua.execute(f"{function[0]}\nreturn half_siphash")


@pytest.mark.parametrize("length", range(64))
def test_published_vectors(half_siphash: Any, length: int) -> None:
    k0, k1 = int.from_bytes(VECTOR_KEY[:4], "little"), int.from_bytes(VECTOR_KEY[4:], "little")
    halves = half_siphash(k0, k1, bytes(range(length)).decode("latin-1"))
    assert b"".join((half & 0xFFFFFFFF).to_bytes(4, "little") for half in halves) == VECTORS[length]


def test_lease_with_the_right_tag_is_accepted(bench: Bench) -> None:
    bench.with_lease()
    bench.run(600)
    assert (bench.status.state, bench.status.rejected) == (LIVE, 0)
    assert bench.may_arm


def test_tags_are_right_for_any_content(bench: Bench) -> None:
    """Words with the sign bit set, and a tag whose last bytes are zero and so are not sent."""
    for number in range(300):
        bench.companion.epoch += 0x00777777
        bench.companion.sequence += 0x00123457
        bench.receive(bench.companion.lease(ttl_ms=0x8000 + number))
        bench.run(100)
    bench.run(600)
    assert (bench.status.state, bench.status.rejected) == (LIVE, 0)


def test_lease_without_a_tag_is_refused_and_the_arming_check_says_why(bench: Bench) -> None:
    bench.companion.key = None
    assert refused(bench, bench.companion.lease())
    assert "HNDO: lease refused, no tag" in bench.texts
    assert bench.refusal == "HNDO: lease refused, no tag"


def test_lease_with_the_tag_of_another_key_is_refused(bench: Bench) -> None:
    bench.companion.key = OTHER_KEY
    assert refused(bench, bench.companion.lease())
    assert bench.refusal == "HNDO: lease refused, tag"


def test_tag_for_another_vehicle_is_refused(bench: Bench) -> None:
    assert refused(bench, bench.companion.lease(tag_for=2))


@pytest.mark.parametrize("position", range(2, 28))
def test_every_byte_of_lease_and_tag_counts(bench: Bench, position: int) -> None:
    """All but version and state, which are refused by themselves."""
    lease = bytearray(bench.companion.lease()[15:43])
    lease[position] ^= 0x04
    assert refused(bench, bench.companion.tunnel(bytes(lease)))


def test_flag_and_length_must_agree(bench: Bench) -> None:
    tagged = bench.companion.lease()[15:43]
    assert refused(bench, bench.companion.tunnel(tagged, length=20))
    assert refused(bench, bench.companion.tunnel(tagged + b"\x01", length=28))
    assert refused(bench, bench.companion.lease(flags=0))
    plain = Bench()
    assert refused(plain, plain.companion.lease(flags=1))


def test_recorded_lease_is_refused_although_its_tag_is_right(bench: Bench) -> None:
    recorded = bench.companion.lease()
    bench.receive(recorded)
    bench.run(100)
    bench.receive(bench.companion.lease())
    assert refused(bench, recorded)


def test_without_a_key_on_the_card_a_tag_is_not_asked_for_and_does_no_harm() -> None:
    bench = Bench()
    bench.companion.key = KEY
    bench.with_lease()
    assert bench.status.state == LIVE


def test_untagged_leases_do_not_keep_a_flight_alive(bench: Bench) -> None:
    bench.fly(AUTO)
    bench.companion.key = None
    bench.run(4000)
    assert bench.vehicle.mode == RTL


@pytest.mark.parametrize(
    "content", ["", "\n", KEY.hex()[:-1], KEY.hex() + "0", "g" * 64, KEY.hex() + " x", "0x" + KEY.hex()[2:], "k" * 5000]
)
def test_a_key_file_that_cannot_be_used_lets_no_lease_through(tmp_path: Path, content: str) -> None:
    bench = keyed_bench(tmp_path, content)
    assert "HNDO: handover.key cannot be used" in bench.texts
    assert refused(bench, bench.companion.lease())
    assert bench.refusal == "HNDO: lease refused, key file"
    bench.companion.key = None
    assert refused(bench, bench.companion.lease())


@pytest.mark.parametrize("first", [0x10, 0xA7, 0xE0])
def test_any_digits_make_a_key(tmp_path: Path, first: int) -> None:
    key = bytes(range(first, first + 32))
    bench = keyed_bench(tmp_path, key.hex())
    bench.companion.key = key
    bench.with_lease()
    assert bench.status.state == LIVE


@pytest.mark.parametrize("content", [KEY.hex(), KEY.hex().upper() + "\r\n", f"  {KEY.hex()}\n\n"])
def test_a_key_file_is_read_however_it_was_typed(tmp_path: Path, content: str) -> None:
    bench = keyed_bench(tmp_path, content)
    bench.with_lease()
    assert bench.status.state == LIVE
    assert "HNDO: handover guard" in bench.texts[0]
    assert bench.texts[0].endswith("loaded, key")


def test_firmware_without_files_is_a_guard_without_a_key() -> None:
    bench = Bench(absent=["io"])
    bench.with_lease()
    assert bench.status.state == LIVE


class TestInstructionBudget:
    """As in test_guard_standing: far below the 10 000 VM instructions that end a script."""

    LIMIT = 6500

    @pytest.mark.parametrize("key", first(1, [KEY, OTHER_KEY]))
    def test_full_queue_of_tagged_leases(self, tmp_path: Path, key: bytes) -> None:
        bench = keyed_bench(tmp_path, count_instructions=True)
        bench.fly()
        bench.companion.key = key
        for _ in range(50):
            for _ in range(30):
                bench.receive(bench.companion.lease(ttl_ms=0x7FFF))
            bench.run(100)
        assert 3000 < bench.most_instructions < self.LIMIT
        assert bench.most_instructions <= stated("VM instructions in one call, at the worst")[1]
        assert bench.vehicle.removed == []

    def test_queue_that_fills_again_and_again_after_a_stall(self, tmp_path: Path) -> None:
        """The queue is read once in a call, also in the one that ends the catching up."""
        bench = keyed_bench(tmp_path, count_instructions=True)
        bench.fly()
        bench.vehicle.now_ms += 5000
        for _ in range(30):
            for _ in range(30):
                bench.receive(bench.companion.lease(ttl_ms=0x7FFF))
            bench.run(10)
        assert bench.vehicle.removed == []
        assert bench.most_instructions <= stated("VM instructions in one call, at the worst")[1]

    def test_stalled_script_hears_a_full_queue_before_it_judges(self, tmp_path: Path) -> None:
        bench = keyed_bench(tmp_path)
        bench.fly()
        for _ in range(24):
            bench.vehicle.now_ms += 200
            bench.receive(bench.companion.lease())
        bench.run(300)
        assert bench.vehicle.mode == AUTO
        assert bench.vehicle.mode_requests == []
