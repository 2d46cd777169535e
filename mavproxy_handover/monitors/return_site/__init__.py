# SPDX-License-Identifier: GPL-3.0-or-later

"""The places where a return may go: which there are, what each is worth, and what the battery leaves for them."""
