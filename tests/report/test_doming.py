"""What a calibration does to heights: bends, what explains them, and flights against them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import anaplot
from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.hypotheses.doming import bend_weights, doming
from anaplot.bundle.solve.crosscofactors import coordinate_cofactors
from anaplot.bundle.solve.selection import NO_ANGLE
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ImagePoint,
    Photo,
    Precision,
    TestSettings,
)
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.collinearity import project
from anaplot.photogrammetry.measuredimage import ideal_rays, measured_rays
from anaplot.photogrammetry.rotation import rotation_matrix
from anaplot.planning.domingflights import doming_flights

TRUE = BrownLens(k1=0.02)
SIGMA = 0.05  # m, of control and check points


def flown(lens: BrownLens | None, *, seed: int = 1, tilt: float = 0.003) -> Block:
    """Three strips of five photos, 60/60, over nearly flat ground: the classical dome.

    Control in the four corners, every fifth point a check point; `lens` is what the camera states.
    """
    rng = np.random.default_rng(seed)
    true, own = Camera("cam", 150.0, lens=TRUE), Camera("cam", 150.0, lens=lens)
    points = np.array(
        [(x, y, rng.uniform(-10.0, 10.0)) for y in np.arange(-1.0, 3.1, 0.5) * 600.0
         for x in np.arange(0.0, 4.1, 0.5) * 600.0]
    )  # fmt: skip
    n = len(points)
    photos, rows = [], []
    for strip in range(3):
        for k in range(5):
            name = f"{strip + 1}{k + 1:02d}"
            photos.append(Photo(name, "cam"))
            centre = (k * 600.0, strip * 600.0, 1000.0)
            rotation = rotation_matrix(*(rng.normal(size=3) * tilt))
            seen = project(
                np.broadcast_to(centre, (n, 3)),
                np.broadcast_to(rotation, (n, 3, 3)),
                np.full(n, 150.0),
                points,
            )
            inside = (np.abs(points[:, :2] - centre[:2]) <= 601.0).all(axis=1)
            xy = measured_rays(true, seen.xy) + rng.normal(size=(n, 2)) * 0.003
            ideal = ideal_rays(own, xy)
            rows += [
                ImagePoint(name, f"p{p}", *ideal[p].tolist())
                for p in np.flatnonzero(inside).tolist()
            ]
    given = points + rng.normal(size=points.shape) * SIGMA
    corners = {0, 8, n - 9, n - 1}
    control = [
        ControlPoint(f"p{p}", tuple(given[p].tolist()), (SIGMA,) * 3,
                     "control" if p in corners else "check")
        for p in sorted(corners | set(range(2, n, 5)))
    ]  # fmt: skip
    return Block(
        "dome", Precision(image_um=3.0), TestSettings(kind="baarda"), (own,),
        photos=tuple(photos), strips=(), image_points=tuple(rows), control=tuple(control),
    )  # fmt: skip


def bend_of(block, weights: np.ndarray, points: tuple[str, ...]) -> float:
    at = {name: k for k, name in enumerate(block.problem.points)}
    heights = np.array([block.state.points[at[name], 2] for name in points])
    return float(weights @ (heights + block.state.origin[2]))


@pytest.mark.slow
def test_the_bend_of_one_deviation_is_that_of_an_adjustment_with_it() -> None:
    block = flown(TRUE)
    free = anaplot.adjust(block, calibrate="k1").result.block
    found = doming(free)
    assert found is not None
    assert not found.held
    assert found.names == (("cam", "k1"),)
    radius, weights = bend_weights(free.state.points)
    assert found.radius == radius
    row = free.parameter_rows()[0]
    value, s = 0.02 + row.coefficient, row.s_coefficient
    bends = []
    for step in (-0.02, 0.02):
        text = f"k1={value + step * s!r}"
        held = anaplot.adjust(block, calibrate=text, calibrate_sigma="k1=0").result.block
        bends.append(bend_of(held, weights, free.problem.points))
    assert found.calibration == pytest.approx(abs(bends[1] - bends[0]) / 0.04, rel=1e-3)
    assert found.worst == pytest.approx((np.sign(bends[1] - bends[0]),))
    # a longer way to all of it: from the cofactors of every height with every other
    q = coordinate_cofactors(free, [(k, 2) for k in range(len(free.problem.points))])
    assert found.bend == pytest.approx(free.sigma * np.sqrt(weights @ q @ weights), rel=1e-9)
    assert found.calibration < found.bend


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_wrong_lens_that_is_held_is_told_by_what_it_does_to_check_points(seed: int) -> None:
    stated = BrownLens(k1=0.0195)
    result = anaplot.adjust(flown(stated, seed=seed))
    found = doming(result.result.block)
    assert found is not None
    assert found.held
    check = {one.use: one for one in found.differences}["check"]
    assert check.bent
    why = check.explained
    assert (why.camera, why.name) == ("cam", "k1")
    assert abs(why.change - 0.0005) < 4.0 * why.s
    assert why.s < 1e-4
    assert why.left < 0.1 * check.rms
    # photographs of flat ground from one height have nothing against it
    assert why.photographs == "do not contradict"
    answer = result.to_dict()["doming"]
    assert answer["held"]
    assert answer["differences"][1]["explained"]["change"] == why.change
    kinds = [one["kind"] for one in answer["flights"]]
    assert kinds[0] == "as it is"
    assert set(kinds[1:]) == {"across", "higher", "oblique", "control in the middle"}
    assert "do not contradict" in result.text()


@pytest.mark.slow
def test_tilted_photographs_say_the_same_of_a_wrong_lens_and_contradict_wrong_heights() -> None:
    found = doming(anaplot.adjust(flown(BrownLens(k1=0.019), tilt=0.2)).result.block)
    why = found.differences[1].explained
    assert why.photographs == "say the same"
    assert why.change == pytest.approx(0.001, rel=0.05)
    [k1, _] = found.freed
    assert k1.change == pytest.approx(0.001, rel=0.05)
    # check heights that were bent by 0.8 m before they were given
    block = flown(TRUE, tilt=0.2)
    middle = np.mean([row.xyz for row in block.control], axis=0)[:2]
    bent = tuple(
        replace(row, xyz=(*row.xyz[:2], row.xyz[2] - 0.8 * float(
            ((np.array(row.xyz[:2]) - middle) ** 2).sum()) / 1700.0**2))
        if row.use == "check" else row
        for row in block.control
    )  # fmt: skip
    found = doming(adjust_block(replace(block, control=bent)))
    why = found.differences[1].explained
    assert why.photographs == "contradict"
    assert "the photographs contradict" in anaplot.adjust(replace(block, control=bent)).text()


@pytest.mark.slow
def test_the_right_lens_bends_nothing_and_no_flight_is_asked_for() -> None:
    result = anaplot.adjust(flown(TRUE))
    answer = result.to_dict()["doming"]
    assert answer["flights"] == []
    check = answer["differences"][1]
    # 4 standard deviations
    assert abs(check["bend"]["size"]) < 4.0 * check["bend"]["s"]
    assert check["explained"] is None


@pytest.mark.slow
def test_a_flight_is_worth_what_the_adjustment_with_it_says() -> None:
    block = flown(TRUE)
    answer = anaplot.adjust(block, calibrate="c,k1,k2").to_dict()["doming"]
    assert answer["calibration"] > 1.0  # metres: images of flat ground leave it open
    flights = {one["kind"]: one for one in answer["flights"]}
    assert flights["as it is"]["bend"] == pytest.approx(answer["calibration"])
    middle = flights["control in the middle"]
    more = next(row for row in block.control if row.point != middle["point"])
    found = {row["point"]: row for row in anaplot.adjust(block).to_dict()["points"]}
    there = found[middle["point"]]
    others = tuple(row for row in block.control if row.point != middle["point"])
    mine = ControlPoint(middle["point"], (there["X"], there["Y"], there["Z"]), more.sigma)
    with_it = anaplot.adjust(
        replace(block, control=(*others, mine)), calibrate="c,k1,k2"
    ).to_dict()["doming"]  # fmt: skip
    assert with_it["calibration"] == pytest.approx(middle["bend"], rel=0.02)
    # what determines the lens by photographs: other inclinations, c by these alone
    assert flights["oblique"]["bend"] < 0.1 * answer["calibration"]
    assert flights["oblique"]["s"][0] < 0.1 * flights["as it is"]["s"][0]
    assert flights["across"]["bend"] > 0.5 * answer["calibration"]
    bends = [one["bend"] for one in answer["flights"][1:]]
    assert bends == sorted(bends)
    assert len(flights["oblique"]["photos"]) == 3


@pytest.mark.slow
def test_what_the_free_calibration_leaves_open_explains_check_points() -> None:
    answer = anaplot.adjust(flown(TRUE, seed=3), calibrate="k1,k2").to_dict()["doming"]
    check = answer["differences"][1]
    assert check["calibration"] > 0.9 * check["expected"] > 5.0 * SIGMA
    assert check["explained"]["left"] < 2.0 * SIGMA
    assert check["explained"]["name"] is None


@pytest.mark.slow
def test_nothing_is_said_where_nothing_is_asked() -> None:
    block = flown(None)
    assert doming(adjust_block(block)) is None
    assert "doming" not in anaplot.adjust(block).to_dict()
    assert doming(anaplot.adjust(block, additional="ebner:b1,b3").result.block) is None
    assert doming(anaplot.adjust(block, calibrate="p1,p2").result.block) is None
    stated = flown(TRUE)
    assert doming(adjust_block(stated, datum="free")) is None
    flat = tuple(replace(row, xyz=(*row.xyz[:2], None)) for row in stated.control)
    kept = [row.xyz[2] for row in stated.control if row.use == "control"]
    back = tuple(
        replace(row, xyz=(*row.xyz[:2], kept.pop(0))) if row.use == "control" else row
        for row in flat
    )
    few = doming(adjust_block(replace(stated, control=back)))
    # four heights of control: a bend needs six
    assert [one.bend for one in few.differences] == [None]


def test_places_on_a_line_or_a_circle_have_no_bend() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 9)[:-1]
    circle = np.column_stack((np.cos(angle), np.sin(angle), angle))
    assert bend_weights(100.0 * circle)[1] is None
    line = np.column_stack((np.arange(8.0), 2.0 * np.arange(8.0), np.zeros(8)))
    assert bend_weights(line)[1] is None
    # a dome of 2 m on a leaning plane is a bend of 2 m
    xy = np.random.default_rng(1).uniform(-50.0, 80.0, (40, 2))
    radius, weights = bend_weights(xy)
    square = ((xy - xy.mean(axis=0)) ** 2).sum(axis=1)
    heights = 5.0 + 0.01 * xy[:, 0] - 0.2 * xy[:, 1] - 2.0 * square / radius**2
    assert weights @ heights == pytest.approx(2.0)


@pytest.mark.slow
def test_flights_have_the_weights_that_were_estimated() -> None:
    """Images eight times as wrong as stated, and control a fifth: the same as stated rightly."""
    block = flown(TRUE)
    control = tuple(replace(row, use="control") for row in block.control)
    right = replace(block, control=control)
    wrong = replace(
        right,
        precision=replace(block.precision, image_um=3.0 / 8.0),
        control=tuple(replace(row, sigma=(5.0 * SIGMA,) * 3) for row in control),
    )
    one, other = (
        anaplot.adjust(stated, calibrate="c,k1,k2", prior="separate").result.block
        for stated in (right, wrong)
    )
    mine, its = (doming_flights(doming(each), each.sigma) for each in (one, other))
    assert len(mine) == 5
    assert [flight.kind for flight in its] == [flight.kind for flight in mine]
    assert [flight.bend for flight in its] == pytest.approx([flight.bend for flight in mine], 1e-3)
    for this, that in zip(mine, its, strict=True):
        assert that.s == pytest.approx(this.s, rel=1e-3)


@pytest.mark.slow
def test_flights_are_without_what_was_rejected() -> None:
    block = flown(TRUE, tilt=0.05)
    control = [replace(row, use="control") for row in block.control[:12]]
    off = control[5]
    control[5] = replace(off, xyz=(*off.xyz[:2], off.xyz[2] + 5.0))
    found = anaplot.adjust(
        replace(block, control=tuple(control)), calibrate="c,k1,k2", errors="search"
    ).result
    assert [one.name for one in found.rejected] == [("control", off.point, "Z")]
    control[5] = replace(off, xyz=(*off.xyz[:2], None))
    bare = anaplot.adjust(replace(block, control=tuple(control)), calibrate="c,k1,k2").result
    mine, its = (
        doming_flights(doming(one.block), one.block.sigma) for one in (found, bare)
    )  # fmt: skip
    assert len(mine) == 5
    assert [flight.kind for flight in its] == [flight.kind for flight in mine]
    assert [flight.bend for flight in its] == pytest.approx([flight.bend for flight in mine], 1e-6)


@pytest.mark.slow
def test_a_point_of_parallel_rays_ends_neither_calibration_nor_flights() -> None:
    block = flown(TRUE, tilt=0.0)
    sky = tuple(ImagePoint(photo, "sky", 20.0, 10.0) for photo in ("101", "102", "103"))
    rows = (*block.image_points, *sky)
    result = anaplot.adjust(replace(block, image_points=rows), calibrate="k1,k2")
    assert result.result.block.problem.undetermined == {"sky": NO_ANGLE}
    answers = (
        one.to_dict()["doming"] for one in (result, anaplot.adjust(block, calibrate="k1,k2"))
    )
    mine, its = ([one["bend"] for one in answer["flights"]] for answer in answers)
    assert len(mine) == 5
    assert mine == pytest.approx(its, rel=1e-4)
