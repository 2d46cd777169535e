# SPDX-License-Identifier: GPL-3.0-or-later

"""What befalls the script itself: a busy neighbour, one that takes the receive queue, scripting that is stopped."""

from __future__ import annotations

from tests.sitl.guard_cases import Case, Outcome, came_home, cut, flights, in_guided, landed_at_home, loss, said
from tests.sitl.guard_flight import DENIED, FAILED, GUIDED, LIVE, RTL, SPEEDUP, Flight

SCRIPTING_COMMAND, STOP, STOP_AND_RESTART = 42701, 2, 3
#: the autopilot's own GCS failsafe, 10 s after the last heartbeat
GCS_FAILSAFE_S = (8.0, 13.0)

BUSY = """\
local function update()
  local sum = 0
  for i = 1, 4000 do sum = sum + i end
  return update, 1
end
return update, 1
"""
TAKES_THE_QUEUE = """\
local function update()
  if param:get('SCR_USER1') == 1 then
    param:set('SCR_USER1', 0)
    mavlink:init(1, 1)
  elseif param:get('SCR_USER1') == 2 then
    param:set('SCR_USER1', 0)
    mavlink:init(1, 1)
    mavlink:register_rx_msgid(33)
  end
  return update, 100
end
return update, 100
"""


def queue_taken(flight: Flight) -> Outcome:
    """Firmware 4.6 and dev gives the queue away, 4.5 and 4.7 keep it."""
    gives_away = flight.firmware.numbers == (4, 6) or flight.firmware.version.endswith("dev")
    flight.take_off()
    flight.pace(2)
    for number in (1, 2):
        flight.run(11)  # a text of a kind is said once in ten seconds
        flight.texts.clear()
        flight.set_parameter("SCR_USER1", number)
        if gives_away:
            said(flight, "HNDO: MAVLink rx", 4)
        else:
            flight.run(2)
        sequence = flight.status[5]
        flight.until(lambda sequence=sequence: flight.status[5] != sequence, 3, "leases are heard again")
    assert bool(flight.status[3] & 8) == gives_away, flight.texts
    flight.run(5)
    assert flight.mode == GUIDED
    assert flight.is_state(LIVE)
    return "noticed and repaired" if gives_away else "refused by the firmware, nothing changes"


def stop_denied(flight: Flight) -> Outcome:
    in_guided(flight)
    for order in (STOP, STOP_AND_RESTART):
        assert flight.command(SCRIPTING_COMMAND, order) == DENIED
        flight.run(0.5)  # ten answers a second at most
    said(flight, "HNDO: scripting command of 251/190 denied")
    flight.statuses.clear()
    flight.run(3)
    assert len(flight.statuses) >= 4
    assert {status[1] for status in flight.statuses} == {LIVE}
    assert flight.status[3] & 8
    return "DENIED, guard LIVE"


def stop_scripting(flight: Flight) -> None:
    """The autopilot looks once a second whether it is to begin again."""
    flight.set_parameter("SCR_ENABLE", 0)
    said(flight, "Scripting: stopped", 5)
    flight.texts.clear()
    flight.run(1.5)


def stopped_and_companion_dead(flight: Flight) -> Outcome:
    """Nothing is left but the autopilot's own failsafe; and what the guard allowed once does not stay allowed."""
    in_guided(flight)
    stop_scripting(flight)
    flight.companion_dies()
    silent_ms = flight.now_ms
    flight.until(lambda: flight.mode == RTL, 15, "GCS failsafe")
    waited_s = (flight.now_ms - silent_ms) / 1000
    assert GCS_FAILSAFE_S[0] <= waited_s <= GCS_FAILSAFE_S[1], waited_s
    landing = landed_at_home(flight)
    flight.beating = {251}
    flight.run(5)
    assert flight.arm() == FAILED
    said(flight, "HNDO: guard stopped while armed")
    return f"GCS failsafe RTL +{waited_s:.0f} s; {landing}; no arming"


def stopped_and_started_again(flight: Flight) -> Outcome:
    """Off and on in flight with the companion alive: it goes on. Then again, and the companion dies meanwhile."""
    in_guided(flight)
    stop_scripting(flight)
    flight.statuses.clear()
    flight.set_parameter("SCR_ENABLE", 1)
    flight.until(lambda: flight.is_state(LIVE), 10, "the guard is back")
    assert flight.mode == GUIDED
    flight.pace(SPEEDUP)
    stop_scripting(flight)
    flight.sending = False
    flight.statuses.clear()
    flight.set_parameter("HNDO_TIMEOUT", 3)
    flight.set_parameter("SCR_ENABLE", 1)
    started_ms = flight.now_ms
    flight.until(lambda: flight.mode == RTL, 8, "RTL")
    waited_s = (flight.now_ms - started_ms) / 1000
    return f"goes on; companion dead meanwhile: RTL +{waited_s:.0f} s; {landed_at_home(flight)}"


CASES = (
    Case(
        "busy second script",
        loss(in_guided, cut, came_home),
        {"SCR_HEAP_SIZE": 307_200},  # on 4.5 the guard alone fills the recommended one, in a 64-bit SITL
        beside={"busy.lua": BUSY, "busy_too.lua": BUSY},
    ),
    Case("second script that initialises the queue in flight", queue_taken, beside={"neighbour.lua": TAKES_THE_QUEUE}),
    Case("command to stop or restart scripting", stop_denied),
    Case("SCR_ENABLE 0, companion dead", stopped_and_companion_dead),
    Case("SCR_ENABLE 0 and 1 in flight", stopped_and_started_again),
)
test_scripting = flights(CASES)
