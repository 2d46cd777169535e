# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover watch`: a page for those who watch. It listens, and sends nothing to any aircraft or station, ever.

Theory of operation
-------------------
What is written down (`tail.py`, `journals.py`) or heard on a link (`passive_link.py`, `link_reader.py`) becomes one
picture of all aircraft and stations (`scene.py`), in which every value knows when it was said. `page_values.py` turns
it into what a browser is given, `page.py` gives it once a second, `web_auth.py` decides who may look. Only `page.py`
knows the web stack.

Rules that live here
--------------------
* Nothing is sent, written or locked: files are opened for reading, sockets are read from.
* What is old is shown with its age, and never as if it were new.
* Whatever arrives is bounded: lines, frames, aircraft, stations, tracks, the feed, viewers.
* What cannot be understood is counted and left out. Nothing that arrives ends the page.
"""
