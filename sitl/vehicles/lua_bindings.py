# SPDX-License-Identifier: GPL-3.0-or-later

"""Runs ArduPilot Lua scripts against a simulated vehicle: the scripting engine, without the autopilot.

`LuaScripting` loads a script into Lua 5.3, calls its update function when it is due and gives it the bindings that
`ardupilot_lua/handover_guard.lua` uses. The bindings act on a `VehicleHost`. A simulated vehicle implements that
protocol, hands received frames to `LuaScripting.deliver`, asks `arming_refusal` before arming and `command_blocked`
before executing a MAVLink command. The embedded vehicle of `handover sim` and the tests of the guard use the same
layer, so that what the tests see is what flies there.

What is kept of ArduPilot (its `libraries/AP_Scripting` and `AP_Arming::aux_auth_checks`):

- one receive queue and one table of message ids for all scripts; a second `mavlink:init` wipes the table, whose memory
  is never freed or enlarged (4.6 and 4.7-dev; 4.5 and 4.7 leave it alone); a full queue drops the newcomer;
- a message to a channel without a port ends the process (before 4.7), one past the buffers raises;
- known messages reach a script even when their CRC is wrong; those for another system or component do not;
- 10 000 VM instructions a call, and no `pcall` saves a script that exceeds them;
- a script that raises is removed and not started again, and the error blocks arming;
- a script reads the files beside it, `scripts/NAME`; nothing else of the file system is there;
- auxiliary arming authorisation keeps its last answer when the script dies; three authorisers at most;
- blocked commands are free again when scripting stops.

Not kept are 32-bit numbers (see `lua_prelude`), memory limits, and routing that has learnt where components
live.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lupa import lua53

from sitl.vehicles.lua_calls import MODE_REASON_SCRIPTING, Received, ScriptCalls
from sitl.vehicles.lua_host import VehicleHost
from sitl.vehicles.lua_image import for_autopilot, message_image
from sitl.vehicles.lua_prelude import LUA_PRELUDE

__all__ = ["MODE_REASON_SCRIPTING", "VM_INSTRUCTION_LIMIT", "LuaScripting", "VehicleHost"]

#: Default of SCR_VM_I_COUNT.
VM_INSTRUCTION_LIMIT = 10_000

# MAV_CMD_SCRIPTING: param1 and the results
SCRIPTING_CMD_STOP, SCRIPTING_CMD_STOP_AND_RESTART = 2, 3
MAV_RESULT_ACCEPTED, MAV_RESULT_DENIED, MAV_RESULT_UNSUPPORTED = 0, 2, 3

MAV_SEVERITY_CRITICAL = 2


@dataclass(slots=True, eq=False)
class _Script:
    path: str
    source: str
    function: Any
    next_run_ms: int


class LuaScripting:
    """One autopilot's scripting engine.

    `absent` takes bindings away ("vehicle.get_control_mode_reason", "FWVersion"), as an older firmware would.
    `count_instructions` counts the script's VM instructions exactly, bindings not included, as the autopilot
    does (slow); `instructions` then holds the count of the last call. Without it the limit is approximate:
    the bindings' own Lua code counts too.
    """

    def __init__(self, host: VehicleHost, *, absent: Iterable[str] = (), count_instructions: bool = False) -> None:
        self._host = host
        self._counting = count_instructions
        self._absent = frozenset(absent)
        self._calls = ScriptCalls(host)
        self._scripts: list[_Script] = []
        self._paths: list[Path] = []
        self._leftovers: dict[int, bytes] = {}
        self._error: str | None = None
        self.instructions = 0
        self.dropped_messages = 0
        self.enabled = True
        self._start()

    def load(self, path: str | Path) -> None:
        """Load a script file; it runs at the next `run_due`. A syntax error removes it at once."""
        file = Path(path)
        self._paths.append(file)
        self._calls.script_folder = file.resolve().parent
        self.load_text(file.read_text(encoding="utf-8"), file.name)

    def load_text(self, text: str, name: str) -> None:
        """Load a script from text (a second script beside the guard, in tests)."""
        source = f"@{name}"
        answer = self._compile(text, source)
        if isinstance(answer, tuple):
            self._remove(_Script(name, source, None, 0), str(answer[1]))
        else:
            self._scripts.append(_Script(name, source, answer, self._host.millis()))

    @property
    def scripts(self) -> tuple[str, ...]:
        """Names of the scripts that are still running."""
        return tuple(script.path for script in self._scripts)

    def next_run_ms(self) -> int | None:
        """When the next script is due; None without scripts."""
        return min((script.next_run_ms for script in self._scripts), default=None)

    def run_due(self, now_ms: int) -> None:
        """Run every script that is due. Raises only what the host itself raised in a binding."""
        if self.enabled and self._host.param_get("SCR_ENABLE") == 0:
            self.stop()
        for script in [script for script in self._scripts if script.next_run_ms <= now_ms]:
            if script in self._scripts:
                self._run(script, now_ms)

    def deliver(self, frame: bytes, channel: int) -> bool:
        """A raw frame arrived on MAVLink channel `channel`. True when it went into the scripts' queue.

        Call it for every frame, whatever its CRC, before the vehicle handles it.
        """
        image = message_image(frame, self._leftovers.get(channel, b""))
        if image is None:
            return False
        self._leftovers[channel] = image[12:276]
        queue = self._calls.queue
        if queue is None or not self._registered(int.from_bytes(image[9:12], "little")):
            return False
        system_id = self._host.param_get("MAV_SYSID") or self._host.param_get("SYSID_THISMAV") or 1
        if not for_autopilot(image, int(system_id)):
            return False
        if len(queue) >= self._calls.queue_size:
            self.dropped_messages += 1
            return False
        queue.append(Received(image, channel, self._host.millis()))
        return True

    def arming_refusal(self) -> str | None:
        """Why scripts refuse arming, or None. Not asked by a forced arm, nor with ARMING_CHECK 0."""
        if self.enabled and self._error is not None:
            return f"Scripting: {self._error}"
        return self._calls.aux_refusal()

    def command_blocked(self, command: int) -> bool:
        """Whether scripts took this MAV_CMD over: the vehicle neither executes nor acknowledges it."""
        return command in self._calls.blocked

    def scripting_command(self, param1: float) -> int:
        """MAV_CMD_SCRIPTING, when it is not blocked. Returns a MAV_RESULT."""
        if param1 == SCRIPTING_CMD_STOP:
            self.stop()
            return MAV_RESULT_ACCEPTED
        if param1 == SCRIPTING_CMD_STOP_AND_RESTART:
            self.restart()
            return MAV_RESULT_ACCEPTED
        return MAV_RESULT_DENIED if param1 in (0, 1) else MAV_RESULT_UNSUPPORTED

    def stop(self) -> None:
        """Scripting ends. Arming authorisation keeps its last answer, blocked commands are free again."""
        self.enabled = False
        self._scripts.clear()
        self._calls.blocked.clear()
        self._host.send_text(MAV_SEVERITY_CRITICAL, "Scripting: stopped")

    def restart(self) -> None:
        """Scripting ends and starts again with the files it had; queue and message ids stay as they are."""
        self.stop()
        self.enabled = True
        self._host.send_text(MAV_SEVERITY_CRITICAL, "Scripting: restarted")
        self._start()
        paths, self._paths = self._paths, []
        for path in paths:
            self.load(path)

    def _start(self) -> None:
        self._error = None
        self._calls.restart()
        self._lua = lua53.LuaRuntime(
            unpack_returned_tuples=True, encoding="latin-1", register_eval=False, register_builtins=False
        )
        bindings = self._lua.table_from(self._calls.bindings())
        absent = self._lua.table_from(dict.fromkeys(self._absent, True))
        self._state, self._arm, self._compile = self._lua.execute(LUA_PRELUDE, bindings, absent)

    def _run(self, script: _Script, now_ms: int) -> None:
        error: str | None = None
        answer: Any = None
        self._arm(VM_INSTRUCTION_LIMIT, script.source, self._counting)
        try:
            answer = script.function()
        except Exception as raised:
            error = str(raised).split("\n", 1)[0]  # lupa appends a trace
        finally:
            self._state.running = False
        self.instructions = int(self._state.count)
        if self._calls.host_fault is not None:
            host_fault, self._calls.host_fault = self._calls.host_fault, None
            raise host_fault
        if self._state.overtime:
            error = f"{script.path} exceeded time limit"
        if error is not None:
            self._remove(script, error)
        elif answer is None:
            self._scripts.remove(script)
        else:
            self._reschedule(script, answer, now_ms)

    def _reschedule(self, script: _Script, answer: Any, now_ms: int) -> None:
        function, delay_ms = answer if isinstance(answer, tuple) and len(answer) == 2 else (None, None)
        if not callable(function):
            self._remove(script, f"{script.path} did not return a function")
        elif isinstance(delay_ms, bool) or not isinstance(delay_ms, (int, float)):
            self._remove(script, f"{script.path} did not return a delay")
        else:
            script.function = function
            script.next_run_ms = now_ms + int(delay_ms)

    def _remove(self, script: _Script, error: str) -> None:
        if script in self._scripts:
            self._scripts.remove(script)
        self._error = error
        self._host.send_text(MAV_SEVERITY_CRITICAL, f"Lua: {error}")
        self._host.script_removed(script.path, error)

    def _registered(self, msgid: int) -> bool:
        """ArduPilot stops at the first free entry of the table."""
        for entry in self._calls.msgids:
            if entry is None:
                return False
            if entry == msgid:
                return True
        return False
