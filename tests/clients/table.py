# SPDX-License-Identifier: GPL-3.0-or-later

"""Which programs are tried, what each of them can do, and which jobs they are given. Data.

A job is a word that is typed to a program (`programs/`). It says which station does it, what the gate is expected to
make of it, and what the aircraft and the texts must show afterwards. The commander's jobs are done on the direct
connection too, for the times; those with `gate = True` only make sense through the companion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

__all__ = [
    "CLIENTS",
    "COMMANDER",
    "ENVIRONMENTS",
    "FLIGHT",
    "NO_HEARTBEATS",
    "OBSERVER",
    "Client",
    "Environment",
    "Expects",
    "Job",
    "Outcome",
    "outcome_of",
]

COMMANDER, OBSERVER = "GCSA", "GCSB"


@dataclass(frozen=True, slots=True)
class Environment:
    """A virtual environment: its folder's name, what is installed there."""

    name: str
    requirements: tuple[str, ...]


_PYMAVLINK = Environment("pymavlink", ("pymavlink",))
_MAVPROXY = Environment("mavproxy-1.8.74", ("MAVProxy==1.8.74", "future"))
# `past` is imported and not declared
_DRONEKIT = Environment("dronekit-2.9.2", ("dronekit==2.9.2", "future"))
_DRONEKIT2 = Environment("dronekit2", ("dronekit2",))
# the two have one name, and nothing in common
_MAVSDK_3 = Environment("mavsdk-3", ("mavsdk<4",))
_MAVSDK = Environment("mavsdk-newest", ("mavsdk",))
ENVIRONMENTS = (_PYMAVLINK, _MAVPROXY, _DRONEKIT, _DRONEKIT2, _MAVSDK_3, _MAVSDK)


class Outcome:
    """What a program's own word comes to."""

    DONE, REFUSED, OTHER = "done", "refused", "other"


_WORDS = {
    Outcome.DONE: {"done", "read", "accepted", "success", "yes"},
    Outcome.REFUSED: {"denied", "command_denied", "permission_denied", "not_in_control"},
}


def outcome_of(result: str) -> str:
    """The outcome that a program's own word stands for."""
    return next((outcome for outcome, words in _WORDS.items() if result in words), Outcome.OTHER)


class Expects:
    """What the gate is expected to make of a job."""

    #: it passes
    DONE = "done"
    #: it is refused at once, in the program's own protocol
    REFUSED = "refused"
    #: one of the two, at once
    ANSWERED = "answered"


@dataclass(frozen=True, slots=True)
class Job:
    """A job, and what must come of it."""

    station: str
    word: str
    expects: str
    #: the aircraft afterwards: words of `CONDITIONS` in `flight.py`
    aircraft: str = ""
    #: the program must show a text with these words
    text: str = ""
    #: the number of what was read must be the same as the last time
    same: bool = False
    #: seconds to wait before it
    pause_s: float = 0.0
    #: the count is in bytes: the table has the rate
    rate: bool = False
    #: only through the companion
    gate: bool = False
    #: the embedded vehicle knows nothing of it
    arducopter: bool = False


_A, _B = COMMANDER, OBSERVER
_DONE, _REFUSED = Expects.DONE, Expects.REFUSED
FLIGHT = (
    Job(_A, "connect", _DONE, "ready"),
    Job(_B, "connect", _DONE),
    Job(_A, "version", _DONE),
    Job(_B, "version", _DONE),
    Job(_A, "modes", _DONE, arducopter=True),
    Job(_B, "modes", _DONE, arducopter=True),
    Job(_A, "mission", _DONE),
    Job(_B, "mission", _DONE),
    Job(_B, "arm", _REFUSED, "disarmed", "arm refused: GCSA commands"),
    Job(_B, "guided", _REFUSED, "", "mode GUIDED refused: GCSA commands"),
    Job(_B, "param", _REFUSED, "", "parameter FS_OPTIONS refused: GCSA commands"),
    Job(_B, "upload", _REFUSED, "", "mission upload refused: GCSA commands"),
    Job(_B, "mission", _DONE, same=True),
    Job(_B, "parameters", _DONE),
    # the configuration names no such component of GCSA
    Job(_A, "arm-camera", _REFUSED, "disarmed", "arm refused: this component has no authority", gate=True),
    Job(_A, "boot-loader", _REFUSED, "", "hold in the boot loader refused: maintenance only", gate=True),
    Job(_A, "file", _DONE, arducopter=True),
    Job(_A, "parameters", _DONE),
    # what was read has dropped nothing: there is no time in which these are refused
    Job(_A, "guided", _DONE, "GUIDED"),
    Job(_A, "arm-reading", _DONE, "armed"),
    Job(_A, "disarm", _DONE, "disarmed"),
    Job(_A, "arm", _DONE, "armed"),
    Job(_A, "takeoff", _DONE, "up"),
    Job(_B, "rtl", _REFUSED, "GUIDED", "mode RTL refused: GCSA commands"),
    Job(_B, "disarm", _REFUSED, "armed", "disarm refused: GCSA commands"),
    Job(_A, "loiter", _DONE, "holding"),
    Job(_A, "land", _DONE, "landed"),
    Job(_A, "logs", _DONE, arducopter=True),
    Job(_A, "log", _DONE, rate=True, arducopter=True),
    # the mission of the package, after a flight and all that was read; by then every heartbeat says "disarmed"
    Job(_A, "start", _DONE, "up", pause_s=2.0, gate=True),
    Job(_A, "rtl", _DONE, "RTL", gate=True),
    Job(_A, "land", _DONE, "landed", gate=True),
    # a mission that the commander sends on the ground is refused, or it stays; one in flight ends with the flight
    Job(_A, "upload", Expects.ANSWERED, pause_s=2.0),
    Job(_A, "mission", _DONE),
    Job(_A, "mission", _DONE, same=True, pause_s=20.0),
)
#: a program that sends no heartbeats commands nothing and is told why; what it reads comes
NO_HEARTBEATS = (
    Job(_A, "connect", _DONE),
    Job(_A, "arm", _REFUSED, "disarmed", "GCSA sends no heartbeat, so it cannot command", gate=True),
    Job(_A, "version", _DONE),
    Job(_A, "mission", _DONE),
    Job(_A, "parameters", _DONE),
)

_READ = frozenset({"connect", "parameters", "mission", "version", "modes", "file", "logs", "log"})
_CHANGE = frozenset({"param", "upload", "arm", "disarm", "guided", "loiter", "rtl", "land", "takeoff", "start"})
_ALL = _READ | _CHANGE | {"arm-reading", "boot-loader"}


@dataclass(frozen=True, slots=True)
class Client:
    """A program that is tried."""

    name: str
    environment: Environment
    #: file of `programs/`
    program: str
    #: what it can do
    words: frozenset[str] = _ALL
    #: what it is given to do, of which it does what it can
    jobs: tuple[Job, ...] = FLIGHT
    #: words whose refusal the program does not show to its user: it waits for the change, or does not wait at all
    untold: frozenset[str] = frozenset()
    #: further keys of its [[station]]
    station: Mapping[str, str] = field(default_factory=dict)
    #: further options of its program
    options: tuple[str, ...] = ()
    #: the environment whose MAVProxy stands between it and the vehicle
    router: Environment | None = None

    def python(self, environments: Path) -> Path:
        """The Python that it runs in."""
        return environments / self.environment.name / "bin" / "python"


# it reads the parameters while it connects and at no other time; it downloads no log
_DRONEKIT_WORDS = _ALL - {"modes", "file", "arm-reading", "logs", "log"}
# its download of a file whose size is not known beforehand ends in "protocol_error", on a direct connection too
_MAVSDK_WORDS = _ALL - {"guided", "modes", "file"}
# it takes every heartbeat of the vehicle for the autopilot's
_DRONEKIT_STATION = {"companion_heartbeat": "false"}
# docs/mavsdk.md: "What ends a MAVSDK program"
_MAVSDK_STATION = {"not_in_control": '"never"'}
CLIENTS = (
    Client("pymavlink", _PYMAVLINK, "pymavlink_station.py", _ALL | {"arm-camera"}),
    Client("pymavlink behind MAVProxy as router", _PYMAVLINK, "pymavlink_station.py", router=_MAVPROXY),
    Client(
        "pymavlink without heartbeats",
        _PYMAVLINK,
        "pymavlink_station.py",
        frozenset(job.word for job in NO_HEARTBEATS),
        NO_HEARTBEATS,
        options=("--no-heartbeats",),
    ),
    Client("MAVProxy 1.8.74", _MAVPROXY, "mavproxy_station.py", _ALL - {"modes"}, untold=frozenset({"param"})),
    Client(
        "DroneKit 2.9.2", _DRONEKIT, "dronekit_station.py", _DRONEKIT_WORDS, untold=_CHANGE, station=_DRONEKIT_STATION
    ),
    Client("dronekit2", _DRONEKIT2, "dronekit_station.py", _DRONEKIT_WORDS, untold=_CHANGE),
    Client("MAVSDK 3", _MAVSDK_3, "mavsdk_station.py", _MAVSDK_WORDS, station=_MAVSDK_STATION),
    Client("MAVSDK, newest", _MAVSDK, "mavsdk_station.py", _MAVSDK_WORDS, station=_MAVSDK_STATION),
)
