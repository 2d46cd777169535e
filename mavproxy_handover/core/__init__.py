# SPDX-License-Identifier: GPL-3.0-or-later

"""The rules of authority and safety, without I/O.

Everything in this package is pure: standard library only, no clock, no sockets, no MAVLink. Time is an argument
(monotonic seconds). The same objects run in flight, in unit tests, in exhaustive exploration and in simulation.
`tests/core/test_purity.py` walks the imports and holds this promise.

`common/` has the words that all rules share. `authority/` and `safety/` do not import each other; `arbiter.py` stands
above both. `tests/structure/test_rules.py` holds that.

A rule asks its caller for something by adding an action to a list. Only `Arbiter.handle` makes this list, and returns
it. So the actions keep their order, and none is lost.
"""
