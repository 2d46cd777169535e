# SPDX-License-Identifier: GPL-3.0-or-later

"""Where the aircraft is: by the autopilot's word or by the position box's, and whether that word counts."""
