# SPDX-License-Identifier: GPL-3.0-or-later

"""Small tools that every part may use."""
