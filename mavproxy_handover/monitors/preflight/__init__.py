# SPDX-License-Identifier: GPL-3.0-or-later

"""Whether guard, parameters, firmware and mission of the autopilot fit each other, judged before the flight."""
