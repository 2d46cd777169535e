# SPDX-License-Identifier: GPL-3.0-or-later

"""What follows from a frame of a station after the verdict of the gate."""
