"""What arrays leave behind is taken by the next ones: no new pages, where the library is GNU's."""

from __future__ import annotations

import sys

import pytest
from processes import running

from anaplot.freedmemory import keep_freed_memory

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
    with running([sys.executable, "-c", PROGRAM]) as child:
        code = child.wait(timeout=60)
    if code == 77:
        pytest.skip("another C library")
    assert code == 0


def test_elsewhere_nothing_is_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "win32")
    assert not keep_freed_memory()
