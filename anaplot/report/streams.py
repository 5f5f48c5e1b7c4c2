"""Standard output and error, also where they are closed or full; light, every command passes."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys

from anaplot.textfiles.wording import plain

__all__ = ["complain", "drop_output", "prepare_streams", "system_message"]


_OF_OUTPUT = (errno.ENOSPC, errno.EBADF, errno.EIO)
"""Of an error that names no file: what is long is written at once and is not waiting any more."""


def prepare_streams() -> None:
    """Make the standard streams safe to use.

    A closed one is opened on the null device, so that no file takes its place: standard error
    swallows what is written, standard output refuses it as a closed descriptor does. A name that
    the terminal's encoding cannot show is no reason to stop.
    """
    if sys.stdin is None:
        os.open(os.devnull, os.O_RDONLY)
    if sys.stdout is None:
        sys.stdout = _opened(os.O_RDONLY)
    if sys.stderr is None:
        sys.stderr = _opened(os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _opened(how: int) -> io.TextIOWrapper:
    # the lowest free descriptor, which is the closed one
    descriptor = os.open(os.devnull, how)
    return open(descriptor, "w", encoding="utf-8", closefd=False)


def complain(message: str) -> None:
    """Write one line to standard error; where that cannot be written nobody can be told."""
    with contextlib.suppress(OSError):
        print(f"anaplot: {plain(message)}", file=sys.stderr, flush=True)


def drop_output() -> bool:
    """Write what is waiting for standard output, or let it go; return whether it had to go.

    Otherwise the interpreter tries again at its end, and complains in its own words.
    """
    try:
        sys.stdout.flush()
    except OSError:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())
        os.close(null)
        return True
    return False


def system_message(error: OSError, output_failed: bool) -> str:
    """Return "FILE: reason" for an error of the operating system.

    Parameters
    ----------
    error
        The error.
    output_failed
        Whether standard output could not be written: an error without a file is about that.
    """
    reason = error.strerror or str(error) or type(error).__name__
    if isinstance(error.filename, str | bytes):
        return f"{os.fsdecode(error.filename)}: {reason}"
    ours = output_failed or error.errno in _OF_OUTPUT
    return f"standard output: {reason}" if ours else reason
