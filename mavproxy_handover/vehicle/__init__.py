# SPDX-License-Identifier: GPL-3.0-or-later

"""What the autopilot says of the vehicle: one state, with the time of each value, and the firmwares that are known."""
