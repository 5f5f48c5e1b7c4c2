"""A cluster of dask.distributed (the extra `cluster`), which somebody else has started.

Code and data go to its scheduler and workers as pickles, and answers come back as such: whoever
controls them can do on this machine what this process can. Nothing is started here, no port is
opened; the connection is that of dask's configuration, also where that asks for TLS.
"""

from __future__ import annotations

import asyncio
import logging
import pickle
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager, suppress
from functools import partial
from importlib import import_module
from threading import Event, Thread
from typing import Any, NamedTuple

from anaplot.errors import AnaplotError, InputError, NotComputableError
from anaplot.shares.work import REPEATS, Failed, Sent, SharesLostError, forget, versions_here
from anaplot.textfiles.wording import plain

__all__ = ["Cluster"]

_PATIENCE = 10.0  # seconds for an answer, and for a first worker
_MORE = 1.0  # seconds that dask has to say itself that nobody answers
_ALONE = 60.0  # seconds without any worker before nobody is waited for
_EVERY = 2.0  # seconds after which workers are counted again
_AGAIN = 0.2  # where nothing can be done without one
_SAID = 200  # characters of somebody else's message
_LOGGERS = ("distributed", "distributed.client", "distributed.core", "tornado.application")


class Cluster(NamedTuple):
    """The workers of a dask cluster.

    Attributes
    ----------
    address
        HOST:PORT of its scheduler.
    patience
        Seconds that are waited for an answer and for a first worker.
    alone
        Seconds that are waited half-way when there is no worker any more.
    """

    address: str
    patience: float = _PATIENCE
    alone: float = _ALONE

    @contextmanager
    def workers(self, sent: Sent[Any, Any], shares: int) -> Iterator[_Cluster]:
        """See `Place`.

        Raises
        ------
        InputError
            The extra is missing, or a worker has other versions than this process.
        NotComputableError
            No answer, or no worker.
        """
        distributed = self._distributed()
        with _quiet():
            client = self._client(distributed)
            try:
                self._check(client)
                there = _Cluster(self, client, sent)
                yield there
                with suppress(Exception):  # the work is done, whatever becomes of the workers
                    client.run(forget)
            finally:
                with suppress(Exception):
                    client.close(timeout=self.patience)

    def named(self) -> str:
        """Return what messages call it."""
        return f"dask://{self.address}"

    def _distributed(self) -> Any:
        try:
            return import_module("distributed")
        except ImportError:
            raise InputError(
                f"{self.named()} needs dask.distributed: pip install 'anaplot[cluster]'"
            ) from None

    def _client(self, distributed: Any) -> Any:
        # in a thread: dask waits without end for a server that takes the call and says nothing
        connected: Future[Any] = Future()
        given_up = Event()

        def connect() -> None:
            try:
                secure = distributed.Security().require_encryption
                client = distributed.Client(
                    f"{'tls' if secure else 'tcp'}://{self.address}",
                    timeout=self.patience,
                    set_as_default=False,
                )
            except Exception as error:  # noqa: BLE001 - it is handed on
                connected.set_exception(error)
                return
            connected.set_result(client)
            if given_up.is_set():
                client.close()

        Thread(target=connect, name="dask", daemon=True).start()
        try:
            return connected.result(timeout=self.patience + _MORE)
        except (OSError, TimeoutError, ValueError, RuntimeError) as error:
            given_up.set()
            with suppress(Exception):  # it may have come at the last moment
                connected.result(timeout=0).close()
            said = plain(str(error) or "it takes the call, and says nothing", _SAID)
            raise NotComputableError(
                f"{self.named()}: no dask scheduler answers within {self.patience:g} s ({said})"
            ) from None

    def _check(self, client: Any) -> None:
        """Look at the versions of all workers before anything is done."""
        try:
            client.wait_for_workers(1, timeout=self.patience)
            found = client.run(versions_here, on_error="return")
        except (OSError, TimeoutError) as error:
            there = "" if isinstance(error, TimeoutError) else f" ({plain(str(error), _SAID)})"
            raise NotComputableError(
                f"{self.named()} has no worker within {self.patience:g} s{there}"
            ) from None
        here = versions_here()
        for worker, versions in sorted(found.items()):
            where = f"{self.named()}: worker {plain(str(worker), _SAID)}"
            if not isinstance(versions, dict):
                said = plain(f"{type(versions).__name__}: {versions}", _SAID)
                raise InputError(f"{where} has no anaplot of this kind ({said})")
            for package, version in here.items():
                if versions.get(package) != version:
                    other = plain(str(versions.get(package)), _SAID)
                    raise InputError(
                        f"{where} has {package} {other}, here is {version}: figures could differ"
                    )


class _Cluster:
    """See `Workers`. dask does the share of a lost worker again by itself, three times."""

    lost_together = False

    def __init__(self, of: Cluster, client: Any, sent: Sent[Any, Any]) -> None:
        self._of, self._client, self._sent = of, client, sent
        self._counted, self._threads = 0.0, 1
        self._seen = time.monotonic()
        self.renew()

    @property
    def ahead(self) -> int:
        self._count()
        return 2 * max(self._threads, 1)

    def _count(self) -> None:
        now = time.monotonic()
        if now < self._counted + _EVERY:
            return
        with self._asking():
            self._threads = sum(self._client.nthreads().values())
        self._counted = time.monotonic()
        if self._threads:
            self._seen = self._counted

    def hand_out(self, share: Any) -> Future[Any]:
        done: Future[Any] = Future()
        with self._asking():
            # not its executor: that takes an answer whose worker is lost just then for an error
            asked = self._client.submit(_do_sent, self._there, share, pure=False)
            done.add_done_callback(partial(_give_up, asked))
            asked.add_done_callback(partial(_hand_on, done))
        return done

    def was_lost(self, error: BaseException) -> bool:
        if type(error).__name__ == "KilledWorker":
            raise SharesLostError(
                f"{self._of.named()}: a share lost its worker four times (out of memory?)"
            ) from error
        if isinstance(error, ImportError):
            # outside of the share, see `_do_sent`: it could not even be received
            ours = (error.name or "").split(".")[0] == "anaplot"
            lacks = "no anaplot of this kind" if ours else "not all that is needed"
            raise InputError(
                f"{self._of.named()}: a worker has {lacks} ({plain(str(error), _SAID)})"
            ) from error
        if isinstance(error, AnaplotError):
            return False
        # the scheduler has gone, or what was sent went with all who had it
        return isinstance(error, CancelledError | OSError)

    def look(self) -> None:
        self._count()
        self._alone()

    def _alone(self) -> None:
        if time.monotonic() > self._seen + self._of.alone:
            raise SharesLostError(f"{self._of.named()} has had no worker for {self._of.alone:g} s")

    def renew(self) -> None:
        for left in reversed(range(REPEATS + 1)):
            self._wait_for_one()
            with self._asking():
                try:
                    # to one; those that need it get it from whoever has it. dask's copies for all
                    # (`broadcast`) do not end where a worker is lost meanwhile
                    self._there = self._client.scatter(self._sent, hash=False)
                    return
                except Exception:
                    # so a worker that is lost just now shows itself, not only a lost scheduler
                    if not left:
                        raise

    def _wait_for_one(self) -> None:
        """Wait until there is a worker, as long as a scheduler without one is waited for."""
        while True:
            self._counted = 0.0
            self._count()
            if self._threads:
                return
            self._alone()
            time.sleep(_AGAIN)

    @contextmanager
    def _asking(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            # whatever a client makes of having lost its scheduler, that is what it means
            raise SharesLostError(f"{self._of.named()} was lost half-way") from error


def _hand_on(done: Future[Any], asked: Any) -> None:
    """Tell what became of a share; in a thread of dask's client."""
    if not done.set_running_or_notify_cancel():
        return
    try:
        found = asked.result()
    except asyncio.CancelledError as error:
        done.set_exception(CancelledError(*error.args))  # that of asyncio is no Exception
    except BaseException as error:  # noqa: BLE001 - it is handed on
        done.set_exception(error)
    else:
        done.set_result(found)


def _give_up(asked: Any, done: Future[Any]) -> None:
    if done.cancelled():
        asked.cancel()


def _do_sent(sent: Sent[Any, Any], share: Any) -> Any:
    """Do a share; its own error is an answer, so that one of dask is never taken for it."""
    try:
        return sent.do(share)
    except Exception as error:
        try:
            whole = type(pickle.loads(pickle.dumps(error))) is type(error)  # noqa: S301 - it is ours
        except Exception:  # noqa: BLE001 - whatever its class makes of it
            whole = False
        if not whole:
            raise  # dask has a way to send it
        return Failed(error)


@contextmanager
def _quiet() -> Iterator[None]:
    """Let nobody write a log meanwhile: what matters of it is an error here."""
    loggers = [logging.getLogger(name) for name in _LOGGERS]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
