# SPDX-License-Identifier: GPL-3.0-or-later

"""Fixtures of the gate's tests."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from mavproxy_handover.wire.frames import Frame
from tests.gate.frames import make_frame


@pytest.fixture(scope="session")
def make() -> Callable[..., Frame]:
    return make_frame
