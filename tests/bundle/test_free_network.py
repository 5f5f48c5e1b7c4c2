"""The free network on the way to control: gross errors do not tear it."""

from __future__ import annotations

import numpy as np
import pytest
from grossblocks import mismatched, planned

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import make_problem
from anaplot.bundle.start import freenetwork
from anaplot.bundle.start.freenetwork import from_free_network


def farthest(one: BlockState, other: BlockState) -> float:
    """By how much a photo stands elsewhere at most [m]."""
    off = one.centres + one.origin - other.centres - other.origin
    return float(np.linalg.norm(off, axis=1).max())


def test_rays_of_other_points_are_not_adjusted_on_the_way(monkeypatch: pytest.MonkeyPatch) -> None:
    block = planned(2, sidelap=0.6)
    true = adjust_block(block).state

    def sought(*_: object, **__: object) -> None:
        raise AssertionError("a minimum was sought that means nothing")

    monkeypatch.setattr(freenetwork, "find_minimum", sought)
    wrong = make_problem(mismatched(block, 5, 2)[0])
    found = from_free_network(wrong, true, None)
    assert found is not None
    assert farthest(found, true) < 2.0
    with pytest.raises(AssertionError):
        from_free_network(make_problem(block), true, None)


def test_a_network_that_fits_lies_on_control_as_it_is_adjusted() -> None:
    block = planned(2, sidelap=0.6)
    true = adjust_block(block).state
    found = from_free_network(make_problem(block), true, None)
    assert found is not None
    assert farthest(found, true) < 0.5
