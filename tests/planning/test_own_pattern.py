"""Patterns of one's own in the models of a block."""

from __future__ import annotations

from dataclasses import replace

import pytest

from anaplot.orientation.ownpattern import OwnPattern
from anaplot.orientation.patterns import PATTERNS, pattern
from anaplot.orientation.suitability import pattern_verdict
from anaplot.photogrammetry.block import Block, Camera, Photo, Precision, Strip, TestSettings
from anaplot.planning.modelplan import PlannedPosition, plan_positions, standard_d
from anaplot.planning.patternfit import pattern_fault
from anaplot.planning.synthetic import further_places, synthetic_truth
from anaplot.planning.syntheticblock import synthetic_plates

CAMERA = Camera("rmk", 152.4, (230.0, 230.0))
D = standard_d(CAMERA)
MINE = OwnPattern(
    "mine.csv",
    (
        *(("a", 0.0, 80.0), ("b", 0.0, 25.0), ("c", 0.0, -25.0), ("d", 0.0, -80.0)),
        *(("m", 40.0, 80.0), ("n", 40.0, -80.0), ("left", 4.0, 0.0)),
        *(("e", 80.0, 80.0), ("f", 80.0, 25.0), ("g", 80.0, -25.0), ("h", 80.0, -80.0)),
    ),
    ("a", "b", "c", "d"),
)


def block(*photos: str, base: float | None = 92.0) -> Block:
    return Block(
        "b",
        Precision(),
        TestSettings(),
        (CAMERA,),
        tuple(Photo(p, CAMERA.id) for p in photos),
        (Strip("1", photos, base),),
    )


STRIP = block("101", "102", "103")


def plan(
    own: OwnPattern,
    preceding: dict[str, tuple[float, float]] | None = None,
    photos: tuple[str, str] = ("101", "102"),
    sign: float = 1.0,
) -> tuple[PlannedPosition, ...]:
    return plan_positions(
        STRIP,
        photos,
        own,
        nominal_base=92.0 * sign,
        preceding=preceding or {},
        candidates=None,
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_its_points_lie_where_the_file_says_at_the_same_part_of_the_base(sign: float) -> None:
    positions = plan(MINE, sign=sign)
    assert [p.point for p in positions] == [f"101-{label}" for label in MINE.labels]
    for p, (_, x, y) in zip(positions, MINE.points, strict=True):
        assert p.xl == pytest.approx(sign * x * 92.0 / 80.0)
        assert p.xl - p.xr == pytest.approx(sign * 92.0)
        assert p.yl == p.yr == y


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_its_ties_are_the_points_that_the_file_says(sign: float) -> None:
    before = {p.point: (p.xr + 0.7, p.yr - 0.4) for p in plan(MINE, sign=sign)}
    positions = plan(MINE, before, ("102", "103"), sign)
    assert [p.point for p in positions[:4]] == ["101-e", "101-f", "101-g", "101-h"]
    assert [p.point for p in positions[4:]] == [f"102-{x}" for x in MINE.labels[4:]]
    for p in positions[:4]:
        assert (p.xl, p.yl) == before[p.point]


def test_a_point_that_is_no_tie_is_no_known_point_of_the_model_before() -> None:
    fewer = replace(MINE, ties=("a", "b", "d"))
    known = {"p": (0.2, -25.0), "q": (3.0, -28.0)}
    positions = plan_positions(
        STRIP,
        ("102", "103"),
        fewer,
        nominal_base=92.0,
        preceding={"p": (0.2, -25.0)},
        candidates=dict.fromkeys(("102", "103"), known),
    )
    assert "p" not in [p.point for p in positions]
    assert "q" in [p.point for p in positions]


def test_a_named_pattern_as_a_file_is_measured_in_the_same_places() -> None:
    named = pattern("13/5")
    places = named.positions(92.0, D, twin=(4.0, 4.0))
    own = OwnPattern("x.csv", tuple((label, *xy) for label, xy in places.items()), named.ties)
    assert pattern_fault(own, STRIP) is None
    for mine, its in zip(
        plan(own),
        plan_positions(
            STRIP, ("101", "102"), named, nominal_base=92.0, preceding={}, candidates=None
        ),
        strict=True,
    ):
        assert mine[1:] == pytest.approx(its[1:])


@pytest.mark.parametrize("name", ["6", "6/3", "9/3", "10/5", "13/5", "15"])
def test_the_verdict_is_that_of_the_same_points_with_a_name(name: str) -> None:
    named = pattern(name)
    at = named.positions(90.0, 100.0)
    own = OwnPattern("x.csv", tuple((label, *xy) for label, xy in at.items()), named.ties)
    its = pattern_verdict(named).replace(f"pattern {name} is", "pattern x.csv is")
    assert pattern_verdict(own) == its


def test_one_that_can_be_measured_has_no_fault() -> None:
    assert pattern_fault(MINE, STRIP) is None
    assert pattern_fault(MINE, block("101", "102", "103", base=None)) is None
    # nothing goes on from the only model of a strip
    assert pattern_fault(replace(MINE, ties=()), block("101", "102")) is None


def moved(label: str, x: float, y: float) -> OwnPattern:
    points = tuple((p[0], x, y) if p[0] == label else p for p in MINE.points)
    return replace(MINE, points=points)


@pytest.mark.parametrize(
    ("own", "label", "words"),
    [
        (replace(MINE, ties=("a", "b")), None, "2 of its points are ties (tie = yes): a strip of"),
        (replace(MINE, ties=()), None, "0 of its points are ties"),
        (moved("m", 40.0, 116.0), "m", "'m' would lie at x 46.0, y 116.0 mm in photo 101, which"),
        (moved("left", -30.0, 0.0), "left", "x -126.5, y 0.0 mm in photo 102, which ends at 115"),
        (moved("e", 20.0, 0.0), "a", "tie 'a': no other point lies near it one base further on"),
        (
            replace(MINE, points=tuple((name, x, 0.0) for name, x, _ in MINE.points)),
            None,
            "its points do not determine a strip's first model",
        ),
        (
            replace(MINE, points=tuple((name, -x, y) for name, x, y in MINE.points)),
            None,
            "no point lies at an x greater than 0",
        ),
        (replace(MINE, points=MINE.points[:4], ties=MINE.labels[:4]), None, "greater than 0"),
    ],
)
def test_what_keeps_it_from_being_measured_is_said(
    own: OwnPattern, label: str | None, words: str
) -> None:
    fault = pattern_fault(own, STRIP)
    assert fault is not None
    assert (fault.label, words in fault.message) == (label, True), fault


def test_a_label_too_long_for_the_names_of_points_is_refused() -> None:
    label = "x" * 101
    fault = pattern_fault(replace(MINE, points=((label, 1.0, 1.0), *MINE.points)), STRIP)
    assert fault == (label, "label of more than 100 characters")


@pytest.mark.parametrize(
    "wanted", [MINE, *(pattern(name) for name in ("8/4", "10/5", "12", "15r"))]
)
def test_synthetic_photographs_show_every_point_of_it(wanted: OwnPattern) -> None:
    ids = ("101", "102", "103")
    truth, _, _ = synthetic_truth(ids, CAMERA, seed=3, base=92.0, wanted=wanted)
    usual, _, _ = synthetic_truth(ids, CAMERA, seed=3, base=92.0)
    for photo in ids:
        assert usual[photo].items() <= truth[photo].items()
    before: dict[str, tuple[float, float]] = {}
    for left, right in STRIP.strips[0].models():
        positions = plan_positions(
            STRIP, (left, right), wanted, nominal_base=92.0, preceding=before, candidates=truth
        )
        assert len(positions) == len(wanted.labels)
        ties = [p.point for p in positions if p.point in before]
        assert len(ties) == (len(wanted.transferred) if before else 0)
        before = {p.point: (p.xr, p.yr) for p in positions}


@pytest.mark.parametrize("name", ["6/3", "9", "13/5", "15"])
def test_what_the_standard_points_serve_needs_no_others(name: str) -> None:
    assert further_places(PATTERNS[name], ("101", "102", "103"), 92.0, D) == {}


def test_strips_side_by_side_show_them_too() -> None:
    strips = (("101", "102", "103"), ("203", "202", "201"))
    truth = synthetic_plates(strips, CAMERA, seed=3, base=92.0, wanted=MINE)
    usual = synthetic_plates(strips, CAMERA, seed=3, base=92.0)
    for photo, seen in truth.items():
        assert usual[photo].items() <= seen.items()
    cameras = block(*truth)
    for left, right in (("101", "102"), ("102", "103"), ("203", "202"), ("202", "201")):
        positions = plan_positions(
            cameras, (left, right), MINE, nominal_base=None, preceding={}, candidates=truth
        )
        assert len(positions) == len(MINE.labels)
