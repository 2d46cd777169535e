# SPDX-License-Identifier: GPL-3.0-or-later

"""Types that authority and safety share: model, limits, causes, events, messages, state of the aircraft."""
