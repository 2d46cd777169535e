# SPDX-License-Identifier: GPL-3.0-or-later

"""The position of the aircraft: by the autopilot or by the position box, and whether that source counts."""
