# SPDX-License-Identifier: GPL-3.0-or-later

"""`addresses.toml` beside `mission.toml`: the addresses at which each station reaches the vehicle.

The file is optional, and no part of the mission: the digest does not cover it. So two stations that differ only in
their addresses have the same mission. The addresses are sent beside the package (`MISSION_PACKAGE.addresses`). A
station never opens one by itself: its operator confirms it. Keys are never sent.

A damaged file costs the addresses and not the mission, because a station that restarts in flight needs the mission.
"""

from __future__ import annotations

from collections.abc import Mapping

from mavproxy_handover.mission.errors import Where
from mavproxy_handover.wire.vehicle_address import (
    ALLOWED,
    MAX_ADDRESSES,
    MAX_OF_STATION,
    Addresses,
    VehicleAddress,
    parse_address,
)

__all__ = ["ADDRESSES_FILE", "read_addresses", "without_addresses"]

ADDRESSES_FILE = "addresses.toml"


def without_addresses(fault: str) -> str:
    """The warning about a package with this fault of its addresses."""
    return f"{fault}. The mission is used without addresses of the vehicle. Put the file right, or remove it."


def read_addresses(table: Mapping[str, object], stations: Mapping[str, int], file: str = ADDRESSES_FILE) -> Addresses:
    """The addresses of a parsed `addresses.toml`. `stations`: system ids of the mission's stations by name; `file`: how
    errors name it.

    Raises MissionError.
    """
    where = Where(file)
    where.known_keys(table, ("vehicle",))
    inside = where.at("[vehicle]")
    listed = inside.table(where.need(table, "vehicle"), "vehicle")
    inside.known_keys(listed, stations)
    found = {stations[name]: _of_station(inside.at(name), value) for name, value in listed.items()}
    number = sum(len(addresses) for addresses in found.values())
    if number > MAX_ADDRESSES:
        raise inside.error(f"{number} addresses (allowed: at most {MAX_ADDRESSES} for all stations together)")
    return found


def _of_station(where: Where, value: object) -> tuple[VehicleAddress, ...]:
    listed = where.array(value, "the value")
    if not 1 <= len(listed) <= MAX_OF_STATION:
        raise where.error(f"{len(listed)} addresses (allowed: 1 to {MAX_OF_STATION}, each {ALLOWED})")
    found = []
    for number, text in enumerate(listed, 1):
        try:
            found.append(parse_address(text))
        except ValueError as error:
            raise where.at(f"address {number}").error(str(error)) from None
        if found.count(found[-1]) > 1:
            raise where.at(f"address {number}").error(f"{found[-1].text} is given twice")
    return tuple(found)
