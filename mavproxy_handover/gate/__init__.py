# SPDX-License-Identifier: GPL-3.0-or-later

"""The filter between stations and autopilot: allow-list, default deny, refusals in each protocol's own words.

`tables` is the policy, `policy` finds a frame's row in it, `judge` decides, `refusals` answers, and `downlink`
chooses what each station hears. Everything here is pure: no sockets, no clock; time is an argument.
"""
