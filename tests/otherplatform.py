"""anaplot as on a system without what POSIX has: run in a process of its own by its test.

    python tests/otherplatform.py FOLDER

What belongs to other packages (pyserial, Textual, asyncio) is loaded before, since on Windows they
bring files of their own. Then the modules and functions of POSIX are gone, `sys.platform` is win32,
and every text file that anaplot opens without an encoding is an error, since it would be another
one there. What is not simulated: paths, and that an open file cannot be replaced.
"""

from __future__ import annotations

import contextlib
import io
import os
import pkgutil
import signal
import socket
import sys
import warnings
from importlib import import_module
from importlib.abc import MetaPathFinder
from pathlib import Path
from types import ModuleType

import anaplot

BEFORE = (
    "asyncio",
    "concurrent.futures.process",
    "jinja2",
    "multiprocessing.resource_tracker",
    "numpy",
    "scipy.linalg",
    "scipy.optimize",
    "scipy.sparse.linalg",
    "scipy.special",
    "scipy.spatial",
    "serial.tools.list_ports",
    "serial.urlhandler.protocol_socket",
    "shutil",
    "subprocess",
    "tempfile",
    "textual.app",
    "textual.drivers.linux_driver",
    "textual.widgets",
)
POSIX = frozenset(
    {"termios", "fcntl", "pty", "tty", "resource", "pwd", "grp", "syslog", "crypt", "readline"}
)
OF_OS = (
    "O_CLOEXEC O_DIRECTORY O_NOFOLLOW O_NONBLOCK O_SYNC O_DSYNC WNOHANG chown fchmod fchown "
    "fdatasync fork forkpty fpathconf getegid geteuid getgid getgroups getloadavg getpgid getpgrp "
    "getpriority getuid killpg lchown lockf mkfifo mknod nice openpty pathconf posix_fadvise "
    "posix_spawn pread pwrite register_at_fork sched_getaffinity sched_yield sendfile setpgid "
    "setsid setuid statvfs sync sysconf tcgetpgrp ttyname uname wait4"
)
OF_SIGNAL = "SIGHUP SIGKILL SIGALRM SIGCHLD SIGUSR1 SIGWINCH SIGTSTP SIGCONT SIG_BLOCK " + (
    "SIG_SETMASK alarm pause pthread_kill pthread_sigmask setitimer siginterrupt sigwait"
)


class _Absent(MetaPathFinder):
    """Finds none of the modules of POSIX."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        if name in POSIX:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def _locks() -> ModuleType:
    """Return what Windows has in place of fcntl: locks of bytes, which the system takes away."""
    module = ModuleType("msvcrt")
    held: dict[tuple[int, int], int] = {}

    def locking(descriptor: int, mode: int, count: int) -> None:
        status = os.fstat(descriptor)
        key = (status.st_dev, status.st_ino)
        if mode == 0:
            held.pop(key, None)
        elif key in held:
            raise PermissionError(13, "Permission denied")
        else:
            held[key] = descriptor

    module.locking = locking  # type: ignore[attr-defined]
    module.LK_UNLCK, module.LK_LOCK, module.LK_NBLCK = 0, 1, 2  # type: ignore[attr-defined]
    return module


def become_another_platform() -> None:
    """Take away what POSIX has."""
    for name in BEFORE:
        import_module(name)
    for name in POSIX:
        sys.modules.pop(name, None)
    sys.meta_path.insert(0, _Absent())
    sys.modules["msvcrt"] = _locks()
    for owner, names in ((os, OF_OS), (signal, OF_SIGNAL)):
        for name in names.split():
            if hasattr(owner, name):
                delattr(owner, name)
    sys.platform = "win32"
    warnings.filterwarnings("error", category=EncodingWarning, module=r"anaplot")


def run(*arguments: str) -> str:
    """Run a command, which must succeed; returns what it prints."""
    from anaplot.cli import main

    told, wrong = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(told), contextlib.redirect_stderr(wrong):
        try:
            code = main(list(arguments))
        except SystemExit as end:
            code = end.code
    if code:
        raise SystemExit(f"{' '.join(arguments)}: {code}: {wrong.getvalue()}")
    return told.getvalue()


def main(folder: Path) -> None:
    """Do what an operator does."""
    become_another_platform()
    for command in ("", "adjust", "open", "report", "plan", "plotter"):
        if "usage: anaplot" not in run(*command.split(), "--help"):
            raise SystemExit(f"no help for {command}")
    block = str(folder / "block")
    run("plan", "block", "--control-m", "0.05", "--to", block)
    run("adjust", block, "--to", str(folder / "tables"))
    figures = str(folder / "figures")
    run("report", block, "-o", str(folder / "report.html"), "--rows", "10", "--figures", figures)
    run("status", block)
    run("pack", block, "-o", str(folder / "block.zip"))
    run("unpack", str(folder / "block.zip"), "-o", str(folder / "unpacked"))
    run("new", str(folder / "new"), "--strip", "101-103", "--camera", "rmk15")
    run("plotter", "list")
    # an instrument over a line, the lock, the journal, the files of a session
    demo = str(folder / "demo")
    run("demo", "--auto", "--models", "1", "--keep", demo)
    run("bridge", demo)
    run("log", demo)
    run("replay", demo, "--check")
    _open_on_a_line(folder / "new")
    for found in pkgutil.walk_packages(anaplot.__path__, "anaplot."):
        if not found.name.endswith("__main__"):
            import_module(found.name)
    print("as elsewhere")


def _open_on_a_line(folder: Path) -> None:
    """Open a block at an instrument on a port, as the console does, and have its lock."""
    from anaplot.errors import InputError
    from anaplot.simulation.opening import open_station

    with socket.create_server(("127.0.0.1", 0)) as server:
        port = f"socket://127.0.0.1:{server.getsockname()[1]}"
        with open_station(folder, profile="anaplot-ascii-crc", port=port):
            try:
                open_station(folder)
            except InputError:
                return
    raise SystemExit("two sessions had one block")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
