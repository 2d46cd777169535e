# SPDX-License-Identifier: GPL-3.0-or-later

"""Authority handover for ArduPilot vehicles: the companion computer's side.

`core` holds the rules and `gate` judges frames. `wire` speaks MAVLink and `mission` reads mission packages. `module` is
the MAVProxy module that ties them to the autopilot and to the stations.
"""
