# SPDX-License-Identifier: GPL-3.0-or-later

"""A ground station that is MAVProxy as it comes: its own command lines are typed, its console is read.

A line of the console is a `said` entry here: what MAVProxy does not show is not heard by its operator.
"""

from __future__ import annotations

import importlib.metadata
import queue
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from talk import MISSION, PARAMETER, Journal, Program, serve

ANSWER_S = 20.0
READ_S, LOG_S = 60.0, 110.0
HEIGHT_M = 8.0
FILE = "@SYS/uarts.txt"


@dataclass(frozen=True)
class Order:
    """Lines that are typed, and the patterns of the console's answers, which may come in any order.

    What the patterns find is the result or the number read.
    """

    lines: str
    answer: str
    timeout_s: float = ANSWER_S
    second_answer: str = ""


RECEIVED = r"Received (?P<count>\d+) parameters"


def acknowledged(name: str) -> str:
    """The pattern of the last COMMAND_ACK of a command."""
    return rf"Got COMMAND_ACK: {name}: (?!IN_PROGRESS)(?P<result>\w+)"


def command(line: str, name: str) -> Order:
    """An order that is answered by COMMAND_ACK."""
    return Order(line, acknowledged(name))


def orders(folder: Path) -> dict[str, Order]:
    """All words."""
    name, value = PARAMETER
    return {
        "parameters": Order("param fetch", RECEIVED, READ_S),
        "mission": Order(f"wp save {folder / 'saved.txt'}", r"Saved (?P<count>\d+) waypoints to"),
        "version": command("long REQUEST_MESSAGE 148", "REQUEST_MESSAGE"),
        "file": Order(f"ftp get {FILE} {folder / 'file'}", r"Wrote (?P<count>\d+) bytes"),
        "param": Order(f"param set {name} {value}", rf"(?P<result>Failed) to set {name}|{name}\s+{value}", 10.0),
        "upload": Order(f"wp load {folder / 'mission.txt'}", r"Got MISSION_ACK: TYPE_MISSION: (?P<result>\w+)"),
        "arm": command("arm throttle", "COMPONENT_ARM_DISARM"),
        "arm-reading": Order("param fetch\narm throttle", RECEIVED, READ_S, acknowledged("COMPONENT_ARM_DISARM")),
        "disarm": command("disarm", "COMPONENT_ARM_DISARM"),
        "guided": command("mode GUIDED", "DO_SET_MODE"),
        "loiter": command("mode LOITER", "DO_SET_MODE"),
        "rtl": command("mode RTL", "DO_SET_MODE"),
        "land": command("mode LAND", "DO_SET_MODE"),
        "takeoff": command(f"takeoff {HEIGHT_M:g}", "NAV_TAKEOFF"),
        "start": command("long MISSION_START", "MISSION_START"),
        "boot-loader": command("reboot bootloader", "PREFLIGHT_REBOOT_SHUTDOWN"),
        "logs": Order("log list", r"Log (?P<count>\d+)  numLogs \d+ lastLog (?P=count) "),
        "log": Order(f"log download latest {folder / 'log'}", r"Finished downloading .*\((?P<count>\d+) bytes", LOG_S),
    }


def mission_file(folder: Path) -> None:
    """Write what `upload` loads."""
    lines = ["QGC WPL 110"]
    for number, (item, latitude, longitude, height) in enumerate(MISSION):
        frame = 3 if number else 0
        lines.append(f"{number}\t{int(not number)}\t{frame}\t{item}\t0\t0\t0\t0\t{latitude}\t{longitude}\t{height}\t1")
    (folder / "mission.txt").write_text("\n".join(lines) + "\n", encoding="ascii")


class Station(Program):
    """MAVProxy and its console."""

    def __init__(self, master: str, sysid: int, journal: Journal) -> None:
        self._journal = journal
        folder = Path(tempfile.mkdtemp())
        mission_file(folder)
        self._command = [sys.executable, "-u", "-E", "-s", str(Path(sys.executable).with_name("mavproxy.py"))]
        self._command += [f"--master={master}", f"--source-system={sysid}", f"--state-basedir={folder}"]
        self._lines: queue.Queue[str] = queue.Queue()
        self._process: subprocess.Popen[str] | None = None
        self.jobs = {word: lambda order=order: self._order(order) for word, order in orders(folder).items()}
        self.jobs["connect"] = self._connect

    def _connect(self) -> tuple[str, int | None]:
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            self._command, stdin=pipe, stdout=pipe, stderr=subprocess.STDOUT, text=True, errors="replace", bufsize=1
        )
        threading.Thread(target=self._read, daemon=True).start()
        # it reads the parameters by itself then
        return ("not heard" if self._await((RECEIVED,), READ_S) is None else "done"), None

    def _read(self) -> None:
        assert self._process is not None
        assert self._process.stdout is not None
        for line in self._process.stdout:
            text = re.sub(r"^(?:[A-Z0-9_()]*> ?)+", "", line.strip())
            self._journal.note("said", text.removeprefix("AP: "))
            self._lines.put(text)

    def _await(self, patterns: Sequence[str], timeout_s: float) -> dict[str, str | None] | None:
        """What the patterns found; None if one of them has not come in time."""
        wanted, values = set(patterns), dict[str, "str | None"]()
        until = time.monotonic() + timeout_s
        while wanted:
            try:
                line = self._lines.get(timeout=max(0.0, until - time.monotonic()))
            except queue.Empty:
                return None
            for pattern in patterns:
                if pattern in wanted and (found := re.search(pattern, line)):
                    wanted.remove(pattern)
                    values.update(found.groupdict())
        return values

    def _order(self, order: Order) -> tuple[str, int | None]:
        assert self._process is not None
        assert self._process.stdin is not None
        while not self._lines.empty():
            self._lines.get_nowait()
        self._process.stdin.write(order.lines + "\n")
        self._process.stdin.flush()
        values = self._await([pattern for pattern in (order.answer, order.second_answer) if pattern], order.timeout_s)
        if values is None:
            return "no answer", None
        count = values.get("count")
        return (values.get("result") or "done").lower(), None if count is None else int(count)

    def end(self) -> None:
        """End MAVProxy."""
        if self._process is not None:
            self._process.kill()


def main() -> None:
    """Until the input ends."""
    version = f"MAVProxy {importlib.metadata.version('MAVProxy')}"
    serve(__doc__, version, lambda master, options, journal: Station(master, options.sysid, journal))


if __name__ == "__main__":
    main()
