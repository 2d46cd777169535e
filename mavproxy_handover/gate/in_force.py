# SPDX-License-Identifier: GPL-3.0-or-later

"""The authority that is in force: the view by which every frame is judged. `core/authority/authority.py` makes it."""

from __future__ import annotations

from mavproxy_handover.core.common.model import AuthorityView

__all__ = ["AuthorityInForce"]


class AuthorityInForce:
    """Of one vehicle. Only `Gate.change` replaces `view`, as a whole."""

    __slots__ = ("view",)

    def __init__(self) -> None:
        self.view = AuthorityView(armed=True)

    def commands(self, station: int) -> bool:
        """Whether this station (system id) has authority."""
        return self.view.commander == station
