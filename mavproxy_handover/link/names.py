# SPDX-License-Identifier: GPL-3.0-or-later

"""Addresses of the hosts of links, given as numbers or as names that are looked up.

Rules that live here:

1. A name look-up may take half a minute, so in flight a thread does it (`tools/worker.py`), one name at a time.
2. The last found addresses stay until other ones are found. A restart in flight begins with them.
3. IPv4 addresses come first, because a station program that listens on only one kind nearly always uses IPv4.
4. An IPv4 address in IPv6 form (`::ffff:192.0.2.1`) is used as the IPv4 address.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import lru_cache, partial
from typing import Any, Final

from mavproxy_handover.link.base import Backoff, reason
from mavproxy_handover.link.forms import DeviceSpec, LinkError
from mavproxy_handover.tools.worker import Worker

__all__ = ["Address", "Names", "endpoint", "hear_both_kinds", "host_of", "is_number", "look_up", "look_up_for"]

#: in the form of Python's sockets: host, port, and for IPv6 flow and scope
Address = tuple[Any, ...]

#: time (s) between two look-ups of one name: while its address is unknown, and later
_UNKNOWN_S, _KNOWN_S = 1.0, 30.0
#: length of the network part of an IPv6 address: a host may have any address in it
_PREFIX_BYTES: Final = 8


def is_number(host: str) -> bool:
    """True if it is an address and not a name."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


def look_up(host: str) -> tuple[str, ...]:
    """Look up the addresses of a host. May take long. Raises OSError, UnicodeError."""
    found = list(socket.getaddrinfo(host, None, type=socket.SOCK_DGRAM))
    found.sort(key=lambda entry: entry[0] != socket.AF_INET)
    return tuple(dict.fromkeys(_plain(_scoped(entry[4])) for entry in found))


def look_up_for(spec: DeviceSpec) -> tuple[str, ...]:
    """Look up the addresses of a link's host. May take long. Raises LinkError if it has none."""
    try:
        return look_up(spec.host)
    except (OSError, UnicodeError) as error:
        raise LinkError(f"link {spec.text} cannot be opened: {reason(error)}") from None


def endpoint(spec: DeviceSpec) -> tuple[socket.AddressFamily, Address]:
    """Family and address of `HOST:PORT`. A name is looked up at once. Raises LinkError."""
    host = _plain(spec.host if is_number(spec.host) else look_up_for(spec)[0])
    try:
        flags = socket.AI_NUMERICHOST
        family, _type, _protocol, _name, address = socket.getaddrinfo(
            host, spec.port, type=socket.SOCK_DGRAM, flags=flags
        )[0]
    except OSError as error:
        raise LinkError(f"link {spec.text} cannot be opened: {reason(error)}") from None
    return family, address


def hear_both_kinds(sock: socket.socket) -> None:
    """Let a socket that will listen on all IPv6 addresses (`::`) receive IPv4 too, as most programs do."""
    if sock.family == socket.AF_INET6:
        with suppress(OSError):
            sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)


@lru_cache(maxsize=256)
def host_of(address: str) -> str:
    """The part of an address that counts as one host. An IPv6 host can choose the second half of its address."""
    try:
        found = ipaddress.ip_address(address)
    except ValueError:
        return address
    if isinstance(found, ipaddress.IPv6Address):
        return str(found.ipv4_mapped or found.packed[:_PREFIX_BYTES].hex())
    return address


def _scoped(address: Address) -> str:
    """The host of an address, with its interface if it is valid on one interface only. Python omits the interface."""
    host, scope = str(address[0]), address[3] if len(address) > 3 else 0
    return f"{host}%{scope}" if scope and "%" not in host else host


def _plain(host: str) -> str:
    try:
        found = ipaddress.ip_address(host)
    except ValueError:
        return host
    mapped = found.ipv4_mapped if isinstance(found, ipaddress.IPv6Address) else None
    return host if mapped is None else str(mapped)


class Names:
    """The known addresses of the names that links use. Only `find` waits or raises."""

    def __init__(
        self,
        known: Mapping[str, tuple[str, ...]] | None = None,
        worker: Worker | None = None,
        search: Callable[[str], tuple[str, ...]] = look_up,
    ) -> None:
        """`known`: addresses of an earlier run, by name."""
        self._known = dict(known or {})
        self._worker = worker or Worker()
        self._search = search
        #: names to look up again, and the time from which each may be looked up
        self._wanted: dict[str, None] = {}
        self._waits: dict[str, Backoff] = {}

    @property
    def known(self) -> Mapping[str, tuple[str, ...]]:
        """The last found addresses, by name."""
        return dict(self._known)

    def find(self, spec: DeviceSpec) -> None:
        """Look up the host of a link and wait for the result, before a flight. Raises LinkError if it has no
        address.
        """
        if not is_number(spec.host):
            self._known[spec.host] = look_up_for(spec)

    def addresses(self, host: str) -> tuple[str, ...]:
        """The known addresses of a host. An unknown name will be looked up."""
        if is_number(host):
            return (host,)
        if host not in self._known:
            self.request(host)
        return self._known.get(host, ())

    def request(self, host: str) -> None:
        """Look up a name again, at most every half minute."""
        if not is_number(host):
            self._wanted[host] = None

    def tick(self, now: float) -> None:
        """Start due look-ups and take results. Call it a few times a second."""
        self._worker.tick(now)
        if self._worker.busy:
            return
        for host in self._wanted:
            wait = self._waits.setdefault(host, Backoff(0.5, _UNKNOWN_S))
            if not wait.due(now):
                continue

            if self._worker.submit(partial(self._search, host), partial(self._found, host)):
                wait.tried(now)
                del self._wanted[host]
            return

    def _found(self, host: str, result: tuple[str, ...] | Exception, now: float) -> None:
        if isinstance(result, tuple) and result:
            self._known[host] = result
            self._waits[host] = wait = Backoff(_KNOWN_S, _KNOWN_S)
            wait.tried(now)
