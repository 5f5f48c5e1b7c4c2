"""Strips bridged side by side: the same as model by model, whatever their rows are like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from grossblocks import mismatched, planned
from syntheticblocks import synthetic_block

from anaplot.aliases import Progress
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.start import approximate, bridging
from anaplot.bundle.start.bridging import bridged_chains, joined_chains
from anaplot.bundle.start.stripmodels import strip_models
from anaplot.bundle.start.subblock import unit_rays
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import Block, ImagePoint, Strip
from anaplot.photogrammetry.selection import model_name, points_of, rows_off


def measured(kind: str, seed: int = 1) -> Block:
    """Five strips of five photos, with noise, and rows of some kind."""
    made = synthetic_block(5, 5, seed=seed)
    rng = np.random.default_rng(seed)
    models: dict[str, list[str]] = {}
    for strip in made.block.strips:
        for pair in strip.models():
            for photo in pair:
                models.setdefault(photo, []).append(model_name(*pair))
    rows = []
    for photo, points in made.truth.items():
        for point, at in points.items():
            x, y = (np.array(at) + rng.normal(0.0, 0.005, 2)).tolist()
            if kind == "gross" and rng.random() < 0.02:
                x += 20.0
            if kind == "turned":
                x, y = 0.8 * x - 0.6 * y, 0.6 * x + 0.8 * y
            use = str(rng.choice(["xy", "xy", "x", "y", "off"])) if kind == "off" else "xy"
            row = ImagePoint(photo, point, x, y, use=use)
            if kind == "models" and rng.random() < 0.7:
                rows += [
                    replace(
                        row, model=model, x=x + 0.003, use="off" if rng.random() < 0.05 else "xy"
                    )
                    for model in (*models[photo], "elsewhere")
                    if rng.random() < 0.9
                ]
                if rng.random() < 0.7:
                    continue
            if kind != "gap" or photo != "203":
                rows.append(row)
    rng.shuffle(rows)
    strips = made.block.strips
    if kind == "gap":
        # of one strip a single photo, one with a stated base, one that shares a photo
        first, second, *others = strips
        strips = (replace(first, base=92.0), second, Strip("one", ("101",)), *others)
        strips += (Strip("again", others[0].photos[1:3]),)
    return replace(made.block, strips=strips, image_points=tuple(rows))


KINDS = ["plain", "gross", "turned", "off", "models", "gap"]


@pytest.mark.parametrize("kind", KINDS)
def test_points_of_models_are_those_that_the_rows_say(kind: str) -> None:
    problem = make_problem(measured(kind)).bare
    laid = strip_models(problem)
    unused = set(problem.unused_rays.tolist())
    rows = [r for k, r in enumerate(problem.block.image_points) if k not in unused]
    pairs = [pair for strip in problem.block.strips for pair in strip.models()]
    assert len(laid.photos) == len(pairs) == laid.strips[-1].stop
    before: dict[str, int] = {}
    for k, pair in enumerate(pairs):
        here = laid.of(k)
        left, right = (points_of(rows, photo, model_name(*pair)) for photo in pair)
        names = [problem.points[p] for p in laid.points[here].tolist()]
        assert names == [point for point in left if point in right]
        assert [tuple(xy) for xy in laid.left[here].tolist()] == [
            (left[n].x, left[n].y) for n in names
        ]
        assert [tuple(xy) for xy in laid.right[here].tolist()] == [
            (right[n].x, right[n].y) for n in names
        ]
        off = rows_off(left, right)
        assert laid.counts[here].tolist() == [
            [(n, axis) not in off for axis in "xy"] for n in names
        ]
        if any(k == strip.start for strip in laid.strips):
            before = {}
        assert laid.before[here].tolist() == [before.get(name, -1) for name in names]
        before = {name: here.start + at for at, name in enumerate(names)}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_side_by_side_is_one_by_one(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = make_problem(measured(kind)).bare
    rays = unit_rays(problem)
    at_once = joined_chains(problem, rays, bridged_chains(problem))
    monkeypatch.setattr(bridging, "_SEVERAL", len(problem.photos))
    singly = joined_chains(problem, rays, bridged_chains(problem))
    assert len(at_once) == len(singly)
    for one, other in zip(at_once, singly, strict=True):
        np.testing.assert_allclose(one.centres, other.centres, rtol=1e-9, atol=1e-7)
        np.testing.assert_allclose(one.rotations, other.rotations, atol=1e-9)
        size = np.abs(one.centres[one.oriented]).max()
        # two rays of one photo do not meet anywhere in particular
        np.testing.assert_allclose(one.points, other.points, rtol=1e-9, atol=1e-6 * size)
    if kind in ("plain", "turned"):
        assert len(at_once) == 1
        assert at_once[0].oriented.all()


def test_what_is_beyond_doubt_is_not_oriented_again(monkeypatch: pytest.MonkeyPatch) -> None:
    def alone(*_: object) -> None:
        raise AssertionError("a model was oriented by itself")

    monkeypatch.setattr(bridging, "orient", alone)
    for kind in ("plain", "models"):
        problem = make_problem(measured(kind)).bare
        (whole,) = joined_chains(problem, unit_rays(problem), bridged_chains(problem))
        assert whole.oriented.all()


@pytest.fixture
def bridgings(monkeypatch: pytest.MonkeyPatch) -> list[Problem]:
    """The bundles whose strips are bridged on the ways to approximate values."""
    seen: list[Problem] = []

    def noted(problem: Problem, progress: Progress | None) -> list[bridging.Chain]:
        seen.append(problem)
        return bridged_chains(problem, progress)

    monkeypatch.setattr(approximate, "bridged_chains", noted)
    return seen


def test_strips_that_hang_together_are_tried_once(bridgings: list[Problem]) -> None:
    ways = approximate.approximate_ways(make_problem(measured("plain")).bare)
    assert bridgings == []
    assert ways[1].find(None) is not None
    assert ways[4].find(None) is None
    assert len(bridgings) == 1


def test_strips_are_bridged_once_where_pairs_go_on(bridgings: list[Problem]) -> None:
    block = measured("plain")
    last = block.strips[-1].photos[-1]
    few = [row for row in block.image_points if row.photo == last][:3]
    rows = [row for row in block.image_points if row.photo != last]
    problem = make_problem(replace(block, image_points=(*rows, *few))).bare
    ways = approximate.approximate_ways(problem)
    for k in (1, 4):
        with pytest.raises(NotComputableError, match=last):
            ways[k].find(None)
    assert bridgings == [problem]


@pytest.mark.slow
def test_a_chain_ends_where_wrong_points_would_stretch_it() -> None:
    made = planned(6, strips=4, photos=15)
    block, wrong = mismatched(made, 27, 6)
    # two points that tie a model to the one before are wrong
    assert {("406", "09-05"), ("406", "09-06")} <= wrong
    problem = make_problem(block)
    for chain in bridged_chains(problem):
        bases = np.linalg.norm(np.diff(chain.centres, axis=0), axis=1)
        np.testing.assert_allclose(bases, 92.0, rtol=0.02)
