# SPDX-License-Identifier: GPL-3.0-or-later

"""Replay: a recorded flight through today's rules, with any mission and any limits (`docs/replay.md`).

`recording.py` reads the flight as messages of the autopilot, from a tlog, a dataflash log (`dataflash.py`) or a table
(`table.py`); `happened.py` reads the journal beside it; `settings.py` makes the configurations. `flight.py` lets time
pass and feeds the real edge of the autopilot and the real rules; `ground.py` answers for the stations, by the journal
or by assumption. `compare.py` compares the result with what happened, and `main.py` prints it.
"""
