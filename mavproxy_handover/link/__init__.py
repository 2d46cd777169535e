# SPDX-License-Identifier: GPL-3.0-or-later

"""The stations' links: devices that move bytes, a monitor that measures them, a bundle that makes several of them one.

* `forms`: device strings, as pymavlink writes them, into values.
* `base`, `udp`, `tcp`, `serial_line`: the devices; none of them blocks, and none raises once it is made.
* `devices`: makes the device that a string names.
* `quality`, `timesync`, `monitor`: what is measured on one link, and when it is too bad.
* `outlet`: one link's way out: frames numbered for it, so that what is missing at the other end is what it lost.
* `bundle`: several links of one station: duplicates out, the best way down, fail-over.

Who may speak on a link is not known here: a caller says which frames were genuine (`LinkBundle.accept`), and only
then is their sender answered and are they counted.
"""
