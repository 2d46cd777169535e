# SPDX-License-Identifier: GPL-3.0-or-later

"""What is on the disk: journal, keys, replay state, and the state of authority that a restart goes on from."""
