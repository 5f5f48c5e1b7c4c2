"""Modules that run when they are used: once, and whole for whichever thread looks."""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Thread
from types import ModuleType

import pytest

from anaplot import ondemand
from anaplot.ondemand import load_on_demand

NAME = "run_when_it_is_used"


@pytest.fixture
def waiting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Thread]]:
    """Threads that the module sees; one that looks a second thing up is begun while it runs."""
    threads: list[Thread] = []
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "meta_path", list(sys.meta_path))
    monkeypatch.setattr(ondemand, "threads", threads, raising=False)
    yield threads
    sys.modules.pop(NAME, None)


def written(folder: Path, text: str) -> ModuleType:
    (folder / f"{NAME}.py").write_text(text)
    load_on_demand({NAME})
    return importlib.import_module(NAME)


def in_its_turn(thread: Thread) -> bool:
    """Whether a thread has come as far as to the module's turn."""
    frame = sys._current_frames().get(thread.ident or 0)
    while frame is not None:
        if frame.f_code.co_filename == ondemand.__file__:
            return True
        frame = frame.f_back
    return False


def test_it_runs_when_something_is_looked_up_and_only_once(
    tmp_path: Path, waiting: list[Thread]
) -> None:
    module = written(
        tmp_path,
        "import sys\nfrom anaplot import ondemand\nondemand.threads.append(1)\n"
        f"own = sys.modules['{NAME}'].__name__\n",
    )
    assert not waiting
    assert type(module) is not ModuleType
    assert module.own == NAME  # it found itself while it ran
    assert module.own == NAME
    assert waiting == [1]
    assert type(module) is ModuleType
    assert module.__loader__ is module.__spec__.loader  # type: ignore[union-attr]
    assert sys.modules[NAME] is module


def test_what_is_set_before_is_set_after_it_has_run(tmp_path: Path, waiting: list[Thread]) -> None:
    module = written(tmp_path, "value = 1\nother = 2\n")
    module.value = 3
    del module.other
    assert module.value == 3
    assert not hasattr(module, "other")


def test_one_that_fails_is_run_again(tmp_path: Path, waiting: list[Thread]) -> None:
    module = written(
        tmp_path,
        "from anaplot import ondemand\nondemand.threads.append(1)\n"
        "value = [7, 8][1 // (len(ondemand.threads) - 1)]\n",
    )
    with pytest.raises(ZeroDivisionError):
        _ = module.value
    assert module.value == 8


def test_a_second_thread_waits_until_it_has_run(
    tmp_path: Path, waiting: list[Thread], monkeypatch: pytest.MonkeyPatch
) -> None:
    found: list[object] = []
    module = written(
        tmp_path,
        "from anaplot import ondemand\nondemand.looking()\nvalue = 5\n",
    )

    def look() -> None:
        try:
            found.append(module.value)
        except AttributeError as error:
            found.append(error)

    def looking() -> None:
        """Begin a second thread that looks, and go on when it waits, or has its answer."""
        second = Thread(target=look)
        waiting.append(second)
        second.start()
        while second.is_alive() and not in_its_turn(second):
            time.sleep(0.001)

    monkeypatch.setattr(ondemand, "looking", looking, raising=False)
    look()
    waiting[0].join()
    assert found == [5, 5]
