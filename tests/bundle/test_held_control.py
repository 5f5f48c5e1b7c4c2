"""Control that has moved itself: the epochs by themselves, without any of it, tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from epochblocks import compare_epochs, epoch, heights_only, written

from anaplot.bundle.epochs.displacements import compare_series
from anaplot.bundle.epochs.displacementtests import epoch_tests
from anaplot.bundle.epochs.seriestests import series_tests
from anaplot.cli import main
from anaplot.photogrammetry.block import TestSettings

BAARDA = TestSettings(kind="baarda")
AWAY = {"p5": (0.0, 1.2, 0.0)}


def free_of_error(block):
    control = tuple(replace(row, sigma=(0.0, 0.0, 0.0)) for row in block.control)
    return replace(block, control=control)


def as_they_are(block):
    return block


@pytest.mark.parametrize("kind", [as_they_are, free_of_error])
@pytest.mark.parametrize("separate", [False, True])
def test_control_that_has_moved_is_named(kind, separate) -> None:
    first, second = kind(epoch(11)), kind(epoch(12, moved=AWAY))
    tested = epoch_tests(compare_epochs(first, second, points=("p8",), separate=separate))
    assert tested.agreement.rejected
    assert tested.any_moved
    assert [step.point for step in tested.located_stable] == ["p5"]
    [said] = [remark for remark in tested.remarks if "the common control has moved" in remark]
    assert "(p5)" in said
    assert "let others hold it (--stable)" in said


def test_in_a_later_epoch_too() -> None:
    blocks = [epoch(11), epoch(12), epoch(13, moved=AWAY)]
    tested = series_tests(compare_series(blocks, points=("p8",)))
    assert tested.agreement.rejected
    assert [step.point for step in tested.located_stable] == ["p5"]
    assert "common control" in tested.overall.families


@pytest.mark.slow
def test_control_that_stays_agrees_at_alpha() -> None:
    runs, alpha, square, rejected = 40, 0.2, 0.0, 0
    for k in range(runs):
        pair = (epoch(300 + 2 * k, test=BAARDA), epoch(301 + 2 * k, test=BAARDA))
        found = compare_epochs(*pair, points=("p8",))
        assert found.agreement is not None
        assert found.agreement.dimension == 3 * len(found.agreement.points) - 7
        square += found.agreement.square
        rejected += bool(epoch_tests(found, alpha=alpha).agreement.rejected)
    # chi-square of all dimensions together, and the binomial count: within 3.3 deviations
    dimension = runs * found.agreement.dimension
    assert abs(square - dimension) < 3.3 * np.sqrt(2 * dimension)
    assert abs(rejected - alpha * runs) < 3.3 * np.sqrt(runs * alpha * (1.0 - alpha))


@pytest.mark.parametrize(("names", "there"), [(("p1", "p5", "p31"), True), (("p1", "p5"), False)])
def test_two_points_do_not_check_each_other(names, there) -> None:
    first, second = epoch(11), epoch(12)
    few = replace(second, control=tuple(row for row in second.control if row.point in names))
    agreement = compare_epochs(first, heights_only(few, "p13"), points=("p8",)).agreement
    assert (agreement is not None) is there
    # not the height that one epoch alone has
    assert agreement is None or agreement.points == names


def test_control_that_was_surveyed_anew_may_have_moved() -> None:
    by = np.array([0.0, 0.05, 0.02])  # within what its sigmas allow
    second = epoch(12, moved={"p5": tuple(by)})
    control = tuple(
        replace(row, xyz=tuple(map(float, np.array(row.xyz) + by))) if row.point == "p5" else row
        for row in second.control
    )
    found = compare_epochs(
        epoch(11), replace(second, control=control), points=("p8",), separate=True
    )
    assert found.agreement.points == ("p1", "p3", "p31", "p33", "p35")


def test_the_command_says_so(tmp_path, capsys) -> None:
    one, two = written(tmp_path, epoch(11), epoch(12, moved=AWAY))[:2]
    assert main(["compare", one, two, "--fail-on-flag"]) == 1
    page = capsys.readouterr().out
    [line] = [row for row in page.splitlines() if "the common control has not moved" in row]
    assert line.endswith("<< REJECTED")
    assert "explain it, one after the other until the rest is accepted: p5" in page


def with_wrong_ray(block, point, photo, **by):
    rows = [
        replace(row, **{axis: getattr(row, axis) + mm for axis, mm in by.items()})
        if (row.photo, row.point) == (photo, point)
        else row
        for row in block.image_points
    ]
    assert tuple(rows) != block.image_points
    return replace(block, image_points=tuple(rows))


@pytest.mark.parametrize(
    ("point", "photo", "by"),
    [("p3", "101", {"y": 0.2}), ("p33", "201", {"y": 2.0}), ("p5", "102", {"y": 0.2})],
)
def test_a_wrong_ray_of_control_is_no_movement_of_it(point, photo, by) -> None:
    second = with_wrong_ray(epoch(12), point, photo, **by)
    found = compare_epochs(epoch(11), second, points=("p8",))
    assert point not in found.agreement.points
    tested = epoch_tests(found)
    assert not tested.agreement.rejected
    said = " ".join(tested.remarks)
    assert f"of point {point} in photo {photo}" in said
    assert "control has moved" not in said


def test_control_that_has_moved_is_named_beside_a_wrong_ray() -> None:
    second = with_wrong_ray(epoch(12, moved=AWAY), "p8", "102", y=0.5)
    tested = epoch_tests(compare_epochs(epoch(11), second, points=("p9",)))
    assert [step.point for step in tested.located_stable] == ["p5"]
