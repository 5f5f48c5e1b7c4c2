"""The progress line: what it says, how wide it is, and that it leaves nothing."""

from __future__ import annotations

import io
import os
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from clibench import here
from hypothesis import given
from hypothesis import strategies as st

from anaplot.report import progress as module
from anaplot.report.progress import ProgressLine, working


class Terminal(io.StringIO):
    """A terminal of a width; `heard` tells when anything was written."""

    def __init__(self, columns: int = 80) -> None:
        super().__init__()
        self.columns = columns
        self.heard = threading.Event()

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        self.heard.set()
        return super().write(text)

    def line(self) -> str:
        """What stands on the screen now."""
        return self.getvalue().rpartition("\r")[2].rstrip()


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(module.os, "get_terminal_size", terminal_size)
    return now


def terminal_size(stream: int) -> os.terminal_size:
    return os.terminal_size((stream, 24))


@pytest.fixture
def wide(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], Terminal]:
    def made(columns: int) -> Terminal:
        made = Terminal(columns)
        monkeypatch.setattr(made, "fileno", lambda: columns, raising=False)
        return made

    return made


def test_what_is_left_is_told_from_what_has_gone(
    clock: list[float], wide: Callable[[int], Terminal]
) -> None:
    terminal = wide(80)
    with ProgressLine(terminal) as line:
        line("factor", 0.0)
        for at, share, shown in (
            (1.5, 0.1, "factor  10 %"),  # too early to tell
            (10.0, 0.25, "factor  25 %, about 30 s of it left"),
            (30.0, 0.01, "factor   1 %"),  # too little to tell
            (1000.0, 0.25, "factor  25 %, about 50 min of it left"),
            (10_000.0, 0.25, "factor  25 %, about 8 h of it left"),
            (10_001.0, 1.0, "factor 100 %"),
            (10_001.5, 1.2, "factor 100 %"),
        ):
            clock[0] = at
            line("factor", share)
            assert terminal.line() == shown
        # what comes then begins anew
        clock[0] = 10_002.0
        line("reliability", 0.5)
        assert terminal.line() == "reliability  50 %"
        clock[0] = 10_012.0
        line("reliability", 0.0)
        assert terminal.line() == "reliability, 10 s"
    assert terminal.line() == ""


def test_an_estimate_that_was_too_short_is_taken_back(
    clock: list[float], wide: Callable[[int], Terminal]
) -> None:
    terminal = wide(80)
    with ProgressLine(terminal) as line:
        line("factor", 0.0)
        clock[0] = 10.0
        line("factor", 0.5)
        assert terminal.line().endswith("about 10 s of it left")
        for at, left in ((16.0, ", about 4 s of it left"), (30.0, "")):
            clock[0] = at
            line._draw(at)
            assert terminal.line() == f"factor  50 %{left}"


def test_it_counts_on_while_the_work_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_ALONE", 0.001)
    monkeypatch.setattr(module, "_FIRST", 0.0)
    monkeypatch.setattr(module, "_EVERY", 0.0)
    terminal = Terminal()
    with ProgressLine(terminal) as line:
        line("reading a/b", 0.0)
        for _ in range(3):
            terminal.heard.clear()
            assert terminal.heard.wait(30.0)
    assert not [one for one in threading.enumerate() if one.name == "progress"]
    assert terminal.line() == ""


def test_nobody_watches_and_nothing_runs(capsys: pytest.CaptureFixture[str]) -> None:
    with working("reading") as line:
        assert not [one for one in threading.enumerate() if one.name == "progress"]
        line("writing", 0.5)
    assert capsys.readouterr() == ("", "")


@given(st.integers(1, 60), st.text(max_size=60), st.floats(0.0, 1.0))
def test_the_line_fits_and_commands_no_terminal(columns: int, what: str, share: float) -> None:
    terminal = Terminal()
    terminal.fileno = lambda: columns  # type: ignore[method-assign]
    with pytest.MonkeyPatch.context() as patch:
        now = [0.0]
        patch.setattr(module.time, "monotonic", lambda: now[0])
        patch.setattr(module.os, "get_terminal_size", terminal_size)
        with ProgressLine(terminal) as line:
            line("another", 0.0)
            for now[0] in (2.0, 9.0):
                line(what, share)
                drawn = terminal.getvalue().rpartition("\r")[2]
                assert module._cells(drawn) <= max(columns - 1, 1)
    for drawn in terminal.getvalue().split("\r"):
        assert drawn.isprintable()
        assert module._cells(drawn) <= max(columns - 1, 1)


def test_a_terminal_that_goes_is_no_error(
    clock: list[float], wide: Callable[[int], Terminal], monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = wide(80)

    def gone(_: str) -> int:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(terminal, "write", gone)
    with ProgressLine(terminal) as line:
        for clock[0] in (0.0, 5.0, 10.0):
            line("factor", 0.5)


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("replay myblock", "replay 100 %"),
        ("bridge myblock", "models"),
        ("bridge myblock", "checks of the block"),
        ("adjust myblock --datum free", "results"),
        ("report myblock --datum free -o page.html", "the page"),
        ("bridge myblock --report models.html", "the page"),
        ("log myblock", "reading the journal"),
        ("pointing myblock", "models"),
        ("status myblock", "models and block"),
        ("export colmap myblock -o colmap", "writing colmap"),
        ("import colmap sparse -o again", "writing again"),
        ("pack myblock -o pack.zip", "packing"),
    ],
)
@pytest.mark.slow
def test_what_takes_long_says_what_it_does(
    command: str,
    told: str,
    demo: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(demo)
    monkeypatch.setattr(module, "_FIRST", 0.0)
    monkeypatch.setattr(module, "_EVERY", 0.0)
    terminal = Terminal()
    monkeypatch.setattr(module.sys, "stderr", terminal)
    result = here(capsys, *command.split())
    assert result.returncode == 0
    assert "\r" not in result.stdout
    assert told in [one.strip() for one in terminal.getvalue().split("\r")]
    assert terminal.line() == ""


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from anaplot.cli import main

    folder = tmp_path_factory.mktemp("demo")
    assert main(["demo", "--auto", "--models", "1", "--keep", str(folder / "myblock")]) == 0
    assert main(["export", "colmap", str(folder / "myblock"), "-o", str(folder / "sparse")]) == 0
    return folder
