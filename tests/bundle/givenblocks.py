"""Blocks that are adjusted in two halves, one after the other, and at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from bundleblocks import aerial

from anaplot.bundle.adjust import adjust_block
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.posteriors import posterior_of
from anaplot.photogrammetry.block import Block, Camera, ImagePoint

LAST = ("points", "photos")


@dataclass(frozen=True)
class Halves:
    """Two blocks that make one."""

    first: Block
    second: Block
    both: Block


def campaigns(noise_um=0.0, control_sigma=0.05, *, length=4, **options) -> Halves:
    """The same points photographed twice; the second flight has a camera and photos of its own.

    Control stands in the first half, but for its last point, which stands in the second.
    """
    made = dict(control_sigma=control_sigma, seed=3, **options)
    first = aerial(2, length, noise_um=noise_um, **made).block
    rng = np.random.default_rng(5)
    rows = tuple(
        replace(
            row,
            photo=f"n{row.photo}",
            x=row.x + rng.normal() * noise_um * 1e-3,
            y=row.y + rng.normal() * noise_um * 1e-3,
        )
        for row in aerial(2, length, **made).block.image_points
    )
    photos = tuple(replace(photo, id=f"n{photo.id}", camera="other") for photo in first.photos)
    other = Camera("other", 150.0)
    second = replace(
        first,
        cameras=(other,),
        photos=photos,
        strips=(),
        image_points=rows,
        control=first.control[-1:],
    )
    both = replace(
        first,
        cameras=(*first.cameras, other),
        photos=first.photos + photos,
        strips=(),
        image_points=first.image_points + rows,
    )
    return Halves(replace(first, strips=(), control=first.control[:-1]), second, both)


def parted(*, points=True, turned=False) -> Halves:
    """One flight: its points in two sets, or the rays of points with four and more in two halves.

    Control is all in the first half.
    """
    block = aerial(2, 4, control_sigma=0.05, seed=3, per_base=2, turned=turned).block
    block = replace(block, strips=())
    firm = {control.point for control in block.control}
    count: dict[str, int] = {}
    for row in block.image_points:
        count[row.point] = count.get(row.point, 0) + 1
    seen: dict[str, int] = {}
    rows: tuple[list[ImagePoint], list[ImagePoint]] = ([], [])
    for row in block.image_points:
        number = seen[row.point] = seen.get(row.point, 0) + 1
        if points:
            rows[row.point not in firm and int(row.point[1:]) % 2].append(row)
        else:
            rows[count[row.point] >= 4 and (int(row.point[1:]) + number) % 2].append(row)
    return Halves(
        replace(block, image_points=tuple(rows[0])),
        replace(block, image_points=tuple(rows[1]), control=()),
        block,
    )


def one_after_the_other(halves: Halves, of=("points",), additional=None) -> AdjustedBlock:
    """Adjust the second half with what the first leaves."""
    left = posterior_of(adjust_block(halves.first, additional=additional), of)
    return adjust_block(replace(halves.second, given=left), additional=additional)


def beside(one: AdjustedBlock, other: AdjustedBlock):
    """Of coordinates of both: differences, and those of cofactors, in standard deviations."""
    a, b = posterior_of(one, LAST), posterior_of(other, LAST)
    place = {name: k for k, name in enumerate(b.names)}
    at = [place[name] for name in a.names]
    size = np.sqrt(np.diag(b.covariance)[at])
    firm = size == 0.0
    assert (np.diag(a.covariance)[firm] == 0.0).all()
    assert np.abs((a.x - b.x[at])[firm]).max(initial=0.0) < 1e-12 * 1e4
    size[firm] = 1.0
    apart = np.where(firm, 0.0, a.x - b.x[at]) / size
    cofactors = (a.covariance - b.covariance[np.ix_(at, at)]) / size[:, None] / size
    return np.abs(apart).max(), np.abs(cofactors).max()


def of_rays(block: AdjustedBlock, values: np.ndarray) -> dict:
    """Values (m, 2) of rays by photo and point."""
    problem = block.problem
    return {
        (problem.photos[photo], problem.points[point]): values[k]
        for k, (photo, point) in enumerate(
            zip(problem.photo.tolist(), problem.point.tolist(), strict=True)
        )
    }
