"""The block of the Bayesian paper as a block that any command can read."""

from __future__ import annotations

from math import sqrt

import numpy as np

from anaplot.aliases import Array
from anaplot.photogrammetry.block import (
    Block,
    Camera,
    ControlPoint,
    ImagePoint,
    Photo,
    PointPrior,
    Precision,
    Strip,
    TestSettings,
)
from anaplot.photogrammetry.collinearity import project
from anaplot.photogrammetry.rotation import rotation_angles
from anaplot.planning.bayesblock import (
    C_MM,
    CORNERS,
    SIGMA_MM,
    bayes_geometry,
    photo_name,
    point_name,
)

__all__ = ["CONTROL_M", "bayes_folder"]

CONTROL_M = 0.01
"""Standard deviation of the control [m]; the paper does not print it, its corners keep 0.0."""


def bayes_folder(name: str, prior_variance: float, errors: Array) -> Block:
    """Return the paper's block with some errors in its image coordinates.

    Parameters
    ----------
    name
        Of the block.
    prior_variance
        Of every unknown [m^2; of angles rad^2]. The prior values are the true ones.
    errors
        (156,) of the image coordinates, in sigmas of 5 um.

    Returns
    -------
    Block
        All 25 points have priors; the four at the corners are control as well, for the second
        step, the others check points with their true coordinates.
    """
    at = bayes_geometry()
    photo, point = at.rays.T
    c = np.full(len(at.rays), C_MM)
    seen = project(at.centres[photo], at.rotations[photo], c, at.points[point]).xy
    measured = seen + SIGMA_MM * errors.reshape(-1, 2)
    sigma = (sqrt(prior_variance),) * 3
    photos = tuple(
        Photo(photo_name(k), "paper", _triple(centre), rotation_angles(rotation), sigma, sigma)
        for k, (centre, rotation) in enumerate(zip(at.centres, at.rotations, strict=True))
    )
    names = [one.id for one in photos]
    rows = tuple(
        ImagePoint(names[f], point_name(p), x, y)
        for (f, p), (x, y) in zip(at.rays.tolist(), measured.tolist(), strict=True)
    )
    places = [_triple(place) for place in at.points]
    control = tuple(
        ControlPoint(point_name(k), place, (CONTROL_M,) * 3)
        if k in CORNERS
        else ControlPoint(point_name(k), place, use="check")
        for k, place in enumerate(places)
    )
    return Block(
        name,
        Precision(1e3 * SIGMA_MM, "exact"),
        TestSettings(),
        (Camera("paper", C_MM),),
        photos,
        (Strip("1", tuple(names[:5])), Strip("2", tuple(names[5:]))),
        image_points=rows,
        control=control,
        priors=tuple(PointPrior(point_name(k), place, sigma) for k, place in enumerate(places)),
    )


def _triple(values: Array) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
