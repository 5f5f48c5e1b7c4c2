"""Inner orientation: plate to image from measured fiducials, with the reliability of each."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import partial
from math import sqrt

import numpy as np

from anaplot.adjustment.tested import Dense, examine
from anaplot.aliases import Axis, Bools
from anaplot.errors import NotComputableError, TooFewError
from anaplot.photogrammetry.block import TestSettings
from anaplot.photogrammetry.camera import CameraCalibration
from anaplot.photogrammetry.distancefit import fit_distances
from anaplot.photogrammetry.fiducialfit import fit_fiducials
from anaplot.photogrammetry.innerfit import InnerFit, in_brackets
from anaplot.photogrammetry.innerresults import DistanceRow, Fiducial, InnerOrientation
from anaplot.photogrammetry.platetransformation import (
    TRANSFORMATIONS,
    Placement,
    PlateTransformation,
    TransformationName,
    random_placement,
)

__all__ = [
    "MINIMUM",
    "TRANSFORMATIONS",
    "DistanceRow",
    "InnerOrientation",
    "Placement",
    "PlateTransformation",
    "TransformationName",
    "candidates",
    "orient_inner",
    "random_placement",
]

MINIMUM: dict[TransformationName, int] = {
    "distances": 2,
    "scales": 3,
    "helmert": 3,  # two would do, but for the side from which the plate is seen
    "affine": 3,
    "bilinear": 4,
    "projective": 4,
}
"""Fewest fiducials of each transformation."""

_NOTHING_MM = 1e-10
"""Residuals of this size are rounding: nothing deviates from anything."""


def candidates(calibration: CameraCalibration, count: int) -> tuple[TransformationName, ...]:
    """Return the transformations for `count` measured fiducials, the one to try first first.

    Distances only: two-parameter similarity; three fiducials: Helmert; four: affine; more:
    bilinear. A poorer one follows for fiducials that lie so that they do not determine the first.
    """
    if calibration.distances:
        return ("distances",)
    if count > 4:
        return ("bilinear", "affine", "helmert")
    return ("affine", "helmert") if count == 4 else ("helmert",)


def orient_inner(
    calibration: CameraCalibration,
    measured: Mapping[str, tuple[float, float]],
    *,
    transformation: TransformationName | None = None,
    apriori_um: float = 5.0,
    test: TestSettings | None = None,
    off: Collection[tuple[str, Axis]] = (),
) -> InnerOrientation:
    """Find the transformation plate -> image.

    Parameters
    ----------
    calibration
        The camera.
    measured
        Plate coordinates [mm] of fiducials by name; names that the camera does not know raise
        KeyError.
    transformation
        Its name, or None to choose it from the data at hand (`candidates`).
    apriori_um
        A-priori standard deviation [um] of a measured coordinate.
    test
        The test that flags rows; the default is that of a block.
    off
        Rows (fiducial, axis) that do not take part; where only distances are calibrated, both
        rows of a fiducial or none.

    Raises
    ------
    NotComputableError
        Too few fiducials, fiducials that do not determine the transformation (named), or a
        transformation that the certificate does not allow.
    """
    settings = TestSettings() if test is None else test
    known = calibration.fiducial_names()
    for name in measured:
        if name not in known:
            raise KeyError(name)
    names = tuple(
        name
        for name in known
        if name in measured and not all((name, axis) in off for axis in _AXES)
    )
    keep = np.array([(name, axis) not in off for name in names for axis in _AXES], dtype=np.bool_)
    plate = np.array([measured[name] for name in names], dtype=np.float64).reshape(-1, 2)
    if not np.isfinite(plate).all():
        raise ValueError("plate coordinates must be finite")
    _check_choice(calibration, transformation, names)
    if calibration.distances and not keep.all():
        raise ValueError("where only distances are calibrated, a fiducial is off as a whole")
    if calibration.distances:
        fit = fit_distances(calibration, names, plate, transformation or "distances", apriori_um)
    else:
        calibrated = {mark.id: (mark.x, mark.y) for mark in calibration.fiducials}
        image = np.array([calibrated[name] for name in names])
        count = int(keep.sum()) // 2
        wanted = (transformation,) if transformation else candidates(calibration, count)
        fit = fit_fiducials(wanted, names, plate, image, keep)
    return _result(calibration, names, fit, apriori_um, settings, keep)


def _check_choice(
    calibration: CameraCalibration, wanted: TransformationName | None, names: tuple[str, ...]
) -> None:
    if not calibration.fiducials and not calibration.distances:
        raise NotComputableError(f"camera {calibration.id!r} states no fiducials")
    from_distances = wanted in ("distances", "scales")
    if wanted is not None and from_distances != bool(calibration.distances):
        has = "distances between fiducials only" if calibration.distances else "their coordinates"
        raise NotComputableError(
            f"a transformation {wanted!r} is not possible: camera {calibration.id!r} states {has}"
        )
    if wanted is not None:
        least = MINIMUM[wanted]
    else:
        least = MINIMUM["distances" if calibration.distances else "helmert"]
    if len(names) < least:
        title = f"the transformation {wanted!r}" if wanted else "inner orientation"
        raise TooFewError(
            f"{title} needs {least} fiducials, {len(names)} measured" + in_brackets(names)
        )


def _result(
    calibration: CameraCalibration,
    names: tuple[str, ...],
    fit: InnerFit,
    apriori_um: float,
    test: TestSettings,
    keep: Bools,
) -> InnerOrientation:
    adjusted = fit.adjustment
    residual, vtpv, f = adjusted.w[keep], adjusted.vtpv, adjusted.redundancy
    if f < 1 or sqrt(vtpv / f) < _NOTHING_MM:
        residual, vtpv = np.zeros_like(residual), 0.0
    keys: list[Fiducial] = [(name, axis) for name in names for axis in _AXES]
    q_vv = adjusted.q_vv[np.ix_(keep, keep)]
    tested = examine(
        [key for key, kept in zip(keys, keep.tolist(), strict=True) if kept],
        ["um"] * len(residual),
        residual * 1e3,
        adjusted.r[keep],
        apriori_um * np.sqrt(adjusted.q_l[keep]),
        vtpv=vtpv / (apriori_um * 1e-3) ** 2,
        redundancy=f,
        test=test,
        dense=partial(Dense, q_vv, q_vv / adjusted.q_l[keep]),
    )
    from scipy.special import chdtri  # loaded with the first inner orientation

    return InnerOrientation(
        camera=calibration.id,
        transformation=fit.transformation,
        placement=fit.transformation.placement(),
        apriori_um=apriori_um,
        iterations=fit.iterations,
        tested=tested,
        distances=fit.distances,
        unmeasured=tuple(n for n in calibration.fiducial_names() if n not in names),
        overall=apriori_um * float(np.sqrt(chdtri(f, test.alpha) / f)) if f > 0 else None,
        exchanged=fit.exchanged,
        remarks=fit.remarks,
        cofactors=fit.cofactors,
    )


_AXES: tuple[Axis, Axis] = ("x", "y")
