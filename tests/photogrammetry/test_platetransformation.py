"""Plate transformations: inverse, derivatives, how a photograph lies on the plate."""

from math import atan2, cos, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anaplot.errors import NotComputableError
from anaplot.photogrammetry.platetransformation import (
    TITLES,
    TRANSFORMATIONS,
    Placement,
    PlateTransformation,
    random_placement,
)

small = st.floats(-1e-3, 1e-3)
places = st.lists(
    st.tuples(st.floats(-160.0, 160.0), st.floats(-160.0, 160.0)), min_size=1, max_size=8
).map(np.array)


@st.composite
def transformations(draw):
    """Any film that an instrument has ever held, however it lies."""
    side = draw(st.sampled_from((1.0, -1.0)))
    angle = draw(st.floats(-pi, pi))
    scale = draw(st.floats(0.98, 1.02)) / 110.0
    c, s = scale * cos(angle), scale * sin(angle)
    reach = 110.0
    product = draw(st.sampled_from((0.0, 1.0)))
    row_x = (draw(small) * reach, reach * (1.0 + draw(small)), reach * draw(small))
    row_y = (draw(small) * reach, reach * draw(small), reach * (1.0 + draw(small)))
    return PlateTransformation(
        "bilinear" if product else "projective",
        (
            (draw(st.floats(-2.0, 2.0)), c, -s),
            (draw(st.floats(-2.0, 2.0)), side * s, side * c),
        ),
        ((*row_x, product * draw(small) * reach), (*row_y, product * draw(small) * reach)),
        ((1.0 - product) * draw(small), (1.0 - product) * draw(small)),
    )


@given(transformations(), places)
def test_to_plate_is_the_inverse_of_to_image(transformation, image):
    plate = transformation.to_plate(image)
    assert np.abs(transformation.to_image(plate) - image).max() < 1e-9
    assert np.abs(transformation.to_plate(transformation.to_image(plate)) - plate).max() < 1e-9


@given(transformations(), places)
def test_derivatives_against_differences(transformation, plate):
    h = 1e-3
    exact = transformation.jacobian(plate)
    for axis in range(2):
        step = np.zeros(2)
        step[axis] = h
        slope = transformation.to_image(plate + step) - transformation.to_image(plate - step)
        assert exact[:, :, axis] == pytest.approx(slope / (2 * h), abs=1e-8)
    image = transformation.to_image(plate)
    identity = transformation.form.inverse_jacobian(image) @ exact
    assert np.abs(identity - np.eye(2)).max() < 1e-9


@given(places)
def test_the_default_is_the_identity(points):
    identity = PlateTransformation()
    assert identity.kind == "identity"
    assert (identity.to_image(points) == points).all()
    assert (identity.to_plate(points) == points).all()
    assert (identity.jacobian(points) == np.eye(2)).all()
    assert identity.placement() == Placement(0.0, 0.0)


def test_no_points_at_all():
    none = np.zeros((0, 2))
    assert PlateTransformation().to_image(none).shape == (0, 2)
    assert PlateTransformation().to_plate(none).shape == (0, 2)
    for wrong in (np.zeros(2), np.zeros((2, 3))):
        with pytest.raises(ValueError, match="shape"):
            PlateTransformation().to_image(wrong)


placements = st.builds(
    Placement,
    st.floats(-500.0, 500.0),
    st.floats(-500.0, 500.0),
    st.floats(-3.14, 3.14),
    st.floats(-0.1, 0.1),
    st.floats(0.9, 1.1),
    st.floats(0.9, 1.1),
    st.booleans(),
)


@given(placements)
def test_a_placement_comes_back_from_its_transformation(placement):
    found = placement.transformation().placement()
    assert found[:6] == pytest.approx(placement[:6], abs=1e-9)
    assert found.mirrored == placement.mirrored


@given(placements)
def test_a_placement_means_what_it_says(placement):
    """A millimetre along the photograph's axes, walked on the plate."""
    to_plate = placement.transformation().to_plate
    origin, along_x, along_y = to_plate(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    assert origin == pytest.approx((placement.x, placement.y), abs=1e-9)
    x, y = along_x - origin, along_y - origin
    assert np.hypot(*x) == pytest.approx(placement.scale_x, abs=1e-9)
    assert np.hypot(*y) == pytest.approx(placement.scale_y, abs=1e-9)
    assert atan2(x[1], x[0]) == pytest.approx(placement.rotation, abs=1e-9)
    assert (x[0] * y[1] - x[1] * y[0] < 0.0) == placement.mirrored
    cosine = float(x @ y) / (np.hypot(*x) * np.hypot(*y))
    assert -cosine == pytest.approx(sin(placement.shear), abs=1e-9)
    shrunk = placement.shrinkage_ppm
    assert shrunk == pytest.approx(
        ((1 - placement.scale_x) * 1e6, (1 - placement.scale_y) * 1e6), abs=1e-6
    )


def test_a_laid_plate_is_the_same_for_the_same_seed_and_within_its_bounds():
    laid = [random_placement(seed) for seed in range(50)]
    assert random_placement(7) == laid[7]
    assert len(set(laid)) == 50
    for transformation in laid:
        place = transformation.placement()
        assert max(abs(place.x), abs(place.y)) <= 2.0
        assert abs(place.rotation) <= 0.02
        assert max(abs(ppm) for ppm in place.shrinkage_ppm) <= 500.0 * (1.0 + 1e-6)
        assert abs(place.shear) < 1e-12
        assert not place.mirrored


def test_what_is_no_transformation():
    with pytest.raises(ValueError, match="folds"):
        PlateTransformation(frame=((0.0, 1.0, 1.0), (0.0, 1.0, 1.0)))
    with pytest.raises(ValueError, match="finite"):
        PlateTransformation(denominator=(float("nan"), 0.0))
    for scale_x, shear in ((0.0, 0.0), (-1.0, 0.0), (1.0, pi / 2)):
        with pytest.raises(ValueError, match="placement"):
            Placement(0.0, 0.0, shear=shear, scale_x=scale_x).transformation()


def test_a_place_that_nothing_maps_to():
    vanishing = PlateTransformation("projective", denominator=(0.5, 0.0))
    assert not np.isfinite(vanishing.to_image(np.array([[-2.0, 1.0]]))).any()
    with pytest.raises(NotComputableError, match=r"no place on the plate .* x = 2, y = 1"):
        vanishing.to_plate(np.array([[0.0, 0.0], [2.0, 1.0]]))
    folded = PlateTransformation("bilinear", numerator=((0, 1, 0, 0), (0, 0, 1, 1)))
    with pytest.raises(NotComputableError, match="x = -1"):
        folded.to_plate(np.array([[-1.0, 5.0]]))


def test_every_transformation_has_a_title():
    assert set(TITLES) == {*TRANSFORMATIONS, "identity"}
