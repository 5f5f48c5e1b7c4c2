"""Points that are named otherwise in an epoch: they seem to have moved to each other's places."""

from __future__ import annotations

from dataclasses import replace

import pytest
from epochblocks import epoch, stable_names

from anaplot.bundle.epochs.displacements import compare_epochs, compare_series
from anaplot.bundle.epochs.displacementtests import epoch_tests
from anaplot.bundle.epochs.seriestests import series_tests

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


def test_movements_are_none() -> None:
    moved = dict.fromkeys(("p8", "p9", "p13"), (0.0, 3.0, 8.0))
    for last in (epoch(12), epoch(12, moved=moved)):
        assert not told(epoch_tests(compare_epochs(epoch(11), last)).remarks)
