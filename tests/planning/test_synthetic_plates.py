"""Simulated photographs of several strips: side by side over one terrain."""

from itertools import pairwise

from syntheticblocks import synthetic_block

from anaplot.photogrammetry.block import Camera
from anaplot.planning.syntheticblock import synthetic_plates

CAMERA = Camera("rmk", 152.4, (230.0, 230.0))


def seen(truth, photos):
    return set().union(*(truth[photo] for photo in photos))


def test_neighbouring_strips_have_points_in_common():
    strips = [("101", "102", "103"), ("203", "202", "201"), ("301", "302")]
    truth = synthetic_plates(strips, CAMERA, seed=3, base=92.0)
    assert set(truth) == {photo for photos in strips for photo in photos}
    for one, other in pairwise(strips):
        assert len(seen(truth, one) & seen(truth, other)) >= 3
    assert not seen(truth, strips[0]) & seen(truth, strips[2])
    for photo, points in truth.items():
        assert all(abs(v) <= 115.0 for xy in points.values() for v in xy), photo
        # what a model needs lies in every photo
        assert len(points) >= 15
    assert not any(point.startswith("C") for point in seen(truth, truth))


def test_they_are_those_of_the_synthetic_block_without_its_control():
    made = synthetic_block(2, 4, seed=6)
    strips = [strip.photos for strip in made.block.strips]
    truth = synthetic_plates(strips, CAMERA, seed=6, base=92.0)
    control = {point.point for point in made.block.control}
    for photo, points in made.truth.items():
        assert truth[photo] == {p: xy for p, xy in points.items() if p not in control}
