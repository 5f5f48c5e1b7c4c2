"""The only place that touches pyserial: what it throws becomes `LinkError`, in one line."""

from __future__ import annotations

import contextlib
import errno
import os
import selectors
import sys
import threading
from dataclasses import dataclass
from typing import Any, Final

import serial
from serial.tools import list_ports

from anaplot.errors import LinkError
from anaplot.plotter.schema import LineSettings
from anaplot.textfiles.wording import plain

__all__ = ["ParityMarks", "PortInfo", "SerialPort", "find_port", "identity_of", "ports"]

if sys.platform == "win32":
    _TERMINAL_ERRORS: tuple[type[Exception], ...] = ()
else:
    import termios

    # termios.error is no OSError
    _TERMINAL_ERRORS = (termios.error,)

# What pyserial was seen to throw when a port is wrong, goes away or is closed meanwhile.
_THROWN: Final = (
    serial.SerialException,
    OSError,
    TypeError,
    AttributeError,
    ValueError,
    NotImplementedError,
    *_TERMINAL_ERRORS,
)
_PARITY: Final = {
    "none": serial.PARITY_NONE,
    "even": serial.PARITY_EVEN,
    "odd": serial.PARITY_ODD,
    "mark": serial.PARITY_MARK,
    "space": serial.PARITY_SPACE,
}
BY_IDENTITY: Final = "usb:"
_WRITE_TIMEOUT: Final = 1.0
_SHORT: Final = 0.02
_CHUNK: Final = 4096


@dataclass(frozen=True, slots=True)
class PortInfo:
    """A port of this computer.

    Attributes
    ----------
    address
        What opens it.
    description
        One safe line about it.
    identity
        ``VID:PID:serial`` of a USB adapter, or "" where there is none.
    """

    address: str
    description: str
    identity: str


def ports() -> list[PortInfo]:
    """List the serial ports of this computer, sorted by address.

    Raises
    ------
    LinkError
        When the system cannot tell.
    """
    try:
        found = list(list_ports.comports())
    except _THROWN as error:
        raise LinkError(f"the ports cannot be listed: {_reason(error)}") from None
    infos = []
    for port in found:
        identity = ""
        if port.vid is not None and port.pid is not None:
            identity = f"{port.vid:04X}:{port.pid:04X}:{plain(port.serial_number or '', 60)}"
        infos.append(PortInfo(port.device, plain(port.description or "", 120), identity))
    return sorted(infos, key=lambda info: info.address)


def identity_of(address: str) -> str:
    """Return the identity of a port, "" when it has none.

    Parameters
    ----------
    address
        As it was opened; a symbolic link is followed.
    """
    if address.startswith(BY_IDENTITY):
        return address.removeprefix(BY_IDENTITY)
    if "://" in address:
        return ""
    real = os.path.realpath(address) if address.startswith("/") else address
    try:
        known = ports()
    except LinkError:
        return ""
    return next((info.identity for info in known if info.address in (address, real)), "")


def find_port(identity: str) -> str | None:
    """Return the address under which an adapter is found now, or None.

    Parameters
    ----------
    identity
        ``VID:PID:serial``; two adapters that cannot be told apart are not found.
    """
    if not identity:
        return None
    try:
        found = [info.address for info in ports() if info.identity == identity]
    except LinkError:
        return None
    return found[0] if len(found) == 1 else None


def _resolved(address: str) -> str:
    """Return the address that opens a port given by its identity."""
    if not address.startswith(BY_IDENTITY):
        return address
    found = find_port(address.removeprefix(BY_IDENTITY))
    if found is None:
        raise LinkError(f"port {plain(address, 120)}: no such adapter is connected, or several are")
    return found


class ParityMarks:
    """Undoes the driver's marks: a byte with wrong parity becomes 0xFF, which no record holds.

    With PARMRK the driver writes ``FF 00 x`` for a byte x with wrong parity and ``FF FF`` for a
    byte FF (termios(3)).
    """

    def __init__(self) -> None:
        self._held = b""

    def strip(self, data: bytes) -> bytes:
        """Take bytes as the driver gives them and return what the device sent.

        Parameters
        ----------
        data
            Marked bytes, cut anywhere.

        Returns
        -------
        bytes
            Unmarked, as far as complete.
        """
        data = self._held + data
        out = bytearray()
        at = 0
        while at < len(data):
            if data[at] != 0xFF:
                out.append(data[at])
                at += 1
            elif data[at + 1 : at + 2] == b"\xff":
                out.append(0xFF)
                at += 2
            elif len(data) - at < 3:
                break
            else:
                out.append(0xFF)
                at += 3
        self._held = data[at:]
        return bytes(out)


class SerialPort:
    """An open port: bytes in, bytes out, and every failure a `LinkError`.

    Parameters
    ----------
    address
        ``COM3``, ``/dev/ttyUSB0``, a pseudo-terminal, ``socket://host:port``,
        ``rfc2217://host:port``, or ``usb:VID:PID:SERIAL`` for the adapter of that identity,
        whatever its name is today.
    settings
        Of the line.

    Raises
    ------
    LinkError
        When it cannot be opened; one line that names the port and the reason.

    Notes
    -----
    One thread reads; any thread may write, wake or close.
    """

    def __init__(self, address: str, settings: LineSettings) -> None:
        self._name = plain(address, 120)
        self._write_lock = threading.Lock()
        self._close_lock = threading.Lock()
        self._closed = False
        self._marks: ParityMarks | None = None
        self._parity = settings.parity
        self._serial: Any = None
        self._selector: selectors.BaseSelector | None = None
        self._wake: tuple[int, int] | None = None
        self._serial = self._open(_resolved(address), settings)
        try:
            self._report_parity_errors(settings)
            self._watch()
        except _THROWN as error:
            self.close()
            raise LinkError(f"port {self._name}: {_reason(error)}") from None

    def _open(self, address: str, settings: LineSettings) -> Any:
        remote = "://" in address
        # A pseudo-terminal has no line: its kernel refuses parity and seven bits.
        bare = remote is False and _is_pseudo_terminal(address)
        port: Any = None
        try:
            port = serial.serial_for_url(
                address,
                do_not_open=True,
                baudrate=settings.baud,
                bytesize=8 if bare else settings.bytesize,
                parity=serial.PARITY_NONE if bare else _PARITY[settings.parity],
                stopbits=1 if bare else settings.stopbits,
                rtscts=settings.flow == "rtscts" and not bare,
                xonxoff=settings.flow == "xonxoff",
                timeout=_SHORT,
                # rfc2217 knows no time limit for writing
                write_timeout=None if address.startswith("rfc2217:") else _WRITE_TIMEOUT,
            )
            if not remote:
                port.exclusive = True
            port.open()
        except _THROWN as error:
            if port is not None:
                _close_quietly(port)
            raise LinkError(f"port {self._name}: {_reason(error)}") from None
        return port

    def _report_parity_errors(self, settings: LineSettings) -> None:
        """Have the driver mark bytes with wrong parity; `ParityMarks` makes them 0xFF.

        pyserial switches the check of incoming parity off; a digit with a bit turned over would
        then be taken for another digit.
        """
        if sys.platform == "win32" or settings.parity in ("none", "mark", "space"):
            return
        if not isinstance(self._serial, serial.Serial) or self._is_pty():
            return
        attributes = termios.tcgetattr(self._serial.fileno())
        attributes[0] |= termios.INPCK | termios.PARMRK
        attributes[0] &= ~termios.IGNPAR
        termios.tcsetattr(self._serial.fileno(), termios.TCSANOW, attributes)
        self._marks = ParityMarks()

    @property
    def checks_parity(self) -> bool:
        """Whether a byte with wrong parity is noticed; true of a line without parity.

        A network adapter and a pseudo-terminal do not say, nor do some systems.
        """
        return self._parity == "none" or self._marks is not None

    def _is_pty(self) -> bool:
        return _is_pseudo_terminal(str(self._serial.port))

    def _watch(self) -> None:
        """Wait on the descriptor itself where there is one: no byte waits for a timeout."""
        if sys.platform == "win32" or not hasattr(self._serial, "fileno"):
            return
        try:
            descriptor = self._serial.fileno()
        except (OSError, AttributeError):
            # rfc2217 and loop have no descriptor of their own
            return
        self._wake = os.pipe()
        # poll() knows no terminals on some systems, select() no large descriptors
        poll = sys.platform == "linux"
        self._selector = selectors.PollSelector() if poll else selectors.SelectSelector()
        self._selector.register(descriptor, selectors.EVENT_READ)
        self._selector.register(self._wake[0], selectors.EVENT_READ)

    def read(self, timeout: float) -> bytes:
        """Return what has arrived, as soon as anything has.

        Parameters
        ----------
        timeout
            Longest wait [s]; ports without a descriptor wait 0.02 s at most.

        Returns
        -------
        bytes
            Empty when nothing came in time or the wait was woken.

        Raises
        ------
        LinkError
            When the port is lost.
        """
        if self._closed:
            raise LinkError(f"port {self._name}: closed")
        try:
            if self._selector is None:
                return self._read_plain()
            return self._read_watched(self._selector, timeout)
        except _THROWN as error:
            raise LinkError(f"port {self._name}: {_reason(error)}") from None

    def _read_plain(self) -> bytes:
        first: bytes = self._serial.read(1)
        if not first:
            return b""
        waiting = int(self._serial.in_waiting)
        rest: bytes = self._serial.read(min(waiting, _CHUNK)) if waiting else b""
        return first + rest

    def _read_watched(self, selector: selectors.BaseSelector, timeout: float) -> bytes:
        ready = {key.fd for key, _ in selector.select(max(0.0, timeout))}
        if self._wake is not None and self._wake[0] in ready:
            os.read(self._wake[0], 64)
            return b""
        if not ready:
            return b""
        try:
            data = os.read(self._serial.fileno(), _CHUNK)
        except BlockingIOError:
            return b""
        if not data:
            raise OSError("the other side has gone")
        return data if self._marks is None else self._marks.strip(data)

    def write(self, data: bytes) -> None:
        """Send bytes, all of them.

        Parameters
        ----------
        data
            What to send.

        Raises
        ------
        LinkError
            When the port is lost or takes nothing for a second.
        """
        with self._write_lock:
            try:
                written = self._serial.write(data)
            except _THROWN as error:
                raise LinkError(f"port {self._name}: {_reason(error)}") from None
            if written is not None and written != len(data):
                raise LinkError(f"port {self._name}: took {written} of {len(data)} bytes")

    def modem(self, line: str) -> bool:
        """Return the level of a modem line.

        Parameters
        ----------
        line
            cts, dsr, cd or ri.

        Raises
        ------
        LinkError
            When the port has no such line or is lost.
        """
        try:
            return bool(getattr(self._serial, line))
        except _THROWN as error:
            raise LinkError(f"port {self._name}: line {line}: {_reason(error)}") from None

    def wake(self) -> None:
        """End a wait in `read`."""
        with self._close_lock:
            if self._wake is not None and not self._closed:
                with contextlib.suppress(OSError):
                    os.write(self._wake[1], b"w")

    def close(self) -> None:
        """Give everything back; may be called more than once, never raises."""
        with self._close_lock:
            if self._closed:
                return
            self._closed = True
            if self._selector is not None:
                self._selector.close()
            if self._wake is not None:
                for descriptor in self._wake:
                    os.close(descriptor)
                self._wake = None
            if self._serial is not None:
                _close_quietly(self._serial)


def _close_quietly(port: Any) -> None:
    # Closing a socket whose peer is gone leaves its descriptor open: pyserial stops at the
    # shutdown that fails.
    inner = getattr(port, "_socket", None)
    with contextlib.suppress(*_THROWN):
        port.close()
    if inner is not None:
        with contextlib.suppress(OSError, AttributeError):
            inner.close()


def _is_pseudo_terminal(address: str) -> bool:
    real = os.path.realpath(address)
    return real.startswith("/dev/pts/") or (
        sys.platform == "darwin" and real.startswith("/dev/ttys")
    )


def _reason(error: Exception) -> str:
    """Return why, in one short line."""
    number = getattr(error, "errno", None)
    if isinstance(number, int):
        reason = os.strerror(number)
        if number == errno.EAGAIN:
            return "in use by another program"
        return reason[:1].lower() + reason[1:]
    text = plain(str(error), 200) or type(error).__name__
    marker = text.rfind("[Errno ")
    if marker >= 0 and (end := text.find("]", marker)) > 0:
        text = text[end + 1 :].strip()
    if "multiple access" in text:
        return "the other side has gone"
    return text
