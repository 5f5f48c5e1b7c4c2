"""Control and stated positions that contradict each other: the photos tell which is wrong."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from gnssblocks import flown

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.errors.grosserrors import block_gross_errors
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.prioroffsets import PriorOffsets

pytestmark = pytest.mark.slow

Place = tuple[float, float, float]


@pytest.fixture(scope="module")
def block() -> Block:
    """Two strips with positions of 5 cm, and control."""
    return flown(PriorOffsets(), seed=8, angles=False).scene.block


def positions(block: Block, changed: Callable[[Place], Place]) -> Block:
    photos = tuple(replace(one, position=changed(one.position)) for one in block.photos)
    return replace(block, photos=photos)


def control(block: Block, changed: Callable[[Place], Place]) -> Block:
    points = tuple(replace(one, xyz=changed(one.xyz)) for one in block.control)
    return replace(block, control=points)


def told(block: Block) -> str:
    """Return what `adjust` says, adjusted or not."""
    try:
        return " ".join(adjust_block(block).warnings)
    except NotComputableError as error:
        return str(error)


WRONG: dict[str, Callable[[Place], Place]] = {
    "X and Y exchanged": lambda at: (at[1], at[0], at[2]),
    "east in feet": lambda at: (at[0] / 0.3048, at[1], at[2]),
}


@pytest.mark.parametrize("how", WRONG)
def test_positions_that_the_photos_do_not_agree_with_are_named(block: Block, how: str) -> None:
    said = told(positions(block, WRONG[how]))
    assert "the photos agree with control to 0." in said
    assert re.search(
        r"and with stated positions (to [\d.e+]+ m|looking up) only: are these in", said
    )


def test_control_that_the_photos_do_not_agree_with_is_named(block: Block) -> None:
    said = told(control(block, WRONG["east in feet"]))
    assert "the photos agree with stated positions to 0." in said
    assert "and with control to " in said
    assert "only: is that in another unit or system" in said


def test_what_lies_elsewhere_as_a_whole_is_an_offset(block: Block) -> None:
    shift = np.array((0.0, 0.0, 48.0))
    moved = positions(block, lambda at: tuple((np.array(at) + shift).tolist()))
    assert "stated positions" not in told(moved)


def test_a_search_that_ends_on_the_wrong_ones_says_so(block: Block) -> None:
    wrong = positions(block, WRONG["east in feet"])
    try:
        said = " ".join(block_gross_errors(wrong, "search").remarks)
    except NotComputableError as error:
        said = str(error)
    assert "the photos agree with control to 0." in said


def test_what_is_right_is_not_doubted(block: Block) -> None:
    assert told(block) == ""
