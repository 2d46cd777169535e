# SPDX-License-Identifier: GPL-3.0-or-later

"""What the companion itself answers and tells the operators at the stations."""
