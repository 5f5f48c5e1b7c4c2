"""A cluster of dask on this machine's loopback: the same figures, and what becomes of losses."""

from __future__ import annotations

import http.server
import importlib
import json
import os
import signal
import socket
import tempfile
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from threading import Thread, Timer
from typing import Any

import pytest
from extras import needed
from sharework import Failing, Squares

import anaplot
from anaplot.cli import main
from anaplot.errors import InputError, NotComputableError
from anaplot.planning.montecarlo import ChunkDone
from anaplot.shares.cluster import Cluster, _Cluster
from anaplot.shares.work import REPEATS, SharesLostError, carry_out, versions_here

# twenty shares
CALL = ["plan", "simulate", "6/3", "--strategy", "baarda,tau", "--runs", "1000", "--json"]


@contextmanager
def cluster(workers: int, threads: int = 1, *, processes: bool = False) -> Iterator[Any]:
    """Have a scheduler and workers that nobody else can reach."""
    distributed = needed("distributed", "cluster")
    with (
        tempfile.TemporaryDirectory() as scratch,
        distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=threads,
            processes=processes,
            host="127.0.0.1",
            protocol="tcp://",
            dashboard_address="127.0.0.1:0",
            worker_dashboard_address=None,
            silence_logs=50,
            local_directory=scratch,
        ) as found,
    ):
        yield found


def address_of(found: Any) -> str:
    return str(found.scheduler_address).removeprefix("tcp://")


@pytest.mark.slow
@pytest.mark.parametrize(("workers", "threads"), [(1, 1), (3, 2)])
def test_the_figures_are_those_of_this_machine(
    workers: int, threads: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*CALL, "--processes", "1"]) == 0
    here = capsys.readouterr().out
    with cluster(workers, threads) as found:
        assert main([*CALL, "--on", f"dask://{address_of(found)}"]) == 0
        assert capsys.readouterr().out == here
        # a program's own executor, which it keeps
        distributed = needed("distributed", "cluster")
        with distributed.Client(found, set_as_default=False) as client:
            executor = client.get_executor()
            told = anaplot.simulate(
                "6/3", strategy="baarda,tau", runs=1000, executor=executor, processes=2
            )
            assert told.to_dict() == json.loads(here)


@pytest.mark.slow
def test_a_lost_cluster_says_how_to_go_on_and_nothing_is_done_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main([*CALL, "--processes", "1"]) == 0
    undisturbed = capsys.readouterr().out
    kept = tmp_path / "kept.jsonl"
    with cluster(1) as found:
        keep = anaplot.report.simulatecommand._keep

        def keep_and_end(file: Any, chunk: ChunkDone) -> None:
            keep(file, chunk)
            found.close()

        monkeypatch.setattr("anaplot.report.simulatecommand._keep", keep_and_end)
        on = Cluster(address_of(found), patience=1.0)
        monkeypatch.setattr("anaplot.report.simulatecommand.place_of", lambda *_: on)
        assert main([*CALL, "--to", str(kept)]) == 4
    told = capsys.readouterr()
    assert told.out == ""
    assert f"{on.named()} was lost half-way; {kept} has what is done: the same" in told.err
    assert "Traceback" not in told.err
    before = kept.read_bytes()
    assert 2 <= before.count(b"\n") < 21
    monkeypatch.undo()
    assert main([*CALL, "--to", str(kept)]) == 0
    assert capsys.readouterr().out == undisturbed
    after = kept.read_bytes()
    assert after.startswith(before)
    numbers = [json.loads(line)["chunk"] for line in after.splitlines()[1:]]
    assert len(numbers) == len(set(numbers))


@pytest.mark.long
@pytest.mark.slow
def test_the_share_of_a_lost_worker_is_done_again(tmp_path: Path) -> None:
    found: list[tuple[int, int]] = []
    with cluster(2, processes=True) as there:
        work = Squares(str(tmp_path / "flag"), deadly=7)
        carry_out(work, range(20), 20, Cluster(address_of(there)), found.append)
        assert (tmp_path / "flag").exists()
        assert sorted(found) == [(k, k * k) for k in range(20)]
        deadly = Squares(str(tmp_path / "flag"), deadly=3, always=True)
        with pytest.raises(SharesLostError, match=r"lost its worker (four|4) times"):
            carry_out(deadly, range(6), 6, Cluster(address_of(there)), found.append)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.timeout(120)
@pytest.mark.parametrize("which", [0, 1])
def test_a_worker_that_is_lost_while_the_work_is_handed_out_is_not_waited_for(
    tmp_path: Path, which: int
) -> None:
    found: list[tuple[int, int]] = []
    with cluster(2, processes=True) as there:
        handlers = there.scheduler.handlers
        hand_out = handlers["scatter"]

        async def hand_out_and_lose(**given: Any) -> Any:
            handlers["scatter"] = hand_out
            sent_to = importlib.import_module("distributed.utils_comm")._round_robin_counter
            sent_to[0] = 0  # the first by address; the other would have got a copy of it
            address = sorted(there.scheduler.workers)[which]
            (lost,) = (nanny for nanny in there.workers.values() if nanny.worker_address == address)
            os.kill(lost.pid, signal.SIGKILL)
            return await hand_out(**given)

        handlers["scatter"] = hand_out_and_lose
        work = Squares(str(tmp_path / "flag"))
        carry_out(work, range(20), 20, Cluster(address_of(there)), found.append)
        assert handlers["scatter"] is hand_out
    assert sorted(found) == [(k, k * k) for k in range(20)]


class Dask:
    """A client whose workers are threads of this process."""

    def __init__(self, executor: Executor) -> None:
        self.executor = executor

    def submit(self, do: Any, *args: Any, pure: bool) -> Any:
        assert not pure
        return self.executor.submit(do, *args)

    def wait_for_workers(self, *_: object, **__: object) -> None: ...

    def scatter(self, sent: Any, **_: object) -> Any:
        return sent

    def nthreads(self) -> dict[str, int]:
        return {"a": 1}


class Losing(Dask):
    """A client that loses a worker while it hands out what all need."""

    def __init__(self, executor: Executor, times: int, error: type[Exception] = OSError) -> None:
        super().__init__(executor)
        self.times, self.error, self.asked = times, error, 0

    def scatter(self, sent: Any, **_: object) -> Any:
        self.asked += 1
        if self.asked <= self.times:
            raise self.error("in <TCP (closed) ConnectionPool.scatter>: Stream is closed")
        return sent


@pytest.mark.parametrize("error", [OSError, KeyError])  # of its line, and of the scheduler's list
@pytest.mark.parametrize("times", [0, 1, REPEATS])
def test_a_worker_that_is_lost_while_it_is_given_the_work_does_not_end_it(
    times: int, error: type[Exception]
) -> None:
    work = Failing(-1)
    with ThreadPoolExecutor(1) as executor:
        client = Losing(executor, times, error)
        there = _Cluster(Cluster("head:1"), client, work)
        assert client.asked == times + 1
        assert there.hand_out(3).result() == work.do(3)


def test_a_scheduler_that_never_hands_out_the_work_is_lost() -> None:
    with ThreadPoolExecutor(1) as executor:
        client = Losing(executor, 99)
        with pytest.raises(SharesLostError, match="dask://head:1 was lost half-way"):
            _Cluster(Cluster("head:1"), client, Failing(-1))
    assert client.asked == REPEATS + 1


class Threads:
    """A place of such workers."""

    @contextmanager
    def workers(self, sent: Any, shares: int) -> Iterator[_Cluster]:
        with ThreadPoolExecutor(1) as executor:
            yield _Cluster(Cluster("head:1"), Dask(executor), sent)


@pytest.mark.parametrize(
    "error",
    [
        FileNotFoundError(2, "no such file", "given.npz"),
        ModuleNotFoundError("No module named 'x'", name="x"),
        CancelledError("by itself"),
        NotComputableError("share 3"),
    ],
)
def test_an_error_of_a_share_is_no_lost_worker(error: Exception) -> None:
    found: list[int] = []
    with pytest.raises(type(error)) as told:
        carry_out(Failing(3, error), range(9), 9, Threads(), found.append)
    assert told.value is error
    assert {0, 1, 2} <= set(found)
    assert len(set(found)) == len(found)


def test_what_a_worker_lacks_is_named() -> None:
    there = _Cluster(Cluster("head:1"), Dask(ThreadPoolExecutor(1)), None)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="has no anaplot of this kind"):
        there.was_lost(ModuleNotFoundError("No module named 'anaplot.x'", name="anaplot.x"))
    with pytest.raises(InputError, match="has not all that is needed"):
        there.was_lost(ModuleNotFoundError("No module named 'mine'", name="mine"))


@pytest.mark.slow
def test_a_share_that_fails_by_itself_fails_as_here() -> None:
    found: list[int] = []
    with cluster(1) as there:
        missing = Failing(3, FileNotFoundError(2, "no such file", "given.npz"))
        with pytest.raises(FileNotFoundError, match="given"):
            carry_out(missing, range(9), 9, Cluster(address_of(there)), found.append)
        with pytest.raises(ArithmeticError, match="share 3"):
            carry_out(Failing(3), range(9), 9, Cluster(address_of(there)), found.append)
        there.scale(0)
        with pytest.raises(NotComputableError, match=r"has no worker within 0\.2 s"):
            carry_out(Failing(3), range(9), 9, Cluster(address_of(there), 0.2), found.append)


@pytest.mark.slow
def test_workers_that_have_gone_for_good_are_not_waited_for() -> None:
    found: list[int] = []
    with cluster(1) as there:

        def take(number: int) -> None:
            found.append(number)
            there.scale(0)

        place = Cluster(address_of(there), patience=1.0, alone=0.1)
        with pytest.raises(SharesLostError, match=r"has had no worker for 0\.1 s"):
            carry_out(Failing(-1), range(500), 500, place, take)
    assert 0 < len(found) < 500
    assert len(set(found)) == len(found)


@pytest.mark.slow
def test_a_worker_that_comes_back_within_the_minute_goes_on() -> None:
    """However short the patience with a first answer is."""
    found: list[int] = []
    with cluster(1) as there:

        def take(number: int) -> None:
            found.append(number)
            if len(found) == 3:
                there.scale(0)
                Timer(1.5, there.scale, [1]).start()

        place = Cluster(address_of(there), patience=0.5)
        carry_out(Failing(-1), range(40), 40, place, take)
    assert sorted(found) == list(range(40))


class Told:
    """A client whose workers have other versions."""

    def __init__(self, answers: dict[str, Any]) -> None:
        self.answers = answers

    def wait_for_workers(self, *_: object, **__: object) -> None: ...

    def run(self, *_: object, **__: object) -> dict[str, Any]:
        return self.answers


@pytest.mark.parametrize("package", ["anaplot", "numpy", "scipy"])
def test_versions_are_looked_at_before_anything_is_done(package: str) -> None:
    good = versions_here()
    place = Cluster("head:1")
    place._check(Told({"tcp://a:1": good, "tcp://b:2": dict(good)}))
    with pytest.raises(InputError, match=rf"worker tcp://b:2 has {package} 1\.0\\x1b, here is"):
        place._check(Told({"tcp://a:1": good, "tcp://b:2": {**good, package: "1.0\x1b"}}))
    missing = ModuleNotFoundError("No module named 'anaplot'")
    with pytest.raises(InputError, match="worker tcp://b:2 has no anaplot of this kind"):
        place._check(Told({"tcp://a:1": good, "tcp://b:2": missing}))


def test_a_setting_that_dask_refuses_is_said_at_once() -> None:
    class Distributed:
        def Security(self) -> None:
            raise ValueError("no such cipher")

    with pytest.raises(NotComputableError, match="no such cipher"):
        Cluster("head:1", patience=60.0)._client(Distributed())


def refused(address: str) -> str:
    needed("distributed", "cluster")
    with pytest.raises(NotComputableError) as error:
        carry_out(Failing(-1), range(2), 2, Cluster(address, patience=0.3), print)
    return str(error.value)


@pytest.mark.slow
def test_nobody_who_answers_is_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        assert "takes the call, and says nothing" in refused(f"127.0.0.1:{port}")
    told = refused(f"127.0.0.1:{port}")
    assert told.startswith(f"dask://127.0.0.1:{port}: no dask scheduler answers within 0.3 s")
    assert "\n" not in told


@pytest.mark.slow
def test_another_kind_of_server_is_one_line() -> None:
    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None: ...

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Quiet) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        told = refused(f"127.0.0.1:{server.server_port}")
        server.shutdown()
    assert "no dask scheduler answers within 0.3 s" in told
    assert "\n" not in told
