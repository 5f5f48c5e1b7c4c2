"""Plate to image where the certificate states nothing but distances between fiducials.

Observed are the plate coordinates and, with a standard deviation of their own, the calibrated
distances: A v + B g + u = 0 with a condition for every distance and one that turns the first
distance into the x axis. The origin is the fiducial centre.
"""

from __future__ import annotations

import numpy as np

from anaplot.adjustment.leastsquares import RankDefectError, adjust_combined
from anaplot.aliases import Array
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.camera import CameraCalibration, FiducialDistance
from anaplot.photogrammetry.innerfit import STEPS, FittedPlate, InnerFit, no_end, rows3, rows4
from anaplot.photogrammetry.innerresults import DistanceRow
from anaplot.photogrammetry.platetransformation import PlateTransformation, TransformationName

__all__ = ["fit_distances"]


_UNKNOWNS: dict[str, tuple[str, ...]] = {
    "distances": ("scale", "rotation"),
    "scales": ("scale along x", "scale along y", "rotation"),
}
_ACROSS = 0.1  # sine of the smallest angle between the first two distances


def fit_distances(
    calibration: CameraCalibration,
    names: tuple[str, ...],
    plate: Array,
    kind: TransformationName,
    apriori_um: float,
) -> InnerFit:
    """Fit the two-parameter similarity, or scales along x and y, to calibrated distances.

    Parameters
    ----------
    calibration
        The camera; its first two distances give the axes.
    names, plate
        Measured fiducials and their (n, 2) plate coordinates [mm].
    kind
        "distances" (scale, rotation) or "scales" (scale along x, scale along y, rotation).
    apriori_um
        Standard deviation [um] of a plate coordinate.

    Raises
    ------
    NotComputableError
        The fiducials of the first two distances are not all measured, or the distances do not
        determine the transformation.
    """
    index = {name: k for k, name in enumerate(names)}
    along_x, along_y = calibration.distances[:2]
    missing = [end for d in (along_x, along_y) for end in (d.first, d.second) if end not in index]
    if missing:
        raise NotComputableError(
            f"fiducial {missing[0]} is not measured: with distances only, "
            f"{along_x.first} to {along_x.second} gives the x axis and {along_y.first} to "
            f"{along_y.second} its side"
        )
    used = [d for d in calibration.distances if d.first in index and d.second in index]
    ends = np.array([(index[d.first], index[d.second]) for d in used])
    mm = np.array([d.mm for d in used])
    frame = _frame_of_distances(plate, ends, mm, used)
    place = plate @ frame[:, 1:].T + frame[:, 0]
    both = np.concatenate((place.ravel(), mm))
    n, k = place.size, len(mm)
    cofactors = np.ones(n + k)
    cofactors[n:] = (calibration.distance_sigma_um / apriori_um) ** 2
    v = np.zeros(n + k)
    g = np.array([1.0, 0.0]) if kind == "distances" else np.array([1.0, 1.0, 0.0])
    iteration = 0
    while True:
        iteration += 1
        A, B, value = _distance_conditions(g, both + v, ends, n)
        try:
            solved = adjust_combined(A, B, value - A @ v, cofactors, unknowns=_UNKNOWNS[kind])
        except RankDefectError as error:
            raise NotComputableError(
                f"distances between {', '.join(names)} do not determine: "
                + ", ".join(error.undetermined)
            ) from error
        g = g + solved.g
        moved = float(np.abs(solved.g).max() + np.abs(solved.v - v).max() / mm.max())
        v = solved.v
        if moved < 1e-13 or (iteration == STEPS and moved < 1e-9):
            break
        if iteration == STEPS or not np.isfinite(moved) or not bool((g[:-1] > 0.0).all()):
            raise NotComputableError(no_end(kind, names))
    scales, turn = _linear_part(g)
    linear = scales[:, None] * turn
    found = np.linalg.norm((place[ends[:, 1]] - place[ends[:, 0]]) @ linear.T, axis=1)
    numerator = np.column_stack((np.zeros(2), linear, np.zeros(2)))
    return InnerFit(
        PlateTransformation(kind, rows3(frame), rows4(numerator)),
        FittedPlate.of(solved, cofactors, n),
        iteration,
        (
            f"only distances are known: x runs from {along_x.first} to {along_x.second}, the "
            + (
                "origin is where the lines between opposite fiducials meet"
                if len(names) == 4
                else "origin is the mean of the fiducials"
            ),
        ),
        tuple(
            DistanceRow(*d, float(difference) * 1e3)
            for d, difference in zip(used, found - mm, strict=True)
        ),
    )


def _frame_of_distances(
    plate: Array, ends: Array, mm: Array, used: list[FiducialDistance]
) -> Array:
    """(2, 3): origin in the fiducial centre, x along the first distance, y towards the second."""
    step = plate[ends[:, 1]] - plate[ends[:, 0]]
    length = np.linalg.norm(step, axis=1)
    # of no unit: all are short against the longest only
    short = np.flatnonzero(length / mm <= 1e-3 * float((length / mm).max()))
    if short.size:
        d = used[int(short[0])]
        raise NotComputableError(f"fiducials {d.first} and {d.second} are measured at one place")
    (ax, ay), (bx, by) = step[0] / length[0], step[1] / length[1]
    across = ax * by - ay * bx
    if abs(across) < _ACROSS:
        raise NotComputableError(
            f"{used[1].first} to {used[1].second} lies on the plate along {used[0].first} to "
            f"{used[0].second}: they do not say how the plate lies; measured in the wrong order?"
        )
    side = 1.0 if across > 0.0 else -1.0
    scale = float(mm.sum() / length.sum())
    turn = scale * np.array([[ax, ay], [-side * ay, side * ax]])
    return np.column_stack((-turn @ _fiducial_centre(plate), turn))


def _fiducial_centre(plate: Array) -> Array:
    """Return where the lines between opposite ones of four fiducials meet, else the mean.

    Of the three ways to join four points by two lines, exactly one makes the lines cross between
    their ends when the points are the corners of a convex figure.
    """
    middle: Array = plate.mean(axis=0)
    if len(plate) != 4:
        return middle
    for i, j, k, m in ((0, 1, 2, 3), (0, 2, 1, 3), (0, 3, 1, 2)):
        first, second = plate[j] - plate[i], plate[m] - plate[k]
        determinant = first[1] * second[0] - first[0] * second[1]
        if determinant == 0.0:
            continue
        gap = plate[k] - plate[i]
        s = (second[0] * gap[1] - second[1] * gap[0]) / determinant
        t = (first[0] * gap[1] - first[1] * gap[0]) / determinant
        if 0.0 < s < 1.0 and 0.0 < t < 1.0:
            return np.asarray(plate[i] + s * first)
    raise NotComputableError(
        "the four fiducials have no centre: the lines between opposite ones do not meet"
    )


def _linear_part(g: Array) -> tuple[Array, Array]:
    """Return (2,) scales and the (2, 2) rotation of the unknowns (scale or scales, rotation)."""
    angle = float(g[-1])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.broadcast_to(g[:-1], 2), turn


def _distance_conditions(
    g: Array, observed: Array, ends: Array, n: int
) -> tuple[Array, Array, Array]:
    """Return A, B and the value of each condition: every distance, and y = 0 along the first."""
    scales, turn = _linear_part(g)
    k, u = len(ends), len(g)
    place = observed[:n].reshape(-1, 2)
    step = (place[ends[:, 1]] - place[ends[:, 0]]) @ turn.T
    seen = scales * step
    length = np.linalg.norm(seen, axis=1)
    by_seen = seen / length[:, None]  # derivative of a length by the step in the image
    A = np.zeros((k + 1, len(observed)))
    B = np.zeros((k + 1, u))
    by_place = (by_seen * scales) @ turn
    quarter = np.column_stack((-step[:, 1], step[:, 0]))  # derivative of step by the rotation
    rows = np.arange(k)
    for axis in range(2):
        A[rows, 2 * ends[:, 1] + axis] = by_place[:, axis]
        A[rows, 2 * ends[:, 0] + axis] = -by_place[:, axis]
        A[k, 2 * ends[0, 1] + axis] = turn[1, axis]
        A[k, 2 * ends[0, 0] + axis] = -turn[1, axis]
    A[rows, n + rows] = -1.0
    if u == 2:
        B[:k, 0] = np.einsum("ij,ij->i", by_seen, step)
    else:
        B[:k, :2] = by_seen * step
    B[:k, -1] = np.einsum("ij,ij->i", by_seen, scales * quarter)
    B[k, -1] = quarter[0, 1]
    return A, B, np.append(length - observed[n:], step[0, 1])
