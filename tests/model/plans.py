# SPDX-License-Identifier: GPL-3.0-or-later

"""What is explored: the first states of QUICK in every test run, DEEP by `make explore`.

What takes long is bounded by a depth in QUICK, and by a number of states in DEEP. From each state the world is run on
until it rests: a bound leaves out faults that come late, not the end of a transfer.

The number of faults is that of one schedule: "2 faults" means every way in which up to two of the kinds named can
strike, each at every point. In every schedule, stations that are dead may come back and links that are cut may heal at
any time, the aircraft may fly on at any time, and operators answer at any time or never.
"""

from __future__ import annotations

from mavproxy_handover.core.common.model import StandingConsent
from tests.model.setting import IMPATIENT, LUCKY, Fault, Request, Setting

__all__ = ["DEEP", "QUICK"]

MESSAGES = frozenset({Fault.LOSE, Fault.DOUBLE, Fault.HOLD})
CRASHES = frozenset({Fault.RESTART_STATION, Fault.KILL_STATION, Fault.RESTART_VEHICLE, Fault.KILL_VEHICLE})
BLANK = frozenset({Fault.BLANK_VEHICLE})
#: what a station can ask the vehicle for, and what of that moves authority by itself
ASKED = frozenset(Request) - {Request.WISH}
TAKES = frozenset({Request.CONTROL, Request.GIVE})
GAPS = CRASHES | {Fault.CUT}
LOST, WEAK, DEATHS = frozenset({Fault.LOSE}), frozenset({Fault.WEAK}), frozenset({Fault.KILL_STATION})
SHORT, DEAF = frozenset({Fault.SHORT}), frozenset({Fault.DEAF})
#: a zone calls while another station may ask, then the commander's ends
PAIRS = ("AC", "ABC", "aBC")

QUICK = (
    Setting("transfer", faults=1),
    Setting("transfer, messages", faults=2, kinds=MESSAGES, limits=IMPATIENT),
    Setting("transfer, crashes", path=("AB",), faults=2, kinds=CRASHES, depth=16),
    Setting("downlinks", faults=2, kinds=DEAF, limits=LUCKY, depth=9),
    Setting("liars", faults=2, kinds=frozenset({Fault.LIE})),
    Setting("weak links", faults=1, kinds=WEAK),
    Setting("energy", path=("AB", "aB", "B"), faults=1, kinds=SHORT, depth=20),
    Setting("through the region", path=("A", "AB", "B"), faults=1, depth=16),
    Setting("zone about to end", path=("AB", "aB", "B"), faults=1, depth=16),
    Setting("held at the border", path=("A", "a", "AB", "aB"), faults=1, kinds=DEATHS, depth=24),
    Setting("gap between the zones", path=("A", "", "B"), faults=1, depth=14),
    Setting("gap that the mission declares", path=("A", "=", "B"), faults=1, kinds=DEATHS, depth=20),
    Setting("awaited at a waypoint", path=("AB?", "AB", "aB"), faults=1, kinds=CRASHES, depth=18),
    Setting("commander's operator", operators="A", faults=0),
    Setting("partner's operator", operators="B", faults=0),
    Setting("one request", faults=0, requests=1, wishes=frozenset(Request)),
    Setting("two requests in the region", path=("AB",), faults=0, requests=2, wishes=ASKED, depth=12),
    Setting("request and fault", path=("AB",), faults=1, kinds=MESSAGES, requests=1, wishes=ASKED, depth=14),
    Setting(
        "ranks", stations=3, path=("AC", "ABC", "aBC"), operators="A", faults=0, requests=1, wishes=TAKES, depth=12
    ),
    Setting("ranks, a message lost", path=("AB", "aB"), faults=1, kinds=LOST, requests=1, wishes=TAKES, depth=12),
    Setting(
        "ranks, weak links", stations=3, path=("AC", "ABC"), faults=1, kinds=WEAK, requests=1, wishes=TAKES, depth=10
    ),
    Setting("all candidates", stations=3, path=("ABC",), operators="B", faults=1, kinds=DEATHS, depth=24),
    Setting("forced, asked", path=("AB",), operators="B", forced="B", faults=1, kinds=DEATHS, depth=40),
    Setting("forced, one of two asked", stations=3, path=("ABC",), forced="B", faults=1, kinds=DEATHS, depth=24),
    Setting("standard commander", standard="A", faults=1, depth=18),
    Setting("standard commander, automatic", standard="A", consent=StandingConsent.AUTOMATIC, faults=1),
    Setting(
        "standard commander, refuses",
        standard="A",
        consent=StandingConsent.REFUSE,
        faults=1,
        requests=1,
        wishes=TAKES,
        depth=12,
    ),
    Setting("standard partner", standard="B", faults=1, depth=18),
    Setting("standard both", standard="AB", faults=1, requests=1, wishes=ASKED, depth=12),
    Setting("on the ground", path=("_AB", "AB"), faults=1, depth=16),
    Setting("requests on the ground", path=("_AB", "AB"), faults=0, requests=1, wishes=ASKED, depth=13),
    Setting("whole flight", path=("_A", "A", "AB", "B", "_B"), faults=0, depth=20),
    Setting("state file lost", path=("A", "_A", "AB"), faults=1, kinds=BLANK | {Fault.LOSE}, depth=18),
    Setting("three stations", stations=3, path=("AB", "ABC", "BC"), faults=0),
    Setting("three stations, liars", stations=3, path=("A", "AB"), faults=1, kinds=frozenset({Fault.LIE})),
    Setting("three stations, deaths", stations=3, path=("AB", "ABC"), faults=1, kinds=CRASHES, depth=26),
)

DEEP = (
    Setting("transfer", faults=2, states=250_000),
    Setting("transfer, messages", faults=3, kinds=MESSAGES, limits=IMPATIENT, states=2_000_000),
    Setting("transfer, crashes", faults=3, kinds=CRASHES, path=("AB",)),
    Setting("transfer, crashes from afar", faults=2, kinds=CRASHES),
    Setting("downlinks", faults=3, kinds=DEAF, limits=LUCKY, depth=30),
    Setting("transfer, cuts", faults=2, kinds=frozenset({Fault.CUT, Fault.LOSE, Fault.KILL_STATION})),
    Setting("liars", faults=3, kinds=frozenset({Fault.LIE, Fault.HOLD}), states=120_000),
    Setting("weak links", faults=2, kinds=frozenset({Fault.WEAK, Fault.LOSE, Fault.KILL_STATION})),
    Setting("energy", path=("AB", "aB", "B"), faults=2, kinds=SHORT | CRASHES, depth=24),
    Setting("energy at the border", path=("A", "a", "AB", "aB"), faults=2, kinds=SHORT | DEATHS, depth=24),
    Setting(
        "energy in a gap that the mission declares", path=("A", "=", "B"), faults=2, kinds=SHORT | DEATHS, depth=24
    ),
    Setting("through the region", path=("A", "AB", "B"), faults=1, states=120_000),
    Setting("gap between the zones", path=("A", "", "B"), faults=1),
    Setting("there and back", path=("A", "AB", "A", "AB"), faults=1, states=120_000),
    Setting("over the edge", path=("A", "AB", "A", "", "B"), faults=1),
    Setting("zone about to end", path=("AB", "aB", "B"), faults=1),
    Setting("held at the border", path=("A", "a", "AB", "aB"), faults=1, kinds=DEATHS | LOST),
    Setting("held at the border, operators", path=("AB", "aB", "B"), operators="AB", faults=1, kinds=DEATHS, depth=24),
    Setting("gap that the mission declares", path=("A", "=", "B"), faults=1, kinds=GAPS),
    Setting("contact behind a declared gap", path=("A", "=", "=B", "B"), faults=1, kinds=DEATHS),
    Setting("awaited at a waypoint", path=("A", "AB?", "AB", "AB?", "aB", "B"), faults=1),
    Setting("awaited in vain", path=("A", "AB?", "aB?", "B?"), faults=1),
    Setting("whole flight", path=("_A", "A", "AB", "B", "_B"), faults=1, kinds=CRASHES),
    Setting("commander's operator", operators="A", faults=1),
    Setting("partner's operator", operators="B", faults=1),
    Setting("both operators", operators="AB", faults=0),
    Setting("two requests", faults=0, requests=2, wishes=frozenset(Request)),
    Setting("two requests in the region", path=("AB",), faults=0, requests=2, wishes=ASKED),
    Setting(
        "ranks",
        stations=3,
        path=PAIRS,
        operators="A",
        faults=1,
        kinds=LOST | WEAK | DEATHS,
        requests=1,
        wishes=TAKES,
        depth=16,
    ),
    Setting(
        "ranks, partner's operator",
        stations=3,
        path=PAIRS,
        operators="C",
        requests=1,
        wishes=TAKES,
        faults=1,
        kinds=LOST | WEAK | DEATHS,
        depth=16,
    ),
    Setting("forced, asked", path=("AB",), operators="B", forced="B", faults=1, kinds=DEATHS),
    Setting("on the ground", path=("_AB", "AB"), faults=1),
    Setting("forced, both asked", stations=3, path=("ABC",), forced="BC", faults=1, kinds=DEATHS | LOST, depth=24),
    Setting("all candidates", stations=3, path=("AB", "ABC"), operators="B", faults=2, kinds=DEATHS | LOST, depth=16),
    Setting("request and fault", faults=1, requests=1, wishes=ASKED, path=("AB",)),
    Setting("standard commander", standard="A", faults=2, requests=1, wishes=ASKED),
    Setting("standard partner", standard="B", faults=2, requests=1, wishes=ASKED),
    Setting("standard both", standard="AB", faults=1, requests=2, wishes=ASKED),
    Setting("requests on the ground", path=("_AB", "AB"), faults=1, requests=1, wishes=ASKED, kinds=CRASHES),
    Setting("state file lost", path=("A", "_A", "AB"), faults=2, kinds=BLANK | MESSAGES),
    Setting("three stations", stations=3, path=("AB", "ABC", "BC"), faults=1, kinds=MESSAGES | CRASHES),
    Setting("three stations, cuts", stations=3, path=("AB", "ABC"), faults=1, kinds=frozenset({Fault.CUT})),
    Setting(
        "three stations, two deaths", stations=3, path=("AB", "ABC"), faults=2, kinds=frozenset({Fault.KILL_STATION})
    ),
    Setting("three stations, two faults", stations=3, path=("AB", "ABC", "BC"), faults=2, depth=12),
)
