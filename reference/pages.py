# SPDX-License-Identifier: GPL-3.0-or-later

"""The pages of the reference, by the name of their file in `docs/reference/`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from reference import ROOT
from reference.configuration import configuration, mission
from reference.exchange import exchange
from reference.locked import locked
from reference.messages import messages
from reference.parameters import parameters
from reference.requirements import requirements
from reference.scenarios import scenarios
from reference.typed import typed

__all__ = ["FOLDER", "PAGES"]

FOLDER: Final = ROOT / "docs" / "reference"
#: name -> what writes it
PAGES: Final[Mapping[str, Callable[[], str]]] = {
    "commands.md": typed,
    "configuration.md": configuration,
    "exchange.md": exchange,
    "locked.md": locked,
    "messages.md": messages,
    "mission.md": mission,
    "parameters.md": parameters,
    "requirements.md": requirements,
    "scenarios.md": scenarios,
}
