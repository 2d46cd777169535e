# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover bench hosts`: the bench of chapter 5 of the thesis, on network namespaces of one machine.

Each computer of the bench is a network namespace with addresses of its own: the mission computer with the aircraft,
each station's computer, the gateway with the route of listing 5.3, and the LTE network. The programs are those of
`handover sim`.
"""
