"""Image coordinates of a block as they were measured, through the lenses that its cameras state."""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.errors import InputError
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.imagepoints import check_coordinates
from anaplot.photogrammetry.measuredimage import has_lens, measured_rays

__all__ = ["check_rows", "measured_xy", "stated_lenses"]


def stated_lenses(block: Block, cameras: Index) -> Array | None:
    """Return (photos, 10) `LENS_PARAMETERS`; None where no camera has a lens."""
    if not any(has_lens(block.cameras[k]) for k in np.unique(cameras).tolist()):
        return None
    return np.array([block.cameras[k].lens_parameters for k in cameras.tolist()])


def measured_xy(block: Block, cameras: Index, ideal: Array) -> Array:
    """Return (m, 2) measured image coordinates [mm] of ideal ones in (m,) cameras."""
    out = ideal.copy()
    for k in np.unique(cameras).tolist():
        mine = cameras == k
        out[mine] = measured_rays(block.cameras[k], ideal[mine])
    return out


def check_rows(block: Block, sigmas: Array) -> None:
    """Raise InputError where image coordinates or standard deviations [um] are none."""
    check_coordinates(block.image_points)
    bad = np.nonzero(~((sigmas > 0.0) & np.isfinite(sigmas)))[0]
    if len(bad):
        row = block.image_points[int(bad[0])]
        sigma = sigmas[bad[0]] if row.sigma_um is None else row.sigma_um
        raise InputError(
            f"image point {row.point} of photo {row.photo}: the sigma {sigma:g} um must be positive"
        )
