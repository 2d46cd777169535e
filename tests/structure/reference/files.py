# SPDX-License-Identifier: GPL-3.0-or-later

"""Which files are generated, whole or in part, and what each should hold."""

from __future__ import annotations

from pathlib import Path

from tests.structure.imports import ROOT
from tests.structure.reference.blocks import blocks
from tests.structure.reference.completion import completion
from tests.structure.reference.configuration import configuration, mission
from tests.structure.reference.locked import locked
from tests.structure.reference.manual import manual
from tests.structure.reference.messages import messages
from tests.structure.reference.parameters import parameters
from tests.structure.reference.requirements import requirements
from tests.structure.reference.typed import typed

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
