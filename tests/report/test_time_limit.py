"""A time that is over ends a search with the best it has, and other work with how far it came."""

from __future__ import annotations

import signal
import time
from argparse import Namespace
from pathlib import Path

import pytest

from anaplot import cli
from anaplot.errors import NotComputableError
from anaplot.report import applyerrors
from anaplot.report.computed import Computed
from anaplot.report.document import Document
from anaplot.report.interrupts import TimeLimit
from anaplot.report.running import computed

LONG = 60.0  # seconds that none of these tests waits


def answer(watch) -> Computed[bool]:
    return Computed(watch.stopped, Document({}, ()), False)


def endless(progress) -> Computed[bool]:
    end = time.monotonic() + LONG
    progress("orienting\x1b[2J photos", 0.25)
    while time.monotonic() < end:
        time.sleep(0.01)
    return answer(progress)


def searching(progress) -> Computed[bool]:
    end = time.monotonic() + LONG
    with progress.searching():
        while not progress.stopped and time.monotonic() < end:
            time.sleep(0.01)
    return answer(progress)


def slow(progress) -> Computed[bool]:
    found = searching(progress)
    time.sleep(0.3)  # what the search found is put together, longer than half the limit
    return found


def deaf(progress) -> Computed[bool]:
    with progress.searching():
        return endless(progress)


def test_what_is_no_search_ends_with_how_far_it_came() -> None:
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(NotComputableError) as caught:
        computed(Namespace(time_limit=0.2), endless)
    said = str(caught.value)
    assert said.startswith("not finished in the 0.2 s of --time-limit: orienting")
    assert "photos 25 %, after " in said
    assert "\x1b" not in said
    assert signal.getsignal(signal.SIGINT) is before


def test_a_search_ends_with_the_best_it_has(capsys: pytest.CaptureFixture[str]) -> None:
    assert computed(Namespace(time_limit=0.2), searching).result
    said = capsys.readouterr().err
    assert "0.2 s are over: the search ends with the best that it has found, if any\n" in said


def test_what_it_found_is_put_together_however_long_that_takes() -> None:
    assert computed(Namespace(time_limit=0.2), slow).result


def test_a_limit_holds_where_interrupts_are_ignored() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with pytest.raises(NotComputableError):
            computed(Namespace(time_limit=0.2), endless)
        assert computed(Namespace(time_limit=0.2), searching).result
        # and a person's are still ignored

        def interrupted(progress) -> Computed[bool]:
            signal.raise_signal(signal.SIGINT)
            return answer(progress)

        assert not computed(Namespace(time_limit=LONG), interrupted).result
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_search_that_does_not_end_is_left(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(NotComputableError, match="photos 25 %, after "):
        computed(Namespace(time_limit=0.2), deaf)
    assert "0.2 s are over" in capsys.readouterr().err


@pytest.mark.parametrize("seconds", [None, LONG])
def test_nothing_happens_in_time(seconds: float | None) -> None:
    options = Namespace() if seconds is None else Namespace(time_limit=seconds)
    assert not computed(options, answer_of).result


def answer_of(progress) -> Computed[bool]:
    return answer(progress)


def test_an_interrupt_of_the_last_moment_is_none_of_the_next_work() -> None:
    for _ in range(20):
        limit = TimeLimit(1e-4)
        try:
            with limit:
                pass
        except KeyboardInterrupt:
            assert limit.over
        time.sleep(0.002)


def test_the_command_line_says_it_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(tmp_path / "b")
    assert cli.main(["plan", "block", "--to", folder]) == 0
    capsys.readouterr()
    monkeypatch.setattr(applyerrors, "adjust", endless)
    assert cli.main(["adjust", folder, "--time-limit", "0.2"]) == 4
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("anaplot: not finished in the 0.2 s of --time-limit: ")
    assert said.err.count("\n") == 1
    assert cli.main(["adjust", folder, "--time-limit", "0"]) == 2
    one = "argument --time-limit: '0' is no number from 0.1 to 1e+06"
    assert capsys.readouterr().err.startswith(f"anaplot: {one}")
