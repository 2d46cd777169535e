# SPDX-License-Identifier: GPL-3.0-or-later

"""The filter between stations and autopilot: an allow-list that refuses by default, and answers in each protocol.

`policy/tables` collects the policy; `policy/rows` finds the row of a frame in it. `judge` decides by the row and by the
authority in force. `filters` may change that verdict. `refusals` answers what is refused, and `explain` describes the
policy. `downlink` chooses what each station hears, and `observers` how often. `flush` closes what a former commander
left open. Everything here is pure: no sockets, no clock; time is an argument.
"""
