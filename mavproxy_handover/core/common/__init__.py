# SPDX-License-Identifier: GPL-3.0-or-later

"""The words that authority and safety share: types, limits, causes, events, messages, and what the aircraft said."""
