"""Rays of other programs: twice in a photo, outside, and behind the lens's fold."""

from __future__ import annotations

import numpy as np
import pytest

from anaplot.exchange.formats.measuredrays import TWICE, MeasuredRay, image_points_of
from anaplot.photogrammetry.block import Camera, in_pixels
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.measuredimage import measured_rays, pixels_of_mm

PLAIN = in_pixels(Camera("p", 2.0), (2000, 1000))
BENT = in_pixels(Camera("b", 2.0, lens=BrownLens(k1=-0.9)), (4000, 3000), None, (2001.0, 1490.0))


def test_pixels_become_rays_through_their_own_cameras() -> None:
    cameras = {"1": PLAIN, "2": BENT}
    rays = [
        MeasuredRay("1", "a", 1000.0, 500.0),
        MeasuredRay("2", "a", 2200.5, 1400.25, 3.0, "x", "blurred"),
    ]
    points, notes = image_points_of(rays, cameras, pixels=True)
    assert not notes
    assert (points[0].x, points[0].y) == (0.0, 0.0)
    assert points[1].measured == (2200.5, 1400.25)
    back = pixels_of_mm(BENT, measured_rays(BENT, [(points[1].x, points[1].y)]))
    np.testing.assert_allclose(back, [(2200.5, 1400.25)], atol=1e-9)
    assert (points[1].sigma_um, points[1].use, points[1].reason) == (3.0, "x", "blurred")


def test_what_stands_twice_is_kept_and_does_not_count() -> None:
    names = ("a", "a", "a~2", "a", "b")
    rays = [MeasuredRay("1", name, 10.0 * k, 20.0) for k, name in enumerate(names)]
    points, notes = image_points_of(rays, {"1": PLAIN}, pixels=True)
    assert [point.point for point in points] == ["a", "a~3", "a~2", "a~4", "b"]
    assert [point.use for point in points] == ["xy", "off", "xy", "off", "xy"]
    assert points[1].reason == TWICE
    assert [(note.what, note.count) for note in notes] == [("doubled", 2)]


@pytest.mark.parametrize(("x", "y"), [(1e308, 5.0), (-0.6, 5.0), (5.0, 1000.6)])
def test_rays_outside_are_left_out_and_told(x: float, y: float) -> None:
    rays = [MeasuredRay("1", "a", x, y), MeasuredRay("1", "b", -0.5, 1000.5)]
    points, notes = image_points_of(rays, {"1": PLAIN}, pixels=True)
    assert [point.point for point in points] == ["b"]
    assert notes[0].count == 1
    assert "outside" in notes[0].text


def test_rays_behind_the_fold_are_left_out_and_told() -> None:
    rays = [MeasuredRay("2", "a", 10.0, 10.0), MeasuredRay("2", "b", 2000.0, 1500.0)]
    points, notes = image_points_of(rays, {"2": BENT}, pixels=True)
    assert [point.point for point in points] == ["b"]
    assert "images nothing" in notes[0].text


def test_mm_are_ideal_where_there_is_no_lens() -> None:
    points, _ = image_points_of(
        [MeasuredRay("1", "a", 0.5, -0.25)], {"1": Camera("c", 2.0)}, pixels=False
    )
    assert points[0].measured is None
    assert (points[0].x, points[0].y) == (0.5, -0.25)


def test_a_name_that_is_made_is_in_nobodys_way() -> None:
    names = ["a", "a~2", "a", "a", "b", "a~2", "gone", "gone"]
    places = [(float(k + 1), 5.0) for k in range(6)] + [(-5.0, 5.0), (9.0, 5.0)]
    rays = [MeasuredRay("1", name, *at) for name, at in zip(names, places, strict=True)]
    rays.append(MeasuredRay("2", "a", 3.0, 5.0))  # in another photo it stands once
    points, notes = image_points_of(rays, {"1": PLAIN, "2": PLAIN}, pixels=True)
    assert [row.point for row in points] == [
        *("a", "a~2", "a~3", "a~4", "b", "a~2~2", "gone", "a"),
    ]
    assert [row.use for row in points] == ["xy", "xy", "off", "off", "xy", "off", "xy", "xy"]
    assert [row.reason for row in points if row.use == "off"] == [TWICE] * 3
    assert [(note.what, note.count) for note in notes] == [("dropped", 1), ("doubled", 3)]
