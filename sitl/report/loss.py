# SPDX-License-Identifier: GPL-3.0-or-later

"""How many frames a ground station's log lost, by pymavlink's own count: that of `mavloss.py`.

MAVProxy's console shows the same of a link. `python -m sitl.report.loss LOG` prints it for every sender.

pymavlink takes every hole in the sequence numbers of a sender (system, component) for lost frames. Messages that its
dialect lacks it does not count, so that they are holes to it. The dialect is the whole process's: `measure` counts in a
process of its own, with ours.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pymavlink import mavutil

__all__ = ["Heard", "losses", "measure"]

_DIALECT: Final = "handover"
#: a log of an hour takes half a minute
_LIMIT_S: Final = 300.0


@dataclass(slots=True)
class Heard:
    """The frames heard of one sender, or of all, and how many are missing in between."""

    heard: int = 0
    lost: int = 0

    @property
    def percent(self) -> float:
        """Lost ones, of all that were sent."""
        return 100.0 * self.lost / max(1, self.heard + self.lost)

    def __str__(self) -> str:
        return f"{self.percent:.1f} % ({self.lost} of {self.heard + self.lost})"


def losses(log: Path) -> dict[tuple[int, int], Heard]:
    """The senders (system, component) in a telemetry log. Raises OSError; what is no frame in it is passed over."""
    with log.open("rb"):  # what is no file pymavlink takes for a serial line
        pass
    reader = mavutil.mavlink_connection(str(log), robust_parsing=True)
    # it has read the beginning of the file already, to see what kind it is
    reader.last_seq.clear()
    reader.mav_count = reader.mav_loss = 0
    senders: dict[tuple[int, int], Heard] = {}
    while (message := reader.recv_match()) is not None:
        if message.get_type() == "BAD_DATA":
            continue
        sender = senders.setdefault((message.get_srcSystem(), message.get_srcComponent()), Heard())
        sender.heard += reader.mav_count
        sender.lost += reader.mav_loss
        reader.mav_count = reader.mav_loss = 0
    reader.close()
    return senders


def measure(log: Path, dialect: str = _DIALECT) -> Heard | str:
    """All senders in a log together, by who knows this dialect; or why that cannot be told, in one line."""
    command = [sys.executable, "-m", "sitl.report.loss", "--json", str(log)]
    knows = {**os.environ, "MAVLINK20": "1", "MAVLINK_DIALECT": dialect}
    try:
        done = subprocess.run(command, env=knows, capture_output=True, text=True, timeout=_LIMIT_S, check=True)
        heard, lost = json.loads(done.stdout)
        return Heard(heard, lost)
    except subprocess.CalledProcessError as error:
        lines: list[str] = error.stderr.strip().splitlines()
        return lines[-1] if lines else f"{log.name} cannot be read"
    except (OSError, ValueError, TypeError, subprocess.TimeoutExpired) as error:
        return f"{log.name} cannot be read: {error}"


def _main(words: list[str]) -> int:
    as_json = words[:1] == ["--json"]
    logs = words[as_json:]
    if len(logs) != 1:
        print("usage: python -m sitl.report.loss LOG", file=sys.stderr)
        return 2
    try:
        senders = losses(Path(logs[0]))
    except OSError as error:
        print(f"{logs[0]}: {error.strerror}", file=sys.stderr)
        return 1
    total = Heard(sum(one.heard for one in senders.values()), sum(one.lost for one in senders.values()))
    if as_json:
        print(json.dumps([total.heard, total.lost]))
        return 0
    for (system, component), one in sorted(senders.items()):
        print(f"{system}/{component}: {one}")
    print(f"total: {total}")
    return 0


if __name__ == "__main__":
    os.environ["MAVLINK20"] = "1"
    mavutil.set_dialect(os.environ.get("MAVLINK_DIALECT", _DIALECT) if sys.argv[1:2] == ["--json"] else _DIALECT)
    sys.exit(_main(sys.argv[1:]))
