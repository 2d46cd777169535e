# SPDX-License-Identifier: GPL-3.0-or-later

"""Authority handover at a ground station.

`core` holds the rules (pure), `module` is the MAVProxy module, `view` shows everything to the operator.
"""
