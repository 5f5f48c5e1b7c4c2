"""The lens function against COLMAP's own: img_from_cam of its camera models."""

from __future__ import annotations

import numpy as np
import pytest

from anaplot.photogrammetry.block import Camera, in_pixels
from anaplot.photogrammetry.camera import BrownLens
from anaplot.photogrammetry.lens import through_lens, without_lens
from anaplot.photogrammetry.measuredimage import measured_rays, pixels_of_mm

pycolmap = pytest.importorskip("pycolmap")

FX, FY, CX, CY = 4012.5, 4000.0, 2990.25, 2011.5
PIXEL_UM = 4.5
MODELS = {
    "SIMPLE_PINHOLE": ((FY, CX, CY), BrownLens(), FY),
    "PINHOLE": ((FX, FY, CX, CY), BrownLens(), FX),
    "SIMPLE_RADIAL": ((FY, CX, CY, -0.08), BrownLens(k1=-0.08), FY),
    "RADIAL": ((FY, CX, CY, -0.08, 0.03), BrownLens(k1=-0.08, k2=0.03), FY),
    "OPENCV": (
        (FX, FY, CX, CY, -0.08, 0.03, 7e-4, -5e-4),
        BrownLens(k1=-0.08, k2=0.03, p1=7e-4, p2=-5e-4),
        FX,
    ),
    "FULL_OPENCV": (
        (FX, FY, CX, CY, -0.08, 0.03, 7e-4, -5e-4, 0.01, 0.0, 0.0, 0.0),
        BrownLens(k1=-0.08, k2=0.03, k3=0.01, p1=7e-4, p2=-5e-4),
        FX,
    ),
}


def camera(lens: BrownLens, fx: float) -> Camera:
    brown = BrownLens(*lens.coefficients[:5], b1=fx / FY - 1.0)
    made = Camera("colmap", FY * PIXEL_UM / 1000.0, lens=brown)
    return in_pixels(made, (6000, 4000), PIXEL_UM, (CX, CY))


@pytest.mark.parametrize("model", MODELS)
def test_pixels_are_those_of_colmap(model: str) -> None:
    params, lens, fx = MODELS[model]
    theirs = pycolmap.Camera(model=model, width=6000, height=4000, params=params)
    # in COLMAP's camera y is down and z forward: u = x / z, v = y / z
    uv = np.random.default_rng(4).uniform((-0.7, -0.48), (0.7, 0.48), (200, 2))
    rays = np.column_stack((uv, np.ones(len(uv))))
    wanted = np.array([theirs.img_from_cam(ray) for ray in rays]).reshape(-1, 2)
    mine = camera(lens, fx)
    ideal = uv * (mine.c, -mine.c)
    found = pixels_of_mm(mine, measured_rays(mine, ideal))
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    # and back
    parameters = np.array(mine.lens_parameters)
    measured = through_lens(uv * (1.0, -1.0), parameters).xy
    np.testing.assert_allclose(without_lens(measured, parameters), uv * (1.0, -1.0), atol=1e-12)
