# SPDX-License-Identifier: GPL-3.0-or-later

"""Linter for plain English in docstrings, comments, messages and documents.

    python -m tests.structure.language [--count] [FILE OR FOLDER ...]

Without paths it reads `WHERE`, the message tables and every `--help` (`shown.py`). It prints `file:line: rule: excerpt:
advice` for each finding, and ends with 1 if there is one. `--count` prints the number for each folder instead.

What it reads
-------------
* Python: docstrings, comments, and string literals that are prose (`_prose`); Lua: comments and such literals;
  parameter files of ArduPilot: comments.
* In a list of terms in columns, each explanation is a text of its own.
* Markdown: paragraphs, list items, table cells and headings. Code blocks are left out.
* Code in backticks counts as one word of unknown meaning. A formatted value in a message does, too.

Each rule of `RULES` is a pattern and an advice. `ALLOWED` lists the exceptions, each with its reason. Folders and files
of `CLEAN` must have no finding (`test_language.py`); a folder that has become clean is added there.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from inspect import cleandoc
from pathlib import Path
from typing import Final

__all__ = [
    "ALLOWED",
    "CLEAN",
    "RULES",
    "Finding",
    "Rule",
    "Text",
    "blocks",
    "check",
    "findings",
    "plain",
    "read",
    "shown",
    "words",
]

ROOT: Final = Path(__file__).resolve().parents[2]
PAGES: Final = ("docs", "README.md", "missions/README.md", "CONTRIBUTING.md", "SECURITY.md")
WHERE: Final = ("mavproxy_handover", "gcs_module", "sitl", "ardupilot_lua", *PAGES)
#: folders and files without findings
CLEAN: Final = ["ardupilot_lua", "gcs_module", "mavproxy_handover", "sitl", "tests/structure/language.py", *PAGES]
#: (path, rule, text in the excerpt, reason)
ALLOWED: Final[list[tuple[str, str, str, str]]] = [
    ("reference/sentences, group guard", "person", "nobody commands", "the guard's script is pinned by its digest"),
    ("docs/authority.md", "long", "parameter patterns", "a list of numbers, each with its noun"),
]

MACHINES: Final = (
    "station|commander|partner|observer|aircraft|drone|vehicle|autopilot|companion|guard|supervisor|judge|module|"
    "program|process|router|gate|link|frame|sender|client|server|box|computer|thread|machine|host|successor|parent"
)
_LONGEST: Final = {"message": 20, "code": 25, "document": 25}
_LONGEST_FIRST: Final = 20


@dataclass(frozen=True, slots=True)
class Rule:
    """`pattern` is searched in each text of the kinds `kinds`; "" stands for a count in `_counted`."""

    name: str
    pattern: str
    advice: str
    kinds: tuple[str, ...] = ("code", "document", "message")


@dataclass(frozen=True, slots=True)
class Text:
    """One paragraph, list item, cell or message. `kind`: code, document or message. Its lines are kept."""

    kind: str
    line: int
    text: str
    #: the first paragraph of a docstring of a "module or class", or of a "function"
    first: str = ""


@dataclass(frozen=True, slots=True)
class Finding:
    path: str
    line: int
    rule: str
    excerpt: str
    advice: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.rule}: {self.excerpt!r}: {self.advice}"


def _rule(name: str, pattern: str, advice: str, *kinds: str) -> Rule:
    return Rule(name, pattern, advice, kinds or ("code", "document", "message"))


#: old names (STYLE section 6) -> the terms that replace them
TERMS: Final = {
    r"helm": "mode source",
    r"look-?outs?": "conditions",
    r"conductor": "transfer manager",
    r"narrator": "event log",
    r"tellers?": "event log",
    r"(command |package )?desks?": "command check, mission transfer",
    r"tongues?": "client capabilities",
    r"out of latency|latent": "stale stream",
    r"outlets?": "link sequencer",
    r"lifelines?": "watchdog pipe",
    r"keepers?": "state store",
    r"rehearsal book": "rehearsal statistics",
    r"slips?": "map drawing",
    r"patients?": "the machine that is checked (check context)",
    r"breaths?": "stall",
    r"own voice": "sender",
    r"(best |chosen |returning )place|places? (of|for|to) (a |the )?returns?|place to return to": "return site",
    r"signs? of (?!life)\w+|(?<!with )a sign(?! of life)|the signs?(?! of life)": "condition",
}

RULES: Final = [
    _rule(
        "person",
        r"\b(whoever|whomever|whosoever|somebody|someone|nobody|no[ -]one|anybody|anyone|everybody|everyone)\b",
        "name the thing or the person: station, program, operator, pilot; 'no station', 'any program'",
    ),
    _rule("he", r"\b(he|she|him|his|hers?|himself|herself)\b", "say 'the operator', 'the pilot', or 'it' of a machine"),
    _rule("machine-who", rf"\b({MACHINES})(es|s)?,? whom?\b", "a machine is a thing: 'that', 'which'"),
    _rule("who", r"^Who (?!(\w+ )*\w+\?)", "name the subject: 'A station that ...'", "code", "message"),
    _rule(
        "behind",
        r"(?<!left )(?<!hidden )(?<!falls )(?<!fall )(?<!lags )(?<!far )\bbehind\b"
        r"(?! ((a|the|its|their|another|one|each) )?(\w+ )?"
        r"(borders?|NAT|firewall|router|proxy|MAVProxy|aircraft|hill|ridge|terrain|gateway|hub|switch|VPN|tunnel))",
        "'after' for time; 'in the background' for threads",
    ),
    _rule("so-long", r"\b(?<!not )so long\b(?! ago)", "'while', or 'at most this long', or 'until' with an event"),
    _rule(
        "inversion",
        r"^(Shown|Told|Left|Kept|Seen|Counted|Given|Taken|Done|Asked|Refused|Held|Said|Written|Meant|Sent|Read|Gone|"
        r"Known|Needed|Noted) (is|are|was|were|has|have)\b"
        r"|\band so (do|does|did|is|are|was|were|has|have|will|can|may|must)\b"
        r"|(^|[,:;] )(should|had|were) (it|they|the|this|that|an?|one|there|no)\b(?!.*\?)"
        r"|\bonly (then|so|there|here|now) (do|does|did|is|are|was|were|has|have|will|can|may|must)\b"
        r"|\bnor (do|does|did|is|are|was|were|has|have|will|can|may|must)\b",
        "subject, verb, object; 'if' for a condition, 'also', 'does not ... either'",
    ),
    _rule("none-the", r"\bnone the (worse|better|less|wiser)\b", "say what still works"),
    _rule(
        "alone", r"\b(\w+'s|\w+s'|ours|theirs|mine|yours|its own|their own) alone\b", "'only X', 'belongs only to X'"
    ),
    _rule("but", r"\b(nothing|none|no \w+|all) but\b", "'only', 'all except'"),
    _rule(
        "riddle",
        r"\b(what (comes|came|becomes|became|is to become) of|comes? to nothing|is (no|not) news|to be had\b|"
        r"has the last word|(is|was|be) its? undoing|is no \w+ of (ours|its|theirs)|stands? for it\b|"
        r"makes? (nothing|something) of|knows? nothing of|goes? by what|of (its|their) own accord|the other way about|"
        r"as it were|to speak of|in vain|once for all|for good\b|none of (ours|theirs)\b|all the same)",
        "say the act: 'result', 'fails', 'obsolete', 'not available', 'still'",
    ),
    _rule(
        "archaic",
        r"\b(whence|thence|hence|lest|ere|till|whereby|whereupon|whereof|thereof|therein|thereby|thereupon|upon|anew|"
        r"hitherto|thither|hither|withal|likewise)\b",
        "a common word: 'from which', 'so', 'until', 'on', 'again', 'also'",
    ),
    _rule("above", r"\b(the same as above|as above(?! (home|the))|ditto)\b|^The same[.:;,]", "say what it is or does"),
    _rule("first-what", r"^What\b", "begin with a noun or a verb: say what the module or class is or does"),
    _rule("first-it", r"^(Who|Whose|That|So that|It|This)\b", "begin with a noun or a verb: say what it is or does"),
    _rule("first-long", "", f"a docstring's first sentence has at most {_LONGEST_FIRST} words"),
    _rule("long", "", "one idea in a sentence: at most 25 words, 20 in a message"),
    *(_rule("term", rf"(?<![\w/.-])({old})(?![\w/-]|\.\w)", f"the term is '{new}'") for old, new in TERMS.items()),
]
_COMPILED: Final = [(rule, re.compile(rule.pattern, re.IGNORECASE)) for rule in RULES if rule.pattern]
#: rule -> whose first paragraph it judges
_FIRST: Final = {"first-what": ("module or class",), "first-it": ("module or class", "function")}
_WORD: Final = re.compile(r"[^\W_]")
_END: Final = re.compile(r"[.!?][)\"'”]*\s+(?=[\"'(“]?[A-Z0-9X])|[:;]\s|\s[–—-]\s|\s\(|\)\s?|…")
#: a term and its explanation, in columns
_TERM: Final = r"\S[^.:;]*?\s{2,}(?=\S)"
_TAG: Final = re.compile(r"^ *// @\w+: *")
_FULL_STOP: Final = re.compile(r"[.!?](\s|$)")


def check(text: Text) -> Iterator[tuple[int, str, str, str]]:
    """The findings in one text: (line, rule, excerpt, advice)."""
    flat = text.text.replace("\n", " ")

    def found(rule: Rule, start: int, end: int) -> tuple[int, str, str, str]:
        line = text.line + text.text.count("\n", 0, start)
        return line, rule.name, flat[max(0, start - 20) : end + 20].strip(), rule.advice

    sentences = [*_sentences(flat)]
    for rule, pattern in _COMPILED:
        if text.kind not in rule.kinds or text.first not in _FIRST.get(rule.name, (text.first,)):
            continue
        if pattern.pattern.startswith("^") and rule.name not in _FIRST:
            hits = [(start + m.start(), start + m.end()) for start, s in sentences for m in pattern.finditer(s)]
        else:
            hits = [m.span() for m in pattern.finditer(flat)]
        yield from (found(rule, *hit) for hit in hits)
    by_name = {rule.name: rule for rule in RULES}
    if text.first and words(_FULL_STOP.split(flat)[0]) > _LONGEST_FIRST:
        yield found(by_name["first-long"], 0, 40)
    for start, sentence in sentences:
        if (count := words(sentence)) > _LONGEST[text.kind]:
            line, name, excerpt, advice = found(by_name["long"], start, start + 40)
            yield line, name, excerpt, f"{advice} ({count} here)"


def _sentences(flat: str) -> Iterator[tuple[int, str]]:
    """Sentences with their offsets. A colon, a semicolon, a dash and a bracket end one, as in ASD-STE100."""
    start = 0
    for end in [*_END.finditer(flat), None]:
        stop = len(flat) if end is None else end.start() + 1
        yield start, flat[start:stop]
        start = stop if end is None else end.end()


def words(sentence: str) -> int:
    return sum(1 for word in sentence.split() if _WORD.search(word))


# ---- where texts are ------------------------------------------------------------------------------------------------


def read(path: Path) -> list[Text]:
    """The texts of a file, by its suffix."""
    source = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        return [*_python(source)]
    if path.suffix == ".lua":
        return [*_lua(source)]
    if path.suffix == ".parm":
        lines = enumerate(source.split("\n"), 1)
        return [*_commented([(number, 0, line.lstrip("# ")) for number, line in lines if line.startswith("#")])]
    return [*blocks(source.split("\n"), 1, "document")]


def _python(source: str) -> Iterator[Text]:
    skipped: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            owner = "function" if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) else "module or class"
            for place, statement in enumerate(node.body):
                if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
                    skipped.add(id(statement.value))
                    lines = cleandoc(str(statement.value.value)).split("\n")
                    for number, text in enumerate(blocks(lines, statement.lineno, "code")):
                        yield Text(text.kind, text.line, text.text, owner if place == number == 0 else "")
        if isinstance(node, ast.JoinedStr):
            skipped.update(id(part) for part in node.values)
            parts = [str(part.value) if isinstance(part, ast.Constant) else "X" for part in node.values]
            yield from _message("".join(parts), node.lineno)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in skipped:
            yield from _message(node.value, node.lineno)
    comments: list[tuple[int, int, str]] = []
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT and not re.match(r"# (type:|noqa|SPDX|pragma)|#!", token.string):
            own = token.line.lstrip().startswith("#")
            comments.append((token.start[0], token.start[1] if own else -1, token.string.lstrip("#: ")))
    yield from _commented(comments)


def _lua(source: str) -> Iterator[Text]:
    comments: list[tuple[int, int, str]] = []
    in_block = False
    for number, line in enumerate(source.split("\n"), 1):
        in_block = not line.startswith("--]]") and (in_block or line.startswith("--[["))
        if in_block:
            # one tag on each line of a parameter's documentation
            column = -1 if _TAG.match(line) else 0
            comments.append((number, column, _TAG.sub("", line).lstrip("-[] ")))
            continue
        code, dashes, comment = line.partition("--")
        if dashes:
            comments.append((number, len(code) if not code.strip() else -1, comment.lstrip("-[] ")))
        for literal in re.findall(r'"((?:[^"\\]|\\.)*)"', code):
            yield from _message(re.sub(r"%[-.\d]*[a-z]", "X", literal), number)
    yield from _commented(comments)


def _commented(comments: list[tuple[int, int, str]]) -> Iterator[Text]:
    """Comments as texts. Those that follow each other in one column are one text.

    Each is (line, column, text). A comment beside code has the column -1.
    """
    run: list[tuple[int, int, str]] = []
    for comment in [*comments, (0, -1, "")]:
        line, column, _text = comment
        if run and (column < 0 or line != run[-1][0] + 1 or column != run[-1][1]):
            yield from blocks([text.rstrip("- ") for _line, _column, text in run], run[0][0], "code")
            run = []
        run.append(comment)


def _message(value: str, line: int) -> Iterator[Text]:
    for text in value.split("\n"):
        if _prose(text):
            yield Text("message", line, plain(text))


def _prose(text: str) -> bool:
    """Whether people read this literal: at least three words of small letters, and hardly anything else."""
    parts = text.split()
    small = [part for part in parts if re.fullmatch(r"[('\"]*[A-Za-z][a-z'-]*[.,:;?!)'\"]*", part)]
    return len(small) >= 3 and len(small) >= 0.6 * len(parts) and not re.search(r"[{}<>=\\|]|\w\(|;$", text)


def plain(text: str) -> str:
    """Code and links as words; line breaks stay, for the line numbers."""

    def kept(match: re.Match[str]) -> str:
        return "X" + "\n" * match[0].count("\n")

    text = re.sub(r"``?[^`]+``?", kept, text)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", lambda match: match[1], text)
    text = re.sub(r"<[^>]+>|https?://\S+", "", text)
    return re.sub(r"\*\*|(?<!\w)\*(?=\w)|(?<=\w)\*(?!\w)", "", text)


def blocks(lines: list[str], line: int, kind: str) -> Iterator[Text]:
    """Paragraphs, list items, cells and headings of `lines`, whose first one is line `line` of the file."""
    block: list[str] = []
    begun, fenced = line, False
    for number, raw in enumerate([*lines, ""], line):
        text = raw.strip()
        if text.startswith(("```", "~~~")):
            fenced = not fenced
        if fenced or (not block and raw.startswith("    ")):
            continue
        item = re.match(rf"([*+-]|\d+\.|#+) +(?=\S)|{_TERM}", text)
        ends = not text or text.startswith(("|", "```", "<!--")) or not re.search(r"\w", text) or item is not None
        if ends and block:
            yield Text(kind, begun, plain("\n".join(block)))
            block = []
        if text.startswith("|"):
            cells = [plain(cell.strip()) for cell in re.split(r"(?<!\\)\|", text)]
            yield from (Text(kind, number, cell) for cell in cells if re.search(r"\w", cell))
        elif not ends or item is not None:
            begun = begun if block else number
            block.append(text[item.end() :] if item else text)


# ---- the command ----------------------------------------------------------------------------------------------------


def findings(paths: Iterable[str | Path]) -> Iterator[Finding]:
    """The findings in files and folders, relative to the project's root."""
    for path in paths:
        for file in _files(ROOT / path):
            name = file.relative_to(ROOT).as_posix()
            for line, rule, excerpt, advice in sorted({found for text in read(file) for found in check(text)}):
                if not _allowed(name, rule, excerpt):
                    yield Finding(name, line, rule, excerpt, advice)


def _allowed(name: str, rule: str, excerpt: str) -> bool:
    return any((name, rule) == (where, which) and what in excerpt for where, which, what, _why in ALLOWED)


def _files(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    pattern = "*.md" if path.name == "docs" else "**/*"
    return sorted(file for file in path.glob(pattern) if file.suffix in (".py", ".lua", ".parm", ".md"))


def shown() -> Iterator[Finding]:
    """The findings in message tables and in `--help`."""
    from tests.structure.shown import help_texts, message_texts

    for where, text in (*message_texts(), *help_texts()):
        for _line, rule, excerpt, advice in check(text):
            if not _allowed(where, rule, excerpt):
                yield Finding(where, text.line, rule, excerpt, advice)


def main(arguments: list[str]) -> int:
    paths = [argument for argument in arguments if argument != "--count"]
    found = [*findings(paths or WHERE), *(() if paths else shown())]
    if "--count" in arguments:
        folders = Counter(str(Path(finding.path).parent) for finding in found)
        print("\n".join(f"{count:6d} {folder}" for folder, count in sorted(folders.items())))
    else:
        print("\n".join(map(str, found)))
    print(f"{len(found)} findings", file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
