# SPDX-License-Identifier: GPL-3.0-or-later

"""Example frames for each name of the policy, with which `trial` asks the gate.

A name may stand for several frames, because the gate looks at parameters: COMPONENT_ARM_DISARM arms or disarms.
Each has a label for people. A name that the installed dialect lacks has no frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import copy
from functools import cache
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import handover as mavlink

from mavproxy_handover.gate.policy.access import ANY
from mavproxy_handover.gate.policy.commands import JUDGED_RULES, TAKE_OFF_RULES, VALUE_RULES
from mavproxy_handover.gate.policy.files import FILE_RULES
from mavproxy_handover.gate.policy.parts import MISSION_TYPES
from mavproxy_handover.gate.policy.switches import SWITCH_NUMBERS
from mavproxy_handover.vehicle.profiles import ASSUMED
from mavproxy_handover.wire.frames import Frame, parse_one
from mavproxy_handover.wire.ids import AUTOPILOT_COMPID, FTP_CREATE, FTP_OPCODES, FTP_OPEN_READ
from mavproxy_handover.wire.message_ids import MESSAGE_IDS

__all__ = ["VEHICLE", "Example", "examples", "frame_of"]

#: the system id of the vehicle that the frames are addressed to
VEHICLE: Final = 1
#: a number without a meaning: the row of all parts without a row of their own
_OTHER_TUNNEL, _OTHER_SWITCH = 1, 32000
_LETTER = "A"
_OPCODES: Final = {name: number for number, name in FTP_OPCODES.items()}
_MISSION_TYPES: Final = {name: number for number, name in MISSION_TYPES.items()}
#: a path that a row of files is about
_PATHS: Final = {
    "unreadable names": b"a\x01b",
    "short names": b"A~1/x",
    "guard's key": b"APM/scripts/handover.key",
    "scripts": b"APM/scripts/x.lua",
    "firmware": b"ardupilot.abin",
    "raw memory": b"@SYS/storage.bin",
    "rally points": b"@MISSION/rally.dat",
    "flight logs": b"APM/LOGS/1.BIN",
    "parameters": b"@PARAM/param.pck",
    "missions": b"@MISSION/mission.dat",
}


class Example(NamedTuple):
    """A message with its fields. `label`: what tells it from the other examples of its name, for people."""

    label: str
    message: str
    fields: dict[str, Any]


@cache
def _blank(name: str) -> Any:
    """The message with zeros in all fields, as if it had been received."""
    cls = mavlink.mavlink_map[MESSAGE_IDS[name]]
    head = bytes([0xFD, cls.unpacker.size, 0, 0, 0, 1, 1]) + MESSAGE_IDS[name].to_bytes(3, "little")
    raw = head + bytes(cls.unpacker.size)
    crc = mavlink.x25crc(raw[1:] + bytes([cls.crc_extra])).crc
    return mavlink.MAVLink(None).decode(bytearray(raw + crc.to_bytes(2, "little")))


def frame_of(example: Example, sysid: int, compid: int) -> Frame:
    """The frame, from this sender to the autopilot."""
    message = copy(_blank(example.message))
    known = message.fieldnames
    aim = {"target": VEHICLE, "target_system": VEHICLE, "target_component": AUTOPILOT_COMPID}
    address = {name: value for name, value in aim.items() if name in known}
    if example.message != "MANUAL_CONTROL":
        address.pop("target", None)
    sender: Any = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)
    for field, value in {**address, **example.fields}.items():
        setattr(message, field, value)
        if isinstance(value, bytes):
            setattr(message, f"_{field}_raw", value)
    frame = parse_one(bytes(message.pack(sender)))
    assert frame is not None
    return frame


def examples(kind: str, name: str) -> tuple[Example, ...]:
    """The frames of a row of the policy; empty if the installed dialect has no such name."""
    return tuple(_MAKERS[kind](name))


def _message(name: str) -> Iterator[Example]:
    if name not in MESSAGE_IDS:
        return
    if name == "SET_MODE":
        for label, mode in _modes():
            yield Example(label, name, {"custom_mode": mode})
    elif name.startswith("RC_CHANNELS_OVERRIDE"):
        yield Example("", name, {"chan3_raw": 1500})
    else:
        yield Example("", name, {})


def _modes() -> Iterator[tuple[str, int]]:
    modes = ASSUMED.gate
    yield "AUTO", modes.auto
    yield from ((modes.names[mode], mode) for mode in modes.take_off)
    if modes.follow is not None:
        yield "FOLLOW", modes.follow
    yield "another mode", next(mode for mode in modes.names if mode not in (modes.auto, modes.follow, *modes.take_off))


def _number(name: str) -> int | None:
    number: int | None = getattr(mavlink, f"MAV_CMD_{name}", None)
    return number


def _command(name: str) -> Iterator[Example]:
    number = _number(name)
    if number is None:
        return
    if name == "DO_SET_MODE":
        for label, mode in _modes():
            yield Example(label, "COMMAND_LONG", {"command": number, "param1": 1.0, "param2": float(mode)})
        return
    for parameters in _parameters(name):
        label = ", ".join(f"{parameter} {value:g}" for parameter, value in parameters.items())
        yield Example(label, "COMMAND_LONG", {"command": number, **parameters})


def _parameters(name: str) -> list[dict[str, float]]:
    """The parameters of a command that the gate tells apart."""
    found: list[dict[str, float]] = []
    for rule in TAKE_OFF_RULES:
        if rule.name == name and rule.unless_zero is not None and not rule.values:
            found += [{f"param{rule.unless_zero}": value} for value in (0.0, 1.0)]
    for judged in JUDGED_RULES:
        if judged.name == name and judged.which is not None and judged.values and judged.also is None:
            found += [{f"param{judged.which}": float(value)} for value in (0, judged.values[0])]
    for value_rule in VALUE_RULES:
        if value_rule.name == name:
            found.append({"param1": value_rule.values[0]})
    return found or [{}]


def _by_value(name: str) -> Iterator[Example]:
    """A row "NAME (other than 0 and 1)"."""
    for rule in VALUE_RULES:
        number = _number(rule.name)
        if name.startswith(f"{rule.name} ") and number is not None:
            other = next(value for value in (3.0, 0.0) if value not in rule.values)
            yield Example(f"param1 {other:g}", "COMMAND_LONG", {"command": number, "param1": other})


def _acknowledged(name: str) -> Iterator[Example]:
    number = _number("NAV_LAND" if name == ANY else name)
    if number is not None:
        yield Example("", "COMMAND_ACK", {"command": number})


def _parameter(name: str) -> Iterator[Example]:
    yield Example("", "PARAM_SET", {"param_id": name.replace(ANY, _LETTER).encode("latin-1")[:16]})


def _switch(name: str) -> Iterator[Example]:
    number = _OTHER_SWITCH if name == ANY else SWITCH_NUMBERS[name]
    for label, position in (("low", 0.0), ("high", 2.0)):
        fields = {"command": mavlink.MAV_CMD_DO_AUX_FUNCTION, "param1": float(number), "param2": position}
        yield Example(label, "COMMAND_LONG", fields)


def _file_request(opcode: int, path: bytes) -> Example:
    head = bytes([0, 0, 0, opcode, len(path), 0, 0, 0]) + bytes(4)
    payload = list((head + path).ljust(251, b"\0"))
    return Example("", "FILE_TRANSFER_PROTOCOL", {"payload": payload})


def _opcode(name: str) -> Iterator[Example]:
    yield _file_request(_OPCODES[name], b"")


def _file(name: str) -> Iterator[Example]:
    rule = next(rule for rule in FILE_RULES if rule.name == name)
    if rule.writes:
        yield _file_request(FTP_CREATE, _PATHS[name])._replace(label="written")
    if rule.reads:
        yield _file_request(FTP_OPEN_READ, _PATHS[name])._replace(label="read")


_MAKERS: Final[Mapping[str, Callable[[str], Iterable[Example]]]] = {
    "message": _message,
    "command": _command,
    "command by parameter": _by_value,
    "acknowledged command": _acknowledged,
    "mission type": lambda name: [Example("", "MISSION_COUNT", {"mission_type": _MISSION_TYPES[name]})],
    "mission type, read": lambda name: [Example("", "MISSION_REQUEST_LIST", {"mission_type": _MISSION_TYPES[name]})],
    "parameter": _parameter,
    "auxiliary function": _switch,
    "file opcode": _opcode,
    "file": _file,
    "tunnel payload type": lambda name: [
        Example("", "TUNNEL", {"payload_type": _OTHER_TUNNEL if name == ANY else int(name)})
    ],
}
