# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover campaign`: random flights with random faults over the real rules, in simulated time, judged by the truth.

Real are the vehicle's `Arbiter` with its strategy and the stations' `StationCore`. The zone finder, the energy model,
the route check, and the choice of the return site are real, too. Everything around them is simulated.

* `plan.py` draws a flight from a seed: stations and zones, mission, wind, links, true energy, faults. `steering.py`
  chooses faults and their times, so that every pair of causes occurs in every phase.
* `aircraft.py` is the true place of the aircraft, its true consumption, and what its autopilot does by itself;
  `guard.py` the guard; `links.py` the fate of a message.
* `companion.py`, with `places.py`, `gaps.py` and `commands.py`, and `stations.py` are the edges of the rules. Only
  these modules know events and actions of the rules.
* `world.py` puts them together and lets time pass, in steps or from one relevant moment to the next (`pace.py`).
* `log.py` keeps what really happened. `judge.py` finds only from that what was unsafe and how the flight ended.
* `work.py` flies many seeds (Dask), `outcome.py` and `figures.py` count, `page.py` and `pictures.py` show; `compare.py`
  flies both ways.
"""
