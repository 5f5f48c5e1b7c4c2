"""Photos and their regions, of whose rays the mean redundancy number is asked."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.problem import Problem
from anaplot.photogrammetry.block import Block
from anaplot.photogrammetry.imagepoints import columns_of

__all__ = ["REGIONS", "ImageParts", "image_parts"]

REGIONS = 3
"""Regions of a photo along either side: where von Gruber's points lie, and between them."""


class ImageParts(NamedTuple):
    """The photos of a bundle, and after them their regions that have rays.

    Attributes
    ----------
    photos
        How many there are: parts 0 ... photos - 1 are whole photos.
    owner, cell
        (parts,) photo of each, and its place on the grid, row by row from the upper left (x to the
        right, y up); -1 of a whole photo.
    region
        (m,) the region in which each ray lies.
    sums
        (parts, m) sums over the rays of each part.
    of_photo
        The parts of each photo, itself among them.
    """

    photos: int
    owner: Index
    cell: Index
    region: Index
    sums: csr_array
    of_photo: tuple[Index, ...]

    def means(self, r: Array, counted: Index) -> Array:
        """Return (parts,) means of (m, 2) redundancy numbers; NaN where no coordinate counts.

        Parameters
        ----------
        r
            (m, 2) zero where a coordinate does not count.
        counted
            (m,) how many coordinates of each ray count.
        """
        with np.errstate(invalid="ignore"):
            out: Array = (self.sums @ r.sum(axis=1)) / (self.sums @ counted)
        return out


def image_parts(problem: Problem) -> ImageParts:
    """Return the photos of a bundle with their regions, `REGIONS` by `REGIONS` on each format.

    Of a camera without a format, what is measured in its photos spans the grid, whether it counts
    or not: rays that are switched off move no border.
    """
    block, n, m, side = problem.block, len(problem.photos), len(problem.photo), REGIONS
    half = _reaches(block)[problem.cameras[problem.photo]]
    place = np.floor((problem.ideal / half + 1.0) * (0.5 * side)).astype(np.intp)
    column, row = np.clip(place, 0, side - 1).T
    cells = side * side
    key = problem.photo * cells + (side - 1 - row) * side + column
    used, region = np.unique(key, return_inverse=True)
    owner = np.concatenate((np.arange(n), used // cells))
    cell = np.concatenate((np.full(n, -1), used % cells))
    rays = np.arange(m)
    rows = np.concatenate((problem.photo, n + region))
    sums = csr_array((np.ones(2 * m), (rows, np.concatenate((rays, rays)))), shape=(len(owner), m))
    order = np.argsort(owner, kind="stable")
    ends = np.searchsorted(owner[order], np.arange(n + 1))
    parts = tuple(order[ends[k] : ends[k + 1]] for k in range(n))
    return ImageParts(n, owner, cell, n + region, sums, parts)


def _reaches(block: Block) -> Array:
    """Return (cameras, 2) largest abs(x) and abs(y) [mm] of the format, or of what was measured."""
    reach = np.zeros((len(block.cameras), 2))
    if any(camera.format is None for camera in block.cameras):
        number = {camera.id: k for k, camera in enumerate(block.cameras)}
        of_photo = {photo.id: number[photo.camera] for photo in block.photos}
        points = columns_of(block.image_points)
        # of photos that are not declared nothing takes part
        camera = np.array([of_photo.get(photo, -1) for photo in points.photo.values], np.intp)
        camera = camera[points.photo.index]
        mine = camera >= 0
        np.maximum.at(reach, camera[mine], np.maximum(np.abs(points.xy[mine]), 1e-9))
        reach[reach[:, 0] == 0.0] = 1.0  # nothing is measured with it
    for k, stated in enumerate(block.cameras):
        if stated.format is not None:
            reach[k] = stated.reach()
    return reach
