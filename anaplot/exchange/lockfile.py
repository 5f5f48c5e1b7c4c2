"""One anaplot at a time: a lock that the system gives back when its holder dies."""

from __future__ import annotations

import contextlib
import os
import platform
import re
import sys
from collections.abc import Iterator
from pathlib import Path

from anaplot.errors import InputError
from anaplot.textfiles.ownfile import is_same, open_own
from anaplot.textfiles.wholefile import write_all
from anaplot.textfiles.wording import place, plain, reason

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

__all__ = ["FolderLock", "lock_open", "sessions_kept_out"]

_FAR = 1 << 30  # Windows locks bytes, also against reading: one that the file does not have
_TRIES = 5


if sys.platform == "win32":

    def lock_open(descriptor: int) -> None:
        """Lock a file until it is closed; raises BlockingIOError where somebody else has it."""
        os.lseek(descriptor, _FAR, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError as error:
            raise BlockingIOError(*error.args) from error
        finally:
            os.lseek(descriptor, 0, os.SEEK_SET)

else:

    def lock_open(descriptor: int) -> None:
        """Lock a file until it is closed; raises BlockingIOError where somebody else has it."""
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


class FolderLock:
    """A held lock.

    The file stays where it is when the lock is released: removing it would let two processes
    lock two files of the same name. Where somebody else removes it, `check` notices.

    Parameters
    ----------
    path
        The lock file, made when it does not exist; the holder's process number and the name of
        its host are written into it.

    Raises
    ------
    InputError
        Somebody else holds it, this process included, it is no file of its own, or it cannot be
        made.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._descriptor: int | None = self._taken()

    def check(self) -> bool:
        """Make sure that the lock is still held, after its file was removed or replaced too.

        Returns
        -------
        bool
            Whether it is the lock that was taken before; False when it had to be taken anew.

        Raises
        ------
        InputError
            Somebody else has taken it meanwhile, or it cannot be made again.
        """
        held = self._descriptor
        if held is not None and is_same(self._path, held):
            return True
        self._descriptor = self._taken()
        if held is not None:
            os.close(held)
        return False

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

    def _taken(self) -> int:
        """Return the descriptor of the locked file."""
        for _ in range(_TRIES):
            try:
                descriptor = open_own(self._path, os.O_RDWR | os.O_CREAT)
            except (OSError, ValueError) as error:
                raise InputError(
                    f"{place(self._path)}: cannot be written: {reason(error)}"
                ) from error
            try:
                self._take(descriptor)
                if is_same(self._path, descriptor):
                    os.ftruncate(descriptor, 0)
                    write_all(descriptor, f"{os.getpid()} {_host()}\n".encode())
                    return descriptor
            except BlockingIOError:
                holder = self._holder(descriptor)
                os.close(descriptor)
                raise InputError(
                    f"{place(self._path.parent.parent)}: the block is open in another anaplot "
                    f"({holder})"
                ) from None
            except OSError as error:
                os.close(descriptor)
                raise InputError(
                    f"{place(self._path)}: cannot be locked: {reason(error)}"
                ) from error
            # Removed between the opening and the locking: a lock that others do not see.
            os.close(descriptor)
        raise InputError(f"{place(self._path)}: cannot be locked: it is removed again and again")

    @staticmethod
    def _holder(descriptor: int) -> str:
        """Return who holds the lock, as its file says."""
        try:
            os.lseek(descriptor, 0, os.SEEK_SET)
            match = re.match(rb"([0-9]{1,10})(?: (\S{1,255}))?", os.read(descriptor, 300))
        except OSError:
            match = None
        if match is None:
            return "process not known"
        process = match[1].decode("ascii")
        host = "" if match[2] is None else f" on {plain(match[2].decode('utf-8', 'replace'), 120)}"
        return f"process {process}{host}"

    _take = staticmethod(lock_open)

    if sys.platform == "win32":

        @staticmethod
        def _give_back(descriptor: int) -> None:
            os.lseek(descriptor, _FAR, os.SEEK_SET)
            msvcrt.locking(descriptor, msvcrt.LK_UNLCK, 1)

    else:

        @staticmethod
        def _give_back(descriptor: int) -> None:
            # Explicitly: a child that inherited the descriptor must not keep the block locked.
            fcntl.flock(descriptor, fcntl.LOCK_UN)


def _host() -> str:
    """Return this computer's name in the network, without blanks."""
    return "".join(platform.node().split()) or "unknown"


@contextlib.contextmanager
def sessions_kept_out(folder: Path) -> Iterator[None]:
    """Keep sessions out of a block folder that has had any, while its files are written."""
    sessions = folder / "sessions"
    lock = FolderLock(sessions / "lock") if sessions.is_dir() else None
    try:
        yield
    finally:
        if lock is not None:
            lock.release()
