"""What a block states of its points and photos beforehand, as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from anaplot.aliases import Array, Bools
from anaplot.bundle.solve.weightrange import check_weighted
from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block, ControlPoint, PointPrior

__all__ = [
    "control_points",
    "expected_coordinates",
    "known_coordinates",
    "stated_orientations",
]

_AXES = "XYZ"


def control_points(block: Block) -> dict[str, ControlPoint]:
    """Return control and check points by name, without those that are off.

    Raises
    ------
    InputError
        A point twice, or a coordinate or standard deviation that is none.
    """
    control: dict[str, ControlPoint] = {}
    for row in block.control:
        _check(f"control point {row.point}", row)
        if row.use == "off":
            continue
        if row.point in control:
            raise InputError(f"control point {row.point}: stands twice")
        control[row.point] = row
    return control


def _check(what: str, row: ControlPoint | PointPrior) -> None:
    for axis, sigma in zip(_AXES, row.sigma, strict=True):
        if sigma is not None and not 0.0 <= sigma < float("inf"):
            raise InputError(f"{what}: s{axis} = {sigma:g} is not a sigma")
    for axis, value in zip(_AXES, row.xyz, strict=True):
        if value is not None and not abs(value) < float("inf"):
            raise InputError(f"{what}: {axis} = {value:g} is no coordinate")


def known_coordinates(
    block: Block, names: Sequence[str], control: Mapping[str, ControlPoint], held: bool
) -> tuple[Array, Array, Bools]:
    """Return (n, 3) control coordinates, their standard deviations, and which are free of error.

    NaN where there are none; without a datum that control holds no coordinate is observed.

    Raises
    ------
    InputError
        A standard deviation without a weight.
    """
    n = len(names)
    known, sigma = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    fixed = np.zeros((n, 3), dtype=bool)
    for k, name in enumerate(names):
        row = control.get(name)
        if row is None or row.use != "control":
            continue
        for axis, (value, stated) in enumerate(zip(row.xyz, block.sigma_of(row), strict=True)):
            if value is None:
                continue
            known[k, axis] = value
            if held and stated == 0.0:
                fixed[k, axis] = True
            elif held:
                check_weighted(f"control point {name}: {_AXES[axis]}", stated)
                sigma[k, axis] = stated
    return known, sigma, fixed


def expected_coordinates(
    block: Block, names: Sequence[str], fixed: Bools, held: bool
) -> tuple[Array, Array, list[tuple[str, str]]]:
    """Return (n, 3) priors of the points, their standard deviations, and what takes no part.

    Parameters
    ----------
    block
        The block.
    names
        Of its n points.
    fixed
        (n, 3) coordinates that control knows free of error: no prior adds anything to them.
    held
        Whether priors are observed.

    Returns
    -------
    (n, 3), (n, 3) arrays and list
        NaN where there are none; names of points with priors that take no part, and why.

    Raises
    ------
    InputError
        A point twice, or a coordinate or standard deviation that is none.
    """
    number = {name: k for k, name in enumerate(names)}
    values, sigma = np.full((len(names), 3), np.nan), np.full((len(names), 3), np.nan)
    seen: set[str] = set()
    left_out = []
    for row in block.priors:
        if row.point in seen:
            raise InputError(f"prior of point {row.point}: stands twice")
        seen.add(row.point)
        _check(f"prior of point {row.point}", row)
        k = number.get(row.point)
        if k is None:
            left_out.append((row.point, "is of a point that is not measured in any photo"))
            continue
        needless = []
        for axis, (value, stated) in enumerate(zip(row.xyz, row.sigma, strict=True)):
            if value is None:
                continue
            if not stated:
                raise InputError(
                    f"prior of point {row.point}: s{_AXES[axis]} must be positive: a prior has a "
                    "standard deviation"
                )
            if fixed[k, axis]:
                needless.append(_AXES[axis])
                continue
            values[k, axis] = value
            if held:
                check_weighted(f"prior of point {row.point}: {_AXES[axis]}", stated)
                sigma[k, axis] = stated
        if needless:
            what = ", ".join(needless)
            left_out.append((row.point, f"is of {what}, which control knows free of error"))
    return values, sigma, left_out


def stated_orientations(block: Block, held: bool) -> tuple[Array, Array, Array, Array]:
    """Return (photos, 3) positions [m], rotations [rad], each before its standard deviations.

    NaN where nothing is stated; without a datum that they hold they are not observed.

    Raises
    ------
    InputError
        A standard deviation that is not positive.
    """
    n = len(block.photos)
    out = tuple(np.full((n, 3), np.nan) for _ in range(4))
    for k, photo in enumerate(block.photos):
        for what, values, sigmas, at in (
            ("position", photo.position, photo.position_sigma, 0),
            ("rotation", photo.rotation, photo.rotation_sigma, 2),
        ):
            if values is None:
                continue
            out[at][k] = values
            if sigmas is None:
                continue
            if not all(0.0 < s < float("inf") for s in sigmas):
                raise InputError(f"photo {photo.id}: {what}_sigma must be positive")
            if held:
                for sigma in sigmas:
                    check_weighted(f"photo {photo.id}: {what}", sigma)
                out[at + 1][k] = sigmas
    return out  # type: ignore[return-value]
