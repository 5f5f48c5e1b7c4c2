"""Residuals as vectors in the image: of one photo, and of all photos of a camera together."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.drawing.drawing import Drawing
from anaplot.drawing.element import text
from anaplot.drawing.frame import equal_frame
from anaplot.drawing.legend import Entry
from anaplot.drawing.plot import Head, Plot
from anaplot.drawing.thinning import thinned
from anaplot.drawing.ticks import round_down, written
from anaplot.photogrammetry.block import Camera
from anaplot.report.columns import counted
from anaplot.report.figures.imageunits import ImageUnits, image_units

__all__ = ["photo_residuals", "residual_pattern"]

_MOST_VECTORS = 2400
_LONG = 42.0  # units of the drawing: the longer ones of a photo's vectors
_FEWEST_IN_CELL, _RAYS_A_CELL, _MOST_CELLS = 5, 14, 12
_RARE = 9.21  # chi-square of two degrees of freedom, exceeded by 1 in 100
_ROUNDING_UM = 1e-3  # residuals as small as that are points
_WITHIN = 0.9  # of a cell: the longest mean


class _Seen(NamedTuple):
    """Rays with their residuals.

    Attributes
    ----------
    xy
        (n, 2) where they were measured, as it is shown.
    v
        (n, 2) residuals [um]; NaN where a coordinate does not count.
    deviation
        (n, 2) expected standard deviations of the residuals [um]; NaN likewise.
    flagged
        (n,) whether x or y is flagged.
    point
        (n,) indices of points.
    out
        (k, 2) where rays were measured that do not count: off, or rejected.
    """

    xy: Array
    v: Array
    deviation: Array
    flagged: Bools
    point: Index
    out: Array


def _seen(block: AdjustedBlock, rays: Index) -> _Seen:
    tested, image = block.tested, block.observations.image
    use = tested.use[:image].reshape(-1, 2)[rays]
    v = np.where(use, tested.residual[:image].reshape(-1, 2)[rays], np.nan)
    expected = np.where(use, tested.expected[:image].reshape(-1, 2)[rays], np.nan)
    problem = block.problem
    some = use.any(axis=1)
    flagged = np.asarray(block.flagged[rays].any(axis=1))
    of_mm = image_units(problem.block).of_mm
    return _Seen(
        problem.xy[rays][some] * of_mm,
        v[some],
        expected[some],
        flagged[some],
        problem.point[rays][some],
        problem.xy[rays][~some] * of_mm,
    )


def _format(camera: Camera, xy: Array, of_mm: float) -> Array:
    """Return (4, 2) corners of the format, or of what was measured, as it is shown."""
    if camera.format is not None:
        x, y = of_mm * camera.format[0] / 2.0, of_mm * camera.format[1] / 2.0
        return np.array([(-x, -y), (x, -y), (x, y), (-x, y)])
    low, high = xy.min(axis=0), xy.max(axis=0)
    return np.array([low, (high[0], low[1]), high, (low[0], high[1])])


def photo_residuals(block: AdjustedBlock, photo: str) -> Drawing | None:
    """Return the residual vectors of a photo; None where none of its rays counts.

    Parameters
    ----------
    block
        The adjusted block.
    photo
        Name of the photo.

    Raises
    ------
    KeyError
        The block has no such photo that takes part.
    """
    problem = block.problem
    try:
        at = problem.photos.index(photo)
    except ValueError:
        raise KeyError(photo) from None
    seen = _seen(block, np.flatnonzero(problem.photo == at))
    if not len(seen.xy):
        return None
    camera = problem.block.cameras[problem.cameras[at]]
    units = image_units(problem.block)
    corners = _format(camera, seen.xy, units.of_mm)
    v = np.nan_to_num(seen.v)
    length = np.hypot(v[:, 0], v[:, 1])
    rms = np.sqrt((v**2).sum(axis=0) / np.maximum(np.isfinite(seen.v).sum(axis=0), 1))
    worst = int(np.argmax(length))
    name = problem.points[seen.point[worst]]
    title = f"Residuals of photo {photo}"
    numbers = (
        f"{counted(len(v), 'ray')}, root mean square x {rms[0]:.1f}, y {rms[1]:.1f} "
        f"{units.small}; largest {length[worst]:.1f} {units.small} at point {name}"
    )
    head = Head(f"residuals-{at + 1}", title, f"{numbers}. Adjusted minus observed.")
    plot = Plot(head, equal_frame(head.bottom, corners, margin=0.06))
    plot.axes(f"x [{units.large}]", f"y [{units.large}]")
    plot.areas(corners[None], "line l-soft")
    times = _vectors(plot, seen, v, length, units)
    plot.dots(seen.xy[~seen.flagged], "l-ink", 2.5)
    plot.marks("circle", seen.xy[seen.flagged], "line bold l-bad", 6.0)
    plot.marks("cross", seen.out, "line l-soft", 3.5)
    if len(seen.out):
        label = f"rejected or off ({len(seen.out)})"
        plot.explain(Entry("mark", label, "line l-soft", "cross", 3.5))
    order = np.argsort(-(length + 1e6 * seen.flagged), kind="stable")
    named = order[: max(int(seen.flagged.sum()), 5) if len(order) <= 40 else 12]
    points = problem.points
    plot.names(
        seen.xy[named], [points[k] for k in seen.point[named].tolist()], obstacles=seen.xy[:500]
    )
    flagged = [points[k] for k in seen.point[seen.flagged][:10].tolist()]
    said = f"Flagged: {', '.join(flagged)}." if flagged else "None is flagged."
    return plot.drawing(
        f"{title}: {numbers}. Vectors are enlarged {written(times, 0)} times. {said}"
    )


def _vectors(plot: Plot, seen: _Seen, v: Array, length: Array, units: ImageUnits) -> float:
    """Draw the vectors of a photo with their scale, and return the exaggeration."""
    um = 1e-3 * units.of_mm  # 1 um in the unit of the axes
    scale = plot.frame.scale[0] * um
    typical = max(float(np.quantile(length, 0.95)), _ROUNDING_UM)
    times = round_down(_LONG / (typical * scale))
    chosen = thinned(seen.xy, _MOST_VECTORS, seen.flagged)
    if len(chosen) < len(v):
        plot.note(f"{len(chosen)} of {len(v)} vectors are drawn, the flagged ones among them.")
    plain, flagged = (chosen[seen.flagged[chosen] == is_so] for is_so in (False, True))
    cut = plot.arrows(seen.xy[plain], v[plain] * um, times, "l-series-1")
    cut += plot.arrows(seen.xy[flagged], v[flagged] * um, times, "bold l-bad")
    if cut:
        plot.note(f"Without a head, since longer than the drawing: {counted(cut, 'vector')}.")
    size = round_down(40.0 / (scale * times))
    plot.explain(
        Entry("arrow", f"{size:g} {units.small}", "line l-series-1", length=size * scale * times)
    )
    if len(flagged):
        plot.explain(Entry("mark", "flagged", "line bold l-bad", "circle", 6.0))
    return times


class _Cells(NamedTuple):
    """Mean residuals in the cells of a format.

    Attributes
    ----------
    middle
        (n, 2) of the cells [mm].
    mean, rays
        (n, 2) mean residuals [um], and (n,) numbers of rays.
    beyond
        (n,) which are larger than chance lets expect in 1 of 100 cells.
    """

    middle: Array
    mean: Array
    rays: Index
    beyond: Bools


def _cells(seen: _Seen, corners: Array) -> tuple[_Cells, Array]:
    """Return the cells with rays enough, and (2,) how large a cell is [mm]."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    extent = np.maximum(high - low, 1e-9)
    wanted = min(max(len(seen.xy) / _RAYS_A_CELL, 9.0), float(_MOST_CELLS**2))
    across = np.clip(np.round(np.sqrt(wanted * extent / extent[::-1])), 2, 2 * _MOST_CELLS)
    size = extent / across
    cell = np.clip(((seen.xy - low) / size).astype(np.intp), 0, across.astype(np.intp) - 1)
    number = cell[:, 0] * int(across[1]) + cell[:, 1]
    both = np.isfinite(seen.v).all(axis=1)
    total = int(across[0] * across[1])
    count = np.bincount(number[both], minlength=total)
    means, spread = np.zeros((total, 2)), np.zeros((total, 2))
    for axis in (0, 1):
        means[:, axis] = np.bincount(number[both], seen.v[both, axis], total)
        spread[:, axis] = np.bincount(
            number[both], np.nan_to_num(seen.deviation[both, axis]) ** 2, total
        )
    enough = np.flatnonzero(count >= _FEWEST_IN_CELL)
    with np.errstate(divide="ignore", invalid="ignore"):
        chi = np.sum(means[enough] ** 2 / spread[enough], axis=1)
    k = np.stack((enough // int(across[1]), enough % int(across[1])), axis=1)
    found = _Cells(
        low + (k + 0.5) * size, means[enough] / count[enough, None], count[enough], chi > _RARE
    )
    return found, size


def residual_pattern(
    block: AdjustedBlock, camera: str | None = None, *, key: str = "residual-pattern"
) -> Drawing | None:
    """Return what the residuals of all photos have in common: their means in cells of the format.

    A cell whose mean is larger than chance lets expect in one of a hundred cells is drawn bold
    with a diamond; residuals count as independent there, which neighbours are not quite.

    Parameters
    ----------
    block
        The adjusted block.
    camera
        Name of the camera; None: that which took the most photos.
    key
        Of the drawing.

    Returns
    -------
    Drawing or None
        None where no cell has five rays.

    Raises
    ------
    KeyError
        The block has no such camera.
    """
    problem = block.problem
    names = [one.id for one in problem.block.cameras]
    if camera is None:
        of = int(np.argmax(np.bincount(problem.cameras, minlength=len(names))))
    elif camera in names:
        of = names.index(camera)
    else:
        raise KeyError(camera)
    rays = np.flatnonzero(problem.cameras[problem.photo] == of)
    if not len(rays):
        return None
    seen = _seen(block, rays)
    units = image_units(problem.block)
    um = 1e-3 * units.of_mm  # 1 um in the unit of the axes
    corners = _format(problem.block.cameras[of], seen.xy, units.of_mm)
    cells, size = _cells(seen, corners)
    if not len(cells.rays):
        return None
    photos = int(np.count_nonzero(problem.cameras == of))
    length = np.hypot(cells.mean[:, 0], cells.mean[:, 1])
    rms = sqrt(float(np.mean(length**2)) / 2.0)
    beyond = int(cells.beyond.sum())
    title = "Residuals of all photos together"
    if len(names) > 1:
        title += f", camera {names[of]}"
    numbers = (
        f"Means of {counted(len(seen.xy), 'ray')} of {counted(photos, 'photo')} in "
        f"{counted(len(cells.rays), 'cell')}, root mean square {rms:.2f} {units.small}, largest "
        f"{float(length.max()):.2f} {units.small}; {beyond} larger than chance explains "
        f"({0.01 * len(cells.rays):.1f} expected)"
    )
    head = Head(key, title, f"{numbers}. Small: rays in the cell.")
    plot = Plot(head, equal_frame(head.bottom, corners, margin=0.03))
    plot.axes(f"x [{units.large}]", f"y [{units.large}]", grid=False)
    half = size / 2.0 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    plot.areas(cells.middle[:, None] + half, "grid")
    scale = plot.frame.scale[0] * um
    reach = _WITHIN * float(size.min()) * plot.frame.scale[0]
    times = round_down(reach / (max(float(np.quantile(length, 0.95)), _ROUNDING_UM) * scale))
    start = cells.middle - cells.mean * um * times / 2.0  # the vector's middle is the cell's
    plain, bold = ~cells.beyond, cells.beyond
    plot.arrows(start[plain], cells.mean[plain] * um, times, "l-series-1")
    plot.arrows(start[bold], cells.mean[bold] * um, times, "bold l-series-2")
    corner = plot.frame.places(cells.middle + half[0]).tolist()
    for (x, y), count in zip(corner, cells.rays.tolist(), strict=True):
        plot.add(text(x + 3.0, y - 3.5, str(count), "t-soft t-tiny"))
    if beyond:
        plot.marks("diamond", cells.middle[bold] + (half[2] - 0.12 * size), "f-series-2", 3.5)
        plot.explain(Entry("mark", "larger than chance explains", "f-series-2", "diamond", 3.5))
    unit = round_down(40.0 / (scale * times))
    plot.explain(
        Entry("arrow", f"{unit:g} {units.small}", "line l-series-1", length=unit * scale * times)
    )
    return plot.drawing(f"{title}. {numbers}. Vectors are enlarged {written(times, 0)} times.")
