"""A simulated operator's mistake in an inner orientation: a fiducial that he misses."""

from __future__ import annotations

from math import sqrt

import numpy as np

from anaplot.aliases import Axis, Side
from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.inner import orient_inner
from anaplot.plotter.device.hand import Offsets, fiducial_name
from anaplot.simulation.mistakes import SMALLEST, Planted

__all__ = ["plant_wrong_fiducial"]


def plant_wrong_fiducial(
    block: Block, seed: int
) -> tuple[Planted, dict[tuple[str, str, str], Offsets]]:
    """Choose one fiducial of one photo, and by how much it is missed at first.

    Parameters
    ----------
    block
        With one strip, its cameras with fiducials' coordinates.
    seed
        Of the generator.

    Returns
    -------
    Planted, dict
        The mistake, large enough for the table to show it, and the offsets that make the hand do
        it.

    Raises
    ------
    InputError
        No photo of the strip has fiducials with coordinates.
    """
    rng = np.random.default_rng([seed, 3])
    models = block.strips[0].models()
    left, right = models[int(rng.integers(len(models)))]
    side: Side = "left" if rng.random() < 0.5 else "right"
    photo = left if side == "left" else right
    calibration = block.camera_of(photo).calibration
    if calibration is None or not calibration.fiducials:
        raise InputError(f"photo {photo}: its camera has no fiducials with coordinates")
    inner = orient_inner(
        calibration,
        {mark.id: (mark.x, mark.y) for mark in calibration.fiducials},
        apriori_um=block.precision.image_um,
        test=block.test,
    )
    row = inner.rows[int(rng.integers(len(inner.rows)))]
    smallest = SMALLEST * block.precision.image_um * 1e-3 / sqrt(max(row.r, 1e-3))
    size = (1.0 if rng.random() < 0.5 else -1.0) * smallest * float(rng.uniform(1.1, 3.0))
    name = f"{left}/{right}"
    fiducial, axis = row.key
    planted = Planted(name, fiducial, photo, axis, size * 1e3, "wrong fiducial", True, name)
    offsets = {(left, right, fiducial_name(side, fiducial)): _offsets(side, axis, size)}
    return planted, offsets


def _offsets(side: Side, axis: Axis, size: float) -> Offsets:
    if side == "left":
        return Offsets(dxl=size) if axis == "x" else Offsets(dyl=size)
    return Offsets(dxr=size) if axis == "x" else Offsets(dyr=size)
