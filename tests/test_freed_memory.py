"""What arrays leave behind is taken by the next ones: no new pages, where the library is GNU's."""

from __future__ import annotations

import argparse
import ctypes
import sys

import pytest
from processes import running as child_running

from anaplot.freedmemory import keep_freed_memory
from anaplot.report import running
from anaplot.report.computed import Computed
from anaplot.report.document import Document

PROGRAM = """
import sys
from anaplot.freedmemory import keep_freed_memory
if not keep_freed_memory():
    sys.exit(77)
import resource
size = 64 << 20
def pages():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    bytearray(size)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
first, second = pages(), pages()
assert second < 100, (first, second)
"""


def test_a_second_large_array_takes_the_pages_of_the_first() -> None:
    with child_running([sys.executable, "-c", PROGRAM]) as child:
        code = child.wait(timeout=60)
    if code == 77:
        pytest.skip("another C library")
    assert code == 0


def test_elsewhere_nothing_is_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "win32")
    assert not keep_freed_memory()


@pytest.mark.parametrize("error", [OSError("no such library"), AttributeError("mallopt")])
def test_where_the_library_cannot_be_told_nothing_is_changed(
    monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def none(_: object) -> object:
        raise error

    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(ctypes, "CDLL", none)
    assert not keep_freed_memory()


def test_python_without_ctypes_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setitem(sys.modules, "ctypes", None)
    assert not keep_freed_memory()


def test_a_command_that_computes_and_ends_keeps_it(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []

    def compute() -> Computed[None]:
        told.append("computed")
        return Computed(None, Document({}, ()))

    monkeypatch.setattr(running, "keep_freed_memory", lambda: told.append("kept"))
    running.computed(argparse.Namespace(), compute)
    assert told == ["kept", "computed"]


HELP = """
import sys
from anaplot.__main__ import main
sys.argv[1:] = ["--help"]
try:
    main()
except SystemExit as end:
    assert end.code in (0, None)
assert "anaplot.cli" in sys.modules
assert "ctypes" not in sys.modules
"""


def test_what_computes_nothing_does_not_ask() -> None:
    with child_running([sys.executable, "-c", HELP]) as child:
        assert child.wait(timeout=60) == 0
