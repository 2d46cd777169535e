# SPDX-License-Identifier: GPL-3.0-or-later

"""Where the companion is said to be: no value of HNDO_CHAN, and no wiring, may cost the autopilot its life."""

from __future__ import annotations

from tests.sitl.guard_cases import Case, Outcome, flights, in_guided, landed_at_home, said
from tests.sitl.guard_flight import ACCEPTED, FAILED, GUIDED, LIVE, RTL, Flight

#: SERIAL1 and SERIAL2 belong to scripts: they are open, and speak no MAVLink
ONLY_SERIAL0 = {"SERIAL1_PROTOCOL": 28, "SERIAL2_PROTOCOL": 28, "SR0_POSITION": 4, "MAV1_POSITION": 4}
COMPANION = 1


def every_channel(flight: Flight) -> Outcome:
    """One after the other in flight: the leases come in on channel 1 all the time."""
    in_guided(flight)
    flight.set_parameter("HNDO_TIMEOUT", 3)
    flight.pace(4)
    flight.set_parameter("HNDO_TIMEOUT", 3)
    flight.set_parameter("HNDO_CHAN", 0)
    flight.until(lambda: flight.mode == RTL, 6, "RTL: the leases come from elsewhere")
    for channel in range(16):
        flight.set_parameter("HNDO_CHAN", channel)
        flight.run(1.5)
        assert flight.parameter("HNDO_CHAN") == channel
        assert flight.mode == RTL
    flight.statuses.clear()
    flight.set_parameter("HNDO_CHAN", COMPANION)
    flight.until(lambda: flight.is_state(LIVE), 5, "the right channel again")
    assert flight.set_mode(GUIDED) == ACCEPTED
    flight.until(lambda: flight.mode == GUIDED, 3, "the commander's GUIDED")
    flight.set_parameter("HNDO_CHAN", -1)
    flight.run(4)
    assert flight.mode == GUIDED
    flight.cut()
    flight.until(lambda: flight.mode == RTL, 6, "RTL")
    return f"RTL where it is wrong, LIVE again where it is right; {landed_at_home(flight)}"


def beyond_what_there_is(channel: int) -> Case:
    """A mistyped number at 20 m."""

    def fly(flight: Flight) -> Outcome:
        in_guided(flight)
        flight.cut()
        flight.set_parameter("HNDO_CHAN", channel)
        flight.sending = True
        flight.until(lambda: flight.mode == RTL, 6, "RTL")
        return f"RTL, {landed_at_home(flight)}"

    return Case(f"HNDO_CHAN {channel} set in flight, no port there", fly)


def no_port_for_the_companion(flight: Flight) -> Outcome:
    """Only SERIAL0 speaks MAVLink, and HNDO_CHAN is 1 as it comes: alive a minute later, and it does not arm."""
    flight.run(60)
    assert flight.set_mode(GUIDED) == ACCEPTED
    flight.until(lambda: flight.mode == GUIDED, 3, "GUIDED")
    assert flight.arm() == FAILED
    said(flight, "HNDO: no lease from companion")
    return "alive, arming refused"


CASES = (
    Case("HNDO_CHAN 0 to 15 and -1 in flight", every_channel),
    beyond_what_there_is(4),
    beyond_what_there_is(9),
    Case("only SERIAL0 speaks MAVLink, HNDO_CHAN 1", no_port_for_the_companion, ONLY_SERIAL0, station_serial=0),
)
test_channels = flights(CASES)
