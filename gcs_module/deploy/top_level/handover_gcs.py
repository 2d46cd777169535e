# SPDX-License-Identifier: GPL-3.0-or-later

"""`module load handover_gcs`: MAVProxy loads a top-level module of this name. The code is in `gcs_module.module`."""

from mavproxy_handover.supervision.must_load import starter

init = starter("handover_gcs", "gcs_module.module")
