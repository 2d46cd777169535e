# SPDX-License-Identifier: GPL-3.0-or-later

"""The companion's console: nothing that is printed waits for a reader, and nothing that is read is lost before it."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from queue import SimpleQueue
from types import SimpleNamespace
from typing import Any

import pytest

from mavproxy_handover.supervision.console import Console, read_lines


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    ends = os.pipe()
    yield ends
    for end in ends:
        try:
            os.close(end)
        except OSError:
            continue


@pytest.fixture
def console(monkeypatch: pytest.MonkeyPatch) -> Console:
    """Small: a hundred characters may wait."""
    small = Console(100)
    with monkeypatch.context() as streams:
        streams.setattr(sys, "stdout", sys.stdout)
        streams.setattr(sys, "stderr", sys.stderr)
        small.redirect_output()
    return small


def test_what_is_printed_arrives_in_order(console: Console, pipe: tuple[int, int]) -> None:
    reader, writer = pipe
    console.put(writer, "one\n")
    console.put(writer, "zwei ü\n")
    console.drain(10.0)
    assert os.read(reader, 100) == "one\nzwei ü\n".encode()


def test_print_goes_through_it(monkeypatch: pytest.MonkeyPatch) -> None:
    put: list[tuple[int, str]] = []
    for name in ("stdout", "stderr"):
        monkeypatch.setattr(sys, name, getattr(sys, name))
    console = Console()
    monkeypatch.setattr(console, "put", lambda descriptor, text: put.append((descriptor, text)))
    console.redirect_output()
    print("to people", flush=True)
    print("of trouble", file=sys.stderr)
    assert put == [(1, "to people"), (1, "\n"), (2, "of trouble"), (2, "\n")]
    assert (sys.stdout.fileno(), sys.stderr.fileno(), sys.stdout.encoding) == (1, 2, "utf-8")


def test_what_nobody_reads_is_left_out_and_counted(console: Console, pipe: tuple[int, int]) -> None:
    reader, writer = pipe
    os.set_blocking(writer, False)
    filled = 0
    try:
        while True:
            filled += os.write(writer, bytes(4096))
    except BlockingIOError:
        os.set_blocking(writer, True)  # a pipe that takes no more, as of a reader that has stopped
    for number in range(30):
        console.put(writer, f"line {number:4}\n")  # ten characters each
    while filled:
        filled -= len(os.read(reader, filled))
    console.drain(10.0)
    console.put(writer, "last\n")
    console.drain(10.0)
    lines = os.read(reader, 4096).decode().splitlines()
    assert lines == [*(f"line {number:4}" for number in range(10)), "[20 lines left out: no program read them]", "last"]


def test_a_reader_that_is_gone_costs_what_it_would_have_read(console: Console, pipe: tuple[int, int]) -> None:
    reader, writer = pipe
    os.close(reader)
    console.put(writer, "nobody\n")
    console.drain(10.0)
    other_reader, other_writer = os.pipe()
    console.put(other_writer, "somebody\n")
    console.drain(10.0)
    assert os.read(other_reader, 100) == b"somebody\n"
    os.close(other_reader)
    os.close(other_writer)


@pytest.mark.parametrize("end", [EOFError(), OSError(5, "Input/output error"), RuntimeError("input(): lost sys.stdin")])
def test_lines_are_handed_on_until_there_are_no_more(end: Exception) -> None:
    typed: list[Any] = ["status", "", end]

    def read() -> str:
        word = typed.pop(0)
        if isinstance(word, Exception):
            raise word
        return str(word)

    lines: SimpleQueue[str] = SimpleQueue()
    read_lines(SimpleNamespace(rl=SimpleNamespace(input=read), input_queue=lines))
    assert [lines.get(), lines.get()] == ["status", ""]
    assert lines.empty()
