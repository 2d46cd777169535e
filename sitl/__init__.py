# SPDX-License-Identifier: GPL-3.0-or-later

"""Simulation: real processes on loopback, played through scenarios. Nothing here runs on an aircraft.

* `report/`: observations and results. Reads journals and the aircraft's telemetry, and draws and writes the report.
* `script/`: the language of scenarios. Its words, what each does to a flight or expects of it, and the reader of its
  files.
* `vehicles/`: the vehicles, ArduPilot's own SITL program or the copter model that ships here.
* `sim_time.py`: the clocks that all programs of a flight share. It imports nothing of ours.
* `run/`: runs a simulation. Connects companion and stations to the vehicle, starts all of them, plays the scenario; and
  the programs in between: bad links, the rogue, a station of the standard.
* `campaign/`: random flights over the real rules in simulated time, without any process, judged by the truth.
* `bench/`: measures speed and transfers with the parts of `run/`.

Imports go one way: `run` imports `vehicles`, `script` and `report`, `script` imports `report`; `report` and `vehicles`
import none of them; `campaign` imports only `report`. The commands are `main.py` (`handover sim`), `campaign/main.py`
(`handover campaign`) and `fly_all.py`; the files in `scenarios/` are data.
"""
