# SPDX-License-Identifier: GPL-3.0-or-later

"""The rules of the language linter: each finds what it names and nothing else, and clean folders stay clean."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.structure.language import ALLOWED, CLEAN, ROOT, RULES, TERMS, Text, check, findings, main, read, shown
from tests.structure.shown import help_texts, message_texts

#: rule -> a text with a finding of this rule, a text without one; a first paragraph of a module where that matters
EXAMPLES = {
    "person": ("Whoever asks gets an answer.", "Every station that asks gets an answer."),
    "he": ("The pilot keeps what he has.", "The pilot keeps the sticks. The header is theirs."),
    "machine-who": (
        "A station, who is silent, is lost.",
        "A station whose link is silent is lost. An operator who asks.",
    ),
    "who": ("Who floods a link is refused.", "A sender that floods a link is refused. Who commands?"),
    "behind": ("It is written behind the main loop.", "A station behind a router falls behind the others."),
    "so-long": ("Wait so long at most.", "Wait at most this long. It is not so long."),
    "inversion": ("Shown is the state.", "The state is shown. What should it do?"),
    "none-the": ("The next job is none the worse.", "The next job still runs. None of them is worse."),
    "alone": ("The file is the user's alone.", "Only the user can read the file. Leave it alone."),
    "but": ("It names nothing but the link.", "It names only the link, but not the station."),
    "riddle": ("What comes of it is told.", "The result is logged. It comes of age."),
    "archaic": ("It begins anew.", "It starts again. Then here is the answer."),
    "above": ("As above, for planes.", "The hold-off of a plane. A value above the limit is refused."),
    "first-what": ("What a link is.", "A link. What it is."),
    "first-it": ("It is silent.", "True if the link is silent."),
    "first-long": (" ".join(["word"] * 21) + ".", " ".join(["word"] * 20) + ". " + " ".join(["word"] * 20)),
    "long": (" ".join(["word"] * 26) + ".", " ".join(["word"] * 25) + "; " + " ".join(["word"] * 25)),
}
#: for each old name a text with it, and for all of them texts in which the words mean something else
OLD_NAMES = [
    "The helm is read.",
    "The lookout is told.",
    "A conductor moves it.",
    "The narrator writes.",
    "The teller says it.",
    "The command desk refuses it.",
    "Tongues of programs.",
    "A latent stick.",
    "The outlet numbers it.",
    "A lifeline ends.",
    "The keeper saves.",
    "The rehearsal book.",
    "A slip of the map.",
    "The patient is a machine.",
    "A breath of the disk.",
    "Its own voice.",
    "The place of a return is home.",
    "While the sign of a fault lasts, a sign is there.",
]
OTHER_WORDS = [
    "`narrator.py` writes it.",
    "The signs of life come every second.",
    "A number of 32 bits with a sign.",
    "The place where it lands has five decimal places.",
    "The desktop shows the helmet.",
]


def rules_of(text: str, kind: str = "code", first: str = "") -> set[str]:
    return {rule for _line, rule, _excerpt, _advice in check(Text(kind, 1, text, first))}


def test_every_rule_has_its_examples() -> None:
    assert {rule.name for rule in RULES} == {*EXAMPLES, "term"}
    assert len(OLD_NAMES) == len(TERMS)


@pytest.mark.parametrize("rule", EXAMPLES)
def test_a_rule_finds_what_it_names_and_nothing_else(rule: str) -> None:
    hit, miss = EXAMPLES[rule]
    first = "module or class" if rule.startswith("first-") else ""
    assert rule in rules_of(hit, first=first)
    assert rule not in rules_of(miss, first=first)


@pytest.mark.parametrize(("old", "text"), list(zip(TERMS, OLD_NAMES, strict=True)))
def test_an_old_name_is_found(old: str, text: str) -> None:
    assert f"the term is '{TERMS[old]}'" in {advice for _line, _rule, _excerpt, advice in check(Text("code", 1, text))}


@pytest.mark.parametrize("text", OTHER_WORDS)
def test_other_words_are_no_old_names(text: str, tmp_path: Path) -> None:
    (tmp_path / "page.md").write_text(text, encoding="utf-8")
    (paragraph,) = read(tmp_path / "page.md")
    assert rules_of(paragraph.text) == set()


def test_a_message_is_shorter_than_other_sentences() -> None:
    assert "long" in rules_of(" ".join(["word"] * 21), "message")
    assert "long" not in rules_of(" ".join(["word"] * 20), "message")


def test_a_function_may_say_what_it_returns() -> None:
    assert "first-what" not in rules_of("What is left (Wh).", first="function")
    assert "first-it" in rules_of("It is flying.", first="function")


PYTHON = '''# SPDX-License-Identifier: X
"""A module
of two lines."""

import re

#: a comment of two lines, with a sentence. It
#: is ended by `code that is one word`
X = 1  # beside code


class A:
    """A class."""

    def f(self, n):
        """A function.

        * an item
          of two lines
        """
        raise ValueError(f"{n} m are too much: " f"the limit is {X} m", "key", "a b=c {}", re.compile(r"no [a-z]+"))
'''


def test_what_is_read_of_python(tmp_path: Path) -> None:
    (tmp_path / "code.py").write_text(PYTHON, encoding="utf-8")
    assert sorted((t.line, t.kind, t.text, t.first) for t in read(tmp_path / "code.py")) == [
        (2, "code", "A module\nof two lines.", "module or class"),
        (7, "code", "a comment of two lines, with a sentence. It\nis ended by X", ""),
        (9, "code", "beside code", ""),
        (13, "code", "A class.", "module or class"),
        (16, "code", "A function.", "function"),
        (18, "code", "an item\nof two lines", ""),
        (21, "message", "X m are too much: the limit is X m", ""),
    ]


def test_what_is_read_of_lua(tmp_path: Path) -> None:
    source = '-- a comment\n-- of two lines\nlocal x = 1 -- beside code\nsay(3, "Guard: no lease for %d s", "key")\n'
    (tmp_path / "guard.lua").write_text(source, encoding="utf-8")
    assert sorted((t.line, t.kind, t.text) for t in read(tmp_path / "guard.lua")) == [
        (1, "code", "a comment\nof two lines"),
        (3, "code", "beside code"),
        (4, "message", "Guard: no lease for X s"),
    ]


LUA_BLOCKS = """--[[
  // @Param: HNDO_X
  // @Description: A value of
  // @User: Standard
--]]
--[[
The theory

of two lines and
a list

  CALM   is there
  OVER   is gone. It goes
         on
--]]
-- fields of a table:
--   first, last  a number
--   each         another one
"""


def test_what_is_read_of_blocks_and_lists_of_lua(tmp_path: Path) -> None:
    (tmp_path / "guard.lua").write_text(LUA_BLOCKS, encoding="utf-8")
    assert sorted((t.line, t.text) for t in read(tmp_path / "guard.lua")) == [
        (2, "HNDO_X"),
        (3, "A value of"),
        (4, "Standard"),
        (7, "The theory"),
        (9, "of two lines and\na list"),
        (12, "is there"),
        (13, "is gone. It goes\non"),
        (16, "fields of a table:"),
        (17, "a number"),
        (18, "another one"),
    ]


def test_what_is_read_of_a_parameter_file(tmp_path: Path) -> None:
    source = "# RTL to\n# the return site.\nFS_X 1\n\n# Not set:\n#   FS_Y  a value\n#         of two lines\n"
    (tmp_path / "x.parm").write_text(source, encoding="utf-8")
    assert [(t.line, t.text) for t in read(tmp_path / "x.parm")] == [
        (1, "RTL to\nthe return site."),
        (5, "Not set:"),
        (6, "a value\nof two lines"),
    ]


def test_what_is_read_of_a_document(tmp_path: Path) -> None:
    source = "# A head\n\nA [link](x.md) and\n`code`.\n\n```\nnobody\n```\n\n    nobody\n\n"
    source += "| a | b |\n|---|---|\n| c `d` | e |\n- item\n"
    (tmp_path / "page.md").write_text(source, encoding="utf-8")
    assert [(t.line, t.text) for t in read(tmp_path / "page.md")] == [
        (1, "A head"),
        (3, "A link and\nX."),
        (12, "a"),
        (12, "b"),
        (14, "c X"),
        (14, "e"),
        (15, "item"),
    ]


def test_a_finding_names_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code = tmp_path / "code.py"
    code.write_text('"""A module."""\n\nX = "it is told to nobody here"\n', encoding="utf-8")
    monkeypatch.setattr("tests.structure.language.ROOT", tmp_path)
    assert main(["code.py"]) == 1
    told = capsys.readouterr()
    assert told.out.startswith("code.py:3: person: 'it is told to nobody here': name the ")
    assert told.err == "1 findings\n"
    code.write_text('"""A module."""\n', encoding="utf-8")
    assert main(["code.py"]) == 0


def test_a_finding_in_a_document_names_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "page.md").write_text("It is fine.\nIt is told to nobody.\n", encoding="utf-8")
    monkeypatch.setattr("tests.structure.language.ROOT", tmp_path)
    assert main(["page.md"]) == 1
    told = capsys.readouterr()
    assert told.out.startswith("page.md:2: person: ")
    assert told.err == "1 findings\n"


def test_message_tables_and_help_have_no_finding() -> None:
    assert [str(finding) for finding in shown()] == []


def test_message_tables_and_help_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    texts = [text.text for _where, text in (*message_texts(), *help_texts())]
    assert len(texts) > 1500
    assert "X commands, epoch X." in texts
    monkeypatch.setattr(
        "tests.structure.shown.help_texts", lambda: [("handover x --help", Text("message", 1, "Whoever."))]
    )
    assert [(finding.path, finding.rule) for finding in shown()] == [("handover x --help", "person")]


def test_every_exception_is_needed_and_has_a_reason() -> None:
    for path, rule, text, reason in ALLOWED:
        assert reason
        texts = [shown_text for where, shown_text in message_texts() if where == path] or read(ROOT / path)
        held = {(found, excerpt) for t in texts for _line, found, excerpt, _advice in check(t)}
        assert any(found == rule and text in excerpt for found, excerpt in held), (path, rule, text)


@pytest.mark.parametrize("path", CLEAN)
def test_a_clean_folder_stays_clean(path: str) -> None:
    assert (ROOT / path).exists()
    assert [str(finding) for finding in findings([path])] == []
