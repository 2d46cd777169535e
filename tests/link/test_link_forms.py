# SPDX-License-Identifier: GPL-3.0-or-later

"""Device strings: every form of pymavlink that is supported, and one line for every other."""

from __future__ import annotations

import pytest

from mavproxy_handover.link.devices import OPENS, DeviceSpec, Kind, LinkError, open_device, parse_device
from mavproxy_handover.link.forms import FORMS


@pytest.mark.parametrize(
    ("text", "kind", "host", "port"),
    [
        ("udpin:0.0.0.0:14550", Kind.UDP_IN, "0.0.0.0", 14550),
        ("udpout:gcs.example:14550", Kind.UDP_OUT, "gcs.example", 14550),
        ("tcp:192.168.1.5:5760", Kind.TCP_OUT, "192.168.1.5", 5760),
        ("tcpin:127.0.0.1:5760", Kind.TCP_IN, "127.0.0.1", 5760),
        ("/dev/ttyUSB0", Kind.SERIAL, "/dev/ttyUSB0", 57600),
        ("/dev/ttyTHS1,921600", Kind.SERIAL, "/dev/ttyTHS1", 921600),
        ("serial:/dev/ttyACM0:115200", Kind.SERIAL, "/dev/ttyACM0", 115200),
        (
            "serial:/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0:57600",
            Kind.SERIAL,
            "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0",
            57600,
        ),
    ],
)
def test_a_device_string_is_read_as_pymavlink_means_it(text: str, kind: Kind, host: str, port: int) -> None:
    assert parse_device(text) == DeviceSpec(text, kind, host, port)


@pytest.mark.parametrize("way", ["wlan0", "wwan0.5", "192.168.1.20"])
def test_a_link_may_name_the_way_that_it_takes(way: str) -> None:
    text = f"udpout:gcs.example:14550@{way}"
    assert parse_device(text) == DeviceSpec(text, Kind.UDP_OUT, "gcs.example", 14550, way)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "14550",
        "udp:127.0.0.1:14550",
        "udpin:127.0.0.1",
        "udpin::14550",
        "udpin:127.0.0.1:0",
        "udpin:127.0.0.1:65536",
        "udpin:127.0.0.1:14550:1",
        "udpin:127.0.0.1:１４５５０",
        "tcp:127.0.0.1:-1",
        "serial:ttyUSB0:57600",
        "serial:/dev/ttyUSB0",
        "/dev/ttyUSB0,",
        "/dev/ttyUSB0,50",
        "/dev/ttyUSB0,999999999999",
        "udpin:127.0.0.1:14550\n",
        "udpout:127.0.0.1:14550@",
        "udpout:127.0.0.1:14550@wlan 0",
        "udpout:127.0.0.1:14550@averyverylongname",
        "udpin:127.0.0.1:14550@wlan0",
        "tcp:127.0.0.1:14550@wlan0",
    ],
)
def test_any_other_string_is_one_line_that_says_what_is_allowed(text: str) -> None:
    with pytest.raises(LinkError) as error:
        parse_device(text)
    assert "must be" in str(error.value)
    assert repr(text) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_host_that_nobody_knows_is_one_line_that_names_the_link() -> None:
    for kind in ("udpout", "udpin", "tcp", "tcpin"):
        with pytest.raises(LinkError, match=f"^link {kind}:no such host:14550 cannot be opened: ") as error:
            open_device(f"{kind}:no such host:14550")
        assert "\n" not in str(error.value)


def test_every_kind_has_its_forms_and_what_opens_it() -> None:
    assert set(FORMS) == set(OPENS) == set(Kind)
    with pytest.raises(LinkError) as told:
        parse_device("udp:127.0.0.1:14550")
    assert [form for form in FORMS.values() if form not in str(told.value)] == []
