# SPDX-License-Identifier: GPL-3.0-or-later

"""Which rules a campaign has flown: every module that a flight depends on counts, and no other state flies along."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sitl.campaign import work
from sitl.campaign.main import main
from sitl.campaign.rules import modules, rules
from sitl.campaign.work import Campaign, CampaignError, Flights, fly_all
from tests.depth import first
from tests.sitl.plant_in_strategy import PACKAGES, ROOT

_LOADED = """
import sys, sitl.campaign.outcome
print("\\n".join(name for name in sys.modules if name.split(".")[0] in ("mavproxy_handover", "gcs_module", "sitl")))
"""
_DIGEST = "from sitl.campaign.rules import rules; print(rules())"


def _python(command: str, home: Path) -> list[str]:
    answered = subprocess.run([sys.executable, "-c", command], cwd=home, capture_output=True, text=True, check=True)
    return answered.stdout.split()


def test_what_flying_loads_is_what_counts() -> None:
    assert set(modules()) == set(_python(_LOADED, ROOT))


@pytest.fixture(scope="module")
def copied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the packages, whose digest is that of this run."""
    home = tmp_path_factory.mktemp("packages")
    for package in PACKAGES:
        shutil.copytree(ROOT / package, home / package, ignore=shutil.ignore_patterns("__pycache__"))
    assert _python(_DIGEST, home) == [rules()]
    return home


@pytest.mark.parametrize(
    ("file", "counts"),
    first(
        3,
        [
            ("mavproxy_handover/core/safety/strategy.py", True),
            ("sitl/campaign/judge.py", True),
            ("gcs_module/menu.py", False),
            ("mavproxy_handover/mission/geodesy.py", True),
            ("gcs_module/core.py", True),
            ("sitl/campaign/page.py", False),
            ("mavproxy_handover/operator/stations/event_log.py", False),
        ],
    ),
)
def test_a_changed_module_is_another_digest_if_flights_depend_on_it(file: str, counts: bool, copied: Path) -> None:
    before = (copied / file).read_bytes()
    try:
        (copied / file).write_bytes(before + b"# another line\n")
        assert (_python(_DIGEST, copied) != [rules()]) is counts
    finally:
        (copied / file).write_bytes(before)


def test_flights_of_other_rules_are_not_added_to_a_folder(tmp_path: Path) -> None:
    Flights(tmp_path, Campaign(0, 5))
    about = json.loads((tmp_path / "campaign.json").read_text())
    assert about["rules"] == rules()
    (tmp_path / "campaign.json").write_text(json.dumps({**about, "rules": "0123456789ab"}))
    with pytest.raises(CampaignError, match="rules differ"):
        Flights(tmp_path, Campaign(0, 5))


@pytest.mark.parametrize(("text", "says"), [("{", r"campaign\.json: no JSON"), ("[]", "holds another campaign")])
def test_a_file_that_is_none_of_a_campaign_is_named(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "campaign.json").write_text(text)
    with pytest.raises(CampaignError, match=says):
        Flights(tmp_path, Campaign(0, 5))


def test_a_folder_that_cannot_be_is_named_once(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CampaignError) as caught:
        Flights(tmp_path / "file" / "campaign", Campaign(0, 5))
    assert str(caught.value).count("campaign") == 1


def test_a_story_is_one_flight(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--story", "--runs", "3"]) == 2
    assert main(["--story", "--compare"]) == 2
    assert "--story tells of one flight" in capsys.readouterr().err


def test_a_worker_with_other_rules_flies_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    asked_with = rules()
    monkeypatch.setattr(work, "rules", lambda: "0123456789ab")
    with pytest.raises(CampaignError, match=f"its rules are 0123456789ab, not {asked_with}"):
        work._fly_batch([1], asked_with)
    assert [each.seed for batch in fly_all(Campaign(1, 1), (), 1, None) for each in batch] == [1]
