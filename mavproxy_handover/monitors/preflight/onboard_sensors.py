# SPDX-License-Identifier: GPL-3.0-or-later

"""Which sensor messages of onboard programs the autopilot uses, by its parameters.

A message that it uses is a finding, because it moves estimate, landing or avoidance. One that it does not use is a
finding too: the program was set up for nothing. So is a sensor that it expects by MAVLink while no program may send it.

Sources: ArduPilot's AC_PrecLand, AP_Proximity, AP_RangeFinder, AP_OpticalFlow, AP_GPS, AP_VisualOdom, AP_NavEKF_Source.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Final

from mavproxy_handover.gate.policy.onboard import SENSORS

__all__ = ["SENSOR_PARAMETERS", "sensor_findings"]

_SETS: Final = (1, 2, 3)
_EXTERNAL, _FLOW = 6, 5
_AXES: Final = ("POSXY", "VELXY", "POSZ", "VELZ", "YAW")
_VISION: Final = tuple((f"EK3_SRC{n}_{axis}", _EXTERNAL) for n in _SETS for axis in _AXES)
_FLOWS: Final = tuple((f"EK3_SRC{n}_VELXY", _FLOW) for n in _SETS)
_RANGES: Final = (("PRX1_TYPE", 2), ("RNGFND1_TYPE", 10))
#: message -> parameters of which all of the first and one of the second must have this value
_USES: Final[Mapping[str, tuple[tuple[tuple[str, int], ...], tuple[tuple[str, int], ...]]]] = {
    "LANDING_TARGET": ((("PLND_ENABLED", 1), ("PLND_TYPE", 1)), ()),
    "OBSTACLE_DISTANCE": ((("PRX1_TYPE", 2),), ()),
    "OBSTACLE_DISTANCE_3D": ((("PRX1_TYPE", 2),), ()),
    "DISTANCE_SENSOR": ((), _RANGES),
    "OPTICAL_FLOW": ((("FLOW_TYPE", 5),), _FLOWS),
    "GPS_INPUT": ((), (("GPS1_TYPE", 14), ("GPS_TYPE", 14), ("GPS2_TYPE", 14))),
}
_OF_VISION: Final = ((("VISO_TYPE", 1),), _VISION)

_STRICT: Final = "PLND_STRICT"
_HOVERS: Final = 2

#: all parameters that are read for that
SENSOR_PARAMETERS: Final = (
    *dict.fromkeys(name for every, one in (*_USES.values(), _OF_VISION) for name, _value in (*every, *one)),
    _STRICT,
)


#: parameter and value by which the autopilot expects a sensor by MAVLink -> the messages that it takes; the sources
#: of its estimator (EK3_SRC) are no sensors
_EXPECTED: Final[Mapping[tuple[str, int], tuple[str, ...]]] = {
    ("PLND_TYPE", 1): ("LANDING_TARGET",),
    ("PRX1_TYPE", 2): ("OBSTACLE_DISTANCE", "OBSTACLE_DISTANCE_3D", "DISTANCE_SENSOR"),
    ("RNGFND1_TYPE", 10): ("DISTANCE_SENSOR",),
    ("FLOW_TYPE", 5): ("OPTICAL_FLOW",),
    ("GPS1_TYPE", 14): ("GPS_INPUT",),
    ("GPS_TYPE", 14): ("GPS_INPUT",),
    ("GPS2_TYPE", 14): ("GPS_INPUT",),
    ("VISO_TYPE", 1): tuple(sorted(set(SENSORS) - set(_USES))),
}


def sensor_findings(parameters: Mapping[str, float], sensors: Collection[str]) -> tuple[str, ...]:
    """Findings about these sensor messages, in words.

    There is one for each message. More are for sensors of the autopilot that no message is for, and for landings that
    never end without a target. `parameters`: those that the autopilot has.
    """
    findings = [_finding(parameters, sensor) for sensor in sorted(sensors)]
    if parameters.get("PLND_ENABLED") == 1 and parameters.get(_STRICT) == _HOVERS:
        findings.append("PLND_STRICT 2: without a landing target it hovers until the battery is empty")
    unsent = (
        f"{name} is {value}, and no onboard program may send {messages[0]}{' or its like' if messages[1:] else ''}"
        for (name, value), messages in _EXPECTED.items()
        if parameters.get(name) == value and not set(messages) & set(sensors) and _on(parameters, name)
    )
    return (*findings, *unsent)


def _on(parameters: Mapping[str, float], name: str) -> bool:
    return name != "PLND_TYPE" or parameters.get("PLND_ENABLED") == 1


def _finding(parameters: Mapping[str, float], sensor: str) -> str:
    every, one = _USES.get(sensor, _OF_VISION)
    lacks = [name for name, value in every if parameters.get(name) != value]
    uses = [name for name, value in one if parameters.get(name) == value]
    if lacks or (one and not uses):
        names = lacks or [name for name, _value in one if name in parameters] or [one[0][0]]
        return f"{sensor} of an onboard program is not used: {names[0]} is {parameters.get(names[0], 0):g}"
    by = ", ".join(uses or [name for name, _value in every])
    return f"{sensor} of an onboard program moves {SENSORS[sensor].moves.value} ({by})"
