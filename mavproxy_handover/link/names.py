# SPDX-License-Identifier: GPL-3.0-or-later

"""Addresses of the hosts that links name: numbers, and names that are looked up.

Rules that live here:

1. To look a name up may take half a minute, so in flight a thread does it (`worker.py`), one name at a time.
2. The addresses that were found last stay until other ones are found. A restart in flight begins with them.
3. IPv4 addresses come first: a station program that listens on one kind alone nearly always listens on that one.
4. An IPv4 address that is written as an IPv6 one (`::ffff:192.0.2.1`) is taken as the IPv4 address that it is.
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
from mavproxy_handover.worker import Worker

__all__ = ["Address", "Names", "endpoint", "hear_both_kinds", "host_of", "is_number", "look_up", "look_up_for"]

#: as Python's sockets have it: host, port, and for IPv6 flow and scope
Address = tuple[Any, ...]

#: between two look-ups of one name: while nothing is known, and later
_UNKNOWN_S, _KNOWN_S = 1.0, 30.0
#: the part of an IPv6 address that stands for one site: a host may have any address in it
_PREFIX_BYTES: Final = 8


def is_number(host: str) -> bool:
    """Whether it is an address, and no name."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


def look_up(host: str) -> tuple[str, ...]:
    """The addresses of a host. Takes as long as the network likes. Raises OSError, UnicodeError."""
    found = list(socket.getaddrinfo(host, None, type=socket.SOCK_DGRAM))
    found.sort(key=lambda entry: entry[0] != socket.AF_INET)
    return tuple(dict.fromkeys(_plain(_scoped(entry[4])) for entry in found))


def look_up_for(spec: DeviceSpec) -> tuple[str, ...]:
    """The addresses of a link's host. Takes as long. Raises LinkError: it has none."""
    try:
        return look_up(spec.host)
    except (OSError, UnicodeError) as error:
        raise LinkError(f"link {spec.text} cannot be opened: {reason(error)}") from None


def endpoint(spec: DeviceSpec) -> tuple[socket.AddressFamily, Address]:
    """Family and address of `HOST:PORT`. A name is looked up on the spot. Raises LinkError."""
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
    """A socket that will listen on all IPv6 addresses (`::`) hears IPv4 too, as most programs have it."""
    if sock.family == socket.AF_INET6:
        with suppress(OSError):
            sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)


@lru_cache(maxsize=256)
def host_of(address: str) -> str:
    """What counts as one host where strangers are counted: an IPv6 host chooses the second half of its address."""
    try:
        found = ipaddress.ip_address(address)
    except ValueError:
        return address
    if isinstance(found, ipaddress.IPv6Address):
        return str(found.ipv4_mapped or found.packed[:_PREFIX_BYTES].hex())
    return address


def _scoped(address: Address) -> str:
    """The host of an address; one that is good at one interface alone names it (Python leaves that out)."""
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
    """What is known of the names that links use. Nothing here waits or raises but `find`."""

    def __init__(
        self,
        known: Mapping[str, tuple[str, ...]] | None = None,
        worker: Worker | None = None,
        search: Callable[[str], tuple[str, ...]] = look_up,
    ) -> None:
        """`known`: addresses of before, by name."""
        self._known = dict(known or {})
        self._worker = worker or Worker()
        self._search = search
        #: names that are to be looked up again, and when each may be
        self._wanted: dict[str, None] = {}
        self._waits: dict[str, Backoff] = {}

    @property
    def known(self) -> Mapping[str, tuple[str, ...]]:
        """The addresses that were found last, by name."""
        return dict(self._known)

    def find(self, spec: DeviceSpec) -> None:
        """Look the host of a link up and wait for that, as before a flight. Raises LinkError: it has no address."""
        if not is_number(spec.host):
            self._known[spec.host] = look_up_for(spec)

    def addresses(self, host: str) -> tuple[str, ...]:
        """The addresses of a host, as far as they are known now. A name that is not known will be looked up."""
        if is_number(host):
            return (host,)
        if host not in self._known:
            self.look_again(host)
        return self._known.get(host, ())

    def look_again(self, host: str) -> None:
        """Have a name looked up, though its addresses are known; not more often than every half minute."""
        if not is_number(host):
            self._wanted[host] = None

    def tick(self, now: float) -> None:
        """Time has passed; to be called a few times a second."""
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
