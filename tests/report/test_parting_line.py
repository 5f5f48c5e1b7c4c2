"""The line in the shell after the console."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest
from sessionscene import Scene

from anaplot.report.partingline import open_again, parting_line
from anaplot.session.events import ModelAccepted, ModelReopened, RowSwitched, Undone
from anaplot.session.state import SessionState, apply
from anaplot.session.workdone import WorkDone, work_done
from anaplot.station.blockstep import NextStep


@pytest.mark.smoke
def test_what_was_done_is_counted_once() -> None:
    scene = Scene(photos=3)
    before = scene.start
    state: SessionState = scene.whole(apply(before, scene.choice(before, 0)))
    count = len(state.current.plan)
    point = state.current.plan[0].point
    assert work_done(before, before) == (0, 0)
    assert work_done(before, state) == (0, count)
    # the same point again is the same point
    again = apply(state, scene.measurement(state, point))
    assert work_done(before, again) == (0, count)
    assert work_done(state, again) == (0, 1)
    assert work_done(before, apply(again, Undone())) == (0, count)
    # what went back to the pointing before was not measured
    assert work_done(again, apply(again, Undone())) == (0, 0)
    accepted = apply(state, ModelAccepted("101", "102"))
    twice = apply(again, ModelAccepted("101", "102"))
    assert work_done(twice, accepted) == (0, 0)
    assert work_done(accepted, twice) == (1, 1)
    assert work_done(before, accepted) == (1, count)
    assert work_done(state, accepted) == (1, 0)
    assert work_done(accepted, apply(accepted, scene.choice(accepted, 1))) == (0, 0)


@pytest.mark.smoke
def test_a_model_accepted_again_counts_when_it_has_changed() -> None:
    scene = Scene(photos=3)
    state = scene.whole(apply(scene.start, scene.choice(scene.start, 0)))
    first = apply(state, ModelAccepted("101", "102"))
    second = apply(first, scene.choice(first, 1))
    second = apply(second, scene.measurement(second, second.current.plan[0].point))
    back = apply(second, ModelReopened("101", "102", None, None))
    # the model that waits meanwhile keeps what was measured in it
    assert work_done(first, back) == (0, 1)
    point = back.current.plan[0].point
    changed = apply(back, RowSwitched(point, "y", on=False))
    assert work_done(first, apply(changed, ModelAccepted("101", "102"))) == (1, 1)


@pytest.mark.smoke
@pytest.mark.parametrize(
    ("done", "step", "line"),
    [
        (
            WorkDone(2, 26),
            NextStep("measure", "x", "103/104"),
            "2 models accepted, 26 points measured; next: measure model 103/104 - OPEN",
        ),
        (
            WorkDone(1, 1),
            NextStep("adjust", "anaplot adjust b"),
            "1 model accepted, 1 point measured; next: adjust the block - anaplot adjust b",
        ),
        (
            WorkDone(0, 0),
            NextStep("measure", "x", "1/2", point="7\x1b[0m"),
            "nothing measured; next: measure model 1/2, point 7\\x1b[0m - OPEN",
        ),
        (WorkDone(0, 3), None, "3 points measured; the block is deleted - OPEN"),
    ],
)
def test_the_line(done: WorkDone, step: NextStep | None, line: str) -> None:
    assert parting_line(done, step, "OPEN") == line


@pytest.mark.smoke
def test_the_command_has_the_options_that_were_given() -> None:
    options = argparse.Namespace(
        profile="anaplot-ascii", port="/dev/tty USB0", simulate=False, truth=None, seed=1,
        pattern=None, operator="", story="x",
    )  # fmt: skip
    assert open_again(Path("a b"), options) == (
        "anaplot open 'a b' --profile anaplot-ascii --port '/dev/tty USB0'"
    )
    # a demonstration that was kept
    demo = argparse.Namespace(simulate=True, seed=3)
    assert open_again(Path("d"), demo) == "anaplot open d --simulate --seed 3"
