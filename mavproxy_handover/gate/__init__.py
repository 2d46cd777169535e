# SPDX-License-Identifier: GPL-3.0-or-later

"""The filter between stations and autopilot: allow-list, default deny, refusals in each protocol's own words.

`tables` is the policy, collected from `message_rules`, `command_rules`, `part_rules`, `parameters` and `files`;
`policy` finds a frame's row in it, `judge` decides, `questions` keeps who asks too much waiting, `latent` keeps out
sticks that ran before their station had control, `refusals` answers, `explain` says it in words. `downlink` chooses
what each station hears, `observers` how often; `flush` closes what a former commander left open. Everything here is
pure: no sockets, no clock; time is an argument.
"""
