"""What `adjust --errors NAME --apply` switched in a session's rows is the session's from then."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from journaltools import append_event
from sessionscene import Scene

from anaplot.cli import main
from anaplot.errors import InputError
from anaplot.exchange.blockfolder import read_block, write_image_points, write_new_block
from anaplot.exchange.journal import Journal
from anaplot.exchange.rejectedrows import STRATEGIES, as_before, rejected_axes, said_by
from anaplot.orientation.strip import bridge_strip
from anaplot.photogrammetry.block import Block, ImagePoint
from anaplot.report.applyerrors import applied, taken_back
from anaplot.session.changes import ChangeLog, Happened
from anaplot.session.commands import Undo
from anaplot.session.events import (
    DecidedRow,
    DecisionsTakenOver,
    Event,
    ModelAccepted,
    ModelReopened,
    ReasonGiven,
    RowSwitched,
    Suspended,
    Undone,
)
from anaplot.session.models import solve
from anaplot.session.state import EventRefusedError, SessionState, apply, fold
from anaplot.session.undone import undone
from anaplot.station import pointsfile
from anaplot.station.edited import check_unedited
from anaplot.station.imagepoints import merged_rows, rows_of
from anaplot.station.journaled import journaled
from anaplot.station.pointsfile import BlockRead
from anaplot.station.rejectedelsewhere import agreeing, decisions, told_decisions
from anaplot.station.replay import replay_session
from anaplot.station.station import Station
from anaplot.station.takenup import TakenUp


def measured(photos: int = 4, seed: int = 5) -> tuple[Scene, list[Event], SessionState]:
    """Return a strip, all its models accepted, a row of each switched off with a reason."""
    scene = Scene(photos, seed)
    state, events = scene.start, list[Event]()

    def happen(event: Event) -> None:
        nonlocal state
        state = apply(state, event)
        events.append(event)

    for k, (left, right) in enumerate(scene.block.strips[0].models()):
        happen(scene.choice(state, k))
        for event in scene.measurements(state):
            happen(event)
        happen(RowSwitched(state.current.plan[-1].point, "y", on=False))
        happen(ReasonGiven("pointing"))
        happen(ModelAccepted(left, right))
    return scene, events, state


def rejected_of(rows: tuple[ImagePoint, ...], number: int, seed: int) -> list[tuple]:
    """Return names of image coordinates, as `adjust` has them."""
    rng = np.random.default_rng(seed)
    chosen = rng.choice(len(rows), number, replace=False)
    return [
        ("image", rows[k].photo, rows[k].point, rows[k].model, axis)
        for k in chosen.tolist()
        for axis in (("x",), ("y",), ("x", "y"))[rng.integers(3)]
    ]


def assert_alike(block: Block, rows: tuple[ImagePoint, ...], state: SessionState) -> None:
    """The bridge of the file is the session's, to the last digit."""
    block = replace(block, image_points=rows)
    bridged = bridge_strip(block, block.strips[0])
    assert bridged.error is None
    for model, one in zip(state.models, bridged.models, strict=True):
        own = solve(state, model)
        assert own.table == one.table
        assert own.off_rows == one.off_rows
        assert (own.points, own.ties, own.base) == (one.points, one.ties, one.base)
        assert own.sigma0_um == one.sigma0_um


@pytest.mark.slow
def test_the_session_says_what_the_files_say_and_takes_it_back_again() -> None:
    scene, _, state = measured()
    rows = rows_of(state.models, state.reasons)
    names = {model.name for model in state.models}
    taken_any = 0
    for seed in range(12):
        file = applied(rows, rejected_of(rows, 6, seed), "tau")
        # a second strategy over the first
        file = applied(file, rejected_of(rows, 3, seed + 100), "huber")
        block = replace(scene.block, image_points=file)
        taken = decisions(block, state)
        taken_any += len(taken)
        after = fold(state, taken)
        assert_alike(scene.block, file, after)
        assert decisions(block, after) == ()
        # the file stays as adjust wrote it, and so does what adjust makes of it
        assert merged_rows(file, after.models, names, after.reasons) == file
        # without the file the session says the same of every model
        again = rows_of(after.models, after.reasons)
        assert_alike(scene.block, again, after)
        assert rows_of(state.models, state.reasons) == taken_back(again, STRATEGIES)
        # and taken back it is as before
        back = replace(scene.block, image_points=taken_back(file, STRATEGIES))
        assert back.image_points == rows
        on = fold(after, decisions(back, after))
        assert [m.off for m in on.models] == [m.off for m in state.models]
        assert [m.plan for m in on.models] == [m.plan for m in state.models]
        assert_alike(scene.block, rows, on)
    assert taken_any >= 10


def test_what_the_operator_decides_afterwards_stands() -> None:
    scene, _, state = measured(3)
    rows = rows_of(state.models, state.reasons)
    point = state.models[0].plan[0].point
    file = applied(rows, [("image", "102", point, "101/102", axis) for axis in "xy"], "tau")
    block = replace(scene.block, image_points=file)
    (taken,) = decisions(block, state)
    assert taken.rows[0] == DecidedRow("101", "102", point, "y", False, "tau")
    assert told_decisions([taken]).startswith("taken over from adjust --apply (tau): 1 row of 1 ")
    state = apply(state, taken)
    assert agreeing(file, state.models)
    # on again in the console
    for event in (
        ModelReopened("101", "102"),
        RowSwitched(point, None, on=True),
        ModelAccepted("101", "102"),
    ):
        state = apply(state, event)
    written = merged_rows(file, state.models, {"101/102", "102/103"}, state.reasons)
    assert {(r.use, r.reason) for r in written if (r.point, r.model) == (point, "101/102")} == {
        ("xy", None)
    }
    assert decisions(replace(block, image_points=written), state) == ()


def test_undo_takes_it_back_and_says_so() -> None:
    scene, _, state = measured(3)
    rows = rows_of(state.models, state.reasons)
    point = state.models[0].plan[0].point
    file = applied(rows, [("image", "102", point, "101/102", "y")], "search")
    (taken,) = decisions(replace(scene.block, image_points=file), state)
    after = apply(state, taken)
    again = apply(after, Undone())
    assert again.models == state.models
    assert undone(after, again) == f"101/102: {point} y on again"
    assert [one.photos for one in after.recomputed] == [("102", "103")]
    # work that is interrupted does not stand in the way, nor a model in work
    assert apply(apply(state, Suspended()), taken).models == after.models
    back = apply(apply(state, ModelReopened("101", "102")), taken)
    assert back.current is not None
    assert (point, "y") in back.current.off
    assert apply(back, ModelAccepted("101", "102")).models[0].off == after.models[0].off


def test_more_than_a_few_rows_taken_back_are_counted() -> None:
    _, _, state = measured(3)
    few, many = (
        replace(
            state,
            models=tuple(
                replace(m, off=m.off | {(p.point, "y") for p in m.plan[:n]}) for m in state.models
            ),
        )
        for n in (2, 5)
    )
    names = [p.point for p in state.models[0].plan[:2]]
    assert f"101/102: {', '.join(f'{n} y' for n in sorted(names))} on again; 10" in undone(
        few, state
    )
    assert undone(many, state) == "101/102: 5 rows on again; 102/103: 5 rows on again"
    assert undone(state, many) == "101/102: 5 rows off again; 102/103: 5 rows off again"
    first = state.models[0]
    block = [replace(first, right=f"{k}") for k in range(300)]
    off = [replace(m, off=frozenset((p.point, "y") for p in m.plan[:3])) for m in block]
    on = [replace(m, off=frozenset()) for m in block]
    before, after = replace(state, models=tuple(off)), replace(state, models=tuple(on))
    assert undone(before, after) == "900 rows of 300 models on again"
    mixed = replace(before, models=(on[0], *off[1:])), replace(before, models=(off[0], *on[1:]))
    assert undone(*mixed) == "900 rows of 300 models on or off again"


def test_what_does_not_fit_is_refused() -> None:
    scene, _, state = measured(3)
    row = DecidedRow("101", "102", "nobody", "y", False, "tau")
    with pytest.raises(EventRefusedError, match="no row y of point nobody"):
        apply(state, DecisionsTakenOver((row,)))
    with pytest.raises(EventRefusedError, match="model 101/102 is not accepted"):
        apply(scene.start, DecisionsTakenOver((row,)))


def test_the_reason_says_who_rejected_what() -> None:
    row = ImagePoint("1", "7", 0.0, 0.0, use="off", reason="huber; before: x, tau; before: xy, so")
    assert rejected_axes(row) == {"x": "huber", "y": "tau"}
    assert as_before(row) == replace(row, use="xy", reason="so")
    assert as_before(row, ["tau"]) == row
    assert said_by("tau, and I agree") is None


def folder_of(folder: Path) -> SessionState:
    scene, events, state = measured(3)
    write_new_block(folder, scene.block)
    journal = Journal.open(folder, {})[0]
    for event in events:
        append_event(journal, event)
    journal.close()
    rows = list(rows_of(state.models, state.reasons))
    write_image_points(folder, tuple(rows))
    return state


@pytest.mark.slow
def test_open_takes_over_what_adjust_applied(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "b"
    state = folder_of(folder)
    rows = read_block(folder).image_points
    point = state.models[0].plan[0].point
    found = [("image", "102", point, "101/102", "y"), ("image", "101", "101-5", "101/102", "x")]
    write_image_points(folder, applied(rows, found, "tau"))
    # before it is opened that is told, and named as what open takes over
    remark = journaled(folder, read_block(folder)).remark(folder)
    assert "was switched by adjust" in remark
    assert "the console takes that over" in remark
    file = (folder / "image_points.csv").read_bytes()
    with Station(folder, operator="KK") as station:
        after = station.state
        assert (point, "y") in after.models[0].off
    assert (folder / "image_points.csv").read_bytes() == file
    assert journaled(folder, read_block(folder)).remark(folder) == ""
    assert_alike(read_block(folder), read_block(folder).image_points, after)
    assert main(["log", str(folder), "--json"]) == 0
    last = json.loads(capsys.readouterr().out)["changes"][-1]
    assert (
        last["what"],
        last["model"],
        last["point"],
        last["axis"],
        last["reason"],
        last["who"],
    ) == (
        "off",
        "101/102",
        point,
        "y",
        "tau",
        "KK",
    )
    assert last["w_before"] is not None
    assert last["w_after"] is None
    assert replay_session(folder).state == after
    # nothing is left to take over; taken back it is on again
    with Station(folder) as station:
        assert station.state == after
    assert main(["adjust", str(folder), "--datum", "free", "--apply-undo", "--json"]) == 0
    note = json.loads(capsys.readouterr().out)["differs_from_journal"]
    assert note["count"] == 1
    with Station(folder) as station:
        assert station.state.models == state.models
        station.give(Undo())
        assert station.state.models == after.models
    assert read_block(folder).image_points != rows
    with Station(folder) as station:
        assert station.state.models == after.models


@pytest.mark.slow
def test_what_is_applied_goes_on_and_back_before_a_session_is_opened(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "b"
    state = folder_of(folder)
    rows = read_block(folder).image_points
    first, second = (one.point for one in state.models[0].plan[:2])
    write_image_points(folder, applied(rows, [("image", "102", first, "101/102", "y")], "tau"))
    free = ["adjust", str(folder), "--datum", "free"]
    # another strategy finds nothing more here, and is not kept from it
    assert main([*free, "--errors", "baarda", "--apply", "--json"]) == 0
    now = read_block(folder).image_points
    found = [("image", "102", second, "101/102", "y")]
    write_image_points(folder, applied(now, found, "search"))
    assert main([*free, "--errors", "search", "--apply-undo"]) == 0
    assert read_block(folder).image_points == now
    assert main([*free, "--apply-undo"]) == 0
    assert read_block(folder).image_points == rows
    assert journaled(folder, read_block(folder)).edited == ()
    # what somebody else changed is refused still
    moved = (replace(rows[0], x=rows[0].x + 0.05), *rows[1:])
    write_image_points(folder, moved)
    for words in (["--errors", "search", "--apply"], ["--apply-undo"]):
        assert main([*free, *words]) == 2
        assert capsys.readouterr().err.endswith(
            "then measure again in the console; nothing is written\n"
        )
    assert read_block(folder).image_points == moved


@pytest.mark.slow
def test_what_was_taken_back_is_not_taken_over_again_where_the_file_could_not_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "b"
    state = folder_of(folder)
    rows = read_block(folder).image_points
    point = state.models[0].plan[0].point
    found = [("image", "102", point, "101/102", "y"), ("image", "101", "101-5", "101/102", "x")]
    file = applied(rows, found, "tau")
    write_image_points(folder, file)

    def full(*_: object) -> str:
        raise InputError("no space left")

    with monkeypatch.context() as patch:
        patch.setattr(pointsfile, "write_image_points", full)
        with Station(folder) as station:
            assert station.state.models != state.models
            station.give(Undo())
            assert station.state.models == state.models
        assert read_block(folder).image_points == file
        # what the file says still is behind the journal, and nobody's decision any more
        assert journaled(folder, read_block(folder)).remark(folder) == ""
        with Station(folder) as station:
            assert station.state.models == state.models
    assert replay_session(folder).state.models == state.models
    # it is written when it can be
    with Station(folder) as station:
        assert station.state.models == state.models
    assert read_block(folder).image_points == rows
    # decided again, with the same words, it is taken over again
    write_image_points(folder, file)
    with Station(folder) as station:
        assert (point, "y") in station.state.models[0].off


def test_what_adjust_applies_while_the_block_is_being_opened_is_taken_over(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "b"
    state = folder_of(folder)
    read = BlockRead.of(folder)
    point = state.models[0].plan[0].point
    file = applied(
        read.block.image_points, [("image", "102", point, "101/102", axis) for axis in "xy"], "tau"
    )
    write_image_points(folder, file)
    taken_up = TakenUp(folder, read)
    journal, _ = taken_up.open({})
    try:
        assert (point, "y") in taken_up.past.state.models[0].off
        taken_up.points.write(taken_up.past.state)
    finally:
        journal.close()
    assert read_block(folder).image_points == taken_up.block.image_points == file


def opened(folder: Path) -> SessionState:
    """Open a session, take over what was decided elsewhere, write the file, and close it."""
    taken_up = TakenUp(folder, BlockRead.of(folder))
    with taken_up.open({})[0] as journal:
        for event in taken_up.decided:
            append_event(journal, event)
        taken_up.points.write(taken_up.past.state)
    return taken_up.past.state


def test_an_earlier_file_put_back_is_taken_over_as_it_was_before(tmp_path: Path) -> None:
    folder = tmp_path / "b"
    state = folder_of(folder)
    path, copy = folder / "image_points.csv", tmp_path / "copy.csv"
    rows = read_block(folder).image_points
    point = state.models[0].plan[0].point
    file = applied(rows, [("image", "102", point, "101/102", axis) for axis in "xy"], "tau")
    write_image_points(folder, file)
    shutil.copy2(path, copy)
    assert (point, "y") in opened(folder).models[0].off
    write_image_points(folder, taken_back(file, STRATEGIES))
    assert opened(folder).models == state.models
    # with its time, as cp -p does
    shutil.copy2(copy, path)
    assert "switched by adjust" in journaled(folder, read_block(folder)).remark(folder)
    assert (point, "y") in opened(folder).models[0].off
    assert path.read_bytes() == copy.read_bytes()


def test_what_else_was_changed_is_refused_as_ever(tmp_path: Path) -> None:
    folder = tmp_path / "b"
    state = folder_of(folder)
    rows = read_block(folder).image_points
    point = state.models[0].plan[0].point
    found = [("image", "102", point, "101/102", "y")]
    other = state.models[0].plan[1].point
    edited = tuple(
        replace(row, use="y") if (row.photo, row.point) == ("102", other) else row
        for row in applied(rows, found, "tau")
    )
    write_image_points(folder, edited)
    block = read_block(folder)
    with pytest.raises(InputError, match="put it back"):
        check_unedited(folder, block, fold(state, decisions(block, state)), {"101/102"})
    # a row that was off for another reason before is not the strategy's
    write_image_points(
        folder,
        tuple(
            replace(row, use="off", reason="tau; before: x")
            if (row.photo, row.point, row.model) == ("102", other, "101/102")
            else row
            for row in rows
        ),
    )
    block = read_block(folder)
    assert state.models[0].planned(other) is not None
    assert [row for event in decisions(block, state) for row in event.rows] == []


def test_the_log_has_a_line_for_every_row() -> None:
    scene, events, state = measured(3)
    log = ChangeLog(scene.block)
    for event in events:
        log.add(Happened("2026-01-01T00:00:00Z", "A", event))
    count = len(log.changes)
    row = DecidedRow("101", "102", state.models[0].plan[0].point, "y", False, "odds")
    log.add(Happened("2026-01-01T00:00:00Z", "B", DecisionsTakenOver((row,))))
    log.add(Happened("2026-01-01T00:00:00Z", "B", Undone()))
    off, back = log.changes[count:]
    assert (off.what, off.model, off.photo, off.reason, off.who) == (
        "off",
        "101/102",
        "102",
        "odds",
        "B",
    )
    assert (back.what, back.point) == ("undone", row.point)
    assert back.w_after == off.w_before
