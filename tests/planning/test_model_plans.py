"""Which points are measured, and where the plates are driven for them."""

from __future__ import annotations

from dataclasses import replace
from math import hypot
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.errors import InputError
from anaplot.orientation.patterns import PATTERNS, pattern
from anaplot.photogrammetry.block import Block, Camera, Photo, Precision, Strip, TestSettings
from anaplot.planning.modelplan import PlannedPosition, plan_positions, standard_d
from anaplot.planning.synthetic import synthetic_strip

CAMERA = Camera("rmk", 152.4, (230.0, 230.0))


def block(*photos: str, camera: Camera = CAMERA) -> Block:
    return Block(
        "b",
        Precision(),
        TestSettings(),
        (camera,),
        tuple(Photo(p, camera.id) for p in photos),
        (Strip("1", photos, 92.0),),
    )


def plan(
    nominal: float | None = 92.0,
    preceding: dict[str, tuple[float, float]] | None = None,
    candidates: dict[str, dict[str, tuple[float, float]]] | None = None,
    avoid: tuple[str, ...] = (),
    photos: tuple[str, str] = ("101", "102"),
    name: str = "13",
    camera: Camera = CAMERA,
) -> tuple[PlannedPosition, ...]:
    return plan_positions(
        block(*photos, camera=camera),
        photos,
        pattern(name),
        nominal_base=nominal,
        preceding=preceding or {},
        candidates=candidates,
        avoid=avoid,
    )


def names(positions: tuple[PlannedPosition, ...]) -> list[str]:
    return [p.point for p in positions]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_without_candidates_the_pattern_lies_at_the_standard_positions(sign: float) -> None:
    positions = plan(sign * 92.0)
    assert len(positions) == 13
    d = standard_d(CAMERA)
    for p in positions:
        # the left mark between nadir and nadir, the right one a base back
        assert 0.0 <= sign * p.xl <= 92.0
        assert p.xl - p.xr == pytest.approx(sign * 92.0)
        assert p.yl == p.yr
        assert abs(p.yl) <= d
    assert names(positions) == [
        *("101-1", "101-1'", "101-2", "101-3", "101-3'"),
        *("102-1", "102-1'", "102-2", "102-3", "102-3'"),
        *("101-7", "101-8", "101-9"),
    ]


def test_a_mirrored_flight_mirrors_the_plan() -> None:
    for a, b in zip(plan(92.0), plan(-92.0), strict=True):
        assert (a.point, a.xl, a.yl, a.xr) == (b.point, -b.xl, b.yl, -b.xr)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_points_of_the_preceding_model_come_first_and_keep_their_names(sign: float) -> None:
    before = {p.point: (p.xr + 0.7, p.yr - 0.4) for p in plan(sign * 92.0)}
    positions = plan(sign * 92.0, before, photos=("102", "103"))
    ties = names(positions)[:5]
    assert ties == ["102-1", "102-1'", "102-2", "102-3", "102-3'"]
    assert not set(names(positions)[5:]) & before.keys()
    for p in positions[:5]:
        assert (p.xl, p.yl) == before[p.point]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_no_tie_is_planned_where_the_right_photo_does_not_reach(sign: float) -> None:
    # the one nearest to its place, of a doubled position whose other point is off
    before = {"a": (2.0, 98.0), "b": (0.0, 0.0), "c": (-1.0, -97.0), "out": (-34.7, -80.0)}
    before = {name: (sign * x, y) for name, (x, y) in before.items()}
    found = names(plan(sign * 92.0, before, photos=("102", "103")))
    assert found[:3] == ["a", "b", "c"]
    assert "out" not in found
    # without a format nobody knows, and where too few are left the base may be another
    endless = Camera("c", 152.0)
    assert "out" in names(plan(sign * 92.0, before, photos=("102", "103"), camera=endless))
    del before["b"]
    assert "out" in names(plan(sign * 92.0, before, photos=("102", "103")))


def test_no_new_point_gets_the_name_of_another() -> None:
    before = {p.point: (p.xr, p.yr) for p in plan()}
    # the first of a doubled position was switched off: its twin serves in its place
    del before["102-1"]
    positions = plan(preceding=before, photos=("102", "103"))
    assert len(set(names(positions))) == 13
    assert names(positions)[0] == "102-1'"
    assert [name for name in names(positions) if name in before] == names(positions)[:4]
    assert "102-1'.2" in names(positions)
    avoided = plan(preceding=before, photos=("102", "103"), avoid=("103-1", "103-1.2"))
    assert "103-1" not in names(avoided)
    assert "103-1.3" in names(avoided)


@given(
    st.sets(st.integers(0, 12)),
    st.lists(st.floats(-60, 60), min_size=26, max_size=26),
    st.sampled_from(sorted(PATTERNS)),
    st.sampled_from([92.0, -92.0, 30.0, None]),
)
def test_names_are_unique_whatever_was_measured_before(
    left_out: set[int], moved: list[float], name: str, nominal: float | None
) -> None:
    before = {
        p.point: (p.xr + moved[2 * k], p.yr + moved[2 * k + 1])
        for k, p in enumerate(plan(nominal))
        if k not in left_out
    }
    positions = plan(nominal, before, photos=("102", "103"), name=name)
    assert len(set(names(positions))) == len(positions) == len(pattern(name).labels)
    for p in positions:
        if p.point in before:
            assert (p.xl, p.yl) == before[p.point]


def test_photo_names_of_any_length_give_names_that_can_be_kept() -> None:
    photos = ("L" * 100, "R" * 100)
    positions = plan(photos=photos)
    assert len(set(names(positions))) == 13
    assert max(map(len, names(positions))) <= 100


def test_among_candidates_the_nearest_is_taken_once() -> None:
    made = synthetic_strip(3, seed=4)
    left, right = "101", "102"
    positions = plan(candidates=dict(made.truth))
    assert len(set(names(positions))) == 13
    common = made.truth[left].keys() & made.truth[right].keys()
    assert set(names(positions)) <= common
    d = standard_d(CAMERA)
    for p in positions:
        assert min(hypot(p.xl - x, p.yl - y) for x in (0, 46, 92) for y in (-d, 0, d)) < 12.0


def test_candidates_far_from_a_position_leave_it_out() -> None:
    few = {
        "101": {"a": (0.0, 0.0), "b": (92.0, 1.0), "c": (23.0, 45.0)},
        "102": {"a": (-92.0, 0.0), "b": (0.0, 1.0), "c": (-69.0, 45.0)},
    }
    positions = plan(candidates=few)
    assert set(names(positions)) <= {"a", "b"}
    assert plan(candidates={"101": {"a": (0.0, 0.0)}, "102": {}}) == ()


def test_the_direction_of_flight_comes_from_the_candidates() -> None:
    made = synthetic_strip(2, seed=4)
    turned = {
        photo: {point: (-x, -y) for point, (x, y) in points.items()}
        for photo, points in made.truth.items()
    }
    positions = plan(92.0, candidates=turned)
    assert len(positions) == 13
    assert {p.xl - p.xr < 0.0 for p in positions} == {True}


def test_a_tie_is_driven_to_where_it_is_marked() -> None:
    made = synthetic_strip(3, seed=4)
    first = plan(candidates=dict(made.truth))
    # one of them was measured at a wrong place, a centimetre away
    before = {p.point: (p.xr, p.yr) for p in first}
    wrong = next(p.point for p in first if p.point.startswith("102-2"))
    before[wrong] = (before[wrong][0] + 10.0, before[wrong][1])
    positions = plan(preceding=before, candidates=dict(made.truth), photos=("102", "103"))
    place = next(p for p in positions if p.point == wrong)
    assert (place.xl, place.yl) == made.truth["102"][wrong]


def test_without_base_and_format_the_camera_gives_an_idea() -> None:
    positions = plan(None, camera=replace(CAMERA, format=None))
    assert positions[0].xl - positions[0].xr == pytest.approx(0.6 * 152.4)
    assert plan(None)[0].xl - plan(None)[0].xr == pytest.approx(92.0)


def test_an_unknown_pattern_names_the_nearest() -> None:
    with pytest.raises(InputError, match="no point pattern '14'"):
        pattern("14")


# -- a real strip as candidates: frames 8936, 8937, 8938 of the Strasbourg block -------------------

SXB = Path(__file__).parents[3] / "shared" / "data" / "sxb" / "measurements"


@pytest.mark.skipif(not SXB.exists(), reason="sxb data absent")
def test_a_real_strip_with_a_short_base_against_x() -> None:
    points: dict[str, dict[str, tuple[float, float]]] = {"2": {}, "3": {}, "4": {}}
    for name in ("markpts.txt", "smartpts.txt"):
        for line in (SXB / name).read_text().splitlines():
            if line.strip() and not line.startswith("#"):
                point, image, column, row = (part.strip() for part in line.split(","))
                if image in points:
                    xy = 0.006 * float(column) - 26.577, 38.811 - 0.006 * float(row)
                    points[image][point] = xy
    camera = Camera("sxb", 123.9392, (53.148, 77.976))
    first = plan(None, candidates=points, photos=("2", "3"), camera=camera)
    assert len(first) >= 9
    assert len(set(names(first))) == len(first)
    assert sorted(p.xl - p.xr for p in first)[len(first) // 2] == pytest.approx(-15.0, abs=1.5)
    before = {p.point: (p.xr, p.yr) for p in first}
    second = plan(None, before, points, photos=("3", "4"), camera=camera)
    ties = [p.point in before for p in second]
    assert any(ties)
    assert ties == sorted(ties, reverse=True)
    for p in second:
        assert (p.xl, p.yl) == points["3"][p.point]
        assert (p.xr, p.yr) == points["4"][p.point]
