"""Processes of this machine, or this one alone; or an executor that a program brings."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import connection, get_context, parent_process, resource_tracker
from typing import Any, ClassVar, NamedTuple

from anaplot.shares.work import Sent, SharesLostError

__all__ = ["GivenExecutor", "LocalProcesses"]

_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")


class LocalProcesses(NamedTuple):
    """So many processes of this machine; with 1 nothing is started beside this one."""

    processes: int

    @contextmanager
    def workers(self, sent: Sent[Any, Any], shares: int) -> Iterator[_Pool | _Here]:
        """See `Place`."""
        processes = min(self.processes, shares)
        if processes <= 1:
            yield _Here(sent)
            return
        with _one_thread_each():
            pool = _Pool(sent, processes)
            try:
                yield pool
            except BaseException:
                # what is still running belongs to work that has ended
                pool.end_all()
                raise
            finally:
                pool.close()


class _Here:
    """Nobody beside this process, which is not lost by itself."""

    ahead = 1
    lost_together = False

    def __init__(self, sent: Sent[Any, Any]) -> None:
        self._sent = sent

    def hand_out(self, share: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(self._sent.do(share))
        return done

    def was_lost(self, error: BaseException) -> bool:
        return False

    def look(self) -> None: ...

    def renew(self) -> None: ...


class _Pool:
    """Processes that are started anew when one of them dies: it takes the others with it."""

    lost_together = True

    def __init__(self, sent: Sent[Any, Any], processes: int) -> None:
        self._sent, self._processes = sent, processes
        self.ahead = 2 * processes
        # what stands in it is never read: every process of these, and no other, sees it
        self._ended, self._end = get_context("spawn").Pipe(duplex=False)
        self._executor = self._started()

    def _started(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            self._processes,
            mp_context=get_context("spawn"),
            initializer=_start,
            initargs=(self._sent, self._ended),
        )

    def end_all(self) -> None:
        """Let all processes end in the middle of what they do."""
        self._end.send_bytes(b"end")

    def close(self) -> None:
        """Wait until all have ended."""
        self._executor.shutdown(wait=True, cancel_futures=True)
        self._ended.close()
        self._end.close()

    def hand_out(self, share: Any) -> Future[Any]:
        with _interrupts_held():
            try:
                return self._executor.submit(_do_there, share)
            except BrokenProcessPool as error:
                lost: Future[Any] = Future()
                lost.set_exception(error)
                return lost

    def was_lost(self, error: BaseException) -> bool:
        return isinstance(error, BrokenProcessPool)

    def look(self) -> None: ...

    def renew(self) -> None:
        self._executor.shutdown(wait=True, cancel_futures=True)
        self._executor = self._started()


class GivenExecutor(NamedTuple):
    """Somebody's executor, with so many shares handed out at a time; it is left open.

    Every share brings the work along; a worker makes it ready once.
    """

    executor: Executor
    ahead: int

    @contextmanager
    def workers(self, sent: Sent[Any, Any], shares: int) -> Iterator[_Given]:
        """See `Place`."""
        yield _Given(self.executor, sent, self.ahead)


class _Given:
    lost_together = False

    def __init__(self, executor: Executor, sent: Sent[Any, Any], ahead: int) -> None:
        self._executor, self._sent, self.ahead = executor, sent, ahead

    def hand_out(self, share: Any) -> Future[Any]:
        try:
            return self._executor.submit(_do_sent, self._sent, share)
        except BrokenExecutor as error:
            raise SharesLostError("the executor is broken: a worker died") from error

    def was_lost(self, error: BaseException) -> bool:
        if isinstance(error, BrokenExecutor):
            raise SharesLostError("the executor is broken: a worker died") from error
        if isinstance(error, CancelledError):
            raise SharesLostError("the executor has cancelled shares") from error
        return False

    def look(self) -> None: ...

    def renew(self) -> None: ...


def _do_sent(sent: Sent[Any, Any], share: Any) -> Any:
    return sent.do(share)


class _Worker:
    """What a process that was started for some work holds."""

    sent: Sent[Any, Any] | None = None


def _start(sent: Sent[Any, Any], ended: connection.Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # interrupts are the parent's business
    _end_with_the_parent(ended)
    _Worker.sent = sent


def _do_there(share: Any) -> Any:
    assert _Worker.sent is not None
    return _Worker.sent.do(share)


def _end_with_the_parent(ended: connection.Connection) -> None:
    """Let this process end when its parent says so, or does, also when that was killed."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        connection.wait([parent.sentinel, ended])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Keep interrupts until the end, and from processes that start meanwhile for good.

    A process would otherwise complain of an interrupt that comes before it can ignore it.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # starting it later would let interrupts through
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _OneThread:
    """What the environment said of threads, and for how many pools it now says one."""

    lock = threading.Lock()
    pools = 0
    before: ClassVar[dict[str, str | None]] = {}


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let the processes started meanwhile do linear algebra with one thread each."""
    with _OneThread.lock:
        if not _OneThread.pools:
            _OneThread.before = {name: os.environ.get(name) for name in _THREADS}
            os.environ.update(dict.fromkeys(_THREADS, "1"))
        _OneThread.pools += 1
    try:
        yield
    finally:
        with _OneThread.lock:
            _OneThread.pools -= 1
            before = {} if _OneThread.pools else _OneThread.before
            for name, value in before.items():
                if value is None:
                    os.environ.pop(name, None)
                else:
                    os.environ[name] = value
