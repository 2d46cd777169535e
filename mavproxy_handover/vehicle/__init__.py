# SPDX-License-Identifier: GPL-3.0-or-later

"""The state of the vehicle, with the time of each value, and the profiles of aircraft."""
