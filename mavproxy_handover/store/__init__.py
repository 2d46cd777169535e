# SPDX-License-Identifier: GPL-3.0-or-later

"""Files on the disk: journal, keys, replay state, and the state of authority from which a restart goes on."""
