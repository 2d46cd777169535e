# SPDX-License-Identifier: GPL-3.0-or-later

"""The ranges of mission.toml, in missions that ship."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mavproxy_handover.mission import package
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.keys import MISSION_KEYS

MISSIONS = Path(__file__).resolve().parents[2] / "missions"


def changed(name: str, was: str, now: str) -> package.MissionPackage:
    """A mission that ships, with something in its mission.toml changed."""
    texts = {
        path.name: path.read_text(encoding="utf-8") for path in (MISSIONS / name).iterdir() if path.suffix != ".png"
    }
    text = re.sub(was, now, texts["mission.toml"], count=1, flags=re.MULTILINE)
    assert text != texts["mission.toml"]
    return package.from_texts(texts | {"mission.toml": text}, name)


@pytest.mark.parametrize(
    ("name", "key", "good", "bad"),
    [
        ("delivery", "expected_handovers", ("0", "1000"), ("-1", "1001")),
        ("delivery", "cruise_speed_mps", ("0.1", "100"), ("0.09", "100.1")),
        ("corridor", "corridor_m", ("5", "10000"), ("4.9", "10001")),
        ("ridge", "limit_s", ("1", "600"), ("0.9", "601")),
        ("delivery", "sysid", ("1", "255"), ("0", "256")),
    ],
)
def test_both_ends_of_a_range_are_allowed_and_nothing_beyond(
    name: str, key: str, good: tuple[str, str], bad: tuple[str, str]
) -> None:
    for value in good:
        changed(name, rf"^{key} = .*$", f"{key} = {value}")
    for value in bad:
        with pytest.raises(MissionError, match=key):
            changed(name, rf"^{key} = .*$", f"{key} = {value}")


def test_every_key_says_what_it_means() -> None:
    assert [key.name for table in MISSION_KEYS for key in table.keys if not key.says] == []
