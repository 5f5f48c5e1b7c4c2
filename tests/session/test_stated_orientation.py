"""Points of other strips and of the ground are driven to by stated exterior orientations."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import radians

import numpy as np
import pytest
from transferscene import flown, second_strip_begun

from anaplot.photogrammetry.block import Block, ControlPoint, ImagePoint
from anaplot.report.adjustcommand import adjust
from anaplot.session.state import SessionState, start
from anaplot.session.statedorientation import seen_by_stated, stated_control, stated_points
from anaplot.session.tiecheck import GROUND, Known
from anaplot.session.transfer import transfer

SIGMA_M, SIGMA_RAD = 1.0, radians(0.05)


@cache
def orientations(seed: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """The true exterior orientations of a block: positions [m] and angles [rad]."""
    made = flown(seed)
    rows = tuple(
        ImagePoint(photo, point, *xy)
        for photo, seen in made.truth.items()
        for point, xy in seen.items()
    )
    control = tuple(
        ControlPoint(name, tuple(xyz.tolist()), (0.0, 0.0, 0.0))
        for name, xyz in made.ground.items()
    )
    found = adjust(replace(made.block, image_points=rows, control=control)).to_dict()
    return {
        one["photo"]: (
            np.array([one["X"], one["Y"], one["Z"]]),
            np.array([one["omega"], one["phi"], one["kappa"]]),
        )
        for one in found["photos"]
    }


def stated(seed: int, noise: int, *, sigmas: bool = True) -> Block:
    """The block whose photos state what a navigation says."""
    made = flown(seed)
    rng = np.random.default_rng([noise, 7])
    photos = tuple(
        replace(
            photo,
            position=tuple((at + rng.normal(0.0, SIGMA_M, 3)).tolist()),
            rotation=tuple((turn + rng.normal(0.0, SIGMA_RAD, 3)).tolist()),
            position_sigma=(SIGMA_M,) * 3 if sigmas else None,
            rotation_sigma=(SIGMA_RAD,) * 3 if sigmas else None,
        )
        for photo in made.block.photos
        for at, turn in [orientations(seed)[photo.id]]
    )
    return replace(made.block, photos=photos)


def begun(block: Block, seed: int) -> SessionState:
    """The first strip accepted; of the second one's first model nothing is measured."""
    state = second_strip_begun(flown(seed))
    nothing = replace(state.current, plan=(), measured=())
    return replace(state, block=start(block).block, current=nothing)


@pytest.mark.slow
@pytest.mark.parametrize("sigmas", [True, False])
def test_what_is_due_is_offered_before_anything_is_measured(sigmas: bool) -> None:
    made = flown(1)
    block = stated(1, 1, sigmas=sigmas)
    state = begun(block, 1)
    known = Known.of(block.control, None)
    found = transfer(state, known)
    sources = {(o.mark, o.source) for o in found.offers}
    # without standard deviations too little is believed of a point that two photos show
    assert sources == {("control", GROUND), *([("lateral", "1")] if sigmas else [])}
    for offer in found.offers:
        at = offer.planned
        left, right = (made.truth[photo][at.point] for photo in state.current.photos)
        error = np.array([at.xl, at.yl, at.xr, at.yr]) - [*left, *right]
        assert offer.sigma is not None
        assert np.abs(error).max() < 4.5 * offer.sigma
    # without any, nothing can be offered
    assert transfer(begun(made.block, 1), Known.of(block.control, None)).offers == ()


@pytest.mark.slow
def test_predictions_err_as_they_say() -> None:
    made = flown(1)
    w = []
    for noise in range(40):
        block = stated(1, noise)
        state = begun(block, 1)
        points = stated_points(block, state.models)
        for name, at, sigma, source in seen_by_stated(block, state.current, points):
            assert source == "1"
            if all(name in made.truth[photo] for photo in state.current.photos):
                left, right = (made.truth[photo][name] for photo in state.current.photos)
                w.append(np.abs(np.array(at) - [*left, *right]).max() / sigma)
    assert len(w) >= 80
    # sigma is the largest of four: hardly any error is 4.5 of it, on the average about one
    assert max(w) < 4.5
    assert 0.6 < np.mean(w) < 1.6


def test_photos_without_it_say_nothing() -> None:
    made = flown(1)
    state = second_strip_begun(made)
    assert stated_points(made.block, state.models) == {}
    half = replace(
        made.block,
        photos=tuple(replace(p, position=(0.0, 0.0, 1500.0)) for p in made.block.photos),
    )
    assert stated_points(half, state.models) == {}


def test_control_of_which_a_coordinate_is_not_known_shows_no_place() -> None:
    block = flown(1).block
    control = [
        ControlPoint("height", (None, None, 10.0), (None, None, 0.02)),
        ControlPoint("plan", (1.0, 2.0, None), (0.02, 0.02, None)),
        ControlPoint("full", (1.0, 2.0, 3.0), (0.01, 0.02, 0.03)),
    ]
    assert stated_control(block, control, GROUND) == {}  # nothing can show it
    photo = replace(block.photos[0], position=(0.0, 0.0, 1500.0), rotation=(0.0, 0.0, 0.0))
    found = stated_control(replace(block, photos=(photo,)), control, GROUND)
    assert list(found) == ["full"]
    np.testing.assert_array_equal(found["full"].xyz, (1.0, 2.0, 3.0))
    np.testing.assert_allclose(found["full"].cov, np.diag((1e-4, 4e-4, 9e-4)))
