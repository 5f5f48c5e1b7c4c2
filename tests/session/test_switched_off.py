"""What a session switches off is in image_points.csv, and the bridge forms its models from it."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest
from sessionscene import Scene

from anaplot.exchange.imagepointscsv import format_image_points, parse_image_points
from anaplot.orientation.results import ModelSolution
from anaplot.orientation.strip import bridge_strip
from anaplot.photogrammetry.block import ImagePoint, TieVariance
from anaplot.session.events import ModelAccepted, RowSwitched
from anaplot.session.models import solve
from anaplot.session.state import SessionState, apply
from anaplot.station.imagepoints import merged_rows, rows_of

VARIANCES: tuple[TieVariance, ...] = ("paper", "propagated", "exact")


def measured(seed: int) -> tuple[Scene, SessionState]:
    """Return a strip of three models, in each some rows and whole points switched off."""
    rng = np.random.default_rng(seed)
    scene = Scene(4, seed)
    block = replace(
        scene.block, precision=replace(scene.block.precision, tie_variance=VARIANCES[seed % 3])
    )
    scene.block, scene.start = block, replace(scene.start, block=replace(block, image_points=()))
    state = scene.start
    for k, (left, right) in enumerate(block.strips[0].models()):
        state = scene.whole(apply(state, scene.choice(state, k)))
        assert state.current is not None
        plan = state.current.plan
        ties = [p.point for p in plan if p.role == "tie"]
        for point in rng.choice([p.point for p in plan], 2, replace=False).tolist():
            state = apply(state, RowSwitched(point, None, False))
        left_ties = [p for p in ties if not state.current.is_off(p)]
        for point, axis in zip(left_ties[:2], ("x", "y"), strict=False):
            state = apply(state, RowSwitched(point, axis, False))
        state = apply(state, ModelAccepted(left, right))
    return scene, state


def assert_equal(one: ModelSolution, other: ModelSolution) -> None:
    assert one.table == other.table
    assert one.off_rows == other.off_rows
    assert one.listed == other.listed
    assert (one.points, one.ties, one.base) == (other.points, other.ties, other.base)
    assert (one.rotation, one.sigma0_um) == (other.rotation, other.sigma0_um)


def check_seed(seed: int, folder: Path) -> None:
    scene, state = measured(seed)
    path = folder / "image_points.csv"
    path.write_text(format_image_points(rows_of(state.models)))
    block = replace(scene.block, image_points=parse_image_points(path, scene.block))
    bridged = bridge_strip(block, block.strips[0])
    assert bridged.error is None
    for model, again in zip(state.models, bridged.models, strict=True):
        solution = solve(state, model)
        assert_equal(again, solution)
        assert {row.key for row in solution.off_rows} == set(model.off)
        assert not {row.key for row in solution.table} & model.off
    rows = {(row.photo, row.point, row.model): row for row in block.image_points}
    for model in state.models:
        for m in model.measured:
            assert rows[model.left, m.point, model.name].use == "xy"
            row = rows[model.right, m.point, model.name]
            assert (row.use == "off") == model.is_off(m.point)
            for axis in model.axes(m.point):
                assert row.counts(axis) == ((m.point, axis) not in model.off)


@pytest.mark.parametrize("seed", range(6))
def test_the_bridge_forms_the_models_of_the_session(seed: int, tmp_path: Path) -> None:
    check_seed(seed, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6, 56))
def test_the_bridge_forms_the_models_of_many_sessions(seed: int, tmp_path: Path) -> None:
    check_seed(seed, tmp_path)


def test_a_row_that_is_off_shows_what_it_is_off_from_the_others() -> None:
    _, state = measured(3)
    for model in state.models:
        solution = solve(state, model)
        order = [m.point for m in model.measured]
        keys = [row.key for row in solution.listed]
        assert keys == sorted(keys, key=lambda key: ("yx".index(key[1]), order.index(key[0])))
        assert {row.key for row in solution.listed if not row.use} == model.off
        for row in solution.off_rows:
            assert (row.expected, row.w, row.mdb, row.flagged) == (None, None, None, False)
        # with all rows back the parallaxes change by no more than a table of noise does
        whole = {row.key: row for row in solve(state, replace(model, off=frozenset())).table}
        for row in solution.off_rows:
            # alone back in, its residual is r times what it was off before
            back = replace(model, off=model.off - {row.key})
            again = {one.key: one for one in solve(state, back).table}
            if row.key in again and row.key in whole and again[row.key].r > 0.05:
                one = again[row.key]
                assert one.residual == pytest.approx(one.r * row.residual, abs=0.02)


def test_a_point_of_which_every_row_is_off_is_no_tie_of_the_next_model() -> None:
    scene, state = measured(1)
    block = replace(scene.block, image_points=rows_of(state.models))
    bridged = bridge_strip(block, block.strips[0]).models
    for model, (before, after) in zip(state.models, pairwise(bridged), strict=False):
        gone = {m.point for m in model.measured if model.is_off(m.point)}
        assert gone
        assert gone.isdisjoint(p.point for p in before.points)
        assert gone.isdisjoint(after.ties)


def test_a_left_ray_serves_as_given_unless_it_is_off() -> None:
    scene, state = measured(0)
    rows = rows_of(state.models)
    name = state.models[0].used[4].point

    def first(use: str) -> ModelSolution:
        changed = tuple(
            replace(row, use=use)  # type: ignore[arg-type]
            if (row.photo, row.point) == ("101", name)
            else row
            for row in rows
        )
        block = replace(scene.block, image_points=changed)
        return bridge_strip(block, block.strips[0]).models[0]

    assert first("x").table == first("y").table == first("xy").table
    off = first("off")
    assert name not in {row.point for row in off.table}
    assert (name, "y") in {row.key for row in off.off_rows}
    right = tuple(
        replace(row, use="off")
        if (row.photo, row.point, row.model) == ("102", name, "101/102")
        else row
        for row in rows
    )
    block = replace(scene.block, image_points=right)
    assert_equal(off, bridge_strip(block, block.strips[0]).models[0])


def test_what_a_person_decided_with_a_reason_stays_in_the_file() -> None:
    _, state = measured(2)
    rows = rows_of(state.models)
    said = replace(rows[20], use="off", reason="mark on the moving lorry")
    found = (*rows[:20], said, *rows[21:])
    of_session = {model.name for model in state.models}
    assert merged_rows(found, state.models, of_session) == found
    # measured anew it is believed again
    other = replace(said, x=said.x + 0.001)
    assert merged_rows((*rows[:20], other, *rows[21:]), state.models, of_session) == rows


def test_the_columns_stand_there_only_where_a_row_needs_them() -> None:
    plain = ImagePoint("101", "1", 1.0, 2.0, model="101/102")
    assert format_image_points([plain]).splitlines()[0] == "photo,point,x,y,model"
    off = ImagePoint("101", "2", 1.0, 2.0, use="x")
    assert format_image_points([plain, off]).splitlines()[0] == "photo,point,x,y,model,use"
    why = replace(off, use="xy", reason="looked at twice")
    assert format_image_points([plain, why]).splitlines()[0] == "photo,point,x,y,model,reason"


def test_rows_of_the_session_are_the_same_whatever_pair_of_rows_is_off() -> None:
    scene = Scene(3)
    state = scene.whole(scene.chosen(1))
    assert state.current is not None
    model = state.current
    ties = [p.point for p in model.plan if p.role == "tie"][:2]
    keys = [(point, axis) for point in ties for axis in model.axes(point)]
    for pair in combinations(keys, 2):
        one = replace(model, off=frozenset(pair))
        block = replace(scene.block, image_points=rows_of((*state.models, one)))
        again = bridge_strip(block, block.strips[0]).models[1]
        assert_equal(again, solve(state, one))


def measured_once() -> tuple[Scene, SessionState, str]:
    """Return models of which the last has left rays of the one before it, but for a point."""
    scene = Scene(4)
    state = scene.whole(scene.chosen(2))
    assert state.current is not None
    first, before = state.models
    last = state.current
    place = {m.point: (m.xr, m.yr) for m in before.measured}
    gone = next(p.point for p in last.plan if p.role == "tie")
    shared = tuple(
        replace(m, xl=place[m.point][0], yl=place[m.point][1]) if m.point in place else m
        for m in last.measured
    )
    plan = tuple(replace(p, role="new") if p.point == gone else p for p in last.plan)
    models = (
        first,
        replace(before, off=frozenset({(gone, "y")})),
        replace(last, mono=True, measured=shared, plan=plan),
    )
    return scene, replace(state, models=models, current=None), gone


def test_what_was_measured_once_is_written_for_each_model_where_they_differ() -> None:
    scene, state, gone = measured_once()
    models = state.models
    _, before, last = models
    shared = {m.point for m in last.measured}
    place = {m.point for m in before.measured}
    rows = rows_of(models)
    served = {row.point: row.use for row in rows if row.model is None}
    assert set(served) == (place & shared) - {gone}
    assert set(served.values()) == {"xy"}
    assert [(row.model, row.use) for row in rows if (row.photo, row.point) == ("103", gone)] == [
        ("102/103", "off"),
        ("103/104", "xy"),
    ]
    block = replace(scene.block, image_points=rows)
    for model, again in zip(models, bridge_strip(block, block.strips[0]).models, strict=True):
        assert_equal(again, solve(state, model))


def test_the_rows_of_a_photo_follow_from_the_models_that_have_it() -> None:
    _, state, _ = measured_once()
    rows = rows_of(state.models)
    for photo in ("101", "102", "103", "104"):
        here = rows_of(m for m in state.models if photo in m.photos)
        mine = [row for row in rows if row.photo == photo]
        assert mine
        assert [row for row in here if row.photo == photo] == mine
