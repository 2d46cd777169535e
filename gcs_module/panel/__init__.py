# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover panel`: a web page for the operator, in a process of its own beside the station's MAVProxy.

Theory of operation
-------------------
The station's module collects what it knows (`collect.py`) into a snapshot (`snapshot.py`). `publisher.py` sends it as
JSON lines over a local socket (`endpoint.py`), some times a second, and reads orders from the same socket
(`orders.py`). An order runs the same function as the operator's typed command.

The panel's process reads the lines (`reader.py`). `band.py` decides what the band says: which station commands, what
comes next, what the operator has to do. `panel_values.py` makes the other parts of the page, `page.py` serves it, and
`panel_auth.py` checks who may use it.

Rules that live here
--------------------
* The station's main loop never waits for the panel. A reader that is slow, silent or hostile is dropped.
* Every value has the time when it was heard. The page never shows an old value as a new one.
* An answer carries the number of its question. If another question has taken its place, the answer is not used.
* Buttons need the token of the operator's own browser. Other programs of the same user are trusted, as they are at
  MAVProxy's terminal.
"""
