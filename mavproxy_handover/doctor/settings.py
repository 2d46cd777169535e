# SPDX-License-Identifier: GPL-3.0-or-later

"""The configuration, by the loader that the modules use, and the key files that it names."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from mavproxy_handover.doctor.accounts import READ, may, reaches
from mavproxy_handover.doctor.check_context import Patient
from mavproxy_handover.doctor.finding import Finding, error, ok, unseen, warning
from mavproxy_handover.store.keys import KeysError, StationKeys, check_distinct, load_station_keys
from mavproxy_handover.wire.signing import fingerprint

__all__ = ["configuration", "keys"]

_OTHERS: Final = stat.S_IRWXO
#: nobody but its owner puts keys there, and nobody outside its group looks into it
_TOO_OPEN: Final = stat.S_IWGRP | stat.S_IRWXO


def configuration(patient: Patient) -> Iterator[Finding]:
    """Whether it loads, and whether who is to read it can."""
    path = patient.path
    if patient.config_error:
        where = patient.config_error.removeprefix(f"{path}: ")
        yield error(str(path), where, f"Put that right in {path}; 'handover init' writes a sample with every key.")
    else:
        name = patient.vehicle.name if patient.vehicle else patient.station.station.name if patient.station else ""
        yield ok(str(path), f"{name}, loads")
    status = path.stat()
    hindered = reaches(path, patient.account, patient.root)
    if hindered is not None or not may(status, patient.account, READ):
        stands = f"{patient.account.name} may not {f'enter {hindered}' if hindered else 'read it'}"
        yield error(str(path), stands, f"Run: chown root:handover {hindered or path}; chmod g+rX {hindered or path}.")
    elif patient.installed and status.st_mode & _OTHERS:
        mode = stat.S_IMODE(status.st_mode)
        yield warning(str(path), f"mode {mode:04o}: everybody may read it", f"Run: chmod 0640 {path}.")


def keys(patient: Patient) -> Iterator[Finding]:
    """Each key that the configuration names: is it there, whose is it, is it one; no two alike."""
    named, unsigned = _named(patient)
    for who in unsigned:
        do = "Make a key with 'handover keys make' and name it in the configuration."
        yield warning(
            who, "speaks unsigned (allow_unsigned): any program that reaches its link counts as this station", do
        )
    for folder in sorted({path.parent for path in named.values()}):
        yield from _folder(patient, folder)
    good: dict[str, StationKeys] = {}
    for who, path in named.items():
        try:
            found = load_station_keys(path, patient.account.uid)
        except KeysError as fault:
            yield _bad_key(patient, who, path, str(fault))
            continue
        good[who] = found
        old = "" if found.previous is None else f"; a rotation is under way, old key {fingerprint(found.previous)}"
        yield ok(f"key of {who}", f"{path}, fingerprint {fingerprint(found.current)}{old}")
    try:
        check_distinct({who: found for who, found in good.items() if who in _stations(patient)})
    except KeysError as fault:
        yield error("keys", str(fault), "Make one of them anew with 'handover keys rotate'.")


def _named(patient: Patient) -> tuple[dict[str, Path], list[str]]:
    """Whose key lies where, and who has none."""
    found: dict[str, Path | None] = {}
    optional: dict[str, Path | None] = {}
    if patient.vehicle is not None:
        found = {each.station.name: each.key for each in patient.vehicle.stations}
        optional = {"the autopilot": patient.vehicle.autopilot_key, "the guard": patient.vehicle.guard_key}
    elif patient.station is not None:
        found = {each.called: each.key for each in patient.station.vehicles}
        if patient.station.ground is not None:
            found["the ground link"] = patient.station.ground_key
    everything = {**found, **{who: path for who, path in optional.items() if path is not None}}
    named = {who: patient.at(path) for who, path in everything.items() if path is not None}
    return named, [who for who in found if who not in named]


def _stations(patient: Patient) -> set[str]:
    return set() if patient.vehicle is None else {each.station.name for each in patient.vehicle.stations}


def _folder(patient: Patient, folder: Path) -> Iterator[Finding]:
    try:
        mode = stat.S_IMODE(folder.stat().st_mode)
        hindered = reaches(folder / "key", patient.account, patient.root)
    except OSError as fault:
        yield error(str(folder), f"{fault.strerror}", "Make keys with 'handover keys make'.")
        return
    if mode & _TOO_OPEN:
        yield error(str(folder), f"mode {mode:04o}: others may look into it", f"Run: chmod 0750 {folder}.")
    elif hindered is not None:
        do = f"Run: chown root:{patient.account.name} {hindered}; chmod 0750 {hindered}."
        yield error(str(folder), f"{patient.account.name} may not enter {hindered}", do)
    else:
        yield ok(str(folder), f"mode {mode:04o}")


def _bad_key(patient: Patient, who: str, path: Path, fault: str) -> Finding:
    what, found = f"key of {who}", fault.removeprefix(f"{path}: ")
    try:
        status = path.stat()
    except FileNotFoundError:
        do = f"Run 'handover keys make', or copy the file of the other end to {path}."
        return error(what, f"{path}: no such file", do)
    except OSError as hidden:
        return unseen(what, f"{path}: {hidden.strerror}", f"Run this as {patient.account.name}, or with sudo.")
    if os.geteuid() not in (0, status.st_uid):
        return unseen(what, f"{path}: belongs to another user", f"Run this as {patient.account.name}, or with sudo.")
    if stat.S_IMODE(status.st_mode) & ~0o600:
        return error(what, f"{path}: {found.partition(':')[0]}", f"Run: chmod 600 {path}.")
    if status.st_uid != patient.account.uid:
        return error(what, f"{path}: {found}", f"Run: chown {patient.account.name}: {path}.")
    return error(what, f"{path}: {found}", "Make another with 'handover keys make', or copy that of the other end.")
