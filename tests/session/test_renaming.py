"""A measured point gets another name, or two exchange theirs: in both photos, or in one."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from deskscene import DRIVEN, MONO, Bench, changes
from journaltools import append_event
from sessionscene import Scene
from test_changes import told
from test_mono_fold import SCENE
from test_mono_fold import chosen as mono_chosen
from test_mono_fold import laid as mono_laid
from test_mono_fold import seen as mono_seen
from test_mono_fold import whole as mono_whole

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block, write_image_points, write_new_block
from anaplot.exchange.journal import Journal
from anaplot.session.accidents import Accident
from anaplot.session.changes import Happened
from anaplot.session.commands import (
    Accept,
    Drive,
    NextModel,
    PointAgain,
    Rename,
    ReturnTo,
    Switch,
    Undo,
)
from anaplot.session.desk import Desk
from anaplot.session.events import (
    Event,
    ModelAccepted,
    PhotoLaid,
    PointMeasured,
    PointRenamed,
    ReasonGiven,
    RowSwitched,
    Undone,
)
from anaplot.session.models import solve
from anaplot.session.modelstate import ModelState
from anaplot.session.othernames import OtherName
from anaplot.session.pointings import Run, pointings_of
from anaplot.session.reasons import reason_of
from anaplot.session.repeating import repetition
from anaplot.session.state import EventRefusedError, SessionState, apply, fold
from anaplot.session.undone import undone
from anaplot.session.workflow import outlook
from anaplot.station.edited import check_unedited
from anaplot.station.imagepoints import rows_of
from anaplot.station.replay import replay_session

HERE = ("101", "102")


def current(state: SessionState) -> ModelState:
    assert state.current is not None
    return state.current


def names(model: ModelState) -> list[str]:
    return [p.point for p in model.plan]


def exchanged_rays(scene: Scene, first: str, second: str, side: str) -> SessionState:
    """The first model, measured with the rays of two points exchanged in a photo."""
    state = scene.chosen()
    swap = {first: second, second: first}
    for planned in current(state).plan:
        event = scene.measurement(state, planned.point)
        other = scene.measurement(state, swap.get(planned.point, planned.point))
        wrong = {"xr": other.xr, "yr": other.yr}
        if side == "left":
            wrong = {"xl": other.xl, "yl": other.yl}
        state = apply(state, replace(event, **wrong))
    return state


def test_a_new_name_takes_the_place_of_the_old_one(scene: Scene) -> None:
    state = scene.whole(scene.chosen())
    before = current(state)
    point = names(before)[4]
    off = replace(before, off=frozenset({(point, "y")}))
    after = current(apply(replace(state, current=off), PointRenamed(*HERE, point, "7")))
    assert names(after) == [*names(before)[:4], "7", *names(before)[5:]]
    was, now = before.measurement(point), after.measurement("7")
    assert was is not None
    assert now == replace(was, point="7")
    assert (after.measurement(point), after.off) == (None, frozenset({("7", "y")}))


def test_two_names_are_exchanged_in_both_photos_or_in_one(scene: Scene) -> None:
    state = scene.whole(scene.chosen())
    before = current(state)
    one, other = before.measured[2], before.measured[8]
    both = apply(state, PointRenamed(*HERE, one.point, other.point))
    after = current(both)
    assert after.plan == before.plan
    assert after.measurement(one.point) == replace(other, point=one.point)
    assert after.measurement(other.point) == replace(one, point=other.point)
    left = apply(state, PointRenamed(*HERE, one.point, other.point, "left"))
    assert current(left).measurement(one.point) == replace(one, xl=other.xl, yl=other.yl)
    assert current(left).measurement(other.point) == replace(other, xl=one.xl, yl=one.yl)
    # the one and then the other is both, and twice is nothing
    right = apply(left, PointRenamed(*HERE, other.point, one.point, "right"))
    assert current(right) == after
    assert current(apply(both, PointRenamed(*HERE, one.point, other.point))) == before


def test_a_tie_that_was_another_point_is_still_to_be_measured(scene: Scene) -> None:
    state = scene.whole(scene.chosen(1))
    tie = next(p.point for p in current(state).plan if p.role == "tie")
    after = apply(state, PointRenamed("102", "103", tie, "7"))
    assert [p.point for p in current(after).pending] == [tie]
    assert current(after).axes("7") == ("y",)
    # and what was taken for a new point becomes a tie by its name
    new = next(p.point for p in current(state).plan if p.role == "new")
    again = apply(after, PointRenamed("102", "103", new, tie))
    assert current(again).axes(tie) == ("y", "x")
    assert [p.point for p in current(again).pending] == [new]


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (PointRenamed("102", "103", "-", "7"), "101/102 is in the instrument"),
        (PointRenamed(*HERE, "-", "7"), "point - is not measured in model 101/102"),
        (PointRenamed(*HERE, "{0}", "{0}"), "point {0} has that name"),
        (PointRenamed(*HERE, "{0}", "7", "left"), "point 7 is not measured in model 101/102: in"),
        (PointRenamed(*HERE, "{0}", "7", None, "tie"), "7 is named as tie, but is not a point of"),
    ],
)
def test_what_cannot_be_renamed(scene: Scene, event: PointRenamed, words: str) -> None:
    state = scene.whole(scene.chosen())
    first = names(current(state))[0]
    event = replace(event, point=event.point.format(first), name=event.name.format(first))
    with pytest.raises(EventRefusedError) as refused:
        apply(state, event)
    assert words.format(first) in str(refused.value)


def test_photo_by_photo_a_sighting_goes_where_the_plan_has_the_name(scene: Scene) -> None:
    state = mono_whole(mono_chosen(scene.start))
    one, other = current(state).measured[2], current(state).measured[8]
    right = apply(state, PointRenamed(*HERE, one.point, other.point, "right"))
    assert current(right).measurement(one.point) == replace(one, xr=other.xr, yr=other.yr)
    new = apply(state, PointRenamed(*HERE, one.point, "7"))
    assert current(new).measurement("7") == replace(one, point="7")
    assert current(new).place_of("left", one.point) is None
    with pytest.raises(EventRefusedError, match="exchanged with another of the model"):
        apply(state, PointRenamed(*HERE, one.point, "7", "right"))


@pytest.mark.parametrize("side", ["left", "right"])
def test_what_is_proposed_mends_the_model(scene: Scene, side: str) -> None:
    first, second = names(current(scene.chosen()))[3], names(current(scene.chosen()))[9]
    state = exchanged_rays(scene, first, second, side)
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.desk = bench.desk.folded(*_events(scene, state))
    assert bench.desk.other_names[:2] == (
        OtherName(first, second, side),  # type: ignore[arg-type]
        OtherName(second, first, side),  # type: ignore[arg-type]
    )
    assert "exchange them" in bench.desk.expected
    bench.give(Rename(*bench.desk.other_names[0]))
    photo = HERE[side == "right"]
    assert f"{first} and {second} exchanged in photo {photo}" in bench.told
    assert bench.desk.state.current == current(scene.whole(scene.chosen()))
    assert bench.desk.other_names == ()
    assert outlook(bench.desk.state).solution == solve(bench.desk.state, bench.desk.state.current)
    bench.give(Undo())
    assert bench.desk.state.current == current(state)
    assert bench.told[-1] == f"undone: {second} is {first} again, {first} is {second} again"


def _events(scene: Scene, state: SessionState) -> Iterator[Event]:
    """The events that lead from the start to a measured first model."""
    yield scene.choice(scene.start, 0)
    for m in current(state).measured:
        yield PointMeasured(*HERE, m.point, m.xl, m.yl, m.xr, m.yr, "key")


@pytest.mark.parametrize(
    ("first", "kinds", "words"),
    [
        ("", ["remeasure", "rename", "switch off", "accept"], "another point?"),
        (
            "101/102",
            ["remeasure", "switch off", "accept"],
            "another point? (named so first in 101/102: return to it)",
        ),
    ],
)
def test_a_name_is_proposed_where_the_point_got_its_own(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, first: str, kinds: list[str], words: str
) -> None:
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.whole_model()
    point, other = names(current(bench.desk.state))[2:4]
    wrong = Accident(point, "another point?", True, "2", other, first)
    monkeypatch.setattr(Desk, "accidents", property(lambda _: (wrong,)))
    agenda = bench.desk.agenda
    assert [step.kind for step in agenda.steps] == kinds
    assert agenda.remark == words
    assert bench.desk.other_names == (() if first else (OtherName(point, other),))


def test_a_name_known_from_elsewhere_is_checked_and_told(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.whole_model()
    bench.give(Accept())
    bench.whole_model()
    model = current(bench.desk.state)
    tie, new = (next(p.point for p in model.plan if p.role == r) for r in ("tie", "new"))
    there = current_of(bench, "101", "102")
    other = next(m.point for m in there.measured if m.point not in names(model))
    bench.give(Rename(new, other))
    (words,) = [one for one in bench.told if "another point?" in one]
    assert words.startswith(f"{other} is ")
    assert words.endswith("mm from where model 101/102 has it: another point?")
    bench.give(Undo())
    bench.give(Rename(tie, "7"))
    bench.give(Rename("7", tie))
    assert bench.told[-1].startswith(f"{tie} is where model 101/102 has it, within ")


def current_of(bench: Bench, left: str, right: str) -> ModelState:
    found = bench.desk.state.accepted(left, right)
    assert found is not None
    return found


def test_names_that_are_none_and_fiducials_to_come(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    with pytest.raises(InputError, match="no model is in the instrument"):
        bench.give(Rename("1", "2"))
    bench.whole_model()
    point = names(current(bench.desk.state))[0]
    for name in ("", " ", "a\nb", "p" * 101):
        with pytest.raises(InputError, match="printable name"):
            bench.give(Rename(point, name))
    for name in (" 9 ", "9 ", " 9"):
        with pytest.raises(InputError, match="begins and ends without a blank"):
            bench.give(Rename(point, name))


def test_what_is_off_stays_off_under_its_new_name_for_the_same_reason(scene: Scene) -> None:
    state = scene.whole(scene.chosen(1))
    tie, other = (next(p.point for p in current(state).plan if p.role == r) for r in ("tie", "new"))
    third = [p.point for p in current(state).plan if p.role == "new"][1]
    rows: list[Event] = [
        RowSwitched(tie, "x", False),
        ReasonGiven("pointing"),
        RowSwitched(other, None, False),
        ReasonGiven("identification"),
    ]
    before = fold(state, rows)
    photos = current(before).photos
    new = apply(before, PointRenamed(*photos, other, "7"))
    assert current(new).off == {(tie, "x"), ("7", "y")}
    assert reason_of(new.reasons, current(new), "7") == "identification"
    exchanged = apply(before, PointRenamed(*photos, tie, other))
    # nothing of the one counts, whatever rows it has; x is no row of the other
    assert current(exchanged).off == {(tie, "x"), (tie, "y")}
    assert reason_of(exchanged.reasons, current(exchanged), tie) == "identification"
    beside = apply(before, PointRenamed(*photos, tie, third))
    assert current(beside).off == {(other, "y")}
    for renamed in (new, exchanged, beside):
        assert apply(renamed, Undone()) == before
    # the rays are others: both points are believed again, and the operator is told
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.whole_model()
    first, second = names(current(bench.desk.state))[2:4]
    bench.give(Switch(second, "y", False))
    bench.give(Rename(first, second, "right"))
    assert current(bench.desk.state).off == frozenset()
    assert f"on again: {second} y" in bench.told


def test_other_models_that_have_the_former_name_are_named(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    for _ in range(2):
        bench.whole_model()
        bench.give(Accept())
    ties = [p.point for p in current_of(bench, "102", "103").plan if p.role == "tie"]
    alone = next(m.point for m in current_of(bench, "101", "102").measured if m.point not in ties)
    bench.give(ReturnTo("101", "102"))
    told = []
    for point in (alone, *ties):
        bench.give(Rename(point, f"{point}x"))
        told += [one for one in bench.told if "still has" in one and one not in told]
    count = len(ties)
    assert told == [
        f"model 102/103 still has {tie}x as {tie}"
        + (
            f": {count - k} of {count - k + 1} points tie it"
            if k < count
            else ": nothing ties it, and it cannot be computed before it has these names, too"
        )
        for k, tie in enumerate(ties, 1)
    ]
    bench.give(Undo())
    # what two are exchanged ties no less, but wrongly
    first, second = ties[-1], f"{ties[0]}x"
    bench.give(Rename(first, second))
    assert f"model 102/103 still has {second} as {first}" in bench.told


def test_the_mark_is_at_the_point_by_its_name_of_now(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.give(NextModel())
    first, second = names(current(bench.desk.state))[:2]
    bench.measure(first)
    assert bench.desk.target == second
    bench.give(Rename(first, second))
    assert (bench.desk.last_measured, bench.desk.target) == (second, first)
    bench.measure_all()
    assert not current(bench.desk.state).pending


def test_an_undone_name_is_that_of_what_was_measured_last(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.give(NextModel())
    bench.measure_all()
    last, first = bench.desk.last_measured, names(current(bench.desk.state))[0]
    for name in ("7", first):
        bench.give(Rename(last, name))
        assert bench.desk.last_measured == name
        bench.give(Undo())
        assert (bench.desk.last_measured, bench.desk.target) == (last, None)
        bench.give(PointAgain(None, 1))
        assert bench.desk.repeating.name == last
        bench.arrive()
    # the mark stands at a point that has its former name again
    bench.give(Rename(last, first))
    bench.give(Drive(first))
    bench.give(Undo())
    assert bench.desk.target is None


def test_a_check_point_that_is_renamed_is_still_the_only_one_to_go(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.whole_model()
    bench.give(Accept())
    bench.give(ReturnTo("101", "102"))
    first, second = bench.desk.checks
    bench.arrive()
    bench.press()
    assert bench.desk.checks == (second,)
    bench.give(Rename(second, "7"))
    assert bench.desk.checks == ("7",)
    bench.give(Rename("7", first))
    assert bench.desk.checks == (first,)
    bench.give(Undo())
    assert bench.desk.checks == ("7",)


def test_in_a_model_returned_to_the_check_points_follow(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.whole_model()
    bench.give(Accept())
    bench.give(ReturnTo("101", "102"))
    first, second = bench.desk.checks
    bench.give(Rename(first, "7"))
    assert first not in bench.desk.checks
    assert all(bench.desk.mode.has(name) for name in bench.desk.checks)
    bench.give(Undo())
    assert all(bench.desk.mode.has(name) for name in bench.desk.checks)
    for name in bench.desk.checks:
        bench.give(Rename(name, f"{name}-x"))
    bench.give(Switch(f"{second}-x", None, False))
    for name in bench.desk.checks:
        bench.give(Drive(name))
        bench.arrive()
        bench.press()
    bench.give(Accept())
    assert current_of(bench, "101", "102").measurement(f"{first}-x") is not None


@pytest.mark.slow
def test_the_log_says_what_is_called_what(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.whole_model()
    one, other = current(bench.desk.state).measured[2:4]
    bench.give(Rename(one.point, other.point, "right"))
    bench.give(Rename(one.point, "7"))
    bench.give(Undo())
    *_, first, second, new_left, new_right, back_left, back_right = told(bench)
    assert (first.what, first.photo, first.point, first.name) == (
        "renamed",
        "102",
        one.point,
        other.point,
    )
    # a measurement stays where it is
    assert (first.old, first.new) == ((one.xr, one.yr), (one.xr, one.yr))
    assert (second.point, second.name) == (other.point, one.point)
    assert (second.old, second.new) == ((other.xr, other.yr), (other.xr, other.yr))
    assert (new_left.photo, new_right.photo, new_left.name) == ("101", "102", "7")
    assert (new_left.old, new_left.new) == ((one.xl, one.yl), (one.xl, one.yl))
    assert {back_left.what, back_right.what} == {"undone"}
    assert (back_left.point, back_left.name) == (one.point, "7")
    assert (back_left.old, back_left.new) == ((one.xl, one.yl), (one.xl, one.yl))


def test_the_log_says_how_a_measurement_fits_by_either_name(scene: Scene) -> None:
    bench = Bench.of(scene.block, DRIVEN, truth=scene.made.truth)
    bench.whole_model()
    state = bench.desk.state
    one, other = (m.point for m in current(state).measured[2:4])
    table = solve(state, current(state)).table
    w, w_other = (max(row.size for row in table if row.point == p) for p in (one, other))
    bench.give(Rename(one, "7"))
    bench.give(Undo())
    bench.give(Rename(one, other))
    *found, first, _, partner, _ = told(bench)
    new, _, back, _ = found[-4:]
    for change, size in ((new, w), (back, w), (first, w), (partner, w_other)):
        assert change.w_before == pytest.approx(size)
        assert change.w_after == pytest.approx(size)


def test_the_log_tells_a_name_of_a_photo_where_there_is_a_measurement() -> None:
    state = mono_laid(mono_chosen(SCENE.start), "left")
    one, other = names(current(state))[:2]
    events = [
        mono_seen(state, one, "left"),
        mono_seen(state, other, "left"),
        PhotoLaid("102"),
        mono_seen(state, other, "right"),
        PointRenamed(*HERE, one, other),
        Undone(),
    ]
    found = changes(
        SCENE.block,
        [
            Happened("2026-01-01T10:00:00Z", "me", event)
            for event in (replace(SCENE.choice(SCENE.start, 0), mono=True), PhotoLaid("101"))
        ]
        + [Happened("2026-01-01T10:00:00Z", "me", event) for event in events],
    )
    # the point itself was seen in the left photo alone
    told_of = [(c.what, c.photo, c.point, c.name) for c in found[-6:]]
    once = [("101", one, other), ("101", other, one), ("102", other, one)]
    assert told_of == [(what, *c) for what in ("renamed", "undone") for c in once]
    assert all(c.old == c.new is not None for c in found[-6:])


def pointed_again(state: SessionState, start: SessionState, events: Sequence[Event]) -> list[Run]:
    """The runs of events that lead from one state to another."""
    happened = [Happened("2026-01-01T10:00:00Z", "me", event) for event in events]
    found = pointings_of(start, happened)
    assert found.state == state
    return list(found.runs)


def test_what_was_pointed_at_before_a_name_was_corrected_goes_on_after_it(scene: Scene) -> None:
    start = scene.chosen(1)
    model = current(start)
    tie = next(p.point for p in model.plan if p.role == "tie")
    new = next(p.point for p in model.plan if p.role == "new")
    measured = {name: scene.measurement(start, name) for name in (tie, new)}

    def again(state: SessionState, name: str, of: str, dy: float) -> Event:
        event = replace(measured[of], point=name, yr=measured[of].yr + dy)
        return repetition(current(state), event, moved=True)

    state, events = start, list[Event]()

    def happen(event: Event) -> None:
        nonlocal state
        state = apply(state, event)
        events.append(event)

    for event in measured.values():
        happen(event)
    happen(again(state, tie, tie, 0.001))
    happen(again(state, new, new, 0.002))
    happen(PointRenamed("102", "103", tie, "7"))
    happen(again(state, "7", tie, 0.003))
    at = {name: ((m.xl, m.yl), (m.xr, m.yr)) for name, m in measured.items()}
    seven, other = pointed_again(state, start, events)
    assert (seven.name, seven.role) == ("7", "new")
    assert [place[1][1] - at[tie][1][1] for place in seven.places] == pytest.approx(
        [0.0, 0.001, 0.003]
    )
    assert (other.name, other.role, len(other.places)) == (new, "new", 2)
    # exchanged, each goes on under the other's name
    happen(PointRenamed("102", "103", new, "7"))
    happen(again(state, "7", new, 0.004))
    first, second = pointed_again(state, start, events)
    assert [(run.name, len(run.places)) for run in (first, second)] == [(new, 3), ("7", 3)]
    # taken back, as before
    happen(Undone())
    happen(Undone())
    assert pointed_again(state, start, events) == [seven, other]
    # what was pointed at in both photos keeps its name when the rays in one are exchanged
    happen(PointRenamed("102", "103", new, "7", "left"))
    assert pointed_again(state, start, events) == [seven, other]


def test_photo_by_photo_what_was_pointed_at_has_the_name_of_its_photo() -> None:
    state = mono_laid(mono_chosen(SCENE.start), "left")
    start = state
    one, other = names(current(state))[:2]
    events: list[Event] = []

    def happen(event: Event) -> None:
        nonlocal state
        state = apply(state, event)
        events.append(event)

    for name in (one, other):
        happen(mono_seen(state, name, "left"))
        happen(repetition(current(state), mono_seen(state, name, "left", 0.001), moved=True))
    assert [run.name for run in pointed_again(state, start, events)] == [one, other]
    happen(PointRenamed(*HERE, one, other, "left"))
    assert [run.name for run in pointed_again(state, start, events)] == [other, one]
    happen(repetition(current(state), mono_seen(state, one, "left", 0.002), moved=True))
    assert [len(run.places) for run in pointed_again(state, start, events)] == [2, 3]


def test_files_journal_replay_and_log_agree(
    scene: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "b"
    write_new_block(folder, scene.block)
    state = scene.whole(scene.chosen())
    one, other = current(state).measured[2:4]
    events = [
        *_events(scene, state),
        ModelAccepted(*HERE),
        Undone(),
        PointRenamed(*HERE, one.point, other.point),
        PointRenamed(*HERE, other.point, "7"),
        ModelAccepted(*HERE),
    ]
    state = scene.start
    earlier = []
    with Journal.open(folder, {})[0] as journal:
        for event in events:
            append_event(journal, event)
            state = apply(state, event)
            earlier.append(rows_of(state.models))
    for rows in (earlier[-1], earlier[-5]):  # as it is now, and as it was before the names
        write_image_points(folder, rows)
        check_unedited(folder, read_block(folder), state, {"101/102"})
    written = {(row.photo, row.point): (row.x, row.y) for row in rows_of(state.models)}
    assert written["102", "7"] == (one.xr, one.yr)
    assert written["101", one.point] == (other.xl, other.yl)
    assert ("101", other.point) not in written
    assert replay_session(folder).state == state
    capsys.readouterr()
    assert main(["log", str(folder), "--json"]) == 0
    renamed = [
        one for one in json.loads(capsys.readouterr().out)["changes"] if one["what"] == "renamed"
    ]
    assert [(one["point"], one["name"]) for one in renamed[-2:]] == [(other.point, "7")] * 2
    assert main(["log", str(folder)]) == 0
    assert "IS NOW" in capsys.readouterr().out


def test_what_an_undo_of_a_name_says(scene: Scene) -> None:
    state = scene.whole(scene.chosen())
    point = names(current(state))[0]
    assert undone(apply(state, PointRenamed(*HERE, point, "7")), state) == f"7 is {point} again"


@pytest.mark.slow
def test_photo_by_photo_the_desk_renames_as_well(scene: Scene) -> None:
    bench = Bench.of(scene.block, MONO, truth=scene.made.truth)
    bench.whole_model()
    before = current(bench.desk.state)
    one, other = before.measured[2:4]
    bench.give(Rename(one.point, other.point, "left"))
    assert f"{one.point} and {other.point} exchanged in photo 101" in bench.told
    assert current(bench.desk.state).measurement(one.point) == replace(
        one, xl=other.xl, yl=other.yl
    )
