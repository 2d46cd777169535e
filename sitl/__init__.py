# SPDX-License-Identifier: GPL-3.0-or-later

"""Simulation: real processes on loopback, played through scenarios. Nothing here runs on an aircraft.

* `report/`: what was seen and what comes of it. Reads journals and the aircraft's telemetry, and draws and writes the
  report.
* `script/`: what a scenario says. Its words, what each does to a flight or wants of it, and the reader of its files.
* `vehicles/`: what flies, ArduPilot's own SITL program or the copter model that ships here.
* `sim_time.py`: the clocks that all programs of a flight share. It imports nothing of ours.
* `run/`: what makes it happen. Wires companion and stations to the vehicle, starts all of them, plays the scenario; and
  the programs that stand in between: bad links, the rogue, a station of the standard.
* `campaign/`: random flights over the real rules in simulated time, without any process, judged by the truth.
* `bench/`: measures speed and transfers with the parts of `run/`.

Imports run one way: `run` takes from `vehicles`, `script` and `report`, `script` from `report`; `report` and `vehicles`
from none of them; `campaign` from `report` alone. The commands are `main.py` (`handover sim`), `campaign/main.py`
(`handover campaign`) and `fly_all.py`; the files in `scenarios/` are data.
"""
