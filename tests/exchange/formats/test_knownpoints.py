"""Known points tell an order of rotations, or say that they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from anaplot.exchange.formats.knownpoints import Sight, meant_order
from anaplot.photogrammetry.block import Camera, ImagePoint
from anaplot.photogrammetry.rotation import rotation_matrix

C = 100.0
TILTED = rotation_matrix(0.4, -0.3, 2.0)
AWAY = TILTED @ np.diag((-1.0, 1.0, -1.0))  # sees a line of points where it is, but behind
NAMES = [str(k) for k in range(5)]


def sight(shift: float = 0.0, y: float = 0.0) -> Sight:
    """A photo that sees five points in a line, which lie so far beside what is known."""
    xs = np.linspace(-30.0, 30.0, 5).tolist()
    rays = tuple(ImagePoint("1", name, x + shift, y) for name, x in zip(NAMES, xs, strict=True))
    ground = (np.array([(x, y, -C) for x in xs]) @ TILTED.T * 12.0 + (1e6, 2e6, 3e3)).tolist()
    points = {name: (x, y, z) for name, (x, y, z) in zip(NAMES, ground, strict=True)}
    return Sight(rays, {"1": Camera("camera", C)}, {"1": (1e6, 2e6, 3e3)}, points)


def meant(seen: Sight, stated: str | None = None, other: np.ndarray = AWAY) -> tuple[str, str]:
    ways = {"usual": {"1": other}, "right": {"1": TILTED}}
    order, why = meant_order(seen, ways, stated=stated, usual="usual")
    return order, why or ""


def test_what_lies_behind_a_photo_does_not_fit() -> None:
    order, why = meant(sight())
    assert order == "right"
    assert why.startswith("5 rays of known points miss by (median) usual inf mm, right ")
    assert meant(sight(), "right") == ("right", "")
    order, why = meant(sight(), "usual")
    assert order == "usual"
    assert why.startswith("as stated, although 5 rays")


@pytest.mark.parametrize(
    ("shift", "order"),
    [(0.0, "right"), (4.9, "right"), (5.1, "usual")],  # mm; a twentieth of 100 mm is near
)
def test_orientations_that_are_nowhere_near_tell_nothing(shift: float, order: str) -> None:
    found, why = meant(sight(shift))
    assert found == order
    assert ("not told by what is known" in why) == (order == "usual")
    if order == "usual":
        assert meant(sight(shift), "right") == ("right", "")


@pytest.mark.parametrize(("tilt", "order"), [(0.005, "usual"), (0.05, "right")])
def test_the_best_has_to_be_twice_as_good(tilt: float, order: str) -> None:
    # the right one misses by 1 mm, the other by some 100 mm times the tilt more or less
    for sign in (-1.0, 1.0):
        other = TILTED @ rotation_matrix(0.0, sign * tilt, 0.0)
        assert meant(sight(1.0), other=other)[0] == order
    assert meant(sight(1.0), other=TILTED)[0] == "usual"


def test_rays_that_do_not_count_and_few_rays_tell_nothing() -> None:
    seen = sight()
    off = tuple(replace(row, use="off") for row in seen.rays[:3])
    assert meant(seen._replace(rays=(*off, *seen.rays[3:]))) == (
        "usual",
        "no known points tell it",
    )
    assert meant(seen._replace(positions={}), "right") == ("right", "")


def test_coordinates_beyond_all_measure_tell_nothing() -> None:
    seen = sight()
    huge = seen._replace(points=dict.fromkeys(NAMES, (1e308, -1e308, 1e308)))
    order, why = meant(huge._replace(positions={"1": (-1e308, 1e308, 1e308)}))
    assert order == "usual"
    assert "inf mm" in why
