# SPDX-License-Identifier: GPL-3.0-or-later

"""Payload authority: flight authority's, a name's, or that of the station which asked."""

from __future__ import annotations

from mavproxy_handover.core.authority.payload import FLIGHT, REQUEST, PayloadAuthority, PayloadSettings


def authority(control: str = FLIGHT, at_handover: str = "release", silent: tuple[str, ...] = ()) -> PayloadAuthority:
    payload = PayloadAuthority(PayloadSettings(control, at_handover), lambda name: name not in silent)
    payload.authority_moved("GCSA")
    return payload


def test_it_follows_flight_authority_by_default() -> None:
    payload = authority()
    assert payload.holder == "GCSA"
    payload.authority_moved("GCSB")
    assert payload.holder == "GCSB"
    payload.authority_moved("")
    assert payload.holder == ""
    assert payload.request("GCSA") == "payload authority is that of flight by the vehicle's file"
    assert payload.release("GCSA") == "it has no payload authority that was requested"


def test_a_name_keeps_it_over_handovers() -> None:
    payload = authority("camera-crew")
    payload.authority_moved("GCSB")
    assert payload.holder == "camera-crew"
    assert payload.request("camera-crew") == ""
    assert payload.request("GCSB") == "payload authority is camera-crew by the vehicle's file"


def test_a_station_that_asks_gets_it_until_it_releases_it() -> None:
    payload = authority(REQUEST)
    assert payload.holder == "GCSA"
    assert payload.request("GCSB") == ""
    assert payload.holder == "GCSB"
    assert payload.request("GCSC") == "GCSB has it; it must release it first"
    assert payload.release("GCSC") == "it has no payload authority that was requested"
    assert payload.release("GCSB") == ""
    assert payload.holder == "GCSA"
    assert payload.request("GCSC") == ""


def test_the_commander_always_gets_it_and_others_from_a_silent_holder() -> None:
    payload = authority(REQUEST)
    assert payload.request("GCSB") == ""
    assert payload.request("GCSA") == ""
    assert payload.holder == "GCSA"
    payload = authority(REQUEST, silent=("GCSB",))
    assert payload.request("GCSB") == ""
    assert payload.request("GCSC") == ""
    assert payload.holder == "GCSC"


def test_a_handover_of_flight_authority_releases_or_keeps_it() -> None:
    for at_handover, holder in (("release", "GCSC"), ("keep", "GCSB")):
        payload = authority(REQUEST, at_handover)
        assert payload.request("GCSB") == ""
        payload.authority_moved("GCSA")
        assert payload.holder == "GCSB", "the same commander is no handover"
        payload.authority_moved("GCSC")
        assert payload.holder == holder
