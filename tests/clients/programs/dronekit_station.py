# SPDX-License-Identifier: GPL-3.0-or-later

"""A ground station that is a script with DroneKit, as its users write them.

DroneKit tells its user nothing of a refusal: a mode, an arming and a parameter are set, and the user looks whether they
changed. So this answers "no change" for what did not change in time.
"""

from __future__ import annotations

import collections
import collections.abc
import importlib.metadata
import time
from collections.abc import Callable
from typing import Any

from talk import COMMAND_RESULTS, MISSION, PARAMETER, Journal, Program, Texts, serve

# DroneKit 2.9.2 was made for Python before 3.10
collections.MutableMapping = collections.abc.MutableMapping  # type: ignore[attr-defined]
import dronekit  # noqa: E402 (it needs the line above)

HEIGHT_M = 8.0
#: as long as its users' loops wait
CHANGE_S, CLIMB_S = 5.0, 15.0
READ_S = 60.0
START, REBOOT, REQUEST_MESSAGE, VERSION = 300, 246, 512, 148
HOLD_IN_BOOT_LOADER = 3
ANSWER_S = 30.0


class Station(Program):
    """The connection and the jobs."""

    def __init__(self, address: str, sysid: int, journal: Journal) -> None:
        self._address, self._sysid = address, sysid
        self._texts = Texts(journal)
        self._vehicle: Any = None
        self._acks: list[Any] = []
        self._versions = 0
        self.jobs = {
            "connect": self._connect,
            "parameters": self._parameters,
            "mission": self._mission,
            "version": self._version,
            "param": self._set_parameter,
            "upload": self._upload,
            "arm": lambda: self._arm(True),
            "disarm": lambda: self._arm(False),
            "guided": lambda: self._mode("GUIDED"),
            "loiter": lambda: self._mode("LOITER"),
            "rtl": lambda: self._mode("RTL"),
            "land": lambda: self._mode("LAND"),
            "takeoff": self._take_off,
            "start": lambda: self._acknowledged(START),
            "boot-loader": lambda: self._acknowledged(REBOOT, HOLD_IN_BOOT_LOADER),
        }

    def _connect(self) -> tuple[str, int | None]:
        self._vehicle = dronekit.connect(self._address, source_system=self._sysid, wait_ready=True, timeout=60)
        self._vehicle.add_message_listener("STATUSTEXT", self._on_text)
        self._vehicle.add_message_listener("COMMAND_ACK", lambda _vehicle, _name, ack: self._acks.append(ack))
        self._vehicle.add_message_listener("AUTOPILOT_VERSION", self._on_version)
        return "done", None

    def _on_text(self, _vehicle: Any, _name: str, message: Any) -> None:
        text = message.text if isinstance(message.text, str) else message.text.decode("utf-8", "replace")
        self._texts.take(message.get_srcComponent(), message.id, text, message.severity)

    def _on_version(self, _vehicle: Any, _name: str, _message: Any) -> None:
        self._versions += 1

    def _until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        until = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > until:
                return False
            time.sleep(0.05)
        return True

    def _changed(self, condition: Callable[[], bool], timeout_s: float = CHANGE_S) -> tuple[str, int | None]:
        return ("done" if self._until(condition, timeout_s) else "no change"), None

    def _parameters(self) -> tuple[str, int | None]:
        """It reads them by itself, while it connects."""
        self._vehicle.wait_ready("parameters", timeout=READ_S)
        return "read", len(self._vehicle.parameters)

    def _mission(self) -> tuple[str, int | None]:
        self._vehicle.commands.download()
        self._vehicle.commands.wait_ready(timeout=READ_S)
        return "read", self._vehicle.commands.count

    def _version(self) -> tuple[str, int | None]:
        before = self._versions
        self._command(REQUEST_MESSAGE, float(VERSION))
        return ("read" if self._until(lambda: self._versions > before, CHANGE_S) else "no answer"), None

    def _set_parameter(self) -> tuple[str, int | None]:
        name, value = PARAMETER
        done = self._vehicle.parameters.set(name, value, wait_ready=True)
        return ("done" if done else "no change"), None

    def _upload(self) -> tuple[str, int | None]:
        commands = self._vehicle.commands
        commands.clear()
        for command, *place in MISSION[1:]:  # home is its own
            commands.add(dronekit.Command(0, 0, 0, 3, command, 0, 1, 0, 0, 0, 0, *place))
        commands.upload(timeout=10)
        return "done", None

    def _arm(self, wanted: bool) -> tuple[str, int | None]:
        self._vehicle.armed = wanted
        return self._changed(lambda: self._vehicle.armed == wanted)

    def _mode(self, name: str) -> tuple[str, int | None]:
        self._vehicle.mode = dronekit.VehicleMode(name)
        return self._changed(lambda: self._vehicle.mode.name == name)

    def _take_off(self) -> tuple[str, int | None]:
        self._vehicle.simple_takeoff(HEIGHT_M)
        return self._changed(lambda: self._vehicle.location.global_relative_frame.alt > 1.0, CLIMB_S)

    def _acknowledged(self, number: int, first: float = 0.0) -> tuple[str, int | None]:
        self._acks.clear()
        self._command(number, first)
        last = [""]

        def ended() -> bool:
            last[:] = [COMMAND_RESULTS[ack.result] for ack in self._acks if ack.command == number][-1:] or [""]
            return last[0] not in ("", "in_progress")

        return (last[0] if self._until(ended, ANSWER_S) else "no answer"), None

    def _command(self, number: int, first: float = 0.0) -> None:
        encode = self._vehicle.message_factory.command_long_encode
        self._vehicle.send_mavlink(encode(0, 1, number, 0, first, 0, 0, 0, 0, 0, 0))


def main() -> None:
    """Until the input ends."""
    versions = [d.version for d in importlib.metadata.distributions() if d.metadata["Name"].startswith("dronekit")]
    version = f"DroneKit {', '.join(versions)}"
    serve(__doc__, version, lambda address, options, journal: Station(address, options.sysid, journal))


if __name__ == "__main__":
    main()
