# SPDX-License-Identifier: GPL-3.0-or-later

"""What makes it happen: processes, wires between them, and the one thread that plays a scenario."""
