"""Without a terminal the console says so in one line."""

from __future__ import annotations

import io
import sys

import pytest

from anaplot.console.terminal import need_terminal
from anaplot.errors import InputError

pytestmark = pytest.mark.smoke


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def terminals(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("stdin", "stdout", "stderr"):
        monkeypatch.setattr(sys, name, Terminal())


def test_a_terminal_is_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    terminals(monkeypatch)
    need_terminal({"TERM": "xterm-256color"})
    need_terminal({})


@pytest.mark.parametrize(
    ("name", "said"), [("stdin", "input"), ("stdout", "output"), ("stderr", "error")]
)
def test_each_stream_is_looked_at(monkeypatch: pytest.MonkeyPatch, name: str, said: str) -> None:
    terminals(monkeypatch)
    for other in (io.StringIO(), None):
        monkeypatch.setattr(sys, name, other)
        with pytest.raises(InputError, match=f"needs a terminal, and standard {said} is none"):
            need_terminal({"TERM": "xterm"})


def test_a_dumb_terminal_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    terminals(monkeypatch)
    with pytest.raises(InputError, match="TERM is dumb"):
        need_terminal({"TERM": "dumb"})
