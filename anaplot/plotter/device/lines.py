"""The lines that a simulated plotter is served on: a pseudo-terminal, or a loopback TCP port."""

from __future__ import annotations

import contextlib
import os
import selectors
import socket
import sys
from pathlib import Path

from anaplot.errors import InputError
from anaplot.textfiles.wording import plain

__all__ = ["CHUNK", "Connection", "PseudoTerminal", "TcpPort"]

CHUNK = 4096
"""Bytes read at once."""


class PseudoTerminal:
    """A pseudo-terminal under a symbolic link."""

    def __init__(self, name: Path) -> None:
        self._name = name
        self._master = self._slave = -1
        self._open()

    def _open(self) -> None:
        if sys.platform == "win32":
            raise OSError("no pseudo-terminals here")
        import tty

        master, slave = os.openpty()
        self._master, self._slave = master, slave
        try:
            tty.setraw(slave)
            os.set_blocking(master, False)
            self._link(os.ttyname(slave))
        except (OSError, InputError):
            self._shut()
            raise

    def _link(self, target: str) -> None:
        """Point the symbolic link at the terminal; nothing but a symbolic link is replaced."""
        if self._name.exists() and not self._name.is_symlink():
            raise InputError(f"{plain(str(self._name), 120)}: exists and is no symbolic link")
        if self._name.is_symlink() and self._name.exists() and _is_foreign(self._name):
            raise InputError(
                f"{plain(str(self._name), 120)}: leads to a terminal that is in use; name another "
                "line, or remove it where its plotter runs no more"
            )
        temporary = self._name.with_name(f".{self._name.name}.{os.getpid()}")
        with contextlib.suppress(FileNotFoundError):
            temporary.unlink()
        temporary.symlink_to(target)
        temporary.replace(self._name)

    @property
    def port(self) -> str:
        """The symbolic link."""
        return str(self._name)

    def register(self, selector: selectors.BaseSelector, name: str) -> None:
        """Watch the master's end."""
        selector.register(self._master, selectors.EVENT_READ, name)

    def receive(self, selector: selectors.BaseSelector, name: str) -> bytes:
        """Read what the host has written."""
        try:
            return os.read(self._master, CHUNK)
        except OSError:
            return b""

    def send(self, data: bytes) -> int:
        """Write as much as the terminal takes."""
        if self._master < 0:
            return 0
        try:
            return os.write(self._master, data)
        except OSError:
            return 0

    def cut(self, selector: selectors.BaseSelector) -> None:
        """Close both ends; the name goes too, as the kernel may give the terminal to others."""
        if self._master >= 0:
            selector.unregister(self._master)
            self._shut()
            self._forget()

    def restore(self, selector: selectors.BaseSelector, name: str) -> None:
        """Open a new terminal under the old name."""
        if self._master < 0:
            self._open()
            self.register(selector, name)

    def _shut(self) -> None:
        for descriptor in (self._master, self._slave):
            if descriptor >= 0:
                os.close(descriptor)
        self._master = self._slave = -1

    def close(self) -> None:
        """Close both ends and take the name away."""
        if self._master >= 0:
            self._shut()
            self._forget()

    def _forget(self) -> None:
        with contextlib.suppress(OSError):
            self._name.unlink()


def _is_foreign(name: Path) -> bool:
    """Say whether a living terminal, somebody else's, hides behind a name."""
    target = str(name.resolve())
    return target.startswith(("/dev/pts/", "/dev/ttys"))


class TcpPort:
    """A loopback TCP port for one host at a time."""

    def __init__(self, number: int) -> None:
        self._number = number
        self._client: socket.socket | None = None
        self._listener: socket.socket | None = None
        self._listen()

    def _listen(self) -> None:
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            if sys.platform != "win32":
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(("127.0.0.1", self._number))
            listener.listen(1)
            listener.setblocking(False)
        except OSError:
            listener.close()
            raise
        self._listener = listener
        self._number = int(listener.getsockname()[1])

    @property
    def port(self) -> str:
        """The address as pyserial takes it."""
        return f"socket://127.0.0.1:{self._number}"

    def register(self, selector: selectors.BaseSelector, name: str) -> None:
        """Watch for a host."""
        if self._listener is not None:
            selector.register(self._listener, selectors.EVENT_READ, name)

    def receive(self, selector: selectors.BaseSelector, name: str) -> bytes:
        """Accept a host, or read what it has sent."""
        self._accept(selector, name)
        if self._client is None:
            return b""
        try:
            data = self._client.recv(CHUNK)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._drop(selector)
        return data

    def _accept(self, selector: selectors.BaseSelector, name: str) -> None:
        if self._listener is None:
            return
        try:
            client, _ = self._listener.accept()
        except OSError:
            return
        if self._client is not None and self._alive():
            # a plotter has one cable
            client.close()
            return
        self._drop(selector)
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client = client
        selector.register(client, selectors.EVENT_READ, name)

    def _alive(self) -> bool:
        if self._client is None:
            return False
        try:
            return self._client.recv(1, socket.MSG_PEEK) != b""
        except BlockingIOError:
            return True
        except OSError:
            return False

    def _drop(self, selector: selectors.BaseSelector) -> None:
        if self._client is not None:
            selector.unregister(self._client)
            self._client.close()
            self._client = None

    def send(self, data: bytes) -> int:
        """Send as much as the connection takes."""
        if self._client is None:
            return 0
        try:
            return self._client.send(data)
        except OSError:
            return 0

    def cut(self, selector: selectors.BaseSelector) -> None:
        """Drop the host and listen no longer."""
        self._drop(selector)
        if self._listener is not None:
            selector.unregister(self._listener)
            self._listener.close()
            self._listener = None

    def restore(self, selector: selectors.BaseSelector, name: str) -> None:
        """Listen again on the same port."""
        if self._listener is None:
            self._listen()
            self.register(selector, name)

    def close(self) -> None:
        """Close everything."""
        for end in (self._client, self._listener):
            if end is not None:
                end.close()
        self._client = self._listener = None


Connection = PseudoTerminal | TcpPort
"""One end of a line: both kinds have the same methods."""
