# SPDX-License-Identifier: GPL-3.0-or-later

"""The rules of authority, without I/O.

Everything in this package is pure: standard library only, no clock, no sockets, no MAVLink. Time is an argument
(monotonic seconds). The same objects run in flight, in unit tests, in exhaustive exploration and in simulation.
`tests/core/test_purity.py` walks the imports and holds this promise.

A rule that asks its edge for something adds to the list of actions that it is handed, so that they stand in the order
in which they were asked for and none is lost on the way; only `Arbiter.handle` makes that list, and returns it.
"""
