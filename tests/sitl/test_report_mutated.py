# SPDX-License-Identifier: GPL-3.0-or-later

"""`handover report` on folders and logs that were damaged at random: a page or one sentence, never a traceback.

Each mutation is drawn from its number alone, so a failure names the number that shows it again. The suite makes
`SHORT` of them, `--long` makes `LONG`.
"""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sitl.report import page as report_page
from sitl.report.page import main_report
from tests.sitl.recorded import companion_entries, companion_log, dataflash, journal, station_entries, station_log
from tests.sitl.synthetic import write_folder

SHORT, LONG = 24, 1000
#: values that no program writes
ODD: tuple[Any, ...] = (
    None, True, [], {}, "", "x" * 5000, -1, 0, 1e308, 10**400, -(10**30), float("nan"), float("inf"),
    [1, 2], {"a": []}, "\u202e<script>", "../../etc/passwd", 2**63, 0.1,
)  # fmt: skip
DEEP = "[" * 100_000


def mutated_json(text: str, chance: random.Random) -> str:
    """One value of one JSON object replaced, removed or nested."""
    try:
        values = json.loads(text)
    except (ValueError, RecursionError):  # damaged before
        return text
    if not isinstance(values, dict) or not values:
        return DEEP
    key = chance.choice(list(values))
    act = chance.randrange(4)
    if act == 0:
        del values[key]
    elif act == 1:
        values[key] = chance.choice(ODD)
    elif act == 2:
        values = {key: values}
    else:
        inner = values[key]
        if isinstance(inner, dict) and inner:
            inner[chance.choice(list(inner))] = chance.choice(ODD)
        elif isinstance(inner, list) and inner:
            inner[chance.randrange(len(inner))] = chance.choice(ODD)
        else:
            values[key] = [inner]
    return json.dumps(values)


def damage(path: Path, chance: random.Random) -> None:
    """Damage one file: bytes, or one value of a line."""
    data = bytearray(path.read_bytes())
    act = chance.randrange(6)
    if act == 0 or not data:
        path.write_bytes(data[: chance.randrange(len(data) + 1)])
    elif act == 1:
        for _ in range(chance.randrange(1, 50)):
            data[chance.randrange(len(data))] = chance.randrange(256)
        path.write_bytes(data)
    elif act == 2:
        path.write_bytes(bytes(data) + (DEEP.encode() if chance.randrange(2) else chance.randbytes(2000)))
    elif path.suffix in (".json", ".jsonl"):
        text = path.read_text(encoding="utf-8", errors="surrogateescape")  # it may be damaged already
        lines = text.splitlines() if path.suffix == ".jsonl" else [text]
        for _ in range(chance.choice((1, 1, 20, 400))):
            place = chance.randrange(len(lines))
            lines[place] = mutated_json(lines[place], chance)
        path.write_text("\n".join(lines) + "\n", encoding="utf-8", errors="surrogateescape")
    else:
        start = chance.randrange(len(data))
        del data[start : start + chance.randrange(1, 4000)]
        path.write_bytes(data)


def run_folder(folder: Path) -> list[Path]:
    write_folder(folder)
    return [path for path in sorted(folder.rglob("*")) if path.is_file()]


def flight_folder(folder: Path) -> list[Path]:
    folder.mkdir()
    companion_log().write(folder / "drone-1.tlog")
    station_log("GCSA").write(folder / "GCSA.tlog")
    dataflash(folder / "00000001.bin")
    journal(folder / "drone-1.jsonl", "drone-1", companion_entries())
    journal(folder / "GCSA.jsonl", "GCSA", station_entries())
    return [path for path in sorted(folder.rglob("*")) if path.is_file()]


# pymavlink leaves a log open whose beginning it cannot read
@pytest.mark.filterwarnings("ignore:unclosed file", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("make", [run_folder, flight_folder])
def test_a_damaged_folder_gives_a_page_or_one_sentence(
    make: Callable[[Path], list[Path]],
    tmp_path: Path,
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    long = request.config.getoption("--long")
    monkeypatch.setattr(report_page, "_pictures", lambda _record: None)
    monkeypatch.setattr(report_page, "_library", lambda: "")
    original = {path: path.read_bytes() for path in make(tmp_path / "flight")}
    pages = 0
    for number in range((LONG if long else SHORT) // 2):
        chance = random.Random(number)
        for path, data in original.items():
            path.write_bytes(data)
        for _ in range(chance.choice((1, 1, 2, 5))):
            damage(chance.choice(list(original)), chance)
        try:
            code = main_report([str(tmp_path / "flight")])
        except Exception as error:
            raise AssertionError(f"mutation {number} of {make.__name__}") from error
        said = capsys.readouterr()
        if code == 0:
            pages += 1
            assert said.err == "", f"mutation {number}"
        else:
            assert code == 2, f"mutation {number}"
            assert said.err.startswith("handover report: "), f"mutation {number}"
            assert said.err.count("\n") == 1, f"mutation {number}: {said.err[:500]}"
    assert pages > 3, "most of what is damaged can still be reported"


def test_half_a_character_in_a_journal_gives_a_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(report_page, "_pictures", lambda _record: None)
    monkeypatch.setattr(report_page, "_library", lambda: "")
    flight_folder(tmp_path / "flight")
    path = tmp_path / "flight" / "drone-1.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines()
    entry = json.loads(lines[-1])
    entry |= {"event": "decision", "text": "RETURN \udcea"}
    path.write_text("\n".join([*lines, json.dumps(entry)]) + "\n", encoding="utf-8")
    assert main_report([str(tmp_path / "flight"), "--csv", str(tmp_path / "flight.csv")]) == 0
    assert capsys.readouterr().err == ""
