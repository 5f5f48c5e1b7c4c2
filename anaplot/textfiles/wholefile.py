"""Files written whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import stat
import sys
from collections.abc import Iterable, Iterator
from contextvars import ContextVar
from pathlib import Path

from anaplot.errors import InputError
from anaplot.textfiles.wording import place, reason

__all__ = [
    "all_or_nothing",
    "check_place",
    "clear_left_over",
    "create_folder",
    "create_whole",
    "make_folder",
    "replace_whole",
    "sync_folder",
    "write_all",
    "write_together",
]

_RANDOM_BYTES = 6

_MADE: ContextVar[list[Path] | None] = ContextVar("made", default=None)


@contextlib.contextmanager
def all_or_nothing() -> Iterator[None]:
    """Take away again what `create_whole` and `make_folder` made within, should the rest fail.

    The last first, so that a folder is empty by then; one in which something else was put stays.
    """
    around, made = _MADE.get(), list[Path]()
    token = _MADE.set(made)
    try:
        yield
    except BaseException:
        for path in reversed(made):
            with contextlib.suppress(OSError):
                if path.is_dir():
                    path.rmdir()
                else:
                    path.unlink()
        raise
    else:
        if around is not None:
            around += made
    finally:
        _MADE.reset(token)


def _was_made(path: Path) -> None:
    made = _MADE.get()
    if made is not None:
        made.append(path)


def replace_whole(path: Path, data: bytes) -> None:
    """Write a file so that at every instant, also after a crash, the old or the new one is there.

    Parameters
    ----------
    path
        The file; one that exists is replaced.
    data
        Its whole new content.

    Raises
    ------
    InputError
        It could not be written; the old file is as it was, unless it is the folder's entry that
        could not be brought to disk, and nothing else is left behind.
    """
    _write_aside(path, data, may_replace=True)


def create_whole(path: Path, data: bytes | Iterable[bytes]) -> None:
    """Write a new file, whole or not at all, and never over another.

    Parameters
    ----------
    path
        The file.
    data
        Its content, also in pieces.

    Raises
    ------
    InputError
        It exists already or could not be written.
    """
    _write_aside(path, data, may_replace=False)
    _was_made(path)


def write_together(files: Iterable[tuple[Path, bytes]]) -> None:
    """Write files that are there or are not: nothing of what is there goes before all are on disk.

    Parameters
    ----------
    files
        Each file and its content, made one after another. They have their names in this order; one
        that was not there is never written over another that came meanwhile.

    Raises
    ------
    InputError
        One could not be written: then those that were there are as they were, but for the case
        that a name could not be given, and nothing else is left behind.
    """
    aside: list[tuple[Path, Path, bool]] = []
    try:
        for path, data in files:
            there = os.path.lexists(path)
            with _told(path):
                aside.append((_aside(path), path, there))
                _write_synced(aside[-1][0], data, like=path if there else None)
        for written, path, there in aside:
            with _told(path):
                if there:
                    written.replace(path)
                else:
                    _rename_to_new(written, path)
                    _was_made(path)
        for folder in dict.fromkeys(path.parent for _, path, _ in aside):
            with _told(folder):
                sync_folder(folder)
    finally:
        for written, _, _ in aside:
            with contextlib.suppress(OSError):
                written.unlink(missing_ok=True)


def create_folder(
    folder: Path, files: Iterable[tuple[str, bytes | Iterable[bytes]]]
) -> tuple[Path, ...]:
    """Write new files in a folder, which is made where it does not exist: all of them, or nothing.

    Parameters
    ----------
    folder
        The folder.
    files
        Name and content of each; made one after another.

    Raises
    ------
    InputError
        One exists already or could not be written; then nothing is there that was not before.
    """
    written = []
    with all_or_nothing():
        make_folder(folder)
        for name, data in files:
            create_whole(folder / name, data)
            written.append(folder / name)
    return tuple(written)


def check_place(path: Path) -> None:
    """Refuse a file for which there is no place, before what it is to hold is computed.

    Raises
    ------
    InputError
        There is no folder around it, or a folder of its name.
    """
    if not path.parent.is_dir():
        raise InputError(f"{place(path)}: cannot be written: there is no such folder")
    if path.is_dir():
        raise InputError(f"{place(path)}: cannot be written: it is a folder")


def clear_left_over(path: Path) -> None:
    """Remove what a writer of this file left beside it when it was killed.

    To be called only by the one who alone may write the file: under the block's lock. What cannot
    be removed stays.
    """
    name = re.compile(rf"\.{re.escape(path.name)}\.[0-9a-f]{{{2 * _RANDOM_BYTES}}}\.tmp")
    with contextlib.suppress(OSError):
        for entry in list(os.scandir(path.parent)):
            if name.fullmatch(entry.name) and entry.is_file(follow_symlinks=False):
                with contextlib.suppress(OSError):
                    Path(entry).unlink()


def make_folder(folder: Path) -> None:
    """Make a folder, and those around it that do not exist, each with its name on disk.

    Raises
    ------
    InputError
        It cannot be made, or there is a file of that name.
    """
    try:
        missing = []
        at = folder
        while not at.is_dir():
            missing.append(at)
            if at.parent == at:
                break
            at = at.parent
        for path in reversed(missing):
            try:
                path.mkdir()
            except FileExistsError:
                if not path.is_dir():
                    raise
            else:
                _was_made(path)
            sync_folder(path.parent)
    except (OSError, ValueError) as error:
        raise InputError(f"{place(folder)}: cannot be made: {reason(error)}") from error


def write_all(descriptor: int, data: bytes) -> None:
    """Write all of data; raises OSError."""
    view = memoryview(data)
    while view:
        view = view[os.write(descriptor, view) :]


def sync_folder(folder: Path) -> None:
    """Bring a folder's entries to disk; raises OSError. Does nothing where there is no way."""
    if sys.platform != "win32":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        except OSError as error:
            # Some network file systems cannot; their entries are as safe as they make them.
            if error.errno not in (errno.EINVAL, errno.ENOTSUP):
                raise
        finally:
            os.close(descriptor)


@contextlib.contextmanager
def _told(path: Path) -> Iterator[None]:
    """Say of which file an error of the system is."""
    try:
        yield
    except FileExistsError:
        raise InputError(f"{place(path)}: exists already and is not overwritten") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{place(path)}: cannot be written: {reason(error)}") from error


def _aside(path: Path) -> Path:
    return path.with_name(f".{path.name}.{os.urandom(_RANDOM_BYTES).hex()}.tmp")


def _write_aside(path: Path, data: bytes | Iterable[bytes], *, may_replace: bool) -> None:
    own = None
    with _told(path):
        aside = _aside(path)
        try:
            _write_synced(aside, data, like=path if may_replace else None)
            own = aside.lstat()
            if may_replace:
                aside.replace(path)
            else:
                _rename_to_new(aside, path)
            sync_folder(path.parent)
        except BaseException:
            with contextlib.suppress(OSError):
                aside.unlink()
            if own is not None and not may_replace:
                # it may have its name already; one that another wrote is not touched
                with contextlib.suppress(OSError):
                    if os.path.samestat(own, path.lstat()):
                        path.unlink()
            raise


def _write_synced(path: Path, data: bytes | Iterable[bytes], like: Path | None) -> None:
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | int(getattr(os, "O_BINARY", 0))
    descriptor = os.open(path, flags, 0o666)
    try:
        if like is not None and sys.platform != "win32":
            with contextlib.suppress(OSError):
                os.fchmod(descriptor, stat.S_IMODE(like.stat().st_mode))
        for piece in (data,) if isinstance(data, bytes) else data:
            write_all(descriptor, piece)
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _rename_to_new(aside: Path, path: Path) -> None:
    """Give a file its name unless the name is taken; raises FileExistsError."""
    try:
        path.hardlink_to(aside)
    except FileExistsError:
        raise
    except OSError:
        # No hard links on this file system: the name is looked at first.
        if os.path.lexists(path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from None
        aside.rename(path)
    else:
        aside.unlink()
