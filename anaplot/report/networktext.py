"""A planned network as text: what is determined, what checks it, what is left open."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.planning.networkplan import Network, NetworkReliability
from anaplot.planning.plannedreliability import PlannedReliability
from anaplot.report.columns import PAGE, counted, fitted, shortened, wrapped
from anaplot.textfiles.wording import plain

__all__ = ["network_lines", "point_lines"]

_FEW = 3  # with two rays one coordinate of each is checked by nothing, or next to nothing
_SHOWN, _NAMED = 12, 20
_NAME = 10


def network_lines(network: Network, block: AdjustedBlock, worth: NetworkReliability) -> list[str]:
    """Return the report of a network, at most a page wide."""
    problem, got = block.problem, block.indicators()
    lines = [
        *wrapped(
            f"PLANNED NETWORK {shortened(network.name, PAGE - 20)}: ",
            (
                counted(len(network.stations), "station"),
                counted(len(network.points), "point"),
                f"{len(network.control)} of them control",
            ),
        ),
        f"n {problem.observations}, u {problem.unknowns}, redundancy {block.redundancy}; "
        f"a-priori sigma0 {network.image_um:g} um",
        f"RI (mean r)         x' {got.ri_x:.3f}   y' {got.ri_y:.3f}   both {got.ri:.3f}",
        f"AI (mean deviation)  {_means((got.ai_x, got.ai_y, got.ai_z, got.ai))}",
    ]
    if network.control:
        lines.append(f"  {f'new points ({worth.new_determined})':<17}  {_means(worth.new_s)}")
    else:
        lines.append("no control: a free network")
    lines += _open(worth)
    lines += ["", "PHOTOS, the one with the weakest observation first", _head("PHOTO", "POINT")]
    lines += [_row(one) for one in worth.photos[:_SHOWN]] + _more(len(worth.photos))
    lines += ["", "POINTS, the one with the weakest observation first",
              _head("POINT", "PHOTO") + "   sX mm   sY mm   sZ mm"]  # fmt: skip
    lines += [_row(one) + _deviations(one) for one in worth.points[:_SHOWN]]
    lines += _more(len(worth.points)) + _few(network, worth)
    spurs = block.spurs()
    if spurs:
        names = [f"{plain(point)} {axis} in {plain(photo)}" for photo, point, axis in spurs]
        lines += ["", f"SPUR OBSERVATIONS: next to nothing checks these {len(spurs)}"]
        lines += wrapped("  ", _named(names))
    return lines


def point_lines(block: AdjustedBlock, point: str) -> list[str]:
    """Return the correlations of a point's residuals, as many columns at a time as fit."""
    labels, rho = block.point_correlations(point)
    lines = wrapped(
        f"POINT {shortened(point, PAGE // 2)}: ",
        ("correlations of its residuals,", "and what is detectable"),
        separator="",
    )
    names = [f"{shortened(photo, _NAME)} {axis}" for photo, _, axis in labels]
    width = max(7, *(len(name) + 1 for name in names))
    mdb = {
        (row.photo, one.axis): one.mdb
        for row in block.ray_rows()
        if row.point == point
        for one in row.xy
    }
    at_once = (PAGE - 2 - width - 9) // width
    for first in range(0, len(names), at_once):
        columns = slice(first, first + at_once)
        last = first + at_once >= len(names)
        head = "".join(f"{name:>{width}}" for name in names[columns])
        lines.append(" " * (width + 2) + head + ("   MDB um" if last else ""))
        for name, (photo, _, axis), values in zip(names, labels, rho, strict=True):
            cells = "".join(
                f"{'-' if np.isnan(v) else format(v, '.3f'):>{width}}" for v in values[columns]
            )
            size = f"{fitted(mdb[photo, axis], 1, 8):>9}" if last else ""
            lines.append(f"  {name:<{width}}{cells}{size}")
    return lines


def _means(metres: tuple[float, float, float, float] | None) -> str:
    if metres is None:
        return "-"
    return "X {}   Y {}   Z {}   all {} mm".format(*(fitted(1e3 * v, 3, 8) for v in metres))


def _open(worth: NetworkReliability) -> list[str]:
    """Return what the network leaves open."""
    lines = []
    if worth.not_determined:
        names = [f"{plain(p)} ({_photos(worth.rays[p])})" for p in worth.not_determined]
        count = len(names)
        lines.append(f"NOT DETERMINED: {count} new point{'s' * (count > 1)}")
        lines += wrapped("  ", _named(names))
    if worth.unused_photos:
        lines += wrapped(
            "STATIONS WITHOUT USABLE RAYS: ", _named([plain(p) for p in worth.unused_photos])
        )
    if worth.unused_control:
        lines += wrapped(
            "CONTROL WITHOUT USABLE RAYS: ", _named([plain(p) for p in worth.unused_control])
        )
    return ["", *lines] if lines else []


def _few(network: Network, worth: NetworkReliability) -> list[str]:
    """Return which of the determined new points are seen in few photos."""
    apart = {row.point for row in network.control} | set(worth.not_determined)
    seen = {point: rays for point, rays in worth.rays.items() if point not in apart}
    lines = []
    for count in range(_FEW):
        names = [plain(name) for name, rays in seen.items() if rays == count]
        if names:
            lines += wrapped(f"  {_photos(count)}: ", _named(names))
    if lines:
        return ["", f"SEEN IN FEWER THAN {_FEW} PHOTOS", *lines]
    which = "every other" if worth.not_determined else "every"
    return ["", f"{which} new point is seen in {_FEW} photos or more"] if seen else []


def _photos(count: int) -> str:
    return "1 photo" if count == 1 else f"{count or 'no'} photos"


def _named(names: list[str]) -> Iterable[str]:
    more = len(names) - _NAMED
    return (*names[:_NAMED], f"and {more} more") if more > 0 else names


def _more(count: int) -> list[str]:
    return [f"  and {count - _SHOWN} more"] if count > _SHOWN else []


def _head(first: str, other: str) -> str:
    return f"  {first:<{_NAME}} RAYS mean r  least  {'AT ' + other:<{_NAME}}     MDB um"


def _row(worth: PlannedReliability) -> str:
    return (
        f"  {shortened(worth.name, _NAME):<{_NAME}} {worth.rays:>4} {worth.mean_r:>6.3f} "
        f"{worth.low_r:>6.3f}  {shortened(worth.weakest, _NAME):<{_NAME}} {worth.axis}"
        f" {fitted(worth.mdb_um, 1, 8):>8}"
    )


def _deviations(worth: PlannedReliability) -> str:
    values = worth.s_xyz or (None, None, None)
    return "".join(f" {fitted(None if v is None else 1e3 * v, 3, 7):>7}" for v in values)
