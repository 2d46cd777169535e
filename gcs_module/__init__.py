# SPDX-License-Identifier: GPL-3.0-or-later

"""Authority handover, the ground station's side: `core` holds the rules (pure), `module` is the MAVProxy module, `view`
what the operator sees."""
