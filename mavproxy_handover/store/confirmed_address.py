# SPDX-License-Identifier: GPL-3.0-or-later

"""The vehicle's address that a station's operator confirmed, in a file beside the station's configuration.

The file is read as strictly as a message from a link. A damaged or foreign file counts as no address.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mavproxy_handover.store.durable import replace_whole
from mavproxy_handover.wire.vehicle_address import VehicleAddress, parse_address, plain_text

__all__ = ["ConfirmedAddress", "address_file", "keep_address", "kept_address"]

_FILE_BYTES: Final = 4096


@dataclass(frozen=True, slots=True)
class ConfirmedAddress:
    """Paths to the vehicle. `sender`: name of the station that sent them. `at`: time in UTC, for display only."""

    addresses: tuple[VehicleAddress, ...]
    sender: str
    mission: str
    at: str

    @property
    def text(self) -> str:
        """The addresses in pymavlink's form."""
        return ", ".join(address.text for address in self.addresses)


def address_file(configuration: Path, station: str, vehicle: int) -> Path:
    """Path of the file in which a station keeps the address of the vehicle with this system id."""
    return configuration.with_name(f"{station}-vehicle-{vehicle}.address")


def kept_address(file: Path) -> ConfirmedAddress | None:
    """Read the confirmed addresses; None if there are none. Raises ValueError, OSError."""
    try:
        with file.open("rb") as stream:
            data = stream.read(_FILE_BYTES + 1)
    except FileNotFoundError:
        return None
    if len(data) > _FILE_BYTES:
        raise ValueError(f"larger than {_FILE_BYTES} bytes")
    try:
        kept = json.loads(data)
        listed = tuple(parse_address(text) for text in kept["addresses"])
        sender, mission, at = (plain_text(kept[key]) for key in ("from", "mission", "confirmed"))
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(f"not what this program wrote ({type(error).__name__})") from None
    if not listed:
        raise ValueError("no address in it")
    return ConfirmedAddress(listed, sender, mission, at)


def keep_address(file: Path, confirmed: ConfirmedAddress | None) -> None:
    """Write the file, or remove it if `confirmed` is None. Raises OSError."""
    if confirmed is None:
        file.unlink(missing_ok=True)
        return
    kept = {
        "addresses": [address.text for address in confirmed.addresses],
        "from": confirmed.sender,
        "mission": confirmed.mission,
        "confirmed": confirmed.at,
    }
    replace_whole(file, (json.dumps(kept, indent=1) + "\n").encode())
