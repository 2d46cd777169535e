# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks the configuration with the loader of the modules, and its key files."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from mavproxy_handover.config.for_mission import is_placeholder
from mavproxy_handover.doctor.accounts import READ, may, reaches
from mavproxy_handover.doctor.check_context import CheckContext
from mavproxy_handover.doctor.finding import Finding, error, ok, unseen, warning
from mavproxy_handover.link.forms import parse_device
from mavproxy_handover.store.keys import KeysError, StationKeys, check_distinct, load_station_keys
from mavproxy_handover.wire.signing import fingerprint

__all__ = ["configuration", "keys"]

_OTHERS: Final = stat.S_IRWXO
#: only the owner may write keys there, and only its group may list them
_TOO_OPEN: Final = stat.S_IWGRP | stat.S_IRWXO


def configuration(context: CheckContext) -> Iterator[Finding]:
    """Check that it loads, and that the service may read it."""
    path = context.path
    if context.config_error:
        where = context.config_error.removeprefix(f"{path}: ")
        yield error(str(path), where, f"Put that right in {path}; 'handover init' writes a sample with every key.")
    else:
        name = context.vehicle.name if context.vehicle else context.station.station.name if context.station else ""
        yield ok(str(path), f"{name}, loads")
    yield from _placeholders(context)
    status = path.stat()
    hindered = reaches(path, context.account, context.root)
    if hindered is not None or not may(status, context.account, READ):
        stands = f"{context.account.name} may not {f'enter {hindered}' if hindered else 'read it'}"
        yield error(str(path), stands, f"Run: chown root:handover {hindered or path}; chmod g+rX {hindered or path}.")
    elif context.installed and status.st_mode & _OTHERS:
        mode = stat.S_IMODE(status.st_mode)
        yield warning(str(path), f"mode {mode:04o}: every user may read it", f"Run: chmod 0640 {path}.")


def _placeholders(context: CheckContext) -> Iterator[Finding]:
    """Links to an address for documentation, as `handover init mission` writes it where the real one is not known."""
    links: list[tuple[str, str]] = []
    if context.vehicle is not None:
        links = [(entry.station.name, link) for entry in context.vehicle.stations for link in entry.links]
    elif context.station is not None:
        links = [(peer.station.name, peer.link) for peer in context.station.peers]
    for name, link in links:
        if is_placeholder(parse_device(link).host):
            do = f"Put the real address in its place in {context.path}."
            yield error(f"link of {name}", f"{link} has an address that no computer has", do)


def keys(context: CheckContext) -> Iterator[Finding]:
    """Check each key that the configuration names: existence, owner, content, and that no two are equal."""
    named, unsigned = _named(context)
    for who in unsigned:
        do = "Make a key with 'handover keys make' and name it in the configuration."
        yield warning(
            who, "speaks unsigned (allow_unsigned): any program that reaches its link counts as this station", do
        )
    for folder in sorted({path.parent for path in named.values()}):
        yield from _folder(context, folder)
    good: dict[str, StationKeys] = {}
    for who, path in named.items():
        try:
            found = load_station_keys(path, context.account.uid)
        except KeysError as fault:
            yield _bad_key(context, who, path, str(fault))
            continue
        good[who] = found
        old = "" if found.previous is None else f"; a rotation is under way, old key {fingerprint(found.previous)}"
        yield ok(f"key of {who}", f"{path}, fingerprint {fingerprint(found.current)}{old}")
    try:
        check_distinct({who: found for who, found in good.items() if who in _stations(context)})
    except KeysError as fault:
        yield error("keys", str(fault), "Make a new one with 'handover keys rotate'.")


def _named(context: CheckContext) -> tuple[dict[str, Path], list[str]]:
    """Paths of keys by owner, and owners without a key."""
    found: dict[str, Path | None] = {}
    optional: dict[str, Path | None] = {}
    if context.vehicle is not None:
        found = {each.station.name: each.key for each in context.vehicle.stations}
        optional = {"the autopilot": context.vehicle.autopilot_key, "the guard": context.vehicle.guard_key}
    elif context.station is not None:
        found = {each.called: each.key for each in context.station.vehicles}
        if context.station.ground is not None:
            found["the ground link"] = context.station.ground_key
    everything = {**found, **{who: path for who, path in optional.items() if path is not None}}
    named = {who: context.at(path) for who, path in everything.items() if path is not None}
    return named, [who for who in found if who not in named]


def _stations(context: CheckContext) -> set[str]:
    return set() if context.vehicle is None else {each.station.name for each in context.vehicle.stations}


def _folder(context: CheckContext, folder: Path) -> Iterator[Finding]:
    try:
        mode = stat.S_IMODE(folder.stat().st_mode)
        hindered = reaches(folder / "key", context.account, context.root)
    except OSError as fault:
        yield error(str(folder), f"{fault.strerror}", "Make keys with 'handover keys make'.")
        return
    if mode & _TOO_OPEN:
        yield error(str(folder), f"mode {mode:04o}: others may look into it", f"Run: chmod 0750 {folder}.")
    elif hindered is not None:
        do = f"Run: chown root:{context.account.name} {hindered}; chmod 0750 {hindered}."
        yield error(str(folder), f"{context.account.name} may not enter {hindered}", do)
    else:
        yield ok(str(folder), f"mode {mode:04o}")


def _bad_key(context: CheckContext, who: str, path: Path, fault: str) -> Finding:
    what, found = f"key of {who}", fault.removeprefix(f"{path}: ")
    try:
        status = path.stat()
    except FileNotFoundError:
        do = f"Run 'handover keys make', or copy the file of the other end to {path}."
        return error(what, f"{path}: no such file", do)
    except OSError as hidden:
        return unseen(what, f"{path}: {hidden.strerror}", f"Run this as {context.account.name}, or with sudo.")
    if os.geteuid() not in (0, status.st_uid):
        return unseen(what, f"{path}: belongs to another user", f"Run this as {context.account.name}, or with sudo.")
    if stat.S_IMODE(status.st_mode) & ~0o600:
        return error(what, f"{path}: {found.partition(':')[0]}", f"Run: chmod 600 {path}.")
    if status.st_uid != context.account.uid:
        return error(what, f"{path}: {found}", f"Run: chown {context.account.name}: {path}.")
    return error(what, f"{path}: {found}", "Make another with 'handover keys make', or copy that of the other end.")
