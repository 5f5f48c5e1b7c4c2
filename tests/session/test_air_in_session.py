"""A block whose refraction and earth curvature are taken off, at the instrument."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from innerscene import InnerScene

from anaplot.photogrammetry.airandearth import AirAndEarth
from anaplot.photogrammetry.radialshift import RadialShift
from anaplot.session.plates import Plates, image_of, plate_of, plates_of
from anaplot.session.state import start
from anaplot.simulation.laidplates import laid_photographs

AIR = AirAndEarth(4000.0, 300.0, refraction=True, earth_curvature=True)
PLACES = np.array([[90.0, 85.0], [-3.0, -100.0], [0.0, 0.0]])


def scene_with(air: AirAndEarth | None) -> tuple[InnerScene, Plates]:
    scene = InnerScene()
    scene.block = replace(scene.block, air=air)
    scene.start = start(scene.block)
    return scene, plates_of(scene.oriented(scene.chosen()))


def test_the_plates_of_a_session_know_air_and_earth() -> None:
    scene, plates = scene_with(AIR)
    _, without = scene_with(None)
    for x, y in PLACES.tolist():
        # the table drives to where the point is imaged, and reads out its ideal place
        at = plate_of(x, y, x, y, plates)
        seen = image_of(at, plates)
        assert (seen.xl, seen.yl, seen.xr, seen.yr) == pytest.approx((x, y, x, y), abs=1e-7)
        displaced = image_of(at, without)
        ideal = RadialShift.of(AIR, scene.calibration.c).taken_off(
            np.array([[displaced.xl, displaced.yl]])
        )
        assert ideal[0].tolist() == pytest.approx([x, y], abs=1e-6)
    far = image_of(plate_of(90.0, 85.0, 90.0, 85.0, plates), without)
    assert np.hypot(far.xl - 90.0, far.yl - 85.0) > 5e-3


def test_simulated_plates_are_laid_by_the_inverse() -> None:
    scene, plates = scene_with(AIR)
    photo = scene.block.strips[0].photos[0]
    truth = {photo: {str(k): (x, y) for k, (x, y) in enumerate(PLACES.tolist())}}
    left, _ = laid_photographs(scene.block, truth, scene.placements)
    for name, (x, y) in truth[photo].items():
        # the fiducials were measured with 3 um of noise
        assert plates.left.to_image(*left[photo][name]) == pytest.approx((x, y), abs=8e-3)
    bare = replace(scene.block, air=None)
    other, _ = laid_photographs(bare, truth, scene.placements)
    away = np.subtract(left[photo]["0"], other[photo]["0"])
    assert np.hypot(*away) > 5e-3
