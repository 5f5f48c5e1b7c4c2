"""The live block in a process of its own: beside it the screen waits for nobody.

Threads of one process share its interpreter: whoever has a record to show waited for every call of
the block's mathematics, some milliseconds each, a dozen times. The process is this interpreter once
more; both speak over its standard input and output, in pickles that nobody else can write. What
else is printed there (by what an interpreter runs first) is passed over.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import IO, NamedTuple, NoReturn

from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.photogrammetry.imagepoint import unchanged_ends
from anaplot.station.blockview import BlockView
from anaplot.station.blockviews import ElsewhereError, LiveViews, OvertakenError, fault
from anaplot.textfiles.wording import plain, reason

__all__ = ["BlockProcess", "serve"]

_LOOK = 0.05  # s between two looks at whether the answer is still wanted
_CHUNK = 500  # rows that are packed at a time: others get their turn between
_KINDER = 5  # by which its priority is lower
_LEAVES = 2.0  # s until it is ended that does not leave by itself
_TRIES = 2  # processes one after the other that end without an answer
_LINE = 4096  # bytes of a line that is no answer
_MARK = b"anaplot: answers follow\n"  # a line of its own before the first of them
_BEGIN = (
    "import sys; sys.path[:] = sys.argv[1:]; from anaplot.station.blockprocess import serve; "
    "serve()"
)
_FLAGS = {
    "isolated": "-I",
    "ignore_environment": "-E",
    "no_user_site": "-s",
    "no_site": "-S",
    "dont_write_bytecode": "-B",
}


class _Rows(NamedTuple):
    """Rows that follow those sent before."""

    rows: tuple[ImagePoint, ...]


class _Asked(NamedTuple):
    """A block is to be adjusted.

    Its rows: the first and the last ones of the block before, and between them those sent since.
    """

    number: int
    block: Block | None  # without rows; None: as before
    first: int
    last: int
    empty: BlockView
    most_weak: int


class _GiveUp(NamedTuple):
    """Nobody waits for an answer any more."""

    number: int


class _Answer(NamedTuple):
    """The view, or why there is none for a fault of the program."""

    number: int
    view: BlockView | None
    fault: str = ""


class _End(NamedTuple):
    """Nothing can be read any more, for a fault or because the process has ended."""

    fault: str = ""


class _Known(NamedTuple):
    """What a process knows once it has read what was taken for it: the block, and its rows."""

    number: int = 0
    bare: Block | None = None
    rows: tuple[ImagePoint, ...] = ()


class _Questions:
    """What a process is still to be told: the newest question alone, however long it reads none."""

    def __init__(self) -> None:
        self._change = threading.Condition()
        self._waiting: tuple[tuple[bytes, ...], _Known] | None = None
        self._known = _Known()
        self._ended = False

    def withdraw(self) -> _Known:
        """Take back what waits, and return what will be known without it."""
        with self._change:
            self._waiting = None
            return self._known

    def put(self, messages: Iterable[object], known: _Known) -> None:
        """Have something told in place of what waits."""
        waiting = tuple(map(pickle.dumps, messages)), known
        with self._change:
            self._waiting = waiting
            self._change.notify()

    def give_up(self) -> None:
        """Have it told that nobody waits for an answer any more."""
        known = self.withdraw()
        self.put((_GiveUp(known.number),), known)

    def end(self) -> None:
        """Have nothing more told."""
        with self._change:
            self._ended = True
            self._change.notify()

    def next(self) -> tuple[bytes, ...] | None:
        """Wait for what is to be told, and take it; None: nothing more."""
        with self._change:
            self._change.wait_for(lambda: self._ended or self._waiting is not None)
            if self._waiting is None or self._ended:
                return None
            (messages, self._known), self._waiting = self._waiting, None
            return messages


class BlockProcess:
    """Adjusts the block in a process of its own, which begins with the first block.

    It ends with `close`, and with this process, however that ends. Where processes end without an
    answer no more of them are begun: what they could not do by themselves is done here. Where they
    were ended (by the system, for want of memory), nobody does it: it would end this process, too.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._answers: queue.SimpleQueue[_Answer | _End] = queue.SimpleQueue()
        self._said = _Questions()
        self._last_words: list[bytes] = []
        self._threads: tuple[threading.Thread, ...] = ()
        self._in_vain = 0
        self._given_up = ""
        self._here: LiveViews | None = None
        self._number = 0

    def view(
        self, block: Block, empty: BlockView, most_weak: int, look_up: Callable[[], None]
    ) -> BlockView | None:
        """See `Views`.

        Raises
        ------
        ElsewhereError
            The program failed there, or the process has ended: the next block has a new one.
        """
        if self._here is not None:
            return self._here.view(block, empty, most_weak, look_up)
        if self._given_up:
            raise ElsewhereError(self._given_up)
        if self._process is None and not block.image_points:
            return None
        self._number += 1
        try:
            self._ask(block, empty, most_weak)
        except OSError as error:
            self.close()
            raise self._failed(f"no process for it: {reason(error)}") from error
        except Exception:
            self.close()  # it has been told half of it
            raise
        try:
            return self._answer(look_up)
        except OvertakenError:
            self._said.give_up()  # if it has ended, whoever asks next will see that
            raise

    def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is None:
            return
        self._said.end()
        try:
            process.wait(_LEAVES)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        for thread in self._threads:
            thread.join(_LEAVES)  # what it reads and writes has ended

    def _ask(self, block: Block, empty: BlockView, most_weak: int) -> None:
        if self._process is None:
            self._start()
        known = self._said.withdraw()
        rows, before = tuple(block.image_points), known.rows
        bare = replace(block, image_points=())
        first, last = unchanged_ends(before, rows)
        asked: list[_Rows | _Asked] = [
            _Rows(rows[at : min(at + _CHUNK, len(rows) - last)])
            for at in range(first, len(rows) - last, _CHUNK)
        ]
        new = None if bare == known.bare else bare
        asked.append(_Asked(self._number, new, first, last, empty, most_weak))
        self._said.put(asked, _Known(self._number, bare, rows))

    def _answer(self, look_up: Callable[[], None]) -> BlockView | None:
        while True:
            look_up()
            with contextlib.suppress(queue.Empty):
                answer = self._answers.get(timeout=_LOOK)
                if isinstance(answer, _End):
                    raise self._ended(answer.fault)
                self._in_vain = 0
                if answer.number == self._number:
                    if answer.fault:
                        raise ElsewhereError(answer.fault)
                    return answer.view

    def _ended(self, unread: str) -> ElsewhereError:
        """Return what is said of a process that has ended, or whose answer cannot be read."""
        process = self._process
        assert process is not None
        self.close()
        code = process.returncode
        killed = not 0 <= code < 256
        if unread and not killed:
            return self._failed(f"its answer cannot be read: {plain(unread, 200)}")
        words = [_how(code), *(plain(line.strip(), 200) for line in self._last_words)]
        return self._failed(f"its process has ended ({': '.join(words)})", killed=killed)

    def _failed(self, why: str, *, killed: bool = False) -> ElsewhereError:
        """Take notice of a process in vain, and return what is said of it."""
        self._in_vain += 1
        if self._in_vain < _TRIES:
            return ElsewhereError(why)
        if killed:
            self._given_up = f"{why}, {_TRIES} times: it is not tried again"
            return ElsewhereError(self._given_up)
        self._here = LiveViews()
        return ElsewhereError(f"{why}, {_TRIES} times: from now on it is adjusted in this one")

    def _start(self) -> None:
        self._process = process = subprocess.Popen(  # noqa: S603 - this interpreter, a text of ours
            [sys.executable, *_flags(), "-c", _BEGIN, *sys.path],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        self._answers, self._said, self._last_words = queue.SimpleQueue(), _Questions(), []
        self._threads = (
            _thread("block questions", _write, process.stdin, self._said),
            _thread("block answers", _read_answers, process.stdout, self._answers),
            _thread("block errors", _read_errors, process.stderr, self._last_words),
        )


def _flags() -> list[str]:
    """Return the flags of this interpreter that say what another one runs first."""
    return [flag for name, flag in _FLAGS.items() if getattr(sys.flags, name)]


def _how(code: int) -> str:
    """Return in words how a process has ended."""
    if code >= 0:
        return f"exit {code}"
    with contextlib.suppress(ValueError):
        return signal.Signals(-code).name
    return f"signal {-code}"


def _thread(name: str, target: Callable[..., None], *given: object) -> threading.Thread:
    """Begin a thread."""
    thread = threading.Thread(target=target, args=given, name=name, daemon=True)
    thread.start()
    return thread


def _write(sink: IO[bytes], said: _Questions) -> None:
    """Tell the process what is said: one that does not read keeps nobody waiting."""
    with contextlib.suppress(OSError), sink:
        while (messages := said.next()) is not None:
            for message in messages:
                sink.write(message)
            sink.flush()


def _read_answers(source: IO[bytes], answers: queue.SimpleQueue[_Answer | _End]) -> None:
    """Take what the process says, until it has ended."""
    end = _End()
    try:
        with source:
            while (line := source.readline(_LINE)) != _MARK:
                if not line:
                    return
            while True:
                answers.put(pickle.load(source))  # noqa: S301 - from our own process
    except (OSError, EOFError):
        pass  # it has ended
    except Exception as error:  # noqa: BLE001 - what is read may be anything
        end = _End(fault(error))
    finally:
        answers.put(end)


def _read_errors(source: IO[bytes], last: list[bytes]) -> None:
    """Keep, as the only one, the last line of what the process says of itself."""
    with contextlib.suppress(OSError), source:
        while line := source.readline(_LINE):
            if line.strip():
                last[:] = [line]


def serve() -> NoReturn:
    """Adjust what is asked for, the newest alone, until nobody asks any more: the whole process."""
    # whoever prints something from now on does not print among the answers
    sink = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    try:
        _serve(sys.stdin.buffer, sink)
    except OSError:
        pass  # nobody listens any more
    except Exception:  # noqa: BLE001 - told by the process that began this one
        traceback.print_exc()
    finally:
        os._exit(1)  # also where the thread that reads still waits


def _serve(source: IO[bytes], sink: IO[bytes]) -> None:
    # what ends it is the end of its input: Ctrl-C is meant for whoever asks
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(_KINDER)
    sink.write(b"\n" + _MARK)
    sink.flush()
    asked: queue.SimpleQueue[tuple[_Asked, Block]] = queue.SimpleQueue()
    newest = [0]
    _thread("questions", _read_questions, source, asked, newest)
    views = LiveViews()
    while True:
        question, block = asked.get()

        def look_up(number: int = question.number) -> None:
            if newest[0] != number:
                raise OvertakenError

        try:
            look_up()
            view = views.view(block, question.empty, question.most_weak, look_up)
            answer = _Answer(question.number, view)
        except OvertakenError:
            continue
        except Exception as error:  # noqa: BLE001 - told to whoever asked
            answer = _Answer(question.number, None, fault(error))
        pickle.dump(answer, sink)
        sink.flush()


def _read_questions(
    source: IO[bytes], asked: queue.SimpleQueue[tuple[_Asked, Block]], newest: list[int]
) -> None:
    """Take what is asked; at the end of it the whole process ends, whatever it is doing."""
    code = 1
    try:
        _take_questions(source, asked, newest)
    except (OSError, EOFError):
        code = 0
    except Exception:  # noqa: BLE001 - told by the process that began this one
        traceback.print_exc()
    finally:
        os._exit(code)


def _take_questions(
    source: IO[bytes], asked: queue.SimpleQueue[tuple[_Asked, Block]], newest: list[int]
) -> NoReturn:
    bare: Block | None = None
    rows: tuple[ImagePoint, ...] = ()
    between: list[ImagePoint] = []
    while True:
        message = pickle.load(source)  # noqa: S301 - from the process that began this one
        match message:
            case _Rows(more):
                between += more
            case _Asked():
                end = len(rows) - message.last
                rows = (*rows[: message.first], *between, *rows[end:])
                between = []
                bare = message.block or bare
                assert bare is not None
                newest[0] = message.number
                asked.put((message, replace(bare, image_points=rows)))
            case _GiveUp(number):
                if newest[0] == number:
                    newest[0] = 0
