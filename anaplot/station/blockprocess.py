"""The live block in a process of its own: beside it the screen waits for nobody.

Threads of one process share its interpreter: whoever has a record to show waited for every call of
the block's mathematics, some milliseconds each, a dozen times. The process is this interpreter once
more; both speak over its standard input and output, in pickles that nobody else can write.
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
from collections.abc import Callable
from dataclasses import replace
from itertools import takewhile
from typing import IO, NamedTuple

from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.station.blockview import BlockView
from anaplot.station.blockviews import ElsewhereError, LiveViews, OvertakenError, fault
from anaplot.textfiles.wording import reason

__all__ = ["BlockProcess", "serve"]

_LOOK = 0.05  # s between two looks at whether the answer is still wanted
_CHUNK = 500  # rows that are packed at a time: others get their turn between
_KINDER = 5  # by which its priority is lower
_LEAVES = 2.0  # s until it is ended that does not leave by itself
_BEGIN = (
    "import sys; sys.path[:] = sys.argv[1:]; from anaplot.station.blockprocess import serve; "
    "serve(sys.stdin.buffer, sys.stdout.buffer)"
)


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


class BlockProcess:
    """Adjusts the block in a process of its own, which begins with the first block.

    It ends with `close`, and with this process, however that ends.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._answers: queue.SimpleQueue[_Answer | None] = queue.SimpleQueue()
        self._reader: threading.Thread | None = None
        self._number = 0
        self._sent: Block | None = None
        self._rows: tuple[ImagePoint, ...] = ()

    def view(
        self, block: Block, empty: BlockView, most_weak: int, look_up: Callable[[], None]
    ) -> BlockView | None:
        """See `Views`.

        Raises
        ------
        ElsewhereError
            The program failed there, or the process has ended: the next block has a new one.
        """
        if self._process is None and not block.image_points:
            return None
        self._number += 1
        try:
            self._ask(block, empty, most_weak)
            return self._answer(look_up)
        except OvertakenError:
            with contextlib.suppress(OSError):  # whoever asks next will see that it has ended
                self._send(_GiveUp(self._number))
            raise
        except OSError as error:
            self.close()
            raise ElsewhereError(f"no process for it: {reason(error)}") from error

    def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        self._sent, self._rows = None, ()
        if process is None:
            return
        assert process.stdin is not None
        with contextlib.suppress(OSError):
            process.stdin.close()
        try:
            process.wait(_LEAVES)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if self._reader is not None:
            self._reader.join()  # what it reads has ended

    def _ask(self, block: Block, empty: BlockView, most_weak: int) -> None:
        if self._process is None:
            self._start()
        rows, before = tuple(block.image_points), self._rows
        bare = replace(block, image_points=())
        first = _alike(zip(rows, before, strict=False))
        room = min(len(rows), len(before)) - first
        backwards = zip(rows[::-1][:room], before[::-1][:room], strict=True)
        last = _alike(backwards)
        for at in range(first, len(rows) - last, _CHUNK):
            self._send(_Rows(rows[at : min(at + _CHUNK, len(rows) - last)]))
        known = self._sent is not None and bare == self._sent
        asked = _Asked(self._number, None if known else bare, first, last, empty, most_weak)
        self._send(asked)
        self._sent, self._rows = bare, rows

    def _answer(self, look_up: Callable[[], None]) -> BlockView | None:
        while True:
            look_up()
            with contextlib.suppress(queue.Empty):
                answer = self._answers.get(timeout=_LOOK)
                if answer is None:
                    self.close()
                    raise ElsewhereError("its process has ended")
                if answer.number == self._number:
                    if answer.fault:
                        raise ElsewhereError(answer.fault)
                    return answer.view

    def _start(self) -> None:
        self._answers = queue.SimpleQueue()
        self._process = subprocess.Popen(  # noqa: S603 - this interpreter, with a text of ours
            [sys.executable, "-c", _BEGIN, *sys.path],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        assert self._process.stdout is not None
        self._reader = threading.Thread(
            target=_read_answers,
            args=(self._process.stdout, self._answers),
            name="block answers",
            daemon=True,
        )
        self._reader.start()

    def _send(self, message: object) -> None:
        process = self._process
        assert process is not None
        assert process.stdin is not None
        pickle.dump(message, process.stdin)
        process.stdin.flush()


def _alike(pairs: zip[tuple[ImagePoint, ImagePoint]]) -> int:
    """Return how many pairs at the beginning are alike."""
    return sum(1 for _ in takewhile(lambda pair: pair[0] is pair[1] or pair[0] == pair[1], pairs))


def _read_answers(source: IO[bytes], answers: queue.SimpleQueue[_Answer | None]) -> None:
    """Take what the process says, until it has ended."""
    with source, contextlib.suppress(OSError, EOFError, pickle.UnpicklingError):
        while True:
            answers.put(pickle.load(source))  # noqa: S301 - from our own process
    answers.put(None)


def serve(source: IO[bytes], sink: IO[bytes]) -> None:
    """Adjust what is asked for, the newest alone, until nobody asks any more: the process itself.

    Parameters
    ----------
    source, sink
        Where messages come from, and where answers go.
    """
    # what ends it is the end of its input: Ctrl-C is meant for whoever asks
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(_KINDER)
    asked: queue.SimpleQueue[tuple[_Asked, Block]] = queue.SimpleQueue()
    newest = [0]
    threading.Thread(target=_read_questions, args=(source, asked, newest), daemon=True).start()
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
        try:
            pickle.dump(answer, sink)
            sink.flush()
        except OSError:
            return


def _read_questions(
    source: IO[bytes], asked: queue.SimpleQueue[tuple[_Asked, Block]], newest: list[int]
) -> None:
    """Take what is asked; at the end of it the whole process ends, whatever it is doing."""
    bare: Block | None = None
    rows: tuple[ImagePoint, ...] = ()
    between: list[ImagePoint] = []
    with contextlib.suppress(OSError, EOFError, pickle.UnpicklingError):
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
    os._exit(0)
