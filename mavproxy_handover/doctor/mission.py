# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks the mission packages on this machine by their digests: vehicle and stations must have the same one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from mavproxy_handover.config.vehicle import VehicleConfig
from mavproxy_handover.core.authority.consent_lines import refused_on_route, without_consent
from mavproxy_handover.doctor.check_context import CheckContext
from mavproxy_handover.doctor.finding import Finding, error, ok, warning
from mavproxy_handover.link.forms import Kind, parse_device
from mavproxy_handover.mission.addresses import ADDRESSES_FILE
from mavproxy_handover.mission.errors import MissionError
from mavproxy_handover.mission.package import MissionPackage, load
from mavproxy_handover.store.state_file import StateError, StateFile

__all__ = ["missions", "shown"]

_DIGITS: Final = 12


def shown(digest: bytes) -> str:
    """The part of a digest that people compare."""
    return digest.hex()[:_DIGITS] if digest else "none"


def missions(context: CheckContext) -> Iterator[Finding]:
    """The findings of this check."""
    if context.vehicle is not None:
        yield from _of_vehicle(context, context.vehicle)
    elif context.station is not None:
        for vehicle in context.station.vehicles:
            if vehicle.mission is None:
                yield ok(f"mission of {vehicle.called}", "none here: it comes from the vehicle or from the parent")
                continue
            found = _loaded(context.at(vehicle.mission))
            if isinstance(found, Finding):
                yield found
            else:
                context.digests[vehicle.sysid] = found.digest
                yield from _damaged(found)
                yield ok(f"mission of {vehicle.called}", f"{found.name!r}, digest {shown(found.digest)}")


def _loaded(folder: Path) -> MissionPackage | Finding:
    try:
        return load(folder)
    except (MissionError, OSError) as fault:
        return error("mission", " ".join(str(fault).split()), f"Run: handover check {folder}; put that right.")


def _of_vehicle(context: CheckContext, vehicle: VehicleConfig) -> Iterator[Finding]:
    if vehicle.mission is not None:
        found = _loaded(context.at(vehicle.mission))
        if isinstance(found, Finding):
            yield found
        else:
            context.package = found
            yield ok("mission on board", f"{found.name!r}, digest {shown(found.digest)}")
            yield from _damaged(found)
            yield from _addresses(vehicle, found)
    else:
        yield ok("mission on board", "none in the configuration: the parent sends it")
    if vehicle.state is not None:
        yield from _held(context, StateFile(context.at(vehicle.state), vehicle.name))
    yield from _consent(context, vehicle)


def _damaged(package: MissionPackage) -> Iterator[Finding]:
    """Warn if the file of the addresses is damaged; the mission is still valid."""
    if package.addresses_fault:
        yield error("addresses", package.addresses_fault, "Put the file right, or remove it.")


def _addresses(vehicle: VehicleConfig, package: MissionPackage) -> Iterator[Finding]:
    """Addresses in the mission for a station at which this vehicle does not listen for it."""
    for station in vehicle.stations:
        links = [parse_device(link) for link in station.links]
        ports = {link.port for link in links if link.kind is Kind.UDP_IN}
        for address in package.addresses.get(station.station.sysid, ()):
            if address.port not in ports:
                text = f"{ADDRESSES_FILE} tells {station.station.name} {address.text}, and nothing listens there for it"
                do = f'Add "udpin:0.0.0.0:{address.port}" to links of that [[station]], or put the file right.'
                yield warning("addresses", text, do)


def _consent(context: CheckContext, vehicle: VehicleConfig) -> Iterator[Finding]:
    """Reasons for which START will be refused because handovers cannot have consent."""
    stations = [each.station for each in vehicle.stations]
    for text in without_consent(stations):
        do = f"Write the line in {context.path}. Else START needs its program to show operator control first."
        yield warning("consent", text, do)
    if context.package is not None:
        for text in refused_on_route(stations, context.package.simulate().commanders):
            yield error("consent", text, f'Write consent = "automatic" in {context.path}, or fly another route.')


def _held(context: CheckContext, store: StateFile) -> Iterator[Finding]:
    """Content of the state file: the last run, or the current one."""
    try:
        kept = store.load()
    except StateError as fault:
        do = "Delete it on the ground: no station has authority from it, and the parent starts again."
        yield error("state", str(fault), do)
        return
    if kept is None:
        yield ok("state", "none is kept: no flight yet")
        return
    digest, running = kept.snapshot.digest, context.running is not None
    text = f"epoch {kept.snapshot.epoch}, mission digest {shown(digest)}, of {'this' if running else 'the last'} run"
    package = context.package
    if package is None:
        context.package = store.load_package(digest) if digest else None
        yield ok("state", text)
    elif digest and digest != package.digest and running:
        found = f"{text}: the companion flies another mission than the one that lies on board ({shown(package.digest)})"
        yield error("state", found, "Restart the companion on the ground, or have the parent share its mission again.")
    elif digest and digest != package.digest:
        found = f"{text}: that was another mission than the one on board ({shown(package.digest)})"
        yield warning("state", found, "See that every station has the mission that is on board: handover share.")
    else:
        yield ok("state", text)
