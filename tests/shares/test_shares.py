"""Shares of work: the same whoever does them, done again when a worker is lost."""

from __future__ import annotations

import os
import pickle
import random
from collections import Counter
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import ExitStack
from multiprocessing import active_children, get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from threading import Condition, Thread
from time import sleep
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sharework import Failing, Squares

import anaplot
from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.planning.modelscenarios import OneError
from anaplot.planning.montecarlo import ChunkDone, simulate
from anaplot.shares import work as shares_work
from anaplot.shares.address import cluster_address
from anaplot.shares.local import GivenExecutor, LocalProcesses, _one_thread_each
from anaplot.shares.work import REPEATS, Sent, SharesLostError, _count, carry_out

SMALL = OneError("small", "6/3", chunk=20, runs=210)


class Shuffled(Executor):
    """One thread that takes what waits in an order of its own; it breaks after some shares."""

    def __init__(self, seed: int, breaks_after: int = 10**9) -> None:
        self.random, self.left = random.Random(seed), breaks_after
        self.waiting: list[tuple[Future[Any], Callable[[], Any]]] = []
        self.changed, self.over = Condition(), False
        self.thread = Thread(target=self.work, daemon=True)
        self.thread.start()

    def submit(self, do: Callable[..., Any], /, *of: Any, **more: Any) -> Future[Any]:
        future: Future[Any] = Future()
        with self.changed:
            self.waiting.append((future, lambda: do(*of, **more)))
            self.changed.notify()
        return future

    def work(self) -> None:
        while True:
            with self.changed:
                self.changed.wait_for(lambda: self.waiting or self.over)
                if not self.waiting:
                    return
                k = self.random.randrange(len(self.waiting))
                future, do = self.waiting.pop(k)
            if not future.set_running_or_notify_cancel():
                continue
            self.left -= 1
            if self.left < 0:
                future.set_exception(BrokenExecutor("gone"))
            else:
                future.set_result(do())

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        with self.changed:
            self.over = True
            self.changed.notify()
        self.thread.join()


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 4])
def test_the_figures_are_those_of_one_process(workers: int) -> None:
    one = simulate(SMALL, seed=3)
    with ThreadPoolExecutor(workers) as executor:
        assert simulate(SMALL, seed=3, place=GivenExecutor(executor, 2 * workers)) == one
        assert executor.submit(int, "1").result() == 1  # it is left open


@given(st.integers(0, 2**32))
def test_every_share_is_done_once_in_any_order(seed: int) -> None:
    found: list[int] = []
    with Shuffled(seed) as executor:
        carry_out(Failing(-1), iter(range(30)), 30, GivenExecutor(executor, 7), found.append)
    assert sorted(found) == list(range(30))


def test_any_order_gives_the_same_figures() -> None:
    with Shuffled(5) as executor:
        chunks: list[ChunkDone] = []
        place = GivenExecutor(executor, 8)
        tally = simulate(SMALL, seed=3, place=place, store=chunks.append)
    assert [chunk.number for chunk in chunks] != sorted(chunk.number for chunk in chunks)
    assert tally == simulate(SMALL, seed=3)


def test_a_share_that_fails_by_itself_is_not_done_again() -> None:
    found: list[int] = []
    with pytest.raises(ArithmeticError, match="share 3"):
        carry_out(Failing(3), range(9), 9, LocalProcesses(1), found.append)
    assert found == [0, 1, 2]
    with ThreadPoolExecutor(1) as executor, pytest.raises(ArithmeticError, match="share 3"):
        carry_out(Failing(3), range(9), 9, GivenExecutor(executor, 2), found.append)


@pytest.mark.slow
def test_a_share_that_fails_ends_its_own_processes_and_no_other() -> None:
    started: list[BaseProcess] = []

    def take(_: int) -> None:
        if not started:
            started.append(get_context("spawn").Process(target=sleep, args=(60.0,)))
            started[0].start()

    before = set(active_children())
    try:
        with pytest.raises(ArithmeticError, match="share 8"):
            carry_out(Failing(8), range(9), 9, LocalProcesses(2), take)
        (stranger,) = set(active_children()) - before
        assert stranger is started[0]
    finally:
        for process in started:
            process.terminate()
            process.join()


def test_what_the_environment_says_of_threads_comes_back_with_the_last_pool(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    with ExitStack() as first, ExitStack() as second:
        first.enter_context(_one_thread_each())
        second.enter_context(_one_thread_each())
        first.close()
        assert os.environ["OMP_NUM_THREADS"] == os.environ["OPENBLAS_NUM_THREADS"] == "1"
        second.close()
    assert "OMP_NUM_THREADS" not in os.environ
    assert os.environ["OPENBLAS_NUM_THREADS"] == "3"


def test_an_executor_that_breaks_is_said_and_what_was_done_is_kept() -> None:
    found: list[int] = []
    with Shuffled(1, breaks_after=5) as executor, pytest.raises(SharesLostError, match="is broken"):
        carry_out(Failing(-1), range(30), 30, GivenExecutor(executor, 4), found.append)
    assert len(found) == 5


def test_an_interrupt_keeps_what_is_done_and_cancels_the_rest() -> None:
    found: list[int] = []

    def take(number: int) -> None:
        found.append(number)
        if len(found) == 3:
            raise KeyboardInterrupt

    with Shuffled(2) as executor:
        with pytest.raises(KeyboardInterrupt):
            carry_out(Failing(-1), range(1000), 1000, GivenExecutor(executor, 50), take)
        with executor.changed:
            left = [future for future, _ in executor.waiting]
        assert all(future.cancelled() for future in left)
    assert 3 <= len(found) < 1000
    assert len(set(found)) == len(found)


def test_work_is_made_ready_once_however_often_it_comes(tmp_path: Path) -> None:
    flag = tmp_path / "flag"
    data = pickle.dumps(Sent(Squares(str(flag))))
    assert [pickle.loads(data).do(k) for k in range(5)] == [(k, k * k) for k in range(5)]
    (prepared,) = tmp_path.glob("*-prepared-*")
    assert prepared.read_text() == "x"
    shares_work.forget()
    assert pickle.loads(data).do(2) == (2, 4)
    assert prepared.read_text() == "xx"


@pytest.mark.parametrize("package", ["anaplot", "numpy", "scipy"])
def test_a_worker_with_other_versions_refuses(package: str) -> None:
    versions = shares_work.versions_here()
    sent = Sent(Failing(-1), versions={**versions, package: "0.0.1"})
    with pytest.raises(InputError, match=f"has {package} .*, here is 0.0.1: figures could differ"):
        sent.do(1)


@pytest.mark.slow
def test_the_share_of_a_process_that_died_is_done_again(tmp_path: Path) -> None:
    found: list[tuple[int, int]] = []
    work = Squares(str(tmp_path / "flag"), deadly=7)
    carry_out(work, range(20), 20, LocalProcesses(2), found.append)
    assert (tmp_path / "flag").exists()
    assert sorted(found) == [(k, k * k) for k in range(20)]
    assert len(list(tmp_path.glob("*-prepared-*"))) >= 2


@pytest.mark.slow
def test_a_share_that_always_ends_its_process_ends_the_work(tmp_path: Path) -> None:
    found: list[tuple[int, int]] = []
    work = Squares(str(tmp_path / "flag"), deadly=3, always=True)
    with pytest.raises(SharesLostError, match=rf"lost its worker {REPEATS + 1} times"):
        carry_out(work, range(8), 8, LocalProcesses(2), found.append)
    assert (3, 9) not in found
    assert len(set(found)) == len(found)


@given(st.text(max_size=40) | st.text("a1.:[]-/@ ", max_size=20).map("dask://{}:1".format))
def test_addresses_are_those_of_a_scheduler_or_refused(text: str) -> None:
    try:
        address = cluster_address(text)
    except ValueError:
        return
    if address is None:
        assert text == "local"
    else:
        host, _, port = address.rpartition(":")
        assert text.startswith(f"dask://{host}:")
        assert 0 < int(port) < 2**16
        assert not set(host) & set("/@?# \n\x1b")


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("local", None),
        ("dask://10.0.0.7:8786", "10.0.0.7:8786"),
        ("dask://head.cluster:08786", "head.cluster:8786"),
        ("dask://[::1]:8786", "[::1]:8786"),
        ("dask://a_b-c.d.:1", "a_b-c.d.:1"),
    ],
)
def test_addresses(text: str, address: str | None) -> None:
    assert cluster_address(text) == address


@pytest.mark.parametrize(
    "text",
    ["", "dask", "dask://", "dask://host", "dask://host:0", "dask://host:65536", "tcp://host:1",
     "dask://me@host:1", "dask://host:1/x", "dask://ho st:1", "dask://host:1\n", "LOCAL",
     "dask://..:1", "dask://.:1", "dask://-:1", "dask://a..b:1", "dask://.a:1", "dask://a-:1",
     f"dask://{'a' * 64}:1", f"dask://{'a.' * 127}:1"],
)  # fmt: skip
def test_what_is_no_address_is_refused_in_a_line(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(InputError, match=r"--on: .*must be local, or dask://HOST:PORT"):
        anaplot.simulate("6/3", on=text)
    assert main(["plan", "simulate", "6/3", "--on", text]) == 2
    told = capsys.readouterr().err
    assert "must be local, or dask://HOST:PORT" in told
    assert len(told.strip().splitlines()) <= 2


def test_what_does_not_go_together_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    call = ["plan", "simulate", "bayes-G3B", "--on", "dask://127.0.0.1:1"]
    assert main([*call, "--processes", "2"]) == 2
    assert "--processes goes with --on local" in capsys.readouterr().err
    assert main([*call, "--to-block", str(tmp_path / "b")]) == 2
    assert "--on goes without --to-block" in capsys.readouterr().err
    with ThreadPoolExecutor(1) as executor, pytest.raises(InputError, match="--on does not go"):
        anaplot.simulate("6/3", on="dask://127.0.0.1:1", executor=executor)


def test_a_program_brings_its_executor() -> None:
    one = anaplot.simulate("6/3", runs=20, strategy="tau", processes=1)
    with ThreadPoolExecutor(2) as executor:
        two = anaplot.simulate("6/3", runs=20, strategy="tau", executor=executor)
    assert two.to_dict() == one.to_dict()


def test_without_the_extra_it_is_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    assert main(["plan", "simulate", "6/3", "--on", "dask://127.0.0.1:1"]) == 2
    assert "needs dask.distributed: pip install 'anaplot[cluster]'" in capsys.readouterr().err


def test_a_share_that_is_lost_too_often_is_named() -> None:
    losses = Counter({4: REPEATS})
    with pytest.raises(SharesLostError, match=rf"^block b9 lost its worker {REPEATS + 1} times"):
        _count([(4, 9)], losses, lambda share: f"block b{share}")
