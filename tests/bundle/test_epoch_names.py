"""Points that are named otherwise in an epoch: they seem to have moved to each other's places."""

from __future__ import annotations

from dataclasses import replace

import pytest
from epochblocks import compare_epochs, epoch, stable_names

from anaplot.bundle.epochs.common import stable_points
from anaplot.bundle.epochs.displacements import compare_series
from anaplot.bundle.epochs.displacementtests import epoch_tests
from anaplot.bundle.epochs.moves import chosen_points
from anaplot.bundle.epochs.seriestests import series_tests
from anaplot.errors import InputError

EXCHANGED = {"p8": "p13", "p13": "p8"}
SHIFTED = {"p8": "p9", "p9": "p12", "p12": "p8"}


def renamed(block, names):
    rows = (replace(row, point=names.get(row.point, row.point)) for row in block.image_points)
    return replace(block, image_points=tuple(rows))


def told(remarks):
    return [remark for remark in remarks if "named otherwise" in remark]


@pytest.mark.parametrize("options", [{}, {"separate": True}, {"stable": stable_names()}])
@pytest.mark.parametrize("names", [EXCHANGED, SHIFTED])
def test_names_that_are_exchanged_are_told(names, options) -> None:
    blocks = (epoch(11), renamed(epoch(12), names))
    [said] = told(epoch_tests(compare_epochs(*blocks, **options)).remarks)
    for old, new in names.items():
        # what was called so before lies there now
        assert f"{new} where {old} was" in said
    assert said.startswith("in epoch 2 points lie where others were in epoch 1 (")


def test_once_in_a_series() -> None:
    blocks = (epoch(11), renamed(epoch(12), EXCHANGED), epoch(13))
    assert len(told(series_tests(compare_series(blocks)).remarks)) == 1


def seen_once(block, names):
    """Leave one ray of some points."""
    seen = set()
    rows = []
    for row in block.image_points:
        if row.point not in names or row.point not in seen:
            rows.append(row)
        seen.add(row.point)
    return replace(block, image_points=tuple(rows))


def test_a_point_that_an_epoch_does_not_determine_is_told_why() -> None:
    first, last = epoch(11), epoch(12)
    once = "in epoch 2 it has one ray only"
    for options, said in (
        ({"points": ("p8",)}, f"^point p8 is not in both epochs: {once}$"),
        ({"stable": ("p1", "p5", "p8")}, "^stable points that epoch 2 does not have: p8 .it has"),
    ):
        with pytest.raises(InputError, match=said):
            compare_epochs(first, seen_once(last, {"p8"}), **options)
    out = ({}, {"p8": "has one ray only", "p13": "has one ray only"})
    said = "in epoch 2 point p8 has one ray only (2 such points)"
    for names, why in (
        ([["p1", "p8"], ["p1"]], "every point that is common to both epochs holds the datum (p1)"),
        ([["p8"], ["p1"]], "the two epochs have no point in common"),
    ):
        with pytest.raises(InputError) as refused:
            chosen_points(names, stable_points(["p1"], 2), (), out)
        assert str(refused.value).endswith(f"{why}: {said}")


def test_movements_are_none() -> None:
    moved = dict.fromkeys(("p8", "p9", "p13"), (0.0, 3.0, 8.0))
    for last in (epoch(12), epoch(12, moved=moved)):
        assert not told(epoch_tests(compare_epochs(epoch(11), last)).remarks)
