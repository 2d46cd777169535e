# SPDX-License-Identifier: GPL-3.0-or-later

"""Files of `handover install`, made from the templates in `deploy/install` and the options.

Nothing of this machine is read, and nothing is written here: equal options give equal files everywhere.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface
from pathlib import Path, PurePosixPath
from typing import Final

from mavproxy_handover.config.files import ConfigError
from mavproxy_handover.link.forms import Kind, LinkError, parse_device
from mavproxy_handover.tools.resources import DEPLOY

__all__ = ["CONFIGURATION", "KEYS", "LINE", "STATE", "TABLES", "Item", "Uplink", "below", "files", "uplink"]

_TEMPLATES: Final = DEPLOY / "install"
#: kind -> its configuration
CONFIGURATION: Final = {
    "companion": PurePosixPath("/etc/handover/vehicle.toml"),
    "station": PurePosixPath("/etc/handover/station.toml"),
}
KEYS: Final = PurePosixPath("/etc/handover/keys")
#: the only folder that the service may write to
STATE: Final = PurePosixPath("/var/lib/handover")
#: name of the autopilot's line, whatever port it is plugged into
LINE: Final = PurePosixPath("/dev/handover-autopilot")
#: routing tables of the two uplinks; usual machines use no such numbers
TABLES: Final = {"wifi": 101, "lte": 102}
#: `/dev/serial/by-id` of a USB device, as udev makes it
_BY_ID: Final = re.compile(r"usb-(?P<serial>[A-Za-z0-9_.:#+=@-]+)-if(?P<interface>[0-9a-f]{2})(-port(?P<port>\d+))?")
_INTERFACE: Final = re.compile(r"[A-Za-z0-9_.-]{1,15}")
_HOST: Final = re.compile(r"[A-Za-z0-9_.-]+")
_TTY: Final = re.compile(r"(?P<kind>tty[A-Za-z]+)\d+")
#: drivers that may be loaded only when a device is plugged in. Before that /proc/devices does not list them. The
#: service may not use drivers that were not listed when it started (DeviceAllow=)
_MODULES: Final = {"ttyACM": "cdc_acm", "ttyUSB": "usbserial"}
_MODULE: Final = "Wants=modprobe@{0}.service\nAfter=modprobe@{0}.service"
#: a start of the computer waits for the clock, and not for ever
_CLOCK: Final = PurePosixPath("/etc/systemd/system/systemd-time-wait-sync.service.d/10-handover.conf")
#: prefix length of a network with one address
_ALONE: Final = 32


@dataclass(frozen=True, slots=True)
class Item:
    """A file to write. `kept`: configuration or key, which is not replaced and not removed by `uninstall`."""

    path: PurePosixPath
    text: str
    mode: int = 0o644
    kept: bool = False


@dataclass(frozen=True, slots=True)
class Uplink:
    """An uplink to the stations. `role`: "wifi" or "lte"; without `address` it uses DHCP."""

    role: str
    interface: str
    address: IPv4Interface | None = None
    gateway: IPv4Address | None = None


def uplink(role: str, text: str) -> Uplink:
    """`INTERFACE`, or `INTERFACE=ADDRESS/BITS[,GATEWAY]`. Raises ConfigError, one line."""
    interface, equals, rest = text.partition("=")
    address, comma, gateway = rest.partition(",")
    try:
        if not _INTERFACE.fullmatch(interface):
            raise ValueError(f"{interface!r} is no name of an interface")
        if not equals:
            return Uplink(role, interface)
        if "/" not in address:
            raise ValueError(f"{address!r} lacks /BITS")
        way = Uplink(role, interface, IPv4Interface(address), IPv4Address(gateway) if comma else None)
        _reachable(way)
    except ValueError as error:
        raise ConfigError(f"--{role} {text}: INTERFACE or INTERFACE=ADDRESS/BITS[,GATEWAY]: {error}") from None
    return way


def _reachable(way: Uplink) -> None:
    """Check the gateway. Raises ValueError if this address could not reach it."""
    if way.address is None or way.gateway is None or way.address.network.prefixlen == _ALONE:
        return
    if way.gateway == way.address.ip or way.gateway not in way.address.network:
        raise ValueError(f"gateway {way.gateway} is no neighbour in {way.address.network}")


def files(
    kind: str, program: str, device: str | None, uplinks: tuple[Uplink, ...] = (), lines: Sequence[str] = ()
) -> list[Item]:
    """All files except configuration and keys. Raises ConfigError.

    `program`: the command `handover`. `device`: the autopilot's line, or a station's link (None: its [[vehicle]] tables
    name them). `lines`: links of the configuration that are serial lines, for example radios.
    """
    if len({way.interface for way in uplinks}) < len(uplinks):
        raise ConfigError(f"--wifi and --lte are both {uplinks[0].interface}: each way has an interface of its own")
    ours = None if device is None else _line(device, "--device")
    radios = [radio for text in lines if (radio := _line(text, "links")) is not None]
    opened = device or ""
    if ours is not None:
        opened = f"{LINE if kind == 'companion' else ours.path},{ours.baud}"
    kinds = sorted({each for line in (ours, *radios) if line is not None for each in line.kinds})
    words = {
        "PROGRAM": program,
        "MASTER": opened,
        "MASTER_OPTION": f" --master {opened}" if opened else "",
        "MODULES": "\n".join(_MODULE.format(_MODULES[each]) for each in kinds if each in _MODULES),
        "DEVICES": "\n".join(["DevicePolicy=closed", *(f"DeviceAllow=char-{each} rw" for each in kinds)]),
        "HARDENING": _template("hardening").rstrip(),
    }
    units = {f"handover-{name}": _filled(name, words) for name in (f"{kind}.service", "logs.service", "logs.timer")}
    found = [
        *(Item(PurePosixPath("/etc/systemd/system") / name, text) for name, text in units.items()),
        Item(PurePosixPath("/etc/sysusers.d/handover.conf"), _template("sysusers.conf")),
        Item(PurePosixPath("/etc/tmpfiles.d/handover.conf"), _template("tmpfiles.conf")),
    ]
    rules = _rules(kind, ours, radios)
    if rules:
        found.append(Item(PurePosixPath(f"/etc/udev/rules.d/70-handover-{kind}.rules"), rules))
    if kind == "companion":
        found.append(Item(_CLOCK, _template("clock.conf")))
    found += [_network(each) for each in uplinks]
    return found


def _template(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")


def _filled(name: str, words: dict[str, str]) -> str:
    return re.sub(r"@([A-Z_]+)@", lambda found: words[found[1]], _template(name))


# ---- serial lines ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Line:
    """A serial line. `match`: udev's condition for it. `kinds`: possible names of its driver in /proc/devices."""

    path: str
    baud: int
    match: str
    kinds: tuple[str, ...]


def _line(device: str, where: str) -> _Line | None:
    """The serial line, None if it is a network link. Raises ConfigError."""
    try:
        spec = parse_device(device)
    except LinkError as error:
        raise ConfigError(f"{where}: {error}") from None
    if spec.kind is not Kind.SERIAL:
        if spec.way:
            raise ConfigError(f"{where} {device}: MAVProxy opens this one, and knows no @{spec.way}")
        if not _HOST.fullmatch(spec.host):
            raise ConfigError(f"{where} {device!r}: {spec.host!r} is no name of a host, nor an address")
        return None
    name = PurePosixPath(spec.host).name
    if spec.host.startswith("/dev/serial/by-id/"):
        return _Line(spec.host, spec.port, _by_id(device, where, name), ("ttyACM", "ttyUSB"))
    if spec.host == f"/dev/{name}" and (plain := _TTY.fullmatch(name)):
        return _Line(spec.host, spec.port, f'KERNEL=="{name}"', (plain["kind"],))
    raise ConfigError(f"{where} {device}: a line is /dev/ttyNAME or /dev/serial/by-id/NAME")


def _by_id(device: str, where: str, name: str) -> str:
    """The name as udev makes it, in its 60-serial.rules."""
    found = _BY_ID.fullmatch(name)
    if found is None:
        raise ConfigError(f"{where} {device}: no name as udev gives it: usb-...-ifNN")
    port = "" if found["port"] is None else f', ENV{{.ID_PORT}}=="{found["port"]}"'
    return f'ENV{{ID_SERIAL}}=="{found["serial"]}", ENV{{ID_USB_INTERFACE_NUM}}=="{found["interface"]}"{port}'


def _rules(kind: str, ours: _Line | None, radios: Sequence[_Line]) -> str:
    """Rules of udev: the service owns each line, and the autopilot's line has its own name. "" without lines."""
    named = {} if ours is None else {ours.match: f'SYMLINK+="{LINE.name}", ' if kind == "companion" else ""}
    matches = {**{line.match: "" for line in radios}, **named}
    if not matches:
        return ""
    rules = [
        f'SUBSYSTEM=="tty", {match}, {name}GROUP="handover", MODE="0660", ENV{{ID_MM_DEVICE_IGNORE}}="1"'
        for match, name in matches.items()
    ]
    head = f"# Written by 'handover install {kind}': lines of the service alone; ModemManager keeps off them"
    return "\n".join([head, *rules]) + "\n"


# ---- two ways to the stations ---------------------------------------------------------------------------------------


def _network(way: Uplink) -> Item:
    """A routing table for each interface. Sockets bound to the interface or its address leave by it.

    Unbound sockets use Wi-Fi, and LTE if there is no Wi-Fi.
    """
    table = TABLES[way.role]
    rules, routes = [f"OutgoingInterface={way.interface}"], []
    if way.address is not None:
        rules.append(f"From={way.address.ip}")
        # otherwise neighbours in the network could be reached only through the gateway
        if way.address.network.prefixlen < _ALONE:
            routes.append(f"Destination={way.address.network}\nScope=link")
    if way.address is not None and way.gateway is not None:
        on_link = "" if way.address.network.prefixlen < _ALONE else "\nGatewayOnLink=yes"
        routes.append(f"Gateway={way.gateway}{on_link}")
    lines = [
        f"# Written by 'handover install': {way.role}, with routing table {table}",
        f"[Match]\nName={way.interface}\n",
        "# a start of this computer waits for no modem\n[Link]\nRequiredForOnline=no\n",
        "[Network]",
        "DHCP=ipv4" if way.address is None else f"Address={way.address}",
        "",
    ]
    if way.address is None:
        lines.append(f"[DHCPv4]\nRouteTable={table}\n")
    lines += [f"[Route]\n{route}\nTable={table}\n" for route in routes]
    lines += [f"[RoutingPolicyRule]\n{rule}\nTable={table}\nPriority={900 + table}\n" for rule in rules]
    lines.append(f"# after the main table\n[RoutingPolicyRule]\nTable={table}\nPriority={33000 + table}\n")
    name = f"/etc/systemd/network/20-handover-{way.role}.network"
    return Item(PurePosixPath(name), "\n".join(lines).rstrip() + "\n")


def below(root: Path, path: PurePosixPath) -> Path:
    """A path of the machine under another root."""
    return root / path.relative_to("/")
