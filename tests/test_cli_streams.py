"""Closed and full standard streams, interrupts, errors of the operating system: one line each."""

from __future__ import annotations

import errno
import importlib
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from clibench import ROOT, TIMEOUT, anaplot, environment, one_line

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.report import patterncomparison

pytestmark = pytest.mark.slow

PATTERN = ("plan", "pattern", "6")
BUFFERED = {"PYTHONUNBUFFERED": ""}
posix = pytest.mark.skipif(sys.platform == "win32", reason="a shell closes the streams")


def under_shell(
    redirection: str, *arguments: object, env: dict[str, str] = BUFFERED
) -> subprocess.CompletedProcess[str]:
    script = f'exec "$@" {redirection}'
    return anaplot(*arguments, env=env, prefix=("sh", "-c", script, "sh"))


@posix
@pytest.mark.parametrize("arguments", [PATTERN, ("--help",), ("manual",)])
def test_a_closed_output_is_one_line(arguments: tuple[str, ...]) -> None:
    result = under_shell(">&-", *arguments)
    one_line(result, 2, "standard output: ", os.strerror(errno.EBADF))


@posix
@pytest.mark.parametrize("arguments", [PATTERN, ("--help",), ("manual",)])
def test_a_full_output_is_one_line(arguments: tuple[str, ...]) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    for env in (BUFFERED, {"PYTHONUNBUFFERED": "1"}):
        result = under_shell(">/dev/full", *arguments, env=env)
        one_line(result, 2, "standard output: ", os.strerror(errno.ENOSPC))


@posix
def test_with_closed_errors_the_work_is_done() -> None:
    result = under_shell("2>&-", *PATTERN)
    assert result.returncode == 0
    assert result.stdout.startswith("PATTERN '6'")
    # and an error neither goes to the output nor becomes another one
    failed = under_shell("2>&-", "plan", "pattern", "nonsense")
    assert (failed.returncode, failed.stdout) == (2, "")
    assert under_shell("<&- >&- 2>&-", *PATTERN).returncode == 2


@posix
def test_no_file_takes_the_place_of_a_closed_stream(tmp_path: Path) -> None:
    table = tmp_path / "x.csv"
    result = under_shell("<&- >&-", *PATTERN, "--csv", table)
    one_line(result, 2, "standard output")
    text = table.read_text()
    assert text.startswith("point,x_mm")
    assert "PATTERN" not in text


def test_an_interrupt_while_loading_is_one_line() -> None:
    code = """
import runpy, sys
class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == "anaplot.cli":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupt())
runpy.run_module("anaplot", run_name="__main__")
"""
    result = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env=environment(),
        timeout=TIMEOUT,
        check=False,
    )
    one_line(result, 130, "interrupted")


def test_too_little_memory_is_one_line(capsys, monkeypatch) -> None:
    def too_much(**_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(patterncomparison, "planned_pattern", too_much)
    assert main(PATTERN) == 4
    assert capsys.readouterr().err == "anaplot: this needs more memory than there is\n"


def test_an_interrupt_while_working_is_one_line(capsys, monkeypatch) -> None:
    def interrupted(**_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(patterncomparison, "planned_pattern", interrupted)
    assert main(PATTERN) == 130
    assert re.fullmatch(r"anaplot: interrupted: reading, after \d\.\d s\n", capsys.readouterr().err)


def test_the_installed_command_is_the_module() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    module, _, name = project["scripts"]["anaplot"].partition(":")
    assert module == "anaplot.__main__"
    assert callable(getattr(importlib.import_module(module), name))


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(errno.ENOSPC, "No space left on device", "x"), "x: No space left on device"),
        (OSError(errno.EIO, "Input/output error", b"a\nb"), "a\\x0ab: Input/output error"),
        (OSError("odd"), "odd"),
        (OSError(), "OSError"),
    ],
)
def test_errors_of_the_system_are_file_and_reason(capsys, monkeypatch, error, said) -> None:
    def fail(**_: object) -> None:
        raise error

    monkeypatch.setattr(patterncomparison, "planned_pattern", fail)
    assert main(PATTERN) == InputError.exit_code
    assert capsys.readouterr().err == f"anaplot: {said}\n"
