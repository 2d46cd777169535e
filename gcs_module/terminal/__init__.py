# SPDX-License-Identifier: GPL-3.0-or-later

"""The station's terminal: a status line that stays, colour, the prompt, and MAVProxy's lines that say nothing.

* `noise`: the table of lines that are left out, and of events that MAVProxy tells a second time. Data only.
* `lines`: the filter in MAVProxy's console. It leaves out, holds back and colours lines.
* `look`: the words of status line and prompt, and their colours. Pure.
* `screen`: writes lines above the input and the status line below it. It knows only the terminal's control sequences.
* `terminal`: connects them with MAVProxy.
"""
