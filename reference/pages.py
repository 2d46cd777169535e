# SPDX-License-Identifier: GPL-3.0-or-later

"""Which files are generated, whole or in part, and what each should hold."""

from __future__ import annotations

from pathlib import Path

from reference import ROOT
from reference.blocks import blocks
from reference.completion import completion
from reference.configuration import configuration, mission
from reference.locked import locked
from reference.manual import manual
from reference.messages import messages
from reference.parameters import parameters
from reference.requirements import requirements
from reference.typed import typed

__all__ = ["REFERENCE", "generated"]

REFERENCE = ROOT / "docs" / "reference"


def generated() -> dict[Path, str]:
    """Path and content of each."""
    return {
        REFERENCE / "messages.md": messages(),
        REFERENCE / "configuration.md": configuration(),
        REFERENCE / "mission.md": mission(),
        REFERENCE / "commands.md": typed(),
        REFERENCE / "parameters.md": parameters(),
        REFERENCE / "locked.md": locked(),
        ROOT / "docs" / "requirements.md": requirements(),
        **manual(),
        **completion(),
        **blocks(),
    }
