"""What an undo took back is said: every kind of event, taken back, has its words."""

from __future__ import annotations

from dataclasses import replace

from deskscene import MONO, Bench
from innerscene import InnerScene
from sessionscene import Scene

from anaplot.photogrammetry.readings import Position
from anaplot.session.commands import Accept, AddPoint, NextModel, Switch, Undo
from anaplot.session.events import FiducialSwitched
from anaplot.session.state import apply
from anaplot.session.undone import undone


def after_undo(bench: Bench) -> str:
    bench.give(Undo())
    return bench.told[-1]


def test_points_rows_and_models(scene: Scene) -> None:
    bench = Bench.of(scene.block, truth=scene.made.truth)
    bench.give(NextModel())
    assert after_undo(bench) == "undone: model 101/102 is not in work any more"
    bench.whole_model()
    first = bench.desk.state.current.plan[0].point  # type: ignore[union-attr]
    bench.give(Switch(first, "y", False))
    assert after_undo(bench) == f"undone: {first} y on again"
    bench.give(Switch(first, None, False))
    bench.give(Switch(first, None, True))
    assert after_undo(bench) == f"undone: {first} y off again"
    assert after_undo(bench) == f"undone: {first} y on again"
    bench.measure(first)
    assert after_undo(bench) == f"undone: {first} is as measured before"
    bench.give(Accept())
    assert after_undo(bench) == "undone: model 101/102 is in work again"
    last = bench.desk.state.current.plan[-1].point  # type: ignore[union-attr]
    assert after_undo(bench) == f"undone: {last} is not measured any more"


def test_an_added_point(scene: Scene) -> None:
    bench = Bench.of(scene.block, truth=scene.made.truth)
    bench.give(NextModel())
    bench.seen = replace(bench.seen, position=Position(1.0, 2.0, -90.0, 2.0))
    bench.arrive()
    bench.give(AddPoint("extra"))
    assert after_undo(bench) == "undone: extra is not in the plan any more"


def test_fiducials() -> None:
    scene = InnerScene()
    before = scene.chosen()
    assert before.current is not None
    inner = before.current.inner[0]
    name = inner.fiducials[0]
    once = apply(before, scene.fiducial(before, name))
    assert undone(once, before) == f"fiducial {name} of {inner.name} is not measured any more"
    again = apply(once, scene.fiducial(once, name, dx=0.1))
    assert undone(again, once) == f"fiducial {name} of {inner.name} is as measured before"
    measured = scene.fiducials(before)
    off = apply(measured, FiducialSwitched(inner.photo, name, "x", False))
    assert undone(off, measured) == f"fiducial {name} x on again"
    accepted = scene.accepted(measured)
    words = f"the inner orientation of {inner.name} is in work again"
    assert undone(accepted, measured) == words


def test_a_mono_comparator(scene: Scene) -> None:
    bench = Bench.of(scene.block, MONO, truth=scene.made.truth)
    bench.give(NextModel())
    first = bench.desk.state.current.plan[0].point  # type: ignore[union-attr]
    bench.stands = Position(1.0, 2.0, 1.0, 2.0)
    bench.press()
    assert after_undo(bench) == f"undone: {first} is not measured any more in photo 101"
    assert after_undo(bench) == "undone: the photo in the comparator is not known any more"
