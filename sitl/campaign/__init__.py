# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover campaign`: random flights with random faults over the real rules, in simulated time, judged by the truth.

What is real: the vehicle's `Arbiter` with its strategy, the stations' `StationCore`, the zone finder, the energy model,
the route check, the choice of the place. What is simulated: everything around them.

* `plan.py` draws a flight from a seed: stations and zones, mission, wind, links, energy as it really is, faults.
  `steering.py` chooses what strikes when, so that every pair of causes comes up in every phase.
* `aircraft.py` is where the aircraft really is, what it really uses, and what its autopilot does by itself; `guard.py`
  the guard; `links.py` what becomes of a message.
* `companion.py`, with `places.py`, `gaps.py` and `commands.py`, and `stations.py` are the edges of the rules. Nothing
  else knows an event or an action of theirs.
* `world.py` puts them together and lets time pass, in steps or from one thing that matters to the next (`pace.py`).
* `log.py` keeps what really happened, `judge.py` says by that alone what was unsafe and how the flight ended.
* `work.py` flies many seeds (Dask), `outcome.py` and `figures.py` count, `page.py` and `pictures.py` show;
  `compare.py` flies both ways.
"""
