"""The map of a block: photos, strips, points by their redundancy, control, what is flagged."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.blockmap import flagged_points, mean_redundancy
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.drawing.classes import draw_classes
from anaplot.drawing.drawing import Drawing
from anaplot.drawing.frame import Frame
from anaplot.drawing.legend import Entry
from anaplot.drawing.plot import Head, Plot
from anaplot.drawing.thinning import thinned
from anaplot.drawing.ticks import round_down, written
from anaplot.report.columns import counted
from anaplot.report.figures.crowding import sampled
from anaplot.report.figures.groundview import GroundView, ground_view
from anaplot.report.figures.modelfigure import REDUNDANCY_CLASSES

__all__ = ["CONTROL_SHAPES", "block_map", "draw_control", "length_of"]

_MOST_POINTS, _MOST_PHOTOS, _MOST_FOOTPRINTS, _MOST_FLAGGED = 4000, 1500, 150, 300
_MOST_WEAK, _NAMED_OF_MANY = 30, 12
_MOST_ELLIPSES, _ROOM_OF_ELLIPSE = 300, 1600.0  # and in square units of the drawing
_FEWEST_ELLIPSES = 40
_SMALLEST, _LARGEST = 11.0, 30.0  # units of the drawing: half axis of the larger ellipses
_SPACING = 0.35  # of the mean distance of points: the same, between those
_TOO_LARGE = 60.0
CONTROL_SHAPES = (
    ("control", "triangle", "f-series-3 rim", 5.5),
    ("control, height only", "down", "f-series-6 rim", 5.0),
    ("control, plan only", "diamond", "f-series-5 rim", 5.0),
    ("check point", "square", "f-series-4 rim", 5.0),
)
"""What control and check points are drawn with: name, shape, classes, size."""


_CONTROL_IN_WORDS = ("in plan and height", "in height only", "in plan only", "to check")


class _Control(NamedTuple):
    """Control and check points.

    Attributes
    ----------
    at
        Index of each in `Problem.points`.
    kind
        Of `CONTROL_SHAPES`.
    names
        Names.
    """

    at: Index
    kind: Index
    names: list[str]


def _control_of(block: AdjustedBlock) -> _Control:
    index = {name: k for k, name in enumerate(block.problem.points)}
    at, kind, names = [], [], []
    for name, row in block.problem.control_rows.items():
        if name not in index or row.use == "off":
            continue
        plan, height = row.xyz[0] is not None or row.xyz[1] is not None, row.xyz[2] is not None
        of = 3 if row.use == "check" else 0 if plan and height else 1 if height else 2
        at.append(index[name])
        kind.append(of)
        names.append(name)
    return _Control(np.array(at, dtype=np.intp), np.array(kind, dtype=np.intp), names)


def draw_control(
    plot: Plot, view: GroundView, *, hollow: bool = False, size: float = 1.0
) -> tuple[Array, list[str]]:
    """Draw control and check points, and return where they are and their names.

    `hollow`: in outline, so that what is beneath is seen; `size`: factor of the marks' size.
    """
    found = _control_of(view.block)
    places = view.at[found.at]
    for k, (label, shape, classes, half) in enumerate(CONTROL_SHAPES):
        of = found.kind == k
        half *= size
        if hollow:
            classes, half = "line l-ink", half + 1.5
        if of.any():
            plot.marks(shape, places[of], classes, half)  # type: ignore[arg-type]
            text = f"{label} ({int(of.sum())})"
            plot.explain(Entry("mark", text, classes, shape, half))  # type: ignore[arg-type]
    order = np.argsort(found.kind == 1, kind="stable")  # heights inside come last
    return places[order], [found.names[k] for k in order.tolist()]


def block_map(block: AdjustedBlock, *, planned: bool = False) -> Drawing:
    """Return the map of an adjusted or planned block.

    Photos with their footprints and strips, points by the mean redundancy number of their image
    coordinates, flagged ones ringed, control and check points, error ellipses of one standard
    deviation at a stated exaggeration. Objects that photos look at levelly are drawn from the side.

    Parameters
    ----------
    block
        The adjusted block; a planned one likewise.
    planned
        Whether nothing was measured: nothing is flagged then.
    """
    view = ground_view(block)
    title = "Planned photos and points" if planned else "Block"
    problem = block.problem
    flagged = np.zeros(len(problem.points), dtype=bool) if planned else flagged_points(block)
    ellipses = _ellipses(view)
    counts = ", ".join(
        (
            counted(len(problem.photos), "photo"),
            counted(len(problem.points), "point"),
            *((f"{int(flagged.sum())} flagged",) if flagged.any() else ()),
        )
    )
    corners = view.footprints[view.whole].reshape(-1, 2)
    # exaggeration goes by the scale of the drawing, its remark is no longer than two lines
    frame = view.frame(Head("block-map", title, "x"), view.centres, corners)
    times, drawn = _exaggeration(ellipses, frame)
    remark = counts
    if times:
        remark += f". Error ellipses {written(times, 0)} times enlarged, one standard deviation"
    head = Head("block-map", title, f"{remark}.")
    plot = Plot(head, view.frame(head, view.centres, corners))
    plot.axes(*view.titles, grid=False)
    _draw_photos(plot, view)
    size, notes = _draw_points(plot, view, flagged)
    if times:
        notes += _draw_ellipses(plot, view, ellipses, drawn, times)
    places, names = draw_control(plot, view, size=max(size, 0.7))
    some = _worst(block, np.flatnonzero(flagged & view.near))[:_MOST_FLAGGED]
    bold = "line bold l-bad" if size == 1.0 else "line l-bad"
    plot.marks("circle", view.at[some], bold, 8.0 * size)
    plot.marks("cross", view.at[some], bold, 4.0 * size)
    if len(some):
        plot.explain(Entry("mark", f"flagged ({int(flagged.sum())})", bold, "circle", 6.5 * size))
    if flagged.sum() > len(some):
        notes += (f"{len(some)} of {int(flagged.sum())} flagged points are drawn, the worst ones.",)
    out = np.zeros(len(problem.points), dtype=bool)
    out[problem.point[problem.newly_rejected.any(axis=1)]] = True
    rejected = np.flatnonzero(out & view.near)
    plot.marks("cross", view.at[rejected[:_MOST_FLAGGED]], "line l-ink", 4.5 * size)
    if len(rejected):
        label = f"a ray is rejected ({len(rejected)})"
        plot.explain(Entry("mark", label, "line l-ink", "cross", 4.5 * size))
    _name(plot, view, places, names, some if size == 1.0 else some[:_NAMED_OF_MANY])
    plot.note(*notes, *view.far_note)
    return plot.drawing(_description(view, flagged, counts, times, planned))


def _name(plot: Plot, view: GroundView, control: Array, names: list[str], flagged: Index) -> None:
    """Write names where there is room: of what is flagged, of control, of photos."""
    points = view.block.problem.points
    at = np.vstack((view.at[flagged], control))
    wanted = [*(points[k] for k in flagged.tolist()), *names]
    left = plot.names(at, wanted, obstacles=view.at[view.near][:3000])
    # rather over a point that nobody asks for than not at all
    plot.names(at[left], [wanted[k] for k in left])
    if len(view.centres) <= 80:
        # photos lie on points often enough: their names may cover marks, not each other's
        plot.names(view.centres, view.block.problem.photos, "t-soft", gap=4.0)


def _draw_photos(plot: Plot, view: GroundView) -> None:
    block = view.block.problem.block
    at = {name: k for k, name in enumerate(view.block.problem.photos)}
    chosen = thinned(view.centres, _MOST_PHOTOS)
    whole = view.whole if len(view.centres) <= _MOST_FOOTPRINTS else view.whole[:0]
    plot.areas(view.footprints[whole], "line thin l-series-1 faint")
    strips = block.strips if view.axes == (0, 1) else ()  # of stations around an object it is none
    for strip in strips:
        places = view.centres[[at[photo] for photo in strip.photos if photo in at]]
        plot.line(places, "dashed l-soft")
    half = 4.0 if len(whole) or len(chosen) < _MOST_FOOTPRINTS else 2.5
    plot.marks("plus", view.centres[chosen], "line l-series-1", half)
    if len(whole):
        plot.explain(Entry("area", "photo on the ground", "line thin l-series-1"))
    plot.explain(Entry("mark", "projection centre", "line l-series-1", "plus", 4.0))
    if strips:
        plot.explain(Entry("line", "strip", "line dashed l-soft"))
    if len(chosen) < len(view.centres):
        plot.note(
            f"{len(chosen)} of {len(view.centres)} projection centres are drawn, one in each part "
            "of the map."
        )
    if len(whole) < len(view.whole):
        plot.note(f"Footprints are drawn of blocks up to {_MOST_FOOTPRINTS} photos.")


def _draw_points(plot: Plot, view: GroundView, flagged: Bools) -> tuple[float, tuple[str, ...]]:
    """Draw the points, and return the factor of the size of marks and what was left out."""
    r = mean_redundancy(view.block)
    known = np.flatnonzero(view.near & np.isfinite(r))
    weakest = known[np.argsort(r[known], kind="stable")][:_MOST_WEAK]
    first = np.concatenate((known[flagged[known]], weakest[~flagged[weakest]]))
    chosen, size = sampled(plot, view.at, known, first, _MOST_POINTS)
    draw_classes(
        plot,
        view.at[chosen],
        r[chosen],
        REDUNDANCY_CLASSES,
        what="r",
        turned=True,
        size=size,
        every=r[known],
    )
    if len(chosen) == len(known):
        return size, ()
    return size, (
        f"{len(chosen)} of {len(known)} points are drawn: flagged ones, the weakest "
        f"{len(weakest)}, and one in each part of the map; the legend counts all.",
    )


def _worst(block: AdjustedBlock, points: Index) -> Index:
    """Return points by the largest abs(w) of their image coordinates, the worst first."""
    largest = np.zeros(len(block.problem.points))
    np.maximum.at(largest, block.problem.point, np.nan_to_num(np.abs(block.w)).max(axis=1))
    return points[np.argsort(-largest[points], kind="stable")]


def _ellipses(view: GroundView) -> Array:
    """Return (p, 2, 2) covariances [m^2] along the axes of the drawing; NaN without sigma."""
    sigma = view.block.sigma
    factor = np.nan if sigma is None else sigma**2
    return view.of_covariances(view.block.cofactors.points) * factor


def _exaggeration(covariance: Array, frame: Frame) -> tuple[float, Index]:
    """Return by how much ellipses are enlarged, and which are drawn; 0 where there are none."""
    size = np.sqrt(np.maximum(np.einsum("nii->n", covariance), 0.0))
    there = np.flatnonzero(np.isfinite(size) & (size > 0.0))
    if not len(there):
        return 0.0, there
    typical = float(np.quantile(size[there], 0.8))
    spacing = sqrt(frame.width * frame.height / len(there))
    scale = frame.scale[0]
    times = round_down(min(max(_SPACING * spacing, _SMALLEST), _LARGEST) / (typical * scale))
    return times, there[size[there] * scale * times <= _TOO_LARGE]


def _draw_ellipses(
    plot: Plot, view: GroundView, covariance: Array, drawn: Index, times: float
) -> tuple[str, ...]:
    drawn = drawn[view.near[drawn]]
    size = np.einsum("nii->n", covariance[drawn])
    drawn = drawn[np.argsort(-size, kind="stable")]  # the largest of a cell first
    room = plot.frame.places(view.at[view.near])
    most = max(int(np.prod(np.ptp(room, axis=0)) / _ROOM_OF_ELLIPSE), _FEWEST_ELLIPSES)
    chosen = drawn[thinned(view.at[drawn], min(most, _MOST_ELLIPSES))]
    plot.ellipses(view.at[chosen], covariance[chosen], times, "line thin l-ink")
    length = round_down(1.2 * _SMALLEST / plot.frame.scale[0] / times)
    wide = length * plot.frame.scale[0] * times
    label = f"error ellipse, half axis {length_of(length)}"
    plot.explain(Entry("ellipse", label, "line thin l-ink", length=2.0 * wide))
    there = int(np.count_nonzero(np.isfinite(np.einsum("nii->n", covariance)) & view.near))
    if len(chosen) < len(drawn):
        return (f"{len(chosen)} of {there} error ellipses are drawn, the largest of each part.",)
    return ()


def length_of(metres: float) -> str:
    """Return a length on the ground as it is read."""
    if metres >= 1.0:
        return f"{metres:.3g} m"
    return f"{1e3 * metres:.3g} mm" if metres >= 1e-4 else f"{1e6 * metres:.3g} µm"


def _description(view: GroundView, flagged: Bools, counts: str, times: float, planned: bool) -> str:
    block = view.block
    control = np.bincount(_control_of(block).kind, minlength=len(CONTROL_SHAPES)).tolist()
    kinds = ", ".join(
        f"{count} {label}" for count, label in zip(control, _CONTROL_IN_WORDS, strict=True) if count
    )
    r = mean_redundancy(block)
    said = [f"{'Planned block' if planned else 'Map of the block'}: {counts}."]
    if kinds:
        said.append(f"Control points: {kinds}.")
    if np.isfinite(r).any():
        weakest = int(np.nanargmin(r))
        said.append(
            f"The mean redundancy number of a point's image coordinates is {np.nanmin(r):.2f} "
            f"at point {block.problem.points[weakest]} to {np.nanmax(r):.2f}."
        )
    if flagged.any():
        names = [block.problem.points[k] for k in np.flatnonzero(flagged)[:10].tolist()]
        said.append(
            f"Flagged points: {', '.join(names)}{' and more' if flagged.sum() > 10 else ''}."
        )
    if times:
        said.append(f"Error ellipses are enlarged {written(times, 0)} times.")
    return " ".join(said)
