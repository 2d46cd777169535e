# SPDX-License-Identifier: GPL-3.0-or-later

"""The dialect: its ids are free wherever pymavlink knows a message, its numbers are our enums', and programs find it.

Looks at the installed pymavlink as it is: its XML, and the Python that was made from it.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from enum import IntEnum
from functools import cache
from pathlib import Path

import pymavlink
import pytest
from pymavlink.dialects.v20 import handover as mavlink

import mavproxy_handover
from mavproxy_handover.core.common.model import Consent, FlightAction, GuardState, LeaseState, Outcome, Phase, Reason

SHIPPED = Path(pymavlink.__file__).parent / "dialects" / "v20"
WIRE = Path(mavproxy_handover.__file__).parent / "wire"
OURS = range(47100, 47132)

#: ids written out: they are the protocol (docs/architecture.md, "A transfer")
MESSAGES = {
    47100: "CONNECT",
    47101: "CONNECT_ACK",
    47102: "MISSION_PACKAGE",
    47103: "MISSION_CHUNK",
    47104: "MISSION_PACKAGE_ACK",
    47105: "HANDOVER_TELEMETRY",
    47106: "HANDOVER_REQUEST",
    47107: "ON_HANDOVER",
    47108: "OK_HANDOVER",
    47109: "CONNECT_HANDOVER",
    47110: "DRONE_CONNECTED",
    47111: "DISCONNECT_HANDOVER",
    47112: "HANDOVER_RESULT",
    47113: "AUTHORITY_STATUS",
    47114: "HANDOVER_AHEAD",
    47115: "OK_AHEAD",
    47120: "HANDOVER_DECISION",
    47121: "HANDOVER_OVERRIDE",
    47122: "HANDOVER_BRIEFING",
    47123: "HANDOVER_REHEARSE",
    47124: "HANDOVER_REHEARSAL",
    47125: "STATION_OPERATOR",
    47128: "HANDOVER_DELEGATE",
}
STANDARD = {512: "CONTROL_STATUS"}


def defined(xml: Path) -> dict[int, str]:
    """Messages of one XML file, by id."""
    return {int(m.get("id", "")): m.get("name", "") for m in ET.parse(xml).iter("message")}


def entries(xml: Path, enum: str) -> dict[int, str]:
    """Entries of one enum in one XML file, by value."""
    found = {}
    for element in ET.parse(xml).iter("enum"):
        if element.get("name") == enum:
            for entry in element.iter("entry"):
                found[int(entry.get("value", "-1"), 0)] = entry.get("name", "")
    return found


@cache
def python_ids(path: Path) -> dict[int, str]:
    """Messages of one generated dialect, by id, without the cost of importing it."""
    return {
        int(number): name
        for name, number in re.findall(
            r"^MAVLINK_MSG_ID_(\w+) = (\d+)$", path.read_text(encoding="utf-8"), re.MULTILINE
        )
        if name not in ("BAD_DATA", "UNKNOWN")
    }


XML_FILES = sorted(SHIPPED.glob("*.xml"))
PYTHON_FILES = sorted(path for path in SHIPPED.glob("*.py") if path.name != "__init__.py")


def test_there_is_something_to_look_at() -> None:
    """Otherwise the tests below would hold for nothing."""
    assert {"common.xml", "ardupilotmega.xml", "development.xml"} <= {path.name for path in XML_FILES}
    assert {"common.py", "ardupilotmega.py", "all.py"} <= {path.name for path in PYTHON_FILES}
    assert python_ids(SHIPPED / "common.py")[0] == "HEARTBEAT"


def test_our_messages_and_their_ids() -> None:
    assert defined(WIRE / "handover.xml") == MESSAGES
    assert defined(WIRE / "operator_control.xml") == STANDARD
    assert set(MESSAGES) <= set(OURS)


@pytest.mark.parametrize("xml", XML_FILES, ids=lambda path: path.name)
def test_our_ids_are_free_in_every_definition_that_pymavlink_ships(xml: Path) -> None:
    for msgid, name in defined(xml).items():
        assert msgid not in OURS, f"{name} has id {msgid} in {xml.name}"
        if msgid in STANDARD:
            assert name == STANDARD[msgid]


@pytest.mark.parametrize("path", PYTHON_FILES, ids=lambda path: path.name)
def test_our_ids_are_free_in_every_dialect_that_pymavlink_ships(path: Path) -> None:
    ids = python_ids(path)
    assert {msgid: name for msgid, name in ids.items() if msgid in OURS} == {}
    assert ids.get(512, "CONTROL_STATUS") == "CONTROL_STATUS"


@pytest.mark.parametrize("xml", XML_FILES, ids=lambda path: path.name)
def test_our_names_are_free_too(xml: Path) -> None:
    """Two messages of one name in a dialect would be one class in Python."""
    assert set(defined(xml).values()) & set(MESSAGES.values()) == set()


@pytest.mark.parametrize("xml", XML_FILES, ids=lambda path: path.name)
def test_the_standards_command_and_result_are_free_or_the_standards(xml: Path) -> None:
    assert entries(xml, "MAV_CMD").get(32100, "") in ("", "MAV_CMD_REQUEST_OPERATOR_CONTROL")
    assert entries(xml, "MAV_RESULT").get(10, "") in ("", "MAV_RESULT_NOT_IN_CONTROL")


def test_names_and_ids_are_there_once() -> None:
    names = [cls.msgname for cls in mavlink.mavlink_map.values()]
    assert len(names) == len(set(names))
    assert {msgid: mavlink.mavlink_map[msgid].msgname for msgid in MESSAGES} == MESSAGES


def test_the_dialect_holds_ardupilotmega_whole() -> None:
    from pymavlink.dialects.v20 import ardupilotmega

    for msgid, cls in ardupilotmega.mavlink_map.items():
        ours = mavlink.mavlink_map[msgid]
        assert (ours.msgname, ours.crc_extra, ours.unpacker.size) == (cls.msgname, cls.crc_extra, cls.unpacker.size)


def test_the_installed_dialect_is_the_one_of_the_xml() -> None:
    for msgid, name in {**MESSAGES, **STANDARD}.items():
        source = WIRE / ("handover.xml" if msgid in MESSAGES else "operator_control.xml")
        message = next(m for m in ET.parse(source).iter("message") if m.get("name") == name)
        fields = [field.get("name") for field in message.iter("field")]
        assert mavlink.mavlink_map[msgid].fieldnames == fields


# ---- numbers ------------------------------------------------------------------------------------------------------

ENUMS: dict[str, type[IntEnum]] = {
    "HANDOVER_PHASE": Phase,
    "HANDOVER_LEASE": LeaseState,
    "HANDOVER_CONSENT": Consent,
    "HANDOVER_OUTCOME": Outcome,
    "HANDOVER_REASON": Reason,
    "HANDOVER_GUARD": GuardState,
}


@pytest.mark.parametrize("name", list(ENUMS))
def test_the_numbers_of_an_enum_are_those_of_the_rules(name: str) -> None:
    xml = {entry.removeprefix(f"{name}_"): value for value, entry in entries(WIRE / "handover.xml", name).items()}
    assert xml == {member.name: member.value for member in ENUMS[name]}


@pytest.mark.parametrize("name", list(ENUMS))
def test_the_numbers_of_an_enum_are_those_of_the_installed_dialect(name: str) -> None:
    for member in ENUMS[name]:
        assert getattr(mavlink, f"{name}_{member.name}") == member.value


def test_the_actions_are_those_of_the_rules_and_one_for_none() -> None:
    xml = {
        entry.removeprefix("HANDOVER_ACTION_"): v
        for v, entry in entries(WIRE / "handover.xml", "HANDOVER_ACTION").items()
    }
    assert xml == {**{action.name: action.value for action in FlightAction}, "NONE": 255}


def test_the_numbers_of_the_operator_control_standard() -> None:
    assert mavlink.MAV_RESULT_NOT_IN_CONTROL == 10
    assert mavlink.MAV_CMD_REQUEST_OPERATOR_CONTROL == 32100
    assert mavlink.GCS_CONTROL_STATUS_FLAGS_SYSTEM_MANAGER == 1
    assert mavlink.MAVLink_control_status_message.unpacker.size == 12, "the layout of 2026"


def test_no_message_is_longer_than_a_frame_can_hold() -> None:
    for msgid in (*MESSAGES, *STANDARD):
        assert mavlink.mavlink_map[msgid].unpacker.size <= 255


# ---- programs that use pymavlink ----------------------------------------------------------------------------------

DECODE = """
from pymavlink import mavutil
mavutil.set_dialect("handover")
sender = mavutil.mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
message = mavutil.mavlink.MAVLink_authority_status_message(1, 251, 252, 252, 7, 3, 2, 2, 1)
(decoded,) = mavutil.mavlink.MAVLink(None).parse_buffer(message.pack(sender))
print(decoded.get_type(), decoded.commander, decoded.partner, decoded.epoch)
"""


def test_a_program_that_asks_for_the_dialect_by_name_decodes_our_messages() -> None:
    """What `--dialect=handover` does in MAVProxy, mavlogdump and MAVExplorer."""
    environment = {**os.environ, "MAVLINK20": "1"}
    done = subprocess.run(
        [sys.executable, "-c", DECODE], env=environment, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.stderr == ""
    assert done.stdout == "AUTHORITY_STATUS 251 252 7\n"


def test_mavlogdump_takes_the_dialect_by_name(tmp_path: Path) -> None:
    """MAVExplorer and MAVProxy do it by the same call; each station of the simulation starts MAVProxy with it."""
    log = tmp_path / "flight.tlog"
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
    status = mavlink.MAVLink_authority_status_message(1, 251, 252, 252, 7, 3, 2, 2, 1)
    log.write_bytes((1_700_000_000_000_000).to_bytes(8, "big") + status.pack(sender))
    folder = Path(sys.executable).parent
    dump = [folder / "mavlogdump.py", "--dialect=handover", str(log)]
    done = subprocess.run(dump, capture_output=True, text=True, check=False, timeout=60)
    assert "AUTHORITY_STATUS {" in done.stdout, done.stderr


def test_starting_python_imports_nothing_heavy_for_the_dialect() -> None:
    """Every program of the environment pays for what the start-up file imports."""
    code = "import sys; print(*sorted(name for name in sys.modules if 'handover' in name or 'pymavlink' in name))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "handover_dialect\n"
