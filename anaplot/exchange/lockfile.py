"""One anaplot at a time: a lock that the system gives back when its holder dies."""

from __future__ import annotations

import contextlib
import os
import re
import sys
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.wholefile import write_all
from anaplot.exchange.wording import place, reason

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

__all__ = ["FolderLock"]

_FAR = 1 << 30  # Windows locks bytes, also against reading: one that the file does not have


class FolderLock:
    """A held lock.

    The file stays where it is when the lock is released: removing it would let two processes
    lock two files of the same name.

    Parameters
    ----------
    path
        The lock file, made when it does not exist; the holder's process number is written into it.

    Raises
    ------
    InputError
        Somebody else holds it, this process included, or it cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._descriptor: int | None = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            raise InputError(f"{place(path)}: cannot be written: {reason(error)}") from error
        try:
            self._take(self._descriptor)
            os.ftruncate(self._descriptor, 0)
            write_all(self._descriptor, f"{os.getpid()}\n".encode())
        except BlockingIOError:
            holder = self._holder(self._descriptor)
            os.close(self._descriptor)
            raise InputError(
                f"{place(path.parent.parent)}: the block is open in another anaplot "
                f"(process {holder})"
            ) from None
        except OSError as error:
            os.close(self._descriptor)
            raise InputError(f"{place(path)}: cannot be locked: {reason(error)}") from error

    def release(self) -> None:
        """Give the lock back; a second call does nothing."""
        if self._descriptor is None:
            return
        descriptor, self._descriptor = self._descriptor, None
        try:
            with contextlib.suppress(OSError):
                os.ftruncate(descriptor, 0)
            with contextlib.suppress(OSError):
                self._give_back(descriptor)
        finally:
            os.close(descriptor)

    @staticmethod
    def _holder(descriptor: int) -> str:
        try:
            os.lseek(descriptor, 0, os.SEEK_SET)
            match = re.match(rb"[0-9]{1,10}", os.read(descriptor, 16))
        except OSError:
            match = None
        return match.group().decode("ascii") if match else "not known"

    if sys.platform == "win32":

        @staticmethod
        def _take(descriptor: int) -> None:
            os.lseek(descriptor, _FAR, os.SEEK_SET)
            try:
                msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
            except OSError as error:
                raise BlockingIOError(*error.args) from error
            finally:
                os.lseek(descriptor, 0, os.SEEK_SET)

        @staticmethod
        def _give_back(descriptor: int) -> None:
            os.lseek(descriptor, _FAR, os.SEEK_SET)
            msvcrt.locking(descriptor, msvcrt.LK_UNLCK, 1)

    else:

        @staticmethod
        def _take(descriptor: int) -> None:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)

        @staticmethod
        def _give_back(descriptor: int) -> None:
            # Explicitly: a child that inherited the descriptor must not keep the block locked.
            fcntl.flock(descriptor, fcntl.LOCK_UN)
