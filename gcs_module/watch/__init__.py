# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover watch`: a web page that shows all aircraft and stations. It only listens, and never sends to any of them.

Theory of operation
-------------------
Journals (`tail.py`, `journals.py`) and links (`passive_link.py`, `link_reader.py`) are combined to one picture of all
aircraft and stations (`scene.py`), in which every value has a time. `page_values.py` makes the rows for a browser from
it, `page.py` sends them once a second, and `web_auth.py` checks who may see the page. Only `page.py` uses the web
framework.

Rules that live here
--------------------
* Nothing is sent, written or locked: files are opened for reading, sockets are read from.
* Old values are shown with their age, and never as if they were new.
* All input is bounded: lines, frames, aircraft, stations, tracks, the feed, viewers.
* Input that cannot be parsed is counted and left out. No input ends the page.
"""
