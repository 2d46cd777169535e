# SPDX-License-Identifier: GPL-3.0-or-later

"""`module load handover`: MAVProxy loads a top-level module of this name.

The code is in `mavproxy_handover.companion.module`.
"""

from mavproxy_handover.supervision.must_load import starter

init = starter("handover", "mavproxy_handover.companion.module")
