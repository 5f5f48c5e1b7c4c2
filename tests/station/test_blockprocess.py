"""The block adjusted by a process of its own: the same views, and nothing left behind."""

from __future__ import annotations

import subprocess
import threading
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

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


def test_a_fault_of_the_program_there_is_told_in_its_words(process, monkeypatch):
    monkeypatch.setattr(
        "anaplot.station.blockprocess._BEGIN",
        "import sys; sys.path[:] = sys.argv[1:]; import anaplot.station.blockviews as v; "
        "v.LiveViews.view = lambda *_: {}['odd']; from anaplot.station.blockprocess import serve; "
        "serve(sys.stdin.buffer, sys.stdout.buffer)",
    )
    with pytest.raises(ElsewhereError, match=r"^KeyError: 'odd'$"):
        process.view(strip(), EMPTY, 0, never)


def test_the_process_ends_with_whoever_asks(process):
    assert process.view(strip(), EMPTY, 0, never).solved
    child: subprocess.Popen[bytes] = process._process
    process.close()
    assert child.poll() == 0
    assert [one for one in threading.enumerate() if one.name == "block answers"] == []


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
