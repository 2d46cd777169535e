# SPDX-License-Identifier: GPL-3.0-or-later

"""The Python half of ArduPilot's script bindings, called by `lua_prelude`.

`ScriptCalls` holds what the autopilot keeps for its scripts: the receive queue, the table of message ids, blocked
commands, arming authorisations, parameter tables and log formats. A binding that refuses its arguments raises
`ScriptFault`, which becomes a Lua error. Where ArduPilot itself would be damaged (memory over-read or overrun, a null
pointer, the halt of SITL on a log message defined twice) the fault is raised in Python, past every `pcall` of the
script.

Where firmware versions differ, `VehicleHost.firmware` decides; 4.7.0 is the development version of 2025.
"""

from __future__ import annotations

import functools
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sitl.vehicles.lua_host import VehicleHost
from sitl.vehicles.lua_image import payload_size

__all__ = ["MODE_REASON_SCRIPTING", "Received", "ScriptCalls", "ScriptFault"]

#: `ModeReason::SCRIPTING`: the reason `VehicleHost.set_mode` is called with.
MODE_REASON_SCRIPTING = 32
MAX_AUX_AUTHS = 3
AUX_AUTH_TEXT_BYTES = 41
PARAMETER_NAME_BYTES = 16
_4_6, _4_7_DEV = (4, 6, 0), (4, 7, 0)


class ScriptFault(Exception):
    """A binding refuses its arguments; becomes a Lua error with this text."""


@dataclass(frozen=True, slots=True)
class Received:
    image: bytes
    channel: int
    stamp_ms: int


def _binding(method: Callable[..., Any]) -> Callable[..., Any]:
    """Answer Lua with `true, values...` or `false, message`; a fault of the host is kept for `run_due`."""

    @functools.wraps(method)
    def call(self: ScriptCalls, *args: Any) -> tuple[Any, ...]:
        try:
            result = method(self, *args)
        except ScriptFault as fault:
            return (False, str(fault))
        except Exception as fault:
            self.host_fault = self.host_fault or fault
            return (False, f"host fault: {fault!r}")
        return (True, *result) if isinstance(result, tuple) else (True, result)

    call.binding = True  # type: ignore[attr-defined]
    return call


def _whole(value: object, low: int, high: int) -> int:
    """An argument that the autopilot takes as an integer."""
    if isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value) and value == int(value):
        if low <= value <= high:
            return int(value)
        raise ScriptFault("bad argument (out of range)")
    raise ScriptFault("bad argument (number has no integer representation)")


def _lua_integer(value: int) -> int:
    """A uint32 on its way to Lua, whose integers may have 32 bits with a sign; the prelude masks it."""
    return ((value + 0x80000000) & 0xFFFFFFFF) - 0x80000000


def _text(value: object) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return str(value)
    raise ScriptFault(f"bad argument (string expected, got {type(value).__name__})")


class ScriptCalls:
    """The state of one autopilot's scripting, and one method for each binding."""

    def __init__(self, host: VehicleHost) -> None:
        self._host = host
        self._tables: dict[int, tuple[str, int]] = {}
        self._log_formats: dict[str, tuple[str, str, str, str]] = {}
        self._allocated = 0
        self.queue: deque[Received] | None = None
        self.queue_size = 0
        self.msgids: list[int | None] = []
        self.host_fault: Exception | None = None
        self.blocked: set[int] = set()
        #: where the scripts' own files lie
        self.script_folder: Path | None = None
        self._forget_authorisations()

    def restart(self) -> None:
        """Scripting starts again. From 4.7 on the authorisations of earlier scripts are void. Queue and message ids
        stay."""
        if self._host.firmware() >= (4, 7, 0):
            self._forget_authorisations()

    def _forget_authorisations(self) -> None:
        self.aux_states: list[bool | None] = []
        self.aux_error = False
        self.aux_text = ""
        self.aux_source = -1

    def bindings(self) -> dict[str, Callable[..., Any]]:
        """The methods that the prelude calls, by name."""
        return {name: getattr(self, name) for name, kind in vars(type(self)).items() if hasattr(kind, "binding")}

    def aux_refusal(self) -> str | None:
        """`AP_Arming::aux_auth_checks`: why arming is refused, or None."""
        if self.aux_error:
            return "Too many auxiliary authorisers"
        failed = [i for i, state in enumerate(self.aux_states) if state is False]
        if failed:
            return self.aux_text if self.aux_source in failed else "Auxiliary authorisation refused"
        return "Waiting for auxiliary authorisation" if None in self.aux_states else None

    @_binding
    def millis(self) -> int:
        return _lua_integer(self._host.millis())

    @_binding
    def micros(self) -> int:
        return _lua_integer(self._host.millis() * 1000)

    @_binding
    def set_mode(self, mode: object) -> bool:
        return self._host.set_mode(_whole(mode, 0, 255), MODE_REASON_SCRIPTING)

    @_binding
    def get_mode(self) -> int:
        return self._host.get_mode()

    @_binding
    def get_control_mode_reason(self) -> int:
        return self._host.get_control_mode_reason()

    @_binding
    def get_likely_flying(self) -> bool:
        return self._host.likely_flying()

    @_binding
    def is_landing(self) -> bool:
        return self._host.is_landing()

    @_binding
    def is_taking_off(self) -> bool:
        return self._host.is_taking_off()

    @_binding
    def in_vtol_mode(self) -> bool:
        return self._host.in_vtol_mode()

    @_binding
    def get_current_nav_index(self) -> int:
        return self._host.mission_item()

    @_binding
    def has_ekf_failsafed(self) -> bool:
        return self._host.has_ekf_failsafed()

    @_binding
    def get_time_flying_ms(self) -> int:
        return self._host.time_flying_ms()

    @_binding
    def is_armed(self) -> bool:
        return self._host.is_armed()

    @_binding
    def arm(self) -> bool:
        return self._host.arm()

    @_binding
    def disarm(self) -> bool:
        return self._host.disarm()

    @_binding
    def get_aux_auth_id(self) -> int | tuple[()]:
        if len(self.aux_states) >= MAX_AUX_AUTHS:
            self.aux_error = True
            return ()
        self.aux_states.append(None)
        return len(self.aux_states) - 1

    @_binding
    def set_aux_auth_passed(self, auth_id: object) -> tuple[()]:
        index = _whole(auth_id, 0, 255)
        if index < len(self.aux_states):
            self.aux_states[index] = True
        return ()

    @_binding
    def set_aux_auth_failed(self, auth_id: object, text: object) -> tuple[()]:
        index = _whole(auth_id, 0, 255)
        if index < len(self.aux_states):
            self.aux_states[index] = False
            if not any(state is False for state in self.aux_states[:index]):
                self.aux_text = _text(text)[:AUX_AUTH_TEXT_BYTES]
                self.aux_source = index
        return ()

    @_binding
    def param_get(self, name: object) -> float | tuple[()]:
        value = self._host.param_get(_text(name))
        return () if value is None else float(value)

    @_binding
    def param_set(self, name: object, value: float) -> bool:
        return self._host.param_set(_text(name), float(value), False)

    @_binding
    def param_set_and_save(self, name: object, value: float) -> bool:
        return self._host.param_set(_text(name), float(value), True)

    @_binding
    def param_add_table(self, key: object, prefix: object, size: object) -> bool:
        number, text, count = _whole(key, 0, 200), _text(prefix), _whole(size, 1, 63)
        known = self._tables.get(number)
        if known is not None and (known[0] != text or count > known[1]):
            return False
        self._tables.setdefault(number, (text, count))
        return True

    @_binding
    def param_add_param(self, key: object, index: object, name: object, default: float) -> bool:
        table = self._tables.get(_whole(key, 0, 200))
        if table is None or _whole(index, 1, 63) > table[1] or len(table[0] + _text(name)) > PARAMETER_NAME_BYTES:
            return False
        return self._host.param_define(table[0] + _text(name), float(default))

    @_binding
    def parameter_exists(self, name: object) -> bool:
        if self._host.param_get(_text(name)) is None:
            raise ScriptFault(f"No parameter: {name}")
        return True

    @_binding
    def read_file(self, path: object) -> str | None:
        """A file in the folder of the scripts, however its path begins; the autopilot's file system is not modelled."""
        folder, _, name = _text(path).rpartition("/")
        if self.script_folder is None or folder.rpartition("/")[2] != "scripts" or name in ("", ".", ".."):
            return None
        try:
            return (self.script_folder / name).read_bytes().decode("latin-1")
        except OSError:
            return None

    @_binding
    def send_text(self, severity: object, text: object) -> tuple[()]:
        self._host.send_text(_whole(severity, 0, 7), _text(text))
        return ()

    @_binding
    def get_gyro(self) -> tuple[float, float, float]:
        return self._host.sensed().gyro_radps

    @_binding
    def get_accel(self) -> tuple[float, float, float]:
        return self._host.sensed().accel_mps2

    @_binding
    def get_pressure(self) -> float:
        return self._host.sensed().pressure_pa

    @_binding
    def battery_voltage(self, instance: object) -> float:
        if _whole(instance, 0, 255) != 0:
            raise ScriptFault("bad argument (out of range)")
        return self._host.sensed().battery_v

    @_binding
    def gps_week_ms(self, instance: object) -> int:
        if _whole(instance, 0, 255) != 0:
            raise ScriptFault("bad argument (out of range)")
        return _lua_integer(self._host.sensed().gps_week_ms)

    @_binding
    def gcs_last_seen(self) -> int:
        return _lua_integer(self._host.gcs_last_seen_ms())

    @_binding
    def rc_has_valid_input(self) -> bool:
        return self._host.rc_valid()

    @_binding
    def rc_run_aux_function(self, function: object, position: object) -> bool:
        return self._host.run_aux_function(_whole(function, 0, 65535), _whole(position, 0, 2))

    @_binding
    def fw_type(self) -> int:
        return self._host.firmware_type()

    @_binding
    def fw_major(self) -> int:
        return self._host.firmware()[0]

    @_binding
    def fw_minor(self) -> int:
        return self._host.firmware()[1]

    @_binding
    def fw_patch(self) -> int:
        return self._host.firmware()[2]

    @_binding
    def mavlink_init(self, queue: object, msgids: object) -> tuple[()]:
        queue_size, count = _whole(queue, 0, 25), _whole(msgids, 0, 25)
        if self.queue is None:
            self.queue, self.queue_size, self._allocated = deque(), queue_size, count
            self.msgids = [None] * count
        elif _4_6 <= self._host.firmware() <= _4_7_DEV:  # before and after, a second call changes nothing
            if count > self._allocated:
                raise RuntimeError(f"mavlink:init overruns the table of {self._allocated} message ids")
            self.msgids = [None] * count
        return ()

    @_binding
    def mavlink_register(self, msgid: object) -> bool:
        number = _whole(msgid, 0, (1 << 24) - 1)
        if number in self.msgids:
            return False
        if None not in self.msgids:
            raise ScriptFault("no registrations free")
        self.msgids[self.msgids.index(None)] = number
        return True

    @_binding
    def mavlink_receive(self) -> tuple[Any, ...]:
        if self.queue is None:
            raise ScriptFault("RX not initialized")
        if not self.queue:
            return (False,)
        message = self.queue.popleft()
        return (True, message.image.decode("latin-1"), message.channel, _lua_integer(message.stamp_ms))

    @_binding
    def mavlink_block_command(self, command: object) -> bool:
        self.blocked.add(_whole(command, 0, 65535))
        return True

    @_binding
    def mavlink_send_chan(self, channel: object, msgid: object, payload: object) -> bool:
        firmware = self._host.firmware()
        buffers = 7 if firmware < _4_6 else 8 if firmware <= _4_7_DEV else 16
        chan, number = _whole(channel, 0, buffers - 1), _whole(msgid, 0, (1 << 24) - 1)
        data = _text(payload).encode("latin-1")
        wanted = payload_size(number)
        if wanted is None:
            raise ScriptFault(f"Unknown MAVLink message ID ({number})")
        if len(data) < wanted:
            raise RuntimeError(f"message {number}: payload of {len(data)} bytes, {wanted} are read")
        if not self._host.has_port(chan):
            if firmware <= _4_7_DEV:
                raise RuntimeError(f"the autopilot's process dies: no port has channel {chan} (packet_overhead_chan)")
            return False
        return self._host.send_message(chan, number, data[:wanted])

    @_binding
    def log_write(self, name: str, labels: str, fmt: str, *rest: object) -> tuple[()]:
        if len(name) > 4 or len(labels) >= 57 or len(fmt) >= 15 or len(labels.split(",")) != len(fmt):
            raise ScriptFault("bad argument (name, labels or format)")
        units, mults, values = "", "", rest
        if len(rest) == len(fmt) + 2:
            units, mults, values = str(rest[0]), str(rest[1]), rest[2:]
            if len(units) != len(fmt) or len(mults) != len(fmt):
                raise ScriptFault("units and multipliers must be same length as format")
        if len(values) != len(fmt):
            raise ScriptFault("bad argument (format does not match No. of arguments)")
        shape = (labels, fmt, units, mults)
        if self._log_formats.setdefault(name, shape) != shape:
            raise RuntimeError(f"log message {name} defined twice: ArduPilot SITL halts")
        for letter, value in zip(fmt, values, strict=True):
            _check_log_value(letter, value)
        self._host.log_write(name, labels, fmt, values)
        return ()


def _check_log_value(letter: str, value: object) -> None:
    """The ranges of ArduPilot's `logger:write`."""
    limits = {"b": (-128, 127), "B": (0, 255), "M": (0, 255), "h": (-32768, 32767), "H": (0, 65535)}
    if letter in limits and not (letter in "BM" and isinstance(value, bool)):
        _whole(value, *limits[letter])
    elif letter == "I" and (
        isinstance(value, bool) or not isinstance(value, (int, float)) or not -(2**31) <= value < 2**32
    ):
        raise ScriptFault("bad argument (argument out of range)")
    elif letter in "nNZ" and not isinstance(value, str):
        raise ScriptFault("bad argument (string expected)")
