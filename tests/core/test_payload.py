# SPDX-License-Identifier: GPL-3.0-or-later

"""Payload authority: flight authority's, a name's, or that of the station which asked, for each kind by itself."""

from __future__ import annotations

import pytest

from mavproxy_handover.core.authority.payload import (
    FLIGHT,
    REQUEST,
    PayloadAuthority,
    PayloadKind,
    PayloadRules,
    PayloadSettings,
)

GIMBAL, CAMERA, WINCH = PayloadKind


def ruled(settings: PayloadSettings, silent: tuple[str, ...] = ()) -> PayloadAuthority:
    payload = PayloadAuthority(lambda: settings, lambda name: name not in silent)
    payload.authority_moved("GCSA")
    return payload


def authority(control: str = FLIGHT, at_handover: str = "release", silent: tuple[str, ...] = ()) -> PayloadAuthority:
    return ruled(PayloadSettings(PayloadRules(control, at_handover)), silent)


def test_by_default_it_is_flight_authoritys() -> None:
    for payload in (authority(), ruled(PayloadSettings())):
        assert payload.holder(GIMBAL) == "GCSA"
        payload.authority_moved("GCSB")
        assert payload.holder(GIMBAL) == "GCSB"
        payload.authority_moved("")
        assert payload.holder(GIMBAL) == ""
        assert payload.request(GIMBAL, "GCSA") == "gimbal authority is that of flight by the vehicle's file"
        assert payload.release(GIMBAL, "GCSA") == "it has no gimbal authority that was requested"


def test_a_named_station_or_program_has_it_whoever_commands() -> None:
    payload = authority("camera-crew")
    payload.authority_moved("GCSB")
    assert payload.holder(CAMERA) == "camera-crew"
    assert payload.request(CAMERA, "camera-crew") == ""
    assert payload.request(CAMERA, "GCSB") == "camera authority is camera-crew's by the vehicle's file"


def test_a_station_asks_for_it_and_gives_it_back() -> None:
    payload = authority(REQUEST)
    assert payload.holder(WINCH) == "GCSA"
    assert payload.request(WINCH, "GCSB") == ""
    assert payload.holder(WINCH) == "GCSB"
    assert payload.request(WINCH, "GCSC") == "GCSB has winch authority; it must release it first"
    assert payload.release(WINCH, "GCSC") == "it has no winch authority that was requested"
    assert payload.release(WINCH, "GCSB") == ""
    assert payload.holder(WINCH) == "GCSA"
    assert payload.request(WINCH, "GCSC") == ""


def test_the_commander_and_who_finds_the_holder_silent_get_it() -> None:
    payload = authority(REQUEST)
    assert payload.request(GIMBAL, "GCSB") == ""
    assert payload.request(GIMBAL, "GCSA") == ""
    assert payload.holder(GIMBAL) == "GCSA"
    payload = authority(REQUEST, silent=("GCSB",))
    assert payload.request(GIMBAL, "GCSB") == ""
    assert payload.request(GIMBAL, "GCSC") == ""
    assert payload.holder(GIMBAL) == "GCSC"


def test_a_handover_of_flight_authority_releases_or_keeps_it() -> None:
    for at_handover, holder in (("release", "GCSC"), ("keep", "GCSB")):
        payload = authority(REQUEST, at_handover)
        assert payload.request(GIMBAL, "GCSB") == ""
        payload.authority_moved("GCSA")
        assert payload.holder(GIMBAL) == "GCSB", "the same commander is no handover"
        payload.authority_moved("GCSC")
        assert payload.holder(GIMBAL) == holder


def test_each_kind_has_an_authority_of_its_own() -> None:
    payload = ruled(PayloadSettings(PayloadRules(REQUEST, None, {CAMERA: "GCSC", WINCH: FLIGHT})))
    assert payload.request(GIMBAL, "GCSB") == ""
    assert [payload.holder(kind) for kind in PayloadKind] == ["GCSB", "GCSC", "GCSA"]
    assert payload.request(CAMERA, "GCSB") == "camera authority is GCSC's by the vehicle's file"
    payload.authority_moved("GCSB")
    assert [payload.holder(kind) for kind in PayloadKind] == ["GCSB", "GCSC", "GCSB"]


@pytest.mark.parametrize(
    ("vehicle", "mission", "found"),
    [
        (PayloadRules(), PayloadRules(), (FLIGHT, FLIGHT, FLIGHT)),
        (PayloadRules("GCSA"), PayloadRules(), ("GCSA", "GCSA", "GCSA")),
        (PayloadRules("GCSA"), PayloadRules(FLIGHT), (FLIGHT, FLIGHT, FLIGHT)),
        (PayloadRules(None, None, {GIMBAL: "GCSA"}), PayloadRules("GCSB"), ("GCSB", "GCSB", "GCSB")),
        (PayloadRules("GCSA"), PayloadRules(None, None, {CAMERA: REQUEST}), ("GCSA", REQUEST, "GCSA")),
    ],
)
def test_the_mission_goes_before_the_vehicle(
    vehicle: PayloadRules, mission: PayloadRules, found: tuple[str, str, str]
) -> None:
    settings = PayloadSettings(vehicle, mission)
    assert tuple(settings.control(kind) for kind in PayloadKind) == found
    assert settings.follows_flight is (set(found) == {FLIGHT})


@pytest.mark.parametrize(
    ("vehicle", "mission", "found"), [(None, None, "release"), ("keep", None, "keep"), ("keep", "release", "release")]
)
def test_the_mission_says_what_a_handover_does(vehicle: str | None, mission: str | None, found: str) -> None:
    settings = PayloadSettings(PayloadRules(REQUEST, vehicle), PayloadRules(None, mission))
    assert settings.at_handover == found


def test_a_mission_that_takes_the_request_away_ends_what_was_granted() -> None:
    """Another mission may be loaded on the ground: its rule applies at once."""
    settings = [PayloadSettings(PayloadRules(REQUEST))]
    payload = PayloadAuthority(lambda: settings[0], lambda _name: True)
    payload.authority_moved("GCSA")
    assert payload.request(GIMBAL, "GCSB") == ""
    settings[0] = PayloadSettings(PayloadRules(REQUEST), PayloadRules("GCSC"))
    assert payload.holder(GIMBAL) == "GCSC"
    assert payload.request(GIMBAL, "GCSB") == "gimbal authority is GCSC's by the mission"
