"""The block adjusted by a process of its own: the same views, and nothing left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from pickle import PicklingError

import numpy as np
import pytest
from processes import ROOT, running

from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.planning.synthetic import synthetic_strip
from anaplot.session.state import start
from anaplot.session.workflow import outlook
from anaplot.station.blockprocess import BlockProcess
from anaplot.station.blockview import BlockView
from anaplot.station.blockviews import ElsewhereError, LiveViews, OvertakenError
from anaplot.station.blockwatch import BlockWatch

pytestmark = pytest.mark.slow
WAIT = 60.0
EMPTY = BlockView("", 0, provisional=False)
HEAD = "import os, sys, time; sys.path[:] = sys.argv[1:]; "
SERVE = "from anaplot.station.blockprocess import serve; serve()"
BROKEN = b"X\x02\0\0\0\xff\xfe."  # a pickle of text that is none
no_windows = pytest.mark.skipif(sys.platform == "win32", reason="signals")


def strip() -> Block:
    made = synthetic_strip(4, seed=3)
    rng = np.random.default_rng(3)
    rows = [
        ImagePoint(photo, name, *(np.array(at) + rng.normal(0.0, 0.005, 2)).round(4).tolist())
        for photo, seen in made.truth.items()
        for name, at in seen.items()
    ]
    return replace(made.block, image_points=tuple(rows))


def never() -> None:
    """Nothing newer has come."""


def within(seconds: float = WAIT) -> Iterator[None]:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        yield
        time.sleep(0.01)
    raise AssertionError("it did not happen")


def patient() -> Callable[[], None]:
    """Return a look-up that waits long for an answer, and not for ever."""
    end = time.monotonic() + WAIT

    def look_up() -> None:
        assert time.monotonic() < end

    return look_up


@pytest.fixture
def begin(monkeypatch) -> Callable[[str], None]:
    """Have the process begin with another text."""
    return lambda text: monkeypatch.setattr("anaplot.station.blockprocess._BEGIN", HEAD + text)


@pytest.fixture
def process() -> Iterator[BlockProcess]:
    made = BlockProcess()
    yield made
    made.close()


def same(one: BlockView | None, other: BlockView | None) -> bool:
    """Whether two views are the same, their maps included."""
    if one is None or other is None or one.block_map is None or other.block_map is None:
        return one == other
    pairs = ((getattr(one.block_map, k), getattr(other.block_map, k)) for k in ("places", "r"))
    return one == other and all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def test_a_block_as_it_grows_and_changes_says_the_same_from_a_process(process):
    block, here = strip(), LiveViews()
    rows = block.image_points
    wrong = replace(rows[20], x=rows[20].x + 0.2)
    steps = [
        (),
        rows[:-9],
        rows,
        (*rows[:20], wrong, *rows[21:]),
        (*rows[:5], *rows[6:]),
        rows[3:],
        rows[:3],  # not computable
        (),
        rows,
    ]
    solved = 0
    for some in steps:
        now = replace(block, image_points=some)
        view = process.view(now, EMPTY, 3, never)
        assert same(view, here.view(now, EMPTY, 3, never))
        solved += view is not None and view.solved
    assert solved == 6
    renamed = replace(block, name="another", precision=replace(block.precision, image_um=9.0))
    assert same(process.view(renamed, EMPTY, 0, never), here.view(renamed, EMPTY, 0, never))


def test_nothing_is_begun_for_an_empty_block(process):
    assert process.view(replace(strip(), image_points=()), EMPTY, 0, never) is None
    assert process._process is None


def test_what_is_overtaken_is_given_up_and_the_next_answer_is_its_own(process):
    block = strip()
    assert process.view(block, EMPTY, 0, never).solved

    def overtaken() -> None:
        raise OvertakenError

    with pytest.raises(OvertakenError):
        process.view(replace(block, image_points=block.image_points[:-1]), EMPTY, 0, overtaken)
    fewer = replace(block, image_points=block.image_points[:-2])
    view, alone = process.view(fewer, EMPTY, 0, never), LiveViews().view(fewer, EMPTY, 0, never)
    assert (view.rays, view.points) == (alone.rays, alone.points)
    assert view.sigma0 == pytest.approx(alone.sigma0, rel=1e-9)


def test_a_process_that_ended_is_told_and_another_one_begins(process):
    block = strip()
    assert process.view(block, EMPTY, 0, never).solved
    first = process._process
    first.kill()
    first.wait()
    with pytest.raises(ElsewhereError, match="process"):
        process.view(replace(block, name="again"), EMPTY, 0, never)
    assert process.view(block, EMPTY, 0, never).solved
    assert process._process is not first


def test_a_process_that_cannot_begin_is_told(process, monkeypatch):
    monkeypatch.setattr("anaplot.station.blockprocess.sys.executable", "/nowhere/python")
    with pytest.raises(ElsewhereError, match=r"^no process for it: No such file"):
        process.view(strip(), EMPTY, 0, never)


def test_a_fault_of_the_program_there_is_told_in_its_words(process, begin):
    begin(
        "import anaplot.station.blockviews as v; v.LiveViews.view = lambda *_: {}['odd']; " + SERVE
    )
    with pytest.raises(ElsewhereError, match=r"^KeyError: 'odd'$"):
        process.view(strip(), EMPTY, 0, never)


def test_the_process_ends_with_whoever_asks(process):
    assert process.view(strip(), EMPTY, 0, never).solved
    child: subprocess.Popen[bytes] = process._process
    process.close()
    assert child.poll() == 0
    assert [one for one in threading.enumerate() if one.name.startswith("block ")] == []


def test_a_watch_has_its_block_adjusted_apart():
    block = strip()
    state, heard = start(block), threading.Event()
    watch = BlockWatch(heard.set, rest=0.0)
    watch.apart()
    try:
        watch.tell(block, state, outlook(state), set())
        for _ in within():
            view = watch.view
            if view is not None and not view.busy:
                break
        assert view.solved
        assert same(view, LiveViews().view(block, EMPTY, 3, never))
        child = watch._views._process
    finally:
        watch.close()
    assert child.poll() == 0


def test_processes_that_end_by_themselves_are_told_and_then_the_block_is_adjusted_here(
    process, begin
):
    begin("sys.exit('nothing\\x1b to run')")
    said = r"its process has ended \(exit 1: nothing\\x1b to run\)"
    with pytest.raises(ElsewhereError, match=rf"^{said}$"):
        process.view(strip(), EMPTY, 0, patient())
    with pytest.raises(ElsewhereError, match=rf"^{said}, 2 times: from now on .* in this one$"):
        process.view(strip(), EMPTY, 0, patient())
    assert process.view(strip(), EMPTY, 0, never).solved
    assert process._process is None


@no_windows
def test_processes_that_are_killed_are_told_and_no_more_of_them_are_begun(process, begin):
    begin("os.kill(os.getpid(), 9)")
    with pytest.raises(ElsewhereError, match=r"^its process has ended \(SIGKILL\)$"):
        process.view(strip(), EMPTY, 0, patient())
    for _ in range(2):
        with pytest.raises(ElsewhereError, match=r"\(SIGKILL\), 2 times: it is not tried again$"):
            process.view(strip(), EMPTY, 0, patient())
        assert process._process is None


def test_what_is_printed_there_is_no_answer(process, begin):
    begin(
        "os.write(1, b'x' * 5000 + b'\\nhello'); import anaplot.station.blockviews as v\n"
        "kept = v.LiveViews.view\n"
        "def view(*given):\n  os.write(1, b'here'); print('too', flush=True)\n"
        "  return kept(*given)\n"
        "v.LiveViews.view = view\n" + SERVE
    )
    assert process.view(strip(), EMPTY, 0, patient()).solved


def test_an_answer_that_cannot_be_read_is_told(process, begin):
    begin(f"os.write(1, b'anaplot: answers follow\\n' + {BROKEN!r}); sys.stdin.read()")
    with pytest.raises(ElsewhereError, match=r"^its answer cannot be read: UnicodeDecodeError"):
        process.view(strip(), EMPTY, 0, patient())


def test_a_question_that_cannot_be_read_ends_the_process(process):
    assert process.view(strip(), EMPTY, 0, patient()).solved
    process._process.stdin.write(BROKEN)
    process._process.stdin.flush()
    with pytest.raises(ElsewhereError, match=r"\(exit 1: UnicodeDecodeError: .*\)$"):
        process.view(strip(), EMPTY, 0, patient())


def test_a_question_told_by_half_is_forgotten(process):
    block = strip()
    with pytest.raises((AttributeError, PicklingError), match="local object"):  # which, by version
        process.view(block, lambda: 0, 0, patient())
    assert process._process is None
    assert process.view(block, EMPTY, 0, patient()).rays == len(block.image_points)


def test_the_process_leaves_at_once_while_it_computes(process, begin):
    begin(
        "import anaplot.station.blockviews as v; "
        "v.LiveViews.view = lambda *_: (os.write(2, b'computes\\n'), time.sleep(600)); " + SERVE
    )
    process._ask(strip(), EMPTY, 0)
    child = process._process
    for _ in within():
        if process._last_words:
            break
    process.close()
    assert child.returncode == 0


@no_windows
def test_a_watch_closes_beside_a_process_that_does_not_read(monkeypatch):
    monkeypatch.setattr("anaplot.station.blockprocess._LEAVES", 0.2)
    block = strip()
    state = start(block)
    watch = BlockWatch(lambda: None, rest=0.0)
    watch.apart()
    watch.tell(block, state, outlook(state), set())
    for _ in within():
        if watch.view is not None and not watch.view.busy:
            break
    child = watch._views._process
    os.kill(child.pid, signal.SIGSTOP)
    more = (
        ImagePoint(block.image_points[0].photo, f"more{k}", 0.001 * k, 0.0) for k in range(9000)
    )
    large = replace(block, image_points=(*block.image_points, *more))
    watch.tell(large, state, outlook(state), set())
    time.sleep(0.5)  # more than a pipe holds is on its way
    closing = threading.Thread(target=watch.close, daemon=True)
    closing.start()
    closing.join(WAIT / 4)
    hangs = closing.is_alive()
    child.kill()
    assert not hangs
    assert child.returncode == -signal.SIGKILL


@no_windows
def test_a_process_that_does_not_read_is_kept_the_newest_question_alone(process):
    block = strip()
    assert process.view(block, EMPTY, 0, patient()).solved
    child, photo = process._process, block.image_points[0].photo
    os.kill(child.pid, signal.SIGSTOP)

    def overtaken() -> None:
        raise OvertakenError

    kept = []
    for k in range(6):
        # the first is more than a pipe holds; the others wait
        more = (ImagePoint(photo, f"more{k}-{j}", 0.001 * j, 0.0) for j in range(4000))
        with pytest.raises(OvertakenError):
            process.view(
                replace(block, image_points=(*block.image_points, *more)), EMPTY, 0, overtaken
            )
        kept.append(sum(map(len, process._said._waiting[0])) if process._said._waiting else 0)
    assert max(kept) < 100
    fewer = replace(block, image_points=block.image_points[4:-3])
    answers: list[BlockView | None] = []
    asking = threading.Thread(
        target=lambda: answers.append(process.view(fewer, EMPTY, 0, patient())), daemon=True
    )
    asking.start()
    os.kill(child.pid, signal.SIGCONT)
    asking.join(WAIT)
    assert process._process is child
    alone = LiveViews().view(fewer, EMPTY, 0, never)
    assert (answers[0].rays, answers[0].points) == (alone.rays, alone.points)
    assert answers[0].sigma0 == pytest.approx(alone.sigma0, rel=1e-9)


@no_windows
def test_the_process_does_not_outlive_whoever_began_it():
    text = (
        "import sys, time; from tests.station.test_blockprocess import *; made = BlockProcess(); "
        "made.view(strip(), EMPTY, 0, never); print(made._process.pid, flush=True); time.sleep(600)"
    )
    env = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "tests")))}
    with running([sys.executable, "-c", text], env=env) as whoever:
        child = int(whoever.stdout.readline())
        whoever.kill()
        for _ in within():
            if gone(child):
                break


def gone(process: int) -> bool:
    """Whether a process has ended, also where nobody asks how."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    entry = Path(f"/proc/{process}/stat")
    return entry.exists() and entry.read_text().rpartition(")")[2].split()[0] == "Z"


def test_the_process_is_begun_with_the_flags_of_this_one():
    text = HEAD + "from anaplot.station.blockprocess import _flags; print(*_flags())"
    for given, flags in (("-IB", "-I -E -s -B"), ("-sB", "-s -B")):
        asked = [sys.executable, given, "-c", text, *sys.path]
        said = subprocess.run(asked, capture_output=True, check=True, text=True)
        assert said.stdout.split() == flags.split()
