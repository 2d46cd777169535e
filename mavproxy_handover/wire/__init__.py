# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVLink: frames, dialect, lease, and the transport of mission packages. No sockets, no clock."""
