# SPDX-License-Identifier: GPL-3.0-or-later

"""`exchange.md`, from the definitions of the dialect."""

from __future__ import annotations

import re
from collections.abc import Iterator
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from reference import ROOT
from reference.markdown import cell, code, page, table

__all__ = ["exchange"]

_WIRE = ROOT / "mavproxy_handover" / "wire"
_STEP = re.compile(r"Step (\d), (.+?)[:.] (.+)")
_FILES = {
    "handover.xml": (
        "The handover's own",
        "MAVLink 2, ids 47100 to 47131. Stations are named by their MAVLink system ids.",
    ),
    "operator_control.xml": (
        "The operator-control standard",
        "Known to any ground station program that speaks the standard; left out of the build where pymavlink "
        "brings them itself.",
    ),
}


def exchange() -> str:
    """The page."""
    parts = [
        "What travels between vehicle and stations, from `mavproxy_handover/wire/handover.xml` and "
        "`operator_control.xml`. The dialect includes ArduPilot's (`ardupilotmega`) whole; `--dialect=handover` makes "
        "MAVProxy and pymavlink's tools decode all of it (these with `MAVLINK20=1`). START, STOP and CONTINUE are "
        "the standard's `MAV_CMD_MISSION_START` and `MAV_CMD_DO_PAUSE_CONTINUE`.",
        "The lease, which the companion sends to the guard, is a `TUNNEL`: "
        "[architecture.md](../architecture.md) and `ardupilot_lua/handover_guard.md` tell of it.",
    ]
    for name, (title, text) in _FILES.items():
        root = ElementTree.parse(_WIRE / name).getroot()
        parts += [f"## {title}", text]
        steps = sorted(_steps(root))
        if steps:
            parts += [
                "### The order of a handover",
                table(("step", "message", "from, to", "what it says"), [(str(n), *rest) for n, *rest in steps]),
                "The vehicle repeats its own until they are answered; stations answer, and repeat nothing. A copy is "
                "answered again and changes nothing; one of another handover or epoch is dropped. Each carries "
                "`vehicle`, `from_station`, `to_station`, `handover_id` and `epoch`.",
            ]
        parts += ["### Messages", *(part for message in root.iter("message") for part in _message(message))]
        parts += ["### Values", *(part for enum in root.iter("enum") for part in _enum(enum))]
    return page("What is exchanged", *parts)


def _steps(root: Element) -> Iterator[tuple[int, str, str, str]]:
    for message in root.iter("message"):
        step = _STEP.fullmatch(_says(message))
        if step:
            yield int(step[1]), _link(message.get("name", "")), cell(step[2]), cell(step[3][0].upper() + step[3][1:])


def _says(element: Element) -> str:
    return " ".join((element.findtext("description") or "").split())


def _link(name: str) -> str:
    return f"[`{name}`](#{name.lower()})"


def _message(message: Element) -> Iterator[str]:
    yield f"#### {message.get('name')}"
    yield f"Id {message.get('id')}. {_says(message)}"
    rows, extension = [], False
    for child in message:
        extension = extension or child.tag == "extensions"
        if child.tag == "field":
            enum = child.get("enum")
            says = cell(child.text or "") + (f" ({_link(enum)})" if enum else "")
            name = code(child.get("name", "")) + (" (extension)" if extension else "")
            rows.append((name, code(child.get("type", "")), cell(child.get("units", "")), says))
    yield table(("field", "type", "unit", "meaning"), rows)


def _enum(enum: Element) -> Iterator[str]:
    yield f"#### {enum.get('name')}"
    yield _says(enum) + (" Values are bits, and may be added." if enum.get("bitmask") else "")
    rows = []
    for entry in enum.iter("entry"):
        parameters = "; ".join(
            f"{param.get('index')} {param.get('label')}: {param.text}"
            + (f" ({param.get('units')})" if param.get("units") else "")
            for param in entry.iter("param")
        )
        rows.append((entry.get("value", ""), code(entry.get("name", "")), cell(f"{_says(entry)} {parameters}")))
    yield table(("value", "name", "meaning"), rows)
