"""Overlaps against counting places, and against what a regular flight has by construction."""

import numpy as np
import pytest

from anaplot.photogrammetry.overlap import footprints, overlap_shares
from anaplot.photogrammetry.rotation import rotation_matrix

SQUARE = np.array([[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]])


def inside(corners, places):
    """Whether places (m, 2) lie in a convex area, by its sides."""
    sides = np.roll(corners, -1, axis=0) - corners
    across = np.stack([-sides[:, 1], sides[:, 0]], axis=1)
    height = np.einsum("kj,mkj->mk", across, places[:, None] - corners)
    return (height >= 0.0).all(axis=1) | (height <= 0.0).all(axis=1)


@pytest.mark.slow
def test_shares_are_those_of_counted_places():
    rng = np.random.default_rng(3)
    steps = (np.arange(400) + 0.5) / 400
    places = np.stack(np.meshgrid(steps, steps), axis=2).reshape(-1, 2)
    corners = []
    for _ in range(30):
        turn, size = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.2, 1.5, 2)
        c, s = np.cos(turn), np.sin(turn)
        box = (SQUARE[0] - 0.5) * size @ np.array([[c, s], [-s, c]]) + rng.uniform(-0.3, 1.3, 2)
        corners.append(box[:: rng.choice([-1, 1])])
    counted = [inside(one, places).mean() for one in corners]
    assert 0.0 < min(one for one in counted if one > 0.0) < 0.2 < 0.6 < max(counted)
    shares = overlap_shares(np.repeat(SQUARE, 30, axis=0), np.array(corners))
    # a side of 2 crosses 800 of the 160 000 places' cells at most
    assert shares == pytest.approx(counted, abs=5e-3)


def test_all_none_a_corner_and_what_is_no_area():
    others = np.array([
        SQUARE[0],
        SQUARE[0] + 5.0,
        SQUARE[0] + 0.75,
        3.0 * SQUARE[0] - 1.0,
        SQUARE[0] * [1.0, 0.0],
        np.where(SQUARE[0] == [1.0, 1.0], np.nan, SQUARE[0]),
    ])  # fmt: skip
    shares = overlap_shares(np.repeat(SQUARE, 6, axis=0), others)
    assert shares[:4] == pytest.approx([1.0, 0.0, 0.0625, 1.0])
    assert np.isnan(shares[4:]).all()
    assert overlap_shares(SQUARE, SQUARE + np.array([0.4, 0.0])) == pytest.approx(0.6)


def test_the_footprint_of_a_tilted_photo_projects_back_to_the_corners_of_its_format():
    rotation = rotation_matrix(0.2, -0.1, 2.0)
    centre, through = np.array([5e5, 5e6, 2000.0]), np.array([5e5 + 300.0, 5e6, 250.0])
    normal = np.array([0.1, -0.05, 1.0])
    (found,) = footprints(
        centre[None], rotation[None], np.array([150.0]), np.array([[230.0, 180.0]]),
        through[None], normal[None],
    )  # fmt: skip
    assert (found - through) @ normal == pytest.approx(0.0, abs=1e-6)
    rays = (found - centre) @ rotation
    image = -150.0 * rays[:, :2] / rays[:, 2:]
    assert image == pytest.approx(
        np.array([(-115.0, -90.0), (115.0, -90.0), (115.0, 90.0), (-115.0, 90.0)])
    )


def test_a_photo_that_looks_past_the_plane_shows_nothing_of_it():
    level = rotation_matrix(np.pi / 2.0, 0.0, 0.0)
    found = footprints(
        np.array([[0.0, 0.0, 10.0]]), level[None], np.array([20.0]), np.array([[30.0, 20.0]]),
        np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]),
    )  # fmt: skip
    assert np.isnan(found).any()
