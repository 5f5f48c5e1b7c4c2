"""The simulated plotter behind a real line: a pseudo-terminal, or a loopback TCP port."""

from __future__ import annotations

import contextlib
import os
import selectors
import shutil
import socket
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

from anaplot.errors import InputError, LinkError
from anaplot.plotter.device.lines import CHUNK, Connection, PseudoTerminal, TcpPort
from anaplot.plotter.device.plotter import SimulatedPlotter

__all__ = ["SimulatorServer"]

_JOIN = 10.0


class SimulatorServer:
    """Runs a simulated plotter in a thread and serves its lines.

    Parameters
    ----------
    simulator
        The plotter.
    symlink
        Stable name of the pseudo-terminal; with several links ``-NAME`` is added. Without it a
        name in a private temporary folder is made.
    tcp
        Serve loopback TCP ports instead; also where there are no pseudo-terminals.
    tcp_port
        Number of the first TCP port; 0 for any free one.
    time_scale
        Simulated seconds per second.

    Notes
    -----
    A context manager: `start` and `close` leave no thread, descriptor or name behind. Bytes that
    the line does not take, because nobody reads, are lost, as on a cable.
    """

    def __init__(
        self,
        simulator: SimulatedPlotter,
        *,
        symlink: str | Path | None = None,
        tcp: bool = False,
        tcp_port: int = 0,
        time_scale: float = 1.0,
    ) -> None:
        if not 0.0 < time_scale < 1e6:
            raise InputError("the time scale of a simulated plotter must be positive")
        self._simulator = simulator
        self._symlink = Path(symlink) if symlink is not None else None
        self._tcp = tcp or not hasattr(os, "openpty")
        self._tcp_port = tcp_port
        self._scale = time_scale
        self._folder: str | None = None
        self._lines: dict[str, Connection] = {}
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._jobs: list[tuple[Callable[[], None], threading.Event]] = []
        self._jobs_lock = threading.Lock()
        self._selector: selectors.BaseSelector | None = None
        self._wake_in: socket.socket | None = None
        self._wake_out: socket.socket | None = None
        self._lost = 0
        self._mending: list[tuple[float, str]] = []

    # -- life ------------------------------------------------------------------------------

    def start(self) -> SimulatorServer:
        """Open the lines and run.

        Raises
        ------
        LinkError
            When a line cannot be made.
        InputError
            When it runs already or the symbolic link's name is taken.
        """
        if self._thread is not None:
            raise InputError("the simulated plotter runs already")
        self._stop.clear()
        self._selector = selectors.DefaultSelector()
        self._wake_out, self._wake_in = socket.socketpair()
        self._wake_out.setblocking(False)
        self._wake_in.setblocking(False)
        self._selector.register(self._wake_out, selectors.EVENT_READ, "")
        try:
            for at, name in enumerate(self._simulator.profile.links):
                line = self._make_line(name, at)
                self._lines[name] = line
                line.register(self._selector, name)
        except OSError as error:
            self._release()
            reason = error.strerror or str(error)
            raise LinkError(f"the simulated plotter's line cannot be made: {reason}") from None
        except InputError:
            self._release()
            raise
        self._simulator.set_on_wake(self._wake)
        self._thread = threading.Thread(target=self._run, name="simulated plotter", daemon=True)
        self._thread.start()
        return self

    def _make_line(self, name: str, at: int) -> Connection:
        if self._tcp:
            return TcpPort(self._tcp_port + at if self._tcp_port else 0)
        several = len(self._simulator.profile.links) > 1
        if self._symlink is not None:
            ending = f"-{name}" if several else ""
            return PseudoTerminal(self._symlink.with_name(self._symlink.name + ending))
        if self._folder is None:
            self._folder = tempfile.mkdtemp(prefix="anaplot-plotter-")
        return PseudoTerminal(Path(self._folder) / name)

    def close(self) -> None:
        """Stop and give everything back; may be called more than once."""
        thread, self._thread = self._thread, None
        self._simulator.set_on_wake(None)
        if thread is not None:
            self._stop.set()
            self._wake()
            if thread is not threading.current_thread():
                thread.join(_JOIN)
        self._release()

    def _release(self) -> None:
        for line in self._lines.values():
            line.close()
        self._lines = {}
        self._mending = []
        if self._selector is not None:
            self._selector.close()
            self._selector = None
        for end in (self._wake_in, self._wake_out):
            if end is not None:
                end.close()
        self._wake_in = self._wake_out = None
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = None
        for _, done in self._jobs:
            done.set()
        self._jobs = []

    def __enter__(self) -> SimulatorServer:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- what it offers --------------------------------------------------------------------

    @property
    def simulator(self) -> SimulatedPlotter:
        """The plotter."""
        return self._simulator

    @property
    def port(self) -> str:
        """What a `Link` opens, for a profile with one link.

        Raises
        ------
        InputError
            When the profile has several links, or the server does not run.
        """
        if len(self._lines) != 1:
            raise InputError("the simulated plotter has several lines, or none: see ports")
        return next(iter(self._lines.values())).port

    @property
    def ports(self) -> dict[str, str]:
        """What a `Link` opens, by the profile's links."""
        return {name: line.port for name, line in self._lines.items()}

    @property
    def lost_bytes(self) -> int:
        """Bytes that the line did not take."""
        return self._lost

    @property
    def running(self) -> bool:
        """Whether the thread runs."""
        return self._thread is not None and self._thread.is_alive()

    def disconnect(self, link: str | None = None) -> None:
        """Break a line, or all of them: the host sees its port go away."""
        self._do(lambda: self._each(link, lambda name, line, sel: line.cut(sel)))

    def reconnect(self, link: str | None = None) -> None:
        """Mend what `disconnect` broke, under the same name."""
        self._do(lambda: self._each(link, lambda name, line, sel: line.restore(sel, name)))

    # -- the thread ------------------------------------------------------------------------

    def _each(
        self,
        link: str | None,
        action: Callable[[str, Connection, selectors.BaseSelector], None],
    ) -> None:
        if self._selector is None:
            return
        for name, line in self._lines.items():
            if link is None or link == name:
                action(name, line, self._selector)

    def _do(self, job: Callable[[], None]) -> None:
        """Have the thread do a job, and wait until it is done."""
        thread = self._thread
        if thread is None:
            raise InputError("the simulated plotter does not run")
        if thread is threading.current_thread():
            job()
            return
        done = threading.Event()
        with self._jobs_lock:
            self._jobs.append((job, done))
        self._wake()
        done.wait(_JOIN)

    def _wake(self) -> None:
        wake = self._wake_in
        if wake is not None:
            # a full buffer wakes as well, a closed one has nobody to wake
            with contextlib.suppress(OSError):
                wake.send(b"w")

    def _run(self) -> None:
        selector = self._selector
        if selector is None:
            return
        last = time.monotonic()
        while not self._stop.is_set():
            now = time.monotonic()
            self._simulator.advance((now - last) * self._scale)
            last = now
            self._flush()
            self._cut_and_mend(now)
            if self._stop.is_set():
                return
            pause = self._simulator.next_event()
            timeout = None if pause is None else pause / self._scale
            if self._mending:
                mend = max(0.0, min(when for when, _ in self._mending) - now)
                timeout = mend if timeout is None else min(timeout, mend)
            ready = [(key.fileobj, str(key.data)) for key, _ in selector.select(timeout)]
            # the wake is taken back before the jobs are: none may be left without a wake
            if any(name == "" for _, name in ready):
                self._drain()
            with self._jobs_lock:
                jobs, self._jobs = self._jobs, []
            for job, done in jobs:
                job()
                done.set()
            # what arrives, arrives now and not when the last round began
            now = time.monotonic()
            self._simulator.advance((now - last) * self._scale)
            last = now
            for fileobj, name in ready:
                if name in self._lines and fileobj in _registered(selector):
                    data = self._lines[name].receive(selector, name)
                    if data:
                        self._simulator.receive(data, name)

    def _cut_and_mend(self, now: float) -> None:
        """Break and mend the lines that a fault has struck."""
        for name, seconds in self._simulator.take_cuts():
            self._each(name, lambda _, line, selector: line.cut(selector))
            self._mending.append((now + seconds / self._scale, name))
        due = [name for when, name in self._mending if when <= now]
        self._mending = [item for item in self._mending if item[0] > now]
        for name in due:
            self._each(name, lambda name, line, selector: line.restore(selector, name))

    def _drain(self) -> None:
        if self._wake_out is not None:
            with contextlib.suppress(OSError):
                self._wake_out.recv(CHUNK)

    def _flush(self) -> None:
        for name, line in self._lines.items():
            data = self._simulator.take(name)
            if data:
                self._lost += len(data) - line.send(data)


def _registered(selector: selectors.BaseSelector) -> set[object]:
    return {key.fileobj for key in selector.get_map().values()}
