# SPDX-License-Identifier: GPL-3.0-or-later

"""MAVLink at the edge: frames, the dialect, the lease, and the transport of mission packages. No sockets, no clock."""
