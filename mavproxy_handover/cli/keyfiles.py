# SPDX-License-Identifier: GPL-3.0-or-later

"""Keyfiles of NetworkManager for the two ways to the stations: the same routing tables as those of networkd.

`machine.files` makes the files of networkd. Where NetworkManager runs, it would take the interfaces away from networkd,
so it gets connections of its own. Rules:

1. A wired interface is `ethernet`, one whose name begins with `wl` is `wifi`, and `wwan` or `cdc-wdm` is `gsm`.
2. A Wi-Fi connection needs the network's name. Its passphrase is never an option of the command: NetworkManager asks
   for it (`nmcli --ask connection up handover-wifi`), and keeps it in the file. So such a file is kept when install
   runs again.
3. A modem's connection names no interface: NetworkManager knows modems by their control port.
"""

from __future__ import annotations

import re
from pathlib import PurePosixPath
from typing import Final

from mavproxy_handover.cli.machine import TABLES, Item, Uplink
from mavproxy_handover.config.files import ConfigError

__all__ = ["FOLDER", "keyfile"]

FOLDER: Final = PurePosixPath("/etc/NetworkManager/system-connections")
_SSID: Final = re.compile(r"[^\x00-\x1f\x7f;\\]{1,32}")


def _kind(interface: str) -> str:
    if interface.startswith("wl"):
        return "wifi"
    return "gsm" if interface.startswith(("wwan", "cdc-wdm")) else "ethernet"


def keyfile(way: Uplink, ssid: str | None) -> Item:
    """The connection of an uplink. `ssid`: the name of the Wi-Fi network. Raises ConfigError, one line."""
    kind, name = _kind(way.interface), f"handover-{way.role}"
    lines = ["[connection]", f"id={name}", f"type={kind}", "autoconnect-priority=10"]
    if kind != "gsm":
        lines.append(f"interface-name={way.interface}")
    lines += ["", *_of_kind(kind, way, ssid), "[ipv4]", *_addresses(way), "", "[ipv6]", "method=disabled"]
    head = f"# Written by 'handover install': {way.role}, with routing table {TABLES[way.role]}"
    text = "\n".join([head, *lines]) + "\n"
    return Item(FOLDER / f"{name}.nmconnection", text, 0o600, kept=kind == "wifi")


def _of_kind(kind: str, way: Uplink, ssid: str | None) -> list[str]:
    if kind == "gsm":
        return ["[gsm]", "auto-config=true", ""]
    if kind != "wifi":
        return []
    if ssid is None:
        raise ConfigError(f"--{way.role} {way.interface}: NetworkManager runs here: name the Wi-Fi with --ssid NAME")
    if not _SSID.fullmatch(ssid):
        raise ConfigError(f"--ssid {ssid!r}: 1 to 32 letters, without ';' and '\\'")
    return ["[wifi]", f"ssid={ssid}", "", "[wifi-security]", "key-mgmt=wpa-psk", ""]


def _addresses(way: Uplink) -> list[str]:
    """Address and routes, all in the table of this way, with the rules that lead there."""
    table = TABLES[way.role]
    rules = [_rule(900 + table, "0.0.0.0/0", table, way.interface)]
    if way.address is None:
        lines = ["method=auto"]
    else:
        gateway = "" if way.gateway is None else f",{way.gateway}"
        lines = ["method=manual", f"address1={way.address}{gateway}"]
        rules.append(_rule(900 + table, f"{way.address.ip}/32", table))
    rules.append(_rule(33000 + table, "0.0.0.0/0", table))
    numbered = [f"routing-rule{number}={rule}" for number, rule in enumerate(rules, start=1)]
    return [*lines, f"route-table={table}", "may-fail=true", *numbered]


def _rule(priority: int, source: str, table: int, interface: str | None = None) -> str:
    """A rule of policy routing, in NetworkManager's words."""
    leaving = () if interface is None else ("oif", interface)
    return " ".join(("priority", str(priority), "from", source, *leaving, "table", str(table)))
